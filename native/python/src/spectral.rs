//! `BiharmonicDistance`, `laplacian` and `eigenpairs`.

use dermis::linalg::smallest_eigenpairs;
use dermis::spectral::{BiharmonicDistance, Laplacian};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;

use crate::arrays::{indices, matrix};
use crate::errors::{linalg_error, spectral_error, value_error};
use crate::mesh::PyTriangleMesh;
use crate::progress::{PyProgress, shared};

type Pairs<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);
type Csc<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
);

/// Biharmonic distance on a surface (eq. 17-19), infinite between components.
#[pyclass(frozen, name = "BiharmonicDistance", module = "dermis_native")]
pub(crate) struct PyBiharmonicDistance(BiharmonicDistance);

#[pymethods]
impl PyBiharmonicDistance {
    #[new]
    #[pyo3(signature = (mesh, *, eigenpairs=100, progress=None))]
    fn new(
        py: Python<'_>,
        mesh: &PyTriangleMesh,
        eigenpairs: usize,
        progress: Option<&PyProgress>,
    ) -> PyResult<Self> {
        let progress = shared(progress);
        py.detach(|| {
            progress.begin("Distances on the surface", 0.0, 1.0)?;
            BiharmonicDistance::new(&mesh.0, eigenpairs, &progress)
        })
        .map(Self)
        .map_err(spectral_error)
    }

    /// Distances (n,) of the vertex pairs i[n], j[n].
    fn between<'py>(
        &self,
        py: Python<'py>,
        i: &Bound<'_, PyAny>,
        j: &Bound<'_, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (i, j) = (indices(i, "i")?, indices(j, "j")?);
        let distances = py.detach(|| self.0.between(&i, &j)).map_err(spectral_error)?;
        Ok(PyArray1::from_vec(py, distances))
    }

    /// Distances (V,) of every vertex to vertex i.
    #[expect(clippy::wrong_self_convention, reason = "distances from a vertex, not a conversion")]
    fn from_vertex<'py>(&self, py: Python<'py>, i: i64) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let distances = py.detach(|| self.0.from_vertex(i)).map_err(spectral_error)?;
        Ok(PyArray1::from_vec(py, distances))
    }

    /// Ascending, without the zero of each component.
    #[getter]
    fn eigenvalues<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.0.eigenvalues())
    }
}

/// Robust Laplace-Beltrami operator (tufted intrinsic Delaunay, Sharp & Crane 2020).
#[pyfunction]
pub(crate) fn laplacian<'py>(py: Python<'py>, mesh: &PyTriangleMesh) -> PyResult<Csc<'py>> {
    let laplacian = py.detach(|| Laplacian::new(&mesh.0)).map_err(value_error)?;
    let pattern = laplacian.stiffness.pattern();
    let signed = |indices: &[usize]| indices.iter().map(|&i| i as i64).collect::<Vec<_>>();
    Ok((
        PyArray1::from_vec(py, laplacian.stiffness.values().to_vec()),
        PyArray1::from_vec(py, signed(pattern.rows())),
        PyArray1::from_vec(py, signed(pattern.column_starts())),
        PyArray1::from_vec(py, laplacian.areas),
    ))
}

/// The `count` smallest non-zero eigenpairs of the Laplacian: values (k,), mass-orthonormal
/// vectors (V,k).
#[pyfunction]
#[pyo3(signature = (mesh, count, *, progress=None))]
pub(crate) fn eigenpairs<'py>(
    py: Python<'py>,
    mesh: &PyTriangleMesh,
    count: usize,
    progress: Option<&PyProgress>,
) -> PyResult<Pairs<'py>> {
    let progress = shared(progress);
    let components = mesh.0.topology().component_count();
    if components != 1 {
        return Err(value_error(format!(
            "the mesh has {components} components (loose vertices count); eigenpairs need exactly 1"
        )));
    }
    let laplacian = Laplacian::new(&mesh.0).map_err(value_error)?;
    let pairs = py
        .detach(|| {
            let constant = vec![1.0; laplacian.areas.len()];
            let mut report = |share: f64| progress.report(share).is_ok();
            smallest_eigenpairs(&laplacian.stiffness, &laplacian.areas, &constant, count, &mut report)
        })
        .map_err(linalg_error)?;
    let found = pairs.values.len();
    let columns = matrix(py, pairs.vectors, found, laplacian.areas.len())?;
    Ok((PyArray1::from_vec(py, pairs.values), columns.transpose()?))
}
