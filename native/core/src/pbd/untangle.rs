//! The last word on volume: no tetrahedron ends nearly flat or inside out.

use super::batches::Batches;
use super::corners::BatchCorners;
use super::lanes::{BATCH, Lanes, OnLanes, Particle, on_widest_lanes};
use super::sweeps::load_tetrahedra;
use super::{Real, least_volume_divisor, project_volume, signed_volume};

/// Share of its rest volume that every tetrahedron keeps.
const LEAST_VOLUME: f32 = 0.1;

/// One sweep that projects the volume constraint as an inequality: opens tetrahedra of the `active`
/// batches that have less than a share of their rest volume, and no others. Their batches are left in `flat`.
pub(super) fn untangle(
    batches: &Batches<4>,
    rest_volume: f32,
    active: &[u32],
    particles: &mut [Particle],
    flat: &mut Vec<u32>,
) {
    let least_volume = LEAST_VOLUME * rest_volume;
    flat.clear();
    let too_flat = |volume: f32| volume < least_volume;
    on_widest_lanes(Look {
        batches,
        active,
        particles,
        sought: too_flat,
        found: |batch, _| flat.push(batch),
    });
    if !flat.is_empty() {
        let least_divisor = least_volume_divisor(rest_volume);
        on_widest_lanes(Untangling { batches, flat, particles, least_volume, least_divisor });
    }
}

/// Tetrahedra of the `active` batches that are inside out.
pub(super) fn count_inverted(batches: &Batches<4>, active: &[u32], particles: &mut [Particle]) -> usize {
    let mut count = 0;
    let inverted = |volume: f32| volume <= 0.0;
    on_widest_lanes(Look { batches, active, particles, sought: inverted, found: |_, among| count += among });
    count
}

/// Looks for tetrahedra of a signed volume that is `sought`.
struct Look<'a, S, F> {
    batches: &'a Batches<4>,
    active: &'a [u32],
    particles: &'a mut [Particle],
    sought: S,
    /// Takes each batch that has some, with their number.
    found: F,
}

impl<S: Fn(f32) -> bool, F: FnMut(u32, usize)> OnLanes for Look<'_, S, F> {
    #[inline(always)]
    fn run<L: Lanes>(mut self, lanes: L) {
        // Lanes of the particle without mass hold no tetrahedron.
        let idle = self.particles.len() as u32 - 1;
        let mut all = self.batches.corners.of(self.particles);
        for &batch in self.active {
            let corners = all.batch(batch as usize);
            let volumes = volumes(lanes, &corners);
            // Nearly always none.
            if volumes.iter().any(|&volume| (self.sought)(volume)) {
                let named = volumes.into_iter().zip(corners.indices(0));
                let count = named.filter(|&(v, corner)| corner != idle && (self.sought)(v)).count();
                if count > 0 {
                    (self.found)(batch, count);
                }
            }
        }
    }
}

/// Signed volumes of the tetrahedra in a batch.
#[inline(always)]
fn volumes<L: Lanes>(lanes: L, corners: &BatchCorners<'_, 4>) -> [f32; BATCH] {
    let mut volumes = [0.0; BATCH];
    for part in 0..L::PARTS {
        lanes.write(&mut volumes, part, signed_volume(load_tetrahedra(lanes, corners, part).0));
    }
    volumes
}

struct Untangling<'a> {
    batches: &'a Batches<4>,
    flat: &'a [u32],
    particles: &'a mut [Particle],
    least_volume: f32,
    least_divisor: f32,
}

impl OnLanes for Untangling<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { batches, flat, .. } = self;
        let mut all = batches.corners.of(self.particles);
        let (one, least_volume) = (lanes.splat(1.0), lanes.splat(self.least_volume));
        let least_divisor = lanes.splat(self.least_divisor);
        for &batch in flat {
            let mut corners = all.batch(batch as usize);
            for part in 0..L::PARTS {
                let (p, w) = load_tetrahedra(lanes, &corners, part);
                let stiffness = one.where_above(least_volume, signed_volume(p));
                let steps = project_volume(p, w, least_volume, least_divisor, stiffness);
                for k in 0..4 {
                    lanes.store(&mut corners, k, part, p[k] + steps[k], w[k]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pbd::lanes::Portable;
    use wide::f32x4;

    /// Two tetrahedra on a common triangle, of which one tip has passed through it by `depth`.
    fn pair(depth: f32, mass: f32) -> (Batches<4>, Vec<Particle>) {
        let rows = [
            [0.0, 0.0, 0.0, mass],
            [1.0, 0.0, 0.0, mass],
            [0.0, 1.0, 0.0, mass],
            [0.0, 0.0, -depth, 1.0],
            [0.0, 0.0, -1.0, mass],
            [0.0; 4],
        ];
        (Batches::new(&[[0, 1, 2, 3], [0, 2, 1, 4]], 5), rows.map(f32x4::new).to_vec())
    }

    #[test]
    fn what_is_inside_out_is_opened() {
        for mass in [0.0, 1.0] {
            let (batches, mut particles) = pair(0.3, mass);
            let active = Vec::from_iter(0..batches.corners.batches().len() as u32);
            assert_eq!(count_inverted(&batches, &active, &mut particles), 1);
            let mut flat = vec![0];
            for _ in 0..40 {
                untangle(&batches, 1.0 / 6.0, &active, &mut particles, &mut flat);
            }
            assert!(flat.is_empty());
            assert_eq!(count_inverted(&batches, &active, &mut particles), 0);
            let least = 0.99 * LEAST_VOLUME / 6.0;
            let mut all = batches.corners.of(&mut particles);
            assert!(active.iter().all(|&b| volumes(Portable, &all.batch(b as usize))[0] >= least));
        }
    }

    #[test]
    fn what_is_open_enough_or_not_active_stays() {
        let (batches, before) = pair(-1.1 * LEAST_VOLUME, 1.0);
        let active = Vec::from_iter(0..batches.corners.batches().len() as u32);
        let mut particles = before.clone();
        untangle(&batches, 1.0 / 6.0, &active, &mut particles, &mut Vec::new());
        assert_eq!(particles, before);
        let (batches, before) = pair(0.3, 1.0);
        let mut particles = before.clone();
        untangle(&batches, 1.0 / 6.0, &[], &mut particles, &mut Vec::new());
        assert_eq!(particles, before);
    }
}
