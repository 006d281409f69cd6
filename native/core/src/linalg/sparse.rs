//! Symmetric sparse matrices in compressed column form.
//!
//! Both triangles are stored, every diagonal entry is present (possibly zero), rows ascend in
//! each column, and mirrored entries are equal bit for bit. Since the matrix is symmetric, the
//! arrays are its compressed rows as well.

use std::sync::Arc;

use rayon::prelude::*;

use super::error::LinalgError;

/// Rows per parallel task of a product; a row's sum never crosses tasks.
const ROWS_PER_TASK: usize = 4096;

/// Positions of the stored entries of a [`SymmetricMatrix`], shared by matrices that differ only
/// in their values.
#[derive(Debug, PartialEq, Eq)]
pub struct SparsityPattern {
    column_starts: Vec<usize>,
    rows: Vec<usize>,
}

impl SparsityPattern {
    /// Number of rows and columns.
    pub fn size(&self) -> usize {
        self.column_starts.len() - 1
    }

    /// Where each column begins in [`Self::rows`]: `size + 1` entries.
    pub fn column_starts(&self) -> &[usize] {
        &self.column_starts
    }

    /// Row index of every stored entry, ascending within a column.
    pub fn rows(&self) -> &[usize] {
        &self.rows
    }
}

/// Symmetric sparse matrix of size n × n.
#[derive(Debug, Clone)]
pub struct SymmetricMatrix {
    pattern: Arc<SparsityPattern>,
    values: Vec<f64>,
}

impl SymmetricMatrix {
    /// Builds a matrix from `(row, column, value)` triplets.
    ///
    /// An off-diagonal triplet stands for the entry and its mirror image, so each pair is given
    /// once, in either triangle. Triplets at the same position are added in the order given.
    ///
    /// # Errors
    /// [`LinalgError::IndexOutOfRange`], [`LinalgError::NonFinite`] (also when a sum overflows).
    pub fn from_triplets(size: usize, triplets: &[(usize, usize, f64)]) -> Result<Self, LinalgError> {
        let mut counts = vec![1_usize; size];
        for &(row, column, value) in triplets {
            if row >= size || column >= size {
                return Err(LinalgError::IndexOutOfRange { row, column, size });
            }
            if !value.is_finite() {
                return Err(non_finite(row, column));
            }
            counts[column] += 1;
            if row != column {
                counts[row] += 1;
            }
        }
        let mut next = Vec::with_capacity(size);
        let mut total = 0;
        for &count in &counts {
            next.push(total);
            total += count;
        }
        // Bucket by column, keeping the order of the triplets, then sort each bucket stably.
        let mut entries = vec![(0_usize, 0.0_f64); total];
        let mut put = |column: usize, row: usize, value: f64| {
            entries[next[column]] = (row, value);
            next[column] += 1;
        };
        for column in 0..size {
            put(column, column, 0.0);
        }
        for &(row, column, value) in triplets {
            put(column, row, value);
            if row != column {
                put(row, column, value);
            }
        }
        let mut column_starts = Vec::with_capacity(size + 1);
        column_starts.push(0);
        let mut rows: Vec<usize> = Vec::with_capacity(total);
        let mut values: Vec<f64> = Vec::with_capacity(total);
        let mut rest = entries.as_mut_slice();
        let mut buckets: Vec<_> = counts.iter().filter_map(|&count| rest.split_off_mut(..count)).collect();
        buckets.par_iter_mut().for_each(|bucket| bucket.sort_by_key(|entry| entry.0));
        for (column, bucket) in buckets.iter().enumerate() {
            let mut previous = usize::MAX;
            for &(row, value) in bucket.iter() {
                if row == previous {
                    if let Some(last) = values.last_mut() {
                        *last += value;
                    }
                } else {
                    rows.push(row);
                    values.push(value);
                    previous = row;
                }
            }
            let start = column_starts[column];
            if let Some(at) = values[start..].iter().position(|value| !value.is_finite()) {
                return Err(non_finite(rows[start + at], column));
            }
            column_starts.push(rows.len());
        }
        rows.shrink_to_fit();
        values.shrink_to_fit();
        Ok(Self { pattern: Arc::new(SparsityPattern { column_starts, rows }), values })
    }

    /// Number of rows and columns.
    pub fn size(&self) -> usize {
        self.pattern.size()
    }

    /// Positions of the stored entries.
    pub fn pattern(&self) -> &Arc<SparsityPattern> {
        &self.pattern
    }

    /// Values of the stored entries, in the order of [`SparsityPattern::rows`].
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Rows and values of one column (or columns and values of one row).
    pub fn column(&self, column: usize) -> (&[usize], &[f64]) {
        let range = self.pattern.column_starts[column]..self.pattern.column_starts[column + 1];
        (&self.pattern.rows[range.clone()], &self.values[range])
    }

    /// The n diagonal entries.
    pub fn diagonal(&self) -> Vec<f64> {
        (0..self.size())
            .map(|column| {
                let (rows, values) = self.column(column);
                rows.binary_search(&column).map_or(0.0, |at| values[at])
            })
            .collect()
    }

    /// `A x`.
    ///
    /// # Errors
    /// [`LinalgError::DimensionMismatch`] unless `vector` has n entries.
    pub fn mul_vec(&self, vector: &[f64]) -> Result<Vec<f64>, LinalgError> {
        self.mul_block(vector, 1)
    }

