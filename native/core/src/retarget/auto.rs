//! `method="auto"`: the source is warped onto the target's skeleton and rest pose, deformed onto
//! its surface, and matched by closest points; what no match serves is filled smoothly, and loose
//! parts are treated as things of their own.

use glam::DVec3;
use kdtree::KdTree;
use kdtree::distance::squared_euclidean;
use rayon::prelude::*;

use super::alignment::align;
use super::deform::{DeformSettings, Deformer};
use super::differing_shapes::mix_skeleton_weights;
use super::icp::{IcpSettings, Surroundings, register};
use super::inpaint::{InpaintSettings, Row};
use super::landmarks::check_landmarks;
use super::marks::{Anchor, Constraint};
use super::part_weights::{PartWeights, weigh_parts};
use super::parts::{PartPolicy, SourceWeights, plan_parts};
use super::ray_marks::{RayMark, ray_marks};
use super::rejection::{RejectionSettings, SurfaceMatch, match_surfaces};
use super::shell::Shell;
use super::{Origin, RetargetError, Retargeted, Settings, pair_bones};
use crate::mesh::{MeshError, SurfaceQuery, TriangleMesh};
use crate::progress::Progress;
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;
use crate::spectral::SpectralError;

/// What a landmark of the user weighs; automatic ones weigh some tens.
const USER_WEIGHT: f64 = 3000.0;

/// Inpainting reaches this far from accepted matches, as a share of the extent.
const FAR_FROM_MATCHES: f64 = 0.02;

/// A character with both of its halves.
#[derive(Clone, Copy)]
pub(super) struct Rigged<'a> {
    pub(super) mesh: &'a TriangleMesh,
    pub(super) skeleton: &'a Skeleton,
}

pub(super) fn retarget(
    source: Rigged<'_>,
    source_weights: &SkinWeights,
    target: Rigged<'_>,
    landmarks: Option<&[[i64; 2]]>,
    settings: &Settings,
    progress: &Progress,
) -> Result<Retargeted, RetargetError> {
    let stage: u32 = std::env::var("STAGE").ok().and_then(|s| s.parse().ok()).unwrap_or(9);
    progress.begin("Reading the characters", 0.0, 0.1)?;
    let takes_part = source_weights.used_bones();
    let pairs = pair_bones(source.skeleton, target.skeleton, &takes_part)?;
    let given = match landmarks {
        Some(given) => check_landmarks(given, source.mesh.vertex_count(), target.mesh.vertex_count())?,
        None => Vec::new(),
    };
    let on_source = |error| mesh_error("source", error);
    let source_query = SurfaceQuery::new(source.mesh).map_err(on_source)?;
    let source_shell = Shell::new(source.mesh, &source_query, progress)?;
    let target_query = SurfaceQuery::new(target.mesh).map_err(|error| mesh_error("target", error))?;
    let target_shell = Shell::new(target.mesh, &target_query, progress)?;
    let source_surface = Surroundings { mesh: source.mesh, query: &source_query, shell: &source_shell };
    let target_surface = Surroundings { mesh: target.mesh, query: &target_query, shell: &target_shell };

    progress.begin("Aligning the skeletons", 0.1, 0.4)?;
    let (alignment, shares) = align(
        source_surface,
        source.skeleton,
        source_weights,
        &takes_part,
        target_surface,
        target.skeleton.renumbered(source.skeleton, &pairs),
        progress,
    )?;
    let warped = alignment.warp().apply(source.mesh.vertices(), source_weights);
    let warped = weighted_surface(warped, source.mesh, source_weights).map_err(on_source)?;

    progress.begin("Deforming the surface", 0.4, 0.8)?;
    let query = SurfaceQuery::new(&warped).map_err(on_source)?;
    let shell = Shell::new(&warped, &query, progress)?;
    let surface = Surroundings { mesh: &warped, query: &query, shell: &shell };
    let found = ray_marks((surface, source_weights), target_surface, &alignment.aligned, &takes_part);
    let marks: Vec<Constraint> = given
        .iter()
        .map(|&[s, t]| Constraint {
            anchor: Anchor::Vertex(s),
            position: target.mesh.vertices()[t as usize],
            weight: USER_WEIGHT,
            trusted: true,
        })
        .chain(found.iter().map(RayMark::constraint))
        .collect();
    let spectral = |error| spectral_error("source", error);
    let mut moved = warped.clone();
    if stage >= 1 {
        let deformer = Deformer::new(&warped, &marks).map_err(spectral)?;
        let mut fitted = deformer.fit(&DeformSettings::default(), progress).map_err(spectral)?;
        if stage >= 2 {
            fitted.vertices = register(&deformer, &fitted, target_surface, &IcpSettings::default(), progress)
                .map_err(spectral)?
                .vertices;
        }
        moved = TriangleMesh::new(fitted.vertices, warped.triangles().to_vec()).map_err(on_source)?;
    }

    progress.begin("Matching surfaces", 0.8, 0.9)?;
    let query = SurfaceQuery::new(&moved).map_err(on_source)?;
    let shell = Shell::new(&moved, &query, progress)?;
    let surface = Surroundings { mesh: &moved, query: &query, shell: &shell };
    let spectral = |error| spectral_error("target", error);
    let matches =
        match_surfaces(surface, target_surface, &RejectionSettings::default(), progress).map_err(spectral)?;
    let accepted: Vec<bool> = matches.iter().map(|found| found.accepted || stage < 4).collect();
    let depth = FAR_FROM_MATCHES * target_surface.shell.extent;
    let far = far_from_matches(target.mesh.vertices(), &accepted, depth);
    let known: Vec<bool> = accepted.iter().zip(&far).map(|(accepted, far)| *accepted || *far).collect();
    let rows: Vec<Row> = matches.iter().map(|found| blend(found, &moved, source_weights)).collect();

    progress.begin("Filling weights", 0.9, 1.0)?;
    let source_rows: Vec<Row> = (0..source.mesh.vertex_count())
        .map(|v| source_weights.entries(v).map(|(bone, weight)| (bone, f64::from(weight))).collect())
        .collect();
    let deformed = SourceWeights { surface, rows: &source_rows };
    let parts = plan_parts(target.mesh, &accepted, deformed, PartPolicy::Auto);
    let filling = InpaintSettings::default();
    let mut filled =
        weigh_parts(target.mesh, &parts, &rows, &known, deformed, &filling, progress).map_err(spectral)?;
    let origin = origins(&filled, &accepted);
    if stage >= 5 {
        mix_skeleton_weights(&mut filled.rows, target.mesh.vertices(), &alignment, &shares, |v| {
            origin[v] != Origin::Part
        });
    }
    let rows = filled.rows.iter().map(|row| renumber(row, &pairs));
    let mut weights = SkinWeights::from_rows(rows, target.skeleton.bone_count());
    if let Some(count) = settings.max_influences {
        weights = weights.limited(count);
    }
    Ok(Retargeted {
        weights: weights.normalized(),
        correspondence: matches.iter().map(|found| nearest(found, &moved)).collect(),
        matched: origin.iter().map(|&origin| origin == Origin::Matched).collect(),
        origin,
        landmarks: given.into_iter().chain(found.iter().map(RayMark::vertices)).collect(),
    })
}

