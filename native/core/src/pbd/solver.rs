//! The loop of Algorithm 1 on one island: Gauss-Seidel over its constraints, in a fixed order.

use glam::{Affine3A, Vec3};
use nalgebra::Vector3;
use wide::f32x4;

use super::active::ActivePart;
use super::cage_contact::CageContacts;
use super::domains::{Domain, sweep};
use super::island::{Bind, Island, SurfacePoint};
use super::lanes::{BATCH, Particle, on_widest_lanes};
use super::start::StartState;
use super::stats::Work;
use super::sweeps::{EnergySweep, StretchSweep, VolumeSweep};
use super::untangle::{count_inverted, untangle};
use super::{PbdSettings, project_bind};

/// Buffers of one island, kept between frames for it alone; what they hold does not matter.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    /// The particles, the result.
    pub particles: Vec<Particle>,
    domains: Vec<DomainScratch>,
    contacts: CageContacts,
    active: ActivePart,
    start: StartState,
    /// True where the last look at all of it found nothing nearly flat.
    is_open: bool,
    /// What the pose took.
    pub work: Work,
}

/// Buffers of one domain.
#[derive(Debug, Clone, Default)]
struct DomainScratch {
    /// Batches of edges with a free end, and of tetrahedra with a free corner.
    edges: Vec<u32>,
    tetrahedra: Vec<u32>,
    multipliers: Vec<[[f32; BATCH]; 4]>,
    anchors: Vec<Vec3>,
    /// Batches with tetrahedra that are too flat.
    flat: Vec<u32>,
    projections: usize,
}

impl Scratch {
    /// False where absurd transforms have made the result overflow.
    pub(super) fn is_finite(&self) -> bool {
        // What is not finite, times zero, is no number.
        let sum = self.particles.iter().fold(f32x4::ZERO, |sum, particle| sum + *particle * f32x4::ZERO);
        sum.to_array() == [0.0; 4]
    }

    /// False for a point of the surface that is carried as plain skinning carries it; `bones` are those of its
    /// vertex.
    pub(super) fn concerns(&self, point: &SurfacePoint, bones: &[u32]) -> bool {
        self.active.concerns(&point.corners, bones)
    }

    /// How often what the pose concerns has changed.
    pub(super) fn changes(&self) -> u64 {
        self.active.changes
    }

