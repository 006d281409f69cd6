//! Weight retargeting: the weights of one character for another (section 5, Algorithm 2).

mod alignment;
mod auto;
pub mod bilaplacian;
mod body;
mod bone_rays;
mod bone_rotations;
mod bones;
mod bound_alike;
mod chains;
mod cloth;
mod crease_smoothing;
pub mod deform;
mod differing_shapes;
mod error;
mod geodesic;
pub mod icp;
pub mod inpaint;
mod joint_refinement;
mod joint_system;
mod landmarks;
mod loose_parts;
mod mapped;
mod marks;
mod match_neighbours;
mod matching;
mod paper;
pub mod part_shapes;
pub mod part_weights;
pub mod parts;
mod ray_marks;
mod reflection;
pub mod rejection;
mod rigid_fit;
pub mod seams;
pub mod shell;
mod shepard;
mod similarity;
mod sliding;
mod surface_sample;
mod surface_weights;
mod unclaimed;
mod warp;

use self::parts::{Part, PartPolicy};
use crate::mesh::{PartChoice, TriangleMesh};
use crate::progress::Progress;
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;
use differing_shapes::Differing;

pub use bones::pair_bones;
pub use chains::{Biped, ChainEnd, Chains};
pub use error::RetargetError;
pub use landmarks::{check_landmarks, landmarks_from_skeletons};
pub use mapped::retarget_weights;
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
    /// What becomes of loose parts of the target.
    pub parts: PartChoice<PartPolicy>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { method: Method::Auto, max_influences: None, eigenpairs: 100, parts: PartChoice::default() }
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

/// Where a vertex has its weights from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// Its match on the source.
    Matched,
    /// Its neighbours, by biharmonic inpainting.
    Inpainted,
    /// The closest point of the source, although no match near it could be relied on.
    Nearest,
    /// The treatment of its loose part: rigid, or after the surface below.
    Part,
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
    /// Where each target vertex has its weights from.
    pub origin: Vec<Origin>,
    /// What became of each loose part of the target, its body among them; empty by the paper's method.
    pub parts: Vec<Part>,
    /// Landmark pairs used (source vertex, target vertex).
    pub landmarks: Vec<[u32; 2]>,
}

/// Retargets between skeletons of which `pairs` tells the target bone of each source bone; every
/// weighted one has a partner. `None` where a skeleton is missing. Returns also what the target's own
/// skeleton should know where shapes differ. `binds` says that the target will be bound to its skeleton
/// in any case.
fn by_method(
    (source, source_weights): (Character<'_>, &SkinWeights),
    target: Character<'_>,
    pairs: Option<&[Option<u32>]>,
    landmarks: Option<&[[i64; 2]]>,
    (settings, binds): (&Settings, bool),
    progress: &Progress,
) -> Result<(Retargeted, Option<Differing>), RetargetError> {
    match (settings.method, source.skeleton, target.skeleton, pairs) {
        (Method::Auto, Some(from), Some(to), Some(pairs)) => {
            let source = auto::Rigged { mesh: source.mesh, skeleton: from };
            let target = auto::Rigged { mesh: target.mesh, skeleton: to };
            auto::retarget((source, source_weights), target, pairs, landmarks, (settings, binds), progress)
        }
        _ if settings.parts != PartChoice::default() => Err(RetargetError::PartsByPaper),
        _ => {
            let source = (source, source_weights);
            Ok((paper::retarget(source, target, pairs, landmarks, settings, progress)?, None))
        }
    }
}

fn check_counts(source: Character<'_>, weights: &SkinWeights) -> Result<(), RetargetError> {
    let vertex_count = source.mesh.vertex_count();
    let bone_count = source.skeleton.map_or(weights.bone_count(), Skeleton::bone_count);
    let checks = [
        ("vertices", "mesh", weights.vertex_count(), vertex_count),
        ("bones", "skeleton", weights.bone_count(), bone_count),
    ];
    for (element, owner, found, expected) in checks {
        if found != expected {
            return Err(RetargetError::WeightCounts { element, owner, weights: found, expected });
        }
    }
    if weights.entry_count() == 0 {
        return Err(RetargetError::NoWeights);
    }
    Ok(())
}
