//! The two sides of a bent joint as height fields over its projection plane, and what follows from
//! them: the plane half way between the sides, where they meet, and how far a hollow between them
//! is closed off. Everything varies continuously with the places.

use glam::{Mat3, Vec3};

use super::fold_grid::{Grid, Located, blur, spread};

/// Where a candidate is over the projection plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// Along the inner direction of the bend, from the joint.
    pub inwards: f32,
    /// Across the bend.
    pub across: f32,
    /// Height over the plane, towards the other side.
    pub beyond: f32,
    /// That height for the field: lower where the surface is turned away.
    pub height: f32,
    /// How far the surface is turned towards the other side, from 0 to 1.
    pub facing: f32,
    /// True on the side of the bone below the joint.
    pub below: bool,
}

/// Scales of a field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FieldScale {
    /// Distance of the grid's nodes: that of neighbouring candidates.
    pub step: f32,
    /// Gap at which the sides begin to feel each other.
    pub margin: f32,
    /// How much too low the heights may be.
    pub slack: f32,
    /// Radius of the limb: a hollow half as wide is closed in full, one as wide not at all.
    pub radius: f32,
}

/// Most nodes along each axis; the step grows where there would be more.
const MOST_NODES: usize = 64;
/// Reach of a candidate's say in the heights, in steps.
const KERNEL: f32 = 1.5;
/// Say of the envelope of cones against that of the candidates themselves.
const ENVELOPE_SAY: f32 = 0.02;
/// What the envelope of cones lacks between candidates, in steps.
const ENVELOPE_LACK: f32 = 0.35;
/// Say of the projection plane in the plane half way, in candidates' says: where little touches, it is
/// not tilted far.
const PRIOR: f32 = 2.0;
/// From here on, in radii along the bend, sides that come near are past the fold's root.
const PAST_ROOT: f32 = 0.75;

/// The field on a grid, with its buffers.
#[derive(Debug, Clone, Default)]
pub(super) struct FoldField {
    grid: Grid,
    /// That of the scale.
    slack: f32,
    /// Highest place of each side.
    highest: [f32; 2],
    /// Heights of both sides along the bend.
    profiles: [Vec<f32>; 2],
    envelopes: [Vec<f32>; 2],
    sums: [Vec<[f32; 2]>; 2],
    /// The plane half way: height at the joint, slopes along and across the bend.
    middle: Vec3,
    overlap: Vec<f32>,
    shut_in: Vec<f32>,
    buffer: Vec<f32>,
}

impl FoldField {
    /// Fills the field from the places of both sides and returns how far they are in contact, from 0
    /// (the field is not filled) to 1.
    pub(super) fn fill(&mut self, places: &[Place], scale: &FieldScale) -> f32 {
        self.slack = scale.slack;
        let level = self.contact_level(places, scale);
        if level <= 0.0 {
            return 0.0;
        }
        let highest = self.highest;
        let reach = |place: &&Place| {
            let other = highest[usize::from(!place.below)];
            place.inwards > -scale.step && place.height + other > -scale.radius - scale.margin
        };
        if !self.lay_out(places.iter().filter(reach), scale.step) {
            return 0.0;
        }
        self.raise(places.iter().filter(reach).map(|place| (place, 1.0)));
        if !self.meet(scale, 0.5, 0.0) {
            return 0.0;
        }
        self.shut(scale);
        level
    }

    /// Fills the field from the places of two sides that have no root in common, and returns how deep they
    /// overlap, at most; 0 where they are apart. The side above goes back by a share of it.
    pub(super) fn fill_open(&mut self, places: &[Place], scale: &FieldScale, share: f32) -> f32 {
        self.slack = scale.slack;
        self.highest = [f32::NEG_INFINITY; 2];
        for place in places {
            let highest = &mut self.highest[usize::from(place.below)];
            *highest = highest.max(place.height);
        }
        let highest = self.highest;
        let reach = |place: &Place| {
            let other = highest[usize::from(!place.below)];
            ((place.height + other + scale.radius) / scale.margin + 1.0).min(1.0)
        };
        let within = |place: &&Place| reach(place) > 0.0;
        if !self.lay_out(places.iter().filter(within), scale.step) {
            return 0.0;
        }
        self.raise(places.iter().map(|place| (place, reach(place))).filter(|(_, reach)| *reach > 0.0));
        if !self.meet(scale, share, f32::NEG_INFINITY) {
            return 0.0;
        }
        let sums = self.sums[0].iter().zip(&self.sums[1]);
        let known = sums.map(|(a, b)| a[1].min(1.0) * b[1].min(1.0));
        let deepest =
            self.overlap.iter().zip(known).map(|(overlap, known)| overlap * known).fold(0.0, f32::max);
        // No farther than so deep, so that nothing moves at the first touch.
        self.slack = scale.slack.min(deepest);
        deepest
    }

