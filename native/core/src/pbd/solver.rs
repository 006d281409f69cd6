//! The loop of Algorithm 1 on one island: Gauss-Seidel over its constraints, in a fixed order.

use glam::{Affine3A, Vec3};
use nalgebra::Vector3;

use super::contact::{ContactScratch, FoldPlane};
use super::island::{Island, from_vector, vector};
use super::{
    EnergyForm, PbdSettings, Start, least_volume_divisor, project_bind, project_energy, project_energy_paper,
    project_stretch, project_volume, signed_volume,
};
use crate::skinning::Skinning;

/// Buffers of one island, kept between frames; what they hold does not matter.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    /// Positions of the particles, the result.
    pub positions: Vec<Vector3<f32>>,
    multipliers: Vec<[f32; 4]>,
    anchors: Vec<Vector3<f32>>,
    folds: Vec<Option<FoldPlane>>,
    candidates: Vec<Vec3>,
    contact: ContactScratch,
}

/// Solves an island for a pose. `transforms` are relative to the island's frame; the positions are
/// left in `scratch.positions`, in that frame.
pub(super) fn solve_island(
    island: &Island,
    settings: &PbdSettings,
    transforms: &[Affine3A],
    scratch: &mut Scratch,
) {
    start(island, settings, transforms, &mut scratch.positions);
    scratch.anchors.clear();
    scratch.folds.clear();
    scratch.multipliers.clear();
    if settings.bind > 0.0 {
        let anchor =
            |bind: &super::island::Bind| vector(transforms[bind.bone as usize].transform_point3(bind.anchor));
        scratch.anchors.extend(island.binds.iter().map(anchor));
    }
    if settings.energy > 0.0 {
        scratch.multipliers.resize(island.tetrahedra.len(), [0.0; 4]);
    }
    if settings.self_collision {
        scratch.folds.extend(island.cage_contacts.iter().map(|contact| contact.fold_plane(transforms)));
    }
    for iteration in 0..settings.iterations {
        // Every second sweep runs backwards, so that no end of the island is always served last.
        let backwards = iteration % 2 == 1;
        let progress = iteration as f32 / settings.iterations as f32;
        let stretch =
            if settings.anneal_stretch { settings.stretch * (1.0 - progress) } else { settings.stretch };
        sweep_stretch(island, stretch, backwards, &mut scratch.positions);
        sweep_volume(island, settings.volume, backwards, &mut scratch.positions);
        sweep_bind(island, settings.bind, &scratch.anchors, &mut scratch.positions);
        sweep_energy(island, settings, scratch);
        // Before the volumes are nearly right, what seems to touch need not touch.
        if 2 * iteration >= settings.iterations {
            sweep_contacts(island, scratch);
        }
    }
    for sweep in 0..settings.volume_sweeps {
        let backwards = (settings.iterations + sweep) % 2 == 1;
        sweep_volume(island, settings.volume, backwards, &mut scratch.positions);
        sweep_contacts(island, scratch);
    }
}

/// The start state: particles skinned by their own weights.
fn start(
    island: &Island,
    settings: &PbdSettings,
    transforms: &[Affine3A],
    positions: &mut Vec<Vector3<f32>>,
) {
    let linear = match settings.start {
        Start::Linear => true,
        Start::DualQuaternion => false,
        Start::Auto => settings.volume <= 0.0,
    };
    let skinning =
        if linear { Skinning::linear(transforms) } else { Skinning::dual_quaternion(transforms, None) };
    positions.clear();
    let particles = island.rest.iter().enumerate();
    positions.extend(particles.map(|(i, &rest)| vector(skinning.vertex(rest, island.weights.row(i)))));
}

fn in_order<T: Copy>(list: &[T], backwards: bool, mut visit: impl FnMut(usize, T)) {
    if backwards {
        list.iter().enumerate().rev().for_each(|(i, &item)| visit(i, item));
    } else {
        list.iter().enumerate().for_each(|(i, &item)| visit(i, item));
    }
}

fn sweep_stretch(island: &Island, stiffness: f32, backwards: bool, positions: &mut [Vector3<f32>]) {
    if stiffness <= 0.0 {
        return;
    }
    let w = &island.inverse_masses;
    in_order(&island.edges, backwards, |_, ([a, b], rest_length)| {
        let (a, b) = (a as usize, b as usize);
        let steps = project_stretch([positions[a], positions[b]], [w[a], w[b]], rest_length, stiffness);
        positions[a] += steps[0];
        positions[b] += steps[1];
    });
}

