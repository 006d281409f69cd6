//! Which patch speaks for which vertex: 1 inside a patch, fading into the neighbour across the
//! border of two patches.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::areas::JointAreas;
use super::patch::smoothstep;
use crate::mesh::{Adjacency, TriangleMesh};

/// Half the width of the seam between two patches, in cells of the coarser one.
const SEAM_CELLS: f64 = 2.0;

/// Each vertex's own patch, and the neighbouring one with its share.
#[derive(Debug, Clone)]
pub(super) struct PatchMasks {
    own: Vec<Option<u32>>,
    other: Vec<Option<(u32, f64)>>,
}

impl PatchMasks {
    pub(super) fn new(mesh: &TriangleMesh, adjacency: &Adjacency, areas: &JointAreas) -> Self {
        let own: Vec<Option<u32>> =
            areas.home.iter().map(|home| home.map(|area| areas.areas[area as usize].patch)).collect();
        let mut other = vec![None; own.len()];
        let patches = areas.cell_sizes.len() as u32;
        for a in 0..patches {
            for b in (0..patches).filter(|&b| b != a) {
                let at_border = |&v: &usize| {
                    own[v] == Some(a) && adjacency.neighbours(v).iter().any(|&n| own[n as usize] == Some(b))
                };
                let mut border = (0..own.len()).filter(at_border).peekable();
                if border.peek().is_none() {
                    continue;
                }
                let cell = areas.cell_sizes[a as usize].max(areas.cell_sizes[b as usize]);
                let width = SEAM_CELLS * cell;
                for (v, distance) in
                    geodesic_distances(mesh, adjacency, border, width).into_iter().enumerate()
                {
                    let Some(distance) = distance.filter(|_| own[v] == Some(a)) else { continue };
                    let share = 0.5 - 0.5 * smoothstep(distance / width);
                    let current: &mut Option<(u32, f64)> = &mut other[v];
                    if current.is_none_or(|(_, s)| share > s) {
                        *current = Some((b, share));
                    }
                }
            }
        }
        Self { own, other }
    }

    /// True where a patch speaks first for a vertex.
    pub(super) fn is_own(&self, vertex: usize, patch: u32) -> bool {
        self.own[vertex] == Some(patch)
    }

    /// Share of a patch in a vertex; the shares of all patches sum to at most 1.
    pub(super) fn mask(&self, vertex: usize, patch: u32) -> f64 {
        match (self.own[vertex], self.other[vertex]) {
            (Some(own), other) if own == patch => 1.0 - other.map_or(0.0, |(_, share)| share),
            (_, Some((other, share))) if other == patch => share,
            _ => 0.0,
        }
    }
}

/// Distance along mesh edges to the nearest seed, up to `limit`; `None` beyond.
pub(super) fn geodesic_distances(
    mesh: &TriangleMesh,
    adjacency: &Adjacency,
    seeds: impl Iterator<Item = usize>,
    limit: f64,
) -> Vec<Option<f64>> {
    let mut distances: Vec<Option<f64>> = vec![None; mesh.vertex_count()];
    // Non-negative floats order like their bits.
    let mut queue: BinaryHeap<Reverse<(u64, u32)>> = BinaryHeap::new();
    for seed in seeds {
        distances[seed] = Some(0.0);
        queue.push(Reverse((0.0f64.to_bits(), seed as u32)));
    }
    while let Some(Reverse((bits, vertex))) = queue.pop() {
        let distance = f64::from_bits(bits);
        if distances[vertex as usize].is_some_and(|d| d < distance) {
            continue;
        }
        for &neighbour in adjacency.neighbours(vertex as usize) {
            let (a, b) = (mesh.vertices()[vertex as usize], mesh.vertices()[neighbour as usize]);
            let through = distance + a.distance(b);
            if through <= limit && distances[neighbour as usize].is_none_or(|d| through < d) {
                distances[neighbour as usize] = Some(through);
                queue.push(Reverse((through.to_bits(), neighbour)));
            }
        }
    }
    distances
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pbd::areas::JointArea;
    use glam::DVec3;

    /// A strip of quads along x, one unit each.
    fn strip(count: u32) -> TriangleMesh {
        let vertices = (0..=count).flat_map(|i| [0.0, 1.0].map(|y| DVec3::new(f64::from(i), y, 0.0)));
        let triangles = (0..count).flat_map(|i| {
            let a = 2 * i;
            [[a, a + 2, a + 1], [a + 2, a + 3, a + 1]]
        });
        TriangleMesh::new(vertices.collect(), triangles.collect()).unwrap()
    }

    #[test]
    fn distances_follow_edges_and_stop_at_the_limit() {
        let mesh = strip(6);
        let adjacency = Adjacency::new(mesh.vertex_count(), &mesh.topology());
        let distances = geodesic_distances(&mesh, &adjacency, [0usize].into_iter(), 3.5);
        assert_eq!(distances[0], Some(0.0));
        assert_eq!(distances[1], Some(1.0));
        assert_eq!(distances[6], Some(3.0));
        assert_eq!(distances[8], None, "4 away");
    }

    #[test]
    fn masks_pass_from_patch_to_patch_and_sum_to_one() {
        let mesh = strip(40);
        let adjacency = Adjacency::new(mesh.vertex_count(), &mesh.topology());
        let area = |patch: u32| JointArea { bone: 1, parent: 0, centre: DVec3::ZERO, radius: 1.0, patch };
        let home = (0..mesh.vertex_count()).map(|v| Some(u32::from(v >= 40))).collect();
        let areas = JointAreas::from_parts(vec![area(0), area(1)], vec![2.0, 1.0], home);
        let masks = PatchMasks::new(&mesh, &adjacency, &areas);
        for v in 0..mesh.vertex_count() {
            assert!((masks.mask(v, 0) + masks.mask(v, 1) - 1.0).abs() < 1e-12);
        }
        assert_eq!((masks.mask(0, 0), masks.mask(81, 1)), (1.0, 1.0), "far from the border");
        assert!(masks.mask(38, 1) > 0.3 && masks.mask(38, 0) > 0.3, "at the border");
        assert!((2..38).step_by(2).all(|v| masks.mask(v + 2, 0) <= masks.mask(v, 0)));
    }
}
