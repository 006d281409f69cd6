//! The part of an island that a pose concerns: what moved bones carry, what may come into contact,
//! and some rings of cells around it. The rest of the island is where it was and is not solved.

use glam::{Affine3A, Mat3A, Vec3A};

use super::fold_plane::FoldPlane;
use super::island::{Island, STILL};

/// Rings of tetrahedra that are solved around what has moved.
const RINGS: usize = 4;

/// Constraints of the concerned part, and the inverse masses that hold everything else.
#[derive(Debug, Clone, Default)]
pub(super) struct ActivePart {
    /// Inverse masses (P), 0 for particles that are not concerned.
    pub inverse_masses: Vec<f32>,
    /// Batches of edges with a free end.
    pub edges: Vec<u32>,
    /// Batches of tetrahedra with a free corner.
    pub tetrahedra: Vec<u32>,
    free: Vec<bool>,
    concerned: Vec<bool>,
    moved: Vec<bool>,
    /// What was concerned before the last ring.
    before: Vec<bool>,
}

impl ActivePart {
    /// Finds the part for a pose; `transforms` are relative to the island's frame.
    pub(super) fn find(&mut self, island: &Island, transforms: &[Affine3A], folds: &[Option<FoldPlane>]) {
        self.moved.clear();
        self.moved.extend(transforms.iter().map(|t| !is_still(t, island.extent)));
        self.concerned.clear();
        self.concerned
            .extend((0..island.rest.len()).map(|particle| {
                island.weights.row(particle).0.iter().any(|&bone| self.moved[bone as usize])
            }));
        for (contact, _) in island.cage_contacts.iter().zip(folds).filter(|(_, fold)| fold.is_some()) {
            for vertex in &contact.vertices {
                for corner in island.surface[vertex.element as usize].corners {
                    self.concerned[corner as usize] = true;
                }
            }
        }
        for _ in 0..RINGS {
            if !self.grow(island) {
                break;
            }
        }
        self.inverse_masses.clear();
        let masses = island.inverse_masses.iter().zip(&self.concerned);
        self.inverse_masses.extend(masses.map(|(&mass, &concerned)| if concerned { mass } else { 0.0 }));
        self.free.clear();
        self.free.extend(self.inverse_masses.iter().map(|&mass| mass > 0.0).chain([false]));
        island.edge_batches.select(&self.free, &mut self.edges);
        island.tetrahedron_batches.select(&self.free, &mut self.tetrahedra);
    }

    /// Adds one ring of tetrahedra; false when there was nothing left to add.
    fn grow(&mut self, island: &Island) -> bool {
        self.before.clone_from(&self.concerned);
        let mut grown = false;
        for corners in &island.tetrahedra {
            let inside = corners.iter().filter(|&&c| self.before[c as usize]).count();
            if (1..4).contains(&inside) {
                grown = true;
                corners.iter().for_each(|&c| self.concerned[c as usize] = true);
            }
        }
        grown
    }
}

/// True for a transform that differs from the identity by rounding alone.
pub(super) fn is_still(transform: &Affine3A, extent: f32) -> bool {
    transform.matrix3.abs_diff_eq(Mat3A::IDENTITY, STILL)
        && transform.translation.abs_diff_eq(Vec3A::ZERO, STILL * extent)
}
