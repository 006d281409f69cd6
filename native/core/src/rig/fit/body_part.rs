//! The part of a mesh that is the body: the largest cluster of triangles, without debris far away.

use std::collections::HashMap;

use glam::DVec3;

use crate::mesh::TriangleMesh;

/// Clusters are pieces with gaps of less than about two cells of this share of the size.
const CELL: f64 = 0.03;
/// The size is between these shares of the area, axis by axis.
const QUANTILES: [f64; 2] = [0.02, 0.98];
/// Triangles farther away than this many cells are left out at once.
const FARTHEST: f64 = 400.0;
/// A triangle marks at most this many points along each side.
const MOST_STEPS: f64 = 64.0;

/// Which triangles (F) belong to the body, and their share of the whole area.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct BodyPart {
    pub(super) belongs: Vec<bool>,
    pub(super) share: f64,
}

impl BodyPart {
    /// Finds the cluster with the largest area. Everything belongs where no triangle has any.
    pub(super) fn new(mesh: &TriangleMesh) -> Self {
        let count = mesh.triangles().len();
        let areas: Vec<f64> = (0..count).map(|t| mesh.area_vector(t).length()).collect();
        let total: f64 = areas.iter().sum();
        let everything = Self { belongs: vec![true; count], share: 1.0 };
        let Some((middle, size)) = extent(mesh, &areas, total) else { return everything };
        let cell = CELL * size;
        let mut cells = Cells::default();
        let mut cell_of = vec![None; count];
        for (t, first_cell) in cell_of.iter_mut().enumerate() {
            let corners = mesh.corners(t).map(|p| (p - middle) / cell);
            if corners.iter().any(|p| p.abs().max_element() > FARTHEST) {
                continue;
            }
            let [a, b, c] = corners;
            let longest = (b - a).length().max((c - a).length()).max((c - b).length());
            let steps = (2.0 * longest).ceil().clamp(1.0, MOST_STEPS) as u32;
            for i in 0..=steps {
                for j in 0..=steps - i {
                    let (u, v) = (f64::from(i) / f64::from(steps), f64::from(j) / f64::from(steps));
                    let id = cells.mark(a + (b - a) * u + (c - a) * v);
                    cells.join(*first_cell.get_or_insert(id), id);
                }
            }
        }
        cells.join_neighbours();
        let mut sums: HashMap<usize, f64> = HashMap::new();
        let clusters: Vec<Option<usize>> = cell_of.into_iter().map(|c| c.map(|c| cells.root(c))).collect();
        for (cluster, area) in clusters.iter().zip(&areas) {
            if let Some(cluster) = cluster {
                *sums.entry(*cluster).or_default() += area;
            }
        }
        let largest = sums.iter().max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(a.0)));
        let Some((&largest, &sum)) = largest else { return everything };
        Self { belongs: clusters.iter().map(|&c| c == Some(largest)).collect(), share: sum / total }
    }
}

/// Middle and longest side of the box that holds most of the area.
fn extent(mesh: &TriangleMesh, areas: &[f64], total: f64) -> Option<(DVec3, f64)> {
    if !(total.is_finite() && total > 0.0) {
        return None;
    }
    let mut ends = [DVec3::ZERO; 2];
    for axis in 0..3 {
        let mut along: Vec<(f64, f64)> = (0..areas.len())
            .map(|t| (mesh.corners(t).iter().map(|p| p[axis]).sum::<f64>() / 3.0, areas[t]))
            .collect();
        along.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut sum = 0.0;
        let mut quantiles = QUANTILES.iter().zip(&mut ends).peekable();
        for (place, area) in along {
            sum += area;
            while quantiles.peek().is_some_and(|(share, _)| sum >= **share * total) {
                if let Some((_, end)) = quantiles.next() {
                    end[axis] = place;
                }
            }
        }
    }
    let size = (ends[1] - ends[0]).max_element();
    let size = if size > 0.0 {
        size
    } else {
        let (low, high) = mesh.bounds();
        (high - low).max_element()
    };
    (size > 0.0).then_some(((ends[0] + ends[1]) * 0.5, size))
}

/// The mesh of the marked triangles (F) and the vertices that they use; `None` without any.
pub(super) fn only_triangles(mesh: &TriangleMesh, keep: &[bool]) -> Option<TriangleMesh> {
    let mut number = vec![None; mesh.vertex_count()];
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for (triangle, _) in mesh.triangles().iter().zip(keep).filter(|(_, keep)| **keep) {
        triangles.push(triangle.map(|v| {
            *number[v as usize].get_or_insert_with(|| {
                vertices.push(mesh.vertices()[v as usize]);
                vertices.len() as u32 - 1
            })
        }));
    }
    if triangles.is_empty() {
        return None;
    }
    TriangleMesh::new(vertices, triangles).ok()
}

/// Cells that hold surface, joined to clusters.
#[derive(Default)]
struct Cells {
    ids: HashMap<[i32; 3], usize>,
    places: Vec<[i32; 3]>,
    parents: Vec<usize>,
}

impl Cells {
    fn mark(&mut self, point: DVec3) -> usize {
        let place = point.floor().to_array().map(|x| x as i32);
        *self.ids.entry(place).or_insert_with(|| {
            self.places.push(place);
            self.parents.push(self.parents.len());
            self.parents.len() - 1
        })
    }

    fn root(&mut self, mut cell: usize) -> usize {
        while self.parents[cell] != cell {
            self.parents[cell] = self.parents[self.parents[cell]];
            cell = self.parents[cell];
        }
        cell
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b)] = a.min(b);
    }

    fn join_neighbours(&mut self) {
        for cell in 0..self.places.len() {
            let [x, y, z] = self.places[cell];
            for (dx, dy, dz) in (0..27).map(|i| (i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1)) {
                if let Some(&other) = self.ids.get(&[x + dx, y + dy, z + dz]) {
                    self.join(cell, other);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn debris_far_away_is_left_out() {
        let at = |x: f64| DVec3::new(x, 0.0, 0.0);
        let one = crate::rig::fit::test_bodies::tubes(&[(at(0.0), at(1.0), 0.1)]);
        let whole =
            crate::rig::fit::test_bodies::tubes(&[(at(0.0), at(1.0), 0.1), (at(500.0), at(500.1), 0.02)]);
        let part = BodyPart::new(&whole);
        let kept = part.belongs.iter().filter(|&&belongs| belongs).count();
        assert_eq!(kept, one.triangles().len());
        assert!((0.9..1.0).contains(&part.share), "{}", part.share);
        assert_eq!(only_triangles(&whole, &part.belongs).unwrap().vertex_count(), one.vertex_count());
    }

    #[test]
    fn pieces_with_small_gaps_are_one_body() {
        let at = |x: f64| DVec3::new(x, 0.0, 0.0);
        let mesh = crate::rig::fit::test_bodies::tubes(&[(at(0.0), at(1.0), 0.1), (at(1.22), at(2.0), 0.1)]);
        assert!(BodyPart::new(&mesh).belongs.iter().all(|&belongs| belongs));
        let point = TriangleMesh::new(vec![DVec3::ONE; 3], vec![[0, 1, 2]]).unwrap();
        assert_eq!(BodyPart::new(&point).share, 1.0);
    }
}
