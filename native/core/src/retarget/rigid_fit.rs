//! The rigid motion that best takes weighted points to others (Kabsch 1976).

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;

/// Singular values below this share of the largest are no direction of their own.
const RANK: f64 = 1e-9;

/// Rotation and translation: `x ↦ rotation · x + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RigidMotion {
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
}

impl RigidMotion {
    pub(super) const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    pub(super) fn apply(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }
}

/// Minimises Σ w |R x + t − y|² over `(x, y, w)`. Points on one line leave the turn about it open:
/// the result then only translates. No point, or no weight: the identity.
pub(super) fn rigid_fit(pairs: &[(DVec3, DVec3, f64)]) -> RigidMotion {
    let total: f64 = pairs.iter().map(|pair| pair.2).sum();
    if total.is_nan() || total <= 0.0 {
        return RigidMotion::IDENTITY;
    }
    let mean = |pick: fn(&(DVec3, DVec3, f64)) -> DVec3| {
        pairs.iter().map(|pair| pick(pair) * pair.2).sum::<DVec3>() / total
    };
    let (from, to) = (mean(|pair| pair.0), mean(|pair| pair.1));
    let mut moment = Matrix3::zeros();
    for &(x, y, w) in pairs {
        let (x, y) = ((x - from).to_array(), (y - to).to_array());
        moment += Matrix3::from_fn(|row, column| w * y[row] * x[column]);
    }
    let decomposition = moment.svd(true, true);
    let mut rotation = DMat3::IDENTITY;
    if let (Some(u), Some(v)) = (decomposition.u, decomposition.v_t) {
        // Singular values descend; two of them fix the rotation, its sign takes the third.
        let values = decomposition.singular_values;
        if values[1] > RANK * values[0] {
            let sign = (u.determinant() * v.determinant()).signum();
            let turn = u * Matrix3::from_diagonal(&nalgebra::Vector3::new(1.0, 1.0, sign)) * v;
            rotation = DMat3::from_cols_slice(turn.as_slice());
        }
    }
    RigidMotion { rotation, translation: to - rotation * from }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn recovers_a_motion_from_a_plane_of_points() {
        let motion = RigidMotion {
            rotation: DMat3::from_quat(DQuat::from_axis_angle(DVec3::ONE.normalize(), 2.0)),
            translation: DVec3::new(1.0, -2.0, 3.0),
        };
        let points = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(2.0, 1.0, 0.0)];
        let pairs: Vec<_> =
            points.iter().zip(1..).map(|(&p, w)| (p, motion.apply(p), f64::from(w))).collect();
        let found = rigid_fit(&pairs);
        let point = DVec3::new(0.3, 0.4, 5.0);
        assert!(found.apply(point).distance(motion.apply(point)) < 1e-12);
    }

    #[test]
    fn a_line_of_points_only_translates() {
        let pairs = [(DVec3::ZERO, DVec3::Z, 1.0), (DVec3::X, DVec3::X + DVec3::Z, 1.0)];
        assert_eq!(rigid_fit(&pairs).rotation, DMat3::IDENTITY);
        assert_eq!(rigid_fit(&[]), RigidMotion::IDENTITY);
    }
}
