//! The template moved and scaled as a whole: where the search starts, and what is given where it
//! finds nothing.

use glam::DVec3;

use super::distance_field::DistanceField;
use super::joints::{Joints, bounds};

/// A joint of the fallback is at least this share of the deepest voxel's depth below the surface.
const LEAST_DEPTH: f64 = 0.15;
/// A uniform scale about the origin followed by a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Similarity {
    pub(super) scale: f64,
    pub(super) step: DVec3,
}

impl Similarity {
    pub(super) fn apply(&self, point: DVec3) -> DVec3 {
        point * self.scale + self.step
    }

    /// Lays the bounds of points onto a box: middle on middle, scaled by the axis that is long in
    /// both, so that spread arms beside lowered ones do not count.
    pub(super) fn between(points: impl Iterator<Item = DVec3>, low: DVec3, high: DVec3) -> Option<Self> {
        let (from_low, from_high) = bounds(points);
        let (from, to) = (from_high - from_low, high - low);
        let longest = (from.max_element(), to.max_element());
        if !(longest.0.is_finite() && longest.0 > 0.0 && longest.1 > 0.0) {
            return None;
        }
        let length = |axis: &usize| (from[*axis] / longest.0).min(to[*axis] / longest.1);
        let axis = (0..3).max_by(|a, b| length(a).total_cmp(&length(b)))?;
        let scale =
            if from[axis] > 0.0 && to[axis] > 0.0 { to[axis] / from[axis] } else { longest.1 / longest.0 };
        Some(Self { scale, step: (low + high) * 0.5 - (from_low + from_high) * (0.5 * scale) })
    }
}

/// Joints (J) of the template after a similarity, those of the body (J) pulled inside.
pub(super) fn scaled_template(
    joints: &Joints,
    in_body: &[bool],
    similarity: Similarity,
    field: &DistanceField,
) -> Vec<DVec3> {
    let deepest = field.depth.iter().copied().fold(0.0, f64::max);
    let place = |(&point, &in_body): (&DVec3, &bool)| {
        let scaled = similarity.apply(point);
        if in_body { field.pulled_inside(scaled, LEAST_DEPTH * deepest) } else { scaled }
    };
    joints.points.iter().zip(in_body).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_arms_do_not_count() {
        let body = [DVec3::new(-1.0, 0.0, 0.0), DVec3::new(1.0, 0.2, 1.9)];
        let low = DVec3::new(-0.5, 0.0, 3.0);
        let found = Similarity::between(body.into_iter(), low, low + DVec3::new(1.0, 0.3, 3.8)).unwrap();
        assert!((found.scale - 2.0).abs() < 1e-12);
        assert!(found.apply(DVec3::new(0.0, 0.1, 0.95)).distance(DVec3::new(0.0, 0.15, 4.9)) < 1e-12);
        assert_eq!(Similarity::between([DVec3::ONE].into_iter(), low, low), None);
    }
}
