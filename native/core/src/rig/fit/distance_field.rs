//! The distance field inside a body (Baran & Popović 2007, section 3.1): a grid of voxels, which of
//! them are inside, and how far each is from the body's outer surface.
//!
//! Any mesh has a field: a voxel is inside where the surface winds around it, or where no way leads
//! out without crossing the surface. Triangles that lie inside of the body, as where shells overlap,
//! are no boundary. Pieces with small gaps between them are bridged.

use glam::{DVec3, IVec3};
use rayon::prelude::*;

use super::body_part::only_triangles;
use crate::cage::WindingNumber;
use crate::mesh::{SurfaceQuery, TriangleMesh};
use crate::progress::{Cancelled, Progress};

/// Voxels along the body: at most, and in the first look at how full it is.
const FINEST: f64 = 170.0;
const COARSE: f64 = 56.0;
/// About as many voxels are inside at most.
const MOST_INSIDE: f64 = 60_000.0;
/// Voxels of a block that are decided together where the surface is far.
const BLOCK: i32 = 4;
/// How far beside a triangle, in voxels, to look whether it is inside of the body.
const BESIDE: f64 = 0.1;
/// Gaps up to this share of the body's size are bridged.
const BRIDGE: f64 = 0.05;

/// All offsets to the 26 neighbours of a voxel.
pub(super) fn neighbours() -> impl Iterator<Item = IVec3> {
    (0..27).filter(|&i| i != 13).map(|i| IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1))
}

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
    /// Bounds of the mesh.
    pub(super) low: DVec3,
    pub(super) high: DVec3,
}

const OUTSIDE: u32 = u32::MAX;

impl DistanceField {
    /// Builds the field of a mesh with extent; without voxels where the mesh encloses nothing.
    pub(super) fn new(mesh: &TriangleMesh, progress: &Progress) -> Result<Self, Cancelled> {
        let (low, high) = mesh.bounds();
        let extent = (high - low).max_element();
        let winding = WindingNumber::new(mesh);
        let Ok(surface) = SurfaceQuery::new(mesh) else {
            return Ok(Self::without_voxels(low, high, extent));
        };
        let coarse = Grid::new(low, high, extent / COARSE).fill(mesh, &winding, &surface, progress)?;
        let count = coarse.inside.iter().filter(|&&inside| inside).count() as f64;
        if count == 0.0 {
            // Perhaps only thin; a fine grid decides.
            progress.report(0.2)?;
        }
        let fullest = (MOST_INSIDE / count.max(1.0)).cbrt();
        let cell = (coarse.cell / fullest).max(extent / FINEST);
        progress.report(0.2)?;
        let grid = Grid::new(low, high, cell).fill(mesh, &winding, &surface, progress)?;
        progress.report(0.6)?;
        let mut field = Self::from_grid(&grid, low, high);
        field.keep_pieces(BRIDGE * extent);
        let outer = outer_surface(mesh, &winding, &grid);
        let outer = outer.as_ref().unwrap_or(&surface);
        field.depth = field
            .voxels
            .par_iter()
            .map(|&voxel| outer.closest_point(field.centre(voxel)).map_or(0.0, |found| found.distance))
            .collect();
        progress.report(1.0)?;
        Ok(field)
    }

    fn without_voxels(low: DVec3, high: DVec3, cell: f64) -> Self {
        Self {
            origin: low,
            cell,
            size: IVec3::ZERO,
            ids: Vec::new(),
            voxels: Vec::new(),
            depth: Vec::new(),
            bridges: Vec::new(),
            low,
            high,
        }
    }

