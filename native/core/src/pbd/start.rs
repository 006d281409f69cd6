//! The start state of an island in a pose: its particles, skinned by their own weights.

use glam::{Affine3A, Vec3};
use nalgebra::Vector3;
use rayon::prelude::*;
use wide::f32x4;

use super::active::ActivePart;
use super::fold_plane::FoldPlane;
use super::island::Island;
use super::lanes::Particle;
use super::{PbdSettings, Start, signed_volume};
use crate::skinning::Skinning;

/// Where a joint bends, how far the start is from linear blending, which sinks the inner side into the
/// fold: contact then parts it no farther than touching. Dual quaternions alone leave a hole at the
/// fold's root that nothing closes; linear blending alone overlaps so far that contact does not part
/// it everywhere.
const BEND_LINEAR: f32 = 0.25;
/// Share of its rest volume from which on a tetrahedron takes its corners no farther towards linear
/// blending: what starts inside out has many ways back, and takes another one in the next pose.
const LEAST_START_VOLUME: f32 = 0.6;
/// Particles that are skinned in one task.
const CHUNK: usize = 2048;

/// Buffers of the start state.
#[derive(Debug, Clone, Default)]
pub(super) struct StartState {
    /// Joints that bend, and how far the start is from linear blending between their bones.
    bends: Vec<(usize, f32)>,
    /// Joints that bend by their part in the blending of each particle, as a sum.
    sinks: Vec<f32>,
    /// Where dual quaternions put each particle, and its way from there towards linear blending.
    places: Vec<(Vec3, Vec3)>,
    /// Share of that way that it goes.
    shares: Vec<f32>,
    /// Where it is at the end of it.
    ends: Vec<Particle>,
}

impl StartState {
    /// Puts all particles in their places, none of them free yet; what no moved bone carries stays where it
    /// was. `transforms` are relative to the island's frame, `folds` the joints whose bones form one, by their
    /// places in the island's list.
    pub(super) fn place<'a>(
        &mut self,
        island: &Island,
        settings: &PbdSettings,
        transforms: &[Affine3A],
        active: &ActivePart,
        folds: impl Iterator<Item = (usize, &'a FoldPlane)>,
        particles: &mut Vec<Particle>,
    ) {
        let linear = match settings.start {
            Start::Linear => true,
            Start::DualQuaternion => false,
            Start::Auto => settings.volume <= 0.0,
        };
        self.bends.clear();
        if settings.start == Start::Auto && !linear {
            let joints = folds.map(|(joint, fold)| (joint, BEND_LINEAR * fold.bend_share));
            self.bends.extend(joints.filter(|&(_, share)| share > 0.0));
        }
        self.sink(island);
        let blended = Skinning::linear(transforms);
        let skinning = if linear { blended.clone() } else { Skinning::dual_quaternion(transforms, None) };
        let sinks = self.sinks.as_slice();
        let place_of = |i: usize| {
            if !active.is_carried(i) {
                return (island.rest[i], Vec3::ZERO);
            }
            let row = island.weights.row(i);
            let place = skinning.vertex(island.rest[i], row);
            if sinks[i] <= 0.0 {
                return (place, Vec3::ZERO);
            }
            // By their part in all the blending between two bones of its row.
            let share = (sinks[i] / island.blends.all[i]).min(1.0);
            (place, (blended.vertex(island.rest[i], row) - place) * share)
        };
        self.places.resize(island.rest.len(), (Vec3::ZERO, Vec3::ZERO));
        self.places.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, places)| {
            (chunk * CHUNK..).zip(places).for_each(|(i, place)| *place = place_of(i));
        });
        self.limit(island);
        particles.clear();
        particles.extend(
            self.places
                .iter()
                .zip(&self.shares)
                .map(|(&(place, sinking), &share)| particle(place + sinking * share)),
        );
    }

    /// Sums the bends of the joints that each particle blends between.
    fn sink(&mut self, island: &Island) {
        let Self { bends, sinks, .. } = self;
        sinks.clear();
        sinks.resize(island.rest.len(), 0.0);
        for &(joint, share) in bends.iter() {
            for &(particle, product) in island.blends.particles(joint) {
                sinks[particle as usize] += product * share;
            }
        }
    }

    /// Lets no tetrahedron shrink far on the way towards linear blending.
    fn limit(&mut self, island: &Island) {
        let Self { bends, places, ends, shares, .. } = self;
        shares.clear();
        shares.resize(places.len(), 1.0);
        ends.clear();
        ends.extend(places.iter().map(|&(place, sinking)| particle(place + sinking)));
        let least = LEAST_START_VOLUME * island.rest_volume;
        let limit_of = |corners: &[u32; 4]| {
            let all = signed_volume(corners.map(|corner| {
                let [x, y, z, _] = ends[corner as usize].to_array();
                Vector3::new(x, y, z)
            }));
            if all >= least {
                return None;
            }
            let none =
                signed_volume(corners.map(|corner| Vector3::from(places[corner as usize].0.to_array())));
            (all < none).then(|| ((none - least) / (none - all)).clamp(0.0, 1.0))
        };
        for tetrahedron in island.blends.tetrahedra(bends.iter().map(|&(joint, _)| joint)) {
            let corners = &island.tetrahedra[tetrahedron as usize];
            if let Some(limit) = limit_of(corners) {
                for &corner in corners {
                    let share = &mut shares[corner as usize];
                    *share = share.min(limit);
                }
            }
        }
    }
}

/// A particle that is not free yet.
fn particle(place: Vec3) -> Particle {
    f32x4::new([place.x, place.y, place.z, 0.0])
}
