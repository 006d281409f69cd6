//! Rays from the bones to the surface, shot alike on source and target: what a limb's girth is, and
//! which places of the two surfaces correspond.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::icp::Surroundings;
use crate::mesh::{RayHit, TriangleMesh};
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// A ray leaves the surface no flatter than this sine.
const STEEP: f64 = 0.2;

/// A ray belongs to its bone where it leaves the source through skin that the bone moves.
const OWN_WEIGHT: f64 = 0.3;

/// Where the logarithm of the ratio of lengths differs by this from that of the skeletons' sizes, the target's
/// ray has left through another limb: a bare hand beside a jacket meets its front.
const OTHER_LIMB: f64 = 1.4;

/// Where a pair of rays left the two surfaces.
#[derive(Debug, Clone, Copy)]
pub(super) struct RayPair {
    pub(super) bone: u32,
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
/// the target from the aligned skeleton, each bone turned by its rotation (B). Keeps the pairs of
/// which both leave their surface outward, on the source through skin that the bone moves, on the target through
/// the same limb.
pub(super) fn shoot(
    (source, skeleton, weights): (Surroundings<'_>, &Skeleton, &SkinWeights),
    (target, aligned, rotations): (Surroundings<'_>, &Skeleton, &[DMat3]),
    takes_part: &[bool],
    fan: &Fan<'_>,
) -> Vec<RayPair> {
    let centre = centre(source.mesh);
    let bones: Vec<usize> =
        (0..takes_part.len()).filter(|&b| takes_part[b] && skeleton.length(b) > 0.0).collect();
    let length = |skeleton: &Skeleton| bones.iter().map(|&b| skeleton.length(b)).sum::<f64>();
    let scale =
        Some((length(aligned) / length(skeleton)).ln()).filter(|scale| scale.is_finite()).unwrap_or(0.0);
    let shoot_bone = |&b: &usize| {
        let along = skeleton.tails()[b] - skeleton.heads()[b];
        let frame = ray_frame(skeleton, b, centre);
        let mut pairs = Vec::new();
        for &station in fan.stations {
            let origin = skeleton.heads()[b] + along * station;
            let goal = aligned.heads()[b] + (aligned.tails()[b] - aligned.heads()[b]) * station;
            for k in 0..fan.directions {
                // Off the plane of symmetry, where rays meet edges and rounding decides.
                let angle = std::f64::consts::TAU * (f64::from(k) + 0.3) / f64::from(fan.directions);
                let direction = frame * DVec3::new(libm::cos(angle), libm::sin(angle), 0.0);
                let Some(on_source) = exit(source, origin, direction) else { continue };
                if own_weight(source.mesh, weights, on_source.triangle, b as u32) < OWN_WEIGHT {
                    continue;
                }
                if let Some(on_target) = exit(target, goal, rotations[b] * direction) {
                    let pair = RayPair { bone: b as u32, source: on_source, target: on_target };
                    if (pair.log_ratio() - scale).abs() < OTHER_LIMB {
                        pairs.push(pair);
                    }
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

/// First hit of a ray, if it leaves the surface there.
fn exit(surface: Surroundings<'_>, origin: DVec3, direction: DVec3) -> Option<RayHit> {
    let hit = surface.query.cast_ray(origin, direction)?;
    let corner = surface.mesh.triangles()[hit.triangle as usize][0] as usize;
    let normal = surface.mesh.area_vector(hit.triangle as usize).normalize_or_zero();
    let steep = normal.dot(direction) * surface.shell.side[corner];
    let steep = if surface.shell.two_sided[corner] { steep.abs() } else { steep };
    (hit.distance > 0.0 && steep > STEEP).then_some(hit)
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
