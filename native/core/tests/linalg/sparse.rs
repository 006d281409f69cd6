//! Assembly and products of sparse matrices against dense ones.

use dermis::linalg::{LinalgError, SymmetricMatrix};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

use crate::surfaces::dense;

/// A size and triplets within it, with many repetitions.
fn triplets() -> impl Strategy<Value = (usize, Vec<(usize, usize, f64)>)> {
    (1_usize..12)
        .prop_flat_map(|size| (Just(size), prop::collection::vec((0..size, 0..size, -10.0..10.0_f64), 0..60)))
}

fn reference(size: usize, triplets: &[(usize, usize, f64)]) -> DMatrix<f64> {
    let mut sum = DMatrix::zeros(size, size);
    for &(row, column, value) in triplets {
        sum[(row, column)] += value;
        if row != column {
            sum[(column, row)] += value;
        }
    }
    sum
}

proptest! {
    #[test]
    fn assembly_adds_in_the_order_given((size, triplets) in triplets()) {
        let matrix = SymmetricMatrix::from_triplets(size, &triplets).unwrap();
        // The reference adds in the same order, so equality is exact.
        prop_assert_eq!(dense(&matrix), reference(size, &triplets));
        for column in 0..size {
            let (rows, _) = matrix.column(column);
            prop_assert!(rows.windows(2).all(|pair| pair[0] < pair[1]));
            prop_assert!(rows.contains(&column), "the diagonal is always stored");
        }
    }

    #[test]
    fn products_match_the_dense_matrix((size, triplets) in triplets(), seed in 0_usize..1000) {
        let matrix = SymmetricMatrix::from_triplets(size, &triplets).unwrap();
        let block: Vec<f64> = (0..size * 3).map(|at| ((at + seed) as f64).sin()).collect();
        let product = matrix.mul_block(&block, 3).unwrap();
        let expected = dense(&matrix) * DMatrix::from_column_slice(size, 3, &block);
        prop_assert!((DMatrix::from_column_slice(size, 3, &product) - expected).amax() < 1e-11);
        prop_assert_eq!(matrix.mul_vec(&block[..size]).unwrap(), product[..size].to_vec());
    }

    #[test]
    fn submatrices_keep_rows_in_the_order_asked((size, triplets) in triplets(), seed in 0_usize..1000) {
        let matrix = SymmetricMatrix::from_triplets(size, &triplets).unwrap();
        let mut kept: Vec<usize> = (0..size).filter(|at| (at * 7 + seed) % 3 != 0).collect();
        let turn = seed % kept.len().max(1);
        kept.rotate_left(turn);
        let part = matrix.principal_submatrix(&kept).unwrap();
        let expected = dense(&matrix).select_rows(&kept).select_columns(&kept);
        prop_assert_eq!(dense(&part), expected);
    }

    #[test]
    fn diagonal_operations_match_the_dense_matrix((size, triplets) in triplets(), scale in -3.0..3.0_f64) {
        let matrix = SymmetricMatrix::from_triplets(size, &triplets).unwrap();
        let d: Vec<f64> = (0..size).map(|at| 0.5 + at as f64).collect();
        let diagonal = DMatrix::from_diagonal(&DVector::from_column_slice(&d));
        let sum = matrix.add_scaled_diagonal(scale, &d).unwrap();
        prop_assert!((dense(&sum) - dense(&matrix) - &diagonal * scale).amax() < 1e-12);
        prop_assert!(std::sync::Arc::ptr_eq(sum.pattern(), matrix.pattern()));
        let more: Vec<_> = triplets.iter().map(|&(row, column, value)| (column, row, scale * value)).collect();
        let sum = matrix.add_triplets(&more).unwrap();
        prop_assert!((dense(&sum) - dense(&matrix) * (1.0 + scale)).amax() < 1e-9);
        let scaled = matrix.scale_symmetrically(&d).unwrap();
        prop_assert!((dense(&scaled) - &diagonal * dense(&matrix) * &diagonal).amax() < 1e-9);
        prop_assert_eq!(dense(&scaled), dense(&scaled).transpose());
        prop_assert_eq!(matrix.diagonal(), dense(&matrix).diagonal().as_slice().to_vec());
    }
}

#[test]
fn bad_entries_are_named() {
    let outside = SymmetricMatrix::from_triplets(3, &[(0, 0, 1.0), (1, 3, 1.0)]);
    assert_eq!(outside.unwrap_err(), LinalgError::IndexOutOfRange { row: 1, column: 3, size: 3 });
    let nan = SymmetricMatrix::from_triplets(3, &[(2, 1, f64::NAN)]);
    assert_eq!(nan.unwrap_err(), LinalgError::NonFinite { what: "matrix", row: 2, column: 1 });
    let overflow = SymmetricMatrix::from_triplets(2, &[(1, 0, f64::MAX), (0, 1, f64::MAX)]);
    assert!(matches!(overflow.unwrap_err(), LinalgError::NonFinite { .. }));
}

#[test]
fn wrong_lengths_and_repeated_rows_are_errors() {
    let matrix = SymmetricMatrix::from_triplets(3, &[(0, 1, 1.0)]).unwrap();
    assert_eq!(
        matrix.mul_vec(&[1.0; 4]).unwrap_err(),
        LinalgError::DimensionMismatch { what: "block of vectors", expected: 3, found: 4 }
    );
    assert!(matrix.add_scaled_diagonal(1.0, &[1.0; 2]).is_err());
    assert!(matrix.scale_symmetrically(&[1.0; 2]).is_err());
    assert_eq!(matrix.add_triplets(&[(0, 2, 1.0)]).unwrap_err(), LinalgError::PatternMismatch);
    assert_eq!(matrix.add_triplets(&[(0, 3, 1.0)]).unwrap_err(), LinalgError::PatternMismatch);
    assert_eq!(
        matrix.add_scaled_diagonal(1.0, &[0.0, f64::INFINITY, 0.0]).unwrap_err(),
        LinalgError::NonFinite { what: "matrix", row: 1, column: 1 }
    );
    assert_eq!(matrix.principal_submatrix(&[2, 0, 2]).unwrap_err(), LinalgError::DuplicateIndex { index: 2 });
    assert!(matches!(matrix.principal_submatrix(&[3]).unwrap_err(), LinalgError::IndexOutOfRange { .. }));
}

#[test]
fn an_empty_matrix_is_a_matrix() {
    let empty = SymmetricMatrix::from_triplets(0, &[]).unwrap();
    assert_eq!(empty.size(), 0);
    assert!(empty.mul_vec(&[]).unwrap().is_empty());
    assert_eq!(empty.pattern().column_starts(), [0]);
}
