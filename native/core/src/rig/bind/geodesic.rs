//! Distances from every bone through the body: Dijkstra on the cage's edges and the edges of its
//! second ring, which bring the length of a path within a few percent of the straight line.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;
use kdtree::KdTree;
use kdtree::distance::squared_euclidean;
use rayon::prelude::*;

use super::sources::Source;
use crate::cage::LatticeCage;
use crate::progress::{Cancelled, Progress};
use crate::rig::distance_to_segment;

/// Cage vertices this near to a segment, in cells, get their straight distance to it.
const NEAR: f64 = 1.2;
/// Spacing of the points, in cells, at which a segment is tested for being outside.
const SPACING: f64 = 1.0;
/// Points of a segment at most.
const MOST_POINTS: f64 = 2048.0;

/// Where a bone touches the cage: cage vertices, ascending, and their straight distances.
pub(super) type Entrance = Vec<(u32, f64)>;

/// Neighbours of each cage vertex in the first two rings, with the lengths of the straight lines.
pub(super) struct Graph {
    starts: Vec<u32>,
    neighbours: Vec<(u32, f64)>,
}

impl Graph {
    pub(super) fn new(cage: &LatticeCage) -> Self {
        let points = cage.mesh.vertices();
        let mut first = vec![Vec::new(); points.len()];
        for [a, b] in cage.mesh.edges() {
            first[a as usize].push(b);
            first[b as usize].push(a);
        }
        let rings: Vec<Vec<(u32, f64)>> = (0..points.len())
            .into_par_iter()
            .map(|v| {
                let mut ring: Vec<u32> = first[v].clone();
                ring.extend(first[v].iter().flat_map(|&n| &first[n as usize]));
                ring.sort_unstable();
                ring.dedup();
                ring.into_iter()
                    .filter(|&n| n as usize != v)
                    .map(|n| (n, points[v].distance(points[n as usize])))
                    .collect()
            })
            .collect();
        let mut starts = vec![0];
        let mut neighbours = Vec::new();
        for ring in rings {
            neighbours.extend(ring);
            starts.push(neighbours.len() as u32);
        }
        Self { starts, neighbours }
    }

    /// Distance of every cage vertex from an entrance; infinite where there is no way.
    fn distances(&self, entrance: &Entrance) -> Vec<f64> {
        let mut distances = vec![f64::INFINITY; self.starts.len() - 1];
        // Distances are not negative, so their bits are in the order of their values.
        let mut heap = BinaryHeap::with_capacity(entrance.len());
        for &(vertex, distance) in entrance {
            if distance < distances[vertex as usize] {
                distances[vertex as usize] = distance;
                heap.push(Reverse((distance.to_bits(), vertex)));
            }
        }
        while let Some(Reverse((bits, vertex))) = heap.pop() {
            let distance = f64::from_bits(bits);
            if distance > distances[vertex as usize] {
                continue;
            }
            let range = self.starts[vertex as usize] as usize..self.starts[vertex as usize + 1] as usize;
            for &(next, length) in &self.neighbours[range] {
                let through = distance + length;
                if through < distances[next as usize] {
                    distances[next as usize] = through;
                    heap.push(Reverse((through.to_bits(), next)));
                }
            }
        }
        distances
    }
}

