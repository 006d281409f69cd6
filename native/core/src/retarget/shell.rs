//! How a surface lies in space: which side is outside, and how thick the body is there.
//!
//! Exports flip triangles, mirrored objects turn inside out, and cloth has no inside at all. The
//! winding of a piece is therefore judged by rays: straight inward they meet the other side of the
//! body, straight outward they mostly meet nothing.

use std::collections::HashSet;

use glam::DVec3;

use crate::mesh::{Adjacency, ClosestPoint, MeshError, SurfaceQuery, TriangleMesh, weld_seams};
use crate::parallel::map_indices;
use crate::progress::{Cancelled, Progress};

/// A piece is thin where its median thickness is below this share of the extent.
const THIN: f64 = 0.01;
/// Rays tell inside from outside when one side has this many more hits than the other, as a share
/// of the piece.
const DECIDED: f64 = 0.1;
/// Where rays start off the surface, as a share of the extent.
const OFFSET: f64 = 1e-4;

/// Outside and thickness of a surface at its vertices.
#[derive(Debug, Clone, PartialEq)]
pub struct Shell {
    /// Outward unit normals (V); zero at a vertex without area.
    pub normals: Vec<DVec3>,
    /// Distance to the first surface straight inward (V), in the mesh's unit; infinite for none
    /// and for thin shells, whose thickness says nothing about the body.
    pub thickness: Vec<f64>,
    /// Whether both sides of the surface count as outside (V): thin shells, and sheets.
    pub two_sided: Vec<bool>,
    /// −1 where the winding faces inward, else 1 (V).
    pub side: Vec<f64>,
    /// Length of the surface along its longest axis, in the mesh's unit.
    pub extent: f64,
    stands_for: Vec<u32>,
    open_edges: HashSet<[u32; 2]>,
    open_vertices: Vec<bool>,
}

impl Shell {
    /// Looks along two rays from every vertex. `query` belongs to the same mesh.
    ///
    /// # Errors
    /// [`Cancelled`] when `progress` was cancelled.
    pub fn new(mesh: &TriangleMesh, query: &SurfaceQuery, progress: &Progress) -> Result<Self, Cancelled> {
        let stands_for = weld_seams(mesh);
        let triangles: Vec<[u32; 3]> =
            mesh.triangles().iter().map(|t| t.map(|v| stands_for[v as usize])).collect();
        let welded = TriangleMesh::new(mesh.vertices().to_vec(), triangles).unwrap_or_else(|_| mesh.clone());
        let topology = welded.topology();
        let component = topology.components();
        let extent = extent(mesh);
        let mut normals = outward(mesh, &stands_for, None);
        let look = |v: usize, direction: DVec3| -> Option<(f64, bool)> {
            let start = mesh.vertices()[v] + direction * (OFFSET * extent);
            let hit = query.cast_ray(start, direction)?;
            let corner = welded.triangles()[hit.triangle as usize][0] as usize;
            let own = component[corner] == component[stands_for[v] as usize];
            Some((hit.distance + OFFSET * extent, own))
        };
        let rays: Vec<[Option<(f64, bool)>; 2]> =
            map_indices(mesh.vertex_count(), progress, [0.0, 0.9], |v, (): &mut ()| {
                [look(v, -normals[v]), look(v, normals[v])]
            })?;
        let mut areas = vec![0.0; mesh.vertex_count()];
        for (t, triangle) in welded.triangles().iter().enumerate() {
            triangle.iter().for_each(|&v| areas[v as usize] += welded.area_vector(t).length());
        }
        let mut votes = vec![[0.0; 3]; topology.component_count()];
        for (v, area) in areas.iter().enumerate() {
            let vote = &mut votes[component[v] as usize];
            vote[2] += area;
            for (side, ray) in rays[v].iter().enumerate() {
                vote[side] += if ray.is_some_and(|(_, own)| own) { *area } else { 0.0 };
            }
        }
        let of = |v: usize| component[stands_for[v] as usize] as usize;
        let flipped: Vec<bool> = votes.iter().map(|[inner, outer, _]| outer > inner).collect();
        let side = (0..mesh.vertex_count()).map(|v| if flipped[of(v)] { -1.0 } else { 1.0 }).collect();
        normals.iter_mut().enumerate().filter(|(v, _)| flipped[of(*v)]).for_each(|(_, n)| *n = -*n);
        let inward: Vec<f64> = rays
            .iter()
            .enumerate()
            .map(|(v, ray)| ray[usize::from(flipped[of(v)])].map_or(f64::INFINITY, |(distance, _)| distance))
            .collect();
        let adjacency = Adjacency::new(mesh.vertex_count(), &topology);
        let mut thickness: Vec<f64> = (0..mesh.vertex_count())
            .map(|v| {
                let own = stands_for[v] as usize;
                let ring = adjacency.neighbours(own).iter().map(|&n| inward[n as usize]);
                median(ring.chain([inward[own]]).collect())
            })
            .collect();
        let mut by_component = vec![Vec::new(); topology.component_count()];
        (0..mesh.vertex_count()).for_each(|v| by_component[of(v)].push(thickness[v]));
        let ambiguous: Vec<bool> = by_component
            .into_iter()
            .zip(&votes)
            .map(|(values, [inner, outer, total])| {
                (inner - outer).abs() <= DECIDED * total || median(values) < THIN * extent
            })
            .collect();
        let two_sided: Vec<bool> = (0..mesh.vertex_count()).map(|v| ambiguous[of(v)]).collect();
        thickness.iter_mut().zip(&two_sided).filter(|(_, both)| **both).for_each(|(t, _)| *t = f64::INFINITY);
        let boundary = topology.boundary_edges();
        let mut open_vertices = vec![false; mesh.vertex_count()];
        boundary.iter().flatten().for_each(|&v| open_vertices[v as usize] = true);
        let open_edges = boundary.into_iter().collect();
        progress.report(1.0)?;
        Ok(Self { normals, thickness, two_sided, side, extent, stands_for, open_edges, open_vertices })
    }

