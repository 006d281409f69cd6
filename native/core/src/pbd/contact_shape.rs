//! Contact candidates of a shape that other shape keys make: what lies over the seam or overlaps in
//! that shape at rest is left alone, as it is in the mesh's own rest shape.

use glam::{Affine3A, Vec3};

use super::contact::{JointContact, THICKNESS};
use super::fold_field::{FoldField, Place};
use super::island::Island;

impl JointContact {
    /// Takes from the rest state, or another shape's, what the candidates keep: how far they overlap
    /// and are shut in there.
    pub(super) fn keep_rest(&mut self, positions: &[Vec3]) {
        let fold = self.plane_between(&Affine3A::IDENTITY, &Affine3A::IDENTITY);
        let mut field = FoldField::default();
        let places: Vec<Place> = match &fold {
            Some(fold) => self.vertices.iter().zip(positions).map(|(v, &p)| self.place(fold, v, p)).collect(),
            None => Vec::new(),
        };
        let deep = fold.map_or(0.0, |fold| fold.deep);
        let meets = fold.is_some() && field.fill(&places, &self.scale(), deep).is_some();
        let thickness = THICKNESS * self.radius;
        for (index, vertex) in self.vertices.iter_mut().enumerate() {
            (vertex.rest_shut_in, vertex.rest_overlap) = (0.0, 0.0);
            if meets {
                let place = &places[index];
                let located = field.locate(place);
                vertex.rest_shut_in = field.shut_in(located).max(field.narrow(located));
                let beyond = place.beyond - field.middle(place) + thickness;
                vertex.rest_overlap = field.sunk(place, beyond).max(0.0);
            }
        }
    }
}

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
