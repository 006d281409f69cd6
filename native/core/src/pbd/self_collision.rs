//! Self-collision constraint (eq. 12-15): a vertex stays on its side of the surface.

use glam::{Vec3, Vec3A};

/// Signed distance of a vertex from a triangle's plane, measured from its barycentre (eq. 12):
/// positive on the side of the normal. 0 for a triangle without area.
#[must_use]
pub fn signed_distance(vertex: Vec3, [a, b, c]: [Vec3; 3]) -> f32 {
    let barycentre = (a + b + c) / 3.0;
    (vertex - barycentre).dot((b - a).cross(c - a).normalize_or_zero())
}

/// True when a vertex has left the side of the triangle where it was (eq. 13): the signed distance
/// has changed from not negative to negative. The reference is the rest pose, never another frame.
#[must_use]
pub fn has_crossed(rest: f32, posed: f32) -> bool {
    rest >= 0.0 && posed < 0.0
}

/// The plane onto which contact vertices are projected (figure 9).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProjectionPlane {
    /// A point of the plane: the joint.
    pub point: Vec3,
    /// Its unit normal.
    pub normal: Vec3,
}

impl ProjectionPlane {
    /// The vertex projected on the plane (eq. 14).
    #[must_use]
    pub fn project(&self, vertex: Vec3) -> Vec3 {
        vertex - self.normal * self.normal.dot(vertex - self.point)
    }
}

/// Mean value coordinates (Floater 2003) of a vertex in its one-ring, given in order around it, in
/// the plane perpendicular to `normal`; they sum to 1. `None` where the ring touches the vertex.
pub fn mean_value_coordinates(vertex: Vec3, ring: &[Vec3], normal: Vec3) -> Option<Vec<f32>> {
    let normal = Vec3A::from(normal.try_normalize()?);
    let flat: Option<Vec<(Vec3A, f32)>> = ring
        .iter()
        .map(|&neighbour| {
            let spoke = Vec3A::from(neighbour - vertex);
            let spoke = spoke - normal * spoke.dot(normal);
            let length = spoke.length();
            (length > f32::MIN_POSITIVE).then(|| (spoke / length, length))
        })
        .collect();
    let flat = flat?;
    let count = flat.len();
    // tan(α/2) of the angle between neighbouring spokes, from its sine and cosine.
    let half_tangent = |i: usize| {
        let ((a, _), (b, _)) = (flat[i], flat[(i + 1) % count]);
        let (sine, cosine) = (normal.dot(a.cross(b)), a.dot(b));
        if sine.abs() > f32::EPSILON { (1.0 - cosine) / sine } else { 0.0 }
    };
    let tangents: Vec<f32> = (0..count).map(half_tangent).collect();
    let weights: Vec<f32> =
        (0..count).map(|i| (tangents[(i + count - 1) % count] + tangents[i]) / flat[i].1).collect();
    let sum: f32 = weights.iter().sum();
    (sum.abs() > f32::MIN_POSITIVE).then(|| weights.iter().map(|w| w / sum).collect())
}

/// Tangential relaxation (eq. 15): half way towards the combination of the neighbours.
#[must_use]
pub fn relax(vertex: Vec3, neighbours: impl IntoIterator<Item = (f32, Vec3)>) -> Vec3 {
    let combination: Vec3 = neighbours.into_iter().map(|(phi, q)| q * phi).sum();
    (vertex + combination) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-1.0f32..1.0).prop_map(Vec3::from_array)
    }

    #[test]
    fn the_side_of_a_triangle_is_signed() {
        let triangle = [Vec3::ZERO, Vec3::X, Vec3::Y];
        assert!((signed_distance(Vec3::new(0.2, 0.3, 0.7), triangle) - 0.7).abs() < 1e-6);
        assert!((signed_distance(Vec3::new(9.0, 0.3, -0.7), triangle) + 0.7).abs() < 1e-6);
        assert_eq!(signed_distance(Vec3::Z, [Vec3::X; 3]), 0.0);
        assert!(has_crossed(0.1, -0.1) && !has_crossed(-0.1, -0.2) && !has_crossed(0.1, 0.0));
    }

    proptest! {
        #[test]
        fn projection_lands_on_the_plane_along_its_normal(p in vector(), point in vector(), n in vector()) {
            prop_assume!(n.length() > 0.1);
            let plane = ProjectionPlane { point, normal: n.normalize() };
            let projected = plane.project(p);
            prop_assert!((projected - point).dot(plane.normal).abs() < 1e-5);
            prop_assert!((projected - p).cross(plane.normal).length() < 1e-5);
            prop_assert!(plane.project(projected).distance(projected) < 1e-5);
        }

        #[test]
        fn mean_value_coordinates_reproduce_the_vertex(
            centre in prop::array::uniform2(-0.3f32..0.3),
            radii in prop::collection::vec(0.6f32..1.4, 3..9),
        ) {
            let count = radii.len();
            let ring: Vec<Vec3> = radii
                .iter()
                .enumerate()
                .map(|(i, r)| {
                    let angle = std::f32::consts::TAU * i as f32 / count as f32;
                    Vec3::new(angle.cos() * r, angle.sin() * r, 0.5)
                })
                .collect();
            let vertex = Vec3::new(centre[0] * 0.3, centre[1] * 0.3, 0.5);
            let phi = mean_value_coordinates(vertex, &ring, Vec3::Z).unwrap();
            prop_assert!((phi.iter().sum::<f32>() - 1.0).abs() < 1e-4);
            let combined: Vec3 = ring.iter().zip(&phi).map(|(&q, &f)| q * f).sum();
            prop_assert!(combined.distance(vertex) < 1e-3);
            let relaxed = relax(vertex + Vec3::X, phi.iter().copied().zip(ring.iter().copied()));
            prop_assert!(relaxed.distance(vertex + Vec3::X * 0.5) < 1e-3);
        }
    }

    #[test]
    fn a_ring_that_touches_its_vertex_has_no_coordinates() {
        let ring = [Vec3::X, Vec3::ZERO, Vec3::Y];
        assert_eq!(mean_value_coordinates(Vec3::ZERO, &ring, Vec3::Z), None);
    }
}
