//! The body as limbs that may touch one another: for each bone the vertices that follow it most, a
//! sample of them, and how thick the limb is.

use std::cmp::Reverse;
use std::collections::HashMap;

use glam::{Affine3A, DVec3, Mat3A, Vec3, Vec3A};

use super::masks::geodesic_distances;
use crate::mesh::{Adjacency, TriangleMesh};
use crate::rig::{Skeleton, distance_to_segment};
use crate::skinning::SkinWeights;

/// Vertices of a sample, about.
const SAMPLE: usize = 100;

/// A limb: what follows one bone most.
#[derive(Debug, Clone)]
pub(super) struct LimbPart {
    pub bone: u32,
    /// Its vertices, ascending, and their outward normals in rest.
    pub vertices: Vec<u32>,
    pub normals: Vec<Vec3>,
    /// Triangles between them, as places in `vertices`.
    pub triangles: Vec<[u32; 3]>,
    /// Places in `vertices`, spread over all of them.
    pub sample: Vec<u32>,
    /// Distances between neighbouring vertices, and between those of the sample.
    pub spacing: f32,
    pub sample_spacing: f32,
    /// Median distance of the vertices from the bone.
    pub radius: f32,
    /// Direction of the bone in rest.
    pub axis: Vec3,
}

/// The parts of all bones that some vertices follow most, bones ascending.
pub(super) fn limb_parts(
    mesh: &TriangleMesh,
    normals: &[DVec3],
    adjacency: &Adjacency,
    skeleton: &Skeleton,
    weights: &SkinWeights,
) -> Vec<LimbPart> {
    let mut members = vec![Vec::new(); skeleton.bone_count()];
    for vertex in 0..mesh.vertex_count() as u32 {
        if let Some((bone, _)) = weights.heaviest(vertex as usize) {
            members[bone as usize].push(vertex);
        }
    }
    let mut place_of = vec![(u32::MAX, 0); mesh.vertex_count()];
    for (bone, members) in (0..).zip(&members) {
        (0..).zip(members).for_each(|(place, &vertex)| place_of[vertex as usize] = (bone, place));
    }
    let mut triangles = vec![Vec::new(); skeleton.bone_count()];
    for triangle in mesh.triangles() {
        let [a, b, c] = triangle.map(|vertex| place_of[vertex as usize]);
        if a.0 == b.0 && b.0 == c.0 && a.0 != u32::MAX {
            triangles[a.0 as usize].push([a.1, b.1, c.1]);
        }
    }
    let part = |(bone, vertices): (usize, Vec<u32>)| {
        let (head, tail) = (skeleton.heads()[bone], skeleton.tails()[bone]);
        let position = |v: u32| mesh.vertices()[v as usize];
        let mut distances: Vec<f64> =
            vertices.iter().map(|&v| distance_to_segment(position(v), head, tail)).collect();
        distances.sort_by(f64::total_cmp);
        let edges = vertices.iter().flat_map(|&v| {
            adjacency.neighbours(v as usize).iter().map(move |&n| position(v).distance(position(n)))
        });
        let (sum, count) = edges.fold((0.0, 0u32), |(sum, count), edge| (sum + edge, count + 1));
        let spacing = (sum / f64::from(count.max(1))) as f32;
        let sample = spread_sample(&vertices);
        Some(LimbPart {
            bone: bone as u32,
            normals: vertices.iter().map(|&v| normals[v as usize].as_vec3()).collect(),
            sample_spacing: spacing * (vertices.len() as f32 / sample.len().max(1) as f32).sqrt(),
            spacing,
            radius: *distances.get(distances.len() / 2)? as f32,
            axis: (tail - head).normalize_or_zero().as_vec3(),
            triangles: std::mem::take(&mut triangles[bone]),
            sample,
            vertices,
        })
    };
    let parts = members.into_iter().enumerate().filter_map(part);
    parts.filter(|part| part.radius > 0.0 && part.spacing > 0.0).collect()
}

/// Places of a sample: those with the least hashes of their vertices, so that no pattern of the mesh is left.
fn spread_sample(vertices: &[u32]) -> Vec<u32> {
    let mut places: Vec<u32> = (0..vertices.len() as u32).collect();
    let hash = |place: &u32| u64::from(vertices[*place as usize] + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    places.sort_by_key(|place| Reverse(hash(place)));
    places.truncate(SAMPLE);
    places.sort_unstable();
    places
}

/// Ways along the surface's edges from a limb to the vertices around it, up to `limit`.
pub(super) fn ways_from(
    part: &LimbPart,
    mesh: &TriangleMesh,
    adjacency: &Adjacency,
    limit: f32,
) -> HashMap<u32, f32> {
    let seeds = part.vertices.iter().map(|&vertex| vertex as usize);
    let ways = geodesic_distances(mesh, adjacency, seeds, limit.into());
    let around = (0..).zip(ways).filter_map(|(vertex, way)| Some((vertex, way? as f32)));
    around.filter(|(vertex, _)| part.vertices.binary_search(vertex).is_err()).collect()
}

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    pub low: Vec3,
    pub high: Vec3,
}

impl Bounds {
    pub(super) fn of(positions: impl Iterator<Item = Vec3>) -> Self {
        // Four at a time: one would wait for the other.
        let mut lanes = [(Vec3A::INFINITY, Vec3A::NEG_INFINITY); 4];
        let mut positions = positions.map(Vec3A::from);
        'all: loop {
            for (low, high) in &mut lanes {
                let Some(position) = positions.next() else { break 'all };
                (*low, *high) = (low.min(position), high.max(position));
            }
        }
        let [a, b, c, d] = lanes.map(|(low, high)| Self { low: low.into(), high: high.into() });
        a.and(b).and(c.and(d))
    }

    /// The box that holds both.
    fn and(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    pub(super) fn grown(self, by: f32) -> Self {
        Self { low: self.low - by, high: self.high + by }
    }

    pub(super) fn meets(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }

    pub(super) fn holds(&self, position: Vec3) -> bool {
        position.cmpge(self.low).all() && position.cmple(self.high).all()
    }
}

/// How a bone's rest normals turn in a pose, and how it scales lengths; `None` where it is flattened.
pub(super) fn turn_of(transform: &Affine3A) -> Option<(Mat3A, f32)> {
    let scale = transform.matrix3.determinant().abs().cbrt();
    let turn = transform.matrix3.inverse().transpose();
    (scale > f32::MIN_POSITIVE && scale.is_finite() && turn.is_finite()).then_some((turn, scale))
}
