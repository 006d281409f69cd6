//! The tufted cover: every triangle twice, front and back, glued so that every edge has exactly
//! two sides and no boundary, whatever the mesh is like.
//!
//! After N. Sharp and K. Crane, "A Laplacian for nonmanifold triangle meshes", 2020, sections 3.2
//! (mollification) and 3.3 (cover).

use std::borrow::Cow;

use glam::DVec3;
use rayon::prelude::*;

use super::intrinsic::{IntrinsicTriangulation, Side};
use crate::mesh::TriangleMesh;

/// Slack that every corner gets in the triangle inequality, as a share of the mean edge length.
const MOLLIFICATION: f64 = 1e-5;

/// Builds the cover of the triangles that have three different vertices.
pub(super) fn tufted_cover(mesh: &TriangleMesh) -> IntrinsicTriangulation {
    let triangles: Vec<[u32; 3]> =
        mesh.triangles().iter().filter(|[a, b, c]| a != b && b != c && c != a).copied().collect();
    let sides = sorted_sides(&triangles);
    let lengths = mollified_lengths(mesh, &triangles, &sides);
    let mut corners = Vec::with_capacity(6 * triangles.len());
    let mut cover_lengths = Vec::with_capacity(6 * triangles.len());
    for ([a, b, c], [ab, bc, ca]) in triangles.iter().zip(&lengths) {
        corners.extend([a, b, c, a, c, b]);
        cover_lengths.extend([ab, bc, ca, ca, bc, ab]);
    }
    IntrinsicTriangulation::new(corners, cover_lengths, glue(mesh, &triangles, &sides))
}

/// Side lengths, all raised by the least amount that gives every corner its slack.
fn mollified_lengths(mesh: &TriangleMesh, triangles: &[[u32; 3]], sides: &[EdgeSide]) -> Vec<[f64; 3]> {
    let position = |v: u32| mesh.vertices()[v as usize];
    let mut lengths: Vec<[f64; 3]> = triangles
        .iter()
        .map(|&[a, b, c]| [(a, b), (b, c), (c, a)].map(|(p, q)| position(p).distance(position(q))))
        .collect();
    let (sum, count) = sides.chunk_by(|a, b| a.edge == b.edge).fold((0.0, 0usize), |(sum, count), run| {
        (sum + lengths[run[0].triangle as usize][run[0].side as usize], count + 1)
    });
    let slack = MOLLIFICATION * sum / (count.max(1) as f64);
    let raise = lengths
        .iter()
        .flat_map(|&[a, b, c]| [a + b - c, b + c - a, c + a - b])
        .fold(0.0f64, |raise, gap| raise.max(slack - gap));
    for length in lengths.iter_mut().flatten() {
        *length += raise;
    }
    lengths
}

/// A side of a triangle with the edge that it lies on.
#[derive(Clone, Copy)]
struct EdgeSide {
    edge: [u32; 2],
    triangle: u32,
    side: u8,
}

fn sorted_sides(triangles: &[[u32; 3]]) -> Vec<EdgeSide> {
    let mut sides = Vec::with_capacity(3 * triangles.len());
    for (t, &[a, b, c]) in triangles.iter().enumerate() {
        for (s, (p, q)) in [(a, b), (b, c), (c, a)].into_iter().enumerate() {
            sides.push(EdgeSide { edge: [p.min(q), p.max(q)], triangle: t as u32, side: s as u8 });
        }
    }
    // No two keys are equal.
    sides.par_sort_unstable_by_key(|s| (s.edge, s.triangle, s.side));
    sides
}

/// Glues, around every edge, the sheet of a triangle that faces forward to the sheet of the next
/// triangle that faces backward. A boundary edge thus joins the two sheets of its triangle.
fn glue(mesh: &TriangleMesh, triangles: &[[u32; 3]], sides: &[EdgeSide]) -> Vec<Side> {
    let mut glued = vec![Side::new(0, 0); 6 * triangles.len()];
    for fan in sides.chunk_by(|a, b| a.edge == b.edge) {
        let fan = by_angle(mesh, triangles, fan);
        for (i, &current) in fan.iter().enumerate() {
            let forward = sheet(triangles, current, true);
            let backward = sheet(triangles, fan[(i + 1) % fan.len()], false);
            glued[3 * forward.triangle as usize + forward.side as usize] = backward;
            glued[3 * backward.triangle as usize + backward.side as usize] = forward;
        }
    }
    glued
}

