//! Dual quaternion skinning (Kavan et al. 2008), the normalised linear blend of Blender's
//! Preserve Volume: what a bone's scale does to the vertex becomes part of the bone's translation,
//! so that every bone that is blended moves the vertex rigidly.

use std::ops::Mul;

use glam::{Affine3A, Mat3A, Quat, Vec3, Vec3A};

use super::blend::{Skinning, check_counts, check_transforms};
use super::linear::SMALLEST_WEIGHT_SUM;
use super::{SkinWeights, SkinningError};

/// Matrices closer than this to orthonormal count as rotations, as in Blender.
const ORTHONORMAL: f32 = 1e-5;
/// Scales closer than this to 1 count as 1, as in Blender.
const UNIT_SCALE: f32 = 1e-4;

/// A bone's motion: rotation and translation as a dual quaternion, and the scale before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DualQuaternion {
    real: Quat,
    dual: Quat,
    scale: Option<Affine3A>,
}

impl DualQuaternion {
    /// Splits a transform into rotation, translation and scale. `rest` is the bone's rest matrix
    /// (y along the bone): a scaled or sheared bone keeps the direction of its y axis. For rigid
    /// transforms it does not matter.
    #[must_use]
    pub fn from_transform(transform: &Affine3A, rest: &Affine3A) -> Self {
        let matrix = &transform.matrix3;
        let posed = *transform * *rest;
        let lengths = |m: &Mat3A| [m.x_axis, m.y_axis, m.z_axis].map(Vec3A::length);
        let ratios = lengths(&posed.matrix3).into_iter().zip(lengths(&rest.matrix3)).map(|(l, r)| l / r);
        let unscaled = ratios.map(|ratio| (ratio - 1.0).powi(2)).sum::<f32>() <= UNIT_SCALE.powi(2);
        if is_orthonormal(matrix) && matrix.determinant() >= 0.0 && unscaled {
            return Self::rigid(Quat::from_mat3a(matrix), transform.translation.into(), None);
        }
        let rotation = orthogonalized_on_y(&posed.matrix3);
        let unrotated = Affine3A { matrix3: orthogonalized_on_y(&rest.matrix3), ..*rest };
        let rigid = Affine3A { matrix3: rotation, translation: posed.translation } * unrotated.inverse();
        let scale = rigid.inverse() * *transform;
        Self::rigid(Quat::from_mat3a(&rigid.matrix3), rigid.translation.into(), Some(scale))
    }

    fn rigid(rotation: Quat, translation: Vec3, scale: Option<Affine3A>) -> Self {
        let real = rotation.normalize();
        let half = translation * 0.5;
        Self { real, dual: Quat::from_xyzw(half.x, half.y, half.z, 0.0).mul(real), scale }
    }
}

fn is_orthonormal(m: &Mat3A) -> bool {
    let gram = m.transpose() * *m;
    gram.abs_diff_eq(Mat3A::IDENTITY, ORTHONORMAL)
}

/// A rotation with the direction of y kept and x, z made perpendicular to it.
fn orthogonalized_on_y(m: &Mat3A) -> Mat3A {
    let y = m.y_axis.try_normalize().unwrap_or(Vec3A::Y);
    let x_like = m.x_axis.try_normalize().unwrap_or(Vec3A::X);
    let z = x_like.cross(y).try_normalize();
    let z = z
        .or_else(|| y.cross(m.z_axis).cross(y).try_normalize())
        .unwrap_or_else(|| y.any_orthonormal_vector());
    Mat3A::from_cols(y.cross(z), y, z)
}

/// The weighted sum of the bones' dual quaternions at one vertex.
#[derive(Debug, Clone, Copy)]
pub struct DualQuaternionBlend {
    real: Quat,
    dual: Quat,
    /// Σ w q ((S − 1) p) over scaled bones, as a map from the vertex p: the images of the axes and
    /// of the origin.
    scale: Option<[Quat; 4]>,
    sum: f32,
}

