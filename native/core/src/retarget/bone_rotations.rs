//! Rotations that take the bones of one skeleton onto those of another, numbered alike.
//!
//! Heads and tails fix a bone's direction only. The turn about it (roll) follows the parent by the
//! smallest rotation, corrected by where the children sit: a hand's fingers or a bent knee tell it,
//! a straight limb does not.

use std::f64::consts::PI;

use glam::{DMat3, DQuat, DVec3};

use super::rigid_fit::rigid_fit;
use crate::rig::Skeleton;

/// What the parent's roll weighs against the children: both in squares of the bone's length.
const PARENT: f64 = 0.5;

/// Rotation of each bone (B) from `source` to `target`. Bones that do not take part, and bones
/// without length, turn with their parent.
pub(super) fn bone_rotations(source: &Skeleton, target: &Skeleton, takes_part: &[bool]) -> Vec<DMat3> {
    let whole = whole_rotation(source, target, takes_part);
    let children = source.children();
    let mut rotations = vec![DMat3::IDENTITY; source.bone_count()];
    for &bone in source.depth_order() {
        let b = bone as usize;
        let parent = source.parents()[b].map_or(whole, |p| rotations[p as usize]);
        let directions = (direction(source, b), direction(target, b));
        let (Some(from), Some(to), true) = (directions.0, directions.1, takes_part[b]) else {
            rotations[b] = parent;
            continue;
        };
        let swung = shortest_rotation(parent * from, to) * parent;
        let right = to.any_orthonormal_vector();
        let forward = to.cross(right);
        let plane = |v: DVec3| (v.dot(right), v.dot(forward));
        // Sum of complex numbers whose argument is the roll that one child asks for.
        let (mut cosine, mut sine) = (PARENT, 0.0);
        for &child in children[b].iter().filter(|&&c| takes_part[c as usize]) {
            let c = child as usize;
            for (at, goal) in [(source.heads()[c], target.heads()[c]), (source.tails()[c], target.tails()[c])]
            {
                let (x, y) = plane(swung * (at - source.heads()[b]) / source.length(b));
                let (u, v) = plane((goal - target.heads()[b]) / target.length(b));
                cosine += u * x + v * y;
                sine += v * x - u * y;
            }
        }
        rotations[b] = DMat3::from_axis_angle(to, libm::atan2(sine, cosine)) * swung;
    }
    rotations
}

/// Direction of a bone; `None` where it has no length.
fn direction(skeleton: &Skeleton, bone: usize) -> Option<DVec3> {
    (skeleton.tails()[bone] - skeleton.heads()[bone]).try_normalize()
}

/// The rotation that fits all joints at once: what the roots start from.
fn whole_rotation(source: &Skeleton, target: &Skeleton, takes_part: &[bool]) -> DMat3 {
    let bones = (0..takes_part.len()).filter(|&b| takes_part[b]);
    let pairs: Vec<(DVec3, DVec3, f64)> = bones
        .flat_map(|b| {
            [(source.heads()[b], target.heads()[b], 1.0), (source.tails()[b], target.tails()[b], 1.0)]
        })
        .collect();
    rigid_fit(&pairs).rotation
}

/// The smallest rotation from one unit vector to another.
fn shortest_rotation(from: DVec3, to: DVec3) -> DMat3 {
    let axis = from.cross(to);
    let (sine, cosine) = (axis.length(), from.dot(to));
    if sine > 1e-12 {
        return DMat3::from_quat(DQuat::from_axis_angle(axis / sine, libm::atan2(sine, cosine)));
    }
    if cosine > 0.0 {
        return DMat3::IDENTITY;
    }
    DMat3::from_axis_angle(from.any_orthonormal_vector(), PI)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hand() -> Skeleton {
        let heads = vec![DVec3::ZERO, DVec3::X, DVec3::X * 2.0, DVec3::new(2.0, 0.3, 0.0)];
        let tails = vec![DVec3::X, DVec3::X * 2.0, DVec3::X * 3.0, DVec3::new(3.0, 0.5, 0.0)];
        Skeleton::new(heads, tails, &[-1, 0, 1, 1], None).unwrap()
    }

    fn turned(skeleton: &Skeleton, rotation: DMat3, offset: DVec3) -> Skeleton {
        let place = |points: &[DVec3]| points.iter().map(|&p| rotation * p + offset).collect();
        let parents: Vec<i64> = skeleton.parents().iter().map(|p| p.map_or(-1, i64::from)).collect();
        Skeleton::new(place(skeleton.heads()), place(skeleton.tails()), &parents, None).unwrap()
    }

    #[test]
    fn a_rigid_motion_is_every_bones_rotation() {
        let rotation = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 2.5);
        let target = turned(&hand(), rotation, DVec3::splat(3.0));
        for found in bone_rotations(&hand(), &target, &[true; 4]) {
            assert!(found.abs_diff_eq(rotation, 1e-9), "{found} {rotation}");
        }
    }

    #[test]
    fn fingers_tell_the_roll_of_the_hand() {
        // The hand (bone 1) and its fingers turn about the arm, the arm (bone 0) does not.
        let turn = DMat3::from_axis_angle(DVec3::X, 1.2);
        let mut target = turned(&hand(), turn, DVec3::ZERO);
        target =
            Skeleton::new(target.heads().to_vec(), target.tails().to_vec(), &[-1, 0, 1, 1], None).unwrap();
        let found = bone_rotations(&hand(), &target, &[true; 4]);
        assert!((found[1] * DVec3::Y).dot(turn * DVec3::Y) > 0.9);
    }

    #[test]
    fn a_bone_that_turns_back_still_has_a_rotation() {
        let line = |x: f64| Skeleton::new(vec![DVec3::ZERO], vec![DVec3::X * x], &[-1], None).unwrap();
        let found = bone_rotations(&line(1.0), &line(-2.0), &[true]);
        assert!((found[0] * DVec3::X).abs_diff_eq(-DVec3::X, 1e-12));
        assert!((found[0].determinant() - 1.0).abs() < 1e-12);
    }
}