/// The moved vertices with the triangles whose corners all have weights.
fn weighted_surface(
    moved: Vec<DVec3>,
    mesh: &TriangleMesh,
    weights: &SkinWeights,
) -> Result<TriangleMesh, MeshError> {
    let has_weights = |&v: &u32| !weights.row(v as usize).0.is_empty();
    let kept = mesh.triangles().iter().filter(|t| t.iter().all(has_weights)).copied().collect();
    TriangleMesh::new(moved, kept)
}

/// Weights of the source at a match.
fn blend(found: &SurfaceMatch, mesh: &TriangleMesh, weights: &SkinWeights) -> Row {
    let mut row = Row::new();
    for (&corner, share) in mesh.triangles()[found.triangle as usize].iter().zip(found.barycentric) {
        let total = weights.total(corner as usize);
        for (bone, weight) in weights.entries(corner as usize) {
            let part = share * f64::from(weight) / total;
            match row.binary_search_by_key(&bone, |entry| entry.0) {
                Ok(at) => row[at].1 += part,
                Err(at) => row.insert(at, (bone, part)),
            }
        }
    }
    row
}

/// Corner of the matched triangle that is nearest to the match.
fn nearest(found: &SurfaceMatch, mesh: &TriangleMesh) -> u32 {
    let shares = found.barycentric;
    let largest = (0..3).rev().max_by(|&a, &b| shares[a].total_cmp(&shares[b])).unwrap_or(0);
    mesh.triangles()[found.triangle as usize][largest]
}

/// Vertices without an accepted match that have none within `depth` of them either: there is
/// nothing to inpaint from, and the closest point of the source is the better guess.
fn far_from_matches(vertices: &[DVec3], accepted: &[bool], depth: f64) -> Vec<bool> {
    let mut tree = KdTree::new(3);
    for (vertex, point) in vertices.iter().enumerate().filter(|(vertex, _)| accepted[*vertex]) {
        // Coordinates of a mesh are finite, so adding them cannot fail.
        let _ = tree.add(point.to_array(), vertex);
    }
    let is_far = |(point, accepted): (&DVec3, &bool)| {
        let nearest = tree.nearest(&point.to_array(), 1, &squared_euclidean);
        !accepted && nearest.is_ok_and(|found| found.first().is_none_or(|found| found.0 > depth * depth))
    };
    vertices.par_iter().zip(accepted).map(is_far).collect()
}

fn origins(filled: &PartWeights, accepted: &[bool]) -> Vec<Origin> {
    let origin = |accepted: &bool| if *accepted { Origin::Matched } else { Origin::Nearest };
    let mut origin: Vec<Origin> = accepted.iter().map(origin).collect();
    filled.inpainted.iter().for_each(|&v| origin[v as usize] = Origin::Inpainted);
    for part in filled.parts.iter().filter(|part| part.policy != PartPolicy::Match) {
        part.vertices.iter().for_each(|&v| origin[v as usize] = Origin::Part);
    }
    origin
}

/// A row with the target's bone numbers, ascending. Bones with weight always have a partner.
fn renumber(row: &Row, pairs: &[Option<u32>]) -> Row {
    let mut renamed: Row =
        row.iter().filter_map(|&(bone, weight)| Some((pairs[bone as usize]?, weight))).collect();
    renamed.sort_unstable_by_key(|entry| entry.0);
    renamed
}

fn mesh_error(side: &'static str, error: MeshError) -> RetargetError {
    RetargetError::Mesh { side, error }
}

fn spectral_error(side: &'static str, error: SpectralError) -> RetargetError {
    match error {
        SpectralError::Cancelled(cancelled) => cancelled.into(),
        error => RetargetError::Spectral { side, error },
    }
}
