//! Sphere packing and its graph (Baran & Popović 2007, section 3.1): spheres around medial samples,
//! the largest first, none with its centre inside another, joined where they intersect. The
//! reduced skeleton is embedded into this graph.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::distance_field::DistanceField;

/// The most spheres.
const MOST: usize = 1500;
/// The largest spheres, to which branchings may go.
pub(super) const LARGEST: usize = 80;
/// No sphere is smaller than this many voxels.
const SMALLEST: f64 = 1.2;

/// Spheres inside the body and which of them intersect.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SphereGraph {
    /// Voxel at the centre of each sphere (S).
    pub(super) voxels: Vec<u32>,
    pub(super) centres: Vec<DVec3>,
    pub(super) radii: Vec<f64>,
    /// Ways over intersecting spheres from each of the largest (at most [`LARGEST`]) to all; infinite
    /// where there is none.
    pub(super) ways: Vec<Vec<f64>>,
}

impl SphereGraph {
    /// Packs spheres around medial samples, the deepest first, and joins them.
    pub(super) fn new(field: &DistanceField, medial: &[u32]) -> Self {
        let mut graph = Self { voxels: Vec::new(), centres: Vec::new(), radii: Vec::new(), ways: Vec::new() };
        for &id in medial {
            let centre = field.position(id);
            let mut spheres = graph.centres.iter().zip(&graph.radii);
            if spheres.all(|(other, radius)| other.distance(centre) > *radius) {
                graph.voxels.push(id);
                graph.centres.push(centre);
                graph.radii.push(field.depth[id as usize].max(SMALLEST * field.cell));
                if graph.voxels.len() == MOST {
                    break;
                }
            }
        }
        let links: Vec<Vec<(usize, f64)>> =
            (0..graph.centres.len()).map(|s| graph.intersecting(s, field)).collect();
        graph.ways = (0..graph.centres.len().min(LARGEST)).map(|s| ways_from(s, &links)).collect();
        graph
    }

    /// Spheres that intersect one, with the distances of their centres.
    fn intersecting(&self, sphere: usize, field: &DistanceField) -> Vec<(usize, f64)> {
        let centre = self.centres[sphere];
        (0..self.centres.len())
            .filter(|&other| other != sphere)
            .map(|other| (other, centre.distance(self.centres[other])))
            .filter(|&(other, distance)| distance < self.radii[sphere] + self.radii[other])
            .filter(|&(other, _)| field.depth_at(centre.midpoint(self.centres[other])) > 0.0)
            .collect()
    }
}

/// Lengths of the shortest ways over links from one sphere to all (Dijkstra).
fn ways_from(start: usize, links: &[Vec<(usize, f64)>]) -> Vec<f64> {
    let mut ways = vec![f64::INFINITY; links.len()];
    ways[start] = 0.0;
    // Lengths are not negative, so their bits are in the order of their values.
    let mut heap = BinaryHeap::from([Reverse((0, start))]);
    while let Some(Reverse((bits, sphere))) = heap.pop() {
        if f64::from_bits(bits) > ways[sphere] {
            continue;
        }
        for &(next, length) in &links[sphere] {
            let way = ways[sphere] + length;
            if way < ways[next] {
                ways[next] = way;
                heap.push(Reverse((way.to_bits(), next)));
            }
        }
    }
    ways
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::fit::medial_surface::medial_surface;
    use crate::rig::fit::test_bodies::{field, figure};

    #[test]
    fn spheres_reach_into_every_limb_and_hang_together() {
        let field = field(&figure(0.3));
        let graph = SphereGraph::new(&field, &medial_surface(&field));
        for i in 0..graph.centres.len() {
            for k in 0..i {
                assert!(graph.centres[i].distance(graph.centres[k]) > graph.radii[k], "packed");
            }
        }
        let hand = DVec3::new(0.14 + 0.6 * 0.3f64.cos(), 0.0, 1.36 - 0.6 * 0.3f64.sin());
        let in_hand = (0..graph.centres.len()).find(|&s| graph.centres[s].distance(hand) < 0.08).unwrap();
        let trunk = graph.centres[0];
        let (way, straight) = (graph.ways[0][in_hand], trunk.distance(hand));
        assert!((straight - 0.1..1.4 * straight).contains(&way), "{way} {straight}");
    }
}
