//! One skinning method prepared for a pose, and the checks that both methods share.

use glam::{Affine3A, Mat3A, Vec3};
use rayon::prelude::*;

use super::dual_quaternion::{DualQuaternion, dual_quaternion_vertex};
use super::linear::linear_vertex;
use super::{DualQuaternionBlend, SkinWeights, SkinningError, StretchedSpace, blended_matrix};

/// Vertices per task: large enough to hide the cost of a task, small enough to share 10k vertices.
const CHUNK: usize = 2048;

/// A pose, ready to skin any vertex.
#[derive(Debug, Clone)]
pub enum Skinning<'a> {
    /// Linear blend, by matrices.
    Linear(&'a [Affine3A]),
    /// Dual quaternions, in a space where bones turn rigidly.
    DualQuaternion(Vec<DualQuaternion>, Option<StretchedSpace>),
}

impl<'a> Skinning<'a> {
    /// Linear blend skinning of a pose.
    #[must_use]
    pub fn linear(transforms: &'a [Affine3A]) -> Self {
        Self::Linear(transforms)
    }

    /// Dual quaternion skinning of a pose; `rest` are the bones' rest matrices, needed only where
    /// bones are scaled (see [`DualQuaternion::from_transform`]) or the whole character is stretched:
    /// where the axes of all rest matrices are those of one stretched space, bones turn rigidly in
    /// the space without the stretch.
    #[must_use]
    pub fn dual_quaternion(transforms: &[Affine3A], rest: Option<&[Affine3A]>) -> Self {
        let space = rest.and_then(StretchedSpace::of);
        let rest_of = |bone: usize| rest.and_then(|r| r.get(bone)).copied().unwrap_or(Affine3A::IDENTITY);
        let bone = |(b, t): (usize, &Affine3A)| match &space {
            None => DualQuaternion::from_transform(t, &rest_of(b)),
            Some(space) => DualQuaternion::from_transform(&space.rigid(t), &(space.inwards * rest_of(b))),
        };
        Self::DualQuaternion((0..).zip(transforms).map(bone).collect(), space)
    }

    /// Skins one vertex with its row of weights. Bones must be in range.
    #[must_use]
    pub fn vertex(&self, vertex: Vec3, row: (&[u32], &[f32])) -> Vec3 {
        match self {
            Self::Linear(transforms) => linear_vertex(vertex, row, transforms),
            Self::DualQuaternion(bones, None) => dual_quaternion_vertex(vertex, row, bones),
            Self::DualQuaternion(bones, Some(space)) => {
                let inside = space.inwards.transform_vector3(vertex);
                // As an offset, so that the identity returns the same bits.
                vertex + space.outwards.transform_vector3(dual_quaternion_vertex(inside, row, bones) - inside)
            }
        }
    }

    /// What the method does to a small offset from a vertex: the blended matrix, or the rotation
    /// (and scale) of the blended dual quaternion.
    #[must_use]
    pub fn matrix(&self, row: (&[u32], &[f32])) -> Mat3A {
        match self {
            Self::Linear(transforms) => blended_matrix(row, transforms),
            Self::DualQuaternion(bones, space) => {
                let matrix = DualQuaternionBlend::new(row, bones).matrix();
                space.as_ref().map_or(matrix, |s| s.outwards.matrix3 * matrix * s.inwards.matrix3)
            }
        }
    }

    /// Skins all vertices on the threads of the current pool.
    pub(super) fn all(&self, vertices: &[Vec3], weights: &SkinWeights) -> Vec<Vec3> {
        let mut skinned = vec![Vec3::ZERO; vertices.len()];
        self.all_into(vertices, weights, &mut skinned);
        skinned
    }

    /// Skins all vertices into `skinned`; the three have one entry (row) for each vertex.
    pub fn all_into(&self, vertices: &[Vec3], weights: &SkinWeights, skinned: &mut [Vec3]) {
        skinned.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, skinned)| {
            for (vertex, out) in (chunk * CHUNK..).zip(skinned) {
                *out = self.vertex(vertices[vertex], weights.row(vertex));
            }
        });
    }
}

pub(super) fn check_counts(
    vertices: &[Vec3],
    weights: &SkinWeights,
    transforms: &[Affine3A],
) -> Result<(), SkinningError> {
    for (element, expected, given) in [
        ("vertices", weights.vertex_count(), vertices.len()),
        ("transforms", weights.bone_count(), transforms.len()),
    ] {
        if expected != given {
            return Err(SkinningError::Count { element, expected, given });
        }
    }
    match vertices.iter().position(|v| !v.is_finite()) {
        Some(vertex) => Err(SkinningError::NonFiniteVertex { vertex }),
        None => Ok(()),
    }
}

/// Checks that every transform is finite.
///
/// # Errors
/// [`SkinningError::NonFiniteTransform`] naming the first bone at fault.
pub fn check_transforms(transforms: &[Affine3A]) -> Result<(), SkinningError> {
    match transforms.iter().position(|t| !t.is_finite()) {
        Some(bone) => Err(SkinningError::NonFiniteTransform { bone }),
        None => Ok(()),
    }
}
