//! The particles of an island: vertices of the cage, and where each of them lies in memory.

use std::collections::{BTreeSet, HashMap};

use glam::{DVec3, Vec3};

use super::domains::Layout;

/// Particles of an island, laid out in domains.
pub(super) struct Particles {
    /// The cage's vertex at each place; `None` for a particle without mass.
    pub at: Vec<Option<u32>>,
    /// Edges with a free end, by the cage's vertices.
    pub edges: Vec<[u32; 2]>,
    pub layout: Layout,
}

impl Particles {
    /// Those of some of the cage's tetrahedra; `freedom` and `position` are those of its vertices.
    pub(super) fn new(tetrahedra: &[[u32; 4]], freedom: &[f64], position: impl Fn(u32) -> DVec3) -> Self {
        let particles = Vec::from_iter(tetrahedra.iter().flatten().copied().collect::<BTreeSet<u32>>());
        let edges: BTreeSet<[u32; 2]> = tetrahedra
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, b], [a, c], [a, d], [b, c], [b, d], [c, d]])
            .filter(|edge| edge.iter().any(|&p| freedom[p as usize] > 0.0))
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        let edges = Vec::from_iter(edges);
        let index: HashMap<u32, u32> = particles.iter().copied().zip(0..).collect();
        let positions: Vec<Vec3> = particles.iter().map(|&p| position(p).as_vec3()).collect();
        let counted: Vec<[u32; 2]> = edges.iter().map(|e| e.map(|p| index[&p])).collect();
        let cells: Vec<[u32; 4]> = tetrahedra.iter().map(|t| t.map(|p| index[&p])).collect();
        let layout = Layout::new(&positions, &counted, &cells);
        let at = layout.order.iter().map(|place| place.map(|index| particles[index as usize])).collect();
        Self { at, edges, layout }
    }
}
