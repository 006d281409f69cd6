//! Joint areas: where two bones blend, how thick the limb is there, and so which cell size its cage
//! needs.

use std::collections::BTreeSet;

use glam::DVec3;

use crate::mesh::TriangleMesh;
use crate::rig::{Skeleton, distance_to_segment};
use crate::skinning::SkinWeights;

/// A vertex belongs to the blend of a joint while its share of the bones below is within this of
/// neither 0 nor 1.
const BLEND: f32 = 0.1;
/// Cells across the radius of a limb.
const CELLS_PER_RADIUS: f64 = 1.25;
/// Joints whose cell sizes differ by at most this factor may share a cage.
const SHARED_CELL_RATIO: f64 = 4.0;

/// Tetrahedra in a cube of the lattice.
const TETRAHEDRA_PER_CELL: f64 = 12.0;
/// Estimated tetrahedra of all patches, at most, while cell sizes are chosen here: more cannot be
/// solved while animating.
pub(super) const MOST_TETRAHEDRA: f64 = 64_000.0;
/// Estimated tetrahedra of one patch, at most: as many as one core solves while animating. The fingers and the
/// palm of a hand, the thinnest limbs on one of the broadest, would take half of those of a body.
const MOST_OF_PATCH: f64 = 12_000.0;
/// Growth of the finest cells while there are more.
const COARSER: f64 = 1.1;
/// Growth of the cells of a patch while it has more than its part.
const COARSER_PATCH: f64 = 1.02;

/// The joint at the head of a bone that has a parent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointArea {
    /// The bone below the joint.
    pub bone: u32,
    /// The bone above it.
    pub parent: u32,
    /// Rest position of the joint.
    pub centre: DVec3,
    /// Median distance of the blending surface from the two bones.
    pub radius: f64,
    /// Cage that the area belongs to.
    pub patch: u32,
}

/// All joint areas, and each vertex's share of the bones below each joint.
#[derive(Debug, Clone)]
pub struct JointAreas {
    /// Areas in the order of their bones.
    pub areas: Vec<JointArea>,
    /// Cell size of each patch.
    pub cell_sizes: Vec<f64>,
    /// Tetrahedra of each patch where its joints are in limbs of their thickness, about; empty where the
    /// cell size was asked for.
    pub expected: Vec<f64>,
    /// Area of each bone.
    area_of_bone: Vec<Option<u32>>,
    /// Entries `(bone, sum of the weights of the bone and all below)` of each vertex, bones ascending.
    shares: Vec<Vec<(u32, f32)>>,
    /// Area that each vertex counts to.
    pub home: Vec<Option<u32>>,
}

impl JointAreas {
    /// Finds the joints at which the surface blends. `weights` are normalised.
    #[must_use]
    pub fn new(
        mesh: &TriangleMesh,
        skeleton: &Skeleton,
        weights: &SkinWeights,
        cell_size: Option<f64>,
    ) -> Self {
        let shares = shares(skeleton, weights);
        let edges = mean_edge_lengths(mesh);
        let mut samples: Vec<Vec<(f64, f64)>> = vec![Vec::new(); skeleton.bone_count()];
        for (vertex, row) in shares.iter().enumerate() {
            for &(bone, share) in row {
                if let Some(parent) = skeleton.parents()[bone as usize]
                    && (BLEND..=1.0 - BLEND).contains(&share)
                {
                    let distance = limb_distance(skeleton, parent, bone, mesh.vertices()[vertex]);
                    samples[bone as usize].push((distance, edges[vertex]));
                }
            }
        }
        let mut areas = Vec::new();
        let mut area_of_bone = vec![None; skeleton.bone_count()];
        for (bone, samples) in samples.iter().enumerate() {
            let (Some(parent), false) = (skeleton.parents()[bone], samples.is_empty()) else { continue };
            // A limb thinner than the mesh is fine, or a blend right on the bone, has no thickness
            // that finer cells could resolve.
            let radius = median(samples.iter().map(|s| s.0)).max(median(samples.iter().map(|s| s.1)));
            if radius > 0.0 {
                area_of_bone[bone] = Some(areas.len() as u32);
                let centre = skeleton.heads()[bone];
                areas.push(JointArea { bone: bone as u32, parent, centre, radius, patch: 0 });
            }
        }
        let mut result = Self {
            areas,
            cell_sizes: Vec::new(),
            expected: Vec::new(),
            area_of_bone,
            shares,
            home: Vec::new(),
        };
        result.home =
            (0..mesh.vertex_count()).map(|v| result.home_of(v, mesh.vertices()[v], weights)).collect();
        result.group(mesh, cell_size);
        result
    }

