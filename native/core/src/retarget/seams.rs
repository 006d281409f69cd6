//! Equal weights for vertices that coincide on open edges, within one object and across several:
//! a body in pieces, or a sleeve that ends where the glove begins, stays closed in every pose.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::mesh::TriangleMesh;
use crate::skinning::{Row, blend, normalized};

/// One object: its surface in world space and the weights of its vertices.
#[derive(Debug)]
pub struct SeamObject<'a> {
    /// The surface; vertices in world space.
    pub mesh: &'a TriangleMesh,
    /// One row for each vertex (V); changed where vertices coincide.
    pub rows: &'a mut [Row],
}

/// Gives vertices on open edges that lie closer together than `tolerance` (in world units, 0 for
/// equal positions) the mean of their rows. Returns how many vertices changed in each object.
///
/// Vertices inside of a surface never take part, so lips that touch stay apart. The mean does not
/// depend on the order of the objects or of their vertices, up to rounding, and all vertices of a
/// group get the same bits.
pub fn join_seams(objects: &mut [SeamObject<'_>], tolerance: f64) -> Vec<usize> {
    let mut places: Vec<(DVec3, usize, u32)> = Vec::new();
    for (index, object) in objects.iter().enumerate() {
        let mut open: Vec<u32> = object.mesh.topology().boundary_edges().into_iter().flatten().collect();
        open.sort_unstable();
        open.dedup();
        places.extend(open.into_iter().map(|v| (object.mesh.vertices()[v as usize], index, v)));
    }
    let mut changed = vec![0; objects.len()];
    for group in groups(&places, tolerance) {
        if group.len() < 2 {
            continue;
        }
        let rows: Vec<Row> = group
            .iter()
            .map(|&at| normalized(objects[places[at].1].rows[places[at].2 as usize].clone()))
            .collect();
        if rows.windows(2).all(|pair| pair[0] == pair[1]) {
            continue;
        }
        let mean = normalized(blend(rows.iter().map(|row| (row, 1.0))));
        for &at in &group {
            let (_, object, vertex) = places[at];
            objects[object].rows[vertex as usize].clone_from(&mean);
            changed[object] += 1;
        }
    }
    changed
}

/// Groups of places that are linked by distances up to the tolerance.
fn groups(places: &[(DVec3, usize, u32)], tolerance: f64) -> Vec<Vec<usize>> {
    let mut parent: Vec<usize> = (0..places.len()).collect();
    fn root(parent: &mut [usize], mut at: usize) -> usize {
        while parent[at] != at {
            parent[at] = parent[parent[at]];
            at = parent[at];
        }
        at
    }
    // Along one axis, only places within the tolerance need a closer look. The axis is askew,
    // because open edges like to lie in the coordinate planes.
    let axis = DVec3::new(0.48, 0.64, 0.6);
    let along: Vec<f64> = places.iter().map(|place| place.0.dot(axis)).collect();
    let slack = tolerance + 1e-12 * along.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by(|&a, &b| along[a].total_cmp(&along[b]).then(a.cmp(&b)));
    for (at, &a) in order.iter().enumerate() {
        for &b in order[at + 1..].iter().take_while(|b| along[**b] - along[a] <= slack) {
            if places[a].0.distance(places[b].0) <= tolerance {
                let (p, q) = (root(&mut parent, a), root(&mut parent, b));
                parent[p.max(q)] = p.min(q);
            }
        }
    }
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for at in 0..places.len() {
        groups.entry(root(&mut parent, at)).or_default().push(at);
    }
    groups.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::test_surfaces::{grid, mapped};

    fn rows(mesh: &TriangleMesh, bone: u32) -> Vec<Row> {
        mesh.vertices().iter().map(|p| vec![(bone, 1.0 + p.y), (9, 1.0)]).map(normalized).collect()
    }

    /// Three sheets around the edge x = 1, y = 0..1, z = 0.
    fn sheets() -> [TriangleMesh; 3] {
        let left = grid(4);
        let right = mapped(&left, |p| p + DVec3::X);
        let up = mapped(&left, |p| DVec3::new(1.0, p.y, p.x));
        [left, right, up]
    }

    fn joined_rows(order: [usize; 3]) -> [Vec<Row>; 3] {
        let sheets = sheets();
        let mut rows = [0, 1, 2].map(|at: usize| rows(&sheets[at], at as u32));
        let mut taken = rows.each_mut().map(|rows| Some(&mut rows[..]));
        let mut objects: Vec<SeamObject<'_>> = order
            .iter()
            .map(|&at| SeamObject { mesh: &sheets[at], rows: taken[at].take().unwrap() })
            .collect();
        assert_eq!(join_seams(&mut objects, 1e-9), [5; 3]);
        rows
    }

    #[test]
    fn coincident_vertices_get_equal_rows_in_any_order_of_objects() {
        let (first, again) = (joined_rows([0, 1, 2]), joined_rows([2, 0, 1]));
        let sheets = sheets();
        let at_seam = |at: usize| -> Vec<(f64, Row)> {
            let vertices = sheets[at].vertices().iter().zip(&first[at]);
            let seam = vertices.filter(|(p, _)| p.x == 1.0 && p.z == 0.0);
            seam.map(|(p, row)| (p.y, row.clone())).collect()
        };
        assert_eq!(at_seam(0).len(), 5);
        assert!(at_seam(0) == at_seam(1) && at_seam(0) == at_seam(2));
        for (y, row) in at_seam(0) {
            assert!((row.iter().map(|entry| entry.1).sum::<f64>() - 1.0).abs() < 1e-12);
            assert!((row[1].1 - (1.0 + y) / (2.0 + y) / 3.0).abs() < 1e-12);
        }
        for (a, b) in first.iter().flatten().zip(again.iter().flatten()) {
            assert!(a.iter().zip(b).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() < 1e-12));
        }
    }

    #[test]
    fn only_open_edges_within_the_tolerance_are_joined() {
        let [left, right, _] = sheets();
        let far = mapped(&right, |p| p + DVec3::X * 1e-3);
        let mut all = [rows(&left, 0), rows(&far, 1)];
        let before = all.clone();
        let join = |all: &mut [Vec<Row>; 2], tolerance| {
            let [a, b] = all;
            let mut objects = [SeamObject { mesh: &left, rows: a }, SeamObject { mesh: &far, rows: b }];
            join_seams(&mut objects, tolerance)
        };
        assert_eq!(join(&mut all, 1e-4), [0, 0]);
        assert_eq!(all, before);
        assert_eq!(join(&mut all, 2e-3), [5, 5]);
        // Crossing sheets that coincide at inner vertices only stay apart.
        let crossing = mapped(&left, |p| DVec3::new(0.5, p.y * 0.5 + 0.25, p.x - 0.5));
        let (mut a, mut b) = (rows(&left, 0), rows(&crossing, 1));
        let before = a.clone();
        let mut objects =
            [SeamObject { mesh: &left, rows: &mut a }, SeamObject { mesh: &crossing, rows: &mut b }];
        assert_eq!(join_seams(&mut objects, 1e-9), [0, 0]);
        assert_eq!(a, before);
    }
}
