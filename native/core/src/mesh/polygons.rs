//! Triangles from polygons.
//!
//! A quad is cut along the diagonal that folds it least; larger polygons are projected on their
//! plane and cut by ear clipping. A polygon without a plane becomes a fan, so that every polygon
//! with n corners gives n − 2 triangles whatever its shape.

use earcut::Earcut;
use earcut::utils3d::project3d_to_2d;
use glam::DVec3;

use super::{MeshError, TriangleMesh};

/// Cuts polygons, given as corner counts and flat vertex indices, into the triangles of a mesh.
///
/// # Errors
/// [`MeshError`] naming the polygon that has fewer than three corners or refers to a vertex that
/// does not exist.
pub fn triangulate_polygons(
    vertices: Vec<DVec3>,
    corner_counts: &[i64],
    corners: &[i64],
) -> Result<TriangleMesh, MeshError> {
    let mut triangles = Vec::with_capacity(corners.len());
    let mut cutter = PolygonCutter::default();
    let mut rest = corners;
    for (polygon, &count) in corner_counts.iter().enumerate() {
        if count < 3 {
            return Err(MeshError::TooFewCorners { polygon, corners: count });
        }
        let Some((loop_indices, after)) = rest.split_at_checked(count as usize) else {
            return Err(corner_count_error(corner_counts, corners));
        };
        rest = after;
        let mut indices = Vec::with_capacity(loop_indices.len());
        for &vertex in loop_indices {
            match u32::try_from(vertex) {
                Ok(v) if (v as usize) < vertices.len() => indices.push(v),
                _ => {
                    return Err(MeshError::VertexOutOfRange {
                        element: "polygon",
                        index: polygon,
                        vertex,
                        vertex_count: vertices.len(),
                    });
                }
            }
        }
        cutter.cut(&vertices, &indices, &mut triangles);
    }
    if !rest.is_empty() {
        return Err(corner_count_error(corner_counts, corners));
    }
    TriangleMesh::new(vertices, triangles)
}

fn corner_count_error(corner_counts: &[i64], corners: &[i64]) -> MeshError {
    let expected = corner_counts.iter().map(|&c| usize::try_from(c).unwrap_or(0)).sum();
    MeshError::CornerCount { expected, given: corners.len() }
}

/// Buffers kept from polygon to polygon.
#[derive(Default)]
struct PolygonCutter {
    earcut: Earcut<f64>,
    flat: Vec<[f64; 2]>,
    ears: Vec<u32>,
}

impl PolygonCutter {
    fn cut(&mut self, vertices: &[DVec3], polygon: &[u32], triangles: &mut Vec<[u32; 3]>) {
        match *polygon {
            [a, b, c] => triangles.push([a, b, c]),
            [a, b, c, d] => {
                let corners = [a, b, c, d].map(|v| vertices[v as usize]);
                if cut_from_first_corner(corners) {
                    triangles.extend([[a, b, c], [a, c, d]]);
                } else {
                    triangles.extend([[b, c, d], [b, d, a]]);
                }
            }
            _ => self.cut_ears(vertices, polygon, triangles),
        }
    }

    fn cut_ears(&mut self, vertices: &[DVec3], polygon: &[u32], triangles: &mut Vec<[u32; 3]>) {
        let points: Vec<[f64; 3]> = polygon.iter().map(|&v| vertices[v as usize].to_array()).collect();
        self.ears.clear();
        if project3d_to_2d(&points, points.len(), &mut self.flat) {
            self.earcut.earcut(self.flat.iter().copied(), &[], &mut self.ears);
        }
        if self.ears.len() == 3 * (polygon.len() - 2) {
            triangles.extend(self.ears.as_chunks::<3>().0.iter().map(|ear| ear.map(|i| polygon[i as usize])));
        } else {
            triangles.extend(polygon[1..].windows(2).map(|side| [polygon[0], side[0], side[1]]));
        }
    }
}

/// Whether the diagonal a–c folds the quad less than b–d; the shorter one where both lie flat.
fn cut_from_first_corner([a, b, c, d]: [DVec3; 4]) -> bool {
    let fold = |p: DVec3, q: DVec3| p.normalize_or_zero().dot(q.normalize_or_zero());
    let along_ac = fold((b - a).cross(c - a), (c - a).cross(d - a));
    let along_bd = fold((c - b).cross(d - b), (d - b).cross(a - b));
    if (along_ac - along_bd).abs() > 1e-9 {
        along_ac > along_bd
    } else {
        a.distance_squared(c) <= b.distance_squared(d)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polygon(points: &[[f64; 2]]) -> TriangleMesh {
        let vertices = points.iter().map(|p| DVec3::new(p[0], 1.0, p[1])).collect();
        let corners: Vec<i64> = (0..points.len() as i64).collect();
        triangulate_polygons(vertices, &[points.len() as i64], &corners).unwrap()
    }

    #[test]
    fn concave_polygons_keep_their_area() {
        let arrow = polygon(&[[0.0, 0.0], [2.0, -1.0], [0.5, 0.0], [2.0, 1.0]]);
        assert!((arrow.area() - 0.5).abs() < 1e-12);
        let comb =
            polygon(&[[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [3.0, 1.0], [2.0, 3.0], [1.0, 1.0], [0.0, 3.0]]);
        assert_eq!(comb.triangles().len(), 5);
        assert!((comb.area() - 8.0).abs() < 1e-12);
    }

    #[test]
    fn a_polygon_without_a_plane_becomes_a_fan() {
        let line = polygon(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [4.0, 0.0]]);
        assert_eq!(line.triangles().len(), 3);
    }

    #[test]
    fn names_the_polygon_at_fault() {
        let square = vec![DVec3::ZERO, DVec3::X, DVec3::ONE, DVec3::Y];
        assert!(matches!(
            triangulate_polygons(square.clone(), &[3, 2], &[0, 1, 2, 0, 1]),
            Err(MeshError::TooFewCorners { polygon: 1, corners: 2 })
        ));
        assert!(matches!(
            triangulate_polygons(square.clone(), &[3, 3], &[0, 1, 2, 0, 1, -1]),
            Err(MeshError::VertexOutOfRange { index: 1, vertex: -1, .. })
        ));
        for corners in [&[0, 1, 2, 0, 2][..], &[0, 1, 2, 0, 2, 3, 1]] {
            let error = triangulate_polygons(square.clone(), &[3, 3], corners).unwrap_err();
            assert!(matches!(error, MeshError::CornerCount { expected: 6, .. }));
        }
    }
}
