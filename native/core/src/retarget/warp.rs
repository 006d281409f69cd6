//! Skeleton-aware alignment: the source's surface moved onto the target's skeleton and rest pose.
//!
//! Every bone has one affine map: along the bone it stretches by the ratio of lengths, across and
//! beyond its ends by the ratio of girths. A vertex is moved by its own weights' blend of them.

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

use super::bone_rotations::bone_rotations;
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// The map of one bone.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoneWarp {
    head: DVec3,
    axis: DVec3,
    length: f64,
    stretch: f64,
    /// Head in the aligned skeleton.
    pub(super) aligned_head: DVec3,
    /// Direction in the aligned skeleton; zero for a bone without length.
    pub(super) aligned_axis: DVec3,
    /// Rotation from source to aligned skeleton.
    pub(super) rotation: DMat3,
    /// Ratio of girths.
    pub(super) girth: f64,
}

impl BoneWarp {
    /// Place of a source point along the bone, 0 at the head, 1 at the tail.
    pub(super) fn along(&self, point: DVec3) -> f64 {
        if self.length > 0.0 {
            ((point - self.head).dot(self.axis) / self.length).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }

    /// Where a source point goes.
    pub(super) fn apply(&self, point: DVec3) -> DVec3 {
        let offset = point - self.head;
        let along = offset.dot(self.axis);
        let inside = along.clamp(0.0, self.length);
        let across = (offset - self.axis * along) * self.girth;
        let lengthwise = inside * self.stretch + (along - inside) * self.girth;
        self.aligned_head + self.rotation * across + self.aligned_axis * lengthwise
    }
}

/// The maps of all bones.
pub(super) struct Warp {
    /// One map for each bone.
    pub(super) bones: Vec<BoneWarp>,
}

impl Warp {
    /// Maps from `source` to `aligned`, whose bones are numbered alike, with given ratios of girth
    /// (B) and turns about the aligned bones (B, radians).
    pub(super) fn new(
        source: &Skeleton,
        aligned: &Skeleton,
        takes_part: &[bool],
        girths: &[f64],
        twists: &[f64],
    ) -> Self {
        let rotations = bone_rotations(source, aligned, takes_part);
        let bones = (0..source.bone_count()).map(|b| {
            let axis = (source.tails()[b] - source.heads()[b]).normalize_or_zero();
            let aligned_axis = (aligned.tails()[b] - aligned.heads()[b]).normalize_or_zero();
            let length = source.length(b);
            // A bone that lost its length keeps its flesh.
            let (axis, length, stretch) = if axis == DVec3::ZERO || aligned_axis == DVec3::ZERO {
                (DVec3::ZERO, 0.0, 1.0)
            } else {
                (axis, length, aligned.length(b) / length)
            };
            let twist = if aligned_axis == DVec3::ZERO {
                DMat3::IDENTITY
            } else {
                DMat3::from_axis_angle(aligned_axis, twists[b])
            };
            BoneWarp {
                head: source.heads()[b],
                axis,
                length,
                stretch,
                aligned_head: aligned.heads()[b],
                aligned_axis,
                rotation: twist * rotations[b],
                girth: girths[b],
            }
        });
        Self { bones: bones.collect() }
    }

    /// Where the vertices go, each with its row of weights; a vertex without weights stays.
    pub(super) fn apply(&self, vertices: &[DVec3], weights: &SkinWeights) -> Vec<DVec3> {
        blended(vertices, weights, |bone, point| self.bones[bone].apply(point))
    }

