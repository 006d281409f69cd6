//! Why a cage cannot be built.

/// A mesh or cell size from which no cage can be made.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CageError {
    /// The mesh has no triangle to build around.
    #[error("the mesh has no triangles")]
    NoTriangles,
    /// All vertices are in one point.
    #[error("the mesh has no extent")]
    NoExtent,
    /// The cell size is not a positive number.
    #[error("the cell size is {0}; it must be finite and above zero")]
    CellSize(f64),
    /// The cells would be too many.
    #[error("cells of size {cell_size} would make more than {limit} tetrahedra; use larger cells")]
    TooManyCells {
        /// The size asked for.
        cell_size: f64,
        /// The largest number of tetrahedra.
        limit: usize,
    },
    /// The weights could not be extended from the surface to the cage.
    #[error("the weights could not be extended into the cage: {0}")]
    Weights(String),
}
