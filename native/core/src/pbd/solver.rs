//! The loop of Algorithm 1 on one island: Gauss-Seidel over its constraints, in a fixed order.

use glam::{Affine3A, Vec3};
use nalgebra::Vector3;
use wide::f32x4;

use super::active::ActivePart;
use super::contact::{ContactScratch, Firmness};
use super::fold_plane::FoldPlane;
use super::island::{Bind, Island, SurfacePoint};
use super::lanes::{BATCH, Particle, on_widest_lanes};
use super::stats::Work;
use super::sweeps::{EnergySweep, StretchSweep, VolumeSweep};
use super::untangle::{count_inverted, untangle};
use super::{PbdSettings, Start, project_bind};
use crate::skinning::Skinning;

/// Buffers of one island, kept between frames; what they hold does not matter.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    /// The particles, the result, and one more without mass, which idle lanes name.
    pub particles: Vec<Particle>,
    multipliers: Vec<[[f32; BATCH]; 4]>,
    anchors: Vec<Vec3>,
    folds: Vec<Option<FoldPlane>>,
    candidates: Vec<Vec3>,
    /// Candidates of each fold that can come into contact.
    near: Vec<Vec<u32>>,
    /// True once [`Self::near`] is that of this pose.
    listed: bool,
    contacts: Vec<ContactScratch>,
    /// Contact sweeps of this pose so far.
    sweeps: usize,
    active: ActivePart,
    /// Joints that bend: bone, parent, and how far the start is from linear blending.
    bends: Vec<(u32, u32, f32)>,
    /// Batches with tetrahedra that are too flat.
    flat: Vec<u32>,
    /// What the pose took.
    pub work: Work,
}

impl Scratch {
    /// False where absurd transforms have made the result overflow.
    pub(super) fn is_finite(&self) -> bool {
        self.particles.iter().all(|particle| particle.to_array().iter().all(|x| x.is_finite()))
    }

    /// False for a point of the surface that is as far from all that has moved as if at rest; `bones` are
    /// those of its vertex.
    pub(super) fn concerns(&self, point: &SurfacePoint, bones: &[u32]) -> bool {
        point.corners.iter().any(|&corner| self.active.is_concerned(corner)) || self.active.has_moved(bones)
    }

    /// Tetrahedra that are inside out. Those that the pose does not concern are as in rest.
    pub(super) fn inverted(&self, island: &Island) -> usize {
        count_inverted(&island.tetrahedron_batches, &self.active.tetrahedra, &self.particles)
    }
}

/// Solves an island for a pose. `transforms` are relative to the island's frame; the positions are
/// left in `scratch.particles`, in that frame.
pub(super) fn solve_island(
    island: &Island,
    settings: &PbdSettings,
    transforms: &[Affine3A],
    scratch: &mut Scratch,
) {
    scratch.anchors.clear();
    scratch.folds.clear();
    scratch.multipliers.clear();
    if settings.bind > 0.0 {
        let anchor = |bind: &Bind| transforms[bind.bone as usize].transform_point3(bind.anchor);
        scratch.anchors.extend(island.binds.iter().map(anchor));
    }
    if settings.energy > 0.0 {
        scratch.multipliers.resize(island.tetrahedron_batches.particles.len(), [[0.0; BATCH]; 4]);
    }
    if settings.self_collision {
        scratch.folds.extend(island.cage_contacts.iter().map(|contact| contact.fold_plane(transforms)));
    }
    scratch.active.carry(island, transforms);
    start(island, settings, transforms, scratch);
    free_concerned(island, scratch);
    scratch.work = Work { solved_islands: 1, ..Work::default() };
    scratch.listed = false;
    scratch.sweeps = 0;
    for iteration in 0..settings.iterations {
        // Every second sweep runs backwards, so that no end of the island is always served last.
        let backwards = iteration % 2 == 1;
        let progress = iteration as f32 / settings.iterations as f32;
        let stretch =
            if settings.anneal_stretch { settings.stretch * (1.0 - progress) } else { settings.stretch };
        sweep_stretch(island, stretch, backwards, scratch);
        sweep_volume(island, settings.volume, backwards, scratch);
        sweep_bind(island, settings.bind, scratch);
        sweep_energy(island, settings, scratch);
        // Before the volumes are nearly right, what seems to touch need not touch.
        if 2 * iteration >= settings.iterations {
            sweep_contacts(island, scratch);
        }
    }
    for sweep in 0..settings.volume_sweeps {
        let backwards = (settings.iterations + sweep) % 2 == 1;
        sweep_volume(island, settings.volume, backwards, scratch);
        sweep_contacts(island, scratch);
    }
    if settings.volume > 0.0 {
        let Scratch { active, particles, flat, .. } = scratch;
        untangle(&island.tetrahedron_batches, island.rest_volume, &active.tetrahedra, particles, flat);
    }
}

