//! Vertex normals that point outwards, also where a component is inside out.

use glam::DVec3;

use super::{Topology, TriangleMesh};

impl TriangleMesh {
    /// [`Self::vertex_normals`] of the mesh of this topology, reversed on every component that encloses a
    /// negative volume.
    #[must_use]
    pub fn outward_normals(&self, topology: &Topology) -> Vec<DVec3> {
        let components = topology.components();
        let count = components.iter().max().map_or(0, |&last| last as usize + 1);
        let (mut volumes, mut first) = (vec![0.0; count], vec![None; count]);
        for (t, triangle) in self.triangles().iter().enumerate() {
            let component = components[triangle[0] as usize] as usize;
            let corner = self.vertices()[triangle[0] as usize];
            // Relative to a place on the component, so that open ones count too.
            let origin = *first[component].get_or_insert(corner);
            volumes[component] += (corner - origin).dot(self.area_vector(t));
        }
        let mut normals = self.vertex_normals();
        for (normal, &component) in normals.iter_mut().zip(components) {
            if volumes[component as usize] < 0.0 {
                *normal = -*normal;
            }
        }
        normals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_point_outwards_also_where_a_surface_is_inside_out() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let vertices =
            corners.iter().chain(&corners).enumerate().map(|(i, &p)| p + DVec3::X * (3 * (i / 4)) as f64);
        let flipped = faces.map(|[a, b, c]| [a + 4, c + 4, b + 4]);
        let mesh = TriangleMesh::new(vertices.collect(), faces.into_iter().chain(flipped).collect()).unwrap();
        let normals = mesh.outward_normals(&mesh.topology());
        for (v, normal) in normals.iter().enumerate() {
            let centre = DVec3::splat(0.25) + DVec3::X * (3 * (v / 4)) as f64;
            assert!(normal.dot(mesh.vertices()[v] - centre) > 0.0, "{v}");
        }
    }
}
