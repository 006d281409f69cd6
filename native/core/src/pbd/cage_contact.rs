//! Self-collision while the cage is solved: contact vertices are pushed through the corners of the
//! tetrahedra that hold them.

use glam::{Affine3A, Vec3};
use rayon::prelude::*;
use wide::f32x4;

use super::PbdSettings;
use super::contact::{ContactScratch, Firmness, JointContact};
use super::fold_plane::FoldPlane;
use super::island::{Island, SurfacePoint};
use super::lanes::Particle;
use super::stats::Work;

/// Contact sweeps that share the height fields of the folds.
const FIELD_SWEEPS: usize = 5;

/// Σ w b² of a tetrahedron whose corners are all free and share a push alike; what has less takes a
/// part of a push only.
const LEAST_CONTACT_MASS: f32 = 0.25;

/// Contacts of an island in a pose.
#[derive(Debug, Clone, Default)]
pub(super) struct CageContacts {
    joints: Vec<JointScratch>,
    /// True once the candidates are listed from which the sweeps choose.
    listed: bool,
    /// Sweeps of this pose so far.
    sweeps: usize,
}

/// Buffers of one joint's contact.
#[derive(Debug, Clone, Default)]
struct JointScratch {
    fold: Option<FoldPlane>,
    candidates: Vec<Vec3>,
    /// Candidates that can come into contact.
    near: Vec<u32>,
    /// Those that the last sweep has looked at.
    list: Vec<u32>,
    contact: ContactScratch,
}

impl CageContacts {
    /// Begins a pose; `transforms` are relative to the island's frame.
    pub(super) fn begin(&mut self, island: &Island, settings: &PbdSettings, transforms: &[Affine3A]) {
        self.joints.resize_with(island.cage_contacts.len(), JointScratch::default);
        for (joint, contact) in self.joints.iter_mut().zip(&island.cage_contacts) {
            joint.fold = settings.self_collision.then(|| contact.fold_plane(transforms)).flatten();
            joint.near.clear();
        }
        self.listed = false;
        self.sweeps = 0;
    }

    /// Joints whose bones form a fold, by their places in the island's list.
    pub(super) fn folds(&self) -> impl Iterator<Item = (usize, &FoldPlane)> {
        self.joints.iter().enumerate().filter_map(|(place, joint)| Some((place, joint.fold.as_ref()?)))
    }

    /// What was listed as able to come into contact.
    pub(super) fn near<'a>(&'a self, island: &'a Island) -> impl Iterator<Item = &'a SurfacePoint> {
        let joints = island.cage_points.iter().zip(&self.joints);
        joints.flat_map(|(points, joint)| joint.near.iter().map(|&near| &points[near as usize]))
    }

    /// Lists the candidates of each fold that can come into contact in the sweeps to come.
    pub(super) fn list_near(&mut self, island: &Island, particles: &[Particle]) {
        each_fold(island, &mut self.joints, |contact, points, fold, joint| {
            let JointScratch { candidates, near, .. } = joint;
            candidates.clear();
            candidates.extend(points.iter().map(|point| point.position(particles)));
            contact.list_near(fold, candidates, near);
        });
    }

    /// Pushes contact vertices back through the corners of the tetrahedra that hold them.
    pub(super) fn sweep(
        &mut self,
        island: &Island,
        inverse_masses: &[f32],
        particles: &mut [Particle],
        work: &mut Work,
    ) {
        if !self.listed {
            self.list_near(island, particles);
            self.listed = true;
        }
        let refill = self.sweeps.is_multiple_of(FIELD_SWEEPS);
        self.sweeps += 1;
        let now = &*particles;
        each_fold(island, &mut self.joints, |contact, points, fold, joint| {
            let JointScratch { candidates, near, list, contact: found, .. } = joint;
            if near.is_empty() || (!refill && found.level.is_none()) {
                list.clear();
                found.pushes.clear();
                return;
            }
            list.clone_from(if refill { near } else { &found.pushable });
            candidates.clear();
            candidates.extend(list.iter().map(|&candidate| points[candidate as usize].position(now)));
            contact.pushes(fold, list, candidates, refill, Firmness::CAGE, found);
        });
        for (points, joint) in island.cage_points.iter().zip(&self.joints) {
            let JointScratch { fold, candidates, list, contact: found, .. } = joint;
            if fold.is_none() {
                continue;
            }
            work.contact_candidates += list.len();
            for push in &found.pushes {
                let point = &points[list[push.listed as usize] as usize];
                // Pushes before this one may have moved the same corners.
                let moved = point.position(particles) - candidates[push.listed as usize];
                let length = push.offset.length();
                let left = length - moved.dot(push.offset) / length;
                let corners = point.corners.map(|corner| corner as usize);
                let w = corners.map(|corner| inverse_masses[corner]);
                let b = point.barycentric;
                let mass: f32 = (0..4).map(|k| w[k] * b[k] * b[k]).sum();
                if left > 0.0 {
                    // Where little is free, all of a push would move a corner far: the surface follows then.
                    let step = push.offset * (left / (length * mass.max(LEAST_CONTACT_MASS)));
                    for k in 0..4 {
                        let step = step * (w[k] * b[k]);
                        particles[corners[k]] += f32x4::new([step.x, step.y, step.z, 0.0]);
                    }
                }
            }
        }
    }
}

/// Runs a task on all joints whose bones form a fold, on several cores where there are several.
fn each_fold(
    island: &Island,
    joints: &mut [JointScratch],
    task: impl Fn(&JointContact, &[SurfacePoint], &FoldPlane, &mut JointScratch) + Sync,
) {
    let folds = island.cage_contacts.par_iter().zip(&island.cage_points).zip(joints).with_max_len(1);
    folds.for_each(|((contact, points), joint)| {
        if let Some(fold) = joint.fold {
            task(contact, points, &fold, joint);
        }
    });
}