    /// How far the sides are in contact, seen along the bend alone: both always meet at the fold's
    /// root, so what counts is overlap, or that they come near each other again farther out.
    fn contact_level(&mut self, places: &[Place], scale: &FieldScale) -> f32 {
        let farthest = places.iter().map(|place| place.inwards).fold(0.0, f32::max);
        self.highest = [f32::NEG_INFINITY; 2];
        if !farthest.is_finite() {
            return 0.0;
        }
        let step = scale.step.max(farthest / MOST_NODES as f32);
        let count = (farthest / step) as usize + 2;
        for line in &mut self.profiles {
            line.clear();
            line.resize(count, f32::NEG_INFINITY);
        }
        for place in places {
            let side = usize::from(place.below);
            // Behind the joint it counts by the cone that reaches past it, so that none sets in as it passes.
            let height = place.height + place.inwards.min(0.0);
            self.highest[side] = self.highest[side].max(height);
            let t = place.inwards.max(0.0) / step;
            let node = (t as usize).min(count - 2);
            let t = t - node as f32;
            let line = &mut self.profiles[side];
            line[node] = line[node].max(height - t * step);
            line[node + 1] = line[node + 1].max(height - (1.0 - t) * step);
        }
        for line in &mut self.profiles {
            for i in 1..count {
                line[i] = line[i].max(line[i - 1] - step);
            }
            for i in (1..count).rev() {
                line[i - 1] = line[i - 1].max(line[i] - step);
            }
        }
        let [above, below] = &self.profiles;
        let (mut level, mut narrowest) = (0.0f32, f32::INFINITY);
        for (i, (a, b)) in above.iter().zip(below).enumerate() {
            let overlap = a + b;
            narrowest = narrowest.min(overlap);
            let near = smoothstep(1.0 + overlap / scale.margin);
            let again = smoothstep((overlap - narrowest) / scale.margin);
            let past_root = smoothstep(2.0 * (i as f32 * step / scale.radius - PAST_ROOT));
            level = level.max(near * again.max(past_root)).max(smoothstep(overlap / scale.step));
        }
        level
    }

