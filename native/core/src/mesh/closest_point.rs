//! Closest surface points and ray hits, over parry3d's bounding volume hierarchy.

use glam::DVec3;
use parry3d_f64::query::Ray;
use parry3d_f64::shape::{CompositeShapeRef, TriMesh};

use super::{MeshError, TriangleMesh};

/// The point of a surface that is nearest to a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPoint {
    /// Triangle that holds it.
    pub triangle: u32,
    /// Its barycentric coordinates in that triangle; not negative, sum 1.
    pub barycentric: [f64; 3],
    /// Its position.
    pub position: DVec3,
    /// Distance to the query.
    pub distance: f64,
}

/// Where a ray first meets a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// Triangle that was hit.
    pub triangle: u32,
    /// Where.
    pub position: DVec3,
    /// Distance from the ray's origin.
    pub distance: f64,
}

/// A surface prepared for queries. Degenerate triangles take part as the segments that they are.
pub struct SurfaceQuery {
    surface: TriMesh,
}

impl SurfaceQuery {
    /// Builds the hierarchy.
    ///
    /// # Errors
    /// [`MeshError::NoSurface`] for a mesh without triangles.
    pub fn new(mesh: &TriangleMesh) -> Result<Self, MeshError> {
        let surface = TriMesh::new(mesh.vertices().to_vec(), mesh.triangles().to_vec())
            .map_err(|_| MeshError::NoSurface)?;
        Ok(Self { surface })
    }

    /// Closest point of the surface; `None` only for a query that is not finite.
    #[must_use]
    pub fn closest_point(&self, query: DVec3) -> Option<ClosestPoint> {
        let (triangle, projection, location) =
            CompositeShapeRef(&self.surface).project_local_point_and_get_location(query, f64::MAX, false)?;
        Some(ClosestPoint {
            triangle,
            barycentric: location.barycentric_coordinates().unwrap_or([1.0, 0.0, 0.0]),
            position: projection.point,
            distance: projection.point.distance(query),
        })
    }

    /// First hit of a ray, from either side of the surface. The direction need not be normalised;
    /// a zero direction hits nothing.
    #[must_use]
    pub fn cast_ray(&self, origin: DVec3, direction: DVec3) -> Option<RayHit> {
        let direction = direction.try_normalize()?;
        let ray = Ray::new(origin, direction);
        let (triangle, distance) = CompositeShapeRef(&self.surface).cast_local_ray(&ray, f64::MAX, false)?;
        Some(RayHit { triangle, position: origin + direction * distance, distance })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn octahedron() -> TriangleMesh {
        let vertices = [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|v| [v, -v]).collect();
        let triangles =
            [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
        TriangleMesh::new(vertices, triangles.to_vec()).unwrap()
    }

    proptest! {
        #[test]
        fn closest_point_is_on_the_surface_and_nearest(q in prop::array::uniform3(-2.0f64..2.0)) {
            let query = DVec3::from_array(q);
            let mesh = octahedron();
            let closest = SurfaceQuery::new(&mesh).unwrap().closest_point(query).unwrap();
            let corners = mesh.corners(closest.triangle as usize);
            let point: DVec3 = corners.iter().zip(closest.barycentric).map(|(&c, b)| c * b).sum();
            prop_assert!(point.distance(closest.position) < 1e-12);
            prop_assert!(closest.barycentric.iter().all(|&b| b >= 0.0));
            // The octahedron is |x| + |y| + |z| = 1: outside, the distance has a closed lower bound.
            let gap = (query.abs().element_sum() - 1.0).abs() / 3f64.sqrt();
            prop_assert!(closest.distance >= gap - 1e-12);
            for corner in mesh.vertices() {
                prop_assert!(closest.distance <= corner.distance(query) + 1e-12);
            }
        }
    }

    #[test]
    fn rays_hit_from_both_sides_and_miss() {
        let query = SurfaceQuery::new(&octahedron()).unwrap();
        let direction = DVec3::splat(2.0);
        let inside = query.cast_ray(DVec3::ZERO, direction).unwrap();
        assert!((inside.distance - 1.0 / 3f64.sqrt()).abs() < 1e-12);
        let outside = query.cast_ray(DVec3::splat(1.0), -direction).unwrap();
        assert!((outside.distance - 2.0 / 3f64.sqrt()).abs() < 1e-12);
        assert_eq!(inside.triangle, outside.triangle);
        assert_eq!(query.cast_ray(DVec3::splat(1.0), direction), None);
        assert_eq!(query.cast_ray(DVec3::ZERO, DVec3::ZERO), None);
    }

    #[test]
    fn a_mesh_without_triangles_is_refused() {
        let points = TriangleMesh::new(vec![DVec3::ZERO], vec![]).unwrap();
        assert_eq!(SurfaceQuery::new(&points).err(), Some(MeshError::NoSurface));
    }
}