    fn from_grid(grid: &Grid, low: DVec3, high: DVec3) -> Self {
        let mut field = Self::without_voxels(low, high, grid.cell);
        (field.origin, field.size) = (grid.origin, grid.size);
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
        if self.voxel_at(point).is_some() && self.depth_at(point) >= depth {
            return point;
        }
        let miss = |id: usize| {
            let lack = (depth - self.depth[id]).max(0.0);
            self.position(id as u32).distance(point) + 3.0 * lack
        };
        let nearest = (0..self.voxels.len()).min_by(|&a, &b| miss(a).total_cmp(&miss(b)));
        nearest.map_or(point, |id| self.position(id as u32))
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

fn index(size: IVec3, place: IVec3) -> usize {
    ((place.z * size.y + place.y) * size.x + place.x) as usize
}

/// A box of voxels around the mesh, with a free layer on all sides.
struct Grid {
    origin: DVec3,
    cell: f64,
    size: IVec3,
    inside: Vec<bool>,
}

impl Grid {
    fn new(low: DVec3, high: DVec3, cell: f64) -> Self {
        // Centred, so that a mirrored mesh has a mirrored grid.
        let half = ((high - low) / (2.0 * cell)).ceil().as_ivec3() + 1;
        let size = half * 2 + 1;
        let origin = (low + high) * 0.5 - size.as_dvec3() * 0.5 * cell;
        Self { origin, cell, size, inside: vec![false; (size.x * size.y * size.z) as usize] }
    }

    fn place(&self, index: usize) -> IVec3 {
        let (x, y) = (self.size.x as usize, self.size.y as usize);
        IVec3::new((index % x) as i32, (index / x % y) as i32, (index / x / y) as i32)
    }

    fn centre(&self, place: IVec3) -> DVec3 {
        self.origin + (place.as_dvec3() + 0.5) * self.cell
    }

    fn contains(&self, place: IVec3) -> bool {
        place.cmpge(IVec3::ZERO).all() && place.cmplt(self.size).all()
    }

    /// Decides which voxels are inside.
    fn fill(
        mut self,
        mesh: &TriangleMesh,
        winding: &WindingNumber,
        surface: &SurfaceQuery,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let blocks = (self.size + (BLOCK - 1)) / BLOCK;
        let far = 3f64.sqrt() * 0.5 * f64::from(BLOCK) * self.cell;
        let decide = |block: i32| {
            let place =
                IVec3::new(block % blocks.x, block / blocks.x % blocks.y, block / blocks.x / blocks.y);
            let first = place * BLOCK;
            let middle = self.origin + (first.as_dvec3() + 0.5 * f64::from(BLOCK)) * self.cell;
            let members = (0..BLOCK.pow(3))
                .map(|i| first + IVec3::new(i % BLOCK, i / BLOCK % BLOCK, i / BLOCK / BLOCK))
                .filter(|&member| self.contains(member));
            let distance = surface.closest_point(middle).map_or(f64::INFINITY, |found| found.distance);
            if distance > far {
                return match winding.is_inside(middle) {
                    true => members.collect(),
                    false => Vec::new(),
                };
            }
            members.filter(|&member| winding.is_inside(self.centre(member))).collect::<Vec<_>>()
        };
        let found: Vec<Vec<IVec3>> =
            (0..blocks.x * blocks.y * blocks.z).into_par_iter().map(decide).collect();
        for place in found.into_iter().flatten() {
            self.inside[index(self.size, place)] = true;
        }
        progress.report(0.4)?;
        let touched = self.touched(mesh);
        self.add_thin(&touched, winding);
        self.add_enclosed(&touched);
        Ok(self)
    }

    /// Voxels that the surface passes through.
    fn touched(&self, mesh: &TriangleMesh) -> Vec<bool> {
        let mut touched = vec![false; self.inside.len()];
        for t in 0..mesh.triangles().len() {
            let [a, b, c] = mesh.corners(t).map(|p| (p - self.origin) / self.cell);
            let longest = (b - a).length().max((c - a).length()).max((c - b).length());
            let steps = (2.0 * longest).ceil().clamp(1.0, 1024.0) as u32;
            for i in 0..=steps {
                for j in 0..=steps - i {
                    let (u, v) = (f64::from(i) / f64::from(steps), f64::from(j) / f64::from(steps));
                    let place = (a + (b - a) * u + (c - a) * v).floor().as_ivec3();
                    if self.contains(place) {
                        touched[index(self.size, place)] = true;
                    }
                }
            }
        }
        touched
    }

    /// Adds voxels on parts that are so thin that they pass between the centres, such as fingers.
    fn add_thin(&mut self, touched: &[bool], winding: &WindingNumber) {
        let is_lonely = |place: IVec3| {
            neighbours().all(|step| {
                let next = place + step;
                !self.contains(next) || !self.inside[index(self.size, next)]
            })
        };
        let corners = || (0..8).map(|i| IVec3::new(i & 1, i >> 1 & 1, i >> 2 & 1).as_dvec3() - 0.5);
        let thin: Vec<usize> = (0..touched.len())
            .into_par_iter()
            .filter(|&i| touched[i] && !self.inside[i] && is_lonely(self.place(i)))
            .filter(|&i| {
                let centre = self.centre(self.place(i));
                corners().any(|corner| winding.is_inside(centre + corner * (0.5 * self.cell)))
            })
            .collect();
        for i in thin {
            self.inside[i] = true;
        }
    }

    /// Adds voxels from which no way leads out without crossing the surface.
    fn add_enclosed(&mut self, touched: &[bool]) {
        let mut reached = touched.to_vec();
        let mut front = vec![IVec3::ZERO];
        reached[0] = true;
        while let Some(place) = front.pop() {
            for step in [IVec3::X, IVec3::Y, IVec3::Z].into_iter().flat_map(|axis| [axis, -axis]) {
                let next = place + step;
                if self.contains(next) && !std::mem::replace(&mut reached[index(self.size, next)], true) {
                    front.push(next);
                }
            }
        }
        for (inside, reached) in self.inside.iter_mut().zip(reached) {
            *inside |= !reached;
        }
    }
}

/// The triangles that have the outside on one side; `None` where there are none.
fn outer_surface(mesh: &TriangleMesh, winding: &WindingNumber, grid: &Grid) -> Option<SurfaceQuery> {
    let step = BESIDE * grid.cell;
    let is_outer: Vec<bool> = (0..mesh.triangles().len())
        .into_par_iter()
        .map(|t| {
            let [a, b, c] = mesh.corners(t);
            let (middle, normal) = ((a + b + c) / 3.0, mesh.area_vector(t).normalize_or_zero());
            [-step, step].iter().any(|&side| !winding.is_inside(middle + normal * side))
        })
        .collect();
    SurfaceQuery::new(&only_triangles(mesh, &is_outer)?).ok()
}
