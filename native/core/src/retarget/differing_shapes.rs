//! Where source and target differ in shape, weights made from the target's skeleton have a say.
//!
//! On like bodies the source knows best to the last crease. Where the shapes are far apart, every
//! match is a guess, and a share of the inverse fourth powers of the distances to the bones (eq. 2)
//! brings the result nearer to what another hand would have painted. How far apart the shapes are
//! is measured after the alignment: the distance left between the surfaces relative to the limb's
//! radius, bone by bone, but never far beyond what is usual for the whole pair, so that one finger
//! that failed is not taken for another creature's.

use glam::DVec3;

use super::bone_rays::median;
use super::inpaint::{Row, blend};
use super::joint_refinement::Alignment;
use super::joint_system::largest_bone;
use crate::rig::{bind_weights_paper, distance_to_segment};

/// Distance left, relative to the radius, up to which shapes are alike,
const ALIKE: f64 = 0.07;
/// and from which on they differ altogether.
const DIFFERENT: f64 = 0.12;
/// A bone's shape differs at most by this multiple of what is usual for the pair.
const UNUSUAL: f64 = 1.5;
/// Share of the skeleton's weights where shapes differ altogether.
const SHARE: f64 = 0.35;

/// Share of the skeleton's weights for every bone (B).
///
/// `points` are the warped source vertices, `distances` what separates each from the target where
/// it met it.
pub(super) fn skeleton_shares(
    alignment: &Alignment<'_>,
    points: &[DVec3],
    distances: &[Option<f64>],
) -> Vec<f64> {
    let bone_count = alignment.takes_part.len();
    let (mut left, mut radius) = (vec![Vec::new(); bone_count], vec![Vec::new(); bone_count]);
    for (vertex, (&point, distance)) in points.iter().zip(distances).enumerate() {
        let Some(bone) = largest_bone(alignment.weights, vertex).map(|b| b as usize) else { continue };
        if let Some(distance) = distance {
            let (head, tail) = (alignment.aligned.heads()[bone], alignment.aligned.tails()[bone]);
            left[bone].push(*distance);
            radius[bone].push(distance_to_segment(point, head, tail));
        }
    }
    let relative: Vec<Option<f64>> = left
        .into_iter()
        .zip(radius)
        .map(|(left, radius)| Some(median(left)? / median(radius).filter(|r| *r > 0.0)?))
        .collect();
    let usual = median(relative.iter().flatten().copied().collect()).unwrap_or(0.0);
    let share = |relative: &Option<f64>| {
        let relative = relative.unwrap_or(usual).min(UNUSUAL * usual);
        let t = ((relative - ALIKE) / (DIFFERENT - ALIKE)).clamp(0.0, 1.0);
        SHARE * t * t * (3.0 - 2.0 * t)
    };
    relative.iter().map(share).collect()
}

/// Mixes the skeleton's weights into the rows of the vertices that `mixed` marks, as much as the
/// bones of each row ask for.
pub(super) fn mix_skeleton_weights(
    rows: &mut [Row],
    vertices: &[DVec3],
    alignment: &Alignment<'_>,
    shares: &[f64],
    mixed: impl Fn(usize) -> bool,
) {
    if shares.iter().all(|share| *share <= 0.0) {
        return;
    }
    let weights = bind_weights_paper(vertices, &alignment.aligned, alignment.takes_part);
    for (vertex, row) in rows.iter_mut().enumerate().filter(|(vertex, _)| mixed(*vertex)) {
        let share: f64 = row.iter().map(|&(bone, weight)| weight * shares[bone as usize]).sum();
        let total = weights.total(vertex);
        if share > 0.0 && total > 0.0 {
            let own: Row = weights.entries(vertex).map(|(bone, w)| (bone, f64::from(w) / total)).collect();
            *row = blend([(&*row, 1.0 - share), (&own, share)].into_iter());
        }
    }
}
