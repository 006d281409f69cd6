//! Contact candidates around each joint of an island, found in the rest pose.

use glam::{DVec3, Vec3};

use super::areas::JointArea;
use super::contact::{ContactVertex, JointContact};
use super::island::SurfacePoint;
use super::patch::PatchInput;

/// Vertices within this many radii of a joint can touch the other side; beyond, as far as the
/// shorter of the two limbs reaches, because a limb that folds back lies along the other one.
const CANDIDATE_REACH: f64 = 2.8;
/// Candidates of a joint that push the cage, about: enough for its cells, however dense the mesh.
const CAGE_CANDIDATES: usize = 600;
/// Directions in which the seam is tabulated.
const SEAM_DIRECTIONS: usize = 256;
/// Sharpness with which the seam is looked up by direction around the joint.
const SEAM_SHARPNESS: f64 = 8.0;

/// Contact candidates around one joint.
pub(super) struct JointContacts {
    /// Those that push the cage while it is solved.
    pub cage: JointContact,
    /// Those that are projected when the surface is made: all.
    pub surface: JointContact,
}

/// Contact candidates of an island, joint by joint.
pub(super) fn joint_contacts(
    input: &PatchInput<'_>,
    areas: &[JointArea],
    surface: &[SurfacePoint],
) -> Vec<JointContacts> {
    areas.iter().filter_map(|area| joint_contact(input, area, surface)).collect()
}

fn joint_contact(
    input: &PatchInput<'_>,
    area: &JointArea,
    surface: &[SurfacePoint],
) -> Option<JointContacts> {
    let (heads, tails) = (input.skeleton.heads(), input.skeleton.tails());
    let (up, down) = (heads[area.parent as usize], tails[area.bone as usize]);
    let up_direction = (up - area.centre).try_normalize()?;
    let down_direction = (down - area.centre).try_normalize()?;
    let normal = (down_direction - up_direction).try_normalize()?;
    let position = |v: u32| input.mesh.vertices()[v as usize];
    let share = |v: u32| input.areas.share(v as usize, area.bone);
    let limb = up.distance(area.centre).min(down.distance(area.centre));
    let reach = (CANDIDATE_REACH * area.radius).max(limb);
    let points: Vec<u32> = (0..)
        .zip(surface)
        .filter(|(_, point)| position(point.vertex).distance(area.centre) <= reach)
        .filter(|(_, point)| is_neighbour(input, area, point.vertex, share(point.vertex) > 0.5))
        .map(|(index, _)| index)
        .collect();
    let mut candidate_of = vec![None; input.mesh.vertex_count()];
    for (candidate, &point) in (0u32..).zip(&points) {
        candidate_of[surface[point as usize].vertex as usize] = Some(candidate);
    }
    let seam = seam_heights(input, area, normal, &candidate_of);
    if seam.is_empty() {
        return None;
    }
    let around = Around::new(normal);
    let seam = Around::tabulate(&seam);
    let vertices: Vec<ContactVertex> = points
        .iter()
        .map(|&point| {
            let vertex = surface[point as usize].vertex;
            let offset = position(vertex) - area.centre;
            let below = share(vertex) > 0.5;
            let seam = around.look_up(&seam, offset);
            let beyond = offset.dot(normal) - seam;
            let rest_violation = (if below { -beyond } else { beyond }).max(0.0) as f32;
            ContactVertex { point, below, seam: seam as f32, rest_violation, rest_overlap: 0.0 }
        })
        .collect();
    let rest: Vec<Vec3> = points.iter().map(|&p| position(surface[p as usize].vertex).as_vec3()).collect();
    let contact = JointContact {
        bone: area.bone,
        parent: area.parent,
        joint: area.centre.as_vec3(),
        up: up.as_vec3(),
        down: down.as_vec3(),
        vertices,
        spacing: spacing(input, &candidate_of),
    };
    Some(JointContacts { cage: thinned(&contact, &rest), surface: with_rest_overlaps(contact, &rest) })
}

