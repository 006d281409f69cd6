//! Gauss-Seidel sweeps over the batches of a domain, for any kind of registers.

use nalgebra::Vector3;

use super::corners::BatchCorners;
use super::domains::Domain;
use super::lanes::{BATCH, Lanes, OnLanes, Particle};
use super::{
    EnergyForm, PbdSettings, least_volume_divisor, project_energy, project_energy_paper, project_stretch,
    project_volume,
};

/// The batch that is served at a step of a sweep.
#[inline(always)]
fn batch_at(batches: &[u32], step: usize, backwards: bool) -> usize {
    batches[if backwards { batches.len() - 1 - step } else { step }] as usize
}

/// Stretch constraints (eq. 6) of all active edges.
pub(super) struct StretchSweep<'a> {
    pub domain: &'a Domain,
    /// Batches with a free particle.
    pub active: &'a [u32],
    pub particles: &'a mut [Particle],
    pub stiffness: f32,
    pub backwards: bool,
}

impl OnLanes for StretchSweep<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let domain = self.domain;
        let mut all = domain.edges.corners.of(self.particles);
        let stiffness = lanes.splat(self.stiffness);
        for step in 0..self.active.len() {
            let batch = batch_at(self.active, step, self.backwards);
            let mut ends = all.batch(batch);
            for part in 0..L::PARTS {
                let ((p, w), (q, v)) = (lanes.load(&ends, 0, part), lanes.load(&ends, 1, part));
                let rest_length = lanes.read(&domain.rest_lengths[batch][0], part);
                let steps = project_stretch([p, q], [w, v], rest_length, stiffness);
                lanes.store(&mut ends, 0, part, p + steps[0], w);
                lanes.store(&mut ends, 1, part, q + steps[1], v);
            }
        }
    }
}

/// Positions and inverse masses of the corners of tetrahedra.
#[inline(always)]
pub(super) fn load_tetrahedra<L: Lanes>(
    lanes: L,
    corners: &BatchCorners<'_, 4>,
    part: usize,
) -> ([Vector3<L::Real>; 4], [L::Real; 4]) {
    let (a, s) = lanes.load(corners, 0, part);
    let (b, t) = lanes.load(corners, 1, part);
    let (c, u) = lanes.load(corners, 2, part);
    let (d, v) = lanes.load(corners, 3, part);
    ([a, b, c, d], [s, t, u, v])
}

/// Volume constraints (eq. 7) of all active tetrahedra.
pub(super) struct VolumeSweep<'a> {
    pub domain: &'a Domain,
    /// Batches with a free particle.
    pub active: &'a [u32],
    pub particles: &'a mut [Particle],
    /// Rest volume of a tetrahedron.
    pub rest_volume: f32,
    pub stiffness: f32,
    pub backwards: bool,
}

impl OnLanes for VolumeSweep<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let mut all = self.domain.tetrahedra.corners.of(self.particles);
        let stiffness = lanes.splat(self.stiffness);
        let rest_volume = lanes.splat(self.rest_volume);
        let least_divisor = lanes.splat(least_volume_divisor(self.rest_volume));
        for step in 0..self.active.len() {
            let mut corners = all.batch(batch_at(self.active, step, self.backwards));
            for part in 0..L::PARTS {
                let (p, w) = load_tetrahedra(lanes, &corners, part);
                let steps = project_volume(p, w, rest_volume, least_divisor, stiffness);
                for k in 0..4 {
                    lanes.store(&mut corners, k, part, p[k] + steps[k], w[k]);
                }
            }
        }
    }
}

#[inline(always)]
fn read_four<L: Lanes>(lanes: L, numbers: &[[f32; BATCH]; 4], part: usize) -> [L::Real; 4] {
    [
        lanes.read(&numbers[0], part),
        lanes.read(&numbers[1], part),
        lanes.read(&numbers[2], part),
        lanes.read(&numbers[3], part),
    ]
}

/// Energy constraints (eq. 8-11) of all active tetrahedra.
pub(super) struct EnergySweep<'a> {
    pub domain: &'a Domain,
    /// Batches with a free particle.
    pub active: &'a [u32],
    pub particles: &'a mut [Particle],
    pub multipliers: &'a mut [[[f32; BATCH]; 4]],
    pub settings: &'a PbdSettings,
}

impl OnLanes for EnergySweep<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { domain, multipliers, settings, .. } = self;
        let mut all = domain.tetrahedra.corners.of(self.particles);
        let (one, strength) = (lanes.splat(1.0), lanes.splat(settings.energy));
        for &batch in self.active {
            let batch = batch as usize;
            let mut corners = all.batch(batch);
            for part in 0..L::PARTS {
                let (mut p, w) = load_tetrahedra(lanes, &corners, part);
                let lengths = read_four(lanes, &domain.spring_lengths[batch], part);
                match settings.energy_form {
                    EnergyForm::Compliant => {
                        let mut stiffness = lanes.splat(settings.energy * settings.stiffness);
                        if let Some([share]) = domain.stiffness_shares.get(batch) {
                            stiffness *= lanes.read(share, part);
                        }
                        let compliance = one / stiffness + lanes.splat(LEAST_COMPLIANCE);
                        let kept = &mut multipliers[batch];
                        let mut sums = read_four(lanes, kept, part);
                        project_energy(&mut p, w, lengths, compliance, &mut sums);
                        for spring in 0..4 {
                            lanes.write(&mut kept[spring], part, sums[spring]);
                        }
                    }
                    EnergyForm::Paper => {
                        let steps = project_energy_paper(p, w, lengths);
                        for k in 0..4 {
                            p[k] += steps[k] * strength;
                        }
                    }
                }
                for k in 0..4 {
                    lanes.store(&mut corners, k, part, p[k], w[k]);
                }
            }
        }
    }
}

/// Springs stiffer than this do not converge in a handful of iterations, and what has not converged
/// looks softer: stiffness saturates here instead.
const LEAST_COMPLIANCE: f32 = 0.75;
