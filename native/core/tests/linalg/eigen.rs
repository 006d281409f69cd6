//! Eigenpairs against the dense spectrum; repeated values, missing pairs, bad input.

use dermis::linalg::{Eigenpairs, LinalgError, SymmetricMatrix, smallest_eigenpairs};

use crate::surfaces::{bits, both, dense_eigenvalues, laplacian, on_threads, sphere, torus};

fn solve(
    matrix: &SymmetricMatrix,
    mass: &[f64],
    null_space: &[f64],
    pairs: usize,
) -> Result<Eigenpairs, LinalgError> {
    smallest_eigenpairs(matrix, mass, null_space, pairs, &mut |_| true)
}

/// Checks residuals, mass-orthonormality and orthogonality to the constant from scratch.
fn assert_eigenpairs(matrix: &SymmetricMatrix, mass: &[f64], found: &Eigenpairs) {
    let size = matrix.size();
    let pairs = found.values.len();
    let images = matrix.mul_block(&found.vectors, pairs).unwrap();
    let vector = |pair: usize| &found.vectors[pair * size..(pair + 1) * size];
    for pair in 0..pairs {
        let residual: f64 = (0..size)
            .map(|row| {
                (images[pair * size + row] - found.values[pair] * mass[row] * vector(pair)[row]).powi(2)
                    / mass[row]
            })
            .sum::<f64>()
            .sqrt();
        assert!(residual < 1e-8 * found.values[pair], "pair {pair}: {residual:e}");
        for other in 0..=pair {
            let product: f64 = (0..size).map(|row| vector(pair)[row] * mass[row] * vector(other)[row]).sum();
            let expected = if pair == other { 1.0 } else { 0.0 };
            assert!((product - expected).abs() < 1e-9, "pairs {pair}, {other}: {product:e}");
        }
        let constant: f64 = (0..size).map(|row| vector(pair)[row] * mass[row]).sum();
        assert!(constant.abs() < 1e-10, "pair {pair} meets the constant: {constant:e}");
    }
}

fn assert_close(found: &[f64], expected: &[f64], tolerance: f64) {
    for (pair, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert!(
            (found - expected).abs() <= tolerance * expected,
            "pair {pair}: {found} instead of {expected}"
        );
    }
}

#[test]
fn a_sphere_has_every_copy_of_its_repeated_eigenvalues() {
    let (matrix, mass) = laplacian(&sphere(4));
    assert_eq!(matrix.size(), 1026);
    // 80 pairs are l = 1 … 8, complete; 75 end within l = 8.
    for pairs in [80, 75] {
        let found = solve(&matrix, &mass, &vec![1.0; matrix.size()], pairs).unwrap();
        assert_eigenpairs(&matrix, &mass, &found);
        let mut pair = 0;
        for degree in 1..=8_usize {
            let continuous = (degree * (degree + 1)) as f64;
            for _ in 0..2 * degree + 1 {
                if pair < pairs {
                    let error = found.values[pair] / continuous - 1.0;
                    assert!(error.abs() < 0.09, "pair {pair}: {error}");
                    pair += 1;
                }
            }
        }
    }
}

#[test]
fn a_symmetric_torus_and_a_warped_one_match_the_dense_spectrum() {
    for warp in [0.0, 0.03] {
        let (matrix, mass) = laplacian(&torus(40, 18, |u| u + warp * (std::f64::consts::TAU * u).sin()));
        let expected = dense_eigenvalues(&matrix, &mass);
        let found = solve(&matrix, &mass, &vec![1.0; matrix.size()], 90).unwrap();
        assert_eigenpairs(&matrix, &mass, &found);
        assert_close(&found.values, &expected[1..], 1e-9);
    }
}

#[test]
fn nearly_degenerate_triangles_still_give_certified_pairs() {
    // Every fourth grid line almost touches the next one: B has entries from 10² to 10¹⁰.
    let squeeze = |u: f64| {
        let line = (u * 48.0).round();
        if line % 4.0 == 1.0 { (line - 0.9999) / 48.0 } else { u }
    };
    let (matrix, mass) = laplacian(&torus(48, 14, squeeze));
    let found = solve(&matrix, &mass, &vec![1.0; matrix.size()], 30).unwrap();
    assert_close(&found.values, &dense_eigenvalues(&matrix, &mass)[1..], 1e-5);
}

