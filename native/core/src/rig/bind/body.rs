//! The body that the distances go through: the mesh in a frame of its own, its seams closed, and
//! lattice tetrahedra around and inside it.
//!
//! The frame turns with the mesh, so that a mesh that was moved, turned or scaled gets the same
//! lattice and the same weights up to rounding.

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;

use super::skeleton_length;
use crate::cage::{BccLattice, CageError, Embedding, LatticeCage, Membership, WindingNumber, embed};
use crate::mesh::{TriangleMesh, weld_seams};
use crate::progress::{Cancelled, Progress};
use crate::rig::Skeleton;

/// Cells along the character.
const CELLS_ALONG: f64 = 87.0;
/// Cells along the mesh in the first, coarse look at how much room it fills.
const COARSE_CELLS: f64 = 40.0;
/// A cage has about this many vertices at most; bulky bodies get larger cells.
const LARGEST_CAGE: f64 = 32_000.0;
/// Between the growth of a surface's cells and that of a solid's when cells shrink.
const GROWTH: f64 = 2.7;
/// The character is at most this many times as long as its skeleton; what is farther is something
/// else that belongs to the mesh.
const BEYOND_SKELETON: f64 = 1.5;
/// A skeleton shorter than this share of the mesh does not make the cells finer.
const SHORTEST_SKELETON: f64 = 0.02;
/// Axes of inertia that differ by less than this share have no direction of their own.
const DISTINCT_AXES: f64 = 0.01;

/// From the caller's space to one where the longest side of the mesh is 1.
#[derive(Debug, Clone, Copy)]
struct Frame {
    centre: DVec3,
    to_axes: DMat3,
    scale: f64,
}

/// A mesh ready for measuring distances through it.
pub(super) struct Body {
    /// The mesh in its frame, with vertices that only a seam had repeated made one.
    pub(super) mesh: TriangleMesh,
    /// Vertex of `mesh` for each of the caller's vertices.
    pub(super) welded: Vec<u32>,
    /// Heads and tails of the bones in the frame.
    pub(super) heads: Vec<DVec3>,
    pub(super) tails: Vec<DVec3>,
    /// Length of the character in the frame: 1, unless the mesh reaches far beyond the skeleton.
    pub(super) length: f64,
    /// The tetrahedra, where the mesh has any extent.
    pub(super) cage: Option<LatticeCage>,
}

impl Body {
    /// Builds the frame and the cage. `takes_part` (B) marks the bones that count.
    pub(super) fn new(
        mesh: &TriangleMesh,
        skeleton: &Skeleton,
        takes_part: &[bool],
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let frame = Frame::of(mesh);
        let place = |points: &[DVec3]| points.iter().map(|&p| frame.apply(p)).collect::<Vec<_>>();
        let (heads, tails) = (place(skeleton.heads()), place(skeleton.tails()));
        let (mesh, welded) = weld(mesh, place(mesh.vertices()));
        let reach = BEYOND_SKELETON * skeleton_length(&heads, &tails, takes_part);
        let length = if reach > SHORTEST_SKELETON { reach.min(1.0) } else { 1.0 };
        let cage = build_cage(&mesh, length / CELLS_ALONG, progress)?;
        Ok(Self { mesh, welded, heads, tails, length, cage })
    }

    /// Where a position is in the cage; `None` outside of it.
    pub(super) fn embed(&self, position: DVec3) -> Option<Embedding> {
        let cage = self.cage.as_ref()?;
        embed(&cage.lattice, &cage.index_of, position)
    }
}

impl Frame {
    fn of(mesh: &TriangleMesh) -> Self {
        let (low, high) = mesh.bounds();
        let middle = (low + high) * 0.5;
        let extent = (high - low).max_element();
        let unit = if extent > 0.0 { extent } else { 1.0 };
        let to_axes = axes_of_inertia(mesh, middle, unit);
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &vertex in mesh.vertices() {
            let p = to_axes * ((vertex - middle) / unit);
            low = low.min(p);
            high = high.max(p);
        }
        let longest = (high - low).max_element();
        let scale = if longest > 0.0 { unit * longest } else { unit };
        Self { centre: middle + to_axes.transpose() * ((low + high) * 0.5) * unit, to_axes, scale }
    }

