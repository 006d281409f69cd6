//! Weights for a mesh that has none, from its skeleton alone: the one entrance to all methods.

use super::bind::{bind_volumetric, limit_influences};
use super::{Skeleton, bind_weights_paper};
use crate::mesh::TriangleMesh;
use crate::progress::{Cancelled, Progress};
use crate::skinning::SkinWeights;

/// How weights are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BindMethod {
    /// Through the volume of the body.
    #[default]
    Volumetric,
    /// Through the air, as printed (eq. 2).
    Paper,
}

/// Choices of a bind.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BindSettings {
    /// The method.
    pub method: BindMethod,
    /// Most bones that one vertex may follow, at least 1. Weights fade out before they are cut off.
    pub max_influences: Option<usize>,
    /// The bones (B) that take part; `None` for all.
    pub bones: Option<Vec<bool>>,
}

/// A bind that cannot be done.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BindError {
    /// There is nothing to bind.
    #[error("the mesh has no triangles")]
    NoTriangles,
    /// There is nothing to bind to.
    #[error("the skeleton has no bones")]
    NoBones,
    /// The choice of bones is empty.
    #[error("no bone is chosen")]
    NoChosenBones,
    /// The choice of bones is not the skeleton's.
    #[error("bones were chosen for {given} bones, but the skeleton has {expected}")]
    BoneCounts {
        /// Length of the choice.
        given: usize,
        /// Bones of the skeleton.
        expected: usize,
    },
    /// The work was asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Makes weights (V×B); every row sums to 1.
///
/// # Errors
/// [`BindError`] for a mesh without triangles or a skeleton without chosen bones.
pub fn bind_weights(
    mesh: &TriangleMesh,
    skeleton: &Skeleton,
    settings: &BindSettings,
    progress: &Progress,
) -> Result<SkinWeights, BindError> {
    let expected = skeleton.bone_count();
    let takes_part = settings.bones.clone().unwrap_or_else(|| vec![true; expected]);
    if mesh.triangles().is_empty() {
        return Err(BindError::NoTriangles);
    }
    if expected == 0 {
        return Err(BindError::NoBones);
    }
    if takes_part.len() != expected {
        return Err(BindError::BoneCounts { given: takes_part.len(), expected });
    }
    if !takes_part.contains(&true) {
        return Err(BindError::NoChosenBones);
    }
    let weights = match settings.method {
        BindMethod::Volumetric => bind_volumetric(mesh, skeleton, &takes_part, progress)?,
        BindMethod::Paper => bind_weights_paper(mesh.vertices(), skeleton, &takes_part),
    };
    Ok(match settings.max_influences {
        Some(count) => limit_influences(&weights, count),
        None => weights,
    })
}
