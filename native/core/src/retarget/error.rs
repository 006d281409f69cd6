//! Why two characters cannot be matched.

use crate::mesh::{MeshError, PartChoiceError};
use crate::progress::Cancelled;
use crate::rig::{BindError, BoneMapError};
use crate::spectral::SpectralError;

/// A retarget that cannot be done. Nothing was changed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RetargetError {
    /// The weights do not belong to the mesh or the skeleton.
    #[error("the source weights have {weights} {element}, but the source {owner} has {expected}")]
    WeightCounts {
        /// "vertices" or "bones".
        element: &'static str,
        /// "mesh" or "skeleton".
        owner: &'static str,
        /// What the weights have.
        weights: usize,
        /// What the owner has.
        expected: usize,
    },
    /// No source vertex has any weight.
    #[error("no source vertex has a weight; paint or bind the source first")]
    NoWeights,
    /// Bones cannot be mapped.
    #[error(transparent)]
    BoneMap(#[from] BoneMapError),
    /// A bone map was given without the skeletons that it maps.
    #[error("a bone map needs both skeletons")]
    MapWithoutSkeletons,
    /// A landmark names a vertex that does not exist.
    #[error("landmark {landmark}: {side} vertex {vertex} does not exist; the {side} has {count} vertices")]
    LandmarkOutOfRange {
        /// Index of the pair.
        landmark: usize,
        /// "source" or "target".
        side: &'static str,
        /// The vertex.
        vertex: i64,
        /// Vertices of that mesh.
        count: usize,
    },
    /// A landmark lies on another piece than the first one.
    #[error(
        "landmark {landmark}: {side} vertex {vertex} lies on another piece of the mesh than landmark 0; \
         put all landmarks on the body"
    )]
    LandmarkOnOtherComponent {
        /// Index of the pair.
        landmark: usize,
        /// "source" or "target".
        side: &'static str,
        /// The vertex.
        vertex: usize,
    },
    /// Too few landmarks to tell places apart.
    #[error(
        "places cannot be told apart by {}; give at least 2 pairs, better 5, \
         or both skeletons so that landmarks can be chosen", pairs(*.count)
    )]
    TooFewLandmarks {
        /// Number of different pairs.
        count: usize,
    },
    /// A mesh cannot be used.
    #[error("{side} mesh: {error}")]
    Mesh {
        /// "source" or "target".
        side: &'static str,
        /// What is wrong.
        error: MeshError,
    },
    /// The Laplacian could not be solved.
    #[error("{side} mesh: {error}")]
    Spectral {
        /// "source" or "target".
        side: &'static str,
        /// What is wrong.
        error: SpectralError,
    },
    /// The target could not be bound to the bones that the source lacks.
    #[error("target: {0}")]
    Bind(BindError),
    /// The treatments of loose parts do not fit the target.
    #[error("target mesh: {0}")]
    Parts(#[from] PartChoiceError),
    /// Treatments of loose parts were given to the paper's method, which knows none.
    #[error("loose parts can be treated by method \"auto\" alone, which needs both skeletons")]
    PartsByPaper,
    /// The work was asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl From<BindError> for RetargetError {
    fn from(error: BindError) -> Self {
        match error {
            BindError::Cancelled(cancelled) => cancelled.into(),
            error => Self::Bind(error),
        }
    }
}

fn pairs(count: usize) -> String {
    match count {
        1 => "1 landmark pair".to_owned(),
        n => format!("{n} landmark pairs"),
    }
}
