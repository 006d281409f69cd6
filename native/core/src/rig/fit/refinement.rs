//! The continuous refinement (Baran & Popović 2007, section 4): all joints of limbs and trunk at once,
//! near the places that the shape gives them, with bones as in the template where it gives none,
//! mirrored where the body is, and inside of it.

use glam::DVec3;
use nalgebra::{DMatrix, DVector};

use super::distance_field::DistanceField;
use super::symmetry::TemplateMirror;
use crate::rig::bind::Plane;

/// How much more a place counts than a bone of usual length.
const PLACE: f64 = 30.0;
const BASE: f64 = 15.0;
/// Scales of the trunk's axes differ from its mean scale by at most this factor.
const MOST_UNEVEN: f64 = 1.5;
/// Trust in one scale for all axes.
const EVEN: f64 = 0.1;
/// Joints of the trunk are at least this share of the deepest voxel's depth below the surface.
const TRUNK_DEPTH: f64 = 0.3;
/// Joints on a side are at least this share of the template's distance from the mirror plane.
const LEAST_BESIDE: f64 = 0.4;
/// Rounds of pulling joints inside and relaxing their bones.
const ROUNDS: usize = 3;

/// A joint's place by the shape, and how firmly it holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Target {
    pub(super) place: DVec3,
    pub(super) is_base: bool,
}

/// What the refinement works on: J joints.
pub(super) struct Refinement<'a> {
    /// Joints of the template.
    pub(super) points: &'a [DVec3],
    /// Neighbours of each joint in the tree of limbs and trunk.
    pub(super) links: &'a [Vec<usize>],
    pub(super) targets: Vec<Option<Target>>,
    /// Places that may not change.
    pub(super) fixed: Vec<Option<DVec3>>,
    pub(super) mirrors: Option<(&'a TemplateMirror, Plane)>,
    /// Length in the body for a length in the template.
    pub(super) scale: f64,
    pub(super) field: &'a DistanceField,
}

