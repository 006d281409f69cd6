//! The weights of one vertex in `f64`, as they are made and mixed before they become [`SkinWeights`].

use super::SkinWeights;

/// A weight row: `(bone, weight)`, bones ascending.
pub type Row = Vec<(u32, f64)>;

/// A row of weights, of sum 1; empty without weights.
#[must_use]
pub fn row_of(weights: &SkinWeights, vertex: usize) -> Row {
    normalized(weights.entries(vertex).map(|(bone, weight)| (bone, f64::from(weight))).collect())
}

/// Sum of rows with factors; what is not positive is left out.
pub fn blend<'a>(rows: impl Iterator<Item = (&'a Row, f64)>) -> Row {
    let mut entries: Row = rows
        .flat_map(|(row, factor)| row.iter().map(move |&(bone, weight)| (bone, factor * weight)))
        .collect();
    entries.sort_by_key(|entry| entry.0);
    entries
        .chunk_by(|a, b| a.0 == b.0)
        .map(|run| (run[0].0, run.iter().map(|entry| entry.1).sum()))
        .filter(|entry| entry.1 > 0.0)
        .collect()
}

/// The row scaled to a sum of 1; empty if it has no weight.
#[must_use]
pub fn normalized(mut row: Row) -> Row {
    let total: f64 = row.iter().map(|entry| entry.1).sum();
    if total <= 0.0 {
        return Row::new();
    }
    row.iter_mut().for_each(|entry| entry.1 /= total);
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_mixed_bone_by_bone() {
        let (a, b) = (vec![(0, 0.25), (2, 0.75)], vec![(1, 0.5), (2, 0.5)]);
        assert_eq!(blend([(&a, 1.0), (&b, 0.5)].into_iter()), [(0, 0.25), (1, 0.25), (2, 1.0)]);
        assert_eq!(blend([(&b, 1.0), (&a, -1.0)].into_iter()), [(1, 0.5)], "nothing below zero stays");
    }

    #[test]
    fn rows_of_weights_have_a_sum_of_one_or_are_empty() {
        let weights = SkinWeights::from_dense(&[0.5, 1.5, 0.0, 0.0], 2).unwrap();
        assert_eq!(row_of(&weights, 0), [(0, 0.25), (1, 0.75)]);
        assert_eq!(row_of(&weights, 1), []);
    }
}
