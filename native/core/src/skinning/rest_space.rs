//! Offsets of the skinned surface taken back into rest space: what a shape key before the Armature
//! modifier has to hold so that the skinned surface moves by a wanted offset.

use glam::{Mat3A, Vec3, Vec3A};
use rayon::prelude::*;

use super::{SkinWeights, Skinning};

/// Vertices per task.
const CHUNK: usize = 2048;
/// A blended matrix that shrinks some direction below this share of its largest axis is nearly
/// singular (linear blending at a half turn): its offsets are limited.
const SINGULAR: f32 = 1e-2;

/// Offsets in rest space, and how many of them had to be limited.
#[derive(Debug, Clone, PartialEq)]
pub struct RestSpaceOffsets {
    /// Offsets (V).
    pub offsets: Vec<Vec3>,
    /// Vertices whose blended matrix is nearly singular.
    pub limited: usize,
}

/// Takes offsets (V) of the skinned surface back to rest by the inverse of each vertex's blended
/// matrix. Nearly singular matrices are damped, so that no vertex is thrown away, and counted.
/// Vertices without weights keep their offset. The three must have one entry (row) for each vertex.
#[must_use]
pub fn to_rest_space(skinning: &Skinning<'_>, weights: &SkinWeights, offsets: &[Vec3]) -> RestSpaceOffsets {
    let mut rest = vec![Vec3::ZERO; offsets.len()];
    let limited = rest
        .par_chunks_mut(CHUNK)
        .enumerate()
        .map(|(chunk, rest)| {
            let mut limited = 0;
            for (vertex, out) in (chunk * CHUNK..).zip(rest) {
                let offset = offsets[vertex];
                if offset != Vec3::ZERO {
                    let (solved, damped) = solve(&skinning.matrix(weights.row(vertex)), offset.into());
                    *out = solved.into();
                    limited += usize::from(damped);
                }
            }
            limited
        })
        .sum();
    RestSpaceOffsets { offsets: rest, limited }
}

/// Solves `matrix · x = offset`, damped where the matrix is nearly singular.
fn solve(matrix: &Mat3A, offset: Vec3A) -> (Vec3A, bool) {
    let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let largest = columns.iter().map(|c| c.length_squared()).fold(0.0, f32::max).sqrt();
    // |det| is at most σ_min · largest², up to a factor of 3.
    if matrix.determinant().abs() > SINGULAR * largest.powi(3) {
        return (matrix.inverse() * offset, false);
    }
    let damping = (SINGULAR * largest).powi(2).max(f32::MIN_POSITIVE);
    let transposed = matrix.transpose();
    let normal = transposed * *matrix + Mat3A::from_diagonal(Vec3::splat(damping));
    let solved = normal.inverse() * (transposed * offset);
    (if solved.is_finite() { solved } else { Vec3A::ZERO }, true)
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
            let rest = to_rest_space(&skinning, &weights(), &[d, Vec3::ONE]);
            prop_assert_eq!(rest.limited, 0);
            prop_assert_eq!(rest.offsets[1], Vec3::ONE, "a vertex without weights");
            let skin = |v: Vec3| linear_blend_skinning(&[v, v], &weights(), &transforms).unwrap()[0];
            prop_assert!((skin(v + rest.offsets[0]) - skin(v)).distance(d) < 2e-5);
        }
    }

    #[test]
    fn a_half_turn_is_limited_and_finite() {
        let transforms = [Affine3A::IDENTITY, Affine3A::from_rotation_x(std::f32::consts::PI)];
        let rest = to_rest_space(&Skinning::linear(&transforms), &weights(), &[Vec3::Y, Vec3::ZERO]);
        assert_eq!(rest.limited, 1);
        assert!(rest.offsets[0].is_finite() && rest.offsets[0].length() < 1.0 / SINGULAR);
    }
}
