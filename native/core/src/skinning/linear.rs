//! Linear blend skinning (eq. 1), in the form that Blender's Armature modifier computes.

use glam::{Affine3A, Mat3A, Vec3, Vec3A};

use super::blend::{Skinning, check_counts, check_transforms};
use super::{SkinWeights, SkinningError};

/// Sums of weights at or below this move nothing, as in Blender's Armature modifier.
pub(super) const SMALLEST_WEIGHT_SUM: f32 = 1e-4;

/// Skins vertices (V) by `p + Σ w_b (T_b p − p) / Σ w_b`: eq. 1 for weights that sum to 1. A vertex
/// without weights stays where it is.
///
/// # Errors
/// [`SkinningError`] when counts differ or a transform or vertex is not finite.
pub fn linear_blend_skinning(
    vertices: &[Vec3],
    weights: &SkinWeights,
    transforms: &[Affine3A],
) -> Result<Vec<Vec3>, SkinningError> {
    check_counts(vertices, weights, transforms)?;
    check_transforms(transforms)?;
    let skinning = Skinning::linear(transforms);
    Ok(skinning.all(vertices, weights))
}

/// One vertex; the caller has checked the counts.
pub(super) fn linear_vertex(
    vertex: Vec3,
    (bones, values): (&[u32], &[f32]),
    transforms: &[Affine3A],
) -> Vec3 {
    let point = Vec3A::from(vertex);
    let mut sum = 0.0;
    let mut offset = Vec3A::ZERO;
    for (&bone, &weight) in bones.iter().zip(values) {
        offset += weight * (transforms[bone as usize].transform_point3a(point) - point);
        sum += weight;
    }
    if sum > SMALLEST_WEIGHT_SUM { Vec3::from(point + offset / sum) } else { vertex }
}

/// The blended 3×3 matrix of a vertex: what [`linear_blend_skinning`] does to an offset from it.
#[must_use]
pub fn blended_matrix((bones, values): (&[u32], &[f32]), transforms: &[Affine3A]) -> Mat3A {
    let mut sum = 0.0;
    let mut matrix = Mat3A::ZERO;
    for (&bone, &weight) in bones.iter().zip(values) {
        matrix += transforms[bone as usize].matrix3 * weight;
        sum += weight;
    }
    if sum > SMALLEST_WEIGHT_SUM { matrix * sum.recip() } else { Mat3A::IDENTITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    fn weights() -> SkinWeights {
        SkinWeights::from_triplets([(0, 0, 0.5), (0, 1, 1.5), (1, 0, 0.1), (3, 1, 5e-5)], 4, 2).unwrap()
    }

    fn vertices() -> Vec<Vec3> {
        vec![Vec3::new(0.1, 0.7, -0.3), Vec3::X, Vec3::Y, Vec3::Z]
    }

    #[test]
    fn identity_returns_the_same_bits() {
        let skinned = linear_blend_skinning(&vertices(), &weights(), &[Affine3A::IDENTITY; 2]).unwrap();
        assert_eq!(skinned, vertices());
    }

    #[test]
    fn blends_by_normalised_weights() {
        let turn = Affine3A::from_rotation_translation(Quat::from_rotation_z(1.0), Vec3::new(1.0, 2.0, 3.0));
        let skinned = linear_blend_skinning(&vertices(), &weights(), &[Affine3A::IDENTITY, turn]).unwrap();
        let expected = vertices()[0] * 0.25 + turn.transform_point3(vertices()[0]) * 0.75;
        assert!(skinned[0].distance(expected) < 1e-6);
        assert_eq!(skinned[1..], vertices()[1..], "unmoved bone, no weight, weight too small");
        let moved = Vec3::new(0.01, -0.02, 0.03);
        let also = linear_blend_skinning(
            &[vertices()[0] + moved, Vec3::X, Vec3::Y, Vec3::Z],
            &weights(),
            &[Affine3A::IDENTITY, turn],
        );
        let matrix = blended_matrix(weights().row(0), &[Affine3A::IDENTITY, turn]);
        assert!((also.unwrap()[0] - skinned[0]).distance((matrix * Vec3A::from(moved)).into()) < 1e-6);
    }

    #[test]
    fn names_the_bad_bone_and_vertex() {
        let mut transforms = [Affine3A::IDENTITY; 2];
        transforms[1].translation.y = f32::NAN;
        assert_eq!(
            linear_blend_skinning(&vertices(), &weights(), &transforms),
            Err(SkinningError::NonFiniteTransform { bone: 1 })
        );
        let mut bad = vertices();
        bad[2].x = f32::INFINITY;
        assert_eq!(
            linear_blend_skinning(&bad, &weights(), &[Affine3A::IDENTITY; 2]),
            Err(SkinningError::NonFiniteVertex { vertex: 2 })
        );
        assert!(matches!(
            linear_blend_skinning(&bad, &weights(), &[Affine3A::IDENTITY]),
            Err(SkinningError::Count { element: "transforms", expected: 2, given: 1 })
        ));
    }
}