/// The start state: particles skinned by their own weights, none of them free yet. What no moved bone
/// carries is where it was.
fn start(island: &Island, settings: &PbdSettings, transforms: &[Affine3A], scratch: &mut Scratch) {
    let Scratch { particles, folds, active, bends, .. } = scratch;
    let linear = match settings.start {
        Start::Linear => true,
        Start::DualQuaternion => false,
        Start::Auto => settings.volume <= 0.0,
    };
    bends.clear();
    if settings.start == Start::Auto && !linear {
        let joints = island.cage_contacts.iter().zip(folds.iter());
        bends.extend(joints.filter_map(|(contact, fold)| {
            let share = BEND_LINEAR * fold.as_ref()?.bend_share;
            (share > 0.0).then_some((contact.bone, contact.parent, share))
        }));
    }
    let blended = Skinning::linear(transforms);
    let skinning = if linear { blended.clone() } else { Skinning::dual_quaternion(transforms, None) };
    particles.clear();
    particles.extend(island.rest.iter().enumerate().map(|(i, &rest)| {
        let mut place = rest;
        if active.is_concerned(i as u32) {
            let row = island.weights.row(i);
            place = skinning.vertex(rest, row);
            let share = if island.inverse_masses[i] > 0.0 { linear_share(row, bends) } else { 0.0 };
            if share > 0.0 {
                place = place.lerp(blended.vertex(rest, row), share);
            }
        }
        f32x4::new([place.x, place.y, place.z, 0.0])
    }));
    particles.push(f32x4::splat(0.0));
}

/// Frees what the pose concerns: what moved bones carry, what may come into contact from the start
/// state, and the rings around it.
fn free_concerned(island: &Island, scratch: &mut Scratch) {
    list_near(island, scratch);
    let Scratch { active, particles, folds, near, .. } = scratch;
    for ((contact, fold), near) in island.cage_contacts.iter().zip(folds).zip(near) {
        for &candidate in near.iter().filter(|_| fold.is_some()) {
            let point = &island.surface[contact.vertices[candidate as usize].element as usize];
            point.corners.iter().for_each(|&corner| active.add(corner));
        }
    }
    active.complete(island);
    for (particle, &mass) in particles.iter_mut().zip(&active.inverse_masses) {
        let [x, y, z, _] = particle.to_array();
        *particle = f32x4::new([x, y, z, mass]);
    }
}

/// Where a joint bends, the start is half way from dual quaternions to linear blending, which sinks
/// the inner side into the fold: contact then parts it no farther than touching. Dual quaternions
/// alone leave a hole at the fold's root that nothing closes; linear blending alone overlaps so far
/// that contact does not part it everywhere.
const BEND_LINEAR: f32 = 0.5;

