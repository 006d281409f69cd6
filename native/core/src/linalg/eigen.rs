//! Smallest eigenpairs of `A x = λ M x`, with proof that none is missing.
//!
//! A is sparse, symmetric and positive semi-definite, M a positive diagonal. In the scaled
//! unknown y = M^½ x this is the ordinary problem of B = M^-½ A M^-½. Small problems, and those
//! that ask for a large part of the spectrum, are solved dense, the others by block Lanczos
//! iteration next to a shift. Three checks run every time: the residual of each pair, the
//! orthonormality of the vectors, and for the iteration the number of eigenvalues below a point
//! in the gap above the last pair, counted by Sylvester's law of inertia.

use rayon::prelude::*;

use super::dense::{symmetric_eigen, zeros};
use super::error::LinalgError;
use super::lanes::{Block, Lanes, WIDTH};
use super::sparse::{SymmetricMatrix, check_length, check_masses};
use super::tall::gram;

/// Largest accepted residual of a returned pair, relative to its eigenvalue.
const RESIDUAL_TOLERANCE: f64 = 1e-8;

/// Largest accepted deviation of the vectors' Gram matrix from the identity.
const ORTHONORMALITY_TOLERANCE: f64 = 1e-9;

/// Problems of this size or less are solved dense.
const DENSE_SIZE: usize = 320;

/// Eigenvalues in ascending order with mass-orthonormal eigenvectors.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigenpairs {
    /// The k eigenvalues.
    pub values: Vec<f64>,
    /// The eigenvectors x with `xᵀ M x = 1`, columns of a column-major n × k matrix.
    pub vectors: Vec<f64>,
    /// Norms of `M^-½ (A x − λ M x)`, relative to λ.
    pub residuals: Vec<f64>,
}

/// The `pairs` smallest eigenpairs of `A x = λ M x` besides those of the null space.
///
/// `mass` is the diagonal of M, `null_space` holds known vectors with `A v = 0` as columns of a
/// column-major matrix (for the Laplacian of a connected surface: one column of ones). They are
/// deflated exactly and not returned; null vectors that are not handed in are returned like
/// other pairs, with eigenvalues that are zero up to rounding. A repeated eigenvalue is returned as
/// often as it occurs.
///
/// `progress` gets the fraction done from time to time and stops the computation by returning
/// false.
///
/// # Errors
/// Bad input: [`LinalgError::DimensionMismatch`], [`LinalgError::NonFinite`],
/// [`LinalgError::NonPositiveMass`], [`LinalgError::NotANullVector`],
/// [`LinalgError::TooManyPairs`], [`LinalgError::NotPositiveDefinite`] or
/// [`LinalgError::NegativeEigenvalue`]. Failed checks: [`LinalgError::ResidualNotReached`],
/// [`LinalgError::NotOrthonormal`], [`LinalgError::MissingPairs`],
/// [`LinalgError::NoConvergence`]. Besides, [`LinalgError::OutOfMemory`] and
/// [`LinalgError::Cancelled`].
pub fn smallest_eigenpairs(
    matrix: &SymmetricMatrix,
    mass: &[f64],
    null_space: &[f64],
    pairs: usize,
    progress: &mut dyn FnMut(f64) -> bool,
) -> Result<Eigenpairs, LinalgError> {
    let size = matrix.size();
    check_length("mass", size, mass.len())?;
    check_masses(mass)?;
    let inverse_root: Vec<f64> = mass.iter().map(|mass| 1.0 / mass.sqrt()).collect();
    let scaled = matrix.scale_symmetrically(&inverse_root)?;
    let null = orthonormal_null_space(&scaled, mass, null_space)?;
    let available = size - null.len();
    if pairs > available {
        return Err(LinalgError::TooManyPairs { requested: pairs, available });
    }
    if pairs == 0 {
        return Ok(Eigenpairs { values: Vec::new(), vectors: Vec::new(), residuals: Vec::new() });
    }
    let mut progress = Progress::new(progress);
    progress.report(0.0)?;
    let problem = Problem { matrix: &scaled, null, area: mass.iter().sum() };
    let sparse = if size <= DENSE_SIZE || pairs > size / 4 {
        None
    } else {
        problem.solve_sparse(pairs, None, &mut progress)?
    };
    let (values, vectors) = match sparse {
        Some(solution) => solution,
        None => problem.solve_dense(pairs)?,
    };
    progress.report(0.97)?;
    let residuals = check(&scaled, &values, &vectors)?;
    let unscaled = unpack(&vectors, pairs, &inverse_root);
    progress.report(1.0)?;
    Ok(Eigenpairs { values, vectors: unscaled, residuals })
}

