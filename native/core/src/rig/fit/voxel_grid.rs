//! A grid of voxels around a mesh and which of them are inside of it.

use glam::{DVec3, IVec3};
use rayon::prelude::*;

use crate::cage::WindingNumber;
use crate::mesh::{SurfaceQuery, TriangleMesh};
use crate::progress::{Cancelled, Progress};

/// Voxels of a block that are decided together where the surface is far.
const BLOCK: i32 = 4;
/// On a sheet the winding number is a half, up to rounding.
const LEAST_WINDING: f64 = 0.501;
/// Cavities are at most this share of a body.
const CAVITY: f64 = 0.25;
/// Step off the planes of the grid, in voxels.
const BESIDE_PLANES: DVec3 = DVec3::new(3.7e-4, 6.1e-4, 8.3e-4);

/// All offsets to the 26 neighbours of a voxel.
pub(super) fn neighbours() -> impl Iterator<Item = IVec3> {
    (0..27).filter(|&i| i != 13).map(|i| IVec3::new(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1))
}

/// Whether a surface winds around a point, and not only past it: a point on a sheet is not inside.
pub(super) fn is_inside(winding: &WindingNumber, point: DVec3) -> bool {
    winding.at(point).abs() > LEAST_WINDING
}

/// Number of a grid place.
pub(super) fn index(size: IVec3, place: IVec3) -> usize {
    ((place.z * size.y + place.y) * size.x + place.x) as usize
}

/// A box of voxels around the mesh, with a free layer on all sides.
pub(super) struct VoxelGrid {
    pub(super) origin: DVec3,
    pub(super) cell: f64,
    pub(super) size: IVec3,
    /// Whether each voxel is inside.
    pub(super) inside: Vec<bool>,
}

impl VoxelGrid {
    pub(super) fn new(low: DVec3, high: DVec3, cell: f64) -> Self {
        // Centred, so that a mirrored mesh has a mirrored grid.
        let half = ((high - low) / (2.0 * cell)).ceil().as_ivec3() + 1;
        let size = half * 2 + 1;
        let origin = (low + high) * 0.5 - size.as_dvec3() * 0.5 * cell;
        Self { origin, cell, size, inside: vec![false; (size.x * size.y * size.z) as usize] }
    }

    pub(super) fn place(&self, index: usize) -> IVec3 {
        let (x, y) = (self.size.x as usize, self.size.y as usize);
        IVec3::new((index % x) as i32, (index / x % y) as i32, (index / x / y) as i32)
    }

    fn centre(&self, place: IVec3) -> DVec3 {
        self.origin + (place.as_dvec3() + 0.5) * self.cell
    }

    fn contains(&self, place: IVec3) -> bool {
        place.cmpge(IVec3::ZERO).all() && place.cmplt(self.size).all()
    }

    /// Whether a point of the grid is inside. It is looked at a little beside: surfaces often lie in the
    /// planes of the grid, where edges would count twice.
    fn is_inside(&self, winding: &WindingNumber, point: DVec3) -> bool {
        is_inside(winding, point + BESIDE_PLANES * self.cell)
    }

    /// Decides which voxels are inside.
    pub(super) fn fill(
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
                return match self.is_inside(winding, middle) {
                    true => members.collect(),
                    false => Vec::new(),
                };
            }
            members.filter(|&member| self.is_inside(winding, self.centre(member))).collect::<Vec<_>>()
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
                corners().any(|corner| self.is_inside(winding, centre + corner * (0.5 * self.cell)))
            })
            .collect();
        for i in thin {
            self.inside[i] = true;
        }
    }

    /// Adds voxels from which no way leads out without crossing the surface, where they are too many to be
    /// cavities such as a mouth: then the triangles do not agree on which side is outside.
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
        let enclosed =
            self.inside.iter().zip(&reached).filter(|&(inside, reached)| !inside && !reached).count();
        let wound = self.inside.iter().filter(|&&inside| inside).count();
        if enclosed as f64 <= CAVITY * wound as f64 {
            return;
        }
        for (inside, reached) in self.inside.iter_mut().zip(reached) {
            *inside |= !reached;
        }
    }
}
