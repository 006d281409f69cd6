//! Lattice tetrahedra around any triangle mesh: every cell that the surface touches or whose middle
//! is inside.

use std::collections::{BTreeSet, HashMap};

use glam::DVec3;
use rayon::prelude::*;

use super::{BccLattice, CageError, LatticePoint, TetMesh, WindingNumber};
use crate::mesh::TriangleMesh;

/// Surface samples are at most this share of the cell size apart.
const SAMPLE_SPACING: f64 = 0.3;
/// A cage never has more tetrahedra than this; a lattice that needs more is a wrong cell size.
const LARGEST_CAGE: usize = 2_000_000;
/// Cells across the mean thickness of a mesh when no cell size is given.
const CELLS_ACROSS: f64 = 4.0;
/// Cells across the longest side of a mesh, at most, when no cell size is given.
const CELLS_ALONG: f64 = 80.0;

/// A lattice tetrahedron, as [`BccLattice::locate`] orders its corners.
type Cell = [LatticePoint; 4];

/// Tetrahedra cut out of a lattice, with the way back from lattice points to vertices.
#[derive(Debug, Clone, PartialEq)]
pub struct LatticeCage {
    /// The lattice.
    pub lattice: BccLattice,
    /// Vertex of each lattice point in use.
    pub index_of: HashMap<LatticePoint, u32>,
    /// Vertices and tetrahedra, both in the order of their lattice points.
    pub mesh: TetMesh,
    /// True for vertices at which the cage ends inside the body, because its region ends there.
    pub is_cut: Vec<bool>,
}

/// Whether a triangle takes part in a cage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Membership {
    /// Its cells belong to the cage.
    Inside,
    /// Its cells do not, and where they meet the cage, the cage is cut.
    Border,
    /// It is far away.
    Outside,
}

/// Builds lattice tetrahedra around the surface and through its inside. Without a `cell_size`, the
/// mean thickness of the mesh decides.
///
/// # Errors
/// [`CageError`] for a mesh without triangles or extent, or a cell size that cannot be used.
pub fn tetrahedralize(mesh: &TriangleMesh, cell_size: Option<f64>) -> Result<TetMesh, CageError> {
    let cell_size = cell_size.map_or_else(|| default_cell_size(mesh), Ok)?;
    let (low, high) = mesh.bounds();
    let lattice = BccLattice::new((low + high) * 0.5, cell_size);
    let winding = WindingNumber::new(mesh);
    let everywhere = vec![Membership::Inside; mesh.triangles().len()];
    Ok(LatticeCage::new(mesh, &winding, lattice, &everywhere, &|_| true)?.mesh)
}

/// Cell size that puts about four cells across the mean thickness of the mesh.
///
/// # Errors
/// [`CageError`] for a mesh without triangles or extent.
pub fn default_cell_size(mesh: &TriangleMesh) -> Result<f64, CageError> {
    if mesh.triangles().is_empty() {
        return Err(CageError::NoTriangles);
    }
    let (low, high) = mesh.bounds();
    let longest = (high - low).max_element();
    if !(longest.is_finite() && longest > 0.0) {
        return Err(CageError::NoExtent);
    }
    let middle = (low + high) * 0.5;
    let volume: f64 = (0..mesh.triangles().len())
        .map(|t| {
            let [a, b, c] = mesh.corners(t).map(|p| p - middle);
            a.dot(b.cross(c)) / 6.0
        })
        .sum();
    // A cylinder's thickness is four times its volume over its area.
    let thickness = 4.0 * volume.abs() / mesh.area().max(f64::MIN_POSITIVE);
    Ok((thickness / CELLS_ACROSS).max(longest / CELLS_ALONG))
}

