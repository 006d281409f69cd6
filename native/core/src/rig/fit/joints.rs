//! The joints of a template: ends of related bones that are in one place are one joint and stay so.

use glam::DVec3;

use crate::rig::Skeleton;

/// Ends nearer than this share of the skeleton's size are one joint.
const CONNECTED: f64 = 1e-6;
const UNPLACED: usize = usize::MAX;

/// Joints of a skeleton. A bone goes from one joint to another, or has both ends in one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Joints {
    /// Place of each joint (J) in the template.
    pub(super) points: Vec<DVec3>,
    /// Joint at the head of each bone (B).
    pub(super) heads: Vec<usize>,
    /// Joint at the tail of each bone (B).
    pub(super) tails: Vec<usize>,
}

impl Joints {
    /// Finds the joints: a child's head on its parent's tail or head, a bone's tail on its own head.
    pub(super) fn new(skeleton: &Skeleton) -> Self {
        let (low, high) = bounds(skeleton.heads().iter().chain(skeleton.tails()).copied());
        let near = CONNECTED * (high - low).max_element();
        let count = skeleton.bone_count();
        let mut joints =
            Self { points: Vec::new(), heads: vec![UNPLACED; count], tails: vec![UNPLACED; count] };
        let children = skeleton.children();
        for &bone in skeleton.depth_order() {
            let bone = bone as usize;
            let (head, tail) = (skeleton.heads()[bone], skeleton.tails()[bone]);
            let known = skeleton.parents()[bone].map(|p| p as usize).and_then(|parent| {
                // The parent's ends, then the heads of brothers that were placed before.
                let brothers = children[parent].iter().map(|&b| joints.heads[b as usize]);
                let ends = [joints.tails[parent], joints.heads[parent]].into_iter();
                let placed = ends.chain(brothers.filter(|&joint| joint != UNPLACED));
                placed.into_iter().find(|&joint| joints.points[joint].distance(head) <= near)
            });
            joints.heads[bone] = known.unwrap_or_else(|| joints.add(head));
            joints.tails[bone] =
                if head.distance(tail) <= near { joints.heads[bone] } else { joints.add(tail) };
        }
        joints
    }

    fn add(&mut self, point: DVec3) -> usize {
        self.points.push(point);
        self.points.len() - 1
    }

    /// The skeleton with its joints at other places (J).
    pub(super) fn place(&self, skeleton: &Skeleton, points: &[DVec3]) -> Skeleton {
        let ends = |joints: &[usize]| joints.iter().map(|&j| points[j]).collect();
        skeleton.placed(ends(&self.heads), ends(&self.tails))
    }
}

/// Bounds of points; infinite and reversed without any.
pub(super) fn bounds(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connected_ends_are_one_joint() {
        let at = |x: f64, z: f64| DVec3::new(x, 0.0, z);
        // A spine, two legs from its head, a loose child, and a bone without length.
        let heads = vec![at(0.0, 0.0), at(0.0, 1.0), at(0.0, 0.0), at(0.0, 0.0), at(0.5, 1.0), at(0.0, 2.0)];
        let tails =
            vec![at(0.0, 1.0), at(0.0, 2.0), at(0.1, -1.0), at(-0.1, -1.0), at(1.0, 1.0), at(0.0, 2.0)];
        let skeleton = Skeleton::new(heads, tails, &[-1, 0, 0, 0, 1, 1], None).unwrap();
        let joints = Joints::new(&skeleton);
        assert_eq!(joints.tails[0], joints.heads[1]);
        assert_eq!(joints.heads[2], joints.heads[0]);
        assert_eq!(joints.heads[3], joints.heads[0]);
        assert_eq!(joints.heads[5], joints.tails[1]);
        assert_eq!(joints.heads[5], joints.tails[5]);
        assert_eq!(joints.points.len(), 7);
        assert_eq!(joints.place(&skeleton, &joints.points), skeleton);
    }
}
