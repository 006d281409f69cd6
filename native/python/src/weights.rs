//! `SkinWeights`.

use dermis::skinning::SkinWeights;
use numpy::{PyArray1, PyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays::{floats, indices, matrix};
use crate::errors::value_error;

type Triplets<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f32>>);

/// Sparse weights, one row per vertex, one column per bone.
#[pyclass(frozen, name = "SkinWeights", module = "dermis_native")]
pub(crate) struct PySkinWeights(pub(crate) SkinWeights);

#[pymethods]
impl PySkinWeights {
    /// weights (V,B), finite and not negative.
    #[staticmethod]
    fn from_dense(weights: &Bound<'_, PyAny>) -> PyResult<Self> {
        let array = floats(weights, "weights", &[None, None])?;
        let (vertex_count, bone_count) = (array.shape()[0], array.shape()[1]);
        let values = array.as_slice()?;
        let entries = values.iter().enumerate().filter(|(_, value)| **value != 0.0);
        let entries = entries.map(|(i, &value)| ((i / bone_count) as i64, (i % bone_count) as i64, value));
        SkinWeights::from_triplets(entries, vertex_count, bone_count).map(Self).map_err(value_error)
    }

    /// Entries (n,); values of a repeated pair are added.
    #[staticmethod]
    fn from_triplets(
        vertex: &Bound<'_, PyAny>,
        bone: &Bound<'_, PyAny>,
        value: &Bound<'_, PyAny>,
        vertex_count: usize,
        bone_count: usize,
    ) -> PyResult<Self> {
        let vertex = indices(vertex, "vertex")?;
        let bone = indices(bone, "bone")?;
        let value = floats(value, "value", &[None])?;
        let value = value.as_slice()?;
        if bone.len() != vertex.len() || value.len() != vertex.len() {
            return Err(value_error(format!(
                "vertex, bone and value must have the same length, got {}, {} and {}",
                vertex.len(),
                bone.len(),
                value.len()
            )));
        }
        let entries = vertex.iter().zip(&bone).zip(value).map(|((&v, &b), &w)| (v, b, w));
        SkinWeights::from_triplets(entries, vertex_count, bone_count).map(Self).map_err(value_error)
    }

    /// (V,B).
    fn to_dense<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        matrix(py, self.0.to_dense(), self.0.vertex_count(), self.0.bone_count())
    }

    /// vertex, bone and value of every entry above zero, ordered by vertex, then bone.
    fn to_triplets<'py>(&self, py: Python<'py>) -> Triplets<'py> {
        let count = self.0.entry_count();
        let mut vertices = Vec::with_capacity(count);
        let mut bones = Vec::with_capacity(count);
        let mut values = Vec::with_capacity(count);
        for vertex in 0..self.0.vertex_count() {
            for (bone, value) in self.0.entries(vertex) {
                vertices.push(vertex as u32);
                bones.push(bone);
                values.push(value);
            }
        }
        (PyArray1::from_vec(py, vertices), PyArray1::from_vec(py, bones), PyArray1::from_vec(py, values))
    }

    /// Rows scaled to a sum of 1; a row without weights stays empty.
    fn normalized(&self) -> Self {
        Self(self.0.normalized())
    }

    /// Number of vertices (rows).
    #[getter]
    fn vertex_count(&self) -> usize {
        self.0.vertex_count()
    }

    /// Number of bones (columns).
    #[getter]
    fn bone_count(&self) -> usize {
        self.0.bone_count()
    }

    fn __repr__(&self) -> String {
        format!(
            "SkinWeights({} vertices, {} bones, {} entries)",
            self.0.vertex_count(),
            self.0.bone_count(),
            self.0.entry_count()
        )
    }
}
