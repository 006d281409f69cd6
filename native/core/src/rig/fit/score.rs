//! How well a skeleton fits: bones inside, limbs found, lengths plausible.

use glam::DVec3;

use super::distance_field::DistanceField;

/// Points of a bone to look at.
const LOOKS: u32 = 8;
/// Mean penalty of an embedding at which its share of the score is a half.
const HALF_COST: f64 = 0.5;
/// Standard deviation of the logarithm of the bones' stretches at which their share is a half.
const HALF_UNEVEN: f64 = 0.6;

/// Share of points of segments that are inside, weighted by their lengths.
pub(super) fn share_inside(segments: &[(DVec3, DVec3)], field: &DistanceField) -> f64 {
    let (mut inside, mut total) = (0.0, 0.0);
    for &(head, tail) in segments {
        let length = head.distance(tail);
        for look in 0..=LOOKS {
            let point = head.lerp(tail, f64::from(look) / f64::from(LOOKS));
            total += length;
            inside += if field.voxel_at(point).is_some() { length } else { 0.0 };
        }
    }
    if total > 0.0 { inside / total } else { 0.0 }
}

/// Share of the score for an embedding's mean penalty.
pub(super) fn of_cost(cost: f64) -> f64 {
    1.0 / (1.0 + (cost / HALF_COST).powi(2))
}

/// Share of the score for bones that were stretched differently: pairs of lengths before and after.
pub(super) fn of_lengths(lengths: &[(f64, f64)]) -> f64 {
    let total: f64 = lengths.iter().map(|l| l.0).sum();
    if total.is_nan() || total <= 0.0 {
        return 0.0;
    }
    let stretch = |&(before, after): &(f64, f64)| (after.max(1e-3 * before) / before).ln();
    let kept = || lengths.iter().filter(|l| l.0 > 0.0);
    let mean = kept().map(|l| l.0 * stretch(l)).sum::<f64>() / total;
    let spread = (kept().map(|l| l.0 * (stretch(l) - mean).powi(2)).sum::<f64>() / total).sqrt();
    1.0 / (1.0 + (spread / HALF_UNEVEN).powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_stretches_cost_nothing() {
        assert!((of_lengths(&[(1.0, 2.0), (3.0, 6.0)]) - 1.0).abs() < 1e-12);
        assert!(of_lengths(&[(1.0, 0.1), (1.0, 6.0)]) < 0.3);
        assert_eq!(of_lengths(&[]), 0.0);
        assert!(of_cost(0.0) == 1.0 && of_cost(HALF_COST) == 0.5);
    }
}