#[test]
fn an_eigenvalue_of_enormous_multiplicity_is_found_as_often_as_it_occurs() {
    // The Laplacian of the complete graph: n, n - 1 times.
    let size = 400;
    let mut triplets: Vec<_> = (0..size).map(|at| (at, at, (size - 1) as f64)).collect();
    triplets.extend((0..size).flat_map(|row| (0..row).map(move |column| (row, column, -1.0))));
    let matrix = SymmetricMatrix::from_triplets(size, &triplets).unwrap();
    let found = solve(&matrix, &vec![1.0; size], &vec![1.0; size], 50).unwrap();
    assert_close(&found.values, &[size as f64; 50], 1e-10);
    assert_eigenpairs(&matrix, &vec![1.0; size], &found);
}

#[test]
fn components_have_one_null_vector_each_handed_in_or_not() {
    let half = torus(24, 14, |u| u);
    let vertices = half.vertices.len();
    let (matrix, mass) = laplacian(&both(torus(24, 14, |u| u), &half));
    let size = matrix.size();
    let mut null_space = vec![0.0; 2 * size];
    null_space[..vertices].fill(1.0);
    null_space[size + vertices..].fill(-3.0);
    let expected = dense_eigenvalues(&matrix, &mass);
    let found = solve(&matrix, &mass, &null_space, 40).unwrap();
    assert_close(&found.values, &expected[2..], 1e-9);
    assert_eigenpairs(&matrix, &mass, &found);
    // Only the constant is known: the other null vector is the first pair.
    let found = solve(&matrix, &mass, &vec![1.0; size], 41).unwrap();
    assert!(found.values[0].abs() < 1e-10);
    assert_close(&found.values[1..], &expected[2..], 1e-9);
    // Nothing is known.
    let found = solve(&matrix, &mass, &[], 42).unwrap();
    assert!(found.values[0].abs() < 1e-10 && found.values[1].abs() < 1e-10);
    assert_close(&found.values[2..], &expected[2..], 1e-9);
}

#[test]
fn any_number_of_pairs_can_be_asked_for() {
    let (matrix, mass) = laplacian(&sphere(3));
    let size = matrix.size();
    let expected = dense_eigenvalues(&matrix, &mass);
    let ones = vec![1.0; size];
    for pairs in [0, 1, 2, 9, size - 1] {
        let found = solve(&matrix, &mass, &ones, pairs).unwrap();
        assert_eq!((found.values.len(), found.vectors.len()), (pairs, pairs * size));
        assert_close(&found.values, &expected[1..], 1e-9);
    }
    assert_eq!(
        solve(&matrix, &mass, &ones, size).unwrap_err(),
        LinalgError::TooManyPairs { requested: size, available: size - 1 }
    );
    let single = SymmetricMatrix::from_triplets(1, &[(0, 0, 3.0)]).unwrap();
    assert_eq!(solve(&single, &[4.0], &[], 1).unwrap().values, [0.75]);
    let empty = SymmetricMatrix::from_triplets(0, &[]).unwrap();
    assert!(solve(&empty, &[], &[], 0).unwrap().values.is_empty());
    // A single pair of a problem that is large enough for the iteration.
    let (matrix, mass) = laplacian(&sphere(4));
    let found = solve(&matrix, &mass, &vec![1.0; matrix.size()], 1).unwrap();
    assert!((found.values[0] - 2.0).abs() < 0.02);
}

