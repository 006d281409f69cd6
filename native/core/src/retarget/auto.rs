//! `method="auto"`: the source is warped onto the target's skeleton and rest pose and deformed onto
//! its surface; [`super::surface_weights`] then takes the weights over.

use glam::DVec3;

use super::alignment::align;
use super::cloth::Worn;
use super::deform::{DeformSettings, Deformer};
use super::differing_shapes::{Difference, Differing};
use super::icp::{IcpSettings, Surroundings, register};
use super::joint_refinement::Alignment;
use super::landmarks::check_landmarks;
use super::marks::{Anchor, Constraint};
use super::ray_marks::{RayMark, ray_marks};
use super::rejection::RejectionSettings;
use super::shell::{Shell, extent};
use super::similarity::{EXACT, POINTS, Pair, distances_to, fit, similar};
use super::sliding::{lengths, slide};
use super::surface_sample::samples;
use super::surface_weights::take_over;
use super::warp::Warp;
use super::{RetargetError, Retargeted, Settings};
use crate::mesh::{MeshError, SurfaceQuery, TriangleMesh};
use crate::progress::Progress;
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;
use crate::spectral::SpectralError;

/// What a landmark of the user weighs; automatic ones weigh some tens.
const USER_WEIGHT: f64 = 3000.0;

/// The source fits as a whole where almost all of the surfaces, by area, then lies within this share of
/// the extent and the alignment of the skeletons does not bring them nearer by
const COINCIDE: f64 = 0.003;
const ALMOST_ALL: f64 = 0.95;
/// this factor,
const MUST_SHRINK: f64 = 0.5;
/// or where both have one skeleton and half of the area lies within this share: a garment on its wearer.
const WORN: f64 = 0.01;
/// It is one at any distance where so much of the wearer
const BARE: f64 = 0.1;
/// is farther from it than this share of the extent.
const COVERED: f64 = 0.05;

/// Joints off by this share of the extent may feign the turn of a bone.
const FEIGNED: f64 = 0.0125;

/// Share of the progress after which the skeletons are aligned,
const ALIGNED: f64 = 0.32;
/// and after which the target is bound to its own skeleton, where it is.
pub(super) const BOUND: f64 = 0.6;

/// Tests of matches for garments, whose folds, linings and distance say little; but where cloth spans
/// two limbs, as at the crotch, closest points tear it apart.
const WORN_LOOSELY: RejectionSettings = RejectionSettings {
    max_angle: 180.0,
    max_distance: f64::INFINITY,
    max_depth: 10.0,
    other_wall: false,
    way_back: false,
    max_stretch: 3.0,
};

/// A character with both of its halves.
#[derive(Clone, Copy)]
pub(super) struct Rigged<'a> {
    pub(super) mesh: &'a TriangleMesh,
    pub(super) skeleton: &'a Skeleton,
}

/// The source on the target.
struct Placed {
    mesh: TriangleMesh,
    /// How the target is worn by the source, if it is.
    worn: Option<Worn>,
    /// Automatic landmarks: source vertex, target vertex.
    landmarks: Vec<[u32; 2]>,
    /// How source and target differ in shape, if they do.
    difference: Option<Difference>,
}

