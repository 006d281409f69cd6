//! Diagonals of inverses against dense inverses and difference quotients.

use dermis::linalg::{
    Cholesky, LinalgError, SymbolicCholesky, SymmetricMatrix, diagonal_of_inverse,
    diagonal_of_inverse_mass_inverse,
};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

use crate::surfaces::{bits, both, dense, laplacian, noise, on_threads, patterns, sphere, torus};

fn factor(matrix: &SymmetricMatrix) -> Cholesky {
    Cholesky::factor(&SymbolicCholesky::new(matrix).unwrap(), matrix).unwrap()
}

/// Diagonals of A⁻¹ and of A⁻¹ M A⁻¹ by a dense inverse.
fn oracle(matrix: &SymmetricMatrix, mass: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let inverse = dense(matrix).cholesky().unwrap().inverse();
    let mass = DMatrix::from_diagonal(&DVector::from_column_slice(mass));
    let product = &inverse * mass * &inverse;
    (inverse.diagonal().as_slice().to_vec(), product.diagonal().as_slice().to_vec())
}

fn largest_relative_error(values: &[f64], expected: &[f64]) -> f64 {
    values
        .iter()
        .zip(expected)
        .map(|(value, expected)| ((value - expected) / expected).abs())
        .fold(0.0, f64::max)
}

#[test]
fn green_function_diagonals_match_a_dense_inverse() {
    // 1,024 vertices less one, spacing from 1 to 20.
    let (laplacian, mass) =
        laplacian(&torus(64, 16, |u| u + 0.15 * (2.0 * std::f64::consts::TAU * u).sin() / 2.0));
    let kept: Vec<usize> = (0..laplacian.size()).filter(|&vertex| vertex != 77).collect();
    let matrix = laplacian.principal_submatrix(&kept).unwrap();
    let mass: Vec<f64> = kept.iter().map(|&vertex| mass[vertex]).collect();
    let cholesky = factor(&matrix);
    let (inverse, product) = oracle(&matrix, &mass);
    assert!(largest_relative_error(&diagonal_of_inverse(&cholesky), &inverse) < 1e-10);
    let diagonal = diagonal_of_inverse_mass_inverse(&cholesky, &mass).unwrap();
    assert!(largest_relative_error(&diagonal, &product) < 1e-10);
}

#[test]
fn several_components_and_masses_of_either_sign_work() {
    let (laplacian, mass) = laplacian(&both(torus(14, 9, |u| u), &sphere(2)));
    let kept: Vec<usize> = (1..laplacian.size() - 1).collect();
    let matrix = laplacian.principal_submatrix(&kept).unwrap();
    let mass: Vec<f64> = kept.iter().map(|&vertex| mass[vertex] * noise(vertex)).collect();
    let (_, product) = oracle(&matrix, &mass);
    let diagonal = diagonal_of_inverse_mass_inverse(&factor(&matrix), &mass).unwrap();
    let scale = product.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    for (value, expected) in diagonal.iter().zip(&product) {
        assert!((value - expected).abs() < 1e-11 * scale);
    }
}

proptest! {
    #[test]
    fn random_patterns_match_a_dense_inverse(matrix in patterns()) {
        let mass: Vec<f64> = (0..matrix.size()).map(|at| 1.5 + noise(at)).collect();
        let (inverse, product) = oracle(&matrix, &mass);
        let cholesky = factor(&matrix);
        prop_assert!(largest_relative_error(&diagonal_of_inverse(&cholesky), &inverse) < 1e-10);
        let diagonal = diagonal_of_inverse_mass_inverse(&cholesky, &mass).unwrap();
        prop_assert!(largest_relative_error(&diagonal, &product) < 1e-10);
    }
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_threads() {
    let (laplacian, mass) = laplacian(&sphere(4));
    let matrix = laplacian.add_scaled_diagonal(0.3, &mass).unwrap();
    let run = || {
        let cholesky = factor(&matrix);
        (
            bits(&diagonal_of_inverse(&cholesky)),
            bits(&diagonal_of_inverse_mass_inverse(&cholesky, &mass).unwrap()),
        )
    };
    assert_eq!(on_threads(1, run), on_threads(2, run));
}

#[test]
fn bad_masses_are_errors() {
    let cholesky = factor(&SymmetricMatrix::from_triplets(2, &[(0, 0, 4.0), (1, 1, 2.0)]).unwrap());
    assert_eq!(diagonal_of_inverse(&cholesky), [0.25, 0.5]);
    assert_eq!(diagonal_of_inverse_mass_inverse(&cholesky, &[16.0, 4.0]), Ok(vec![1.0, 1.0]));
    assert_eq!(
        diagonal_of_inverse_mass_inverse(&cholesky, &[1.0]).unwrap_err(),
        LinalgError::DimensionMismatch { what: "mass", expected: 2, found: 1 }
    );
    assert_eq!(
        diagonal_of_inverse_mass_inverse(&cholesky, &[1.0, f64::NAN]).unwrap_err(),
        LinalgError::NonFinite { what: "mass", row: 1, column: 0 }
    );
    let empty = factor(&SymmetricMatrix::from_triplets(0, &[]).unwrap());
    assert!(diagonal_of_inverse(&empty).is_empty());
}
