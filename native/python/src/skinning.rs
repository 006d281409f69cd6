//! `linear_blend_skinning`, `dual_quaternion_skinning`, `rest_space_offsets`.

use dermis::skinning::{self, Skinning, SkinningError};
use numpy::PyArray2;
use pyo3::prelude::*;

use crate::errors::value_error;
use crate::poses::{numbers, positions, positions_array, transforms};
use crate::weights::PySkinWeights;

/// Linear blend skinning (eq. 1) as Blender's Armature modifier computes it.
///
/// vertices (V,3), transforms (B,4,4) = pose · rest⁻¹; returns (V,3) float32. Weights need not sum
/// to 1; a vertex without weights stays where it is.
#[pyfunction]
pub(crate) fn linear_blend_skinning<'py>(
    py: Python<'py>,
    vertices: &Bound<'py, PyAny>,
    weights: &PySkinWeights,
    #[pyo3(from_py_with = pose)] transforms: Pose,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let vertices = positions(vertices, "vertices")?;
    let skin = || skinning::linear_blend_skinning(&vertices, &weights.0, &transforms.0);
    positions_array(py, py.detach(skin).map_err(value_error)?)
}

/// Dual quaternion skinning as Blender's Preserve Volume computes it.
///
/// Like `linear_blend_skinning`; rest (B,4,4) are the bones' rest matrices, which matter only where
/// bones are scaled.
#[pyfunction]
#[pyo3(signature = (vertices, weights, transforms, *, rest=None))]
pub(crate) fn dual_quaternion_skinning<'py>(
    py: Python<'py>,
    vertices: &Bound<'py, PyAny>,
    weights: &PySkinWeights,
    #[pyo3(from_py_with = pose)] transforms: Pose,
    rest: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let vertices = positions(vertices, "vertices")?;
    let rest = rest.map(|rest| crate::poses::transforms(rest, "rest")).transpose()?;
    let skin = || skinning::dual_quaternion_skinning(&vertices, &weights.0, &transforms.0, rest.as_deref());
    positions_array(py, py.detach(skin).map_err(value_error)?)
}

/// Offsets (V,3) of the skinned surface taken back to rest by the inverse of what skinning does at
/// each vertex: what a shape key has to hold under a live Armature modifier.
///
/// shares (V,), 0 to 1, say how much of the skinning each vertex follows. Returns the offsets (V,3)
/// float32 and the number of vertices whose blended matrix is nearly singular; their offsets are
/// limited.
#[pyfunction]
#[pyo3(signature = (offsets, weights, transforms, *, preserve_volume=false, shares=None))]
pub(crate) fn rest_space_offsets<'py>(
    py: Python<'py>,
    offsets: &Bound<'py, PyAny>,
    weights: &PySkinWeights,
    #[pyo3(from_py_with = pose)] transforms: Pose,
    preserve_volume: bool,
    shares: Option<&Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArray2<f32>>, usize)> {
    let offsets = positions(offsets, "offsets")?;
    let shares = shares.map(|shares| numbers(shares, "shares")).transpose()?;
    let vertex_count = weights.0.vertex_count();
    for (element, expected, given) in [
        ("offsets", vertex_count, offsets.len()),
        ("transforms", weights.0.bone_count(), transforms.0.len()),
        ("shares", vertex_count, shares.as_ref().map_or(vertex_count, Vec::len)),
    ] {
        if expected != given {
            return Err(value_error(SkinningError::Count { element, expected, given }));
        }
    }
    skinning::check_transforms(&transforms.0).map_err(value_error)?;
    let result = py.detach(|| {
        let skinning = match preserve_volume {
            true => Skinning::dual_quaternion(&transforms.0, None),
            false => Skinning::linear(&transforms.0),
        };
        skinning::to_rest_space(&skinning, &weights.0, |vertex| offsets[vertex], shares.as_deref())
    });
    Ok((positions_array(py, result.offsets)?, result.limited))
}

/// The argument `transforms`.
pub(crate) struct Pose(pub(crate) Vec<glam::Affine3A>);

/// Reads the argument `transforms`.
pub(crate) fn pose(argument: &Bound<'_, PyAny>) -> PyResult<Pose> {
    transforms(argument, "transforms").map(Pose)
}
