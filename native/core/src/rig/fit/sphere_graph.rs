//! Sphere packing and its graph (Baran & Popović 2007, section 3.1): spheres around medial samples,
//! the largest first, none with its centre inside another, joined where they intersect. The
//! reduced skeleton is embedded into this graph.

use glam::DVec3;

use super::distance_field::DistanceField;

/// The most spheres.
const MOST: usize = 1500;
/// No sphere is smaller than this many voxels.
const SMALLEST: f64 = 1.2;

/// Spheres inside the body and which of them intersect.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SphereGraph {
    /// Voxel at the centre of each sphere (S).
    pub(super) voxels: Vec<u32>,
    pub(super) centres: Vec<DVec3>,
    pub(super) radii: Vec<f64>,
    /// Neighbours of each sphere and their distances.
    pub(super) links: Vec<Vec<(usize, f64)>>,
}

impl SphereGraph {
    /// Packs spheres around medial samples, the deepest first, and joins them.
    pub(super) fn new(field: &DistanceField, medial: &[u32]) -> Self {
        let mut graph =
            Self { voxels: Vec::new(), centres: Vec::new(), radii: Vec::new(), links: Vec::new() };
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
        graph.links = (0..graph.centres.len()).map(|s| graph.intersecting(s, field)).collect();
        graph
    }

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
