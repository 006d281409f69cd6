//! Sparse Cholesky factorisation and counting of eigenvalues by inertia.
//!
//! The symbolic part is analysed once and shared. Factors are kept as `L D Lᵀ`, the square-root
//! free form, so that the same code serves indefinite matrices.

use rayon::prelude::*;

use super::error::LinalgError;
use super::lanes::{Lanes, WIDTH};
use super::ldl::LdlFactor;
use super::sparse::{SymmetricMatrix, check_length, check_masses};
pub use super::symbolic::SymbolicCholesky;

/// A pivot below this fraction of its diagonal entry is rounding noise of a singular matrix.
const DEFINITE: f64 = 64.0 * f64::EPSILON;

/// Largest growth of a row during elimination without pivoting that leaves the signs of the
/// pivots trustworthy. A definite matrix has a growth of one.
const GROWTH: f64 = 1e6;

/// Factor of a symmetric positive definite matrix.
#[derive(Debug, Clone)]
pub struct Cholesky {
    factor: LdlFactor,
}

impl Cholesky {
    /// Factors `matrix`, whose pattern must be the one that was analysed.
    ///
    /// # Errors
    /// [`LinalgError::PatternMismatch`], [`LinalgError::NotPositiveDefinite`] (also when the
    /// matrix is singular to working precision), [`LinalgError::OutOfMemory`].
    pub fn factor(symbolic: &SymbolicCholesky, matrix: &SymmetricMatrix) -> Result<Self, LinalgError> {
        let factor = LdlFactor::new(symbolic.inner(), matrix)?.map_err(|breakdown| {
            LinalgError::NotPositiveDefinite { column: breakdown.column, pivot: breakdown.pivot }
        })?;
        let diagonal = matrix.diagonal();
        for (&column, pivot) in symbolic.inner().original.iter().zip(factor.pivots()) {
            if pivot <= DEFINITE * diagonal[column].abs() {
                return Err(LinalgError::NotPositiveDefinite { column, pivot });
            }
        }
        Ok(Self { factor })
    }

    /// Size of the matrix.
    pub fn size(&self) -> usize {
        self.factor.symbolic().size()
    }

    /// Replaces right-hand sides by solutions of `A X = B`. `block` is a column-major
    /// n × `columns` matrix. A column's solution does not depend on the other columns.
    ///
    /// # Errors
    /// [`LinalgError::DimensionMismatch`], [`LinalgError::NonFinite`]; `block` is unchanged.
    pub fn solve_in_place(&self, block: &mut [f64], columns: usize) -> Result<(), LinalgError> {
        let size = self.size();
        check_length("right-hand sides", size * columns, block.len())?;
        if let Some(at) = block.iter().position(|value| !value.is_finite()) {
            return Err(LinalgError::NonFinite {
                what: "right-hand side",
                row: at % size,
                column: at / size,
            });
        }
        if size == 0 {
            return Ok(());
        }
        let original = &self.factor.symbolic().original;
        block.par_chunks_mut(size * WIDTH).for_each(|vectors| {
            let mut rows = vec![Lanes::ZERO; size];
            for (lane, vector) in vectors.chunks_exact(size).enumerate() {
                for (row, &index) in rows.iter_mut().zip(original) {
                    row[lane] = vector[index];
                }
            }
            self.factor.solve(&mut rows);
            for (lane, vector) in vectors.chunks_exact_mut(size).enumerate() {
                for (row, &index) in rows.iter().zip(original) {
                    vector[index] = row[lane];
                }
            }
        });
        Ok(())
    }

    pub(super) fn ldl(&self) -> &LdlFactor {
        &self.factor
    }
}

/// Number of eigenvalues λ of `A x = λ M x` below `shift`, M being the diagonal matrix `mass`
/// with positive entries: by Sylvester's law of inertia, the number of negative pivots of
/// `A − shift · M`.
///
/// # Errors
/// [`LinalgError::VanishingPivot`] when elimination without pivoting comes so close to a zero
/// pivot that the count cannot be trusted: ask again with a slightly different shift. Besides,
/// [`LinalgError::PatternMismatch`], [`LinalgError::DimensionMismatch`],
/// [`LinalgError::NonFinite`], [`LinalgError::NonPositiveMass`], [`LinalgError::OutOfMemory`].
pub fn negative_eigenvalue_count(
    symbolic: &SymbolicCholesky,
    matrix: &SymmetricMatrix,
    mass: &[f64],
    shift: f64,
) -> Result<usize, LinalgError> {
    check_length("mass", matrix.size(), mass.len())?;
    check_masses(mass)?;
    let shifted = matrix.add_scaled_diagonal(-shift, mass)?;
    let factor = factor_indefinite(symbolic, &shifted, shift)?;
    Ok(negative_pivots(&factor))
}

/// Factors an indefinite matrix; an error unless the factor is stable.
pub(super) fn factor_indefinite(
    symbolic: &SymbolicCholesky,
    shifted: &SymmetricMatrix,
    shift: f64,
) -> Result<LdlFactor, LinalgError> {
    let factor = LdlFactor::new(symbolic.inner(), shifted)?
        .map_err(|breakdown| LinalgError::VanishingPivot { column: breakdown.column, shift })?;
    // The rounding errors of row i amount to those of a matrix with diagonal (|L| |D| |L|ᵀ)_ii.
    let largest = |column| {
        let (_, values) = shifted.column(column);
        values.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()))
    };
    for (&column, size) in symbolic.inner().original.iter().zip(factor.row_sizes()) {
        if size.is_nan() || size > GROWTH * largest(column) {
            return Err(LinalgError::VanishingPivot { column, shift });
        }
    }
    Ok(factor)
}

/// Number of negative pivots.
pub(super) fn negative_pivots(factor: &LdlFactor) -> usize {
    factor.pivots().filter(|pivot| *pivot < 0.0).count()
}