    /// Tetrahedra that are inside out. Those that the pose does not concern are as in rest.
    pub(super) fn inverted(&mut self, island: &Island) -> usize {
        if self.is_open {
            return 0;
        }
        let counts = island.domains.iter().zip(&self.domains).map(|(domain, scratch)| {
            let particles = &mut self.particles[domain.particles.clone()];
            count_inverted(&domain.tetrahedra, &scratch.tetrahedra, particles)
        });
        counts.sum()
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
    scratch.contacts.begin(island, settings, transforms);
    scratch.active.carry(island, transforms);
    let Scratch { particles, contacts, active, start, .. } = scratch;
    start.place(island, settings, transforms, active, contacts.folds(), particles);
    let is_new = free_concerned(island, scratch);
    take_constraints(island, settings, transforms, scratch, is_new);
    scratch.work = Work { solved_islands: 1, ..Work::default() };
    for iteration in 0..settings.iterations {
        // Every second sweep runs backwards, so that no end of the island is always served last.
        let backwards = iteration % 2 == 1;
        let progress = iteration as f32 / settings.iterations as f32;
        let stretch =
            if settings.anneal_stretch { settings.stretch * (1.0 - progress) } else { settings.stretch };
        let Scratch { particles, domains, active, .. } = scratch;
        let masses = &active.inverse_masses;
        sweep(&island.domains, particles, domains, backwards, &|domain, particles, scratch| {
            sweep_stretch(domain, stretch, backwards, particles, scratch);
            sweep_volume(domain, island.rest_volume, settings.volume, backwards, particles, scratch);
            sweep_bind(domain, settings.bind, masses, particles, scratch);
            sweep_energy(domain, settings, particles, scratch);
        });
        // Before the volumes are nearly right, what seems to touch need not touch.
        if 2 * iteration >= settings.iterations {
            sweep_contacts(island, scratch);
        }
    }
    for step in 0..settings.volume_sweeps {
        let backwards = (settings.iterations + step) % 2 == 1;
        let Scratch { particles, domains, .. } = scratch;
        sweep(&island.domains, particles, domains, backwards, &|domain, particles, scratch| {
            sweep_volume(domain, island.rest_volume, settings.volume, backwards, particles, scratch);
        });
        sweep_contacts(island, scratch);
    }
    scratch.is_open = settings.volume > 0.0 && untangle_all(island, scratch);
    scratch.work.projections = scratch.domains.iter().map(|domain| domain.projections).sum();
}

/// Opens what is nearly flat, domain by domain. True where nothing is left of it.
fn untangle_all(island: &Island, scratch: &mut Scratch) -> bool {
    let Scratch { particles, domains, .. } = scratch;
    for _ in 0..MOST_UNTANGLING_SWEEPS {
        sweep(&island.domains, particles, domains, false, &|domain, particles, scratch| {
            let DomainScratch { tetrahedra, flat, .. } = scratch;
            untangle(&domain.tetrahedra, island.rest_volume, tetrahedra, particles, flat);
        });
        if domains.iter().all(|domain| domain.flat.is_empty()) {
            return true;
        }
    }
    false
}

/// Finds the constraints that what is free takes part in, unless they are known.
fn take_constraints(
    island: &Island,
    settings: &PbdSettings,
    transforms: &[Affine3A],
    scratch: &mut Scratch,
    is_new: bool,
) {
    let Scratch { particles, domains, active, .. } = scratch;
    domains.resize_with(island.domains.len(), DomainScratch::default);
    let free = &active.free;
    sweep(&island.domains, particles, domains, false, &|domain, _, scratch| {
        if is_new {
            let free = &free[domain.particles.clone()];
            domain.edges.select(free, &mut scratch.edges);
            domain.tetrahedra.select(free, &mut scratch.tetrahedra);
        }
        scratch.projections = 0;
        scratch.anchors.clear();
        if settings.bind > 0.0 {
            let anchor = |bind: &Bind| transforms[bind.bone as usize].transform_point3(bind.anchor);
            scratch.anchors.extend(domain.binds.iter().map(anchor));
        }
        scratch.multipliers.clear();
        if settings.energy > 0.0 {
            scratch.multipliers.resize(domain.tetrahedra.corners.batches().len(), [[0.0; BATCH]; 4]);
        }
    });
}

/// Sweeps that open what is nearly flat, at most.
const MOST_UNTANGLING_SWEEPS: usize = 40;

/// Frees what the pose concerns: what is deformed, what may come into contact from the start state, and
/// the rings around it. False where it is what the pose before concerned.
fn free_concerned(island: &Island, scratch: &mut Scratch) -> bool {
    let Scratch { active, particles, contacts, .. } = scratch;
    contacts.list_near(island, particles);
    let is_new = active.complete(island, contacts.near(island).flat_map(|point| point.corners));
    for (particle, &mass) in particles.iter_mut().zip(&active.inverse_masses) {
        let [x, y, z, _] = particle.to_array();
        *particle = f32x4::new([x, y, z, mass]);
    }
    is_new
}

fn sweep_stretch(
    domain: &Domain,
    stiffness: f32,
    backwards: bool,
    particles: &mut [Particle],
    scratch: &mut DomainScratch,
) {
    if stiffness > 0.0 {
        let active = &scratch.edges;
        scratch.projections += BATCH * active.len();
        on_widest_lanes(StretchSweep { domain, active, particles, stiffness, backwards });
    }
}

fn sweep_volume(
    domain: &Domain,
    rest_volume: f32,
    stiffness: f32,
    backwards: bool,
    particles: &mut [Particle],
    scratch: &mut DomainScratch,
) {
    if stiffness > 0.0 {
        let active = &scratch.tetrahedra;
        scratch.projections += BATCH * active.len();
        on_widest_lanes(VolumeSweep { domain, active, particles, rest_volume, stiffness, backwards });
    }
}

fn sweep_bind(
    domain: &Domain,
    stiffness: f32,
    inverse_masses: &[f32],
    particles: &mut [Particle],
    scratch: &mut DomainScratch,
) {
    let DomainScratch { anchors, projections, .. } = scratch;
    *projections += anchors.len();
    let inverse_masses = &inverse_masses[domain.particles.clone()];
    for (bind, &anchor) in domain.binds.iter().zip(anchors.iter()) {
        let particle = bind.particle as usize;
        // A heavier particle, where the island ends, follows less.
        let stiffness = stiffness * inverse_masses[particle];
        let vector = |v: Vec3| Vector3::from(v.to_array());
        let [x, y, z, _] = particles[particle].to_array();
        let step = project_bind(Vector3::new(x, y, z), vector(anchor), bind.rest_length, stiffness);
        particles[particle] += f32x4::new([step.x, step.y, step.z, 0.0]);
    }
}

fn sweep_energy(
    domain: &Domain,
    settings: &PbdSettings,
    particles: &mut [Particle],
    scratch: &mut DomainScratch,
) {
    if settings.energy > 0.0 {
        let DomainScratch { tetrahedra: active, multipliers, projections, .. } = scratch;
        *projections += BATCH * active.len();
        on_widest_lanes(EnergySweep { domain, active, particles, multipliers, settings });
    }
}

fn sweep_contacts(island: &Island, scratch: &mut Scratch) {
    let Scratch { particles, contacts, active, work, .. } = scratch;
    contacts.sweep(island, &active.inverse_masses, particles, work);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Adjacency, TriangleMesh};
    use crate::pbd::areas::tests::prism;
    use crate::pbd::build::build_islands;
    use crate::pbd::island::position;
    use crate::pbd::lanes::tests::on_portable_lanes;
    use crate::pbd::{Start, signed_volume};
    use crate::rig::Skeleton;
    use crate::skinning::SkinWeights;

