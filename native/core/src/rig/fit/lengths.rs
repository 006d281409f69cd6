//! No bone shrinks to nothing: where both of its joints were drawn to one place, the bone gets its
//! length back.

use glam::{DQuat, DVec3};

use super::joints::Joints;
use crate::rig::Skeleton;

/// A bone keeps at least this share of its length in the scaled template.
const LEAST_LENGTH: f64 = 0.2;

/// Moves the tails of bones that became too short, from the roots on, along the direction that the
/// template has after its parent's turn. `points` (J) are the joints' places, `scale` the body's
/// size in the template's; joints that `fixed` (J) marks stay.
pub(super) fn keep_lengths(
    template: &Skeleton,
    joints: &Joints,
    scale: f64,
    fixed: &[bool],
    points: &mut [DVec3],
) {
    let direction = |from: DVec3, to: DVec3| (to - from).try_normalize();
    for &bone in template.depth_order() {
        let bone = bone as usize;
        let (head, tail) = (joints.heads[bone], joints.tails[bone]);
        let before = (joints.points[tail] - joints.points[head]) * scale;
        if fixed[tail] || points[tail].distance(points[head]) >= LEAST_LENGTH * before.length() {
            continue;
        }
        let turn = template.parents()[bone].and_then(|parent| {
            let (above, below) = (joints.heads[parent as usize], joints.tails[parent as usize]);
            let old = direction(joints.points[above], joints.points[below])?;
            Some(DQuat::from_rotation_arc(old, direction(points[above], points[below])?))
        });
        points[tail] = points[head] + turn.unwrap_or(DQuat::IDENTITY) * before;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_collapsed_bones_change() {
        let at = |x: f64, z: f64| DVec3::new(x, 0.0, z);
        // An arm of three bones, and a bone without length.
        let heads = vec![at(0.0, 0.0), at(1.0, 0.0), at(2.0, 0.0), at(0.0, 0.0)];
        let tails = vec![at(1.0, 0.0), at(2.0, 0.0), at(3.0, 0.0), at(0.0, 0.0)];
        let template = Skeleton::new(heads, tails, &[-1, 0, 1, 0], None).unwrap();
        let joints = Joints::new(&template);
        // Twice as large, the first bone turned upwards, the second collapsed, the third short enough.
        let fitted = vec![at(0.0, 0.0), at(0.0, 2.0), at(0.0, 2.0), at(0.5, 2.0)];
        let mut points = fitted.clone();
        keep_lengths(&template, &joints, 2.0, &[false; 4], &mut points);
        assert_eq!(points[..2], fitted[..2]);
        assert!(points[2].distance(at(0.0, 4.0)) < 1e-12);
        assert_eq!(points[3], fitted[3]);

        let mut points = fitted.clone();
        keep_lengths(&template, &joints, 2.0, &[false, false, true, false], &mut points);
        assert_eq!(points, fitted);
    }
}