    #[cfg(test)]
    pub(super) fn from_parts(areas: Vec<JointArea>, cell_sizes: Vec<f64>, home: Vec<Option<u32>>) -> Self {
        Self { areas, cell_sizes, expected: Vec::new(), area_of_bone: Vec::new(), shares: Vec::new(), home }
    }

    /// Share of a bone and all bones below it in a vertex's weights.
    #[must_use]
    pub fn share(&self, vertex: usize, bone: u32) -> f32 {
        let row = &self.shares[vertex];
        row.binary_search_by_key(&bone, |entry| entry.0).map_or(0.0, |i| row[i].1)
    }

    /// The joint that blends most at a vertex, or else, relative to its radius, the nearest joint
    /// of the bones that move it.
    fn home_of(&self, vertex: usize, position: DVec3, weights: &SkinWeights) -> Option<u32> {
        let blending = self.shares[vertex]
            .iter()
            .filter_map(|&(bone, share)| Some((self.area_of_bone[bone as usize]?, share.min(1.0 - share))))
            .filter(|&(_, blend)| blend >= 0.5 * BLEND)
            .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        if let Some((area, _)) = blending {
            return Some(area);
        }
        let bones = weights.row(vertex).0;
        (0..)
            .zip(&self.areas)
            .filter(|(_, area)| bones.contains(&area.bone) || bones.contains(&area.parent))
            .map(|(index, area)| (index, position.distance(area.centre) / area.radius))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(index, _)| index)
    }

    /// Gathers areas that touch and need similar cells into patches.
    fn group(&mut self, mesh: &TriangleMesh, cell_size: Option<f64>) {
        let count = self.areas.len();
        if let Some(size) = cell_size {
            self.cell_sizes = vec![size; count.min(1)];
            return;
        }
        let ideal: Vec<f64> = self.areas.iter().map(|area| area.radius / CELLS_PER_RADIUS).collect();
        let mut contact = BTreeSet::new();
        for &([u, v], _) in mesh.topology().edges() {
            if let (Some(a), Some(b)) = (self.home[u as usize], self.home[v as usize])
                && a != b
            {
                contact.insert((a.min(b), a.max(b)));
            }
        }
        // The most alike first.
        let ratio = |&(a, b): &(u32, u32)| {
            let (a, b) = (ideal[a as usize], ideal[b as usize]);
            a.max(b) / a.min(b)
        };
        let mut pairs = Vec::from_iter(contact);
        pairs.sort_by(|a, b| ratio(a).total_cmp(&ratio(b)).then(a.cmp(b)));
        let mut group: Vec<u32> = (0..count as u32).collect();
        let mut range: Vec<(f64, f64)> = ideal.iter().map(|&h| (h, h)).collect();
        for (a, b) in pairs {
            let (a, b) = (group[a as usize], group[b as usize]);
            let (low, high) =
                (range[a as usize].0.min(range[b as usize].0), range[a as usize].1.max(range[b as usize].1));
            if a != b && high <= SHARED_CELL_RATIO * low {
                let (into, from) = (a.min(b), a.max(b));
                group.iter_mut().filter(|g| **g == from).for_each(|g| *g = into);
                range[into as usize] = (low, high);
            }
        }
        let mut patch_of_group = vec![None; count];
        for (area, &group) in self.areas.iter_mut().zip(&group) {
            let (low, high) = range[group as usize];
            let patch = *patch_of_group[group as usize].get_or_insert_with(|| {
                self.cell_sizes.push(low * (high / low).cbrt());
                self.cell_sizes.len() as u32 - 1
            });
            area.patch = patch;
        }
        self.limit(mesh);
    }

    /// Lets cells grow until each patch has an affordable number, and then the finest ones until all patches
    /// together have.
    fn limit(&mut self, mesh: &TriangleMesh) {
        // Volume of a patch from its surface and the radius of its limbs, and a layer of cells.
        let mut solids = vec![(0.0, 0.0); self.cell_sizes.len()];
        for (t, triangle) in mesh.triangles().iter().enumerate() {
            if let Some(home) = triangle.iter().find_map(|&v| self.home[v as usize]) {
                let area = &self.areas[home as usize];
                let surface = 0.5 * mesh.area_vector(t).length();
                let (volume, total) = &mut solids[area.patch as usize];
                *volume += 0.5 * surface * area.radius;
                *total += surface;
            }
        }
        let filling = |(&(v, a), h): (&(f64, f64), f64)| TETRAHEDRA_PER_CELL * (v + a * h) / h.powi(3);
        for (&solid, size) in solids.iter().zip(&mut self.cell_sizes) {
            while filling((&solid, *size)) > MOST_OF_PATCH {
                *size *= COARSER_PATCH;
            }
        }
        let tetrahedra = |finest: f64| -> f64 {
            let sizes = self.cell_sizes.iter().map(|size| size.max(finest));
            solids.iter().zip(sizes).map(filling).sum()
        };
        let mut finest = self.cell_sizes.iter().copied().fold(f64::INFINITY, f64::min);
        while finest.is_finite() && tetrahedra(finest) > MOST_TETRAHEDRA {
            finest *= COARSER;
        }
        self.cell_sizes.iter_mut().for_each(|size| *size = size.max(finest));
        self.expected = solids.iter().zip(self.cell_sizes.iter().copied()).map(filling).collect();
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Mean length of the edges at each vertex (V), 0 for a loose one.
fn mean_edge_lengths(mesh: &TriangleMesh) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0f64); mesh.vertex_count()];
    for &([a, b], _) in mesh.topology().edges() {
        let length = mesh.vertices()[a as usize].distance(mesh.vertices()[b as usize]);
        for v in [a, b] {
            sums[v as usize].0 += length;
            sums[v as usize].1 += 1.0;
        }
    }
    sums.into_iter().map(|(sum, count)| sum / count.max(1.0)).collect()
}