impl DualQuaternionBlend {
    /// Blends the bones of one row of weights, which must be in range.
    #[must_use]
    pub fn new((row_bones, values): (&[u32], &[f32]), bones: &[DualQuaternion]) -> Self {
        let zero = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        let mut blend = Self { real: zero, dual: zero, scale: None, sum: 0.0 };
        for (&bone, &weight) in row_bones.iter().zip(values) {
            let bone = &bones[bone as usize];
            // q and −q are the same rotation: take the one on the side of what is there already.
            let signed = if bone.real.dot(blend.real) < 0.0 { -weight } else { weight };
            blend.real += bone.real * signed;
            blend.dual += bone.dual * signed;
            if let Some(scale) = bone.scale {
                let stretch = scale.matrix3 - Mat3A::IDENTITY;
                let columns = [stretch.x_axis, stretch.y_axis, stretch.z_axis, scale.translation];
                for (sum, column) in blend.scale.get_or_insert([zero; 4]).iter_mut().zip(columns) {
                    *sum += bone.real.mul(Quat::from_xyzw(column.x, column.y, column.z, 0.0)) * signed;
                }
            }
            blend.sum += weight;
        }
        blend
    }

    /// Moves the vertex that the weights belong to.
    #[must_use]
    pub fn apply(&self, vertex: Vec3) -> Vec3 {
        let length_squared = self.real.length_squared();
        if self.sum <= SMALLEST_WEIGHT_SUM || length_squared <= f32::MIN_POSITIVE {
            return vertex;
        }
        let point = Vec3A::from(vertex);
        let mut dual = self.dual;
        if let Some([x, y, z, origin]) = self.scale {
            dual += (x * point.x + y * point.y + z * point.z + origin) * 0.5;
        }
        let (axis, w) = (Vec3A::new(self.real.x, self.real.y, self.real.z), self.real.w);
        let (dual, dual_w) = (Vec3A::new(dual.x, dual.y, dual.z), dual.w);
        // Written as an offset, so that the identity returns the same bits.
        let turned = 2.0 * axis.cross(axis.cross(point) + w * point);
        let moved = 2.0 * (w * dual - dual_w * axis + axis.cross(dual));
        Vec3::from(point + (turned + moved) / length_squared)
    }

    /// What [`Self::apply`] does to a small offset from the vertex: rotation and scale of the blend;
    /// the identity where nothing is blended.
    #[must_use]
    pub fn matrix(&self) -> Mat3A {
        let length_squared = self.real.length_squared();
        if self.sum <= SMALLEST_WEIGHT_SUM || length_squared <= f32::MIN_POSITIVE {
            return Mat3A::IDENTITY;
        }
        let rotation = Mat3A::from_quat(self.real.normalize());
        let Some([x, y, z, _]) = self.scale else { return rotation };
        let image = |q: Quat| Vec3A::from(q.mul(self.real.conjugate()).xyz()) / length_squared;
        rotation + Mat3A::from_cols(image(x), image(y), image(z))
    }
}

pub(super) fn dual_quaternion_vertex(vertex: Vec3, row: (&[u32], &[f32]), bones: &[DualQuaternion]) -> Vec3 {
    match row.0 {
        [] => vertex,
        _ => DualQuaternionBlend::new(row, bones).apply(vertex),
    }
}

