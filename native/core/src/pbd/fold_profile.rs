//! The two sides of a bent joint seen along the bend alone, and how far they are in contact.

use super::fold_field::{FieldScale, MOST_NODES, Place, smoothstep};
use super::fold_grid::{larger, smaller};

/// From here on, in radii along the bend, sides that come near are past the fold's root.
const PAST_ROOT: f32 = 0.75;

/// Buffers of the profile.
#[derive(Debug, Clone, Default)]
pub(super) struct FoldProfile {
    /// Highest place of each side.
    pub highest: [f32; 2],
    /// Heights of both sides along the bend.
    heights: [Vec<f32>; 2],
}

impl FoldProfile {
    /// How far the sides are in contact, from 0 to 1. Both always meet at the fold's root, so what counts is
    /// overlap, or that they come near each other again farther out.
    pub(super) fn contact_level(&mut self, places: &[Place], scale: &FieldScale) -> f32 {
        let farthest = places.iter().map(|place| place.inwards).fold(0.0, larger);
        self.highest = [f32::NEG_INFINITY; 2];
        if !farthest.is_finite() {
            return 0.0;
        }
        let step = scale.step.max(farthest / MOST_NODES as f32);
        let count = (farthest / step) as usize + 2;
        for line in &mut self.heights {
            line.clear();
            line.resize(count, f32::NEG_INFINITY);
        }
        for place in places {
            let side = usize::from(place.below);
            // Behind the joint it counts by the cone that reaches past it, so that none sets in as it passes.
            let height = place.height + smaller(0.0, place.inwards);
            self.highest[side] = larger(self.highest[side], height);
            let t = larger(0.0, place.inwards) / step;
            let node = (t as i32 as usize).min(count - 2);
            let t = t - node as f32;
            let line = &mut self.heights[side];
            line[node] = larger(line[node], height - t * step);
            line[node + 1] = larger(line[node + 1], height - (1.0 - t) * step);
        }
        for line in &mut self.heights {
            for i in 1..count {
                line[i] = larger(line[i], line[i - 1] - step);
            }
            for i in (1..count).rev() {
                line[i - 1] = larger(line[i - 1], line[i] - step);
            }
        }
        let [above, below] = &self.heights;
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
}
