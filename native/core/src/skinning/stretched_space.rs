//! The space of a character that is stretched or sheared as a whole, so that its bones do not turn
//! rigidly there: dual quaternions are blended in the space without the stretch.

use glam::{Affine3A, DMat3, DVec3, Mat3, Mat3A};
use nalgebra::{Matrix3, SymmetricEigen};

/// Rest matrices whose axes differ by less than this share belong to one space.
const ALIKE: f64 = 1e-3;
/// Spaces stretched by less than this share are not stretched.
const UNSTRETCHED: f64 = 1e-5;

/// A symmetric stretch P, without which a character's bones turn rigidly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StretchedSpace {
    /// P⁻¹, linear.
    pub inwards: Affine3A,
    /// P, linear.
    pub outwards: Affine3A,
}

impl StretchedSpace {
    /// The space of bones whose rest matrices are L · (orthonormal) with one L: P is the root of
    /// L Lᵀ. `None` where that is no stretch, or where there is no such L.
    #[must_use]
    pub fn of(rest: &[Affine3A]) -> Option<Self> {
        let squares = |bone: &Affine3A| {
            let matrix = Mat3::from(bone.matrix3).as_dmat3();
            matrix * matrix.transpose()
        };
        let first = squares(rest.first()?);
        let size = first.to_cols_array().iter().fold(0.0f64, |most, x| most.max(x.abs()));
        let even =
            DMat3::from_diagonal(DVec3::splat(first.to_cols_array().iter().step_by(4).sum::<f64>() / 3.0));
        if first.abs_diff_eq(even, UNSTRETCHED * size) {
            return None;
        }
        if rest.iter().any(|bone| !squares(bone).abs_diff_eq(first, ALIKE * size)) {
            return None;
        }
        let eigen = SymmetricEigen::new(Matrix3::from_column_slice(&first.to_cols_array()));
        if eigen.eigenvalues.min() <= UNSTRETCHED * UNSTRETCHED * size {
            return None;
        }
        let power = |exponent: f64| {
            let scaled = Matrix3::from_diagonal(&eigen.eigenvalues.map(|value| value.powf(exponent)));
            let matrix = eigen.eigenvectors * scaled * eigen.eigenvectors.transpose();
            let columns: Vec<f32> = matrix.iter().map(|&x| x as f32).collect();
            Affine3A::from_mat3(Mat3::from_cols_slice(&columns))
        };
        Some(Self { inwards: power(-0.5), outwards: power(0.5) })
    }

    /// A bone's transform in the space without the stretch; the exact identity for the identity.
    #[must_use]
    pub fn rigid(&self, transform: &Affine3A) -> Affine3A {
        let moved = transform.matrix3 - Mat3A::IDENTITY;
        Affine3A {
            matrix3: Mat3A::IDENTITY + self.inwards.matrix3 * moved * self.outwards.matrix3,
            translation: self.inwards.matrix3 * transform.translation,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Quat, Vec3};

    fn rest(bone: f32) -> Affine3A {
        Affine3A::from_rotation_translation(Quat::from_axis_angle(Vec3::X, bone), Vec3::splat(bone))
    }

    #[test]
    fn turns_are_rigid_again() {
        let stretch = Affine3A::from_mat3(Mat3::from_cols(
            Vec3::new(1.0, 0.2, 0.0),
            Vec3::new(0.1, 2.0, 0.3),
            Vec3::new(0.0, 0.0, -0.5),
        ));
        let space = StretchedSpace::of(&[stretch * rest(0.3), stretch * rest(2.0)]).unwrap();
        let turn = stretch * Affine3A::from_rotation_y(1.1) * stretch.inverse();
        let rigid = space.rigid(&turn).matrix3;
        assert!((rigid.transpose() * rigid).abs_diff_eq(Mat3A::IDENTITY, 1e-5));
        assert!((space.inwards * space.outwards).abs_diff_eq(Affine3A::IDENTITY, 1e-5));
    }

    #[test]
    fn even_scale_and_unlike_bones_are_no_stretch() {
        let scale = Affine3A::from_scale(Vec3::splat(0.02));
        assert_eq!(StretchedSpace::of(&[scale * rest(0.3), scale * rest(1.0)]), None);
        let uneven = Affine3A::from_scale(Vec3::new(1.0, 2.0, 1.0));
        assert_eq!(StretchedSpace::of(&[uneven * rest(0.3), rest(1.0)]), None);
        assert_eq!(StretchedSpace::of(&[Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.0))]), None);
        assert_eq!(StretchedSpace::of(&[]), None);
    }
}
