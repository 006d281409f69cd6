//! The distance field inside a body (Baran & Popović 2007, section 3.1): a grid of voxels, which of
//! them are inside, and how far each is from the body's outer surface.
//!
//! Any mesh has a field: a voxel is inside where the surface winds around it, or, where the triangles do
//! not agree on a side, where no way leads out without crossing them. Triangles that lie inside of the body, as where shells overlap,
//! are no boundary. Pieces with small gaps between them are bridged.

use glam::{DVec3, IVec3};
use rayon::prelude::*;

use super::body_part::only_triangles;
use super::voxel_grid::{VoxelGrid, index, is_inside, neighbours};
use crate::cage::WindingNumber;
use crate::mesh::{SurfaceQuery, TriangleMesh};
use crate::progress::{Cancelled, Progress};
use crate::rig::bind::Plane;

/// Voxels along the body: at most, and in the first look at how full it is.
const FINEST: f64 = 170.0;
const COARSE: f64 = 56.0;
/// About as many voxels are inside at most.
const MOST_INSIDE: f64 = 60_000.0;
/// Price of leaving a plane to come inside, for every length.
const FAR_ASIDE: f64 = 10.0;
/// How far beside a triangle, in voxels, to look whether it is inside of the body.
const BESIDE: f64 = 0.1;
/// Depths are rounded to this share of a voxel: mirror images are equally deep, whatever the last digits say.
const ROUNDING: f64 = 1.0 / 256.0;
/// Gaps up to this share of the body's size are bridged.
const BRIDGE: f64 = 0.05;

/// Voxels inside a body and their distances from its surface.
pub(super) struct DistanceField {
    origin: DVec3,
    /// Side of a voxel.
    pub(super) cell: f64,
    size: IVec3,
    /// Inside voxel of each grid place.
    ids: Vec<u32>,
    /// Grid places of the inside voxels (N), ascending.
    pub(super) voxels: Vec<IVec3>,
    /// Distance of each inside voxel's centre from the outer surface.
    pub(super) depth: Vec<f64>,
    /// Pairs of voxels that bridge gaps between pieces.
    pub(super) bridges: Vec<(u32, u32)>,
}

const OUTSIDE: u32 = u32::MAX;

impl DistanceField {
    /// Builds the field of a mesh with extent; without voxels where the mesh encloses nothing.
    pub(super) fn new(mesh: &TriangleMesh, progress: &Progress) -> Result<Self, Cancelled> {
        let (low, high) = mesh.bounds();
        let extent = (high - low).max_element();
        let winding = WindingNumber::new(mesh);
        let Ok(surface) = SurfaceQuery::new(mesh) else {
            return Ok(Self::without_voxels(low, extent));
        };
        let coarse = VoxelGrid::new(low, high, extent / COARSE).fill(mesh, &winding, &surface, progress)?;
        let count = coarse.inside.iter().filter(|&&inside| inside).count() as f64;
        let fullest = (MOST_INSIDE / count.max(1.0)).cbrt();
        // A whole number of voxels along the body, so that a voxel more or less in the first look changes nothing.
        let cell = extent / (extent * fullest / coarse.cell).min(FINEST).round().max(1.0);
        progress.report(0.2)?;
        let grid = VoxelGrid::new(low, high, cell).fill(mesh, &winding, &surface, progress)?;
        progress.report(0.6)?;
        let mut field = Self::from_grid(&grid);
        field.keep_pieces(BRIDGE * extent);
        let outer = outer_surface(mesh, &winding, &grid);
        let outer = outer.as_ref().unwrap_or(&surface);
        field.depth = field
            .voxels
            .par_iter()
            .map(|&voxel| outer.closest_point(field.centre(voxel)).map_or(0.0, |found| found.distance))
            .map(|depth| (depth / (ROUNDING * cell)).round() * ROUNDING * cell)
            .collect();
        progress.report(1.0)?;
        Ok(field)
    }

    fn without_voxels(low: DVec3, cell: f64) -> Self {
        Self {
            origin: low,
            cell,
            size: IVec3::ZERO,
            ids: Vec::new(),
            voxels: Vec::new(),
            depth: Vec::new(),
            bridges: Vec::new(),
        }
    }

    fn from_grid(grid: &VoxelGrid) -> Self {
        let mut field = Self::without_voxels(grid.origin, grid.cell);
        field.size = grid.size;
        field.voxels = (0..grid.inside.len()).filter(|&i| grid.inside[i]).map(|i| grid.place(i)).collect();
        field.number();
        field
    }

    fn number(&mut self) {
        self.ids = vec![OUTSIDE; (self.size.x * self.size.y * self.size.z) as usize];
        for (id, &voxel) in (0..).zip(&self.voxels) {
            let slot = index(self.size, voxel);
            self.ids[slot] = id;
        }
    }

    /// Centre of a grid place.
    fn centre(&self, place: IVec3) -> DVec3 {
        self.origin + (place.as_dvec3() + 0.5) * self.cell
    }

    /// Position of an inside voxel.
    pub(super) fn position(&self, id: u32) -> DVec3 {
        self.centre(self.voxels[id as usize])
    }

