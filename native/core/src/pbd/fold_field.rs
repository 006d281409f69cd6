//! The two sides of a bent joint as height fields over its projection plane, and what follows from
//! them: the plane half way between the sides, where they meet, and how far a hollow between them
//! is closed off. Everything varies continuously with the places.

use glam::{Mat3, Vec3};

pub(super) use super::fold_grid::smoothstep;
use super::fold_grid::{Grid, Located, blur, larger, smaller, spread};
use super::fold_profile::FoldProfile;

/// Where a candidate is over the projection plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// Along the inner direction of the bend, from the joint.
    pub inwards: f32,
    /// Across the bend.
    pub across: f32,
    /// Height over the plane, towards the other side.
    pub beyond: f32,
    /// That height for the field: lower where another limb's surface is turned away.
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
    /// Gap at which the sides begin to feel each other, if the bend is not deep.
    pub margin: f32,
    /// How much too low the heights may be.
    pub slack: f32,
    /// Radius of the limb: a hollow half as wide is closed in full, one as wide not at all.
    pub radius: f32,
}

/// Most nodes along each axis; the step grows where there would be more.
pub(super) const MOST_NODES: usize = 64;
/// Reach of a candidate's say in the heights, in steps.
const KERNEL: f32 = 1.5;
/// Say of the envelope of cones against that of the candidates themselves.
const ENVELOPE_SAY: f32 = 0.02;
/// What the envelope of cones lacks between candidates, in steps.
const ENVELOPE_LACK: f32 = 0.35;
/// Say of the projection plane in the plane half way, in candidates' says: where little touches, it is
/// not tilted far.
const PRIOR: f32 = 2.0;
/// Gap, in radii, from which on the flesh of a deep bend's sides begins to fill it.
const NARROW: f32 = 0.45;

/// The field on a grid, with its buffers.
#[derive(Debug, Clone, Default)]
pub(super) struct FoldField {
    grid: Grid,
    /// That of the scale.
    slack: f32,
    profile: FoldProfile,
    envelopes: [Vec<f32>; 2],
    /// Heights of the candidates at each node, times their say, and all they say.
    sums: [Vec<f32>; 2],
    totals: [Vec<f32>; 2],
    /// The plane half way: height at the joint, slopes along and across the bend.
    middle: Vec3,
    overlap: Vec<f32>,
    /// Share of both sides that is known at each node.
    known: Vec<f32>,
    shut_in: Vec<f32>,
    narrow: Vec<f32>,
    closing: Vec<f32>,
    buffer: Vec<f32>,
    located: Vec<Located>,
}

impl FoldField {
    /// Fills the field from the places of both sides of a bend that is so `deep`, from 0 to 1, and returns how
    /// far they are in contact, from 0 to 1; `None`, and no field, where they do not feel each other.
    pub(super) fn fill(&mut self, places: &[Place], scale: &FieldScale, deep: f32) -> Option<f32> {
        self.slack = scale.slack;
        let level = self.profile.contact_level(places, scale);
        if level <= 0.0 && deep <= 0.0 {
            return None;
        }
        let highest = self.profile.highest;
        let reach = |place: &&Place| {
            let other = highest[usize::from(!place.below)];
            place.inwards > -scale.step && place.height + other > -scale.radius - scale.margin
        };
        if !self.lay_out(places.iter().filter(reach), scale.step) {
            return None;
        }
        self.raise(places.iter().filter(reach).map(|place| (place, 1.0)));
        let narrow = NARROW * scale.radius;
        let felt = if deep > 0.0 { narrow.max(scale.margin) } else { scale.margin };
        if !self.meet(felt) {
            return None;
        }
        self.fit_middle(scale, 0.5, 0.0);
        self.shut(scale);
        self.narrow.clear();
        let nodes = self.overlap.iter().zip(&self.known);
        self.narrow.extend(nodes.map(|(overlap, known)| deep * known * smoothstep(1.0 + overlap / narrow)));
        blur(&mut self.narrow, &mut self.buffer, self.grid.size);
        Some(level)
    }

    /// Fills the field from the places of two sides that have no root in common, and returns how deep they
    /// overlap, at most; 0 where they are apart. The side above goes back by a share of it.
    pub(super) fn fill_open(&mut self, places: &[Place], scale: &FieldScale, share: f32) -> f32 {
        self.slack = scale.slack;
        let mut highest = [f32::NEG_INFINITY; 2];
        for place in places {
            let highest = &mut highest[usize::from(place.below)];
            *highest = highest.max(place.height);
        }
        let reach = |place: &Place| {
            let other = highest[usize::from(!place.below)];
            ((place.height + other + scale.radius) / scale.margin + 1.0).min(1.0)
        };
        let within = |place: &&Place| reach(place) > 0.0;
        if !self.lay_out(places.iter().filter(within), scale.step) {
            return 0.0;
        }
        self.raise(places.iter().map(|place| (place, reach(place))).filter(|(_, reach)| *reach > 0.0));
        if !self.meet(scale.margin) {
            return 0.0;
        }
        self.fit_middle(scale, share, f32::NEG_INFINITY);
        let overlaps = self.overlap.iter().zip(&self.known);
        let deepest = overlaps.map(|(overlap, known)| overlap * known).fold(0.0, f32::max);
        // No farther than so deep, so that nothing moves at the first touch.
        self.slack = scale.slack.min(deepest);
        deepest
    }

