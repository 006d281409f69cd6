//! From a rigged mesh to the islands of its cage.

use rayon::prelude::*;

use super::areas::JointAreas;
use super::island::Island;
use super::masks::PatchMasks;
use super::patch::{PatchInput, build_patch};
use super::{PbdError, PbdSettings};
use crate::cage::WindingNumber;
use crate::mesh::{Adjacency, SurfaceQuery, TriangleMesh};
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// Islands of all joint areas, the largest first; none for a mesh without triangles.
///
/// # Errors
/// [`PbdError`] when a cage cannot be built.
pub(super) fn build_islands(
    mesh: &TriangleMesh,
    skeleton: &Skeleton,
    weights: &SkinWeights,
    settings: &PbdSettings,
    stiffness_shares: Option<&[f32]>,
    adjacency: &Adjacency,
) -> Result<Vec<Island>, PbdError> {
    let Ok(surface) = SurfaceQuery::new(mesh) else {
        return Ok(Vec::new());
    };
    let weights = weights.normalized();
    let areas = JointAreas::new(mesh, skeleton, &weights, settings.cell_size);
    let masks = PatchMasks::new(mesh, adjacency, &areas);
    let winding = WindingNumber::new(mesh);
    let input = PatchInput {
        mesh,
        skeleton,
        weights: &weights,
        areas: &areas,
        masks: &masks,
        winding: &winding,
        surface: &surface,
        adjacency,
        region: settings.region,
        stiffness_shares,
    };
    let patches: Result<Vec<Vec<Island>>, PbdError> = (0..areas.cell_sizes.len() as u32)
        .into_par_iter()
        .map(|patch| build_patch(&input, patch, settings.cell_size))
        .collect();
    let mut islands: Vec<Island> = patches?.into_iter().flatten().collect();
    // The largest first, so that no thread starts it last.
    islands.sort_by_key(|island| std::cmp::Reverse(island.tetrahedra.len()));
    Ok(islands)
}
