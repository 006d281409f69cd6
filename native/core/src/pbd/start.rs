//! The start state of an island in a pose: its particles, skinned by their own weights.

use glam::{Affine3A, Vec3};
use nalgebra::Vector3;
use rayon::prelude::*;
use wide::f32x4;

use super::active::ActivePart;
use super::contact::JointContact;
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
/// Particles that are skinned, and tetrahedra that are looked at, in one task.
const CHUNK: usize = 1024;

/// Buffers of the start state.
#[derive(Debug, Clone, Default)]
pub(super) struct StartState {
    /// Joints that bend: bone, parent, and how far the start is from linear blending.
    bends: Vec<(u32, u32, f32)>,
    /// Where dual quaternions put each particle, and its way from there towards linear blending.
    places: Vec<(Vec3, Vec3)>,
    /// True for particles that have such a way.
    sinks: Vec<bool>,
    /// Share of that way that it goes.
    shares: Vec<f32>,
    /// Tetrahedra that let their corners go a share of the way only.
    limits: Vec<(u32, f32)>,
}

impl StartState {
    /// Puts all particles in their places, none of them free yet; what no moved bone carries stays where it
    /// was. `transforms` are relative to the island's frame, `folds` the joints whose bones form one.
    pub(super) fn place<'a>(
        &mut self,
        island: &Island,
        settings: &PbdSettings,
        transforms: &[Affine3A],
        active: &ActivePart,
        folds: impl Iterator<Item = (&'a JointContact, &'a FoldPlane)>,
        particles: &mut Vec<Particle>,
    ) {
        let linear = match settings.start {
            Start::Linear => true,
            Start::DualQuaternion => false,
            Start::Auto => settings.volume <= 0.0,
        };
        self.bends.clear();
        if settings.start == Start::Auto && !linear {
            let joints = folds.map(|(contact, fold)| (contact, BEND_LINEAR * fold.bend_share));
            let bent = joints.filter(|&(_, share)| share > 0.0);
            self.bends.extend(bent.map(|(contact, share)| (contact.bone, contact.parent, share)));
        }
        let blended = Skinning::linear(transforms);
        let skinning = if linear { blended.clone() } else { Skinning::dual_quaternion(transforms, None) };
        let bends = self.bends.as_slice();
        let place_of = |i: usize| {
            if !active.is_carried(i) {
                return (island.rest[i], Vec3::ZERO);
            }
            let row = island.weights.row(i);
            let place = skinning.vertex(island.rest[i], row);
            let share = if island.inverse_masses[i] > 0.0 { linear_share(row, bends) } else { 0.0 };
            let sinking = match share > 0.0 {
                true => (blended.vertex(island.rest[i], row) - place) * share,
                false => Vec3::ZERO,
            };
            (place, sinking)
        };
        self.places.resize(island.rest.len(), (Vec3::ZERO, Vec3::ZERO));
        self.places.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, places)| {
            (chunk * CHUNK..).zip(places).for_each(|(i, place)| *place = place_of(i));
        });
        self.limit(island);
        particles.clear();
        particles.extend(self.places.iter().zip(&self.shares).map(|(&(place, sinking), &share)| {
            let place = place + sinking * share;
            f32x4::new([place.x, place.y, place.z, 0.0])
        }));
    }

    /// Lets no tetrahedron shrink far on the way towards linear blending.
    fn limit(&mut self, island: &Island) {
        let Self { bends, places, sinks, shares, limits } = self;
        shares.clear();
        shares.resize(places.len(), 1.0);
        limits.clear();
        if bends.is_empty() {
            return;
        }
        sinks.clear();
        sinks.extend(places.iter().map(|&(_, sinking)| sinking != Vec3::ZERO));
        let least = LEAST_START_VOLUME * island.rest_volume;
        let limit_of = |corners: &[u32; 4]| {
            if !corners.iter().any(|&corner| sinks[corner as usize]) {
                return None;
            }
            let places = corners.map(|corner| places[corner as usize]);
            let volume = |share: f32| {
                signed_volume(
                    places.map(|(place, sinking)| Vector3::from((place + sinking * share).to_array())),
                )
            };
            let (none, all) = (volume(0.0), volume(1.0));
            (all < least && all < none).then(|| ((none - least) / (none - all)).clamp(0.0, 1.0))
        };
        limits.par_extend(
            island
                .tetrahedra
                .par_iter()
                .enumerate()
                .with_min_len(CHUNK)
                .filter_map(|(tetrahedron, corners)| Some((tetrahedron as u32, limit_of(corners)?))),
        );
        for &(tetrahedron, limit) in limits.iter() {
            for corner in island.tetrahedra[tetrahedron as usize] {
                let share = &mut shares[corner as usize];
                *share = share.min(limit);
            }
        }
    }
}

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
