//! Sparse skin weights: for every vertex, the bones that influence it and by how much.

/// Weights that cannot be used, naming the first entry at fault.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WeightsError {
    /// A weight is negative, NaN or infinite.
    #[error("the weight of vertex {vertex} for bone {bone} is {value}; weights are finite and not negative")]
    BadValue {
        /// Vertex of the weight.
        vertex: usize,
        /// Bone of the weight.
        bone: usize,
        /// The weight.
        value: f64,
    },
    /// An entry names a vertex or bone that does not exist.
    #[error("entry {entry} refers to {element} {index}, but there are {count}")]
    OutOfRange {
        /// Index of the entry.
        entry: usize,
        /// "vertex" or "bone".
        element: &'static str,
        /// The index that it names.
        index: i64,
        /// How many there are.
        count: usize,
    },
}

/// Weights in compressed rows: one row per vertex, bones ascending, no zeros stored.
///
/// Values are finite and not negative. Rows need not sum to 1; see [`SkinWeights::normalized`].
#[derive(Debug, Clone, PartialEq)]
pub struct SkinWeights {
    starts: Vec<u32>,
    bones: Vec<u32>,
    values: Vec<f32>,
    bone_count: usize,
}

impl SkinWeights {
    /// Builds rows from entries `(vertex, bone, value)` in any order. Values of a repeated pair are
    /// added in the order given.
    ///
    /// # Errors
    /// [`WeightsError`] naming the first entry that is out of range or has no usable value.
    pub fn from_triplets(
        entries: impl IntoIterator<Item = (i64, i64, f64)>,
        vertex_count: usize,
        bone_count: usize,
    ) -> Result<Self, WeightsError> {
        let mut sorted = Vec::new();
        for (entry, (vertex, bone, value)) in entries.into_iter().enumerate() {
            for (element, index, count) in [("vertex", vertex, vertex_count), ("bone", bone, bone_count)] {
                if !usize::try_from(index).is_ok_and(|i| i < count) {
                    return Err(WeightsError::OutOfRange { entry, element, index, count });
                }
            }
            if !(value.is_finite() && value >= 0.0) {
                return Err(WeightsError::BadValue { vertex: vertex as usize, bone: bone as usize, value });
            }
            sorted.push((vertex as u32, bone as u32, value));
        }
        sorted.sort_by_key(|&(vertex, bone, _)| (vertex, bone));
        let mut rows = RowBuilder::new(vertex_count, bone_count);
        let mut next = 0;
        for run in sorted.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            while next < run[0].0 {
                rows.finish_row();
                next += 1;
            }
            rows.push(run[0].1, run.iter().map(|entry| entry.2).sum());
        }
        Ok(rows.finish())
    }

    /// Builds rows from rows: for each vertex its `(bone, value)` entries, bones ascending and in
    /// range, values finite and not negative. Entries that are zero in `f32` are dropped.
    pub(crate) fn from_rows<R>(rows: impl IntoIterator<Item = R>, bone_count: usize) -> Self
    where
        R: IntoIterator<Item = (u32, f64)>,
    {
        let mut builder = RowBuilder::new(0, bone_count);
        for row in rows {
            for (bone, value) in row {
                builder.push(bone, value);
            }
            builder.finish_row();
        }
        builder.finish()
    }

    /// Builds rows from a dense matrix (V×B), row after row.
    ///
    /// # Errors
    /// [`WeightsError::BadValue`] naming the first weight that is negative or not finite.
    pub fn from_dense(dense: &[f64], bone_count: usize) -> Result<Self, WeightsError> {
        let vertex_count = dense.len().checked_div(bone_count).unwrap_or(0);
        let entries = dense.iter().enumerate().filter(|(_, value)| **value != 0.0);
        let entries = entries.map(|(i, &value)| ((i / bone_count) as i64, (i % bone_count) as i64, value));
        Self::from_triplets(entries, vertex_count, bone_count)
    }

    /// Number of vertices (rows).
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of bones (columns).
    #[must_use]
    pub fn bone_count(&self) -> usize {
        self.bone_count
    }

    /// Number of entries above zero.
    #[must_use]
    pub fn entry_count(&self) -> usize {
        self.values.len()
    }

    /// Bones of a vertex, ascending, and their weights.
    #[must_use]
    pub fn row(&self, vertex: usize) -> (&[u32], &[f32]) {
        let range = self.starts[vertex] as usize..self.starts[vertex + 1] as usize;
        (&self.bones[range.clone()], &self.values[range])
    }

    /// Entries of a vertex as `(bone, weight)`.
    pub fn entries(&self, vertex: usize) -> impl Iterator<Item = (u32, f32)> + '_ {
        let (bones, values) = self.row(vertex);
        bones.iter().copied().zip(values.iter().copied())
    }

    /// The bone that a vertex follows most, the first of several alike, and its weight; `None` without weights
    /// above zero.
    #[must_use]
    pub fn heaviest(&self, vertex: usize) -> Option<(u32, f32)> {
        let weighted = self.entries(vertex).filter(|entry| entry.1 > 0.0);
        weighted.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
    }

    /// Sum of a vertex's weights.
    #[must_use]
    pub fn total(&self, vertex: usize) -> f64 {
        self.row(vertex).1.iter().map(|&w| f64::from(w)).sum()
    }

    /// Which bones (B) have any weight.
    #[must_use]
    pub fn used_bones(&self) -> Vec<bool> {
        let mut used = vec![false; self.bone_count];
        self.bones.iter().for_each(|&bone| used[bone as usize] = true);
        used
    }

    /// Weights as a dense matrix (V×B), row after row.
    #[must_use]
    pub fn to_dense(&self) -> Vec<f32> {
        let mut dense = vec![0.0; self.vertex_count() * self.bone_count];
        for vertex in 0..self.vertex_count() {
            for (bone, value) in self.entries(vertex) {
                dense[vertex * self.bone_count + bone as usize] = value;
            }
        }
        dense
    }

    /// The same weights with rows that sum to 1; a row without weights stays empty.
    #[must_use]
    pub fn normalized(&self) -> Self {
        self.map_rows(|row| scale_to_one(row))
    }

    /// Keeps the `count` largest influences of every vertex (the lower bone where weights are
    /// equal) and scales them to the row's former sum.
    #[must_use]
    pub fn limited(&self, count: usize) -> Self {
        self.map_rows(|row| {
            let total: f64 = row.iter().map(|entry| entry.1).sum();
            row.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
            row.truncate(count);
            row.sort_unstable_by_key(|entry| entry.0);
            scale_to_one(row);
            row.iter_mut().for_each(|entry| entry.1 *= total);
        })
    }

    fn map_rows(&self, change: impl Fn(&mut Vec<(u32, f64)>)) -> Self {
        let rows = (0..self.vertex_count()).map(|vertex| {
            let mut row: Vec<(u32, f64)> = self.entries(vertex).map(|(b, w)| (b, f64::from(w))).collect();
            change(&mut row);
            row
        });
        Self::from_rows(rows, self.bone_count)
    }
}

