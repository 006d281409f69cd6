//! Weights for a mesh that has none, from its skeleton alone, through the volume of the body.
//!
//! 1. A cage of lattice tetrahedra around and through any mesh (`body`), after the idea of Dionne
//!    and de Lasa (2013), "Geodesic voxel binding for production character meshes".
//! 2. On the cage, for every bone: distances through the body (`geodesic`) and the chance that a
//!    random walk meets this bone before any other (`first_met`).
//! 3. Both decide, softly, which bone a vertex belongs to (`labels`), and a diffusion over the
//!    surface makes the falloff (`falloff`).
//! 4. Where the skeleton has a mirror plane, bones keep to their side (`mirror`).
//! 5. What the bones do not reach follows what they do, and small parts move as one, unless something
//!    else is chosen (`loose_parts`).
//!
//! Any mesh with a triangle and any skeleton with a bone gets weights: open, in pieces,
//! self-intersecting, flat, with bones outside. Moving, turning or scaling mesh and skeleton
//! together, or permuting vertices and triangles, changes weights by rounding alone, or, where the
//! surface has no distinct axes of inertia and is turned, by the size of the cells.

mod body;
mod falloff;
mod first_met;
mod geodesic;
mod labels;
mod limit;
mod loose_parts;
mod mirror;
mod sources;

use glam::DVec3;

use crate::mesh::{ResolvedChoice, TriangleMesh};
use crate::progress::{Cancelled, Progress};
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

pub(super) use limit::limit_influences;
pub use loose_parts::BindPartPolicy;
pub(super) use mirror::{Plane, mirror_plane};

use body::Body;
use labels::{Labels, Row};

/// Weights (V×B) of a mesh for the bones (B) that `takes_part` marks, at least one of them. Every
/// row sums to 1.
///
/// # Errors
/// [`Cancelled`] when the work was asked to stop.
pub(super) fn bind_volumetric(
    mesh: &TriangleMesh,
    skeleton: &Skeleton,
    takes_part: &[bool],
    choice: &ResolvedChoice<BindPartPolicy>,
    progress: &Progress,
) -> Result<SkinWeights, Cancelled> {
    progress.begin("Filling the body", 0.0, 0.2)?;
    let body = Body::new(mesh, skeleton, takes_part, progress)?;
    let labels = labels_of(&body, skeleton, takes_part, progress)?;
    progress.begin("Smoothing", 0.7, 0.95)?;
    let mut rows = falloff::smoothed(&body.mesh, labels, skeleton.bone_count(), progress)?;
    mirror::keep_sides(&body, &mut rows, skeleton, takes_part);
    progress.begin("Attaching loose parts", 0.95, 1.0)?;
    loose_parts::attach(&body, &mut rows, takes_part, choice);
    let rows = body.welded.iter().map(|&v| rows[v as usize].iter().copied());
    Ok(SkinWeights::from_rows(rows, skeleton.bone_count()))
}

/// Longest side of the bounds of the bones that take part.
fn skeleton_length(heads: &[DVec3], tails: &[DVec3], takes_part: &[bool]) -> f64 {
    let bones = (0..heads.len()).filter(|&bone| takes_part[bone]);
    let (low, high) = bones
        .flat_map(|bone| [heads[bone], tails[bone]])
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), end| (low.min(end), high.max(end)));
    (high - low).max_element().max(0.0)
}

fn labels_of(
    body: &Body,
    skeleton: &Skeleton,
    takes_part: &[bool],
    progress: &Progress,
) -> Result<Labels, Cancelled> {
    let unreached = || {
        let count = body.mesh.vertex_count();
        Labels { rows: vec![Row::new(); count], distances: vec![f64::INFINITY; count] }
    };
    let Some(cage) = &body.cage else { return Ok(unreached()) };
    let sources = sources::sources(body, skeleton, takes_part);
    progress.begin("Measuring distances through the body", 0.2, 0.45)?;
    let is_inside = |point| body.embed(point).is_some();
    let entrances = geodesic::entrances(cage, &sources, takes_part.len(), &is_inside);
    let distances = geodesic::bone_distances(&geodesic::Graph::new(cage), &entrances, progress)?;
    progress.begin("Walking through the body", 0.45, 0.7)?;
    // Where the solve fails the distances decide alone.
    let chances = first_met::first_met(cage, &entrances)
        .unwrap_or_else(|_| distances.iter().map(|column| vec![1.0; column.len()]).collect());
    Ok(labels::labels(body, cage, &sources, &chances, &distances))
}