/// The side, in the cover, of the sheet that faces forward (with growing angle) or backward.
fn sheet(triangles: &[[u32; 3]], side: EdgeSide, forward: bool) -> Side {
    let along_edge = triangles[side.triangle as usize][side.side as usize] == side.edge[0];
    if along_edge == forward {
        Side::new(2 * side.triangle as usize, side.side as usize)
    } else {
        // The back sheet is (a, c, b): its sides are ac, cb, ba.
        Side::new(2 * side.triangle as usize + 1, [2, 1, 0][side.side as usize])
    }
}

/// The triangles at an edge in the order of their angle around it.
fn by_angle<'a>(mesh: &TriangleMesh, triangles: &[[u32; 3]], fan: &'a [EdgeSide]) -> Cow<'a, [EdgeSide]> {
    if fan.len() < 3 {
        return Cow::Borrowed(fan);
    }
    let position = |v: u32| mesh.vertices()[v as usize];
    let start = position(fan[0].edge[0]);
    let axis = (position(fan[0].edge[1]) - start).normalize_or_zero();
    let radial = |side: &EdgeSide| {
        let apex = triangles[side.triangle as usize][(side.side as usize + 2) % 3];
        let offset = position(apex) - start;
        offset - axis * offset.dot(axis)
    };
    let x = radial(&fan[0]).normalize_or_zero();
    let y: DVec3 = axis.cross(x);
    let mut ordered: Vec<(f64, EdgeSide)> = fan
        .iter()
        .map(|side| {
            let r = radial(side);
            (r.dot(y).atan2(r.dot(x)), *side)
        })
        .collect();
    ordered.sort_by(|a, b| a.0.total_cmp(&b.0));
    ordered.into_iter().map(|(_, side)| side).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mesh(points: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> TriangleMesh {
        TriangleMesh::new(points.into_iter().map(DVec3::from_array).collect(), triangles).unwrap()
    }

    proptest! {
        /// Any triangle soup has a closed cover, before and after flipping, of the same area.
        #[test]
        fn cover_is_closed_and_flips_keep_area(
            points in prop::collection::vec(prop::array::uniform3(-1.0f64..1.0), 9),
            triangles in prop::collection::vec(prop::array::uniform3(0u32..9), 1..25),
        ) {
            let mut cover = tufted_cover(&mesh(points, triangles));
            cover.check();
            let area = |c: &IntrinsicTriangulation| (0..c.triangle_count()).map(|t| c.area(t)).sum::<f64>();
            let before = area(&cover);
            cover.flip_to_delaunay();
            cover.check();
            prop_assert!((area(&cover) - before).abs() <= 1e-6 * (1.0 + before));
        }
    }

    #[test]
    fn an_obtuse_quad_is_flipped_to_its_short_diagonal() {
        let flat = mesh(
            vec![[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, -0.5, 0.0]],
            vec![[0, 1, 2], [1, 0, 3]],
        );
        let mut cover = tufted_cover(&flat);
        cover.flip_to_delaunay();
        cover.check();
        for t in 0..cover.triangle_count() {
            for s in 0..3 {
                assert!(cover.cotangent(Side::new(t, s)) > -1e-9 || cover.area(t) > 0.0);
            }
        }
        let longest = (0..4).flat_map(|t| (0..3).map(move |s| Side::new(t, s)));
        let ends: Vec<_> = longest
            .map(|s| (cover.corner(s), cover.corner(Side::new(s.triangle as usize, s.side as usize + 1))))
            .collect();
        assert!(!ends.contains(&(0, 1)) && ends.contains(&(2, 3)));
    }
}
