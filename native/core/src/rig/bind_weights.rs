//! Weights for a mesh that has none, from its skeleton alone: the one entrance to all methods.

use super::bind::{BindPartPolicy, bind_volumetric, limit_influences};
use super::{Skeleton, bind_weights_paper};
use crate::mesh::{PartChoice, PartChoiceError, TriangleMesh};
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
    /// What becomes of loose parts.
    pub parts: PartChoice<BindPartPolicy>,
    /// Vertices that keep the weights they have.
    pub protected: Option<ProtectedWeights>,
}

/// Vertices that keep their weights bit for bit, whatever these add up to.
#[derive(Debug, Clone, PartialEq)]
pub struct ProtectedWeights {
    /// Which vertices (V).
    pub vertices: Vec<bool>,
    /// The weights that there are (V×B).
    pub weights: SkinWeights,
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
    /// The treatments of loose parts do not fit the mesh.
    #[error(transparent)]
    Parts(#[from] PartChoiceError),
    /// Treatments of loose parts were given to the paper's method, which knows none.
    #[error("loose parts can be treated by method \"volumetric\" alone")]
    PartsByPaper,
    /// What is protected is not of this mesh and skeleton.
    #[error("protected {what} are of {given} {element}, but there are {expected}")]
    ProtectedCounts {
        /// "vertices" or "weights".
        what: &'static str,
        /// "vertices" or "bones".
        element: &'static str,
        /// What was given.
        given: usize,
        /// What the mesh or the skeleton has.
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
    if settings.method == BindMethod::Paper && settings.parts != PartChoice::default() {
        return Err(BindError::PartsByPaper);
    }
    let choice = settings.parts.resolved(mesh)?;
    if let Some(protected) = &settings.protected {
        check_protected(protected, mesh.vertex_count(), expected)?;
    }
    let weights = match settings.method {
        BindMethod::Volumetric => bind_volumetric(mesh, skeleton, &takes_part, &choice, progress)?,
        BindMethod::Paper => bind_weights_paper(mesh.vertices(), skeleton, &takes_part),
    };
    let weights = match settings.max_influences {
        Some(count) => limit_influences(&weights, count),
        None => weights,
    };
    Ok(match &settings.protected {
        Some(protected) => with_protected(&weights, protected),
        None => weights,
    })
}

fn check_protected(
    protected: &ProtectedWeights,
    vertex_count: usize,
    bone_count: usize,
) -> Result<(), BindError> {
    let counts = [
        ("vertices", "vertices", protected.vertices.len(), vertex_count),
        ("weights", "vertices", protected.weights.vertex_count(), vertex_count),
        ("weights", "bones", protected.weights.bone_count(), bone_count),
    ];
    match counts.into_iter().find(|&(.., given, expected)| given != expected) {
        Some((what, element, given, expected)) => {
            Err(BindError::ProtectedCounts { what, element, given, expected })
        }
        None => Ok(()),
    }
}

fn with_protected(weights: &SkinWeights, protected: &ProtectedWeights) -> SkinWeights {
    let row = |vertex: usize| {
        let kept = if protected.vertices[vertex] { &protected.weights } else { weights };
        kept.entries(vertex).map(|(bone, weight)| (bone, f64::from(weight)))
    };
    SkinWeights::from_rows((0..weights.vertex_count()).map(row), weights.bone_count())
}
