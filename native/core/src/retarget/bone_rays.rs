//! Rays from the bones to the surface, shot alike on source and target: what a limb's girth is, and
//! which places of the two surfaces correspond.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::warp::Warp;
use crate::mesh::{RayHit, SurfaceQuery, TriangleMesh};
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// A ray leaves the surface no flatter than this sine.
const STEEP: f64 = 0.2;

/// A ray belongs to its bone where it leaves the source through skin that the bone moves.
const OWN_WEIGHT: f64 = 0.3;

/// A surface with its queries and the side that its triangles face.
pub(super) struct Surface<'a> {
    pub(super) mesh: &'a TriangleMesh,
    pub(super) query: SurfaceQuery,
    /// -1 for a surface that is inside out.
    pub(super) outward: f64,
}

/// Where a pair of rays left the two surfaces.
#[derive(Debug, Clone, Copy)]
pub(super) struct RayPair {
    pub(super) bone: u32,
    /// Place along the bone, 0 at the head.
    pub(super) station: f64,
    pub(super) source: RayHit,
    pub(super) target: RayHit,
}

impl RayPair {
    /// How much longer the target's ray is, as a logarithm.
    pub(super) fn log_ratio(&self) -> f64 {
        (self.target.distance / self.source.distance).ln()
    }
}

/// Where the rays of a search start and how many there are around a bone.
pub(super) struct Fan<'a> {
    pub(super) stations: &'a [f64],
    pub(super) directions: u32,
}

/// Shoots a fan of rays from every bone that takes part, on the source from its own skeleton, on
/// the target from the aligned skeleton, turned as the warp turns them. Keeps the pairs of which
/// both leave their surface outward, on the source through the bone's own skin.
pub(super) fn shoot(
    (source, skeleton, weights): (&Surface<'_>, &Skeleton, &SkinWeights),
    (target, aligned): (&Surface<'_>, &Skeleton),
    warp: &Warp,
    takes_part: &[bool],
    fan: &Fan<'_>,
) -> Vec<RayPair> {
    let centre = centre(source.mesh);
    let bones: Vec<usize> =
        (0..takes_part.len()).filter(|&b| takes_part[b] && skeleton.length(b) > 0.0).collect();
    let shoot_bone = |&b: &usize| {
        let along = skeleton.tails()[b] - skeleton.heads()[b];
        let frame = ray_frame(skeleton, b, centre);
        let mut pairs = Vec::new();
        for &station in fan.stations {
            let origin = skeleton.heads()[b] + along * station;
            let goal = aligned.heads()[b] + (aligned.tails()[b] - aligned.heads()[b]) * station;
            for k in 0..fan.directions {
                let angle = std::f64::consts::TAU * f64::from(k) / f64::from(fan.directions);
                let direction = frame * DVec3::new(libm::cos(angle), libm::sin(angle), 0.0);
                let Some(on_source) = exit(source, origin, direction) else { continue };
                if own_weight(source.mesh, weights, on_source.triangle, b as u32) < OWN_WEIGHT {
                    continue;
                }
                if let Some(on_target) = exit(target, goal, warp.bones[b].rotation * direction) {
                    pairs.push(RayPair { bone: b as u32, station, source: on_source, target: on_target });
                }
            }
        }
        pairs
    };
    bones.par_iter().flat_map_iter(shoot_bone).collect()
}

/// Logarithm of the ratio of girths of every bone (B): the median over its rays, or over all rays
/// where a bone has too few.
pub(super) fn log_girths(pairs: &[RayPair], bone_count: usize) -> Vec<f64> {
    const FEW: usize = 4;
    let mut of_bone: Vec<Vec<f64>> = vec![Vec::new(); bone_count];
    for pair in pairs {
        of_bone[pair.bone as usize].push(pair.log_ratio());
    }
    let whole = median(of_bone.iter().flatten().copied().collect()).unwrap_or(0.0);
    of_bone
        .into_iter()
        .map(|ratios| if ratios.len() < FEW { whole } else { median(ratios).unwrap_or(whole) })
        .collect()
}

/// Middle value; the mean of the two in the middle of an even number.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        n if n % 2 == 1 => Some(values[middle]),
        _ => Some(0.5 * (values[middle - 1] + values[middle])),
    }
}

