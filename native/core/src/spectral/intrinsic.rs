//! An intrinsic triangulation: triangles known by their side lengths and by which side is glued to
//! which. It may be non-manifold at vertices and hold loops; lengths are all its geometry.
//!
//! After N. Sharp and K. Crane, "A Laplacian for nonmanifold triangle meshes", 2020.

use rayon::prelude::*;

/// A side of a triangle: side `s` runs from corner `s` to corner `s + 1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Side {
    pub(super) triangle: u32,
    pub(super) side: u8,
}

impl Side {
    pub(super) fn new(triangle: usize, side: usize) -> Self {
        Self { triangle: triangle as u32, side: (side % 3) as u8 }
    }

    fn next(self) -> Self {
        Self { triangle: self.triangle, side: (self.side + 1) % 3 }
    }

    fn slot(self) -> usize {
        3 * self.triangle as usize + self.side as usize
    }
}

/// Corners, side lengths and gluing of each triangle, each indexed by side slot `3 t + s`, and
/// what follows from the lengths.
pub(super) struct IntrinsicTriangulation {
    corners: Vec<u32>,
    lengths: Vec<f64>,
    glued: Vec<Side>,
    shapes: Vec<Shape>,
}

/// Area of a triangle and the cotangents of the angles opposite its sides.
#[derive(Debug, Clone, Copy)]
struct Shape {
    area: f64,
    cotangents: [f64; 3],
}

impl Shape {
    /// Area by Kahan's form of Heron's formula, which is stable for needles.
    fn new(lengths: [f64; 3]) -> Self {
        let mut sorted = lengths;
        sorted.sort_unstable_by(|a, b| b.total_cmp(a));
        let [a, b, c] = sorted;
        let product = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c));
        let area = 0.25 * product.max(0.0).sqrt();
        let cotangents = [0, 1, 2].map(|s| {
            let (c, a, b) = (lengths[s], lengths[(s + 1) % 3], lengths[(s + 2) % 3]);
            (a * a + b * b - c * c) / (4.0 * area)
        });
        Self { area, cotangents }
    }
}

/// Sides whose cotangent weight is above minus this are Delaunay (the bound keeps flips from
/// cycling on rounding errors in cocircular triangles).
const DELAUNAY_TOLERANCE: f64 = 1e-6;

impl IntrinsicTriangulation {
    pub(super) fn new(corners: Vec<u32>, lengths: Vec<f64>, glued: Vec<Side>) -> Self {
        debug_assert!(corners.len() == lengths.len() && corners.len() == glued.len());
        let shapes = lengths.par_chunks_exact(3).map(|l| Shape::new([l[0], l[1], l[2]])).collect();
        Self { corners, lengths, glued, shapes }
    }

    pub(super) fn triangle_count(&self) -> usize {
        self.corners.len() / 3
    }

    pub(super) fn corner(&self, side: Side) -> u32 {
        self.corners[side.slot()]
    }

    pub(super) fn area(&self, triangle: usize) -> f64 {
        self.shapes[triangle].area
    }

    /// Cotangent of the angle opposite a side.
    pub(super) fn cotangent(&self, side: Side) -> f64 {
        self.shapes[side.triangle as usize].cotangents[side.side as usize]
    }

    /// Flips sides until every one is Delaunay. The order is fixed, so the result is too.
    pub(super) fn flip_to_delaunay(&mut self) {
        let mut queue: Vec<Side> = (0..self.triangle_count())
            .rev()
            .flat_map(|t| (0..3).rev().map(move |s| Side::new(t, s)))
            .collect();
        let mut queued = vec![true; self.corners.len()];
        while let Some(side) = queue.pop() {
            queued[side.slot()] = false;
            let twin = self.glued[side.slot()];
            let weight = 0.5 * (self.cotangent(side) + self.cotangent(twin));
            // A weight that is not a number belongs to a triangle without area: leave it alone.
            if twin.triangle == side.triangle || weight.is_nan() || weight >= -DELAUNAY_TOLERANCE {
                continue;
            }
            if !self.flip(side, twin) {
                continue;
            }
            for around in [side.next(), side.next().next(), twin.next(), twin.next().next()] {
                if !std::mem::replace(&mut queued[around.slot()], true) {
                    queue.push(around);
                }
            }
        }
    }

    /// Replaces the diagonal of the quad around two glued sides. Afterwards the new diagonal is
    /// side 0 of both triangles' former slots `side` and `twin`.
    fn flip(&mut self, side: Side, twin: Side) -> bool {
        let (i, j) = (self.corner(side), self.corner(side.next()));
        let (k, m) = (self.corner(side.next().next()), self.corner(twin.next().next()));
        let [jk, ki] = [side.next(), side.next().next()];
        let [im, mj] = [twin.next(), twin.next().next()];
        let diagonal = self.opposite_diagonal(side, twin);
        if !diagonal.is_finite() || diagonal <= 0.0 {
            return false;
        }
        let old = [jk, ki, im, mj].map(|s| (s, self.lengths[s.slot()], self.glued[s.slot()]));
        // Triangle of `side` becomes (m, k, i): diagonal, ki, im. That of `twin` (k, m, j): diagonal, mj, jk.
        let [new_ki, new_im] = [side.next(), side.next().next()];
        let [new_mj, new_jk] = [twin.next(), twin.next().next()];
        for (slot, corner) in [(side, m), (new_ki, k), (new_im, i), (twin, k), (new_mj, m), (new_jk, j)] {
            self.corners[slot.slot()] = corner;
        }
        self.lengths[side.slot()] = diagonal;
        self.lengths[twin.slot()] = diagonal;
        let moved = [(jk, new_jk), (ki, new_ki), (im, new_im), (mj, new_mj)];
        let place = |s: Side| moved.iter().find(|(from, _)| *from == s).map_or(s, |(_, to)| *to);
        for ((_, to), (_, length, neighbour)) in moved.into_iter().zip(old) {
            let neighbour = place(neighbour);
            self.lengths[to.slot()] = length;
            self.glued[to.slot()] = neighbour;
            self.glued[neighbour.slot()] = to;
        }
        for triangle in [side.triangle as usize, twin.triangle as usize] {
            self.shapes[triangle] = Shape::new([0, 1, 2].map(|s| self.lengths[3 * triangle + s]));
        }
        true
    }

    /// Length of the other diagonal of the quad, laid out in the plane.
    fn opposite_diagonal(&self, side: Side, twin: Side) -> f64 {
        let base = self.lengths[side.slot()];
        let apex = |from_start: f64, from_end: f64, area: f64| {
            let x = (base * base + from_start * from_start - from_end * from_end) / (2.0 * base);
            (x, 2.0 * area / base)
        };
        let length = |s: Side| self.lengths[s.slot()];
        let (kx, ky) =
            apex(length(side.next().next()), length(side.next()), self.area(side.triangle as usize));
        let (mx, my) =
            apex(length(twin.next()), length(twin.next().next()), self.area(twin.triangle as usize));
        (kx - mx).hypot(ky + my)
    }

    #[cfg(test)]
    pub(super) fn check(&self) {
        for t in 0..self.triangle_count() {
            for s in 0..3 {
                let side = Side::new(t, s);
                let twin = self.glued[side.slot()];
                assert_eq!(self.glued[twin.slot()], side);
                assert_eq!(self.lengths[twin.slot()], self.lengths[side.slot()]);
                assert_eq!(self.corner(side), self.corner(twin.next()));
                assert_eq!(self.corner(side.next()), self.corner(twin));
            }
        }
    }
}
