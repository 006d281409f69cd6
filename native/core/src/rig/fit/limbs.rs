//! Joints of limbs along the limbs' centrelines: where a limb leaves the trunk is its first joint, and
//! the others follow by the template's proportions.

use glam::DVec3;

use super::centreline::{BaseAt, Centreline};
use super::reduced_skeleton::Limb;
use super::symmetry::TemplateMirror;

/// Limbs begin between these shares of where the template has their joints.
const WINDOW: [f64; 2] = [0.7, 1.5];
/// A joint nearer to the tip than this share of the limb is no base.
const FIRST_BASE: f64 = 0.3;
/// Trust in the first guess of the scale, beside one limb's base.
const PRIOR: f64 = 1.0;
/// Scales of limbs differ from the body's by at most this factor; beyond it the template's limb ends
/// elsewhere than in the tip.
const MOST_STRETCH: f64 = 1.25;
/// Heads and tails differ more.
const MOST_MIDDLE_STRETCH: f64 = 1.8;
/// A base belongs to a joint when the logarithm of the ratio of their lengths is below this.
const LARGEST_MISS: f64 = 0.6;
/// Both bones at a hinge are longer than this share of the limb.
const LONG_BONE: f64 = 0.2;
/// Without a base joints are placed as far as this share of the limb.
const WITHOUT_BASE: f64 = 0.8;

/// A limb of the template on a limb of the body.
pub(super) struct FoundLimb<'a> {
    limb: &'a Limb,
    line: Centreline,
    /// Length along the line at which it leaves the trunk.
    base: Option<f64>,
    /// Direction in which it lies beside its mirror image where both end in one tip, else zero.
    beside: DVec3,
    is_middle: bool,
}

impl<'a> FoundLimb<'a> {
    /// A limb and its centreline. `is_middle` is for limbs in the mirror plane, such as a neck: they
    /// begin at the trunk's surface, where arms and legs begin inside of it.
    pub(super) fn new(
        limb: &'a Limb,
        line: Centreline,
        is_middle: bool,
        beside: DVec3,
        scale: f64,
        diameter: f64,
    ) -> Self {
        let first = limb.candidates().map(|i| limb.lengths[i]).next().unwrap_or(0.0);
        let last = limb.lengths[limb.lengths.len() - 1];
        let window = [WINDOW[0] * scale * first, WINDOW[1] * scale * last];
        let at = if is_middle { BaseAt::Surface } else { BaseAt::Inside };
        let base = line.base(window, at, diameter);
        Self { limb, line, base, beside, is_middle }
    }

    /// Joint that is the limb's base at a scale, as its place in the limb.
    fn base_joint(&self, scale: f64) -> Option<(usize, f64)> {
        let base = self.base?;
        let miss = |i: usize| (base / (scale * self.limb.lengths[i])).ln().abs();
        self.limb.candidates().map(|i| (i, miss(i))).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Joint where the limb leaves the trunk.
    pub(super) fn base(&self, scale: f64) -> Option<usize> {
        self.base_joint(scale).map(|(joint, _)| self.limb.joints[joint])
    }

    /// Whether a joint is between two long bones of a limb, as knees and elbows are.
    fn is_hinge(&self, joint: usize, limb: f64) -> bool {
        let lengths = &self.limb.lengths;
        let bones = [lengths[joint] - lengths[joint - 1], lengths[joint + 1] - lengths[joint]];
        !self.is_middle && bones.iter().all(|&bone| bone > LONG_BONE * limb)
    }

    /// Places for joints of the limb: the joint, its place, and whether it is the base.
    pub(super) fn targets(&self, scale: f64, diameter: f64) -> Vec<(usize, DVec3, bool)> {
        let lengths = &self.limb.lengths;
        let anchor = self.base_joint(scale).filter(|(_, miss)| *miss < LARGEST_MISS);
        let total = lengths[lengths.len() - 1];
        let (from, at, last) = match (anchor, self.base) {
            (Some((joint, _)), Some(base)) => (lengths[joint], base, joint),
            _ => {
                let inside = |&i: &usize| lengths[i] <= WITHOUT_BASE * total;
                let last = (0..lengths.len() - 1).filter(inside).max().unwrap_or(0);
                (0.0, 0.0, last)
            }
        };
        let most_stretch = if self.is_middle { MOST_MIDDLE_STRETCH } else { MOST_STRETCH };
        // From the base towards the tip; without a base from the tip.
        let stretch = match anchor {
            Some(_) => (at / from).clamp(scale / most_stretch, scale * most_stretch),
            None => scale,
        };
        (0..=last)
            .map(|i| {
                let is_base = anchor.is_some() && i == last;
                let mut along = (at - stretch * (from - lengths[i])).max(0.0);
                if i > 0 && i < last && self.is_hinge(i, from) {
                    along = self.line.narrow_near(along, stretch * from);
                }
                let place = match is_base {
                    true => self.line.continued(at, diameter),
                    false => self.line.at(along),
                };
                (self.limb.joints[i], place + self.beside * self.line.half_radius(along), is_base)
            })
            .collect()
    }
}

impl Limb {
    /// Joints that may be the limb's base, as places in the limb: not its end and not the branching.
    fn candidates(&self) -> impl Iterator<Item = usize> + '_ {
        let last = self.lengths.len() - 1;
        let total = self.lengths[last];
        let inner = (1..last).filter(move |&i| self.lengths[i] >= FIRST_BASE * total && self.beside_trunk[i]);
        let has_inner = inner.clone().next().is_some();
        inner.chain((!has_inner).then_some(last))
    }
}

/// Gives two limbs that are mirror images in the template one length up to their bases, also where the
/// body's pose has no mirror plane.
pub(super) fn share_bases(limbs: &mut [FoundLimb], mirror: &TemplateMirror) {
    let bases: Vec<(usize, Option<f64>)> = limbs.iter().map(|l| (l.limb.joints[0], l.base)).collect();
    for limb in limbs {
        let partner = mirror.partner[limb.limb.joints[0]];
        if let Some((_, other)) = bases.iter().find(|(end, _)| Some(*end) == partner) {
            // What one side shows alone is no base.
            limb.base = limb.base.zip(*other).map(|(one, other)| 0.5 * (one + other));
        }
    }
}

/// Length in the body for a length in the template: the one at which the bases of most limbs are where
/// a joint is, and near to `first`.
pub(super) fn common_scale(limbs: &[FoundLimb], first: f64) -> f64 {
    let cost = |scale: f64| {
        // Heads and tails are large or small as they like.
        let sides = limbs.iter().filter(|limb| !limb.is_middle);
        let misses = sides.filter_map(|limb| limb.base_joint(scale)).map(|(_, miss)| miss.min(0.4));
        misses.sum::<f64>() + PRIOR * (scale / first).ln().abs()
    };
    let scales = (-20..=20).map(|i| first * 1.0175f64.powi(i));
    scales.min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap_or(first)
}
