//! The triangle mesh that every algorithm takes: positions and vertex triples, validated once.

use glam::DVec3;

use super::{MeshError, Topology};

/// Triangles over shared vertices. Indices are in range and coordinates finite by construction;
/// nothing else is promised: triangles may be degenerate, edges non-manifold, vertices loose.
#[derive(Debug, Clone, PartialEq)]
pub struct TriangleMesh {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// Takes vertices in the caller's unit and vertex triples, counter-clockwise seen from outside.
    ///
    /// # Errors
    /// [`MeshError`] naming the first vertex that is not finite or the first triangle that refers
    /// to a vertex that does not exist.
    pub fn new(vertices: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        for (element, count) in [("vertices", vertices.len()), ("triangles", triangles.len())] {
            if u32::try_from(count).is_err() {
                return Err(MeshError::TooLarge { element, count });
            }
        }
        if let Some((vertex, p)) = vertices.iter().enumerate().find(|(_, p)| !p.is_finite()) {
            return Err(MeshError::NonFiniteVertex { vertex, x: p.x, y: p.y, z: p.z });
        }
        for (index, triangle) in triangles.iter().enumerate() {
            if let Some(&vertex) = triangle.iter().find(|&&v| v as usize >= vertices.len()) {
                return Err(MeshError::VertexOutOfRange {
                    element: "triangle",
                    index,
                    vertex: i64::from(vertex),
                    vertex_count: vertices.len(),
                });
            }
        }
        Ok(Self { vertices, triangles })
    }

    /// Positions (V).
    #[must_use]
    pub fn vertices(&self) -> &[DVec3] {
        &self.vertices
    }

    /// Vertex triples (F).
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Number of vertices.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.vertices.len()
    }

    /// Corners of a triangle as positions.
    #[must_use]
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| self.vertices[v as usize])
    }

    /// Twice the area times the unit normal of a triangle.
    #[must_use]
    pub fn area_vector(&self, triangle: usize) -> DVec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a)
    }

    /// Area of the whole surface, in square units.
    #[must_use]
    pub fn area(&self) -> f64 {
        (0..self.triangles.len()).map(|t| 0.5 * self.area_vector(t).length()).sum()
    }

    /// Smallest and largest corner of the bounding box; zero for a mesh without vertices.
    #[must_use]
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let Some(&first) = self.vertices.first() else {
            return (DVec3::ZERO, DVec3::ZERO);
        };
        self.vertices.iter().fold((first, first), |(low, high), &p| (low.min(p), high.max(p)))
    }

    /// Area-weighted vertex normals, of length 1 or, where no triangle has area, 0.
    #[must_use]
    pub fn vertex_normals(&self) -> Vec<DVec3> {
        let mut normals = vec![DVec3::ZERO; self.vertices.len()];
        for (t, triangle) in self.triangles.iter().enumerate() {
            let normal = self.area_vector(t);
            for &v in triangle {
                normals[v as usize] += normal;
            }
        }
        normals.iter().map(|n| n.normalize_or_zero()).collect()
    }

    /// Triangles with a repeated vertex or an area that rounding alone explains.
    #[must_use]
    pub fn degenerate_triangles(&self) -> Vec<u32> {
        (0u32..).take(self.triangles.len()).filter(|&t| self.is_degenerate(t as usize)).collect()
    }

    fn is_degenerate(&self, triangle: usize) -> bool {
        let [a, b, c] = self.triangles[triangle];
        if a == b || b == c || c == a {
            return true;
        }
        let [a, b, c] = self.corners(triangle);
        let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
        let magnitude = a.abs().max(b.abs()).max(c.abs()).max_element();
        let rounding = 8.0 * f64::EPSILON * longest.sqrt() * magnitude.max(longest.sqrt());
        self.area_vector(triangle).length() <= rounding
    }

    /// Edges, components and their defects.
    #[must_use]
    pub fn topology(&self) -> Topology {
        Topology::new(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> TriangleMesh {
        let vertices = vec![DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
        TriangleMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3]]).unwrap()
    }

    #[test]
    fn measures_a_square() {
        let mesh = square();
        assert_eq!(mesh.area(), 1.0);
        assert_eq!(mesh.bounds(), (DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0)));
        assert!(mesh.vertex_normals().iter().all(|n| *n == DVec3::Z));
        assert!(mesh.degenerate_triangles().is_empty());
    }

    #[test]
    fn names_the_bad_vertex_and_the_bad_triangle() {
        let mut vertices = square().vertices().to_vec();
        assert!(matches!(
            TriangleMesh::new(vertices.clone(), vec![[0, 1, 2], [0, 2, 4]]),
            Err(MeshError::VertexOutOfRange { index: 1, vertex: 4, vertex_count: 4, .. })
        ));
        vertices[2].y = f64::NAN;
        assert!(matches!(
            TriangleMesh::new(vertices, vec![[0, 1, 2]]),
            Err(MeshError::NonFiniteVertex { vertex: 2, .. })
        ));
    }

    #[test]
    fn finds_degenerate_triangles_far_from_the_origin() {
        let far = DVec3::splat(1000.0);
        let vertices = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0, DVec3::Y].map(|p| p * 0.01 + far);
        let triangles = vec![[0, 1, 2], [0, 1, 3], [0, 0, 1]];
        let mesh = TriangleMesh::new(vertices.to_vec(), triangles).unwrap();
        assert_eq!(mesh.degenerate_triangles(), [0, 2]);
    }

    #[test]
    fn an_empty_mesh_is_a_mesh() {
        let mesh = TriangleMesh::new(vec![], vec![]).unwrap();
        assert_eq!((mesh.area(), mesh.bounds()), (0.0, (DVec3::ZERO, DVec3::ZERO)));
    }
}
