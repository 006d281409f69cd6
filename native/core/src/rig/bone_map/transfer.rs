//! Weights over source bones as weights over target bones.

use glam::DVec3;
use rayon::prelude::*;

use super::chain::joints;
use super::{BoneMap, BoneMapError};
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// Half of the width over which a bone of a chain hands over to the next, as a share of the shorter
/// of the two.
const BLEND: f64 = 0.4;

/// Where one bone of a chain hands over to the next.
struct Handover {
    joint: DVec3,
    direction: DVec3,
    half_width: f64,
}

impl Handover {
    /// 0 before the joint, 1 behind it, with a smooth step (Hermite) between.
    fn passed(&self, point: DVec3) -> f64 {
        let along = (point - self.joint).dot(self.direction);
        if self.half_width <= 0.0 {
            return if along < 0.0 { 0.0 } else { 1.0 };
        }
        let t = (0.5 + 0.5 * along / self.half_width).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }
}

impl BoneMap {
    /// Weights (V×target bones) from `rows` (V×source bones) of the target's vertices (V).
    ///
    /// A bone without a counterpart gives its weight to its carrier; the weight of a bone that is
    /// split over a chain goes to the bones of the chain by the vertex's position along it, with
    /// smooth steps at the joints whose shares sum to 1. Sums of rows stay.
    ///
    /// # Errors
    /// [`BoneMapError::OtherSkeleton`] when rows or target have other numbers of bones than the map.
    pub fn transfer(
        &self,
        rows: &SkinWeights,
        vertices: &[DVec3],
        target: &Skeleton,
    ) -> Result<SkinWeights, BoneMapError> {
        self.check_skeletons(None, target)?;
        if rows.bone_count() != self.source_bone_count() {
            let (expected, found) = (self.source_bone_count(), rows.bone_count());
            return Err(BoneMapError::OtherSkeleton { side: "source", expected, found });
        }
        let handovers: Vec<Vec<Handover>> =
            (0..self.source_bone_count()).map(|bone| handovers(target, self.targets(bone))).collect();
        let row = |vertex: usize| {
            let mut entries: Vec<(u32, f64)> = Vec::new();
            for (bone, weight) in rows.entries(vertex) {
                let carrier = self.carrier(bone as usize) as usize;
                let targets = self.targets(carrier);
                // What has not passed the next joint stays with the bone before it.
                let mut left = 1.0f64;
                for (at, &target) in targets.iter().enumerate() {
                    let next = match handovers[carrier].get(at) {
                        Some(handover) => left.min(handover.passed(vertices[vertex])),
                        None => 0.0,
                    };
                    entries.push((target, f64::from(weight) * (left - next)));
                    left = next;
                }
            }
            entries.sort_by_key(|entry| entry.0);
            entries.dedup_by(|next, kept| {
                kept.0 == next.0 && {
                    kept.1 += next.1;
                    true
                }
            });
            entries
        };
        let whole: Vec<Vec<(u32, f64)>> = (0..rows.vertex_count()).into_par_iter().map(row).collect();
        Ok(SkinWeights::from_rows(whole, self.target_bone_count))
    }
}

fn handovers(target: &Skeleton, chain: &[u32]) -> Vec<Handover> {
    if chain.len() < 2 {
        return Vec::new();
    }
    let points = joints(target, chain);
    let handover = |three: &[DVec3]| {
        let (before, after) = (three[1] - three[0], three[2] - three[1]);
        let bisector = before.normalize_or_zero() + after.normalize_or_zero();
        let direction = if bisector.length() > 1e-6 { bisector } else { three[2] - three[0] };
        Handover {
            joint: three[1],
            direction: direction.normalize_or_zero(),
            half_width: BLEND * before.length().min(after.length()),
        }
    };
    points.windows(3).map(handover).collect()
}
