//! `Skeleton`.

use dermis::rig::Skeleton;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::arrays::{indices, points, points_array};
use crate::errors::value_error;

/// Bones as head and tail points in the mesh's space; parents index bones, -1 is a root.
#[pyclass(frozen, name = "Skeleton", module = "dermis_native")]
pub(crate) struct PySkeleton(pub(crate) Skeleton);

#[pymethods]
impl PySkeleton {
    #[new]
    #[pyo3(signature = (heads, tails, parents, names=None))]
    fn new(
        heads: &Bound<'_, PyAny>,
        tails: &Bound<'_, PyAny>,
        parents: &Bound<'_, PyAny>,
        names: Option<Vec<String>>,
    ) -> PyResult<Self> {
        let (heads, tails) = (points(heads, "heads")?, points(tails, "tails")?);
        let parents = indices(parents, "parents")?;
        Skeleton::new(heads, tails, &parents, names).map(Self).map_err(value_error)
    }

    /// Heads (B,3).
    #[getter]
    fn heads<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points_array(py, self.0.heads())
    }

    /// Tails (B,3).
    #[getter]
    fn tails<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points_array(py, self.0.tails())
    }

    /// Parents (B,), -1 for a root.
    #[getter]
    fn parents<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i32>> {
        let parents = self.0.parents().iter().map(|parent| parent.map_or(-1, |p| p as i32));
        PyArray1::from_vec(py, parents.collect())
    }

    /// Names (B), where known.
    #[getter]
    fn names(&self) -> Option<Vec<String>> {
        self.0.names().map(<[String]>::to_vec)
    }

    fn __len__(&self) -> usize {
        self.0.bone_count()
    }

    fn __repr__(&self) -> String {
        format!("Skeleton({} bones)", self.0.bone_count())
    }
}