    fn apply(&self, point: DVec3) -> DVec3 {
        self.to_axes * ((point - self.centre) / self.scale)
    }
}

/// Rotation into the axes of inertia of the surface; none where they are not distinct.
fn axes_of_inertia(mesh: &TriangleMesh, middle: DVec3, unit: f64) -> DMat3 {
    let (mut total, mut first, mut second) = (0.0, DVec3::ZERO, DMat3::ZERO);
    for t in 0..mesh.triangles().len() {
        let [a, b, c] = mesh.corners(t).map(|p| (p - middle) / unit);
        let area = (b - a).cross(c - a).length();
        let sum = a + b + c;
        total += area;
        first += sum * (area / 3.0);
        // Second moment of a triangle: its corners and three times its centroid, over twelve.
        let outer = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
        second += (outer(a) + outer(b) + outer(c) + outer(sum)) * (area / 12.0);
    }
    if total.is_nan() || total <= 0.0 {
        return DMat3::IDENTITY;
    }
    let mean = first / total;
    let spread = second * (1.0 / total) - DMat3::from_cols(mean * mean.x, mean * mean.y, mean * mean.z);
    let eigen = Matrix3::from_column_slice(&spread.to_cols_array()).symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let [least, some, most] = order.map(|i| eigen.eigenvalues[i]);
    if some - least < DISTINCT_AXES * most || most - some < DISTINCT_AXES * most {
        return DMat3::IDENTITY;
    }
    let axis = |i: usize| DVec3::from_slice(eigen.eigenvectors.column(order[i]).as_slice());
    let (x, y) = (axis(0).normalize_or_zero(), axis(1).normalize_or_zero());
    let rows = DMat3::from_cols(x, y, x.cross(y));
    if rows.is_finite() { rows.transpose() } else { DMat3::IDENTITY }
}

/// Joins vertices that a seam had repeated.
fn weld(mesh: &TriangleMesh, vertices: Vec<DVec3>) -> (TriangleMesh, Vec<u32>) {
    let stands_for = weld_seams(mesh);
    let mut welded = vec![0; vertices.len()];
    let mut kept = Vec::with_capacity(vertices.len());
    for (v, &first) in stands_for.iter().enumerate() {
        // The first of a group comes before the others.
        welded[v] = if first as usize == v {
            kept.push(vertices[v]);
            kept.len() as u32 - 1
        } else {
            welded[first as usize]
        };
    }
    let triangles = mesh.triangles().iter().map(|t| t.map(|v| welded[v as usize])).collect();
    match TriangleMesh::new(kept, triangles) {
        Ok(mesh) => (mesh, welded),
        // Positions too large to be turned: leave the mesh as it is.
        Err(_) => (mesh.clone(), (0..vertices.len() as u32).collect()),
    }
}

/// The finest cage with cells of at least `cell_size` that is not too large; `None` for a mesh
/// without extent.
fn build_cage(
    mesh: &TriangleMesh,
    cell_size: f64,
    progress: &Progress,
) -> Result<Option<LatticeCage>, Cancelled> {
    let winding = WindingNumber::new(mesh);
    let everywhere = vec![Membership::Inside; mesh.triangles().len()];
    let (low, high) = mesh.bounds();
    if !(high - low).is_finite() || (high - low).max_element() <= 0.0 {
        return Ok(None);
    }
    let mut cell = (1.0 / COARSE_CELLS).max(cell_size);
    loop {
        progress.report(0.5)?;
        let lattice = BccLattice::new((low + high) * 0.5, cell);
        match LatticeCage::new(mesh, &winding, lattice, &everywhere, &|_| true) {
            Ok(cage) => {
                let fullness = cage.mesh.vertices().len() as f64 / LARGEST_CAGE;
                let finest = (cell * fullness.powf(1.0 / GROWTH)).max(cell_size);
                // Close enough: another build would cost more than it gives.
                if (0.93 * cell..=1.07 * cell).contains(&finest) {
                    return Ok(Some(cage));
                }
                cell = finest;
            }
            Err(CageError::TooManyCells { .. }) => cell *= 2.0,
            Err(_) => return Ok(None),
        }
        if cell > 2.0 {
            return Ok(None);
        }
    }
}