/// Scales a row to a sum of 1, if it has any weight.
fn scale_to_one(row: &mut [(u32, f64)]) {
    let total: f64 = row.iter().map(|entry| entry.1).sum();
    if total > 0.0 {
        row.iter_mut().for_each(|entry| entry.1 /= total);
    }
}

struct RowBuilder {
    weights: SkinWeights,
    vertex_count: usize,
}

impl RowBuilder {
    fn new(vertex_count: usize, bone_count: usize) -> Self {
        let weights = SkinWeights { starts: vec![0], bones: vec![], values: vec![], bone_count };
        Self { weights, vertex_count }
    }

    fn push(&mut self, bone: u32, value: f64) {
        let value = value as f32;
        if value > 0.0 {
            self.weights.bones.push(bone);
            self.weights.values.push(value);
        }
    }

    fn finish_row(&mut self) {
        self.weights.starts.push(self.weights.values.len() as u32);
    }

    fn finish(mut self) -> SkinWeights {
        while self.weights.starts.len() <= self.vertex_count {
            self.finish_row();
        }
        self.weights
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn repeated_pairs_are_added_and_rows_may_be_empty() {
        let entries = [(2, 1, 0.25), (0, 1, 0.5), (2, 0, 1.0), (2, 1, 0.25)];
        let weights = SkinWeights::from_triplets(entries, 4, 2).unwrap();
        assert_eq!(weights.row(2), (&[0, 1][..], &[1.0, 0.5][..]));
        assert_eq!(weights.entry_count(), 3);
        assert!(weights.row(1).0.is_empty() && weights.row(3).0.is_empty());
        assert_eq!(weights.to_dense(), [0.0, 0.5, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0]);
    }

    #[test]
    fn the_heaviest_bone_is_the_first_of_several_alike() {
        let entries = [(0, 0, 0.2), (0, 1, 0.4), (0, 2, 0.4), (1, 2, 0.0)];
        let weights = SkinWeights::from_triplets(entries, 3, 3).unwrap();
        assert_eq!([0, 1, 2].map(|vertex| weights.heaviest(vertex)), [Some((1, 0.4)), None, None]);
    }

    #[test]
    fn names_the_entry_at_fault() {
        let bad = |entry| SkinWeights::from_triplets([(0, 0, 1.0), entry], 2, 2).unwrap_err();
        assert!(matches!(
            bad((2, 0, 1.0)),
            WeightsError::OutOfRange { entry: 1, element: "vertex", index: 2, .. }
        ));
        assert!(matches!(
            bad((0, -1, 1.0)),
            WeightsError::OutOfRange { entry: 1, element: "bone", index: -1, .. }
        ));
        assert!(matches!(bad((1, 1, -0.5)), WeightsError::BadValue { vertex: 1, bone: 1, .. }));
        assert!(matches!(bad((1, 1, f64::NAN)), WeightsError::BadValue { vertex: 1, bone: 1, .. }));
    }

    #[test]
    fn limiting_keeps_the_largest_and_the_sum() {
        let weights = SkinWeights::from_dense(&[0.1, 0.4, 0.3, 0.2], 4).unwrap();
        let limited = weights.limited(2);
        assert_eq!(limited.row(0).0, [1, 2]);
        assert!((limited.total(0) - 1.0).abs() < 1e-6);
        assert!((limited.row(0).1[0] - 4.0 / 7.0).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn dense_round_trip_and_normalisation(dense in prop::collection::vec(0.0f64..1.0, 0..40)) {
            let whole = dense.len() / 4 * 4;
            let weights = SkinWeights::from_dense(&dense[..whole], 4).unwrap();
            let back = weights.to_dense();
            prop_assert!(dense.iter().zip(&back).all(|(a, b)| *a as f32 == *b));
            let normalized = weights.normalized();
            for vertex in 0..weights.vertex_count() {
                if weights.total(vertex) > 0.0 {
                    prop_assert!((normalized.total(vertex) - 1.0).abs() < 1e-6);
                }
            }
        }
    }
}