    /// Where the vertices go by the turns of the bones alone: the source, as long and as thick as it is,
    /// in the aligned skeleton's pose. `source` is its skeleton. A turn that joints may feign which are
    /// off by `error`, in the source's unit, is shape and no pose.
    pub(super) fn repose(
        &self,
        source: &Skeleton,
        error: f64,
        vertices: &[DVec3],
        weights: &SkinWeights,
    ) -> Vec<DVec3> {
        let mut heads = source.heads().to_vec();
        let mut turns: Vec<DQuat> = self.bones.iter().map(|bone| DQuat::from_mat3(&bone.rotation)).collect();
        let wholly = turns.clone();
        for &bone in source.depth_order() {
            let b = bone as usize;
            if let Some(parent) = source.parents()[b].map(|parent| parent as usize) {
                let own = wholly[parent].inverse() * wholly[b];
                let feigned = error / source.length(b);
                let sure = (own.angle_between(DQuat::IDENTITY) / feigned - 1.0).clamp(0.0, 1.0);
                turns[b] = turns[parent] * DQuat::IDENTITY.slerp(own, sure);
                let offset = source.heads()[b] - source.heads()[parent];
                heads[b] = heads[parent] + turns[parent] * offset;
            }
        }
        let turn = |bone: usize, point: DVec3| heads[bone] + turns[bone] * (point - source.heads()[bone]);
        blended(vertices, weights, turn)
    }
}

/// Vertices moved by their weights' blend of the bones' maps; one without weights stays.
fn blended(
    vertices: &[DVec3],
    weights: &SkinWeights,
    map: impl Fn(usize, DVec3) -> DVec3 + Sync,
) -> Vec<DVec3> {
    let place = |(vertex, &point): (usize, &DVec3)| {
        let (mut sum, mut total) = (DVec3::ZERO, 0.0);
        for (bone, weight) in weights.entries(vertex) {
            sum += map(bone as usize, point) * f64::from(weight);
            total += f64::from(weight);
        }
        if total > 0.0 { sum / total } else { point }
    };
    vertices.par_iter().enumerate().map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn skeleton(joints: &[DVec3]) -> Skeleton {
        let count = joints.len() - 1;
        let parents: Vec<i64> = (0..count as i64).map(|b| b - 1).collect();
        Skeleton::new(joints[..count].to_vec(), joints[1..].to_vec(), &parents, None).unwrap()
    }

    #[test]
    fn stretches_along_and_thickens_across() {
        let source = skeleton(&[DVec3::ZERO, DVec3::X * 2.0]);
        let aligned = skeleton(&[DVec3::Y, DVec3::Y + DVec3::X * 6.0]);
        let warp = Warp::new(&source, &aligned, &[true], &[2.0], &[0.0]);
        let weights = SkinWeights::from_dense(&[1.0; 3], 1).unwrap();
        let vertices = [DVec3::new(1.0, 0.5, 0.0), DVec3::new(3.0, 0.0, 0.0), DVec3::new(-1.0, 0.0, 0.0)];
        let moved = warp.apply(&vertices, &weights);
        assert!(moved[0].abs_diff_eq(DVec3::new(3.0, 2.0, 0.0), 1e-12));
        // Beyond its ends a bone grows like its girth.
        assert!(moved[1].abs_diff_eq(DVec3::new(8.0, 1.0, 0.0), 1e-12));
        assert!(moved[2].abs_diff_eq(DVec3::new(-2.0, 1.0, 0.0), 1e-12));
    }

    #[test]
    fn a_turned_bone_takes_its_flesh_along() {
        let source = skeleton(&[DVec3::ZERO, DVec3::X, DVec3::X * 2.0]);
        let aligned = skeleton(&[DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y]);
        let warp = Warp::new(&source, &aligned, &[true; 2], &[1.0; 2], &[0.0; 2]);
        let weights = SkinWeights::from_dense(&[0.0, 1.0, 0.0, 0.0], 2).unwrap();
        let moved = warp.apply(&[DVec3::new(1.5, 0.2, 0.3), DVec3::ONE], &weights);
        assert!(moved[0].abs_diff_eq(DVec3::new(0.8, 0.5, 0.3), 1e-12), "{}", moved[0]);
        assert_eq!(moved[1], DVec3::ONE);
    }

    #[test]
    fn turned_bones_keep_their_size_in_another_pose() {
        let source = skeleton(&[DVec3::ZERO, DVec3::X, DVec3::X * 2.0]);
        let aligned = skeleton(&[DVec3::Z, DVec3::Z + DVec3::X * 3.0, DVec3::new(3.0, 5.0, 1.0)]);
        let warp = Warp::new(&source, &aligned, &[true; 2], &[2.0; 2], &[0.0; 2]);
        let weights = SkinWeights::from_dense(&[1.0, 0.0, 0.0, 1.0], 2).unwrap();
        let vertices = [DVec3::new(0.5, 0.2, 0.3), DVec3::new(1.5, 0.2, 0.3)];
        let moved = warp.repose(&source, 0.1, &vertices, &weights);
        assert!(moved[0].abs_diff_eq(DVec3::new(0.5, 0.2, 0.3), 1e-12), "{}", moved[0]);
        assert!(moved[1].abs_diff_eq(DVec3::new(0.8, 0.5, 0.3), 1e-12), "{}", moved[1]);
        // Joints so uncertain may feign even a right angle.
        let moved = warp.repose(&source, 2.0, &vertices, &weights);
        assert!(moved.iter().zip(&vertices).all(|(a, b)| a.abs_diff_eq(*b, 1e-12)));
    }

    #[test]
    fn lost_length_is_no_division_by_zero() {
        let source = skeleton(&[DVec3::ZERO, DVec3::X]);
        let aligned = skeleton(&[DVec3::ZERO, DVec3::ZERO]);
        for (from, to) in [(&source, &aligned), (&aligned, &source)] {
            let warp = Warp::new(from, to, &[true], &[1.0], &[0.0]);
            assert!(warp.bones[0].apply(DVec3::ONE).is_finite());
        }
    }
}
