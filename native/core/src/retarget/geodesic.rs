//! Places that lie near along the edges of a surface.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::DVec3;
use rustc_hash::FxHashMap;

use crate::mesh::{Adjacency, TriangleMesh};

/// Whether a way of at most two edges between two triangles joins a point of each within `bound`: where
/// it does, so does the shortest way.
pub(super) fn joined_by_two_edges(
    mesh: &TriangleMesh,
    adjacency: &Adjacency,
    (from, start): ([u32; 3], DVec3),
    (to, end): ([u32; 3], DVec3),
    bound: f64,
) -> bool {
    let position = |v: u32| mesh.vertices()[v as usize];
    let last = to.map(|b| position(b).distance(end));
    let arrives =
        |v: u32, before: f64| to.iter().zip(last).any(|(&b, last)| b == v && before + last <= bound);
    from.iter().any(|&a| {
        let first = position(a).distance(start);
        let ways = adjacency.neighbours(a as usize).iter();
        first <= bound
            && ways.map(|&b| (b, first + position(a).distance(position(b)))).any(|(b, second)| {
                let mut beyond = adjacency.neighbours(b as usize).iter();
                arrives(b, second)
                    || (second <= bound
                        && beyond.any(|&c| arrives(c, second + position(b).distance(position(c)))))
            })
    })
}

/// Scratch space for [`Ball::grow`], used again from one centre to the next.
#[derive(Debug, Default)]
pub(super) struct Ball {
    distances: FxHashMap<u32, f64>,
    queue: BinaryHeap<Entry>,
}

#[derive(Debug, PartialEq)]
struct Entry(f64, u32);

impl Eq for Entry {}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        other.0.total_cmp(&self.0).then(other.1.cmp(&self.1))
    }
}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ball {
    /// Finds all vertices within `radius` along the edges from a point of a triangle.
    pub(super) fn grow(
        &mut self,
        mesh: &TriangleMesh,
        adjacency: &Adjacency,
        corners: [u32; 3],
        point: DVec3,
        radius: f64,
    ) {
        self.distances.clear();
        self.queue.clear();
        let position = |v: u32| mesh.vertices()[v as usize];
        for corner in corners {
            self.reach(corner, position(corner).distance(point), radius);
        }
        while let Some(Entry(distance, v)) = self.queue.pop() {
            if self.distances.get(&v).is_some_and(|known| *known < distance) {
                continue;
            }
            for &next in adjacency.neighbours(v as usize) {
                self.reach(next, distance + position(v).distance(position(next)), radius);
            }
        }
    }

    fn reach(&mut self, v: u32, distance: f64, radius: f64) {
        if distance <= radius && self.distances.get(&v).is_none_or(|known| distance < *known) {
            self.distances.insert(v, distance);
            self.queue.push(Entry(distance, v));
        }
    }

    /// Distance to a point of a triangle along edges, at most; infinite beyond the radius.
    pub(super) fn distance(&self, mesh: &TriangleMesh, corners: [u32; 3], point: DVec3) -> f64 {
        let through = |corner: &u32| {
            let rest = mesh.vertices()[*corner as usize].distance(point);
            self.distances.get(corner).map_or(f64::INFINITY, |distance| distance + rest)
        };
        corners.iter().map(through).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_surfaces::{grid, tube};
    use super::*;

    #[test]
    fn follows_the_surface() {
        // Across a tube the way round is π/2 times the way through.
        let tube = tube(0.5, 1.0, 64, 32);
        let adjacency = Adjacency::new(tube.vertex_count(), &tube.topology());
        let mut ball = Ball::default();
        let (start, across) = ([16 * 64; 3], [16 * 64 + 32; 3]);
        let point = |corners: [u32; 3]| tube.vertices()[corners[0] as usize];
        ball.grow(&tube, &adjacency, start, point(start), 2.0);
        let round = ball.distance(&tube, across, point(across));
        assert!((round / (0.5 * std::f64::consts::PI) - 1.0).abs() < 0.01, "{round}");
        ball.grow(&tube, &adjacency, start, point(start), 1.5);
        assert_eq!(ball.distance(&tube, across, point(across)), f64::INFINITY);
    }

    #[test]
    fn two_edges_never_promise_more_than_the_shortest_way() {
        let grid = grid(10);
        let adjacency = Adjacency::new(grid.vertex_count(), &grid.topology());
        let centre = |t: usize| grid.corners(t).into_iter().sum::<DVec3>() / 3.0;
        let mut joined = 0;
        for from in (0..grid.triangles().len()).step_by(7) {
            let mut ball = Ball::default();
            ball.grow(&grid, &adjacency, grid.triangles()[from], centre(from), 3.0);
            for to in 0..grid.triangles().len() {
                let shortest = ball.distance(&grid, grid.triangles()[to], centre(to));
                for bound in [0.1, 0.2, 0.3] {
                    let ends = [from, to].map(|t| (grid.triangles()[t], centre(t)));
                    if joined_by_two_edges(&grid, &adjacency, ends[0], ends[1], bound) {
                        assert!(shortest <= bound + 1e-12, "{from} {to}");
                        joined += 1;
                    }
                }
            }
        }
        assert!(joined > 500, "{joined}");
    }

    #[test]
    fn starts_inside_of_a_triangle() {
        let grid = grid(10);
        let adjacency = Adjacency::new(grid.vertex_count(), &grid.topology());
        let mut ball = Ball::default();
        let centre = grid.corners(0).into_iter().sum::<DVec3>() / 3.0;
        ball.grow(&grid, &adjacency, grid.triangles()[0], centre, 0.5);
        let corner = grid.triangles()[0];
        assert!((ball.distance(&grid, [corner[0]; 3], grid.corners(0)[0]) - centre.length()).abs() < 1e-12);
    }
}