impl Refinement<'_> {
    /// Places of the joints of the tree; `None` for others and where nothing holds them.
    pub(super) fn run(mut self) -> Option<Vec<Option<DVec3>>> {
        self.mirror_targets();
        let scales = self.trunk_scales();
        let mut places = self.solve(scales)?;
        for _ in 0..ROUNDS {
            let mut moved = false;
            for (joint, place) in places.iter().enumerate() {
                let (Some(place), None) = (*place, self.fixed[joint]) else { continue };
                let inside = self.inside(joint, place);
                if inside.distance(place) > 1e-3 * self.field.cell {
                    let is_base = self.targets[joint].is_some_and(|target| target.is_base);
                    self.targets[joint] = Some(Target { place: inside, is_base });
                    moved = true;
                }
            }
            if !moved {
                break;
            }
            self.mirror_targets();
            places = self.solve(scales)?;
        }
        // The bones may have pulled a joint out again.
        for (joint, place) in places.iter_mut().enumerate() {
            if self.fixed[joint].is_none() {
                *place = place.map(|place| self.inside(joint, place));
            }
        }
        self.mirror(&mut places);
        Some(places)
    }

    /// The place itself where it is deep enough, or one nearby that is.
    fn inside(&self, joint: usize, place: DVec3) -> DVec3 {
        let deepest = self.field.depth.iter().copied().fold(0.0, f64::max);
        let depth = match self.targets[joint] {
            None => TRUNK_DEPTH * deepest,
            Some(_) => 0.5 * self.field.cell,
        };
        let Some((mirror, plane)) = &self.mirrors else { return self.field.pulled_inside(place, depth) };
        if mirror.partner[joint] == Some(joint) {
            return self.field.pulled_inside_near(place, depth, Some(plane));
        }
        let inside = self.field.pulled_inside(place, depth);
        let height = plane.height(inside);
        match mirror.partner[joint] {
            Some(_) => {
                // Left stays left, and not much nearer to the middle than in the template.
                let expected = mirror.plane.height(self.points[joint]);
                let least = LEAST_BESIDE * self.scale * expected.abs();
                let lack = (least - height * expected.signum()).max(0.0);
                inside + plane.normal * (lack * expected.signum())
            }
            None => inside,
        }
    }

    /// Partners' targets become mirror images; one side's target serves both.
    fn mirror_targets(&mut self) {
        let Some((mirror, plane)) = &self.mirrors else { return };
        let before = self.targets.clone();
        for (joint, target) in self.targets.iter_mut().enumerate() {
            let Some(partner) = mirror.partner[joint] else { continue };
            let image = before[partner].map(|t| Target { place: plane.mirrored(t.place), ..t });
            *target = match (before[joint], image) {
                (Some(a), Some(b)) => {
                    Some(Target { place: a.place.midpoint(b.place), is_base: a.is_base || b.is_base })
                }
                (one, other) => one.or(other),
            };
        }
    }

    fn mirror(&self, places: &mut [Option<DVec3>]) {
        let Some((mirror, plane)) = &self.mirrors else { return };
        let before = places.to_vec();
        for (joint, place) in places.iter_mut().enumerate() {
            let Some(partner) = mirror.partner[joint] else { continue };
            if self.fixed[joint].is_some() || self.fixed[partner].is_some() {
                continue;
            }
            if let (Some(one), Some(other)) = (before[joint], before[partner]) {
                *place = Some(one.midpoint(plane.mirrored(other)));
            }
        }
    }

    /// Scales along the axes between the limbs' bases.
    fn trunk_scales(&self) -> DVec3 {
        let bases: Vec<(DVec3, DVec3)> = (0..self.points.len())
            .filter_map(|joint| {
                let target = self.targets[joint].filter(|target| target.is_base)?;
                Some((self.points[joint], target.place))
            })
            .collect();
        let (mut products, mut squares) = (DVec3::ZERO, DVec3::ZERO);
        for (i, &(from, to)) in bases.iter().enumerate() {
            for &(other_from, other_to) in &bases[..i] {
                let (template, body) = (other_from - from, other_to - to);
                products += template * body;
                squares += template * template;
            }
        }
        let total = squares.element_sum();
        let mean = match total > 0.0 {
            true => {
                // As much trust in the limbs' scale as a tenth of the trunk gives.
                (products.element_sum() + EVEN * total * self.scale) / (total * (1.0 + EVEN))
            }
            false => self.scale,
        };
        let mean = mean.clamp(self.scale / MOST_UNEVEN, self.scale * MOST_UNEVEN);
        let prior = (EVEN * total).max(f64::MIN_POSITIVE);
        let scales = (products + prior * mean) / (squares + prior);
        scales.clamp(DVec3::splat(mean / MOST_UNEVEN), DVec3::splat(mean * MOST_UNEVEN))
    }

    /// Least squares over targets and bones.
    fn solve(&self, scales: DVec3) -> Option<Vec<Option<DVec3>>> {
        let joints: Vec<usize> = (0..self.links.len()).filter(|&j| !self.links[j].is_empty()).collect();
        let number = |joint: usize| joints.binary_search(&joint).ok();
        let mut matrix = DMatrix::<f64>::zeros(joints.len(), joints.len());
        let mut right = [0; 3].map(|_| DVector::<f64>::zeros(joints.len()));
        let mut held = false;
        let bones = || joints.iter().flat_map(|&a| self.links[a].iter().map(move |&b| (a, b)));
        let lengths: f64 = bones().map(|(a, b)| self.points[a].distance(self.points[b])).sum();
        let usual = lengths / bones().count().max(1) as f64;
        for (a, b) in bones().filter(|(a, b)| a < b) {
            let (Some(i), Some(k)) = (number(a), number(b)) else { continue };
            let bone = self.points[b] - self.points[a];
            let weight = usual / bone.length().max(0.05 * usual);
            // Where the shape gives both ends, the bone follows; otherwise it is the template's.
            let place = |joint: usize| self.fixed[joint].or(self.targets[joint].map(|t| t.place));
            let wanted = match (place(a), place(b)) {
                (Some(from), Some(to)) => (to - from).to_array(),
                _ => (bone * scales).to_array(),
            };
            matrix[(i, i)] += weight;
            matrix[(k, k)] += weight;
            matrix[(i, k)] -= weight;
            matrix[(k, i)] -= weight;
            for axis in 0..3 {
                right[axis][i] -= weight * wanted[axis];
                right[axis][k] += weight * wanted[axis];
            }
        }
        for (i, &joint) in joints.iter().enumerate() {
            let target = self.targets[joint].map(|t| (t.place, if t.is_base { BASE } else { PLACE }));
            let fixed = self.fixed[joint].map(|place| (place, 1e6));
            if let Some((place, weight)) = fixed.or(target) {
                held = true;
                matrix[(i, i)] += weight;
                for (axis, value) in place.to_array().into_iter().enumerate() {
                    right[axis][i] += weight * value;
                }
            }
        }
        let cholesky = held.then(|| matrix.cholesky())??;
        let solved = right.map(|column| cholesky.solve(&column));
        let mut places = vec![None; self.links.len()];
        for (i, &joint) in joints.iter().enumerate() {
            let place = DVec3::new(solved[0][i], solved[1][i], solved[2][i]);
            places[joint] = Some(self.fixed[joint].unwrap_or(place));
        }
        Some(places)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::fit::test_bodies::{field, tubes};

    /// A chain of three joints along z in a tube of radius 0.3.
    fn chain(targets: [Option<f64>; 3], fixed: [Option<f64>; 3]) -> Option<Vec<Option<DVec3>>> {
        let field = field(&tubes(&[(DVec3::ZERO, DVec3::Z * 4.0, 0.3)]));
        let points: Vec<DVec3> = (0..3).map(|i| DVec3::Z * f64::from(i)).collect();
        let links = vec![vec![1], vec![0, 2], vec![1]];
        let target = |z: f64| Target { place: DVec3::Z * z, is_base: false };
        let refinement = Refinement {
            points: &points,
            links: &links,
            targets: targets.iter().map(|t| t.map(target)).collect(),
            fixed: fixed.iter().map(|f| f.map(|z| DVec3::Z * z)).collect(),
            mirrors: None,
            scale: 1.0,
            field: &field,
        };
        refinement.run()
    }

    #[test]
    fn joints_between_targets_keep_the_templates_proportions() {
        let places = chain([Some(1.0), None, Some(3.0)], [None; 3]).unwrap();
        assert!(places[1].unwrap().distance(DVec3::Z * 2.0) < 0.05);
        assert_eq!(chain([None; 3], [None; 3]), None, "nothing holds them");
    }

    #[test]
    fn fixed_joints_stay_and_others_come_inside() {
        let places = chain([Some(9.0), None, Some(3.0)], [None, Some(1.5), None]).unwrap();
        assert_eq!(places[1], Some(DVec3::Z * 1.5));
        assert!(places[0].unwrap().z < 4.35, "{places:?}");
    }
}
