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
const CLEAR: f64 = 1.7;
/// What is cut off before a base when a limb is continued straight, as a share of the diameter.
const BEFORE_BASE: f64 = 0.03;

/// Slices of a limb from its tip on.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Centreline {
    /// Centre of each slice, smoothed along the line.
    pub(super) centres: Vec<DVec3>,
    /// Length of the line from the tip to each centre.
    pub(super) lengths: Vec<f64>,
    /// Volume of each slice over its thickness.
    pub(super) areas: Vec<f64>,
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

    /// Length of the whole line.
    pub(super) fn length(&self) -> f64 {
        self.lengths[self.lengths.len() - 1]
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
    pub(super) fn base(&self, from: f64, to: f64, diameter: f64) -> Option<f64> {
        let reach = ((GROWTH_STEP * diameter / self.step).round() as usize).max(2);
        let growth = |i: usize| {
            let (low, high) = (self.areas[i - reach], self.areas[i + reach]);
            (high.max(f64::MIN_POSITIVE) / low.max(f64::MIN_POSITIVE)).ln()
        };
        let slices = reach..self.areas.len().saturating_sub(reach);
        let inside: Vec<usize> = slices.filter(|&i| (from..=to).contains(&self.lengths[i])).collect();
        let &peak = inside.iter().max_by(|&&a, &&b| growth(a).total_cmp(&growth(b)))?;
        let mut all: Vec<f64> = inside.iter().map(|&i| growth(i)).collect();
        all.sort_by(f64::total_cmp);
        let usual = all[all.len() / 2].max(0.0);
        if growth(peak) < CLEAR * usual || growth(peak) < 0.3 {
            return None;
        }
        let mut rise = peak;
        while rise > inside[0] && growth(rise) > 0.5 * growth(peak) {
            rise -= 1;
        }
        Some(0.5 * (self.lengths[rise] + self.lengths[peak]))
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
