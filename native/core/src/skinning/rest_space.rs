//! Offsets of the skinned surface taken back into rest space: what a shape key before the Armature
//! modifier has to hold so that the skinned surface moves by a wanted offset.

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DVec3, Mat3, Mat3A, Vec3, Vec3A};
use nalgebra::{Matrix3, SymmetricEigen};
use rayon::prelude::*;

use super::{SkinWeights, Skinning};

/// Vertices per task.
const CHUNK: usize = 1024;
/// A blended matrix with a singular value below this share of its largest is nearly singular
/// (linear blending within one degree of a half turn): its offsets are limited.
const SINGULAR: f64 = 1e-2;

/// Offsets in rest space, and how many of them had to be limited.
#[derive(Debug, Clone, PartialEq)]
pub struct RestSpaceOffsets {
    /// Offsets (V).
    pub offsets: Vec<Vec3>,
    /// Vertices whose blended matrix is nearly singular.
    pub limited: usize,
}

impl RestSpaceOffsets {
    /// No offset for so many vertices.
    #[must_use]
    pub fn zero(vertex_count: usize) -> Self {
        Self { offsets: vec![Vec3::ZERO; vertex_count], limited: 0 }
    }
}

/// Takes the offset of each vertex (V rows of `weights`) of the skinned surface back to rest by the inverse
/// of its blended matrix M, or of (1 − s) I + s M where `shares` s (V) of the vertices follow the skinning.
/// Nearly singular matrices are limited, so that no vertex is thrown away, and counted. Vertices without
/// weights keep their offset. `shares` must have one entry for each vertex.
#[must_use]
pub fn to_rest_space(
    skinning: &Skinning<'_>,
    weights: &SkinWeights,
    offset_of: impl Fn(usize) -> Vec3 + Sync,
    shares: Option<&[f32]>,
) -> RestSpaceOffsets {
    let limited = AtomicUsize::new(0);
    let of_vertex = |vertex: usize| {
        let offset = offset_of(vertex);
        if offset == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let mut matrix = skinning.matrix(weights.row(vertex));
        if let Some(shares) = shares {
            matrix = Mat3A::IDENTITY + (matrix - Mat3A::IDENTITY) * shares[vertex];
        }
        let (solved, is_limited) = solve(&matrix, offset.into());
        if is_limited {
            limited.fetch_add(1, Ordering::Relaxed);
        }
        solved.into()
    };
    // Collected, so that all threads touch the new memory first, each its part.
    let vertices = (0..weights.vertex_count()).into_par_iter().with_min_len(CHUNK);
    RestSpaceOffsets { offsets: vertices.map(of_vertex).collect(), limited: limited.into_inner() }
}