    /// `A X` for the columns of the column-major n × `columns` matrix `X`.
    ///
    /// # Errors
    /// [`LinalgError::DimensionMismatch`] unless `block` has n · `columns` entries.
    pub fn mul_block(&self, block: &[f64], columns: usize) -> Result<Vec<f64>, LinalgError> {
        let size = self.size();
        check_length("block of vectors", size * columns, block.len())?;
        let mut product = vec![0.0; block.len()];
        if size == 0 {
            return Ok(product);
        }
        for (vector, out) in block.chunks_exact(size).zip(product.chunks_exact_mut(size)) {
            out.par_chunks_mut(ROWS_PER_TASK).enumerate().for_each(|(task, out)| {
                let first = task * ROWS_PER_TASK;
                for (row, out) in (first..).zip(out) {
                    let (columns, values) = self.column(row);
                    *out = columns.iter().zip(values).map(|(&column, value)| value * vector[column]).sum();
                }
            });
        }
        Ok(product)
    }

    /// The rows and columns `kept`, in that order.
    ///
    /// # Errors
    /// [`LinalgError::IndexOutOfRange`], [`LinalgError::DuplicateIndex`].
    pub fn principal_submatrix(&self, kept: &[usize]) -> Result<Self, LinalgError> {
        let size = self.size();
        let mut position = vec![usize::MAX; size];
        for (at, &index) in kept.iter().enumerate() {
            if index >= size {
                return Err(LinalgError::IndexOutOfRange { row: index, column: index, size });
            }
            if position[index] != usize::MAX {
                return Err(LinalgError::DuplicateIndex { index });
            }
            position[index] = at;
        }
        let mut column_starts = Vec::with_capacity(kept.len() + 1);
        column_starts.push(0);
        let mut rows = Vec::new();
        let mut values = Vec::new();
        let mut entries = Vec::new();
        for &index in kept {
            let (old_rows, old_values) = self.column(index);
            entries.clear();
            entries.extend(
                old_rows
                    .iter()
                    .zip(old_values)
                    .filter(|(row, _)| position[**row] != usize::MAX)
                    .map(|(&row, &value)| (position[row], value)),
            );
            entries.sort_unstable_by_key(|entry| entry.0);
            rows.extend(entries.iter().map(|entry| entry.0));
            values.extend(entries.iter().map(|entry| entry.1));
            column_starts.push(rows.len());
        }
        Ok(Self { pattern: Arc::new(SparsityPattern { column_starts, rows }), values })
    }

    /// `A + scale · diag(diagonal)`, with the pattern of `A`.
    ///
    /// # Errors
    /// [`LinalgError::DimensionMismatch`], [`LinalgError::NonFinite`].
    pub fn add_scaled_diagonal(&self, scale: f64, diagonal: &[f64]) -> Result<Self, LinalgError> {
        check_length("diagonal", self.size(), diagonal.len())?;
        let mut sum = self.clone();
        for (column, &value) in diagonal.iter().enumerate() {
            let range = self.pattern.column_starts[column]..self.pattern.column_starts[column + 1];
            if let Ok(at) = self.pattern.rows[range.clone()].binary_search(&column) {
                let entry = &mut sum.values[range.start + at];
                *entry += scale * value;
                if !entry.is_finite() {
                    return Err(non_finite(column, column));
                }
            }
        }
        Ok(sum)
    }

    /// `A + B` with the pattern of `A`, B given by `(row, column, value)` triplets as in
    /// [`Self::from_triplets`] that all lie in that pattern.
    ///
    /// # Errors
    /// [`LinalgError::PatternMismatch`], [`LinalgError::NonFinite`].
    pub fn add_triplets(&self, triplets: &[(usize, usize, f64)]) -> Result<Self, LinalgError> {
        let mut sum = self.clone();
        for &(row, column, value) in triplets {
            let mirrored = (row != column).then_some((column, row));
            for (row, column) in [(row, column)].into_iter().chain(mirrored) {
                if column >= self.size() {
                    return Err(LinalgError::PatternMismatch);
                }
                let range = self.pattern.column_starts[column]..self.pattern.column_starts[column + 1];
                let place = self.pattern.rows[range.clone()].binary_search(&row);
                let entry = &mut sum.values[range.start + place.map_err(|_| LinalgError::PatternMismatch)?];
                *entry += value;
                if !entry.is_finite() {
                    return Err(non_finite(row, column));
                }
            }
        }
        Ok(sum)
    }

    /// `diag(d) A diag(d)`, with the pattern of `A`.
    ///
    /// # Errors
    /// [`LinalgError::DimensionMismatch`], [`LinalgError::NonFinite`].
    pub fn scale_symmetrically(&self, d: &[f64]) -> Result<Self, LinalgError> {
        check_length("diagonal", self.size(), d.len())?;
        let mut scaled = self.clone();
        for column in 0..self.size() {
            for at in self.pattern.column_starts[column]..self.pattern.column_starts[column + 1] {
                let row = self.pattern.rows[at];
                // The product of the two factors commutes, so mirrored entries stay equal.
                scaled.values[at] *= d[row] * d[column];
                if !scaled.values[at].is_finite() {
                    return Err(non_finite(row, column));
                }
            }
        }
        Ok(scaled)
    }
}

/// Error unless `found` is `expected`.
pub(super) fn check_length(what: &'static str, expected: usize, found: usize) -> Result<(), LinalgError> {
    if expected == found { Ok(()) } else { Err(LinalgError::DimensionMismatch { what, expected, found }) }
}

/// Error unless every mass is finite and positive.
pub(super) fn check_masses(mass: &[f64]) -> Result<(), LinalgError> {
    for (index, &value) in mass.iter().enumerate() {
        if !value.is_finite() {
            return Err(LinalgError::NonFinite { what: "mass", row: index, column: 0 });
        }
        if value <= 0.0 {
            return Err(LinalgError::NonPositiveMass { index, value });
        }
    }
    Ok(())
}

fn non_finite(row: usize, column: usize) -> LinalgError {
    LinalgError::NonFinite { what: "matrix", row, column }
}