/// Sums of weights over every bone's descendants, for each vertex.
fn shares(skeleton: &Skeleton, weights: &SkinWeights) -> Vec<Vec<(u32, f32)>> {
    let mut sums = vec![0.0f32; skeleton.bone_count()];
    (0..weights.vertex_count())
        .map(|vertex| {
            let mut touched = Vec::new();
            for (bone, weight) in weights.entries(vertex) {
                let mut current = Some(bone);
                while let Some(bone) = current {
                    if sums[bone as usize] == 0.0 {
                        touched.push(bone);
                    }
                    sums[bone as usize] += weight;
                    current = skeleton.parents()[bone as usize];
                }
            }
            touched.sort_unstable();
            touched.into_iter().map(|bone| (bone, std::mem::take(&mut sums[bone as usize]))).collect()
        })
        .collect()
}

/// Distance from the two bones that meet at the head of `bone`.
fn limb_distance(skeleton: &Skeleton, parent: u32, bone: u32, position: DVec3) -> f64 {
    let (heads, tails) = (skeleton.heads(), skeleton.tails());
    let joint = heads[bone as usize];
    distance_to_segment(position, heads[parent as usize], joint).min(distance_to_segment(
        position,
        joint,
        tails[bone as usize],
    ))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const SIDES: u32 = 12;

    /// A prism of radius 1 along x from −6 to 6 with a ring at every half, bones meeting at −2, 2.
    pub(in crate::pbd) fn prism(radius: impl Fn(f64) -> f64) -> (TriangleMesh, Skeleton, SkinWeights) {
        let xs: Vec<f64> = (-12..=12).map(|i| f64::from(i) * 0.5).collect();
        let around = (0..SIDES).map(|k| std::f64::consts::TAU * f64::from(k) / f64::from(SIDES));
        let circle: Vec<DVec3> = around.map(|angle| DVec3::new(0.0, angle.cos(), angle.sin())).collect();
        let vertices = xs.iter().flat_map(|&x| circle.iter().map(move |&p| (x, p)));
        let vertices = vertices.map(|(x, p)| DVec3::X * x + p * radius(x));
        let triangles = (0..xs.len() as u32 - 1).flat_map(|i| {
            (0..SIDES).flat_map(move |k| {
                let (a, b) = (SIDES * i + k, SIDES * i + (k + 1) % SIDES);
                [[a, b, b + SIDES], [a, b + SIDES, a + SIDES]]
            })
        });
        let mesh = TriangleMesh::new(vertices.collect(), triangles.collect()).unwrap();
        let heads = [-6.0, -2.0, 2.0].map(|x| DVec3::X * x).to_vec();
        let tails = [-2.0, 2.0, 6.0].map(|x| DVec3::X * x).to_vec();
        let skeleton = Skeleton::new(heads, tails, &[-1, 0, 1], None).unwrap();
        let ramp = |x: f64| (x + 0.5).clamp(0.0, 1.0);
        let entries = xs.iter().enumerate().flat_map(|(ring, &x)| {
            let (second, third) = (ramp((x + 2.0) / 2.0), ramp((x - 2.0) / 2.0));
            let row = [1.0 - second, second - third, third];
            (0..SIDES as usize).flat_map(move |k| {
                let vertex = SIDES as usize * ring + k;
                row.into_iter().enumerate().map(move |(b, w)| (vertex as i64, b as i64, w))
            })
        });
        let weights = SkinWeights::from_triplets(entries, mesh.vertex_count(), 3).unwrap();
        (mesh, skeleton, weights)
    }

    #[test]
    fn joints_have_the_radius_of_their_limb_and_share_cells_when_alike() {
        let (mesh, skeleton, weights) = prism(|_| 1.0);
        let areas = JointAreas::new(&mesh, &skeleton, &weights, None);
        assert_eq!(areas.areas.iter().map(|a| (a.bone, a.parent)).collect::<Vec<_>>(), [(1, 0), (2, 1)]);
        assert!(areas.areas.iter().all(|a| (a.radius - 1.0).abs() < 1e-9 && a.patch == 0));
        assert_eq!(areas.cell_sizes.len(), 1);
        assert_eq!(areas.home[0], Some(0), "rigid, moved by the first bone");
        assert_eq!(areas.home[mesh.vertex_count() - 1], Some(1));
        assert!((areas.share(SIDES as usize * 12, 1) - 1.0).abs() < 1e-6, "all below the first joint");
    }

    #[test]
    fn the_cells_of_a_patch_grow_until_it_has_no_more_than_its_part() {
        let (mesh, _, _) = prism(|_| 1.0);
        let sized = |size: f64| {
            let area = JointArea { bone: 1, parent: 0, centre: DVec3::ZERO, radius: 1.0, patch: 0 };
            let home = vec![Some(0); mesh.vertex_count()];
            let mut areas = JointAreas::from_parts(vec![area], vec![size], home);
            areas.limit(&mesh);
            (areas.cell_sizes[0], areas.expected[0])
        };
        let (size, expected) = sized(0.1);
        assert!(
            size > 0.2 && expected <= MOST_OF_PATCH && expected > 0.9 * MOST_OF_PATCH,
            "{size} {expected}"
        );
        assert_eq!(sized(0.8).0, 0.8, "few enough");
    }

    #[test]
    fn joints_of_very_different_thickness_have_cells_of_their_own() {
        let (mesh, skeleton, weights) = prism(|x| if x < 0.0 { 8.0 } else { 0.9 });
        let areas = JointAreas::new(&mesh, &skeleton, &weights, None);
        assert_eq!(areas.cell_sizes.len(), 2);
        assert!(areas.cell_sizes[0] > 4.0 * areas.cell_sizes[1]);
        let one = JointAreas::new(&mesh, &skeleton, &weights, Some(0.3));
        assert_eq!(one.cell_sizes, [0.3]);
    }

    #[test]
    fn the_finest_cells_grow_until_all_are_affordable() {
        let (mesh, skeleton, weights) = prism(|x| if x < 0.0 { 500.0 } else { 0.9 });
        let areas = JointAreas::new(&mesh, &skeleton, &weights, None);
        let cells: f64 = 12.0 * 500f64.powi(2) * 6.0 / areas.cell_sizes[0].powi(3);
        assert!(cells < 2.0 * MOST_TETRAHEDRA, "{:?}", areas.cell_sizes);
    }

    #[test]
    fn without_blending_there_is_no_area() {
        let (mesh, skeleton, _) = prism(|_| 1.0);
        let rigid = (0..mesh.vertex_count() as i64).map(|v| (v, 0, 1.0));
        let rigid = SkinWeights::from_triplets(rigid, mesh.vertex_count(), 3).unwrap();
        let areas = JointAreas::new(&mesh, &skeleton, &rigid, None);
        assert!(areas.areas.is_empty() && areas.cell_sizes.is_empty());
    }
}
