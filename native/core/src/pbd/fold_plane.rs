//! The projection plane of a bent joint in a pose (figure 9), and how far the joint bends.

use glam::{Affine3A, Vec3};

use super::contact::JointContact;
use super::fold_field::smoothstep;
use super::self_collision::ProjectionPlane;

/// Bones closer than this to one line have no inner side: nothing can fold there. As |a + b| of
/// the unit directions of both bones; 0.1 is a bend of 6°.
const STRAIGHT: f32 = 0.1;
/// From here on, 23°, contact counts in full.
const BENT: f32 = 0.4;
/// From 90° to 122° the flesh of the two sides comes to fill a narrow gap between them.
const DEEP: [f32; 2] = [1.41, 1.75];

/// Joints that are turned by less than this cannot bring anything into contact.
const UNMOVED: f32 = 1e-4;
/// Sine of half the turn from which hollows close in full: 23°.
const TURNED: f32 = 0.2;
/// The projection plane of a joint in a pose, with the direction of the fold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FoldPlane {
    pub plane: ProjectionPlane,
    pub inwards: Vec3,
    /// The direction towards the other side, in rest, for the side above the joint and for that below.
    pub towards: [Vec3; 2],
    /// 0 for straight joints, 1 from a moderate bend on, so that contact sets in gently.
    pub strength: f32,
    /// 0 up to a right angle, 1 where both sides lie along each other.
    pub deep: f32,
    /// 0 at rest, 1 once the joint has turned some way, so that hollows begin to close gently.
    pub set_in: f32,
    /// How far the joint bends rather than twists, from 0 to 1, and 0 for straight joints: sin² of half
    /// the bend over sin² of half the turn, times the strength.
    pub bend_share: f32,
}

impl JointContact {
    /// The plane through the joint, perpendicular to the plane of its two bones, half way between
    /// them; `None` where they are in line or have not turned since rest.
    pub(super) fn fold_plane(&self, transforms: &[Affine3A]) -> Option<FoldPlane> {
        let (below, above) = (&transforms[self.bone as usize], &transforms[self.parent as usize]);
        if below.abs_diff_eq(*above, UNMOVED) { None } else { self.plane_between(below, above) }
    }

    pub(super) fn plane_between(&self, below: &Affine3A, above: &Affine3A) -> Option<FoldPlane> {
        let joint = below.transform_point3(self.joint).midpoint(above.transform_point3(self.joint));
        let up = (above.transform_point3(self.up) - joint).try_normalize()?;
        let down = (below.transform_point3(self.down) - joint).try_normalize()?;
        let normal = (down - up).try_normalize()?;
        let inwards = up + down;
        let length = inwards.length();
        let strength = ((length - STRAIGHT) / (BENT - STRAIGHT)).min(1.0);
        let (bend_share, set_in) = self.turn(below, above);
        let in_rest = |pose: &Affine3A| (pose.matrix3.transpose() * normal).normalize_or_zero();
        (length > STRAIGHT).then(|| FoldPlane {
            plane: ProjectionPlane { point: joint, normal },
            inwards: inwards / length,
            towards: [in_rest(above), -in_rest(below)],
            strength,
            deep: smoothstep((length - DEEP[0]) / (DEEP[1] - DEEP[0])),
            set_in,
            bend_share: strength * bend_share,
        })
    }

    /// Share of the turn since rest that is not about the bone itself, and how far the turn lets
    /// hollows close.
    fn turn(&self, below: &Affine3A, above: &Affine3A) -> (f32, f32) {
        let (_, turn, _) = (above.inverse() * *below).to_scale_rotation_translation();
        let down = (self.down - self.joint).normalize_or_zero();
        let bend = down.distance_squared(turn * down) * 0.25;
        let whole = turn.xyz().length_squared();
        let share = if whole > f32::MIN_POSITIVE { (bend / whole).min(1.0) } else { 0.0 };
        (share, smoothstep(whole.sqrt() / TURNED))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pbd::contact::tests::{bent, contact};

    #[test]
    fn the_fold_plane_halves_the_bend() {
        let (contact, _) = contact();
        let fold = contact.fold_plane(&bent(1.0)).unwrap();
        let half = Vec3::new(0.5f32.cos(), 0.5f32.sin(), 0.0);
        assert!(fold.plane.normal.distance(half) < 1e-6);
        assert!(fold.inwards.distance(Vec3::new(-half.y, half.x, 0.0)) < 1e-6);
        assert_eq!((fold.set_in, fold.deep), (1.0, 0.0));
        assert_eq!(contact.fold_plane(&bent(2.2)).unwrap().deep, 1.0);
        assert!((fold.bend_share - 1.0).abs() < 1e-5);
        assert!(contact.fold_plane(&bent(0.0)).is_none(), "straight");
        assert!(contact.fold_plane(&[Affine3A::from_rotation_z(1.0); 2]).is_none(), "turned as a whole");
    }

    #[test]
    fn a_twist_of_a_bent_joint_is_no_bend() {
        let (mut contact, _) = contact();
        contact.up = Vec3::new(-1.0, 1.0, 0.0);
        let twisted = contact.fold_plane(&[Affine3A::IDENTITY, Affine3A::from_rotation_x(1.0)]).unwrap();
        assert!(twisted.bend_share < 1e-5);
        let both = Affine3A::from_rotation_z(0.5) * Affine3A::from_rotation_x(0.5);
        let both = contact.fold_plane(&[Affine3A::IDENTITY, both]).unwrap();
        assert!((0.4..0.6).contains(&both.bend_share), "{}", both.bend_share);
    }
}
