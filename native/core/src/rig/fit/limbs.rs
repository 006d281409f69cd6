//! Joints of limbs along the limbs' centrelines: where a limb leaves the trunk is its first joint, and
//! the others follow by the template's proportions.

use glam::DVec3;

use super::centreline::Centreline;
use super::reduced_skeleton::Limb;

/// Limbs begin between these shares of where the template has their joints.
const WINDOW: [f64; 2] = [0.7, 1.5];
/// A joint nearer to the tip than this share of the limb is no base.
const FIRST_BASE: f64 = 0.3;
/// How much longer the template's bones are than the way through a body, which cuts corners.
const DETOUR: f64 = 1.12;
/// Trust in that, beside one limb's base.
const PRIOR: f64 = 0.5;
/// Scales of limbs differ from the body's by at most this factor; beyond it the template's limb ends
/// elsewhere than in the tip.
const MOST_STRETCH: f64 = 1.16;
/// Without a base joints are placed as far as this share of the limb.
const WITHOUT_BASE: f64 = 0.8;

/// A limb of the template on a limb of the body.
pub(super) struct FoundLimb<'a> {
    pub(super) limb: &'a Limb,
    pub(super) line: Centreline,
    /// Length along the line at which it leaves the trunk.
    pub(super) base: Option<f64>,
}

impl<'a> FoundLimb<'a> {
    pub(super) fn new(limb: &'a Limb, line: Centreline, scale: f64, diameter: f64) -> Self {
        let first = limb.candidates().map(|i| limb.lengths[i]).next().unwrap_or(0.0);
        let last = limb.lengths[limb.lengths.len() - 1];
        let base = line.base(WINDOW[0] * scale * first, WINDOW[1] * scale * last, diameter);
        Self { limb, line, base }
    }

    /// Joint that is the limb's base at a scale, as its place in the limb.
    fn base_joint(&self, scale: f64) -> Option<(usize, f64)> {
        let base = self.base?;
        let miss = |i: usize| (base / (scale * self.limb.lengths[i])).ln().abs();
        self.limb.candidates().map(|i| (i, miss(i))).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Places for joints of the limb: the joint, its place, and whether it is the base.
    pub(super) fn targets(&self, scale: f64, diameter: f64) -> Vec<(usize, DVec3, bool)> {
        let lengths = &self.limb.lengths;
        let anchor = self.base_joint(scale).filter(|(_, miss)| *miss < 2.0 * MOST_STRETCH.ln());
        let total = lengths[lengths.len() - 1];
        let (from, at, last) = match (anchor, self.base) {
            (Some((joint, _)), Some(base)) => (lengths[joint], base, joint),
            _ => {
                let inside = |&i: &usize| lengths[i] <= WITHOUT_BASE * total;
                let last = (0..lengths.len() - 1).filter(inside).max().unwrap_or(0);
                (0.0, 0.0, last)
            }
        };
        // From the base towards the tip; without a base from the tip.
        let stretch = match anchor {
            Some(_) => (at / from).clamp(scale / MOST_STRETCH, scale * MOST_STRETCH),
            None => scale,
        };
        (0..=last)
            .map(|i| {
                let is_base = anchor.is_some() && i == last;
                let place = match is_base {
                    true => self.line.continued(at, diameter),
                    false => self.line.at((at - stretch * (from - lengths[i])).max(0.0)),
                };
                (self.limb.joints[i], place, is_base)
            })
            .collect()
    }
}

impl Limb {
    /// Joints that may be the limb's base, as places in the limb: not its end and not the branching.
    fn candidates(&self) -> impl Iterator<Item = usize> + '_ {
        let last = self.lengths.len() - 1;
        let total = self.lengths[last];
        let inner = (1..last).filter(move |&i| self.lengths[i] >= FIRST_BASE * total);
        let has_inner = inner.clone().next().is_some();
        inner.chain((!has_inner).then_some(last))
    }
}

/// Length in the body for a length along the template's bones: the one at which the bases of most
/// limbs are where a joint is. `first` is the scale of the search, by the ways through the body.
pub(super) fn common_scale(limbs: &[FoundLimb], first: f64) -> f64 {
    let cost = |scale: f64| {
        let misses = limbs.iter().filter_map(|limb| limb.base_joint(scale)).map(|(_, miss)| miss.min(0.4));
        misses.sum::<f64>() + PRIOR * (scale / (DETOUR * first)).ln().abs()
    };
    let scales = (0..=40).map(|i| first * 0.85 * 1.0175f64.powi(i));
    scales.min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap_or(first)
}
