//! What can go wrong between a surface and its spectrum.

use crate::linalg::LinalgError;
use crate::mesh::MeshError;
use crate::progress::Cancelled;

/// A spectral computation that failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SpectralError {
    /// The mesh has no surface to work on.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A factorisation or an eigen solve failed.
    #[error("the Laplacian could not be solved: {0}")]
    Linalg(LinalgError),
    /// A vertex index does not exist.
    #[error("index {position} refers to vertex {vertex}, but there are {vertex_count} vertices")]
    VertexOutOfRange {
        /// Place in the list of indices.
        position: usize,
        /// The vertex that it names.
        vertex: i64,
        /// Vertices of the mesh.
        vertex_count: usize,
    },
    /// Two lists that go together differ in length.
    #[error("{first} first and {second} second vertices were given; pairs need as many of both")]
    PairCounts {
        /// Length of the first list.
        first: usize,
        /// Length of the second list.
        second: usize,
    },
    /// The work was asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl From<LinalgError> for SpectralError {
    fn from(error: LinalgError) -> Self {
        match error {
            LinalgError::Cancelled => Self::Cancelled(Cancelled),
            other => Self::Linalg(other),
        }
    }
}
