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
/// Length of a bone, in radii of its joint, from which on it is a limb's.
const LIMB: f64 = 4.0;
/// Distance of a joint from the middle of the bone above, in distances from that bone's head, up to which the middle
/// has no direction.
const BESIDE_MIDDLE: f64 = 0.25;

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
    let down = tails[area.bone as usize];
    let [head, tail] = [heads, tails].map(|ends| ends[area.parent as usize]);
    let up = towards(area.centre, head, tail);
    let up_direction = (up - area.centre).try_normalize()?;
    let down_direction = (down - area.centre).try_normalize()?;
    (down_direction - up_direction).try_normalize()?;
    let position = |v: u32| input.mesh.vertices()[v as usize];
    let is_below = |v: u32| input.areas.share(v as usize, area.bone) > 0.5;
    let limb = head.distance(area.centre).min(down.distance(area.centre));
    let reach = (CANDIDATE_REACH * area.radius).max(limb);
    let is_candidate =
        |v: u32| position(v).distance(area.centre) <= reach && is_neighbour(input, area, v, is_below(v));
    let points: Vec<u32> =
        (0..).zip(surface).filter(|(_, point)| is_candidate(point.vertex)).map(|(index, _)| index).collect();
    let in_cage: Vec<u32> = points.iter().map(|&point| surface[point as usize].vertex).collect();
    if !meets(input, &in_cage, &is_below) {
        return None;
    }
    let candidates: Vec<u32> = (0..input.mesh.vertex_count() as u32).filter(|&v| is_candidate(v)).collect();
    let contact_of = |elements: &[u32], vertices: &[u32]| {
        let candidate = |(&element, &vertex): (&u32, &u32)| ContactVertex {
            element,
            below: is_below(vertex),
            normal: input.normals[vertex as usize].as_vec3(),
            rest_overlap: 0.0,
            rest_shut_in: 0.0,
        };
        let rest: Vec<Vec3> = vertices.iter().map(|&v| position(v).as_vec3()).collect();
        let contact = JointContact {
            bone: area.bone,
            parent: area.parent,
            joint: area.centre.as_vec3(),
            up: up.as_vec3(),
            down: down.as_vec3(),
            vertices: elements.iter().zip(vertices).map(candidate).collect(),
            spacing: spacing(input, vertices),
            left_out: 0.0,
            radius: area.radius as f32,
        };
        (contact, rest)
    };
    let (cage, rest) = contact_of(&points, &in_cage);
    let (surface, surface_rest) = contact_of(&candidates, &candidates);
    Some(JointContacts { cage: thinned(&cage, &rest), surface: at_rest(surface, &surface_rest) })
}

/// A point up a bone from a joint: its middle. A bone that ends at the joint lies in the direction of its head as well;
/// one beside it, as the pelvis beside a hip, does not. Where the joint is near the middle itself, the head.
fn towards(joint: DVec3, head: DVec3, tail: DVec3) -> DVec3 {
    let middle = head.midpoint(tail);
    if joint.distance(middle) < BESIDE_MIDDLE * joint.distance(head) { head } else { middle }
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
    let left_out = spacing - contact.spacing;
    at_rest(JointContact { vertices, spacing, left_out, ..contact.clone() }, &rest)
}

fn at_rest(mut contact: JointContact, rest: &[Vec3]) -> JointContact {
    contact.keep_rest(rest);
    contact
}

/// True for vertices that mostly follow a bone near the joint: over its plane, such bones are height
/// fields, while a hand that hangs below the plane of a spine joint has not passed through anything.
/// What follows the bones next to the joint's own two takes part where a limb is long enough to lie along
/// it: fingers curl beside each other, and their ends and the palm meet at other angles.
fn is_neighbour(input: &PatchInput<'_>, area: &JointArea, vertex: u32, below: bool) -> bool {
    let parents = input.skeleton.parents();
    let Some((bone, _)) = input.weights.heaviest(vertex as usize) else { return false };
    let parent = parents[bone as usize];
    let length = |bone: u32| {
        let bone = bone as usize;
        input.skeleton.tails()[bone].distance(input.skeleton.heads()[bone])
    };
    if bone == if below { area.bone } else { area.parent } {
        return true;
    }
    let is_next = if below {
        parent == Some(area.bone)
    } else {
        parent == Some(area.parent) || parents[area.parent as usize] == Some(bone)
    };
    is_next && length(area.bone).max(length(area.parent)) >= LIMB * area.radius
}

/// True where both sides of the joint are on one surface: an edge leads from one to the other.
fn meets(input: &PatchInput<'_>, vertices: &[u32], is_below: &impl Fn(u32) -> bool) -> bool {
    let listed = listed(input, vertices);
    input.mesh.triangles().iter().any(|triangle| {
        let below = triangle.map(|v| listed[v as usize].then(|| is_below(v)));
        below.contains(&Some(true)) && below.contains(&Some(false)) && !below.contains(&None)
    })
}

/// Mean length of the edges between candidates.
fn spacing(input: &PatchInput<'_>, vertices: &[u32]) -> f32 {
    let listed = listed(input, vertices);
    let (mut sum, mut count) = (0.0, 0u32);
    for v in vertices.iter().map(|&v| v as usize) {
        let neighbours = input.adjacency.neighbours(v).iter().map(|&n| n as usize);
        for n in neighbours.filter(|&n| n > v && listed[n]) {
            sum += input.mesh.vertices()[v].distance(input.mesh.vertices()[n]);
            count += 1;
        }
    }
    (sum / f64::from(count.max(1))) as f32
}

/// True for the given vertices (V).
fn listed(input: &PatchInput<'_>, vertices: &[u32]) -> Vec<bool> {
    let mut listed = vec![false; input.mesh.vertex_count()];
    vertices.iter().for_each(|&v| listed[v as usize] = true);
    listed
}
