//! Barycentric embedding of surface vertices in cage tetrahedra.

use std::collections::HashMap;

use glam::DVec3;

use super::LatticePoint;
use super::lattice::BccLattice;

/// Corners and barycentric coordinates of one embedded point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Embedding {
    /// Cage vertices.
    pub corners: [u32; 4],
    /// Their shares; sum 1.
    pub barycentric: [f64; 4],
}

/// Embeds a position in the lattice tetrahedron around it; `None` where the cage has no such
/// tetrahedron.
#[must_use]
pub fn embed(
    lattice: &BccLattice,
    index_of: &HashMap<LatticePoint, u32>,
    position: DVec3,
) -> Option<Embedding> {
    let (points, barycentric) = lattice.locate(position);
    let mut corners = [0; 4];
    for (corner, point) in corners.iter_mut().zip(points) {
        *corner = *index_of.get(&point)?;
    }
    Some(Embedding { corners, barycentric })
}
