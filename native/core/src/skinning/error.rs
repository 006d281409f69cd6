//! What can be wrong with vertices and transforms, naming the first element at fault.

/// Vertices or transforms that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SkinningError {
    /// Two arrays that belong together differ in length.
    #[error("{given} {element} were given where {expected} are needed")]
    Count {
        /// What was counted.
        element: &'static str,
        /// How many are needed.
        expected: usize,
        /// How many were given.
        given: usize,
    },
    /// A transform is NaN or infinite.
    #[error("the transform of bone {bone} is not finite")]
    NonFiniteTransform {
        /// Index of the bone.
        bone: usize,
    },
    /// A vertex is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite")]
    NonFiniteVertex {
        /// Index of the vertex.
        vertex: usize,
    },
}
