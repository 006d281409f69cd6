//! Shepard interpolation of weights (eq. 23).

use crate::skinning::SkinWeights;

/// Number of interpolation points, as in the paper.
pub const NEIGHBOURS: usize = 4;

/// Blends the weight rows of source vertices with factors 1/d (eq. 23).
///
/// `neighbours` gives each vertex and its distance d to the corresponding vertex. Where distances
/// are zero the factor would be infinite: those rows alone are averaged. Rows are scaled to a sum
/// of 1 first. The result is ordered by bone and sums to 1; it is empty without neighbours.
#[must_use]
pub fn shepard(weights: &SkinWeights, neighbours: &[(u32, f64)]) -> Vec<(u32, f64)> {
    let coincident = neighbours.iter().any(|(_, distance)| *distance <= 0.0);
    let factor = |distance: f64| match (coincident, distance <= 0.0) {
        (true, true) => 1.0,
        (true, false) => 0.0,
        (false, _) => 1.0 / distance,
    };
    let mut blend: Vec<(u32, f64)> = Vec::new();
    let mut total = 0.0;
    for &(vertex, distance) in neighbours {
        let (factor, row_total) = (factor(distance), weights.total(vertex as usize));
        if factor > 0.0 && row_total > 0.0 {
            total += factor;
            for (bone, weight) in weights.entries(vertex as usize) {
                let share = factor * f64::from(weight) / row_total;
                match blend.binary_search_by_key(&bone, |entry| entry.0) {
                    Ok(at) => blend[at].1 += share,
                    Err(at) => blend.insert(at, (bone, share)),
                }
            }
        }
    }
    blend.iter_mut().for_each(|entry| entry.1 /= total);
    blend
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights() -> SkinWeights {
        SkinWeights::from_dense(&[1.0, 0.0, 0.0, 2.0, 0.5, 0.5, 0.0, 0.0], 2).unwrap()
    }

    #[test]
    fn nearer_rows_count_more_whatever_their_sum() {
        let blend = shepard(&weights(), &[(0, 1.0), (1, 3.0)]);
        assert_eq!(blend, [(0, 0.75), (1, 0.25)]);
    }

    #[test]
    fn coincident_rows_are_averaged_alone() {
        assert_eq!(shepard(&weights(), &[(0, 1.0), (1, 0.0), (2, 0.0)]), [(0, 0.25), (1, 0.75)]);
    }

    #[test]
    fn rows_without_weights_do_not_count() {
        assert_eq!(shepard(&weights(), &[(3, 0.1), (0, 1.0)]), [(0, 1.0)]);
        assert!(shepard(&weights(), &[(3, 0.1)]).is_empty());
        assert!(shepard(&weights(), &[]).is_empty());
    }
}