    /// Vertex that stands for each vertex once seams are closed (V).
    pub(super) fn stands_for(&self) -> &[u32] {
        &self.stands_for
    }

    /// The surface with its seams closed.
    pub(super) fn welded(&self, mesh: &TriangleMesh) -> Result<TriangleMesh, MeshError> {
        let triangles = mesh.triangles().iter().map(|t| t.map(|v| self.stands_for[v as usize])).collect();
        TriangleMesh::new(mesh.vertices().to_vec(), triangles)
    }

    /// Outward normals once the vertices have moved.
    #[must_use]
    pub fn normals_of(&self, moved: &TriangleMesh) -> Vec<DVec3> {
        outward(moved, &self.stands_for, Some(&self.side))
    }

    /// The same surface once the vertices have moved.
    pub(super) fn moved(&self, to: &TriangleMesh) -> Self {
        Self { normals: self.normals_of(to), ..self.clone() }
    }

    /// For each of some vertices the triangles that meet there once seams are closed, ascending.
    pub(super) fn triangles_around(
        &self,
        mesh: &TriangleMesh,
        vertices: impl Iterator<Item = u32>,
    ) -> Vec<Vec<u32>> {
        let mut around = vec![Vec::new(); mesh.vertex_count()];
        for (t, triangle) in (0u32..).zip(mesh.triangles()) {
            triangle.iter().for_each(|&v| around[self.stands_for[v as usize] as usize].push(t));
        }
        vertices.map(|v| around[self.stands_for[v as usize] as usize].clone()).collect()
    }

    /// Outward normal of one vertex once the vertices have moved; `around` are the triangles there.
    pub(super) fn normal_of(
        &self,
        mesh: &TriangleMesh,
        moved: &[DVec3],
        vertex: u32,
        around: &[u32],
    ) -> DVec3 {
        let normal = |&t: &u32| {
            let [a, b, c] = mesh.triangles()[t as usize].map(|v| moved[v as usize]);
            (b - a).cross(c - a)
        };
        around.iter().map(normal).sum::<DVec3>().normalize_or_zero() * self.side[vertex as usize]
    }

    /// Outward normal at a point of the surface, and whether both sides count as outside there.
    #[must_use]
    pub fn normal_at(&self, mesh: &TriangleMesh, point: &ClosestPoint) -> (DVec3, bool) {
        let corners = mesh.triangles()[point.triangle as usize];
        let normal = corners.iter().zip(point.barycentric).map(|(&v, b)| self.normals[v as usize] * b);
        let normal = normal.sum::<DVec3>().normalize_or_zero();
        (normal, self.two_sided[corners[0] as usize])
    }

    /// Thickness at a point of the surface.
    #[must_use]
    pub fn thickness_at(&self, mesh: &TriangleMesh, point: &ClosestPoint) -> f64 {
        let corners = mesh.triangles()[point.triangle as usize];
        let largest = (0..3).rev().max_by(|&a, &b| point.barycentric[a].total_cmp(&point.barycentric[b]));
        self.thickness[corners[largest.unwrap_or(0)] as usize]
    }

    /// Whether a point lies on an open edge of the surface.
    #[must_use]
    pub fn is_on_open_edge(&self, mesh: &TriangleMesh, point: &ClosestPoint) -> bool {
        const ON: f64 = 1e-6;
        let corners = mesh.triangles()[point.triangle as usize].map(|v| self.stands_for[v as usize]);
        let touched: Vec<u32> =
            corners.iter().zip(point.barycentric).filter(|(_, b)| *b > ON).map(|(&v, _)| v).collect();
        match touched[..] {
            [v] => self.open_vertices[v as usize],
            [a, b] => self.open_edges.contains(&[a.min(b), a.max(b)]),
            _ => false,
        }
    }
}