    /// Inside voxel at a grid place.
    pub(super) fn id(&self, place: IVec3) -> Option<u32> {
        let in_grid = place.cmpge(IVec3::ZERO).all() && place.cmplt(self.size).all();
        in_grid.then(|| self.ids[index(self.size, place)]).filter(|&id| id != OUTSIDE)
    }

    /// Inside voxel that holds a point.
    pub(super) fn voxel_at(&self, point: DVec3) -> Option<u32> {
        self.id(((point - self.origin) / self.cell).floor().as_ivec3())
    }

    /// Distance from the surface at a point, interpolated between voxels; outside of them it is
    /// below zero and about minus one voxel.
    pub(super) fn depth_at(&self, point: DVec3) -> f64 {
        let place = (point - self.origin) / self.cell - 0.5;
        let (first, share) = (place.floor().as_ivec3(), place - place.floor());
        let mut depth = 0.0;
        for corner in (0..8).map(|i| IVec3::new(i & 1, i >> 1 & 1, i >> 2 & 1)) {
            let weight = (0..3).map(|axis| if corner[axis] == 1 { share[axis] } else { 1.0 - share[axis] });
            let here = self.id(first + corner).map_or(-0.5 * self.cell, |id| self.depth[id as usize]);
            depth += weight.product::<f64>() * here;
        }
        depth
    }

    /// The point itself where it is at least `depth` below the surface, else the centre of the voxel
    /// that is near and deep.
    pub(super) fn pulled_inside(&self, point: DVec3, depth: f64) -> DVec3 {
        self.pulled_inside_near(point, depth, None)
    }

    /// Like [`Self::pulled_inside`], to a place in a plane.
    pub(super) fn pulled_inside_near(&self, point: DVec3, depth: f64, plane: Option<&Plane>) -> DVec3 {
        let in_plane = |p: DVec3| plane.map_or(p, |plane| p - plane.normal * plane.height(p));
        let point = in_plane(point);
        if self.voxel_at(point).is_some() && self.depth_at(point) >= depth {
            return point;
        }
        let miss = |id: usize| {
            let lack = (depth - self.depth[id]).max(0.0);
            let place = self.position(id as u32);
            let aside = plane.map_or(0.0, |plane| (plane.height(place).abs() - 0.6 * self.cell).max(0.0));
            place.distance(point) + 3.0 * lack + FAR_ASIDE * aside
        };
        let nearest = (0..self.voxels.len()).min_by(|&a, &b| miss(a).total_cmp(&miss(b)));
        nearest.map_or(point, |id| in_plane(self.position(id as u32)))
    }

    /// Keeps the largest connected piece and those with small gaps to it, and bridges the gaps.
    fn keep_pieces(&mut self, gap: f64) {
        let (mut piece_of, counts) = self.pieces();
        let Some(largest) = (0..counts.len()).max_by_key(|&p| (counts[p], std::cmp::Reverse(p))) else {
            return;
        };
        let mut kept = vec![false; counts.len()];
        kept[largest] = true;
        let mut bridges: Vec<(IVec3, IVec3)> = Vec::new();
        // The nearest piece first, as often as one is near enough.
        loop {
            let mut tree = kdtree::KdTree::new(3);
            for (id, &voxel) in self.voxels.iter().enumerate() {
                if kept[piece_of[id]] {
                    // Positions are finite, so nothing is refused.
                    let _ = tree.add(self.centre(voxel).to_array(), id as u32);
                }
            }
            let loose: Vec<usize> = (0..self.voxels.len()).filter(|&id| !kept[piece_of[id]]).collect();
            let found: Vec<(f64, usize, u32)> = loose
                .par_iter()
                .filter_map(|&id| {
                    let point = self.centre(self.voxels[id]).to_array();
                    let near = tree.nearest(&point, 1, &kdtree::distance::squared_euclidean).ok()?;
                    near.first().map(|&(squared, &other)| (squared.sqrt(), id, other))
                })
                .filter(|found| found.0 <= gap + 2.0 * self.cell)
                .collect();
            let mut nearest: Vec<Option<(f64, usize, u32)>> = vec![None; counts.len()];
            for bridge in found {
                let best = &mut nearest[piece_of[bridge.1]];
                if best.is_none_or(|best| bridge.0 < best.0) {
                    *best = Some(bridge);
                }
            }
            if nearest.iter().all(Option::is_none) {
                break;
            }
            for (piece, bridge) in nearest.into_iter().enumerate() {
                if let Some((_, id, other)) = bridge {
                    kept[piece] = true;
                    bridges.push((self.voxels[id], self.voxels[other as usize]));
                }
            }
        }
        let mut id = 0;
        self.voxels.retain(|_| {
            id += 1;
            kept[piece_of[id - 1]]
        });
        piece_of.clear();
        self.number();
        let number = |(a, b): (IVec3, IVec3)| Some((self.id(a)?, self.id(b)?));
        self.bridges = bridges.into_iter().filter_map(number).collect();
    }

