//! Small dense matrices: products, and the symmetric eigenproblem.
//!
//! One thread throughout, because the bits of faer's parallel algorithms depend on the number of
//! threads.

use faer::diag::Diag;
use faer::dyn_stack::MemStack;
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::error::LinalgError;
use super::symbolic::allocate;

/// All eigenvalues, ascending, and the orthonormal eigenvectors, column-major, of the symmetric
/// matrix `matrix` (column-major, size × size; the lower triangle counts).
///
/// # Errors
/// [`LinalgError::NoConvergence`], [`LinalgError::OutOfMemory`].
pub(super) fn symmetric_eigen(size: usize, matrix: &[f64]) -> Result<(Vec<f64>, Vec<f64>), LinalgError> {
    let mut vectors = zeros(size * size)?;
    if size == 0 {
        return Ok((Vec::new(), vectors));
    }
    // The solver's tolerances are absolute: it is handed entries of about 1, exactly rescaled.
    let largest = matrix.iter().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    let exponent = if largest.is_finite() { libm::frexp(largest).1 } else { 0 };
    let mut scaled = zeros(matrix.len())?;
    for (scaled, &value) in scaled.iter_mut().zip(matrix) {
        *scaled = libm::ldexp(value, -exponent);
    }
    let scratch =
        self_adjoint_evd_scratch::<f64>(size, ComputeEigenvectors::Yes, Par::Seq, Default::default());
    let mut memory = allocate(scratch, "dense eigenproblem")?;
    let mut values = Diag::<f64>::zeros(size);
    self_adjoint_evd(
        MatRef::from_column_major_slice(&scaled, size, size),
        values.as_mut(),
        Some(MatMut::from_column_major_slice_mut(&mut vectors, size, size)),
        Par::Seq,
        MemStack::new(&mut memory),
        Default::default(),
    )
    .map_err(|_| LinalgError::NoConvergence { size })?;
    let values = (0..size).map(|at| libm::ldexp(values[at], exponent)).collect();
    Ok((values, vectors))
}

/// A zeroed vector, with an error where the allocation would abort.
pub(super) fn zeros(length: usize) -> Result<Vec<f64>, LinalgError> {
    let mut values = Vec::new();
    values.try_reserve_exact(length).map_err(|_| LinalgError::OutOfMemory { what: "dense matrix" })?;
    values.resize(length, 0.0);
    Ok(values)
}

/// A dense column-major matrix.
#[derive(Debug, Clone)]
pub(super) struct Dense {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) values: Vec<f64>,
}

impl Dense {
    pub(super) fn zeros(rows: usize, columns: usize) -> Self {
        Self { rows, columns, values: vec![0.0; rows * columns] }
    }

    pub(super) fn view(&self) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(&self.values, self.rows, self.columns)
    }

    pub(super) fn view_mut(&mut self) -> MatMut<'_, f64> {
        MatMut::from_column_major_slice_mut(&mut self.values, self.rows, self.columns)
    }

    /// The first columns alone.
    pub(super) fn truncate(&mut self, columns: usize) {
        self.values.truncate(self.rows * columns);
        self.values.shrink_to_fit();
        self.columns = columns;
    }

    /// `self += factor · left · right`
    pub(super) fn add_product(&mut self, factor: f64, left: MatRef<'_, f64>, right: MatRef<'_, f64>) {
        matmul(self.view_mut(), Accum::Add, left, right, factor, Par::Seq);
    }

    /// Rows and columns `at` of a square matrix.
    pub(super) fn gather(&self, at: &[usize]) -> Self {
        let mut part = Vec::with_capacity(at.len() * at.len());
        for &column in at {
            let values = &self.values[column * self.rows..(column + 1) * self.rows];
            part.extend(at.iter().map(|&row| values[row]));
        }
        Self { rows: at.len(), columns: at.len(), values: part }
    }
}