    /// Of the prism, which runs from -6 to 6.
    const HEIGHT: f32 = 12.0;

    fn bent_prism() -> (TriangleMesh, Skeleton, SkinWeights, [Affine3A; 3]) {
        let (mesh, skeleton, weights) = prism(|_| 1.0);
        let turned = |x: f32, turn: Affine3A| {
            Affine3A::from_translation(Vec3::X * x) * turn * Affine3A::from_translation(Vec3::X * -x)
        };
        let bend = turned(-2.0, Affine3A::from_rotation_z(1.4));
        let pose = [Affine3A::IDENTITY, bend, bend * turned(2.0, Affine3A::from_rotation_x(2.0))];
        (mesh, skeleton, weights, pose)
    }

    fn islands_of(settings: &PbdSettings) -> (Vec<Island>, [Affine3A; 3]) {
        let (mesh, skeleton, weights, pose) = bent_prism();
        let topology = mesh.topology();
        let adjacency = Adjacency::new(mesh.vertex_count(), &topology);
        let islands =
            build_islands(&mesh, &skeleton, &weights, settings, None, &topology, &adjacency).unwrap();
        assert!(!islands.is_empty());
        (islands, pose)
    }

    #[test]
    fn solutions_on_all_lane_widths_agree_to_a_millionth_of_the_height() {
        let fine = PbdSettings { cell_size: Some(0.25), ..PbdSettings::paper() };
        for settings in [PbdSettings::default(), PbdSettings::paper(), fine] {
            let (islands, pose) = islands_of(&settings);
            assert_eq!(settings.cell_size.is_some(), islands[0].domains.len() > 1, "only large ones are cut");
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

    #[test]
    fn tetrahedra_inside_out_are_counted_whether_they_were_looked_at_or_not() {
        let unsolved =
            PbdSettings { iterations: 0, volume_sweeps: 0, start: Start::Linear, ..PbdSettings::default() };
        let not_opened = PbdSettings { volume: 0.0, ..unsolved };
        for (settings, is_looked_at) in
            [(PbdSettings::default(), true), (unsolved, true), (not_opened, false)]
        {
            let (islands, [still, _, _]) = islands_of(&settings);
            // Turned by half, linear blending draws everything through the middle of the joint.
            let turned = Affine3A::from_translation(Vec3::X * -2.0)
                * Affine3A::from_rotation_x(3.1)
                * Affine3A::from_rotation_z(1.0)
                * Affine3A::from_translation(Vec3::X * 2.0);
            let mut total = 0;
            for island in &islands {
                let mut scratch = Scratch::default();
                solve_island(island, &settings, &[still, turned, turned], &mut scratch);
                let at = |place: u32| {
                    let [x, y, z, _] = scratch.particles[place as usize].to_array();
                    Vector3::new(x, y, z)
                };
                let inverted = island.tetrahedra.iter().filter(|t| signed_volume(t.map(at)) <= 0.0).count();
                assert_eq!(scratch.inverted(island), inverted);
                assert!(is_looked_at || !scratch.is_open);
                total += inverted;
            }
            assert!(is_looked_at || total > 0);
        }
    }

    #[test]
    fn what_one_bone_carries_is_not_solved_far_from_where_it_bends() {
        let settings = PbdSettings { cell_size: Some(0.35), ..PbdSettings::default() };
        let (islands, [still, bend, _]) = islands_of(&settings);
        let pose = [still, bend, bend];
        for island in &islands {
            let mut scratch = Scratch::default();
            solve_island(island, &settings, &pose, &mut scratch);
            let mut rigid = 0;
            for (place, particle) in scratch.particles.iter().enumerate() {
                let (row, free) = (island.weights.row(place).0, scratch.active.free[place]);
                if island.inverse_masses[place] > 0.0 && !free {
                    let carried = pose[row[0] as usize].transform_point3(island.rest[place]);
                    assert!(position(*particle).distance(carried) < 1e-5);
                    rigid += usize::from(row[0] > 0);
                }
            }
            assert!(rigid > 50, "{rigid}");
        }
    }

    #[test]
    fn what_is_kept_from_pose_to_pose_changes_no_bit() {
        let settings = PbdSettings { cell_size: Some(0.35), ..PbdSettings::default() };
        let (islands, [still, bend, twisted]) = islands_of(&settings);
        let more = Affine3A::from_rotation_z(0.05) * bend;
        let poses = [[still, bend, bend], [still, more, more], [still, bend, twisted], [still, bend, bend]];
        for island in &islands {
            let mut kept = Scratch::default();
            let mut changes = Vec::new();
            for pose in &poses {
                let mut fresh = Scratch::default();
                solve_island(island, &settings, pose, &mut kept);
                solve_island(island, &settings, pose, &mut fresh);
                assert!(kept.particles == fresh.particles && kept.work == fresh.work);
                assert_eq!(kept.inverted(island), fresh.inverted(island));
                changes.push(kept.changes());
            }
            assert!(changes[2] > changes[1] && changes[3] > changes[2], "other bones move: {changes:?}");
        }
    }
}