/// Entrances of the bones (B), empty for those without a segment. Where a segment is outside of the
/// cage it enters at the nearest cage vertices.
pub(super) fn entrances(
    cage: &LatticeCage,
    sources: &[Source],
    bone_count: usize,
    is_inside: &(dyn Fn(DVec3) -> bool + Sync),
) -> Vec<Entrance> {
    let cell = cage.lattice.cell_size();
    let points = cage.mesh.vertices();
    let mut tree = KdTree::new(3);
    for (index, point) in points.iter().enumerate() {
        // Positions are finite, so nothing is refused.
        let _ = tree.add(point.to_array(), index as u32);
    }
    let of_source = |source: &Source| -> Entrance {
        let near = points.iter().zip(0..).filter_map(|(&p, v)| {
            let distance = distance_to_segment(p, source.head, source.tail);
            (distance < NEAR * cell).then_some((v, distance))
        });
        let mut entrance: Entrance = near.collect();
        let length = source.head.distance(source.tail);
        let steps = (length / (SPACING * cell)).ceil().clamp(1.0, MOST_POINTS);
        for step in 0..=steps as u32 {
            let point = source.head.lerp(source.tail, f64::from(step) / steps);
            if !is_inside(point)
                && let Ok(found) = tree.nearest(&point.to_array(), 1, &squared_euclidean)
            {
                entrance.extend(found.first().map(|&(squared, &v)| (v, squared.sqrt())));
            }
        }
        entrance
    };
    let found: Vec<Entrance> = sources.par_iter().map(of_source).collect();
    let mut entrances = vec![Entrance::new(); bone_count];
    for (source, entrance) in sources.iter().zip(found) {
        entrances[source.bone as usize].extend(entrance);
    }
    for entrance in &mut entrances {
        entrance.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        entrance.dedup_by_key(|(vertex, _)| *vertex);
    }
    entrances
}

/// Distances (B) of every cage vertex, empty for a bone without an entrance.
pub(super) fn bone_distances(
    graph: &Graph,
    entrances: &[Entrance],
    progress: &Progress,
) -> Result<Vec<Vec<f64>>, Cancelled> {
    let distances = entrances
        .par_iter()
        .map(|entrance| match entrance.is_empty() || progress.is_cancelled() {
            true => Vec::new(),
            false => graph.distances(entrance),
        })
        .collect();
    progress.report(1.0)?;
    Ok(distances)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cage::{BccLattice, Membership, WindingNumber};
    use crate::mesh::TriangleMesh;

    /// A box from the origin to `size`.
    fn cuboid(size: DVec3) -> TriangleMesh {
        let corner =
            |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2 & 1)) * size;
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        TriangleMesh::new((0..8).map(corner).collect(), triangles.collect()).unwrap()
    }

    fn cage(mesh: &TriangleMesh, cell: f64) -> LatticeCage {
        let everywhere = vec![Membership::Inside; mesh.triangles().len()];
        let lattice = BccLattice::new(DVec3::ZERO, cell);
        LatticeCage::new(mesh, &WindingNumber::new(mesh), lattice, &everywhere, &|_| true).unwrap()
    }

    #[test]
    fn in_a_convex_body_distances_are_nearly_straight() {
        let cage = cage(&cuboid(DVec3::new(4.0, 1.0, 1.0)), 0.2);
        let source = Source { bone: 0, head: DVec3::splat(0.5), tail: DVec3::new(1.0, 0.5, 0.5) };
        let entrance = entrances(&cage, &[source], 1, &|_| true);
        let distances = bone_distances(&Graph::new(&cage), &entrance, &Progress::new()).unwrap();
        for (&point, &through) in cage.mesh.vertices().iter().zip(&distances[0]) {
            let straight = distance_to_segment(point, source.head, source.tail);
            assert!(
                through >= straight - 1e-12 && through <= 1.1 * straight + 0.1 * 0.2,
                "{through} {straight}"
            );
        }
    }

    #[test]
    fn a_bone_outside_enters_at_its_nearest_vertices() {
        let cage = cage(&cuboid(DVec3::ONE), 0.25);
        let source = Source { bone: 1, head: DVec3::new(0.5, 0.5, 3.0), tail: DVec3::new(0.5, 0.5, 4.0) };
        let entrance = entrances(&cage, &[source], 2, &|p| p.z < 1.0);
        assert!(entrance[0].is_empty() && !entrance[1].is_empty());
        let distances = bone_distances(&Graph::new(&cage), &entrance, &Progress::new()).unwrap();
        assert!(distances[0].is_empty());
        let nearest = distances[1].iter().copied().fold(f64::INFINITY, f64::min);
        assert!((1.5..2.1).contains(&nearest), "{nearest}");
    }
}