    /// Chooses the grid: nodes at whole steps from the joint, so that they stay where they are from
    /// pose to pose.
    fn lay_out<'a>(&mut self, places: impl Iterator<Item = &'a Place>, step: f32) -> bool {
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for place in places {
            for (axis, x) in [place.inwards, place.across].into_iter().enumerate() {
                low[axis] = low[axis].min(x);
                high[axis] = high[axis].max(x);
            }
        }
        let extent = (high[0] - low[0]).max(high[1] - low[1]).max(0.0);
        if !extent.is_finite() {
            return false;
        }
        self.grid.step = step.max(extent / (MOST_NODES as f32 - 5.0));
        self.grid.per_step = self.grid.step.recip();
        for axis in 0..2 {
            let first = (low[axis] / self.grid.step).floor() - 1.0;
            let last = (high[axis] / self.grid.step).floor() + 2.0;
            self.grid.origin[axis] = first * self.grid.step;
            self.grid.size[axis] = ((last - first) as usize + 1).clamp(4, MOST_NODES);
            self.grid.last[axis] = (self.grid.size[axis] - 2) as f32;
        }
        let count = self.grid.size[0] * self.grid.size[1];
        for side in 0..2 {
            self.envelopes[side].clear();
            self.envelopes[side].resize(count, f32::NEG_INFINITY);
            self.sums[side].clear();
            self.sums[side].resize(count, [0.0; 2]);
        }
        true
    }

    /// Where a place is on the grid.
    #[inline]
    pub(super) fn locate(&self, place: &Place) -> Located {
        self.grid.locate([place.inwards, place.across])
    }

    /// Heights of both sides at the nodes, from places and how far each is within reach.
    fn raise<'a>(&mut self, places: impl Iterator<Item = (&'a Place, f32)> + Clone) {
        let row = self.grid.size[0];
        for (place, _) in places.clone() {
            let Located { node, s, t } = self.locate(place);
            let envelope = &mut self.envelopes[usize::from(place.below)];
            for (first, y) in [(node, t), (node + row, 1.0 - t)] {
                for (height, x) in envelope[first..first + 2].iter_mut().zip([s, 1.0 - s]) {
                    *height = height.max(place.height - (x * x + y * y).sqrt() * self.grid.step);
                }
            }
        }
        for side in 0..2 {
            spread(&mut self.envelopes[side], self.grid.size, self.grid.step);
        }
        for (place, reach) in places {
            let side = usize::from(place.below);
            let located = self.locate(place);
            let hidden = (self.grid.at(&self.envelopes[side], located) - place.height) * self.grid.per_step;
            let say = (1.0 - hidden).clamp(0.0, 1.0) * place.facing * reach;
            if say <= 0.0 {
                continue;
            }
            let Located { node, s, t } = located;
            let first = node - row - 1;
            let along = [1.0 + s, s, 1.0 - s, 2.0 - s].map(|x| 1.0 - x * x / (KERNEL * KERNEL));
            let across = [1.0 + t, t, 1.0 - t, 2.0 - t].map(|y| y * y / (KERNEL * KERNEL));
            for (b, y) in across.into_iter().enumerate() {
                for (x, [sum, total]) in along.into_iter().zip(&mut self.sums[side][first + b * row..][..4]) {
                    let near = (x - y).max(0.0);
                    let weight = say * near * near;
                    *sum += weight * place.beyond;
                    *total += weight;
                }
            }
        }
        for side in 0..2 {
            for (envelope, &[sum, total]) in self.envelopes[side].iter_mut().zip(&self.sums[side]) {
                let cones = *envelope + ENVELOPE_LACK * self.grid.step;
                *envelope = (sum + ENVELOPE_SAY * cones) / (total + ENVELOPE_SAY);
            }
        }
    }

    /// Overlap and middle of the heights; false where the sides are too far apart everywhere. For the middle
    /// counts what lies farther along the bend than `root`.
    fn meet(&mut self, scale: &FieldScale, share: f32, root: f32) -> bool {
        let [above, below] = &self.envelopes;
        self.overlap.clear();
        self.overlap.extend(above.iter().zip(below).map(|(a, b)| a + b));
        if !self.overlap.iter().any(|&overlap| overlap > -scale.margin) {
            return false;
        }
        self.fit_middle(scale, share, root);
        true
    }

    /// The plane between the sides, a share of the way down from the side above, by least squares, those
    /// nodes before all where the sides are close. One plane for both sides: what it parts cannot cross.
    fn fit_middle(&mut self, scale: &FieldScale, share: f32, root: f32) {
        let above = &self.envelopes[0];
        let known = self.sums[0].iter().zip(&self.sums[1]).map(|(a, b)| a[1].min(1.0) * b[1].min(1.0));
        let lever = scale.radius.powi(2);
        let mut normal = Mat3::from_diagonal(Vec3::new(1.0, lever, lever) * PRIOR);
        let mut right = Vec3::ZERO;
        for (node, known) in known.enumerate() {
            let (i, j) = (node % self.grid.size[0], node / self.grid.size[0]);
            let x = self.grid.origin[0] + i as f32 * self.grid.step;
            let y = self.grid.origin[1] + j as f32 * self.grid.step;
            if known <= 0.0 || x <= root {
                continue;
            }
            let gap = (-self.overlap[node] / scale.margin).max(0.0);
            let row = Vec3::new(1.0, x, y);
            let weighted = row * (known / (1.0 + gap * gap));
            normal += Mat3::from_cols(weighted, weighted * x, weighted * y);
            right += weighted * (above[node] - share * self.overlap[node]);
        }
        self.middle = normal.inverse() * right;
    }

    /// How far each node is shut in: what touches farther from the joint closes off what is nearer.
    fn shut(&mut self, scale: &FieldScale) {
        let sums = self.sums[0].iter().zip(&self.sums[1]);
        self.shut_in.clear();
        self.shut_in.extend(self.overlap.iter().zip(sums).map(|(overlap, (a, b))| {
            let known = a[1].min(1.0) * b[1].min(1.0);
            known * smoothstep(1.0 + overlap / scale.margin)
        }));
        blur(&mut self.shut_in, &mut self.buffer, self.grid.size);
        for line in self.shut_in.chunks_mut(self.grid.size[0]) {
            let mut farther = 0.0f32;
            for shut in line.iter_mut().rev() {
                let own = *shut;
                *shut = farther;
                farther = farther.max(own);
            }
        }
        blur(&mut self.shut_in, &mut self.buffer, self.grid.size);
    }

    /// Height of the plane half way between the sides, seen from the place's own side.
    #[inline]
    pub(super) fn middle(&self, place: &Place) -> f32 {
        let middle = self.middle.dot(Vec3::new(1.0, place.inwards, place.across));
        if place.below { -middle } else { middle }
    }

    /// How far a place that is so far beyond the middle is in the other side: never farther than that
    /// side reaches there, so that a plane that fits badly parts the sides no farther than touching.
    #[inline]
    pub(super) fn sunk(&self, place: &Place, beyond: f32) -> f32 {
        let other = self.envelope(!place.below, self.locate(place));
        beyond.min(place.beyond + other + self.slack)
    }

    /// How far the sides overlap; negative for a gap.
    #[inline]
    pub(super) fn overlap(&self, located: Located) -> f32 {
        self.grid.at(&self.overlap, located)
    }

    /// Height of a side's outermost layer.
    #[inline]
    pub(super) fn envelope(&self, below: bool, located: Located) -> f32 {
        self.grid.at(&self.envelopes[usize::from(below)], located)
    }

    /// How far a place is shut in between the joint and where the sides touch, from 0 to 1.
    #[inline]
    pub(super) fn shut_in(&self, located: Located) -> f32 {
        self.grid.at(&self.shut_in, located)
    }
}

