//! From a rigged mesh to the islands of its cage.

use rayon::prelude::*;

use super::areas::{self, JointAreas};
use super::island::Island;
use super::masks::PatchMasks;
use super::patch::{self, PatchInput, build_patch, count};
use super::{PbdError, PbdSettings};
use crate::cage::WindingNumber;
use crate::mesh::{Adjacency, SurfaceQuery, Topology, TriangleMesh};
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// A patch with so many times the tetrahedra that limbs of its joints' thickness would have is not in limbs.
const FILLED: f64 = 2.5;
/// Patches with so few tetrahedra may have them.
const FEW: f64 = 500.0;

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
    topology: &Topology,
    adjacency: &Adjacency,
) -> Result<Vec<Island>, PbdError> {
    let Ok(surface) = SurfaceQuery::new(mesh) else {
        return Ok(Vec::new());
    };
    let weights = weights.normalized();
    let areas = JointAreas::new(mesh, skeleton, &weights, settings.cell_size);
    let masks = PatchMasks::new(mesh, adjacency, &areas);
    let winding = WindingNumber::new(mesh);
    let normals = mesh.outward_normals(topology);
    let input = PatchInput {
        mesh,
        normals: &normals,
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
        .map(|patch| build_patch(&input, patch, settings.cell_size, patch::MOST_TETRAHEDRA))
        .collect();
    let patches = with_coarser_faces(&input, patches?)?;
    let mut islands: Vec<Island> = patches.into_iter().flatten().collect();
    // The largest first, so that no thread starts it last.
    islands.sort_by_key(|island| std::cmp::Reverse(island.tetrahedra.len()));
    Ok(islands)
}

/// Where all patches together have too many tetrahedra, those that fill something much thicker than
/// their joints get coarser cells. The small bones of a face lie close under the skin of a head: how
/// near they are says little about how thick it is, and cells as fine as that would go all through it.
fn with_coarser_faces(
    input: &PatchInput<'_>,
    patches: Vec<Vec<Island>>,
) -> Result<Vec<Vec<Island>>, PbdError> {
    let total: usize = patches.iter().map(|islands| count(islands)).sum();
    if total as f64 <= areas::MOST_TETRAHEDRA || input.areas.expected.is_empty() {
        return Ok(patches);
    }
    (0..)
        .zip(patches)
        .collect::<Vec<(u32, Vec<Island>)>>()
        .into_par_iter()
        .map(|(patch, islands)| {
            let expected = input.areas.expected[patch as usize];
            let most = expected.max(FEW);
            match count(&islands) as f64 > FILLED * most {
                true => build_patch(input, patch, None, most as usize),
                false => Ok(islands),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pbd::areas::tests::prism;

    #[test]
    fn a_fine_patch_has_no_cells_where_only_its_coarse_neighbour_blends() {
        let (mesh, skeleton, _) = prism(|x| if x < -1.2 { 2.0 } else { 0.2 });
        // The first joint blends far down its limb, to where the seam of the second one's cells reaches.
        let ramp = |from: f64, to: f64, x: f64| ((x - from) / (to - from)).clamp(0.0, 1.0);
        let rows = mesh.vertices().iter().map(|p| {
            let (second, third) = (ramp(-4.5, -0.4, p.x), ramp(1.5, 2.5, p.x));
            [1.0 - second, second - third, third]
        });
        let entries = rows.enumerate().flat_map(|(vertex, row)| {
            row.into_iter().enumerate().map(move |(bone, weight)| (vertex as i64, bone as i64, weight))
        });
        let weights = SkinWeights::from_triplets(entries, mesh.vertex_count(), 3).unwrap();
        let (settings, topology) = (PbdSettings::default(), mesh.topology());
        let adjacency = Adjacency::new(mesh.vertex_count(), &topology);
        let islands =
            build_islands(&mesh, &skeleton, &weights, &settings, None, &topology, &adjacency).unwrap();
        let volumes: Vec<f32> = islands.iter().map(|island| island.rest_volume).collect();
        assert_eq!(islands.len(), 2, "{volumes:?}");
        assert!(volumes.iter().any(|&volume| volume > 20.0 * volumes[0].min(volumes[1])));
    }
}
