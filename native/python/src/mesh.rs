//! `TriangleMesh`.

use dermis::mesh::{MeshError, TriangleMesh, triangulate_polygons};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::arrays::{indices, integers, matrix, points, points_array};
use crate::errors::value_error;

/// Triangles over shared vertices: any topology, several components, boundaries allowed.
#[pyclass(frozen, name = "TriangleMesh", module = "dermis_native")]
pub(crate) struct PyTriangleMesh(pub(crate) TriangleMesh);

#[pymethods]
impl PyTriangleMesh {
    #[new]
    fn new(vertices: &Bound<'_, PyAny>, triangles: &Bound<'_, PyAny>) -> PyResult<Self> {
        let vertices = points(vertices, "vertices")?;
        let array = integers(triangles, "triangles", &[None, Some(3)])?;
        let mut triangles = Vec::with_capacity(array.len()? / 3);
        for (index, corners) in array.as_slice()?.as_chunks::<3>().0.iter().enumerate() {
            let mut triangle = [0; 3];
            for (corner, &vertex) in triangle.iter_mut().zip(corners) {
                *corner = u32::try_from(vertex).map_err(|_| {
                    let vertex_count = vertices.len();
                    value_error(MeshError::VertexOutOfRange {
                        element: "triangle",
                        index,
                        vertex,
                        vertex_count,
                    })
                })?;
            }
            triangles.push(triangle);
        }
        TriangleMesh::new(vertices, triangles).map(Self).map_err(value_error)
    }

    /// Polygons as flat vertex indices; each polygon is cut into triangles at its best diagonals.
    #[staticmethod]
    fn from_polygons(
        vertices: &Bound<'_, PyAny>,
        loop_counts: &Bound<'_, PyAny>,
        loop_indices: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let vertices = points(vertices, "vertices")?;
        let counts = indices(loop_counts, "loop_counts")?;
        let corners = indices(loop_indices, "loop_indices")?;
        triangulate_polygons(vertices, &counts, &corners).map(Self).map_err(value_error)
    }

    /// Positions (V,3).
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points_array(py, self.0.vertices())
    }

    /// Vertex triples (F,3).
    #[getter]
    fn triangles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let triangles = self.0.triangles();
        matrix(py, triangles.as_flattened().to_vec(), triangles.len(), 3)
    }

    /// Component of each vertex (V,), numbered by their smallest vertex; loose vertices count.
    #[getter]
    fn components<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_vec(py, self.0.topology().components().to_vec())
    }

    /// (E,2) vertex pairs used by exactly one triangle.
    #[getter]
    fn boundary_edges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let edges = self.0.topology().boundary_edges();
        matrix(py, edges.as_flattened().to_vec(), edges.len(), 2)
    }

    /// (E,2) vertex pairs used by more than two triangles.
    #[getter]
    fn non_manifold_edges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let edges = self.0.topology().non_manifold_edges();
        matrix(py, edges.as_flattened().to_vec(), edges.len(), 2)
    }

    /// Triangles with a repeated vertex or no area.
    #[getter]
    fn degenerate_triangles<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_vec(py, self.0.degenerate_triangles())
    }

    fn __repr__(&self) -> String {
        format!("TriangleMesh({} vertices, {} triangles)", self.0.vertex_count(), self.0.triangles().len())
    }
}
