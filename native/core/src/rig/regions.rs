//! Decomposition of a surface into joint regions and bone regions (section 4.1, figure 3).
//!
//! Vertices near a joint, within a radius, belong to the joint; every other vertex belongs to its
//! nearest bone segment. A joint is the head of a bone that has a parent. A vertex on the outer side
//! of a bent joint is equally near to both bones there, namely at the joint: it belongs to the bone to
//! whose side it leans.

use glam::DVec3;
use rayon::prelude::*;

use super::{Skeleton, closest_on_segment};

/// Radius of a joint region as a share of the shorter of the two bones that meet there. The paper
/// sets it by experience.
pub const JOINT_RADIUS: f64 = 0.3;

/// Bones whose distances differ by less than this share are equally near.
const EQUALLY_NEAR: f64 = 1e-9;

/// Region of a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Region {
    /// Near the head of this bone, where it meets its parent.
    Joint(u32),
    /// Nearest to this bone's segment.
    Bone(u32),
}

/// Radius of the joint at the head of each bone (B), 0 where there is none: at a root, and where
/// one of the two bones does not take part.
#[must_use]
pub fn joint_radii(skeleton: &Skeleton, takes_part: &[bool]) -> Vec<f64> {
    let radius = |(bone, parent): (usize, &Option<u32>)| match parent.map(|p| p as usize) {
        Some(parent) if takes_part[bone] && takes_part[parent] => {
            JOINT_RADIUS * skeleton.length(bone).min(skeleton.length(parent))
        }
        _ => 0.0,
    };
    skeleton.parents().iter().enumerate().map(radius).collect()
}

/// Region of every point, among the bones (B) that take part: bones that move no skin, such as IK
/// targets, should not. A point within several joints' radii belongs to the joint that is nearest
/// relative to its radius; ties go to the lower bone. Without bones there are no regions.
#[must_use]
pub fn decompose(points: &[DVec3], skeleton: &Skeleton, takes_part: &[bool]) -> Vec<Option<Region>> {
    let radii = joint_radii(skeleton, takes_part);
    let heads = skeleton.heads();
    let region = |&point: &DVec3| {
        let joint = (0..radii.len())
            .filter(|&bone| radii[bone] > 0.0)
            .map(|bone| (bone, point.distance(heads[bone]) / radii[bone]))
            .filter(|(_, relative)| *relative <= 1.0)
            .min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((bone, _)) = joint {
            return Some(Region::Joint(bone as u32));
        }
        nearest_bones(point, skeleton, takes_part).first().map(|&(_, bone)| Region::Bone(bone))
    };
    points.par_iter().map(region).collect()
}

/// Distances to the bones (B) that take part, the nearest first. Of bones that are equally near, as
/// at a joint, the one comes first that makes the smallest angle with the way to the point; rounding
/// decides neither.
pub(super) fn nearest_bones(point: DVec3, skeleton: &Skeleton, takes_part: &[bool]) -> Vec<(f64, u32)> {
    let mut found: Vec<(f64, f64, u32)> = (0..takes_part.len())
        .filter(|&bone| takes_part[bone])
        .map(|bone| {
            let (head, tail) = (skeleton.heads()[bone], skeleton.tails()[bone]);
            let at = closest_on_segment(point, head, tail).0;
            // From an end of the bone into it; along it in between, which is across the way.
            let inward = (0.5 * (head + tail) - at).normalize_or_zero();
            (point.distance(at), (point - at).normalize_or_zero().dot(inward), bone as u32)
        })
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
    let mut rest = &mut found[..];
    while let Some(first) = rest.first() {
        let bound = first.0 * (1.0 + EQUALLY_NEAR);
        let (equal, farther) = rest.split_at_mut(rest.partition_point(|entry| entry.0 <= bound));
        equal.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.2.cmp(&b.2)));
        rest = farther;
    }
    found.into_iter().map(|(distance, _, bone)| (distance, bone)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joints_take_their_radius_and_bones_the_rest() {
        let heads = vec![DVec3::ZERO, DVec3::X * 2.0];
        let tails = vec![DVec3::X * 2.0, DVec3::X * 6.0];
        let skeleton = Skeleton::new(heads, tails, &[-1, 0], None).unwrap();
        assert_eq!(joint_radii(&skeleton, &[true; 2]), [0.0, JOINT_RADIUS * 2.0]);
        let points = [0.0, 1.3, 1.5, 2.5, 2.7, 9.0].map(|x| DVec3::new(x, 0.1, 0.0));
        let regions: Vec<Region> = decompose(&points, &skeleton, &[true; 2]).into_iter().flatten().collect();
        let (joint, first, second) = (Region::Joint(1), Region::Bone(0), Region::Bone(1));
        assert_eq!(regions, [first, first, joint, joint, second, second]);
        let alone = decompose(&points, &skeleton, &[false, true]);
        assert!(alone.iter().all(|region| *region == Some(second)));
    }

    #[test]
    fn beyond_a_bent_joint_a_point_belongs_to_the_bone_it_leans_to() {
        let joints = [DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0)];
        let skeleton = Skeleton::new(joints[..2].to_vec(), joints[1..].to_vec(), &[-1, 0], None).unwrap();
        // Both are nearest to the joint itself, whatever rounding says of the distances.
        let points = [DVec3::new(1.3, -0.5, 0.1), DVec3::new(1.5, -0.3, 0.1)];
        let mut random = 1.0;
        for _ in 0..100 {
            random = (random * 997.0 + 0.1) % 1.0;
            let turn = glam::DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 7.0 * random);
            let place = |points: &[DVec3]| points.iter().map(|&p| turn * p + turn.x_axis).collect::<Vec<_>>();
            let moved = skeleton.placed(place(skeleton.heads()), place(skeleton.tails()));
            let found = decompose(&place(&points), &moved, &[true; 2]);
            assert_eq!(found, [Some(Region::Bone(0)), Some(Region::Bone(1))]);
        }
    }

    #[test]
    fn no_bones_no_regions() {
        let skeleton = Skeleton::new(vec![], vec![], &[], None).unwrap();
        assert_eq!(decompose(&[DVec3::ZERO], &skeleton, &[]), [None]);
    }
}
