//! `TetMesh` and `tetrahedralize`.

use dermis::cage::{self, CageError, TetMesh};
use numpy::PyArray2;
use pyo3::prelude::*;

use crate::arrays::{matrix, points_array};
use crate::errors::{NumericalError, value_error};
use crate::mesh::PyTriangleMesh;

/// Tetrahedra over shared vertices, positively oriented.
#[pyclass(frozen, name = "TetMesh", module = "dermis_native")]
pub(crate) struct PyTetMesh(pub(crate) TetMesh);

#[pymethods]
impl PyTetMesh {
    /// Positions (P,3).
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points_array(py, self.0.vertices())
    }

    /// Corner indices (T,4).
    #[getter]
    fn tetrahedra<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let tetrahedra = self.0.tetrahedra();
        matrix(py, tetrahedra.as_flattened().to_vec(), tetrahedra.len(), 4)
    }

    fn __repr__(&self) -> String {
        format!("TetMesh({} vertices, {} tetrahedra)", self.0.vertices().len(), self.0.tetrahedra().len())
    }
}

/// Body-centred-cubic lattice tetrahedra around and inside any triangle mesh: open, in pieces,
/// self-intersecting, non-manifold. Without `cell_size` the mean thickness of the mesh decides.
#[pyfunction]
#[pyo3(signature = (mesh, *, cell_size=None))]
pub(crate) fn tetrahedralize(
    py: Python<'_>,
    mesh: &PyTriangleMesh,
    cell_size: Option<f64>,
) -> PyResult<PyTetMesh> {
    py.detach(|| cage::tetrahedralize(&mesh.0, cell_size)).map(PyTetMesh).map_err(cage_error)
}

pub(crate) fn cage_error(error: CageError) -> PyErr {
    match error {
        CageError::Weights(_) => NumericalError::new_err(error.to_string()),
        CageError::NoTriangles
        | CageError::NoExtent
        | CageError::CellSize(_)
        | CageError::TooManyCells { .. } => value_error(error),
    }
}