/// A progress callback whose fractions never go back.
pub(super) struct Progress<'a> {
    callback: &'a mut dyn FnMut(f64) -> bool,
    furthest: f64,
}

impl<'a> Progress<'a> {
    pub(super) fn new(callback: &'a mut dyn FnMut(f64) -> bool) -> Self {
        Self { callback, furthest: 0.0 }
    }

    pub(super) fn report(&mut self, fraction: f64) -> Result<(), LinalgError> {
        self.furthest = self.furthest.max(fraction);
        if (self.callback)(self.furthest) { Ok(()) } else { Err(LinalgError::Cancelled) }
    }
}

/// The scaled problem: eigenpairs of `matrix` orthogonal to `null`.
pub(super) struct Problem<'a> {
    pub(super) matrix: &'a SymmetricMatrix,
    pub(super) null: Vec<Vec<f64>>,
    /// The trace of M: the area of a surface.
    pub(super) area: f64,
}

/// Eigenvalues and eigenvectors in blocks of eight, rows in the matrix's order.
pub(super) type Solution = (Vec<f64>, Vec<Block>);

impl Problem<'_> {
    /// All eigenpairs by a dense solver; the null space is moved above the spectrum.
    fn solve_dense(&self, pairs: usize) -> Result<Solution, LinalgError> {
        let size = self.matrix.size();
        let mut dense = zeros(size * size)?;
        let mut largest = 0.0_f64;
        for column in 0..size {
            let (rows, values) = self.matrix.column(column);
            for (&row, &value) in rows.iter().zip(values) {
                dense[column * size + row] = value;
            }
            largest = largest.max(values.iter().map(|value| value.abs()).sum());
        }
        let lift = if largest > 0.0 { 2.0 * largest } else { 1.0 };
        for null in &self.null {
            for column in 0..size {
                let factor = lift * null[column];
                for (row, value) in null.iter().enumerate() {
                    dense[column * size + row] += factor * value;
                }
            }
        }
        let (mut values, vectors) = symmetric_eigen(size, &dense)?;
        values.truncate(pairs);
        let blocks = (0..pairs.div_ceil(WIDTH))
            .map(|block| {
                let mut rows = vec![Lanes::ZERO; size];
                for lane in 0..WIDTH.min(pairs - block * WIDTH) {
                    let column = block * WIDTH + lane;
                    for (row, value) in rows.iter_mut().zip(&vectors[column * size..][..size]) {
                        row[lane] = *value;
                    }
                }
                rows
            })
            .collect();
        Ok((values, blocks))
    }
}

