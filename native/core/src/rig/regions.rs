//! Decomposition of a surface into joint regions and bone regions (section 4.1, figure 3).
//!
//! Vertices near a joint, within a radius, belong to the joint; every other vertex belongs to its
//! nearest bone segment. A joint is the head of a bone that has a parent.

use glam::DVec3;
use rayon::prelude::*;

use super::{Skeleton, distance_to_segment};

/// Radius of a joint region as a share of the shorter of the two bones that meet there. The paper
/// sets it by experience.
pub const JOINT_RADIUS: f64 = 0.3;

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
    let (heads, tails) = (skeleton.heads(), skeleton.tails());
    let region = |&point: &DVec3| {
        let joint = (0..radii.len())
            .filter(|&bone| radii[bone] > 0.0)
            .map(|bone| (bone, point.distance(heads[bone]) / radii[bone]))
            .filter(|(_, relative)| *relative <= 1.0)
            .min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((bone, _)) = joint {
            return Some(Region::Joint(bone as u32));
        }
        (0..radii.len())
            .filter(|&bone| takes_part[bone])
            .map(|bone| (bone, distance_to_segment(point, heads[bone], tails[bone])))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(bone, _)| Region::Bone(bone as u32))
    };
    points.par_iter().map(region).collect()
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
    fn no_bones_no_regions() {
        let skeleton = Skeleton::new(vec![], vec![], &[], None).unwrap();
        assert_eq!(decompose(&[DVec3::ZERO], &skeleton, &[]), [None]);
    }
}
