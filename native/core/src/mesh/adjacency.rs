//! One-ring neighbours of every vertex in compressed rows.

use super::Topology;

/// Neighbours of each vertex along edges, ascending, in compressed rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Adjacency {
    starts: Vec<u32>,
    neighbours: Vec<u32>,
}

impl Adjacency {
    /// Collects the neighbours of `vertex_count` vertices along the edges of a topology.
    #[must_use]
    pub fn new(vertex_count: usize, topology: &Topology) -> Self {
        let mut starts = vec![0u32; vertex_count + 1];
        for &([a, b], _) in topology.edges() {
            starts[a as usize + 1] += 1;
            starts[b as usize + 1] += 1;
        }
        for v in 0..vertex_count {
            starts[v + 1] += starts[v];
        }
        let mut next = starts.clone();
        let mut neighbours = vec![0u32; 2 * topology.edges().len()];
        // Edges ascend in (a, b): each row first receives its smaller neighbours, then its larger
        // ones, both ascending.
        for larger in [true, false] {
            for &([a, b], _) in topology.edges() {
                let (row, neighbour) = if larger { (b, a) } else { (a, b) };
                neighbours[next[row as usize] as usize] = neighbour;
                next[row as usize] += 1;
            }
        }
        Self { starts, neighbours }
    }

    /// Neighbours of a vertex, ascending.
    #[must_use]
    pub fn neighbours(&self, vertex: usize) -> &[u32] {
        &self.neighbours[self.starts[vertex] as usize..self.starts[vertex + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriangleMesh;
    use glam::DVec3;

    #[test]
    fn rows_are_ascending_and_symmetric() {
        let vertices = (0..5).map(|i| DVec3::splat(f64::from(i))).collect();
        let mesh = TriangleMesh::new(vertices, vec![[3, 1, 0], [1, 2, 3]]).unwrap();
        let adjacency = Adjacency::new(5, &mesh.topology());
        assert_eq!(adjacency.neighbours(1), [0, 2, 3]);
        assert_eq!(adjacency.neighbours(3), [0, 1, 2]);
        assert!(adjacency.neighbours(4).is_empty());
    }
}