#[test]
fn the_order_of_the_vertices_does_not_matter() {
    let (matrix, mass) = laplacian(&torus(30, 16, |u| u + 0.02 * (9.0 * u).sin()));
    let order: Vec<usize> = (0..matrix.size()).map(|at| (at * 7) % matrix.size()).collect();
    let shuffled = matrix.principal_submatrix(&order).unwrap();
    let shuffled_mass: Vec<f64> = order.iter().map(|&at| mass[at]).collect();
    let ones = vec![1.0; matrix.size()];
    let expected = solve(&matrix, &mass, &ones, 50).unwrap();
    let found = solve(&shuffled, &shuffled_mass, &ones, 50).unwrap();
    assert_close(&found.values, &expected.values, 1e-11);
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let (matrix, mass) = laplacian(&sphere(5));
    let ones = vec![1.0; matrix.size()];
    let run = |threads| {
        let found = on_threads(threads, || solve(&matrix, &mass, &ones, 40)).unwrap();
        (bits(&found.values), bits(&found.vectors), bits(&found.residuals))
    };
    assert_eq!(run(1), run(2));
}

#[test]
fn progress_never_goes_back_and_can_cancel_at_every_report() {
    let (matrix, mass) = laplacian(&torus(30, 16, |u| u));
    let ones = vec![1.0; matrix.size()];
    let mut reports = Vec::new();
    smallest_eigenpairs(&matrix, &mass, &ones, 30, &mut |fraction| {
        reports.push(fraction);
        true
    })
    .unwrap();
    assert!(reports.len() > 10);
    assert!(reports.windows(2).all(|pair| pair[0] <= pair[1]));
    assert_eq!((reports[0], reports[reports.len() - 1]), (0.0, 1.0));
    for stop in 0..reports.len() {
        let mut count = 0;
        let result = smallest_eigenpairs(&matrix, &mass, &ones, 30, &mut |_| {
            count += 1;
            count <= stop
        });
        assert_eq!(result.unwrap_err(), LinalgError::Cancelled);
    }
}

#[test]
fn bad_input_is_named() {
    let (matrix, mass) = laplacian(&sphere(2));
    let size = matrix.size();
    let ones = vec![1.0; size];
    let with = |index: usize, value: f64| {
        let mut mass = mass.clone();
        mass[index] = value;
        solve(&matrix, &mass, &ones, 5).unwrap_err()
    };
    assert_eq!(with(3, 0.0), LinalgError::NonPositiveMass { index: 3, value: 0.0 });
    assert_eq!(with(4, -1.0), LinalgError::NonPositiveMass { index: 4, value: -1.0 });
    assert_eq!(with(5, f64::INFINITY), LinalgError::NonFinite { what: "mass", row: 5, column: 0 });
    assert_eq!(
        solve(&matrix, &mass[1..], &ones, 5).unwrap_err(),
        LinalgError::DimensionMismatch { what: "mass", expected: size, found: size - 1 }
    );
    assert!(matches!(
        solve(&matrix, &mass, &ones[1..], 5).unwrap_err(),
        LinalgError::DimensionMismatch { .. }
    ));
    let twice = vec![1.0; 2 * size];
    assert!(matches!(
        solve(&matrix, &mass, &twice, 5).unwrap_err(),
        LinalgError::NotANullVector { vector: 1, .. }
    ));
    let mut bump = ones.clone();
    bump[7] = 1.01;
    assert!(matches!(
        solve(&matrix, &mass, &bump, 5).unwrap_err(),
        LinalgError::NotANullVector { vector: 0, .. }
    ));
    assert!(matches!(
        solve(&matrix, &mass, &vec![0.0; size], 5).unwrap_err(),
        LinalgError::NotANullVector { .. }
    ));
    bump[7] = f64::NAN;
    assert_eq!(
        solve(&matrix, &mass, &bump, 5).unwrap_err(),
        LinalgError::NonFinite { what: "null space", row: 7, column: 0 }
    );
}

#[test]
fn an_indefinite_matrix_is_an_error() {
    let (matrix, mass) = laplacian(&sphere(4));
    let shifted = matrix.add_scaled_diagonal(-100.0, &mass).unwrap();
    assert!(matches!(solve(&shifted, &mass, &[], 5).unwrap_err(), LinalgError::NotPositiveDefinite { .. }));
}