/// Skins vertices (V) by blended dual quaternions. `rest` are the bones' rest matrices, which
/// matter only for scaled bones. A vertex without weights stays where it is.
///
/// # Errors
/// [`SkinningError`] when counts differ or a transform or vertex is not finite.
pub fn dual_quaternion_skinning(
    vertices: &[Vec3],
    weights: &SkinWeights,
    transforms: &[Affine3A],
    rest: Option<&[Affine3A]>,
) -> Result<Vec<Vec3>, SkinningError> {
    check_counts(vertices, weights, transforms)?;
    check_transforms(transforms)?;
    if let Some(rest) = rest {
        if rest.len() != transforms.len() {
            return Err(SkinningError::Count {
                element: "rest matrices",
                expected: transforms.len(),
                given: rest.len(),
            });
        }
        check_transforms(rest)?;
    }
    Ok(Skinning::dual_quaternion(transforms, rest).all(vertices, weights))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn rotation() -> impl Strategy<Value = Quat> {
        prop::array::uniform4(-1.0f32..1.0)
            .prop_filter("length", |q| Quat::from_array(*q).length() > 0.1)
            .prop_map(|q| Quat::from_array(q).normalize())
    }

    fn vector() -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-2.0f32..2.0).prop_map(Vec3::from_array)
    }

    fn one_bone() -> SkinWeights {
        SkinWeights::from_triplets([(0, 0, 0.7)], 1, 1).unwrap()
    }

    proptest! {
        #[test]
        fn a_single_bone_moves_like_its_matrix(
            q in rotation(), t in vector(), v in vector(), scale in prop::array::uniform3(0.2f32..3.0),
            rest_q in rotation(), rest_t in vector(),
        ) {
            for scale in [Vec3::ONE, Vec3::from_array(scale)] {
                let rest = Affine3A::from_rotation_translation(rest_q, rest_t);
                let posed = Affine3A::from_scale_rotation_translation(scale, q, t);
                let transform = posed * rest.inverse();
                let skinned = dual_quaternion_skinning(&[v], &one_bone(), &[transform], Some(&[rest])).unwrap();
                prop_assert!(skinned[0].distance(transform.transform_point3(v)) < 2e-5);
            }
        }

        #[test]
        fn equal_parts_of_two_rotations_turn_half_way(angle in -3.0f32..3.0, v in vector()) {
            let weights = SkinWeights::from_triplets([(0, 0, 0.5), (0, 1, 0.5)], 1, 2).unwrap();
            let turned = Affine3A::from_rotation_x(angle);
            let skinned =
                dual_quaternion_skinning(&[v], &weights, &[Affine3A::IDENTITY, turned], None).unwrap();
            let half = Affine3A::from_rotation_x(angle / 2.0).transform_point3(v);
            prop_assert!(skinned[0].distance(half) < 1e-5);
            let blend = Skinning::dual_quaternion(&[Affine3A::IDENTITY, turned], None);
            let matrix = blend.matrix(weights.row(0));
            prop_assert!(matrix.abs_diff_eq(Mat3A::from_rotation_x(angle / 2.0), 1e-5));
        }

        #[test]
        fn the_matrix_is_the_derivative_of_scaled_bones_too(
            turn in rotation(), scale in prop::array::uniform3(0.5f32..2.0), v in vector(), d in vector(),
        ) {
            let weights = SkinWeights::from_triplets([(0, 0, 0.4), (0, 1, 0.7)], 1, 2).unwrap();
            let scaled = Affine3A::from_scale_rotation_translation(Vec3::from_array(scale), turn, v);
            let skinning = Skinning::dual_quaternion(&[Affine3A::IDENTITY, scaled], None);
            let row = weights.row(0);
            let moved = skinning.vertex(v + d, row) - skinning.vertex(v, row);
            prop_assert!(moved.distance((skinning.matrix(row) * Vec3A::from(d)).into()) < 1e-4);
        }

        #[test]
        fn identity_returns_the_same_bits(v in vector(), a in 0.01f32..1.0, b in 0.01f32..1.0) {
            let weights = SkinWeights::from_triplets([(0, 0, a.into()), (0, 1, b.into())], 1, 2).unwrap();
            let skinned = dual_quaternion_skinning(&[v], &weights, &[Affine3A::IDENTITY; 2], None).unwrap();
            prop_assert_eq!(skinned[0], v);
        }
    }

    #[test]
    fn a_flattened_bone_stays_finite() {
        let flat = Affine3A::from_scale(Vec3::new(0.0, 0.0, 0.0));
        let skinned = dual_quaternion_skinning(&[Vec3::ONE], &one_bone(), &[flat], None).unwrap();
        assert!(skinned[0].is_finite());
    }
}