pub(super) fn smoothstep(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two sides over a plane, a gap wide except where they touch beyond 1.2, and tilted by a slope.
    fn sides(gap: f32, slope: f32) -> Vec<Place> {
        let along = (0..20).map(|i| 0.1 * i as f32);
        let grid = along.flat_map(|x| (-8..=8).map(move |j| (x, 0.1 * j as f32)));
        grid.flat_map(|(inwards, across)| {
            let half = 0.5 * gap * smoothstep((1.2 - inwards) / 0.3) * smoothstep(inwards / 0.3);
            let middle = slope * inwards;
            [true, false].map(|below| {
                let beyond = if below { -middle - half } else { middle - half };
                Place { inwards, across, beyond, height: beyond, facing: 1.0, below }
            })
        })
        .collect()
    }

    const SCALE: FieldScale = FieldScale { step: 0.1, margin: 0.15, slack: 0.1, radius: 1.0 };

    #[test]
    fn a_hollow_between_sides_that_touch_is_shut_in() {
        let places = sides(0.4, 0.1);
        let mut field = FoldField::default();
        assert!(field.fill(&places, &SCALE) > 0.99);
        let at = |inwards: f32| Place {
            inwards,
            across: 0.0,
            beyond: 0.0,
            height: 0.0,
            facing: 1.0,
            below: false,
        };
        let shut_in = |inwards: f32| field.shut_in(field.locate(&at(inwards)));
        let overlap = |inwards: f32| field.overlap(field.locate(&at(inwards)));
        let (hollow, end) = (shut_in(0.6), shut_in(1.85));
        assert!(hollow > 0.9 && end < 0.8 * hollow, "{hollow} {end}");
        assert!((overlap(0.7) + 0.4).abs() < 0.1 && overlap(1.6).abs() < 0.1);
        let middle = field.middle(&at(1.5));
        assert!((middle - 0.15).abs() < 0.03, "{middle}");
        let below = field.middle(&Place { below: true, ..at(1.5) });
        assert!((below + middle).abs() < 1e-6, "seen from the other side");
    }

    #[test]
    fn a_plane_that_fits_badly_parts_no_farther_than_touching() {
        let mut field = FoldField::default();
        assert!(field.fill(&sides(0.4, 0.0), &SCALE) > 0.0);
        let place = |inwards: f32, beyond: f32| Place {
            inwards,
            across: 0.0,
            beyond,
            height: beyond,
            facing: 1.0,
            below: false,
        };
        // The other side is 0.2 under the plane in the hollow, and reaches it farther out.
        let left = |place: Place, beyond: f32| field.sunk(&place, beyond) - SCALE.slack;
        assert!((left(place(0.7, 0.3), 5.0) - 0.1).abs() < 0.06);
        assert!((left(place(1.6, 0.3), 5.0) - 0.3).abs() < 0.06);
        assert_eq!(field.sunk(&place(1.6, 0.3), 0.05), 0.05);
    }

    #[test]
    fn sides_that_part_from_the_root_on_are_not_in_contact() {
        let opened: Vec<Place> = sides(0.0, 0.0)
            .into_iter()
            .map(|place| {
                let beyond = place.beyond - place.inwards;
                Place { beyond, height: beyond, ..place }
            })
            .collect();
        assert_eq!(FoldField::default().fill(&opened, &SCALE), 0.0);
        let one_side: Vec<Place> = opened.into_iter().filter(|place| place.below).collect();
        assert_eq!(FoldField::default().fill(&one_side, &SCALE), 0.0);
        assert_eq!(FoldField::default().fill(&[], &SCALE), 0.0);
        let absurd = [f32::MAX, f32::INFINITY].map(|inwards| Place { inwards, ..sides(0.0, 0.0)[0] });
        assert_eq!(FoldField::default().fill(&absurd, &SCALE), 0.0);
    }
}
