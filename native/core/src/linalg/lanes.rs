//! Eight vectors side by side.
//!
//! Everything that touches a sparse factor or a tall basis works on eight vectors at once, stored
//! row by row: one row fills one cache line, so that scattered rows cost one access each and
//! loops over a row vectorise. Within a row no lane ever mixes with another, therefore a vector
//! gets the same bits whatever its neighbours are.

use std::ops::{Index, IndexMut};

use faer::traits::pulp::{Arch, Simd, WithSimd};

/// Number of vectors in one block.
pub(super) const WIDTH: usize = 8;

/// One row of eight vectors.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C, align(64))]
pub(super) struct Lanes(pub(super) [f64; WIDTH]);

/// Eight vectors of length n: n rows.
pub(super) type Block = Vec<Lanes>;

/// Product of two blocks: entry `[a][b]` belongs to vector a of the left and b of the right one.
pub(super) type Coupling = [Lanes; WIDTH];

/// A coupling of zeros.
pub(super) const NO_COUPLING: Coupling = [Lanes::ZERO; WIDTH];

impl Lanes {
    pub(super) const ZERO: Self = Self([0.0; WIDTH]);

    /// `self += factor · other`
    #[inline(always)]
    pub(super) fn add_scaled<S: Simd>(&mut self, simd: S, factor: f64, other: &Self) {
        let factor = simd.splat_f64s(factor);
        let (own, _) = S::as_mut_simd_f64s(&mut self.0);
        let (other, _) = S::as_simd_f64s(&other.0);
        for (own, other) in own.iter_mut().zip(other) {
            *own = simd.mul_add_e_f64s(factor, *other, *own);
        }
    }

    /// `self -= other`
    #[inline(always)]
    pub(super) fn subtract<S: Simd>(&mut self, simd: S, other: &Self) {
        let (own, _) = S::as_mut_simd_f64s(&mut self.0);
        let (other, _) = S::as_simd_f64s(&other.0);
        for (own, other) in own.iter_mut().zip(other) {
            *own = simd.sub_f64s(*own, *other);
        }
    }

    /// `self += other`
    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self) {
        for (own, other) in self.0.iter_mut().zip(&other.0) {
            *own += other;
        }
    }

    /// `self -= factor · other`
    #[inline(always)]
    pub(super) fn subtract_scaled(&mut self, factor: f64, other: &Self) {
        for (own, other) in self.0.iter_mut().zip(&other.0) {
            *own -= factor * other;
        }
    }

    /// `self *= factor`
    #[inline(always)]
    pub(super) fn scale(&mut self, factor: f64) {
        for own in &mut self.0 {
            *own *= factor;
        }
    }
}

impl Index<usize> for Lanes {
    type Output = f64;
    #[inline(always)]
    fn index(&self, lane: usize) -> &f64 {
        &self.0[lane]
    }
}

impl IndexMut<usize> for Lanes {
    #[inline(always)]
    fn index_mut(&mut self, lane: usize) -> &mut f64 {
        &mut self.0[lane]
    }
}

/// Runs a kernel with the widest vector instructions of this machine.
#[inline]
pub(super) fn vectorized<K: WithSimd>(kernel: K) -> K::Output {
    Arch::new().dispatch(kernel)
}
