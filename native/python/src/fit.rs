//! `fit_skeleton`.

use dermis::rig::{self, FitError, FitMethod, FitSettings, FittedSkeleton};
use numpy::PyArray1;
use pyo3::prelude::*;

use crate::arrays::mask;
use crate::errors::{Cancelled, value_error};
use crate::mesh::PyTriangleMesh;
use crate::progress::{PyProgress, shared};
use crate::rig::PySkeleton;

/// A skeleton in a mesh.
#[pyclass(frozen, name = "FittedSkeleton", module = "dermis_native")]
pub(crate) struct PyFittedSkeleton(FittedSkeleton);

#[pymethods]
impl PyFittedSkeleton {
    /// The template's bones at their fitted rest positions.
    #[getter]
    fn skeleton(&self) -> PySkeleton {
        PySkeleton(self.0.skeleton.clone())
    }

    /// "embedding" or "template".
    #[getter]
    fn method(&self) -> &'static str {
        match self.0.method {
            FitMethod::Embedding => "embedding",
            FitMethod::Template => "template",
        }
    }

    /// How well the skeleton fits, 0 to 1.
    #[getter]
    fn score(&self) -> f64 {
        self.0.score
    }

    /// What was not found; empty when all is well.
    #[getter]
    fn message(&self) -> &str {
        &self.0.message
    }

    /// True where a bone was placed by the shape (B,).
    #[getter]
    fn found<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        PyArray1::from_slice(py, &self.0.found)
    }

    /// Whether a mirror plane was used.
    #[getter]
    fn symmetric(&self) -> bool {
        self.0.symmetric
    }

    fn __repr__(&self) -> String {
        let bones = self.0.found.len();
        format!("FittedSkeleton({bones} bones, method=\"{}\", score={:.2})", self.method(), self.0.score)
    }
}

/// Fits a template skeleton into a mesh.
#[pyfunction]
#[pyo3(signature = (mesh, template, *, deform=None, fixed=None, symmetric=None, progress=None))]
pub(crate) fn fit_skeleton(
    py: Python<'_>,
    mesh: &PyTriangleMesh,
    template: &PySkeleton,
    deform: Option<&Bound<'_, PyAny>>,
    fixed: Option<&Bound<'_, PyAny>>,
    symmetric: Option<bool>,
    progress: Option<&PyProgress>,
) -> PyResult<PyFittedSkeleton> {
    let bones = template.0.bone_count();
    let mask = |argument: Option<&Bound<'_, PyAny>>, name| {
        argument.map(|argument| mask(argument, name, "booleans", bones)).transpose()
    };
    let settings = FitSettings { deform: mask(deform, "deform")?, fixed: mask(fixed, "fixed")?, symmetric };
    let progress = shared(progress);
    py.detach(|| rig::fit_skeleton(&mesh.0, &template.0, &settings, &progress)).map(PyFittedSkeleton).map_err(
        |error| match error {
            FitError::Cancelled(cancelled) => Cancelled::new_err(cancelled.to_string()),
            error => value_error(error),
        },
    )
}
