//! Limits how many bones a vertex follows, without jumps between neighbours.

use crate::skinning::SkinWeights;

/// A weight this many times the largest one that has to go stays as it is.
const UNTOUCHED: f64 = 2.0;

/// At most `count` influences of every vertex, scaled to a sum of 1.
///
/// A weight fades to zero as it comes near to the largest one that has to go, so that a vertex whose
/// fifth bone overtakes its fourth differs little from its neighbour. Where all that would stay are
/// equal to that one, they stay in equal shares, the lower bones first.
pub(in crate::rig) fn limit_influences(weights: &SkinWeights, count: usize) -> SkinWeights {
    let rows = (0..weights.vertex_count()).map(|vertex| {
        let row: Vec<(u32, f64)> = weights.entries(vertex).map(|(b, w)| (b, f64::from(w))).collect();
        if row.len() > count { limited(row, count) } else { row }
    });
    SkinWeights::from_rows(rows, weights.bone_count())
}

fn limited(mut row: Vec<(u32, f64)>, count: usize) -> Vec<(u32, f64)> {
    row.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let above = row[count].1;
    row.truncate(count);
    let fade = |weight: f64| weight * ((weight / above - 1.0) / (UNTOUCHED - 1.0)).clamp(0.0, 1.0);
    if row.iter().any(|entry| fade(entry.1) > 0.0) {
        row.iter_mut().for_each(|entry| entry.1 = fade(entry.1));
        row.retain(|entry| entry.1 > 0.0);
    }
    let total: f64 = row.iter().map(|entry| entry.1).sum();
    row.iter_mut().for_each(|entry| entry.1 /= total);
    row.sort_unstable_by_key(|entry| entry.0);
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keeps_the_largest_and_does_not_jump() {
        let at = |fourth: f64, fifth: f64| {
            let weights = SkinWeights::from_dense(&[0.4, 0.3, 0.1, fourth, fifth], 5).unwrap();
            limit_influences(&weights, 3).to_dense()
        };
        let (before, after) = (at(0.0999, 0.1001), at(0.1001, 0.0999));
        assert!(before.iter().zip(&after).all(|(a, b)| (a - b).abs() < 2e-3), "{before:?} {after:?}");
        assert!((after.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert!(after.iter().filter(|w| **w > 0.0).count() <= 3);
    }

    #[test]
    fn equal_weights_stay_in_equal_shares() {
        let weights = SkinWeights::from_dense(&[0.25; 4], 4).unwrap();
        assert_eq!(limit_influences(&weights, 2).to_dense(), [0.5, 0.5, 0.0, 0.0]);
        assert_eq!(limit_influences(&weights, 9), weights);
    }
}
