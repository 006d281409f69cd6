//! Exact biharmonic distances to chosen vertices: two sparse solves each.

use super::component::Component;
use super::{Laplacian, SpectralError};
use crate::mesh::TriangleMesh;

/// Piece of a vertex and its index there; `None` for a vertex without area.
type Place = Option<(u32, u32)>;

/// The connected pieces of a surface, ready for exact distances.
pub struct ExactDistance {
    pub(super) components: Vec<Component>,
    pub(super) places: Vec<Place>,
}

impl ExactDistance {
    /// Prepares a surface; factorisations are made when they are first needed.
    ///
    /// # Errors
    /// [`SpectralError::Mesh`] when the mesh has no surface.
    pub fn new(mesh: &TriangleMesh) -> Result<Self, SpectralError> {
        let laplacian = Laplacian::new(mesh)?;
        let topology = mesh.topology();
        let mut members: Vec<Vec<usize>> = vec![Vec::new(); topology.component_count()];
        for (vertex, &component) in topology.components().iter().enumerate() {
            if laplacian.areas[vertex] > 0.0 {
                members[component as usize].push(vertex);
            }
        }
        let mut places = vec![None; mesh.vertex_count()];
        let mut components = Vec::new();
        for vertices in members.into_iter().filter(|m| !m.is_empty()) {
            for (local, &vertex) in vertices.iter().enumerate() {
                places[vertex] = Some((components.len() as u32, local as u32));
            }
            let areas = vertices.iter().map(|&v| laplacian.areas[v]).collect();
            components.push(Component::new(laplacian.stiffness.principal_submatrix(&vertices)?, areas));
        }
        Ok(Self { components, places })
    }

    /// Number of vertices of the mesh.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.places.len()
    }

    /// Distances of every vertex (V) to one vertex; infinite on other pieces.
    ///
    /// # Errors
    /// [`SpectralError`] when the vertex does not exist or the factorisation breaks down.
    pub fn from_vertex(&self, vertex: i64) -> Result<Vec<f64>, SpectralError> {
        let vertex = self.check(&[vertex])?[0];
        let mut distances = vec![f64::INFINITY; self.vertex_count()];
        distances[vertex] = 0.0;
        if let Some((piece, own)) = self.places[vertex] {
            let squares = self.components[piece as usize].squared_distances(own as usize)?;
            for (distance, place) in distances.iter_mut().zip(&self.places) {
                if let Some((_, local)) = place.filter(|(p, _)| *p == piece) {
                    *distance = squares[local as usize].sqrt();
                }
            }
        }
        Ok(distances)
    }

    /// Vertex indices, when all of them exist.
    pub(super) fn check(&self, vertices: &[i64]) -> Result<Vec<usize>, SpectralError> {
        let vertex_count = self.vertex_count();
        let index = |(position, &vertex): (usize, &i64)| match usize::try_from(vertex) {
            Ok(v) if v < vertex_count => Ok(v),
            _ => Err(SpectralError::VertexOutOfRange { position, vertex, vertex_count }),
        };
        vertices.iter().enumerate().map(index).collect()
    }
}