    /// Chooses the grid: nodes at whole steps from the joint, so that they stay where they are from
    /// pose to pose.
    fn lay_out<'a>(&mut self, places: impl Iterator<Item = &'a Place>, step: f32) -> bool {
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for place in places {
            for (axis, x) in [place.inwards, place.across].into_iter().enumerate() {
                low[axis] = smaller(low[axis], x);
                high[axis] = larger(high[axis], x);
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
            for sums in [&mut self.sums[side], &mut self.totals[side]] {
                sums.clear();
                sums.resize(count, 0.0);
            }
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
        self.located.clear();
        self.located.extend(places.clone().map(|(place, _)| self.grid.locate([place.inwards, place.across])));
        for ((place, _), &Located { node, s, t }) in places.clone().zip(&self.located) {
            let envelope = &mut self.envelopes[usize::from(place.below)];
            let (x, y) = ([s, 1.0 - s, s, 1.0 - s], [t, t, 1.0 - t, 1.0 - t]);
            let cones: [f32; 4] = std::array::from_fn(|corner| {
                let (x, y) = (x[corner], y[corner]);
                place.height - (x * x + y * y).sqrt() * self.grid.step
            });
            for (first, cones) in [(node, &cones[..2]), (node + row, &cones[2..])] {
                for (height, cone) in envelope[first..first + 2].iter_mut().zip(cones) {
                    *height = larger(*height, *cone);
                }
            }
        }
        for side in 0..2 {
            spread(&mut self.envelopes[side], self.grid.size, self.grid.step);
        }
        for ((place, reach), &located) in places.zip(&self.located) {
            let side = usize::from(place.below);
            let hidden = (self.grid.at(&self.envelopes[side], located) - place.height) * self.grid.per_step;
            let say = (1.0 - hidden).clamp(0.0, 1.0) * place.facing * reach;
            if say <= 0.0 {
                continue;
            }
            let Located { node, s, t } = located;
            let first = node - row - 1;
            let along = [1.0 + s, s, 1.0 - s, 2.0 - s].map(|x| 1.0 - x * x / (KERNEL * KERNEL));
            let across = [1.0 + t, t, 1.0 - t, 2.0 - t].map(|y| y * y / (KERNEL * KERNEL));
            let (sums, totals) = (&mut self.sums[side], &mut self.totals[side]);
            for (b, y) in across.into_iter().enumerate() {
                let weights = along.map(|x| {
                    let near = larger(0.0, x - y);
                    say * near * near
                });
                let line = first + b * row..first + b * row + 4;
                for (sum, weight) in sums[line.clone()].iter_mut().zip(weights) {
                    *sum += weight * place.beyond;
                }
                for (total, weight) in totals[line].iter_mut().zip(weights) {
                    *total += weight;
                }
            }
        }
        for side in 0..2 {
            let says = self.sums[side].iter().zip(&self.totals[side]);
            for (envelope, (sum, total)) in self.envelopes[side].iter_mut().zip(says) {
                let cones = *envelope + ENVELOPE_LACK * self.grid.step;
                *envelope = (sum + ENVELOPE_SAY * cones) / (total + ENVELOPE_SAY);
            }
        }
    }

    /// Overlap of the heights; false where the sides are farther apart than `felt` everywhere.
    fn meet(&mut self, felt: f32) -> bool {
        let [above, below] = &self.envelopes;
        self.overlap.clear();
        self.overlap.extend(above.iter().zip(below).map(|(a, b)| a + b));
        let says = self.totals[0].iter().zip(&self.totals[1]);
        self.known.clear();
        self.known.extend(says.map(|(&a, &b)| smaller(1.0, a) * smaller(1.0, b)));
        self.overlap.iter().any(|&overlap| overlap > -felt)
    }

    /// The plane between the sides, a share of the way down from the side above, by least squares, those
    /// nodes before all where the sides are close and that lie farther along the bend than `root`. One plane
    /// for both sides: what it parts cannot cross.
    fn fit_middle(&mut self, scale: &FieldScale, share: f32, root: f32) {
        let above = &self.envelopes[0];
        let lever = scale.radius.powi(2);
        let mut normal = Mat3::from_diagonal(Vec3::new(1.0, lever, lever) * PRIOR);
        let mut right = Vec3::ZERO;
        for (j, line) in self.known.chunks(self.grid.size[0]).enumerate() {
            let y = self.grid.origin[1] + j as f32 * self.grid.step;
            for (i, &known) in line.iter().enumerate() {
                let x = self.grid.origin[0] + i as f32 * self.grid.step;
                if known <= 0.0 || x <= root {
                    continue;
                }
                let node = j * self.grid.size[0] + i;
                let gap = larger(0.0, -self.overlap[node] / scale.margin);
                let row = Vec3::new(1.0, x, y);
                let weighted = row * (known / (1.0 + gap * gap));
                normal += Mat3::from_cols(weighted, weighted * x, weighted * y);
                right += weighted * (above[node] - share * self.overlap[node]);
            }
        }
        self.middle = normal.inverse() * right;
    }

    /// How far each node is shut in: what touches farther from the joint closes off what is nearer.
    fn shut(&mut self, scale: &FieldScale) {
        self.shut_in.clear();
        let nodes = self.overlap.iter().zip(&self.known);
        self.shut_in.extend(nodes.map(|(overlap, known)| known * smoothstep(1.0 + overlap / scale.margin)));
        blur(&mut self.shut_in, &mut self.buffer, self.grid.size);
        for line in self.shut_in.chunks_mut(self.grid.size[0]) {
            let mut farther = 0.0f32;
            for shut in line.iter_mut().rev() {
                let own = *shut;
                *shut = farther;
                farther = larger(farther, own);
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
        self.sunk_at(self.locate(place), place, beyond)
    }

    /// The same, where the place has been located already.
    #[inline]
    pub(super) fn sunk_at(&self, located: Located, place: &Place, beyond: f32) -> f32 {
        let other = self.envelope(!place.below, located);
        beyond.min(place.beyond + other + self.slack)
    }

    /// How firmly gaps close from now on: by a share in a hollow that is shut in and no wider than half the
    /// `radius`, and by another where flesh fills a narrow gap.
    pub(super) fn close(&mut self, hollow: f32, fill: f32, radius: f32) {
        self.closing.clear();
        let nodes = self.overlap.iter().zip(&self.shut_in).zip(&self.narrow);
        self.closing.extend(nodes.map(|((overlap, shut_in), narrow)| {
            let small = smoothstep(2.0 + 2.0 * overlap / radius);
            (hollow * shut_in * small).max(fill * narrow)
        }));
    }

    /// How firmly the gap at a place closes.
    #[inline]
    pub(super) fn closing(&self, located: Located) -> f32 {
        self.grid.at(&self.closing, located)
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

    /// How far the gap at a place of a deep bend is so narrow that flesh fills it, from 0 to 1.
    #[inline]
    pub(super) fn narrow(&self, located: Located) -> f32 {
        self.grid.at(&self.narrow, located)
    }
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
        assert!(field.fill(&places, &SCALE, 0.0).unwrap() > 0.99);
        let at = |inwards: f32| Place {
            inwards,
            across: 0.0,
            beyond: 0.0,
            height: 0.0,
            facing: 1.0,
            below: false,
        };
        let shut_in = |inwards: f32| field.shut_in(field.locate(&at(inwards)));
        let overlap = |inwards: f32| field.grid.at(&field.overlap, field.locate(&at(inwards)));
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
        assert!(field.fill(&sides(0.4, 0.0), &SCALE, 0.0).unwrap() > 0.0);
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
    fn flesh_fills_the_narrow_gap_of_a_deep_bend() {
        let narrow = |gap: f32, deep: f32| {
            let apart = sides(0.0, 0.0).into_iter().map(|place| {
                let beyond = place.beyond - 0.5 * gap;
                Place { beyond, height: beyond, ..place }
            });
            let mut field = FoldField::default();
            let places: Vec<Place> = apart.collect();
            let level = field.fill(&places, &SCALE, deep)?;
            Some((level, field.narrow(field.locate(&places[10 * 34 + 16]))))
        };
        assert!(narrow(0.3, 0.0).is_none(), "apart, and not deep");
        let (level, half) = narrow(0.3, 0.5).unwrap();
        assert!(level == 0.0 && half > 0.05);
        let (_, whole) = narrow(0.3, 1.0).unwrap();
        assert!((whole - 2.0 * half).abs() < 1e-6, "{half} {whole}");
        assert!(narrow(0.1, 1.0).unwrap().1 > 0.6 && narrow(0.5, 1.0).is_none());
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
        assert_eq!(FoldField::default().fill(&opened, &SCALE, 0.0), None);
        let one_side: Vec<Place> = opened.into_iter().filter(|place| place.below).collect();
        assert_eq!(FoldField::default().fill(&one_side, &SCALE, 0.0), None);
        assert_eq!(FoldField::default().fill(&[], &SCALE, 0.0), None);
        let absurd = [f32::MAX, f32::INFINITY].map(|inwards| Place { inwards, ..sides(0.0, 0.0)[0] });
        for deep in [0.0, 1.0] {
            assert_eq!(FoldField::default().fill(&absurd, &SCALE, deep), None);
            assert_eq!(FoldField::default().fill(&[], &SCALE, deep), None);
        }
    }
}
