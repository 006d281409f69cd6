//! The middle of a limb: what lies between two distances from its tip is a slice of the limb, and the
//! slices' centres are its centreline (level-set diagrams, Lazarus & Verroust 1999). Where the slices
//! grow fastest the limb leaves the trunk: at the crotch, the armpit, below the neck.

use glam::DVec3;

use super::geodesic::Ways;
use super::tips::Tip;

/// Thickness of a slice in voxels.
const SLICE: f64 = 1.5;
/// Rounds of smoothing the line.
const SMOOTHING: usize = 4;
/// Slices that are compared for their growth are this share of the body's diameter apart, twice.
const GROWTH_STEP: f64 = 0.018;
/// At a base the slices grow at least this much faster than in the middle of the limb.
const CLEAR: f64 = 1.5;
const LEAST_GROWTH: f64 = 0.15;
/// What is cut off before a base when a limb is continued straight, as a share of the diameter.
const BEFORE_BASE: f64 = 0.04;
/// How far from where it is expected a narrow place counts, as a share of the limb.
const NARROW_WINDOW: f64 = 0.08;
/// It is narrower than the ends of that window by this share.
const NARROWER: f64 = 0.04;

/// Where a limb's first joint is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum BaseAt {
    /// Where the slices begin to grow, relative to their size: a neck or a tail.
    Surface,
    /// Where they grow fastest: an arm or a leg, whose joint is inside the trunk.
    Inside,
}

/// Slices of a limb from its tip on.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Centreline {
    /// Centre of each slice, smoothed along the line.
    centres: Vec<DVec3>,
    /// Length of the line from the tip to each centre.
    lengths: Vec<f64>,
    /// Volume of each slice over its thickness.
    areas: Vec<f64>,
    step: f64,
}

impl Centreline {
    /// Slices of the limb that ends in a tip, as far as a voxel of the body.
    pub(super) fn new(ways: &Ways, tip: &Tip, to: u32) -> Self {
        let field = ways.field;
        let step = SLICE * field.cell;
        let slice_of = |id: u32| (tip.distances[id as usize] / step) as usize;
        let mut path = ways.path(to, &tip.distances);
        path.reverse();
        let mut centres: Vec<DVec3> = Vec::new();
        let mut areas: Vec<f64> = Vec::new();
        let mut seen = vec![false; field.voxels.len()];
        for slice in 0..=slice_of(to) {
            // The path cuts the slice in one place; the slice is what is connected to it there.
            let Some(&seed) = path.iter().find(|&&id| slice_of(id) == slice) else {
                centres.push(centres.last().copied().unwrap_or(field.position(tip.voxel)));
                areas.push(areas.last().copied().unwrap_or(0.0));
                continue;
            };
            let (mut sum, mut count) = (DVec3::ZERO, 0.0);
            let mut front = vec![seed];
            seen[seed as usize] = true;
            while let Some(id) = front.pop() {
                sum += field.position(id);
                count += 1.0;
                for next in ways.neighbours(id) {
                    if !seen[next as usize] && slice_of(next) == slice {
                        seen[next as usize] = true;
                        front.push(next);
                    }
                }
            }
            centres.push(sum / count);
            areas.push(count * field.cell.powi(3) / step);
        }
        for _ in 0..SMOOTHING {
            let before = centres.clone();
            for i in 1..centres.len().saturating_sub(1) {
                centres[i] = before[i] * 0.5 + (before[i - 1] + before[i + 1]) * 0.25;
            }
        }
        let mut lengths = vec![0.0];
        for pair in centres.windows(2) {
            lengths.push(lengths[lengths.len() - 1] + pair[0].distance(pair[1]));
        }
        Self { centres, lengths, areas, step }
    }

    /// Point of the line at a length from the tip, clamped to the ends.
    pub(super) fn at(&self, length: f64) -> DVec3 {
        let next = self.lengths.partition_point(|&l| l <= length);
        if next == 0 || next >= self.lengths.len() {
            return self.centres[next.min(self.lengths.len() - 1)];
        }
        let (from, to) = (self.lengths[next - 1], self.lengths[next]);
        self.centres[next - 1].lerp(self.centres[next], (length - from) / (to - from))
    }