impl LatticeCage {
    /// Cuts the cage of a part of a surface out of a lattice: the cells of its `Inside` triangles,
    /// and those inside the surface as far as `region` (a test of positions) goes.
    ///
    /// # Errors
    /// [`CageError`] for a cell size that cannot be used.
    pub fn new(
        mesh: &TriangleMesh,
        winding: &WindingNumber,
        lattice: BccLattice,
        triangles: &[Membership],
        region: &(dyn Fn(DVec3) -> bool + Sync),
    ) -> Result<Self, CageError> {
        let cell_size = lattice.cell_size();
        let (low, high) = mesh.bounds();
        // Lattice coordinates are kept in i32, with room for neighbours.
        let reach = (high - low).max_element() / cell_size;
        if !(cell_size.is_finite() && cell_size > 0.0) {
            return Err(CageError::CellSize(cell_size));
        }
        let check = |count: f64| match count <= LARGEST_CAGE as f64 {
            true => Ok(()),
            false => Err(CageError::TooManyCells { cell_size, limit: LARGEST_CAGE }),
        };
        check(reach)?;
        let mut kept: BTreeSet<Cell> = BTreeSet::new();
        let mut left_out: BTreeSet<Cell> = BTreeSet::new();
        for (triangle, &membership) in triangles.iter().enumerate() {
            let cells = match membership {
                Membership::Inside => &mut kept,
                Membership::Border => &mut left_out,
                Membership::Outside => continue,
            };
            let corners = mesh.corners(triangle);
            check(mesh.area_vector(triangle).length() / cell_size.powi(2))?;
            cells.extend(samples(corners, SAMPLE_SPACING * cell_size).map(|sample| lattice.locate(sample).0));
            check(cells.len() as f64)?;
        }
        let mut known = kept.clone();
        let mut front = Vec::from_iter(kept.iter().copied());
        while !front.is_empty() {
            let candidates: BTreeSet<Cell> = front
                .iter()
                .flat_map(|&corners| lattice.face_neighbours(corners))
                .map(|(_, corners)| corners)
                .filter(|corners| known.insert(*corners))
                .collect();
            // Some(true): inside and in the region; Some(false): inside, but beyond the region.
            let verdicts: Vec<(Cell, Option<bool>)> = Vec::from_iter(candidates)
                .into_par_iter()
                .map(|cell| {
                    let middle = cell.iter().map(|&c| lattice.position(c)).sum::<DVec3>() * 0.25;
                    (cell, winding.is_inside(middle).then(|| region(middle)))
                })
                .collect();
            front = verdicts.iter().filter(|v| v.1 == Some(true)).map(|v| v.0).collect();
            left_out.extend(verdicts.iter().filter(|v| v.1 == Some(false)).map(|v| v.0));
            kept.extend(&front);
            check(known.len() as f64)?;
        }
        Ok(Self::from_cells(lattice, &kept, &left_out))
    }

    fn from_cells(lattice: BccLattice, cells: &BTreeSet<Cell>, left_out: &BTreeSet<Cell>) -> Self {
        // Neighbours in space become neighbours in memory.
        let mut points: Vec<LatticePoint> = cells.iter().flatten().copied().collect();
        points.sort_by_key(|&[x, y, z]| (z.div_euclid(2), y.div_euclid(2), x));
        points.dedup();
        let index_of: HashMap<LatticePoint, u32> = points.iter().copied().zip(0..).collect();
        let mut tetrahedra: Vec<[u32; 4]> = cells.iter().map(|t| t.map(|c| index_of[&c])).collect();
        tetrahedra.sort_by_key(|t| (t.iter().copied().min(), *t));
        let vertices = points.iter().map(|&p| lattice.position(p)).collect();
        let mut is_cut = vec![false; points.len()];
        for cell in left_out.difference(cells) {
            for index in cell.iter().filter_map(|point| index_of.get(point)) {
                is_cut[*index as usize] = true;
            }
        }
        Self { lattice, index_of, mesh: TetMesh::new(vertices, tetrahedra), is_cut }
    }
}

