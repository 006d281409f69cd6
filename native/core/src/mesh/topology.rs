//! Edges and connected components of a triangle mesh, and where it is open or non-manifold.

use super::TriangleMesh;

/// Edges, each with the number of triangles at it, and the component of each vertex.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topology {
    edges: Vec<([u32; 2], u32)>,
    components: Vec<u32>,
    component_count: usize,
}

impl Topology {
    /// Reads the topology of a mesh. A triangle that repeats a vertex joins nothing.
    #[must_use]
    pub fn new(mesh: &TriangleMesh) -> Self {
        let mut sides: Vec<[u32; 2]> = Vec::with_capacity(3 * mesh.triangles().len());
        for &[a, b, c] in mesh.triangles() {
            if a != b && b != c && c != a {
                sides.extend([(a, b), (b, c), (c, a)].map(|(u, v)| [u.min(v), u.max(v)]));
            }
        }
        sides.sort_unstable();
        let edges = sides.chunk_by(|a, b| a == b).map(|run| (run[0], run.len() as u32)).collect::<Vec<_>>();
        let (components, component_count) = connected_components(mesh.vertex_count(), &edges);
        Self { edges, components, component_count }
    }

    /// Edges as vertex pairs, smaller index first, in ascending order, with their triangle counts.
    #[must_use]
    pub fn edges(&self) -> &[([u32; 2], u32)] {
        &self.edges
    }

    /// Edges at exactly one triangle.
    #[must_use]
    pub fn boundary_edges(&self) -> Vec<[u32; 2]> {
        self.edges_with(|count| count == 1)
    }

    /// Edges at more than two triangles.
    #[must_use]
    pub fn non_manifold_edges(&self) -> Vec<[u32; 2]> {
        self.edges_with(|count| count > 2)
    }

    /// Component of each vertex (V), numbered in the order of their smallest vertices. A loose
    /// vertex is a component of its own.
    #[must_use]
    pub fn components(&self) -> &[u32] {
        &self.components
    }

    /// Number of components.
    #[must_use]
    pub fn component_count(&self) -> usize {
        self.component_count
    }

    fn edges_with(&self, keep: impl Fn(u32) -> bool) -> Vec<[u32; 2]> {
        self.edges.iter().filter(|(_, count)| keep(*count)).map(|(edge, _)| *edge).collect()
    }
}

fn connected_components(vertex_count: usize, edges: &[([u32; 2], u32)]) -> (Vec<u32>, usize) {
    let mut parent: Vec<u32> = (0..vertex_count as u32).collect();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    for &([a, b], _) in edges {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        // The smaller index becomes the root, so that the numbering below follows the vertices.
        parent[a.max(b) as usize] = a.min(b);
    }
    let mut count = 0;
    let mut number = vec![0u32; vertex_count];
    for v in 0..vertex_count {
        let r = root(&mut parent, v as u32) as usize;
        if r == v {
            number[v] = count;
            count += 1;
        } else {
            number[v] = number[r];
        }
    }
    (number, count as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    fn mesh(vertex_count: usize, triangles: Vec<[u32; 3]>) -> TriangleMesh {
        let vertices = (0..vertex_count).map(|i| DVec3::new(i as f64, (i * i) as f64, 0.0)).collect();
        TriangleMesh::new(vertices, triangles).unwrap()
    }

    #[test]
    fn three_triangles_at_one_edge_are_non_manifold() {
        let topology = mesh(5, vec![[0, 1, 2], [1, 0, 3], [0, 1, 4]]).topology();
        assert_eq!(topology.non_manifold_edges(), [[0, 1]]);
        assert_eq!(topology.boundary_edges().len(), 6);
        assert_eq!(topology.component_count(), 1);
    }

    #[test]
    fn loose_vertices_are_components() {
        let topology = mesh(8, vec![[5, 6, 7], [1, 2, 3]]).topology();
        assert_eq!(topology.components(), [0, 1, 1, 1, 2, 3, 3, 3]);
    }

    proptest! {
        #[test]
        fn components_agree_across_every_edge(
            triangles in prop::collection::vec(prop::array::uniform3(0u32..30), 0..40)
        ) {
            let topology = mesh(30, triangles).topology();
            for &([a, b], count) in topology.edges() {
                prop_assert!(a < b && count > 0);
                prop_assert_eq!(topology.components()[a as usize], topology.components()[b as usize]);
            }
            let largest = *topology.components().iter().max().unwrap() as usize;
            prop_assert_eq!(largest + 1, topology.component_count());
        }
    }
}