/// Solves `matrix · x = offset`; true where singular values had to be limited. A limited singular
/// value σ counts as s² / σ, s the limit: continuous at s, and bounded where σ is zero.
fn solve(matrix: &Mat3A, offset: Vec3A) -> (Vec3A, bool) {
    let matrix = Mat3::from(*matrix).as_dmat3();
    let squares: f64 = matrix.to_cols_array().iter().map(|x| x * x).sum();
    // The two largest singular values have a product of at most half of that, and each is at most
    // its root: what passes here is regular.
    if matrix.determinant().abs() > 0.5 * SINGULAR * squares * squares.sqrt() {
        return ((matrix.inverse() * offset.as_dvec3()).as_vec3a(), false);
    }
    // AᵀA is symmetric: its decomposition always succeeds.
    let gram = matrix.transpose() * matrix;
    let eigen = SymmetricEigen::new(Matrix3::from_column_slice(&gram.to_cols_array()));
    let least = (SINGULAR * SINGULAR * eigen.eigenvalues.max()).max(f64::MIN_POSITIVE);
    let wanted = matrix.transpose() * offset.as_dvec3();
    let mut solved = DVec3::ZERO;
    let mut limited = false;
    for (&value, axis) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        let axis = DVec3::new(axis[0], axis[1], axis[2]);
        limited |= value < least;
        solved += axis * (axis.dot(wanted) / value.max(least));
    }
    let solved = solved.as_vec3a();
    (if solved.is_finite() { solved } else { Vec3A::ZERO }, limited)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::skinning::linear_blend_skinning;
    use glam::Affine3A;
    use proptest::prelude::*;

    fn weights() -> SkinWeights {
        SkinWeights::from_triplets([(0, 0, 0.5), (0, 1, 0.5)], 2, 2).unwrap()
    }

    proptest! {
        #[test]
        fn skinning_the_offset_vertex_gives_the_wanted_offset(
            v in prop::array::uniform3(-1.0f32..1.0), d in prop::array::uniform3(-0.3f32..0.3),
            angle in -2.8f32..2.8,
        ) {
            let (v, d) = (Vec3::from_array(v), Vec3::from_array(d));
            let transforms = [Affine3A::IDENTITY, Affine3A::from_rotation_x(angle)];
            let skinning = Skinning::linear(&transforms);
            let rest = to_rest_space(&skinning, &weights(), |v| [d, Vec3::ONE][v], None);
            prop_assert_eq!(rest.limited, 0);
            prop_assert_eq!(rest.offsets[1], Vec3::ONE, "a vertex without weights");
            let skin = |v: Vec3| linear_blend_skinning(&[v, v], &weights(), &transforms).unwrap()[0];
            prop_assert!((skin(v + rest.offsets[0]) - skin(v)).distance(d) < 2e-5);
        }
    }

    #[test]
    fn a_share_follows_in_part() {
        let transforms = [Affine3A::IDENTITY, Affine3A::from_rotation_x(2.0)];
        let skinning = Skinning::linear(&transforms);
        let (v, d) = (Vec3::new(0.3, 0.5, -0.2), Vec3::new(0.02, -0.01, 0.03));
        for share in [0.0, 0.3, 1.0] {
            let rest = to_rest_space(&skinning, &weights(), |v| [d, Vec3::ZERO][v], Some(&[share, 1.0]));
            let masked = |v: Vec3| v.lerp(skinning.vertex(v, weights().row(0)), share);
            assert!((masked(v + rest.offsets[0]) - masked(v)).distance(d) < 1e-6, "{share}");
        }
    }

    #[test]
    fn only_nearly_half_turns_are_limited_and_stay_bounded() {
        let mut last = 0.0;
        for tenths in 1600..=1800u16 {
            let angle = (f32::from(tenths) / 10.0).to_radians();
            let transforms = [Affine3A::IDENTITY, Affine3A::from_rotation_x(angle)];
            let skinning = Skinning::linear(&transforms);
            // The direction that the collapse shrinks most, at the size that the collapse leaves.
            let wanted = Vec3::from(skinning.matrix(weights().row(0)) * Vec3A::Y);
            let rest = to_rest_space(&skinning, &weights(), |v| [wanted, Vec3::ZERO][v], None);
            let length = rest.offsets[0].length();
            if tenths < 1788 {
                assert_eq!(rest.limited, 0, "{tenths}");
                assert!(rest.offsets[0].distance(Vec3::Y) < 1e-4, "{tenths}: {}", rest.offsets[0]);
            } else if tenths > 1790 {
                assert_eq!(rest.limited, 1, "{tenths}");
                assert!(length <= 1.0 && length <= last, "{tenths}: {length}");
            }
            last = length + 1e-3;
        }
    }

    #[test]
    fn a_half_turn_is_limited_and_finite() {
        let transforms = [Affine3A::IDENTITY, Affine3A::from_rotation_x(std::f32::consts::PI)];
        let rest =
            to_rest_space(&Skinning::linear(&transforms), &weights(), |v| [Vec3::Y, Vec3::ZERO][v], None);
        assert_eq!(rest.limited, 1);
        assert!(rest.offsets[0].is_finite() && rest.offsets[0].length() < 1.0 / SINGULAR as f32);
        let flat = [Affine3A::from_scale(Vec3::ZERO); 2];
        let rest = to_rest_space(&Skinning::linear(&flat), &weights(), |v| [Vec3::Y, Vec3::ZERO][v], None);
        assert_eq!((rest.limited, rest.offsets[0]), (1, Vec3::ZERO));
    }
}