/// Retargets between skeletons of which `pairs` tells the target bone of each source bone. Where
/// `binds`, or where shapes differ, the shares of the progress from [`BOUND`] on are left to the caller.
pub(super) fn retarget(
    (source, source_weights): (Rigged<'_>, &SkinWeights),
    target: Rigged<'_>,
    pairs: &[Option<u32>],
    landmarks: Option<&[[i64; 2]]>,
    (settings, binds): (&Settings, bool),
    progress: &Progress,
) -> Result<(Retargeted, Option<Differing>), RetargetError> {
    progress.begin("Reading the characters", 0.0, 0.05)?;
    let takes_part = source_weights.used_bones();
    let choice = settings.parts.resolved(target.mesh)?;
    let given = match landmarks {
        Some(given) => check_landmarks(given, source.mesh.vertex_count(), target.mesh.vertex_count())?,
        None => Vec::new(),
    };
    let user: Vec<Constraint> = given
        .iter()
        .map(|&[s, t]| Constraint {
            anchor: Anchor::Vertex(s),
            position: target.mesh.vertices()[t as usize],
            weight: USER_WEIGHT,
            trusted: true,
        })
        .collect();
    let on_source = |error| mesh_error("source", error);
    let source_query = SurfaceQuery::new(source.mesh).map_err(on_source)?;
    let source_shell = Shell::new(source.mesh, &source_query, progress)?;
    progress.begin("Reading the characters", 0.05, 0.1)?;
    let target_query = SurfaceQuery::new(target.mesh).map_err(|error| mesh_error("target", error))?;
    let mut target_shell = Shell::new(target.mesh, &target_query, progress)?;
    let given_skeleton = target.skeleton.renumbered(source.skeleton, pairs);
    let whole = as_large_as((source, source_weights), &given_skeleton, &takes_part).map_err(on_source)?;
    target_shell.extent = target_shell.extent.max(whole);
    let source_surface = Surroundings { mesh: source.mesh, query: &source_query, shell: &source_shell };
    let target_surface = Surroundings { mesh: target.mesh, query: &target_query, shell: &target_shell };

    progress.begin("Aligning the skeletons", 0.1, ALIGNED)?;
    let (alignment, difference) = align(
        source_surface,
        source.skeleton,
        source_weights,
        &takes_part,
        target_surface,
        given_skeleton.clone(),
        progress,
    )?;
    let difference = Some(difference).filter(|difference| difference.share > 0.0);
    let _matching = progress.part(ALIGNED, if binds || difference.is_some() { BOUND } else { 1.0 });
    let warped = warped(&alignment).map_err(on_source)?;
    let warped_query = SurfaceQuery::new(&warped).map_err(on_source)?;
    let warped_surface = Surroundings { mesh: &warped, query: &warped_query, shell: &source_shell };
    let placed = match as_a_whole(&alignment, &warped_query, &given_skeleton, target_surface, progress)? {
        Some((whole, worn)) => {
            let mesh = if user.is_empty() { whole } else { fitted(&whole, &user, progress)? };
            Placed { mesh, worn, landmarks: Vec::new(), difference: None }
        }
        None => on_target(
            (&alignment, &given_skeleton),
            warped_surface,
            difference,
            target_surface,
            (user, &given),
            progress,
        )?,
    };

    let tests = if placed.worn.is_some() { WORN_LOOSELY } else { RejectionSettings::default() };
    let found = (&placed.mesh, source_weights);
    let taken = take_over(found, (&tests, placed.worn), target_surface, &choice, progress)?;
    let rows = taken.rows.iter().map(|row| {
        // Bones with weight always have a partner.
        let mut renamed: Vec<(u32, f64)> =
            row.iter().filter_map(|&(bone, weight)| Some((pairs[bone as usize]?, weight))).collect();
        renamed.sort_unstable_by_key(|entry| entry.0);
        renamed
    });
    let mut weights = SkinWeights::from_rows(rows, target.skeleton.bone_count());
    if let Some(count) = settings.max_influences {
        weights = weights.limited(count);
    }
    let differing = placed.difference.map(|difference| Differing {
        difference,
        matches: taken.matches,
        origin: taken.origin.clone(),
        parts: taken.parts.clone(),
        source: (source_query, source_shell),
        target: (target_query, target_shell),
    });
    let found = Retargeted {
        weights: weights.normalized(),
        correspondence: taken.correspondence,
        matched: taken.matched,
        origin: taken.origin,
        parts: taken.parts,
        landmarks: given.into_iter().chain(placed.landmarks).collect(),
    };
    Ok((found, differing))
}

/// Extent of the source on the target's skeleton: a garment is a small part of a character, whose size counts.
fn as_large_as(
    (source, weights): (Rigged<'_>, &SkinWeights),
    given: &Skeleton,
    takes_part: &[bool],
) -> Result<f64, MeshError> {
    let length = |skeleton: &Skeleton| -> f64 {
        (0..takes_part.len()).filter(|&bone| takes_part[bone]).map(|bone| skeleton.length(bone)).sum()
    };
    let scale = length(given) / length(source.skeleton);
    let girth = if scale.is_finite() { scale } else { 1.0 };
    let (girths, unturned) = (vec![girth; takes_part.len()], vec![0.0; takes_part.len()]);
    let warp = Warp::new(source.skeleton, given, takes_part, &girths, &unturned);
    let moved = warp.apply(source.mesh.vertices(), weights);
    Ok(extent(&weighted_surface(moved, (source.mesh, weights))?))
}

/// The source moved as a whole, if that brings it about as near to the target as the alignment of
/// the skeletons does, which `warped` queries, and whether the target is a garment on it.
fn as_a_whole(
    alignment: &Alignment<'_>,
    warped: &SurfaceQuery,
    given: &Skeleton,
    target: Surroundings<'_>,
    progress: &Progress,
) -> Result<Option<(TriangleMesh, Option<Worn>)>, RetargetError> {
    let on_source = |error| mesh_error("source", error);
    let rigs = (alignment.skeleton, given);
    let of_source = samples(alignment.source.mesh, alignment.skeleton, |_| Some(0), POINTS);
    let of_target = samples(target.mesh, given, |_| Some(0), POINTS);
    let of_source = (alignment.source.mesh.vertices(), of_source.as_slice());
    let of_target = (target.mesh, of_target.as_slice());
    progress.begin("Comparing the surfaces", 0.0, 0.12)?;
    let (moved, one_skeleton) = similar(of_source, rigs, alignment.takes_part, target, progress)?;
    let whole = weighted_surface(moved, (alignment.source.mesh, alignment.weights)).map_err(on_source)?;
    let whole_query = SurfaceQuery::new(&whole).map_err(on_source)?;
    let left = distances_to(warped, of_target, [0.6, 0.7], progress)?.below(ALMOST_ALL);
    let off = distances_to(&whole_query, of_target, [0.7, 0.85], progress)?;
    let bare = distances_to(target.query, (&whole, of_source.1), [0.85, 1.0], progress)?;
    let is_part = bare.below(1.0 - BARE) > COVERED * target.shell.extent
        && ends_agree(alignment, given) <= EXACT * target.shell.extent;
    let worn = one_skeleton && (is_part || off.below(0.5) <= WORN * target.shell.extent);
    let off = off.below(ALMOST_ALL);
    let coincide = off <= COINCIDE * target.shell.extent && left >= MUST_SHRINK * off;
    let how = if off <= COINCIDE * target.shell.extent { Worn::OnSkin } else { Worn::Hanging };
    Ok((worn || coincide).then_some((whole, worn.then_some(how))))
}

/// How far both ends of the bones are apart after the similarity that brings them nearest: the heads of two bones
/// fit in any case.
fn ends_agree(alignment: &Alignment<'_>, given: &Skeleton) -> f64 {
    let (from, bones) = (alignment.skeleton, 0..alignment.takes_part.len());
    let ends = |bone: usize| {
        let [heads, tails] = [(from.heads(), given.heads()), (from.tails(), given.tails())];
        [heads, tails].map(|(from, to)| (from[bone], to[bone], 1.0))
    };
    let pairs: Vec<Pair> = bones.filter(|&bone| alignment.takes_part[bone]).flat_map(ends).collect();
    fit(&pairs, &mut [])
}

/// The source, warped onto the target's skeleton, deformed onto its surface. Which side of it is
/// outside is what it was before the warp.
fn on_target(
    (alignment, given_skeleton): (&Alignment<'_>, &Skeleton),
    warped: Surroundings<'_>,
    difference: Option<Difference>,
    target: Surroundings<'_>,
    (user, given): (Vec<Constraint>, &[[u32; 2]]),
    progress: &Progress,
) -> Result<Placed, RetargetError> {
    progress.begin("Finding landmarks", 0.12, 0.2)?;
    let found = ray_marks((warped, alignment.weights), target, &alignment.aligned, alignment.takes_part);
    let marks: Vec<Constraint> = user.into_iter().chain(found.iter().map(RayMark::constraint)).collect();
    let source = alignment.source.mesh;
    let stay: Vec<DVec3> = given.iter().map(|&[s, _]| source.vertices()[s as usize]).collect();
    let share = difference.map_or(0.0, |difference| difference.share);
    let on_source = (source, alignment.weights);
    let slides = (share < 1.0).then(|| {
        // Refined joints serve the fit; the given ones tell the pose.
        let (rig, none) = (alignment.skeleton, vec![0.0; alignment.skeleton.bone_count()]);
        let pose = Warp::new(rig, given_skeleton, alignment.takes_part, &none, &none);
        let error = FEIGNED * alignment.source.shell.extent;
        let posed = pose.repose(rig, error, on_source.0.vertices(), on_source.1);
        (posed, lengths(on_source, alignment.skeleton, &stay, share))
    });
    let mesh = registered(warped, &marks, slides, target, progress)?;
    Ok(Placed { mesh, worn: None, landmarks: found.iter().map(RayMark::vertices).collect(), difference })
}

/// A surface deformed to marks.
fn fitted(
    mesh: &TriangleMesh,
    marks: &[Constraint],
    progress: &Progress,
) -> Result<TriangleMesh, RetargetError> {
    let spectral = |error| spectral_error("source", error);
    progress.begin("Fitting landmarks", 0.2, 0.63)?;
    let deformer = Deformer::new(mesh, marks).map_err(spectral)?;
    let fitted = deformer.fit(&DeformSettings::default(), progress).map_err(spectral)?;
    moved_to(mesh, fitted.vertices)
}

/// A surface deformed to marks and then onto a target, where it slides along, if told its vertices at
/// rest in the target's pose and how far.
fn registered(
    surface: Surroundings<'_>,
    marks: &[Constraint],
    slides: Option<(Vec<DVec3>, Vec<f64>)>,
    target: Surroundings<'_>,
    progress: &Progress,
) -> Result<TriangleMesh, RetargetError> {
    let spectral = |error| spectral_error("source", error);
    progress.begin("Fitting landmarks", 0.2, 0.35)?;
    let deformer = Deformer::new(surface.mesh, marks).map_err(spectral)?;
    let fitted = deformer.fit(&DeformSettings::default(), progress).map_err(spectral)?;
    progress.begin("Deforming the surface", 0.35, 0.57)?;
    let settings = IcpSettings::default();
    let registered = register(&deformer, &fitted, target, &settings, progress).map_err(spectral)?;
    progress.begin("Sliding along the surface", 0.57, 0.63)?;
    let Some((posed, lengths)) = slides else { return moved_to(surface.mesh, registered.vertices) };
    let start = (deformer.surface(), registered.vertices.as_slice());
    let slid = slide(start, (&posed, &lengths), surface.shell, target, progress).map_err(spectral)?;
    moved_to(surface.mesh, slid)
}

fn moved_to(mesh: &TriangleMesh, vertices: Vec<DVec3>) -> Result<TriangleMesh, RetargetError> {
    TriangleMesh::new(vertices, mesh.triangles().to_vec()).map_err(|error| mesh_error("source", error))
}

fn warped(alignment: &Alignment<'_>) -> Result<TriangleMesh, MeshError> {
    let moved = alignment.warp().apply(alignment.source.mesh.vertices(), alignment.weights);
    weighted_surface(moved, (alignment.source.mesh, alignment.weights))
}

/// Moved vertices with the triangles whose corners all have weights.
fn weighted_surface(
    moved: Vec<DVec3>,
    (mesh, weights): (&TriangleMesh, &SkinWeights),
) -> Result<TriangleMesh, MeshError> {
    let has_weights = |&v: &u32| !weights.row(v as usize).0.is_empty();
    let triangles = mesh.triangles().iter();
    TriangleMesh::new(moved, triangles.filter(|t| t.iter().all(has_weights)).copied().collect())
}

pub(super) fn mesh_error(side: &'static str, error: MeshError) -> RetargetError {
    RetargetError::Mesh { side, error }
}

pub(super) fn spectral_error(side: &'static str, error: SpectralError) -> RetargetError {
    match error {
        SpectralError::Cancelled(cancelled) => cancelled.into(),
        SpectralError::Mesh(error) => mesh_error(side, error),
        error => RetargetError::Spectral { side, error },
    }
}
