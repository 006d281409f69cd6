//! A bone as a line segment.

use glam::DVec3;

/// Point of the segment from `head` to `tail` that is nearest to `point`, and its place along the
/// segment, 0 at the head and 1 at the tail. A segment without length is its head.
#[must_use]
pub fn closest_on_segment(point: DVec3, head: DVec3, tail: DVec3) -> (DVec3, f64) {
    let axis = tail - head;
    let length_squared = axis.length_squared();
    let along =
        if length_squared > 0.0 { ((point - head).dot(axis) / length_squared).clamp(0.0, 1.0) } else { 0.0 };
    (head + axis * along, along)
}

/// Distance from a point to a segment.
#[must_use]
pub fn distance_to_segment(point: DVec3, head: DVec3, tail: DVec3) -> f64 {
    point.distance(closest_on_segment(point, head, tail).0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clamps_to_the_ends() {
        let (head, tail) = (DVec3::ZERO, DVec3::X * 2.0);
        assert_eq!(closest_on_segment(DVec3::new(0.5, 1.0, 0.0), head, tail), (DVec3::X * 0.5, 0.25));
        assert_eq!(closest_on_segment(DVec3::new(9.0, 1.0, 0.0), head, tail), (tail, 1.0));
        assert_eq!(distance_to_segment(DVec3::new(-3.0, 4.0, 0.0), head, tail), 5.0);
        assert_eq!(distance_to_segment(DVec3::Y, DVec3::ZERO, DVec3::ZERO), 1.0);
    }
}
