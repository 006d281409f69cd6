//! Weight retargeting: the weights of one character for another (section 5, Algorithm 2).

mod alignment;
mod auto;
pub mod bilaplacian;
mod body;
mod bone_rays;
mod bone_rotations;
mod bones;
mod chains;
pub mod deform;
mod error;
mod geodesic;
pub mod icp;
pub mod inpaint;
mod joint_refinement;
mod joint_system;
mod landmarks;
mod loose_parts;
mod marks;
mod matching;
mod paper;
mod parallel;
pub mod part_shapes;
pub mod part_weights;
pub mod parts;
mod ray_marks;
pub mod rejection;
mod rigid_fit;
pub mod seams;
pub mod shell;
mod shepard;
#[cfg(test)]
mod test_surfaces;
mod warp;

use crate::mesh::TriangleMesh;
use crate::progress::Progress;
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

pub use bones::pair_bones;
pub use chains::{Biped, ChainEnd, Chains};
pub use error::RetargetError;
pub use landmarks::{check_landmarks, landmarks_from_skeletons};
pub use matching::{Descriptors, Match, Regions, best_matches};
pub use shepard::{NEIGHBOURS, shepard};

/// How weights find their way to the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// The best method that applies to the pair of characters.
    #[default]
    Auto,
    /// Algorithm 2 of the paper: biharmonic distances to landmarks, Shepard interpolation.
    Paper,
}

/// Settings of a retarget.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// How weights find their way.
    pub method: Method,
    /// Keep at most this many influences for each vertex.
    pub max_influences: Option<usize>,
    /// Eigenpairs for distances between arbitrary vertices (eq. 17).
    pub eigenpairs: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { method: Method::Auto, max_influences: None, eigenpairs: 100 }
    }
}

/// One side of a retarget: a surface and, where known, its skeleton in the same space.
#[derive(Debug, Clone, Copy)]
pub struct Character<'a> {
    /// The surface.
    pub mesh: &'a TriangleMesh,
    /// The skeleton.
    pub skeleton: Option<&'a Skeleton>,
}

/// What a retarget found.
#[derive(Debug, Clone, PartialEq)]
pub struct Retargeted {
    /// Weights of the target, columns in the order of the target's bones; every row sums to 1.
    pub weights: SkinWeights,
    /// Source vertex for each target vertex.
    pub correspondence: Vec<u32>,
    /// Whether a vertex was matched by the surface; the others follow the nearest matched surface.
    pub matched: Vec<bool>,
    /// Landmark pairs used (source vertex, target vertex).
    pub landmarks: Vec<[u32; 2]>,
}

/// Gives the target the weights of the source.
///
/// Without landmarks both skeletons are needed, and landmarks are chosen on them. Where both
/// skeletons are given, bones are paired and matches are searched region by region (figure 3).
///
/// # Errors
/// [`RetargetError`]; nothing was changed.
pub fn retarget_weights(
    source: Character<'_>,
    source_weights: &SkinWeights,
    target: Character<'_>,
    landmarks: Option<&[[i64; 2]]>,
    settings: &Settings,
    progress: &Progress,
) -> Result<Retargeted, RetargetError> {
    match settings.method {
        Method::Auto if source.skeleton.is_some() && target.skeleton.is_some() => {
            let (Some(a), Some(b)) = (source.skeleton, target.skeleton) else { unreachable!() };
            auto::retarget((source.mesh, a), source_weights, (target.mesh, b), settings, progress)
        }
        Method::Auto | Method::Paper => {
            paper::retarget(source, source_weights, target, landmarks, settings, progress)
        }
    }
}
