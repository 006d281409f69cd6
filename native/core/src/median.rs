//! The median of values that do not count alike.

/// The value, first, that half of the weight, second, lies at or below; 0 without any.
pub(crate) fn weighted_median(mut values: Vec<(f64, f64)>) -> f64 {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let half = 0.5 * values.iter().map(|value| value.1).sum::<f64>();
    let mut below = 0.0;
    for &(value, weight) in &values {
        below += weight;
        if below >= half {
            return value;
        }
    }
    0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_counts_more_decides() {
        let light = (0..15).map(|k| (0.2 + 0.01 * f64::from(k), 0.01));
        let heavy = [(0.05, 0.5), (0.03, 0.4), (0.06, 0.7)];
        assert_eq!(weighted_median(light.chain(heavy).collect()), 0.05);
        assert_eq!(weighted_median(vec![(0.3, 1.0)]), 0.3);
        assert_eq!(weighted_median(Vec::new()), 0.0);
    }
}
