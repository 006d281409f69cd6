//! Factorisation, solves and inertia against dense linear algebra.

use dermis::linalg::{Cholesky, LinalgError, SymbolicCholesky, SymmetricMatrix, negative_eigenvalue_count};
use nalgebra::DMatrix;
use proptest::prelude::*;

use crate::surfaces::{
    bits, both, dense, dense_eigenvalues, laplacian, noise, on_threads, patterns, sphere, torus,
};

fn factor(matrix: &SymmetricMatrix) -> Result<Cholesky, LinalgError> {
    Cholesky::factor(&SymbolicCholesky::new(matrix).unwrap(), matrix)
}

#[test]
fn solutions_match_a_dense_factorisation() {
    // Two components, so that the elimination tree is a forest.
    let (laplacian, mass) = laplacian(&both(sphere(3), &torus(20, 12, |u| u)));
    let matrix = laplacian.add_scaled_diagonal(0.1, &mass).unwrap();
    let columns = 11;
    let block: Vec<f64> = (0..matrix.size() * columns).map(noise).collect();
    let mut solution = block.clone();
    factor(&matrix).unwrap().solve_in_place(&mut solution, columns).unwrap();
    let oracle =
        dense(&matrix).cholesky().unwrap().solve(&DMatrix::from_column_slice(matrix.size(), columns, &block));
    let difference = (DMatrix::from_column_slice(matrix.size(), columns, &solution) - &oracle).amax();
    assert!(difference < 1e-11 * oracle.amax(), "{difference:e}");
}

