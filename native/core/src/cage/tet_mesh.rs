//! Tetrahedra over shared vertices.

use glam::DVec3;

/// A tetrahedral mesh; every tetrahedron is positively oriented in rest.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TetMesh {
    vertices: Vec<DVec3>,
    tetrahedra: Vec<[u32; 4]>,
}

impl TetMesh {
    /// Takes vertices and corner indices that are in range.
    pub(crate) fn new(vertices: Vec<DVec3>, tetrahedra: Vec<[u32; 4]>) -> Self {
        debug_assert!(tetrahedra.iter().flatten().all(|&v| (v as usize) < vertices.len()));
        Self { vertices, tetrahedra }
    }

    /// Positions (P).
    #[must_use]
    pub fn vertices(&self) -> &[DVec3] {
        &self.vertices
    }

    /// Corner indices (T,4).
    #[must_use]
    pub fn tetrahedra(&self) -> &[[u32; 4]] {
        &self.tetrahedra
    }

    /// Corners of a tetrahedron as positions.
    #[must_use]
    pub fn corners(&self, tetrahedron: usize) -> [DVec3; 4] {
        self.tetrahedra[tetrahedron].map(|v| self.vertices[v as usize])
    }

    /// Signed volume of a tetrahedron, in cubic units.
    #[must_use]
    pub fn volume(&self, tetrahedron: usize) -> f64 {
        let [a, b, c, d] = self.corners(tetrahedron);
        (b - a).cross(c - a).dot(d - a) / 6.0
    }

    /// Edges as vertex pairs, smaller index first, ascending, each once.
    #[must_use]
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let mut edges: Vec<[u32; 2]> = self
            .tetrahedra
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, b], [a, c], [a, d], [b, c], [b, d], [c, d]])
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// Appends another mesh, which keeps its own vertices.
    pub(crate) fn append(&mut self, other: &Self) {
        let offset = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        self.tetrahedra.extend(other.tetrahedra.iter().map(|t| t.map(|v| v + offset)));
    }
}