/// The candidates that push the cage: a sample of those that are projected in the end. Chosen by a
/// hash of their index, so that no pattern of the mesh is left.
fn thinned(contact: &JointContact, rest: &[Vec3]) -> JointContact {
    let count = contact.vertices.len();
    let kept = |index: &usize| {
        let hash = (*index as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32;
        count <= CAGE_CANDIDATES || hash as usize % count < CAGE_CANDIDATES
    };
    let indices: Vec<usize> = (0..count).filter(kept).collect();
    let vertices: Vec<ContactVertex> = indices.iter().map(|&i| contact.vertices[i]).collect();
    let rest: Vec<Vec3> = indices.iter().map(|&i| rest[i]).collect();
    let spacing = contact.spacing * (count as f32 / indices.len().max(1) as f32).sqrt();
    with_rest_overlaps(JointContact { vertices, spacing, ..contact.clone() }, &rest)
}

fn with_rest_overlaps(mut contact: JointContact, rest: &[Vec3]) -> JointContact {
    let overlaps = contact.rest_overlaps(rest);
    for (vertex, overlap) in contact.vertices.iter_mut().zip(overlaps) {
        vertex.rest_overlap = overlap;
    }
    contact
}

/// True for vertices that mostly follow a bone near the joint: over its plane, such bones are height
/// fields, while a hand that hangs below the plane of a spine joint has not passed through anything.
fn is_neighbour(input: &PatchInput<'_>, area: &JointArea, vertex: u32, below: bool) -> bool {
    let parents = input.skeleton.parents();
    let heaviest =
        input.weights.entries(vertex as usize).max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
    let Some((bone, _)) = heaviest else { return false };
    let parent = parents[bone as usize];
    if below {
        bone == area.bone || parent == Some(area.bone)
    } else {
        bone == area.parent || parent == Some(area.parent) || parents[area.parent as usize] == Some(bone)
    }
}

/// Where the surface passes from one side of the joint to the other: direction around the joint
/// and height along the normal, at every edge where the share of the bones below passes one half.
fn seam_heights(
    input: &PatchInput<'_>,
    area: &JointArea,
    normal: DVec3,
    candidate_of: &[Option<u32>],
) -> Vec<(f64, f64)> {
    let around = Around::new(normal);
    let mut seam = Vec::new();
    for triangle in input.mesh.triangles() {
        if triangle.iter().any(|&v| candidate_of[v as usize].is_none()) {
            continue;
        }
        for k in 0..3 {
            let (u, v) = (triangle[k], triangle[(k + 1) % 3]);
            let share = |v: u32| f64::from(input.areas.share(v as usize, area.bone)) - 0.5;
            if share(u) * share(v) < 0.0 {
                let t = share(u) / (share(u) - share(v));
                let (a, b) = (input.mesh.vertices()[u as usize], input.mesh.vertices()[v as usize]);
                let offset = a.lerp(b, t) - area.centre;
                seam.push((around.angle(offset), offset.dot(normal)));
            }
        }
    }
    seam
}

/// Directions around an axis.
struct Around {
    x: DVec3,
    y: DVec3,
}

impl Around {
    fn new(axis: DVec3) -> Self {
        let x = axis.any_orthonormal_vector();
        Self { x, y: axis.cross(x) }
    }

    fn angle(&self, offset: DVec3) -> f64 {
        offset.dot(self.y).atan2(offset.dot(self.x))
    }

    /// Mean heights of the seam in [`SEAM_DIRECTIONS`] directions.
    fn tabulate(seam: &[(f64, f64)]) -> Vec<f64> {
        let mean = |direction: usize| {
            let angle = std::f64::consts::TAU * direction as f64 / SEAM_DIRECTIONS as f64;
            let (mut sum, mut total) = (0.0, f64::MIN_POSITIVE);
            for &(direction, height) in seam {
                let weight = (SEAM_SHARPNESS * ((direction - angle).cos() - 1.0)).exp();
                sum += weight * height;
                total += weight;
            }
            sum / total
        };
        (0..SEAM_DIRECTIONS).map(mean).collect()
    }

    /// Height of the tabulated seam in the direction of an offset.
    fn look_up(&self, heights: &[f64], offset: DVec3) -> f64 {
        let turns = self.angle(offset).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU;
        let place = turns * SEAM_DIRECTIONS as f64;
        let first = place.floor();
        let at = |i: usize| heights[i % SEAM_DIRECTIONS];
        at(first as usize) + (place - first) * (at(first as usize + 1) - at(first as usize))
    }
}

/// Mean length of the edges between candidates.
fn spacing(input: &PatchInput<'_>, candidate_of: &[Option<u32>]) -> f32 {
    let (mut sum, mut count) = (0.0, 0u32);
    for (v, _) in candidate_of.iter().enumerate().filter(|(_, candidate)| candidate.is_some()) {
        let neighbours = input.adjacency.neighbours(v).iter().map(|&n| n as usize);
        for n in neighbours.filter(|&n| n > v && candidate_of[n].is_some()) {
            sum += input.mesh.vertices()[v].distance(input.mesh.vertices()[n]);
            count += 1;
        }
    }
    (sum / f64::from(count.max(1))) as f32
}
