//! What can be wrong with a mesh, naming the first element at fault.

/// A mesh that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite: ({x}, {y}, {z})")]
    NonFiniteVertex {
        /// Index of the vertex.
        vertex: usize,
        /// Its coordinates.
        x: f64,
        /// Its coordinates.
        y: f64,
        /// Its coordinates.
        z: f64,
    },
    /// A triangle or polygon names a vertex that does not exist.
    #[error("{element} {index} refers to vertex {vertex}, but there are {vertex_count} vertices")]
    VertexOutOfRange {
        /// "triangle" or "polygon".
        element: &'static str,
        /// Index of the triangle or polygon.
        index: usize,
        /// The vertex that it names.
        vertex: i64,
        /// Vertices of the mesh.
        vertex_count: usize,
    },
    /// A polygon has fewer than three corners.
    #[error("polygon {polygon} has {corners} corners; a polygon needs at least 3")]
    TooFewCorners {
        /// Index of the polygon.
        polygon: usize,
        /// Its number of corners.
        corners: i64,
    },
    /// The corner counts of the polygons do not add up to the index list.
    #[error("the polygons have {expected} corners in all, but {given} vertex indices were given")]
    CornerCount {
        /// Sum of the polygons' corners.
        expected: usize,
        /// Length of the index list.
        given: usize,
    },
    /// The mesh has too many elements for 32-bit indices.
    #[error("{count} {element} are more than 32-bit indices can address")]
    TooLarge {
        /// "vertices" or "triangles".
        element: &'static str,
        /// How many there are.
        count: usize,
    },
    /// There is no triangle with area.
    #[error("the mesh has no triangle with an area")]
    NoSurface,
}
