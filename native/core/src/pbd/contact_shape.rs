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
        positions.extend(contact.vertices.iter().map(|v| vertices[v.element as usize]));
        contact.keep_rest(&positions);
    }
    contacts
}