/// Side that a surface faces: rays from inside mostly leave through the outer side of triangles.
pub(super) fn outward(mesh: &TriangleMesh, query: &SurfaceQuery, skeleton: &Skeleton, takes_part: &[bool]) -> f64 {
    let centre = centre(mesh);
    let mut balance = 0i64;
    for b in (0..takes_part.len()).filter(|&b| takes_part[b] && skeleton.length(b) > 0.0) {
        let middle = 0.5 * (skeleton.heads()[b] + skeleton.tails()[b]);
        let frame = ray_frame(skeleton, b, centre);
        for direction in [frame.x_axis, frame.y_axis, -frame.x_axis, -frame.y_axis] {
            if let Some(hit) = query.cast_ray(middle, direction) {
                balance += if mesh.area_vector(hit.triangle as usize).dot(direction) < 0.0 { -1 } else { 1 };
            }
        }
    }
    if balance < 0 { -1.0 } else { 1.0 }
}

/// First hit of a ray, if it leaves the surface there.
fn exit(surface: &Surface<'_>, origin: DVec3, direction: DVec3) -> Option<RayHit> {
    let hit = surface.query.cast_ray(origin, direction)?;
    let normal = surface.mesh.area_vector(hit.triangle as usize).normalize_or_zero() * surface.outward;
    (hit.distance > 0.0 && normal.dot(direction) > STEEP).then_some(hit)
}

/// Mean weight of a bone at the corners of a triangle, as a share of all weights there.
fn own_weight(mesh: &TriangleMesh, weights: &SkinWeights, triangle: u32, bone: u32) -> f64 {
    let (mut own, mut all) = (0.0, 0.0);
    for &corner in &mesh.triangles()[triangle as usize] {
        for (b, weight) in weights.entries(corner as usize) {
            all += f64::from(weight);
            own += if b == bone { f64::from(weight) } else { 0.0 };
        }
    }
    if all > 0.0 { own / all } else { 0.0 }
}

/// Axes of a bone's rays: two across it and the bone itself. They turn with the character and know
/// nothing of the axes of the world: the first points away from the middle of the skeleton or of
/// the surface, whichever lies farther off the bone.
fn ray_frame(skeleton: &Skeleton, bone: usize, centre: DVec3) -> DMat3 {
    let head = skeleton.heads()[bone];
    let axis = (skeleton.tails()[bone] - head).normalize_or_zero();
    let joints = skeleton.heads().iter().chain(skeleton.tails());
    let middle = joints.sum::<DVec3>() / (2 * skeleton.bone_count()) as f64;
    let parent = skeleton.parents()[bone].map_or(head, |p| skeleton.heads()[p as usize]);
    let off_axis = [middle, centre, parent].map(|point| (head - point).reject_from_normalized(axis));
    let side = off_axis.into_iter().fold(DVec3::ZERO, |best, offset| {
        if offset.length_squared() > 1.0001 * best.length_squared() { offset } else { best }
    });
    let right = side.try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector());
    DMat3::from_cols(right, axis.cross(right), axis)
}

/// Mean of the surface, weighted by area; it knows nothing of the order of vertices.
fn centre(mesh: &TriangleMesh) -> DVec3 {
    let (mut sum, mut total) = (DVec3::ZERO, 0.0);
    for triangle in 0..mesh.triangles().len() {
        let [a, b, c] = mesh.corners(triangle);
        let area = mesh.area_vector(triangle).length();
        sum += (a + b + c) / 3.0 * area;
        total += area;
    }
    if total > 0.0 { sum / total } else { DVec3::ZERO }
}

/// Size of a character that does not depend on how it is turned: the height of a standing person
/// whose surface has the same root mean square distance from its middle.
pub(super) fn extent(mesh: &TriangleMesh) -> f64 {
    const PERSON: f64 = 3.6;
    let centre = centre(mesh);
    let (mut sum, mut total) = (0.0, 0.0);
    for triangle in 0..mesh.triangles().len() {
        let area = mesh.area_vector(triangle).length();
        let middle = mesh.corners(triangle).into_iter().sum::<DVec3>() / 3.0;
        sum += middle.distance_squared(centre) * area;
        total += area;
    }
    if total > 0.0 { PERSON * (sum / total).sqrt() } else { 0.0 }
}