proptest! {
    #[test]
    fn random_patterns_are_solved(matrix in patterns()) {
        let expected: Vec<f64> = (0..matrix.size()).map(noise).collect();
        let mut solution = matrix.mul_vec(&expected).unwrap();
        factor(&matrix).unwrap().solve_in_place(&mut solution, 1).unwrap();
        for (solution, expected) in solution.iter().zip(&expected) {
            prop_assert!((solution - expected).abs() < 1e-9);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Sparse random graphs of many small pieces with a few hubs: their elimination trees have
    /// subtrees of all shapes, which the solves cut into tasks.
    #[test]
    fn bushy_elimination_trees_are_solved(
        (size, reach, edges) in (60_usize..900, 2_usize..60).prop_flat_map(|(size, reach)| {
            let edge = (0..size, 1..=reach, 0.1..1.1_f64);
            (Just(size), Just(reach), prop::collection::vec(edge, size / 2..2 * size))
        }),
        hubs in 0_usize..6
    ) {
        let mut triplets: Vec<_> = (0..size).map(|at| (at, at, 0.05)).collect();
        for (at, (a, step, weight)) in edges.into_iter().enumerate() {
            let b = if at % 7 < hubs { at % 7 } else { (a + step * step % reach) % size };
            if a != b {
                triplets.extend([(a, b, -weight), (a, a, weight), (b, b, weight)]);
            }
        }
        let matrix = SymmetricMatrix::from_triplets(size, &triplets).unwrap();
        let columns = 9;
        let expected: Vec<f64> = (0..size * columns).map(noise).collect();
        let mut solution = matrix.mul_block(&expected, columns).unwrap();
        factor(&matrix).unwrap().solve_in_place(&mut solution, columns).unwrap();
        for (solution, expected) in solution.iter().zip(&expected) {
            prop_assert!((solution - expected).abs() < 1e-9);
        }
    }
}

#[test]
fn a_solution_has_the_same_bits_on_any_thread_and_in_any_company() {
    let (laplacian, mass) = laplacian(&sphere(4));
    let matrix = laplacian.add_scaled_diagonal(1.0, &mass).unwrap();
    let block: Vec<f64> = (0..matrix.size() * 20).map(noise).collect();
    let solve = |block: &[f64], columns: usize| {
        let mut solution = block.to_vec();
        factor(&matrix).unwrap().solve_in_place(&mut solution, columns).unwrap();
        solution
    };
    let one = on_threads(1, || solve(&block, 20));
    let two = on_threads(2, || solve(&block, 20));
    assert_eq!(bits(&one), bits(&two));
    let alone = solve(&block[13 * matrix.size()..14 * matrix.size()], 1);
    assert_eq!(bits(&alone), bits(&one[13 * matrix.size()..14 * matrix.size()]));
}

#[test]
fn singular_and_indefinite_matrices_are_rejected() {
    let (laplacian, mass) = laplacian(&sphere(2));
    assert!(matches!(factor(&laplacian).unwrap_err(), LinalgError::NotPositiveDefinite { .. }));
    let indefinite = laplacian.add_scaled_diagonal(-1.0, &mass).unwrap();
    assert!(matches!(factor(&indefinite).unwrap_err(), LinalgError::NotPositiveDefinite { .. }));
    let one_bad_row = SymmetricMatrix::from_triplets(3, &[(0, 0, 1.0), (1, 1, -2.0), (2, 2, 1.0)]).unwrap();
    assert_eq!(
        factor(&one_bad_row).unwrap_err(),
        LinalgError::NotPositiveDefinite { column: 1, pivot: -2.0 }
    );
    let zero_row = SymmetricMatrix::from_triplets(3, &[(0, 0, 1.0), (1, 1, 1.0)]).unwrap();
    assert!(matches!(factor(&zero_row).unwrap_err(), LinalgError::NotPositiveDefinite { column: 2, .. }));
}

#[test]
fn the_symbolic_part_serves_every_matrix_of_its_pattern_and_no_other() {
    let (first, mass) = laplacian(&sphere(2));
    let symbolic = SymbolicCholesky::new(&first).unwrap();
    for shift in [0.5, 2.0] {
        let matrix = first.add_scaled_diagonal(shift, &mass).unwrap();
        let mut solution = matrix.mul_vec(&mass).unwrap();
        Cholesky::factor(&symbolic, &matrix).unwrap().solve_in_place(&mut solution, 1).unwrap();
        assert!(solution.iter().zip(&mass).all(|(solution, mass)| (solution - mass).abs() < 1e-12));
    }
    let (other, _) = laplacian(&torus(11, 6, |u| u));
    assert_eq!(first.size(), other.size(), "the sizes alone do not tell them apart");
    assert_eq!(Cholesky::factor(&symbolic, &other).unwrap_err(), LinalgError::PatternMismatch);
}

#[test]
fn bad_right_hand_sides_stay_unchanged() {
    let matrix = SymmetricMatrix::from_triplets(2, &[(0, 0, 4.0), (1, 1, 2.0)]).unwrap();
    let cholesky = factor(&matrix).unwrap();
    let mut block = [8.0, 2.0, 1.0, f64::NAN];
    let error = cholesky.solve_in_place(&mut block, 2).unwrap_err();
    assert_eq!(error, LinalgError::NonFinite { what: "right-hand side", row: 1, column: 1 });
    assert_eq!(block[..3], [8.0, 2.0, 1.0]);
    assert!(matches!(
        cholesky.solve_in_place(&mut block, 3).unwrap_err(),
        LinalgError::DimensionMismatch { .. }
    ));
    cholesky.solve_in_place(&mut block[..2], 1).unwrap();
    assert_eq!(block[..2], [2.0, 1.0]);
}

#[test]
fn the_smallest_sizes_work() {
    let empty = SymmetricMatrix::from_triplets(0, &[]).unwrap();
    factor(&empty).unwrap().solve_in_place(&mut [], 3).unwrap();
    let single = SymmetricMatrix::from_triplets(1, &[(0, 0, 4.0)]).unwrap();
    let mut block = [2.0];
    factor(&single).unwrap().solve_in_place(&mut block, 1).unwrap();
    assert_eq!(block, [0.5]);
}

#[test]
fn inertia_counts_the_eigenvalues_below_every_gap() {
    let (matrix, mass) = laplacian(&torus(24, 14, |u| u + 0.02 * (7.0 * u).sin()));
    let symbolic = SymbolicCholesky::new(&matrix).unwrap();
    let values = dense_eigenvalues(&matrix, &mass);
    let mut counted = 0;
    for (below, pair) in values.windows(2).enumerate() {
        if pair[1] - pair[0] > 1e-6 * pair[1] {
            // Elimination without pivoting may fail at one point of the gap, not at all of them.
            let counts = [0.5, 0.35, 0.65].map(|fraction| {
                let shift = pair[0] + fraction * (pair[1] - pair[0]);
                negative_eigenvalue_count(&symbolic, &matrix, &mass, shift)
            });
            assert!(counts.contains(&Ok(below + 1)), "{counts:?}");
            assert!(
                counts.iter().all(|count| count.as_ref().is_ok_and(|count| *count == below + 1)
                    || matches!(count, Err(LinalgError::VanishingPivot { .. }))),
                "{counts:?}"
            );
            counted += 1;
        }
    }
    assert!(counted > values.len() / 3);
}

#[test]
fn a_vanishing_pivot_is_an_error_and_another_shift_works() {
    // The eigenvalues are -1 and 1: elimination without pivoting fails at shift 0.
    let matrix = SymmetricMatrix::from_triplets(2, &[(0, 1, 1.0)]).unwrap();
    let symbolic = SymbolicCholesky::new(&matrix).unwrap();
    let count = |shift| negative_eigenvalue_count(&symbolic, &matrix, &[1.0, 1.0], shift);
    assert!(matches!(count(0.0).unwrap_err(), LinalgError::VanishingPivot { .. }));
    assert!(matches!(count(1e-13).unwrap_err(), LinalgError::VanishingPivot { .. }));
    assert_eq!(count(0.1), Ok(1));
    assert_eq!(count(-1.1), Ok(0));
    assert_eq!(count(1.1), Ok(2));
    let bad = negative_eigenvalue_count(&symbolic, &matrix, &[1.0, 0.0], 0.1);
    assert_eq!(bad.unwrap_err(), LinalgError::NonPositiveMass { index: 1, value: 0.0 });
}
