//! Contact candidates of a shape that other shape keys make: what lies over the seam or overlaps in
//! that shape at rest is left alone, as it is in the mesh's own rest shape.

use glam::{Affine3A, Vec3};

use super::contact::JointContact;
use super::island::Island;

/// The contacts of an island over other rest positions `vertices` of the whole surface. Joints that
/// cannot be in contact under `local` transforms are left out of the work, not of the result.
pub(super) fn reshaped(island: &Island, local: &[Affine3A], vertices: &[Vec3]) -> Vec<JointContact> {
    let mut contacts = island.contacts.clone();
    let mut positions = Vec::new();
    for contact in contacts.iter_mut().filter(|contact| contact.fold_plane(local).is_some()) {
        positions.clear();
        let own = contact.vertices.iter().map(|v| vertices[island.surface[v.point as usize].vertex as usize]);
        positions.extend(own);
        reshape(contact, &positions);
    }
    contacts
}

fn reshape(contact: &mut JointContact, positions: &[Vec3]) {
    let direction = |end: Vec3| (end - contact.joint).normalize_or_zero();
    let normal = (direction(contact.down) - direction(contact.up)).normalize_or_zero();
    let joint = contact.joint;
    for (vertex, position) in contact.vertices.iter_mut().zip(positions) {
        let beyond = (*position - joint).dot(normal) - vertex.seam;
        vertex.rest_violation = (if vertex.below { -beyond } else { beyond }).max(0.0);
    }
    let overlaps = contact.rest_overlaps(positions);
    for (vertex, overlap) in contact.vertices.iter_mut().zip(overlaps) {
        vertex.rest_overlap = overlap;
    }
}