    /// Connected piece of each voxel, and the pieces' numbers of voxels.
    fn pieces(&self) -> (Vec<usize>, Vec<usize>) {
        let mut piece_of = vec![usize::MAX; self.voxels.len()];
        let mut counts = Vec::new();
        for seed in 0..self.voxels.len() {
            if piece_of[seed] != usize::MAX {
                continue;
            }
            piece_of[seed] = counts.len();
            let mut count = 1;
            let mut front = vec![seed as u32];
            while let Some(id) = front.pop() {
                for step in neighbours() {
                    let next = self.id(self.voxels[id as usize] + step);
                    if let Some(next) = next.filter(|&n| piece_of[n as usize] == usize::MAX) {
                        piece_of[next as usize] = counts.len();
                        count += 1;
                        front.push(next);
                    }
                }
            }
            counts.push(count);
        }
        (piece_of, counts)
    }
}

/// The triangles that have the outside on one side; `None` where there are none.
fn outer_surface(mesh: &TriangleMesh, winding: &WindingNumber, grid: &VoxelGrid) -> Option<SurfaceQuery> {
    let step = BESIDE * grid.cell;
    let is_outer: Vec<bool> = (0..mesh.triangles().len())
        .into_par_iter()
        .map(|t| {
            let [a, b, c] = mesh.corners(t);
            let (middle, normal) = ((a + b + c) / 3.0, mesh.area_vector(t).normalize_or_zero());
            [-step, step].iter().any(|&side| !is_inside(winding, middle + normal * side))
        })
        .collect();
    SurfaceQuery::new(&only_triangles(mesh, &is_outer)?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::fit::test_bodies::{field, tubes};

    fn tube() -> TriangleMesh {
        tubes(&[(DVec3::ZERO, DVec3::X * 2.0, 0.3)])
    }

    fn assert_is_the_tube(field: &DistanceField) {
        for id in (0..field.voxels.len() as u32).step_by(97) {
            let point = field.position(id);
            let along = DVec3::X * point.x.clamp(0.0, 2.0);
            let depth = 0.3 - point.distance(along);
            // Twelve corners are up to 4 % inside of the round tube.
            assert!((field.depth[id as usize] - depth).abs() < 0.03, "{point}");
        }
        let volume = field.voxels.len() as f64 * field.cell.powi(3);
        let exact = std::f64::consts::PI * 0.09 * 2.4;
        assert!((0.85..1.05).contains(&(volume / exact)), "{volume} {exact}");
    }

    #[test]
    fn depths_are_distances_from_the_surface() {
        assert_is_the_tube(&field(&tube()));
    }

    #[test]
    fn surfaces_inside_out_or_in_shells_have_the_same_inside() {
        let mesh = tube();
        let flipped = mesh.triangles().iter().map(|&[a, b, c]| [a, c, b]).collect();
        assert_is_the_tube(&field(&TriangleMesh::new(mesh.vertices().to_vec(), flipped).unwrap()));
        let (middle, end) = (DVec3::X, DVec3::X * 2.0);
        assert_is_the_tube(&field(&tubes(&[(DVec3::ZERO, middle, 0.3), (middle * 0.8, end, 0.3)])));
    }

    #[test]
    fn random_orientation_leaves_what_is_enclosed() {
        let mesh = tube();
        let triangles = mesh.triangles().iter().enumerate();
        let mixed = triangles.map(|(i, &[a, b, c])| if i % 2 == 0 { [a, b, c] } else { [a, c, b] }).collect();
        let field = field(&TriangleMesh::new(mesh.vertices().to_vec(), mixed).unwrap());
        assert!(field.voxel_at(DVec3::X).is_some() && field.voxel_at(DVec3::Y).is_none());
    }

    #[test]
    fn small_gaps_are_bridged_and_large_ones_are_not() {
        let pieces = |gap: f64| {
            let (a, b) = (DVec3::X * (1.6 + gap), DVec3::X * (2.6 + gap));
            field(&tubes(&[(DVec3::ZERO, DVec3::X, 0.3), (a, b, 0.3)]))
        };
        let near = pieces(0.06);
        assert_eq!(near.bridges.len(), 1);
        assert!(near.voxel_at(DVec3::X * 2.4).is_some());
        let far = pieces(1.0);
        assert!(far.bridges.is_empty());
        assert!(far.voxel_at(DVec3::X * 0.5).is_some() != far.voxel_at(DVec3::X * 3.0).is_some());
    }

    #[test]
    fn points_are_pulled_inside() {
        let field = field(&tube());
        assert_eq!(field.pulled_inside(DVec3::X, 0.1), DVec3::X);
        let pulled = field.pulled_inside(DVec3::new(1.0, 0.5, 0.0), 0.1);
        assert!(
            field.depth_at(pulled) > 0.08 && pulled.distance(DVec3::new(1.0, 0.2, 0.0)) < 0.08,
            "{pulled}"
        );
    }

    #[test]
    fn a_sheet_encloses_nothing() {
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        let vertices = corners.map(|(x, y)| DVec3::new(x, y, 0.0)).to_vec();
        assert!(field(&TriangleMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3]]).unwrap()).voxels.is_empty());
    }
}
