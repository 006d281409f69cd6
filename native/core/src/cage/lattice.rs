//! The body-centred-cubic lattice and its tetrahedra (Labelle & Shewchuk 2007, section 3).
//!
//! Lattice points are integer triples of one parity: even triples are the corners of the cubes,
//! odd ones their centres. A cube has side `cell_size`, two units of the triples. All tetrahedra
//! are alike: an edge between two neighbouring points of one parity and, across it, an edge of the
//! other parity. Dihedral angles are 60° and 90°.

use glam::DVec3;

/// A lattice point: three even or three odd numbers, in half cells from the origin.
pub type LatticePoint = [i32; 3];

/// An infinite lattice with its origin and cell size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BccLattice {
    origin: DVec3,
    half_cell: f64,
}

impl BccLattice {
    /// A lattice through `origin` with cubes of side `cell_size`, which must be above zero.
    #[must_use]
    pub fn new(origin: DVec3, cell_size: f64) -> Self {
        Self { origin, half_cell: 0.5 * cell_size }
    }

    /// Side of the cubes.
    #[must_use]
    pub fn cell_size(&self) -> f64 {
        2.0 * self.half_cell
    }

    /// Volume of each tetrahedron: a twelfth of a cube.
    #[must_use]
    pub fn tetrahedron_volume(&self) -> f64 {
        self.cell_size().powi(3) / 12.0
    }

    /// Position of a lattice point.
    #[must_use]
    pub fn position(&self, point: LatticePoint) -> DVec3 {
        self.origin + DVec3::from_array(point.map(f64::from)) * self.half_cell
    }

    /// The tetrahedron that holds a position, positively oriented, and the position's barycentric
    /// coordinates in it. The order of the
    /// corners depends on the tetrahedron alone. On a shared face, edge or corner one of the candidates is chosen.
    #[must_use]
    pub fn locate(&self, position: DVec3) -> ([LatticePoint; 4], [f64; 4]) {
        let p = (position - self.origin) / self.half_cell;
        let cube = (p * 0.5).floor();
        let centre = cube * 2.0 + 1.0;
        let offset = (p - centre).to_array();
        let mut axes = [0usize, 1, 2];
        axes.sort_by(|&i, &j| offset[j].abs().total_cmp(&offset[i].abs()));
        let [k, i, j] = axes;
        let sign = |x: f64| if x < 0.0 { -1 } else { 1 };
        let centre: LatticePoint = centre.to_array().map(|x| x as i32);
        let at = |dk: i32, di: i32, dj: i32| {
            let mut point = centre;
            point[k] += dk * sign(offset[k]);
            point[i] += di * sign(offset[i]);
            point[j] += dj * sign(offset[j]);
            point
        };
        let (x, y, z) = (offset[k].abs(), offset[i].abs(), offset[j].abs());
        // One order for the whole tetrahedron, wherever in it the position is: both pairs ascend.
        let mut odd = [(centre, 1.0 - 0.5 * (x + y)), (at(2, 0, 0), 0.5 * (x - y))];
        let mut even = [(at(1, 1, -1), 0.5 * (y - z)), (at(1, 1, 1), 0.5 * (y + z))];
        odd.sort_by_key(|(point, _)| point[k]);
        even.sort_by_key(|(point, _)| point[j]);
        // (k, i, j) may be an odd permutation, and i may point down: either mirrors the tetrahedron.
        let cyclic = (i + 3 - k) % 3 == 1;
        if cyclic != (offset[i] < 0.0) {
            even.swap(0, 1);
        }
        let [(a, s), (b, t)] = odd;
        let [(c, u), (d, v)] = even;
        ([a, b, d, c], [s, t, v, u])
    }

    /// The four tetrahedra that share faces with a tetrahedron, each with the corner of the given
    /// tetrahedron that is opposite to the shared face.
    #[must_use]
    pub fn face_neighbours(&self, corners: [LatticePoint; 4]) -> [(usize, [LatticePoint; 4]); 4] {
        // The centre of mass mirrored far enough through a face is inside the neighbour there.
        let positions = corners.map(|c| self.position(c));
        let centre = (positions[0] + positions[1] + positions[2] + positions[3]) * 0.25;
        [0, 1, 2, 3].map(|opposite| {
            let face = (centre * 4.0 - positions[opposite]) / 3.0;
            (opposite, self.locate(face * 2.0 - centre).0)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lattice() -> BccLattice {
        BccLattice::new(DVec3::new(0.3, -0.2, 0.1), 0.7)
    }

    proptest! {
        #[test]
        fn located_tetrahedra_hold_the_point(p in prop::array::uniform3(-5.0f64..5.0)) {
            let p = DVec3::from_array(p);
            let (corners, barycentric) = lattice().locate(p);
            let positions = corners.map(|c| lattice().position(c));
            let back: DVec3 = positions.iter().zip(barycentric).map(|(&c, b)| c * b).sum();
            prop_assert!(back.distance(p) < 1e-12);
            prop_assert!(barycentric.iter().all(|&b| b >= -1e-12));
            prop_assert!((barycentric.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            for corner in corners {
                let parity = corner[0].rem_euclid(2);
                prop_assert!(corner.iter().all(|x| x.rem_euclid(2) == parity));
            }
            let [a, b, c, d] = positions;
            let volume = (b - a).cross(c - a).dot(d - a) / 6.0;
            prop_assert!((volume - lattice().tetrahedron_volume()).abs() < 1e-12);
        }

        #[test]
        fn neighbours_share_the_face_opposite_to_a_corner(p in prop::array::uniform3(-5.0f64..5.0)) {
            let (corners, _) = lattice().locate(DVec3::from_array(p));
            for (opposite, neighbour) in lattice().face_neighbours(corners) {
                let back = lattice().face_neighbours(neighbour);
                prop_assert!(back.iter().any(|(_, again)| *again == corners), "one order for one cell");
                let shared: Vec<_> = corners.iter().filter(|c| neighbour.contains(c)).collect();
                prop_assert_eq!(shared.len(), 3);
                prop_assert!(!neighbour.contains(&corners[opposite]));
            }
        }
    }

    #[test]
    fn dihedral_angles_are_sixty_and_ninety_degrees() {
        let (corners, _) = lattice().locate(DVec3::new(0.4, 0.1, 0.2));
        let p = corners.map(|c| lattice().position(c));
        for (a, b, c, d) in
            [(0, 1, 2, 3), (0, 2, 1, 3), (0, 3, 1, 2), (1, 2, 0, 3), (1, 3, 0, 2), (2, 3, 0, 1)]
        {
            let axis = (p[b] - p[a]).normalize();
            let across = |q: DVec3| (q - p[a]).reject_from(axis).normalize();
            let angle = across(p[c]).dot(across(p[d])).acos().to_degrees();
            assert!((angle - 60.0).abs() < 1e-9 || (angle - 90.0).abs() < 1e-9, "{angle}");
        }
    }
}