/// A tiny step off a place, as small as its unit `extent` is large. Between two walls that are
/// equally near, as on the mirror plane of a body, it decides by the place and not by the order of
/// the triangles.
pub(super) fn tie_break(extent: f64) -> DVec3 {
    DVec3::new(0.48, 0.64, 0.6) * (1e-8 * extent)
}

/// Length of a surface along its longest axis: that of a rod with the same second moment. Unlike
/// a bounding box it neither depends on the axes nor on a single vertex.
#[must_use]
pub fn extent(mesh: &TriangleMesh) -> f64 {
    let area = |t: usize| mesh.area_vector(t).length();
    let centre = |t: usize| mesh.corners(t).into_iter().sum::<DVec3>() / 3.0;
    let count = mesh.triangles().len();
    let total: f64 = (0..count).map(area).sum();
    if total <= 0.0 {
        let (low, high) = mesh.bounds();
        return low.distance(high);
    }
    let mean = (0..count).map(|t| centre(t) * area(t)).sum::<DVec3>() / total;
    let mut moment = nalgebra::Matrix3::<f64>::zeros();
    for t in 0..count {
        let x = (centre(t) - mean).to_array();
        moment += nalgebra::Matrix3::from_fn(|row, column| x[row] * x[column] * area(t) / total);
    }
    (12.0 * moment.symmetric_eigenvalues().max()).sqrt()
}

/// Area-weighted unit normals; vertices of a closed seam share theirs.
fn outward(mesh: &TriangleMesh, stands_for: &[u32], side: Option<&[f64]>) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; mesh.vertex_count()];
    for (t, triangle) in mesh.triangles().iter().enumerate() {
        let normal = mesh.area_vector(t);
        triangle.iter().for_each(|&v| sums[stands_for[v as usize] as usize] += normal);
    }
    let sign = |v: usize| side.map_or(1.0, |side| side[v]);
    (0..mesh.vertex_count()).map(|v| sums[stands_for[v] as usize].normalize_or_zero() * sign(v)).collect()
}

/// The middle value; the upper one of two.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::INFINITY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::test_surfaces::{grid, icosphere, joined, mapped, similarity, tube};

    fn shell(mesh: &TriangleMesh) -> Shell {
        Shell::new(mesh, &SurfaceQuery::new(mesh).unwrap(), &Progress::new()).unwrap()
    }

    fn inside_out(mesh: &TriangleMesh) -> TriangleMesh {
        let flipped = mesh.triangles().iter().map(|&[a, b, c]| [a, c, b]).collect();
        TriangleMesh::new(mesh.vertices().to_vec(), flipped).unwrap()
    }

    #[test]
    fn the_outside_does_not_depend_on_the_winding() {
        for mesh in [icosphere(2), tube(0.3, 2.0, 24, 30)] {
            for mesh in [mesh.clone(), inside_out(&mesh)] {
                let shell = shell(&mesh);
                let outward = |(n, p): (&DVec3, &DVec3)| n.dot(DVec3::new(p.x, p.y, 0.0)) >= -0.1;
                assert!(shell.normals.iter().zip(mesh.vertices()).all(outward));
                assert!(shell.two_sided.iter().all(|two_sided| !two_sided));
            }
        }
    }

    #[test]
    fn thickness_of_a_sphere_is_its_diameter() {
        let shell = shell(&icosphere(3));
        assert!(shell.thickness.iter().all(|t| (t - 2.0).abs() < 0.02));
    }

    #[test]
    fn sheets_and_thin_shells_have_two_outsides() {
        assert!(shell(&grid(8)).two_sided.iter().all(|two_sided| *two_sided));
        let inner = inside_out(&mapped(&icosphere(3), |p| p * 0.995));
        let hollow = joined(&icosphere(3), &inner);
        assert!(shell(&hollow).two_sided[..642].iter().all(|two_sided| *two_sided));
    }

    #[test]
    fn the_extent_of_a_long_tube_is_its_length() {
        let long = tube(0.05, 2.0, 12, 80);
        assert!((extent(&long) - 2.0).abs() < 0.02);
        let moved = mapped(&long, |p| similarity(10.0).transform_point3(p));
        assert!((extent(&moved) / extent(&long) - 10.0).abs() < 1e-9);
    }

    #[test]
    fn open_edges_are_known() {
        let grid = grid(4);
        let (query, shell) = (SurfaceQuery::new(&grid).unwrap(), shell(&grid));
        let closest = |x, y| query.closest_point(DVec3::new(x, y, 0.3)).unwrap();
        assert!(shell.is_on_open_edge(&grid, &closest(0.4, -1.0)));
        assert!(shell.is_on_open_edge(&grid, &closest(3.0, 3.0)));
        assert!(!shell.is_on_open_edge(&grid, &closest(0.4, 0.3)));
        assert!(!shell.is_on_open_edge(&grid, &closest(0.5, 0.5)));
    }
}