/// Points of a triangle, corners included, about `spacing` apart.
fn samples([a, b, c]: [DVec3; 3], spacing: f64) -> impl Iterator<Item = DVec3> {
    let longest = (b - a).length().max((c - a).length()).max((c - b).length());
    let steps = (longest / spacing).ceil().clamp(1.0, 4096.0) as u32;
    (0..=steps).flat_map(move |i| {
        (0..=steps - i).map(move |j| {
            let (u, v) = (f64::from(i) / f64::from(steps), f64::from(j) / f64::from(steps));
            a + (b - a) * u + (c - a) * v
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cage::embed;

    /// A box of 2 × 1 × 1 without the quads in `missing`.
    fn cuboid(missing: &[usize]) -> TriangleMesh {
        let vertices = (0..8u32)
            .map(|i| DVec3::new(f64::from(i & 1) * 2.0, f64::from(i >> 1 & 1), f64::from(i >> 2 & 1)));
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let kept = quads.iter().enumerate().filter(|(i, _)| !missing.contains(i));
        let triangles = kept.flat_map(|(_, &[a, b, c, d])| [[a, b, c], [a, c, d]]);
        TriangleMesh::new(vertices.collect(), triangles.collect()).unwrap()
    }

    #[test]
    fn every_tetrahedron_is_positive_and_the_solid_is_covered() {
        for missing in [&[][..], &[1]] {
            let mesh = cuboid(missing);
            let cage = tetrahedralize(&mesh, Some(0.25)).unwrap();
            let cell = 0.25f64.powi(3) / 12.0;
            let volumes: Vec<f64> = (0..cage.tetrahedra().len()).map(|t| cage.volume(t)).collect();
            assert!(volumes.iter().all(|v| (v - cell).abs() < 1e-12));
            let total: f64 = volumes.iter().sum();
            // At least the solid, at most a layer of two half cells around it.
            assert!((1.9..2.5 * 1.5 * 1.5).contains(&total), "{total}");
        }
    }

    #[test]
    fn every_surface_vertex_is_embedded() {
        let mesh = cuboid(&[]);
        let lattice = BccLattice::new(DVec3::splat(0.03), 0.3);
        let everywhere = vec![Membership::Inside; mesh.triangles().len()];
        let cage =
            LatticeCage::new(&mesh, &WindingNumber::new(&mesh), lattice, &everywhere, &|_| true).unwrap();
        assert!(cage.is_cut.iter().all(|cut| !cut));
        for &vertex in mesh.vertices() {
            let embedding = embed(&lattice, &cage.index_of, vertex).unwrap();
            let corners = embedding.corners.map(|c| cage.mesh.vertices()[c as usize]);
            let back: DVec3 = corners.iter().zip(embedding.barycentric).map(|(&c, b)| c * b).sum();
            assert!(back.distance(vertex) < 1e-12);
            let sorted = |mut t: [u32; 4]| {
                t.sort_unstable();
                t
            };
            assert!(cage.mesh.tetrahedra().iter().any(|t| sorted(*t) == sorted(embedding.corners)));
        }
    }

    #[test]
    fn a_region_cuts_the_cage_where_it_ends() {
        let mesh = cuboid(&[]);
        let lattice = BccLattice::new(DVec3::ZERO, 0.25);
        let left: Vec<Membership> = (0..mesh.triangles().len())
            .map(|t| match mesh.corners(t).iter().any(|p| p.x == 0.0) {
                true => Membership::Inside,
                false => Membership::Border,
            })
            .collect();
        let cage =
            LatticeCage::new(&mesh, &WindingNumber::new(&mesh), lattice, &left, &|p| p.x < 1.0).unwrap();
        let cut = || cage.mesh.vertices().iter().zip(&cage.is_cut).filter(|(_, cut)| **cut);
        assert!(cut().count() > 10);
        assert!(cut().all(|(p, _)| p.x > 0.5), "the closed end is not cut");
    }

    #[test]
    fn what_cannot_be_filled_is_refused() {
        let points = TriangleMesh::new(vec![DVec3::ZERO, DVec3::ONE], vec![]).unwrap();
        assert_eq!(tetrahedralize(&points, None), Err(CageError::NoTriangles));
        let point = TriangleMesh::new(vec![DVec3::ONE; 3], vec![[0, 1, 2]]).unwrap();
        assert_eq!(tetrahedralize(&point, None), Err(CageError::NoExtent));
        let mesh = cuboid(&[]);
        assert_eq!(tetrahedralize(&mesh, Some(0.0)), Err(CageError::CellSize(0.0)));
        assert!(matches!(tetrahedralize(&mesh, Some(f64::NAN)), Err(CageError::CellSize(_))));
        for size in [1e-3, 1e-12, f64::MIN_POSITIVE] {
            assert!(matches!(tetrahedralize(&mesh, Some(size)), Err(CageError::TooManyCells { .. })));
        }
        assert!(tetrahedralize(&mesh, Some(50.0)).is_ok(), "one coarse cell around everything");
    }

    #[test]
    fn the_default_cell_size_follows_the_thickness() {
        let size = default_cell_size(&cuboid(&[])).unwrap();
        assert!((0.1..0.3).contains(&size), "{size}");
    }
}