/// M-orthonormal basis of the null space, scaled by M^½, after checking that it is one.
fn orthonormal_null_space(
    scaled: &SymmetricMatrix,
    mass: &[f64],
    null_space: &[f64],
) -> Result<Vec<Vec<f64>>, LinalgError> {
    let size = scaled.size();
    let count = null_space.len().checked_div(size).unwrap_or(0);
    check_length("null space", size * count, null_space.len())?;
    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(count);
    for vector in 0..count {
        let given = &null_space[vector * size..(vector + 1) * size];
        if let Some(row) = given.iter().position(|value| !value.is_finite()) {
            return Err(LinalgError::NonFinite { what: "null space", row, column: vector });
        }
        let mut y: Vec<f64> = given.iter().zip(mass).map(|(value, mass)| value * mass.sqrt()).collect();
        let before = dot(&y, &y).sqrt();
        for _ in 0..2 {
            for other in &basis {
                let overlap = dot(&y, other);
                for (value, other) in y.iter_mut().zip(other) {
                    *value -= overlap * other;
                }
            }
        }
        let norm = dot(&y, &y).sqrt();
        if norm.is_nan() || norm <= 1e-10 * before {
            return Err(LinalgError::NotANullVector { vector, residual: norm / before });
        }
        for value in &mut y {
            *value /= norm;
        }
        let image = scaled.mul_vec(&y)?;
        let size_of_terms = rounding_scale(scaled, &y);
        let residual = dot(&image, &image).sqrt() / size_of_terms;
        if residual > 1e-9 {
            return Err(LinalgError::NotANullVector { vector, residual });
        }
        basis.push(y);
    }
    Ok(basis)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Norm of |B| |y|: what the terms of `B y` amount to before they cancel.
fn rounding_scale(matrix: &SymmetricMatrix, vector: &[f64]) -> f64 {
    (0..matrix.size())
        .map(|row| {
            let (columns, values) = matrix.column(row);
            let sum: f64 =
                columns.iter().zip(values).map(|(&column, value)| (value * vector[column]).abs()).sum();
            sum * sum
        })
        .sum::<f64>()
        .sqrt()
}

/// Checks residuals and orthonormality; returns the relative residuals.
fn check(matrix: &SymmetricMatrix, values: &[f64], vectors: &[Block]) -> Result<Vec<f64>, LinalgError> {
    let squares: Vec<(Lanes, Lanes)> = vectors
        .par_iter()
        .enumerate()
        .map(|(block, rows)| {
            let (mut residual, mut terms) = (Lanes::ZERO, Lanes::ZERO);
            let mut shifts = Lanes::ZERO;
            for (lane, value) in values[block * WIDTH..].iter().take(WIDTH).enumerate() {
                shifts[lane] = *value;
            }
            for (row, own) in rows.iter().enumerate() {
                let (columns, entries) = matrix.column(row);
                let (mut sum, mut size) = (Lanes::ZERO, Lanes::ZERO);
                for (&column, entry) in columns.iter().zip(entries) {
                    for lane in 0..WIDTH {
                        let term = entry * rows[column].0[lane];
                        sum.0[lane] += term;
                        size.0[lane] += term.abs();
                    }
                }
                for lane in 0..WIDTH {
                    let difference = sum.0[lane] - shifts.0[lane] * own.0[lane];
                    residual.0[lane] += difference * difference;
                    terms.0[lane] += size.0[lane] * size.0[lane];
                }
            }
            (residual, terms)
        })
        .collect();
    let mut residuals = Vec::with_capacity(values.len());
    for (pair, &value) in values.iter().enumerate() {
        let (residual, terms) = &squares[pair / WIDTH];
        let residual = residual[pair % WIDTH].sqrt();
        // What rounding alone makes of the product, on a matrix with tiny or thin triangles.
        let rounding = 16.0 * f64::EPSILON * terms[pair % WIDTH].sqrt();
        if value < -4.0 * rounding {
            return Err(LinalgError::NegativeEigenvalue { pair, value });
        }
        if residual.is_nan() || residual > RESIDUAL_TOLERANCE * value.abs() + rounding {
            return Err(LinalgError::ResidualNotReached {
                pair,
                residual: residual / value.abs(),
                tolerance: RESIDUAL_TOLERANCE,
            });
        }
        residuals.push(residual / value.abs());
    }
    let products = gram(vectors);
    for second in 0..values.len() {
        for first in 0..=second {
            let (left, right) = (first / WIDTH, second / WIDTH);
            let product = products[right * (right + 1) / 2 + left][first % WIDTH][second % WIDTH];
            let deviation = (product - f64::from(u8::from(first == second))).abs();
            if deviation.is_nan() || deviation > ORTHONORMALITY_TOLERANCE {
                return Err(LinalgError::NotOrthonormal { first, second, deviation });
            }
        }
    }
    Ok(residuals)
}

/// Column-major vectors `x = M^-½ y`.
fn unpack(blocks: &[Block], pairs: usize, inverse_root: &[f64]) -> Vec<f64> {
    let size = inverse_root.len();
    let mut vectors = vec![0.0; size * pairs];
    vectors.par_chunks_mut(size).enumerate().for_each(|(pair, vector)| {
        let rows = &blocks[pair / WIDTH];
        for ((out, row), factor) in vector.iter_mut().zip(rows).zip(inverse_root) {
            *out = row[pair % WIDTH] * factor;
        }
    });
    vectors
}