/// How far a particle starts from linear blending: the joints that bend, as `(bone, parent, share)`,
/// by their part in all the blending between two bones of its row.
fn linear_share((bones, weights): (&[u32], &[f32]), bends: &[(u32, u32, f32)]) -> f32 {
    if bones.len() < 2 || bends.is_empty() {
        return 0.0;
    }
    let weight = |bone: u32| bones.iter().position(|&b| b == bone).map_or(0.0, |place| weights[place]);
    let bent: f32 = bends.iter().map(|&(bone, parent, share)| weight(bone) * weight(parent) * share).sum();
    let pairs = (0..weights.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    let all: f32 = pairs.map(|(i, j)| weights[i] * weights[j]).sum();
    if bent > 0.0 { (bent / all).min(1.0) } else { 0.0 }
}

fn sweep_stretch(island: &Island, stiffness: f32, backwards: bool, scratch: &mut Scratch) {
    if stiffness > 0.0 {
        let Scratch { active, particles, work, .. } = scratch;
        work.projections += BATCH * active.edges.len();
        on_widest_lanes(StretchSweep { island, active, particles, stiffness, backwards });
    }
}

fn sweep_volume(island: &Island, stiffness: f32, backwards: bool, scratch: &mut Scratch) {
    if stiffness > 0.0 {
        let Scratch { active, particles, work, .. } = scratch;
        work.projections += BATCH * active.tetrahedra.len();
        on_widest_lanes(VolumeSweep { island, active, particles, stiffness, backwards });
    }
}

fn sweep_bind(island: &Island, stiffness: f32, scratch: &mut Scratch) {
    let Scratch { particles, anchors, active, work, .. } = scratch;
    work.projections += anchors.len();
    for (bind, &anchor) in island.binds.iter().zip(anchors.iter()) {
        let particle = bind.particle as usize;
        // A heavier particle, where the island ends, follows less.
        let stiffness = stiffness * active.inverse_masses[particle];
        let vector = |v: Vec3| Vector3::from(v.to_array());
        let [x, y, z, _] = particles[particle].to_array();
        let step = project_bind(Vector3::new(x, y, z), vector(anchor), bind.rest_length, stiffness);
        particles[particle] += f32x4::new([step.x, step.y, step.z, 0.0]);
    }
}

fn sweep_energy(island: &Island, settings: &PbdSettings, scratch: &mut Scratch) {
    if settings.energy > 0.0 {
        let Scratch { active, particles, multipliers, work, .. } = scratch;
        work.projections += BATCH * active.tetrahedra.len();
        on_widest_lanes(EnergySweep { island, active, particles, multipliers, settings });
    }
}

/// Lists the candidates of each fold that can come into contact in the sweeps to come.
fn list_near(island: &Island, scratch: &mut Scratch) {
    let Scratch { particles, folds, candidates, near, .. } = scratch;
    near.resize_with(folds.len(), Vec::new);
    for ((contact, fold), near) in island.cage_contacts.iter().zip(folds).zip(near) {
        let Some(fold) = fold else { continue };
        candidates.clear();
        let points = contact.vertices.iter().map(|vertex| &island.surface[vertex.element as usize]);
        candidates.extend(points.map(|point| point.position(particles)));
        contact.list_near(fold, candidates, near);
    }
}

/// Contact sweeps that share the height fields of the folds.
const FIELD_SWEEPS: usize = 4;

/// Pushes contact vertices back through the corners of the tetrahedra that hold them.
fn sweep_contacts(island: &Island, scratch: &mut Scratch) {
    if !scratch.listed {
        list_near(island, scratch);
        scratch.listed = true;
    }
    let Scratch { particles, folds, candidates, near, sweeps, contacts, active, work, .. } = scratch;
    let refill = *sweeps % FIELD_SWEEPS == 0;
    *sweeps += 1;
    contacts.resize_with(folds.len(), ContactScratch::default);
    let joints = island.cage_contacts.iter().zip(folds).zip(near).zip(contacts);
    for (((contact, fold), near), found) in joints {
        let Some(fold) = fold else { continue };
        if near.is_empty() || (!refill && found.level <= 0.0) {
            continue;
        }
        let point_of =
            |listed: usize| &island.surface[contact.vertices[near[listed] as usize].element as usize];
        work.contact_candidates += near.len();
        candidates.clear();
        candidates.extend((0..near.len()).map(|listed| point_of(listed).position(particles)));
        contact.pushes(fold, near, candidates, refill, Firmness::CAGE, found);
        for push in &found.pushes {
            let point = point_of(push.listed as usize);
            // Pushes before this one may have moved the same corners.
            let moved = point.position(particles) - candidates[push.listed as usize];
            let length = push.offset.length();
            let left = length - moved.dot(push.offset) / length;
            let corners = point.corners.map(|corner| corner as usize);
            let w = corners.map(|corner| active.inverse_masses[corner]);
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

/// Σ w b² of a tetrahedron whose corners are all free and share a push alike; what has less takes a
/// part of a push only.
const LEAST_CONTACT_MASS: f32 = 0.25;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Adjacency;
    use crate::pbd::areas::tests::prism;
    use crate::pbd::build::build_islands;
    use crate::pbd::lanes::tests::on_portable_lanes;

    /// Of the prism, which runs from -6 to 6.
    const HEIGHT: f32 = 12.0;

    #[test]
    fn solutions_on_all_lane_widths_agree_to_a_millionth_of_the_height() {
        let (mesh, skeleton, weights) = prism(|_| 1.0);
        let topology = mesh.topology();
        let adjacency = Adjacency::new(mesh.vertex_count(), &topology);
        let turned = |x: f32, turn: Affine3A| {
            Affine3A::from_translation(Vec3::X * x) * turn * Affine3A::from_translation(Vec3::X * -x)
        };
        let bend = turned(-2.0, Affine3A::from_rotation_z(1.4));
        let pose = [Affine3A::IDENTITY, bend, bend * turned(2.0, Affine3A::from_rotation_x(2.0))];
        for settings in [PbdSettings::default(), PbdSettings::paper()] {
            let islands =
                build_islands(&mesh, &skeleton, &weights, &settings, None, &topology, &adjacency).unwrap();
            assert!(!islands.is_empty());
            for island in &islands {
                let solve = || {
                    let mut scratch = Scratch::default();
                    solve_island(island, &settings, &pose, &mut scratch);
                    assert!(scratch.work.projections > 1000 && scratch.is_finite());
                    scratch.particles.iter().map(|p| p.to_array()).collect::<Vec<_>>()
                };
                let (widest, portable) = (solve(), on_portable_lanes(solve));
                let differences = widest.iter().flatten().zip(portable.iter().flatten());
                let largest = differences.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(largest <= 1e-6 * HEIGHT, "{largest}");
            }
        }
    }
}