fn sweep_volume(island: &Island, stiffness: f32, backwards: bool, positions: &mut [Vector3<f32>]) {
    if stiffness <= 0.0 {
        return;
    }
    let w = &island.inverse_masses;
    let least_divisor = least_volume_divisor(island.rest_volume);
    in_order(&island.tetrahedra, backwards, |_, corners| {
        let c = corners.map(|corner| corner as usize);
        let (p, masses) = (c.map(|i| positions[i]), c.map(|i| w[i]));
        let steps = project_volume(p, masses, island.rest_volume, least_divisor, stiffness);
        for (corner, step) in c.into_iter().zip(steps) {
            positions[corner] += step;
        }
    });
}

fn sweep_bind(island: &Island, stiffness: f32, anchors: &[Vector3<f32>], positions: &mut [Vector3<f32>]) {
    for (bind, &anchor) in island.binds.iter().zip(anchors) {
        let particle = bind.particle as usize;
        // A heavier particle, where the island ends, follows less.
        let stiffness = stiffness * island.inverse_masses[particle];
        let step = project_bind(positions[particle], anchor, bind.rest_length, stiffness);
        positions[particle] += step;
    }
}

fn sweep_energy(island: &Island, settings: &PbdSettings, scratch: &mut Scratch) {
    let stiffness = settings.energy * settings.stiffness;
    let (w, positions) = (&island.inverse_masses, &mut scratch.positions);
    let springs = island.tetrahedra.iter().zip(&island.spring_lengths);
    for (index, ((corners, &lengths), multipliers)) in springs.zip(&mut scratch.multipliers).enumerate() {
        let share = island.stiffness_shares.get(index).copied().unwrap_or(1.0);
        let compliance = (stiffness * share).recip() + LEAST_COMPLIANCE;
        let c = corners.map(|corner| corner as usize);
        let (mut p, masses) = (c.map(|i| positions[i]), c.map(|i| w[i]));
        match settings.energy_form {
            EnergyForm::Compliant => project_energy(&mut p, masses, lengths, compliance, multipliers),
            EnergyForm::Paper => {
                let steps = project_energy_paper(p, masses, lengths);
                p.iter_mut().zip(steps).for_each(|(p, step)| *p += step * settings.energy);
            }
        }
        c.into_iter().zip(p).for_each(|(i, p)| positions[i] = p);
    }
}

/// Springs stiffer than this do not converge in a handful of iterations, and what has not converged
/// looks softer: stiffness saturates here instead.
const LEAST_COMPLIANCE: f32 = 0.75;

/// Pushes contact vertices back through the corners of the tetrahedra that hold them.
fn sweep_contacts(island: &Island, scratch: &mut Scratch) {
    let Scratch { positions, folds, candidates, contact: found, .. } = scratch;
    for (contact, fold) in island.cage_contacts.iter().zip(folds) {
        let Some(fold) = fold else { continue };
        candidates.clear();
        let points = contact.vertices.iter().map(|vertex| &island.surface[vertex.point as usize]);
        candidates.extend(points.map(|point| from_vector(point.position(positions))));
        contact.pushes(fold, candidates, found);
        for push in &found.pushes {
            let candidate = push.candidate as usize;
            let point = &island.surface[contact.vertices[candidate].point as usize];
            // Pushes before this one may have moved the same corners.
            let moved = from_vector(point.position(positions)) - candidates[candidate];
            let length = push.offset.length();
            let left = length - moved.dot(push.offset) / length;
            let corners = point.corners.map(|corner| corner as usize);
            let w = corners.map(|corner| island.inverse_masses[corner]);
            let b = point.barycentric;
            let mass: f32 = (0..4).map(|k| w[k] * b[k] * b[k]).sum();
            // Where little is free, most of a push would move a corner far: leave it to the surface.
            if left > 0.0 && mass > LEAST_CONTACT_MASS {
                let step = vector(push.offset) * (left / (length * mass));
                for k in 0..4 {
                    positions[corners[k]] += step * (w[k] * b[k]);
                }
            }
        }
    }
}

/// Smallest Σ w b² of a tetrahedron that takes a push; a quarter when all four corners are free
/// and share alike.
const LEAST_CONTACT_MASS: f32 = 0.05;

/// Tetrahedra that are inside out.
pub(super) fn inverted(island: &Island, positions: &[Vector3<f32>]) -> usize {
    let volume = |corners: &[u32; 4]| signed_volume(corners.map(|corner| positions[corner as usize]));
    island.tetrahedra.iter().filter(|corners| volume(corners) <= 0.0).count()
}
