//! Why a skeleton cannot be fitted.

use crate::progress::Cancelled;

/// A mesh, template or choice of bones that a skeleton cannot be fitted with.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    /// There is nothing to fit into.
    #[error("the mesh has no triangles")]
    NoTriangles,
    /// All vertices are in one point.
    #[error("the mesh has no size: all its vertices are in one point")]
    NoExtent,
    /// A skeleton of fewer than two bones has no shape to fit.
    #[error("the template has {0} bones; a skeleton of at least two is needed")]
    TooFewBones(usize),
    /// All bones that count are in one point.
    #[error("the template has no size: all its bones are in one point")]
    NoTemplateExtent,
    /// No bone follows the body.
    #[error("no bone of the template is marked as deforming")]
    NoDeformBones,
    /// A choice of bones is not the template's.
    #[error("{argument} has {given} entries, but the template has {expected} bones")]
    BoneCounts {
        /// "deform" or "fixed".
        argument: &'static str,
        /// Length of the choice.
        given: usize,
        /// Bones of the template.
        expected: usize,
    },
    /// The work was asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}
