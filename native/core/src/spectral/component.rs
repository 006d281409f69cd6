//! Biharmonic distance on one connected piece of a surface, exactly.
//!
//! With the stiffness matrix K and lumped areas M, let u solve K u = e_x − e_y with area mean 0.
//! Then d(x, y)² = uᵀ M u (eq. 17–19 in matrix form). One vertex is grounded to make K
//! invertible; with A the inverse of the grounded K, m the areas and T their sum,
//! d(x, y)² = B_xx + B_yy − 2 B_xy where B = A (M − m mᵀ / T) A.

use std::sync::OnceLock;

use super::SpectralError;
use crate::linalg::{
    Cholesky, Eigenpairs, SymbolicCholesky, SymmetricMatrix, diagonal_of_inverse_mass_inverse,
    smallest_eigenpairs,
};

/// One connected piece: its operators, and what was computed from them so far.
pub(super) struct Component {
    stiffness: SymmetricMatrix,
    areas: Vec<f64>,
    grounded: OnceLock<Result<Grounded, SpectralError>>,
}

/// The factorised grounded operator and the diagonal of B; the last vertex is the grounded one,
/// whose row and column of A are zero.
struct Grounded {
    factor: Cholesky,
    diagonal: Vec<f64>,
}

impl Component {
    /// Takes the operators of a connected piece; every area is above zero.
    pub(super) fn new(stiffness: SymmetricMatrix, areas: Vec<f64>) -> Self {
        Self { stiffness, areas, grounded: OnceLock::new() }
    }

    pub(super) fn vertex_count(&self) -> usize {
        self.areas.len()
    }

    /// The smallest non-zero eigenpairs, at most as many as there are.
    pub(super) fn eigenpairs(
        &self,
        count: usize,
        report: &mut dyn FnMut(f64) -> bool,
    ) -> Result<Eigenpairs, SpectralError> {
        let count = count.min(self.vertex_count() - 1);
        let constant = vec![1.0; self.vertex_count()];
        Ok(smallest_eigenpairs(&self.stiffness, &self.areas, &constant, count, report)?)
    }

    /// Squared distances from every vertex of the piece to one of them.
    pub(super) fn squared_distances(&self, vertex: usize) -> Result<Vec<f64>, SpectralError> {
        let grounded = self.grounded()?;
        let mut column = vec![0.0; self.vertex_count()];
        column[vertex] = 1.0;
        self.apply_b(grounded, &mut column)?;
        let own = grounded.diagonal[vertex];
        let square = |(b_xy, b_xx): (&f64, &f64)| (b_xx + own - 2.0 * b_xy).max(0.0);
        let mut squares: Vec<f64> = column.iter().zip(&grounded.diagonal).map(square).collect();
        squares[vertex] = 0.0;
        Ok(squares)
    }

    /// Diagonal g(x, x) of the biharmonic Green's function (eq. 18), which has area mean 0 in
    /// either argument: B_xx − 2 (B m)_x / T + mᵀ B m / T².
    pub(super) fn green_diagonal(&self) -> Result<Vec<f64>, SpectralError> {
        let grounded = self.grounded()?;
        let total: f64 = self.areas.iter().sum();
        let mut b_m = self.areas.clone();
        self.apply_b(grounded, &mut b_m)?;
        let mean = b_m.iter().zip(&self.areas).map(|(b, m)| b * m).sum::<f64>() / (total * total);
        Ok(grounded.diagonal.iter().zip(&b_m).map(|(b_xx, b)| b_xx - 2.0 * b / total + mean).collect())
    }

    /// Multiplies a vector by B.
    fn apply_b(&self, grounded: &Grounded, vector: &mut [f64]) -> Result<(), SpectralError> {
        let Some((last, free)) = vector.split_last_mut() else {
            return Ok(());
        };
        *last = 0.0;
        if free.is_empty() {
            return Ok(());
        }
        let total: f64 = self.areas.iter().sum();
        grounded.factor.solve_in_place(free, 1)?;
        let mean = free.iter().zip(&self.areas).map(|(u, m)| u * m).sum::<f64>() / total;
        for (u, m) in free.iter_mut().zip(&self.areas) {
            *u = m * (*u - mean);
        }
        grounded.factor.solve_in_place(free, 1)?;
        Ok(())
    }

    fn grounded(&self) -> Result<&Grounded, SpectralError> {
        self.grounded.get_or_init(|| self.ground()).as_ref().map_err(Clone::clone)
    }

    fn ground(&self) -> Result<Grounded, SpectralError> {
        let free: Vec<usize> = (0..self.vertex_count() - 1).collect();
        let matrix = self.stiffness.principal_submatrix(&free)?;
        let areas = &self.areas[..free.len()];
        let factor = Cholesky::factor(&SymbolicCholesky::new(&matrix)?, &matrix)?;
        let mut diagonal = diagonal_of_inverse_mass_inverse(&factor, areas)?;
        let mut a_m = areas.to_vec();
        factor.solve_in_place(&mut a_m, 1)?;
        let total: f64 = self.areas.iter().sum();
        for (b, u) in diagonal.iter_mut().zip(&a_m) {
            *b -= u * u / total;
        }
        diagonal.push(0.0);
        Ok(Grounded { factor, diagonal })
    }
}