    /// Length at which the limb leaves the trunk, looked for between two lengths; `None` where it
    /// only grows evenly.
    pub(super) fn base(&self, [from, to]: [f64; 2], at: BaseAt, diameter: f64) -> Option<f64> {
        let reach = ((GROWTH_STEP * diameter / self.step).round() as usize).max(2);
        let radius = |i: usize| (self.areas[i] / std::f64::consts::PI).sqrt().max(f64::MIN_POSITIVE);
        let ends = |i: usize| (radius(i - reach), radius(i + reach));
        let relative = |i: usize| (ends(i).1 / ends(i).0).ln();
        let absolute = |i: usize| (ends(i).1 - ends(i).0) / (2.0 * reach as f64 * self.step);
        let slices = reach..self.areas.len().saturating_sub(reach);
        let inside: Vec<usize> = slices.filter(|&i| (from..=to).contains(&self.lengths[i])).collect();
        let largest = |growth: &dyn Fn(usize) -> f64| {
            inside.iter().copied().max_by(|&a, &b| growth(a).total_cmp(&growth(b)))
        };
        let peak = largest(&relative)?;
        let mut all: Vec<f64> = inside.iter().map(|&i| relative(i)).collect();
        all.sort_by(f64::total_cmp);
        let usual = all[all.len() / 2].max(0.0);
        let rise = (inside[0]..=peak).rev().find(|&i| relative(i) <= 0.5 * relative(peak))?;
        if relative(peak) < CLEAR * usual || relative(peak) < LEAST_GROWTH {
            return None;
        }
        Some(match at {
            BaseAt::Surface => {
                let (below, above) = (relative(rise), relative(rise + 1));
                let share = (0.5 * relative(peak) - below) / (above - below).max(f64::MIN_POSITIVE);
                let (from, to) = (self.lengths[rise], self.lengths[rise + 1]);
                from + (to - from) * share.clamp(0.0, 1.0)
            }
            // Thin limbs on thick trunks grow fastest soon, thick ones late.
            BaseAt::Inside => {
                let steepest = largest(&absolute)?;
                0.5 * (self.summit(peak, &inside, &relative) + self.summit(steepest, &inside, &absolute))
            }
        })
    }

    /// Length at which a parabola through the values at a slice and beside it has its summit.
    fn summit(&self, slice: usize, inside: &[usize], value: &dyn Fn(usize) -> f64) -> f64 {
        if slice == inside[0] || slice == inside[inside.len() - 1] {
            return self.lengths[slice];
        }
        let [before, here, after] = [slice - 1, slice, slice + 1].map(value);
        let bend = (before - 2.0 * here + after).min(-f64::MIN_POSITIVE);
        let step = (0.5 * (before - after) / bend).clamp(-0.5, 0.5);
        let next = if step < 0.0 { slice - 1 } else { slice + 1 };
        self.lengths[slice] + (self.lengths[next] - self.lengths[slice]) * step.abs()
    }

    /// The narrowest place near a length, such as a knee; the length itself where there is none.
    pub(super) fn narrow_near(&self, length: f64, limb: f64) -> f64 {
        let (from, to) = (length - NARROW_WINDOW * limb, length + NARROW_WINDOW * limb);
        let window: Vec<usize> =
            (1..self.areas.len() - 1).filter(|&i| (from..=to).contains(&self.lengths[i])).collect();
        let area = |i: usize| (self.areas[i - 1] + self.areas[i] * 2.0 + self.areas[i + 1]) * 0.25;
        let (Some(&first), Some(&last)) = (window.first(), window.last()) else { return length };
        let narrowest = window.iter().copied().min_by(|&a, &b| area(a).total_cmp(&area(b)));
        let is_narrow = |i: &usize| area(*i) < (1.0 - NARROWER) * area(first).min(area(last));
        narrowest.filter(is_narrow).map_or(length, |i| self.summit(i, &window, &|i| -area(i)))
    }

    /// Radius of each of two equal limbs side by side that make up the slice at a length.
    pub(super) fn half_radius(&self, length: f64) -> f64 {
        let slice = self.lengths.partition_point(|&l| l < length).min(self.areas.len() - 1);
        (self.areas[slice] / (2.0 * std::f64::consts::PI)).sqrt()
    }

    /// The point at a base, where the limb would be if it went on as it does just before: the slices
    /// at the base are half trunk.
    pub(super) fn continued(&self, base: f64, diameter: f64) -> DVec3 {
        let cut = BEFORE_BASE * diameter;
        let (near, far) = (base - cut, base - 3.0 * cut);
        if far <= 0.0 {
            return self.at(base);
        }
        let along = (self.at(near) - self.at(far)).normalize_or_zero();
        self.at(near) + along * cut
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::fit::test_bodies::{field, tubes};
    use crate::rig::fit::tips::Tips;

    #[test]
    fn follows_a_limb_and_finds_where_it_leaves_the_trunk() {
        let limb = (DVec3::X * 0.3, DVec3::X * 1.5, 0.08);
        let field = field(&tubes(&[(DVec3::Z * -0.5, DVec3::Z * 0.5, 0.35), limb]));
        let ways = Ways::new(&field);
        let tips = Tips::new(&ways, None).unwrap();
        let end = DVec3::X * 1.58;
        let tip = tips.tips.iter().find(|tip| field.position(tip.voxel).distance(end) < 0.1).unwrap();
        let line = Centreline::new(&ways, tip, field.voxel_at(DVec3::ZERO).unwrap());
        for length in [0.2, 0.5, 0.8] {
            let off = line.at(length).reject_from(DVec3::X).length();
            assert!(off < 0.02 && (1.58 - line.at(length).x - length).abs() < 0.1, "{length} {off}");
        }
        for (at, from, to) in [(BaseAt::Surface, 1.1, 1.35), (BaseAt::Inside, 1.15, 1.5)] {
            let base = line.base([0.3, 1.6], at, tips.diameter).unwrap();
            assert!((from..to).contains(&base), "{at:?} {base}");
        }
        assert_eq!(line.base([0.2, 0.9], BaseAt::Inside, tips.diameter), None);
        assert_eq!(line.narrow_near(0.6, 1.0), 0.6, "a tube has no narrow place");
    }
}
