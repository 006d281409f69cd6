//! Why a skin cannot be built or solved.

use crate::cage::CageError;
use crate::skinning::SkinningError;

/// A skin that cannot be built, or a pose that cannot be solved.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PbdError {
    /// Mesh, weights and skeleton do not belong together.
    #[error("the {left} has {left_count} {element} and the {right} {right_count}")]
    Mismatch {
        /// "vertices" or "bones".
        element: &'static str,
        /// First owner.
        left: &'static str,
        /// Its count.
        left_count: usize,
        /// Second owner.
        right: &'static str,
        /// Its count.
        right_count: usize,
    },
    /// A setting is out of range.
    #[error("{name} is {value}; it must be {range}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// A vertex's share is out of range.
    #[error("{name}[{vertex}] is {share}; it must be from 0 to 1")]
    Share {
        /// Name of the shares.
        name: &'static str,
        /// Index of the vertex.
        vertex: usize,
        /// Its share.
        share: f32,
    },
    /// The pose or the vertices cannot be skinned.
    #[error(transparent)]
    Skinning(#[from] SkinningError),
    /// No cage could be built.
    #[error(transparent)]
    Cage(#[from] CageError),
    /// The system refused the threads.
    #[error("{count} threads could not be started: {reason}")]
    Threads {
        /// Threads asked for.
        count: usize,
        /// What the system said.
        reason: String,
    },
}
