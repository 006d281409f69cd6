//! Kernels of the triangular solves: one pass over a list of supernodes, eight right-hand sides.

use faer::traits::pulp::{Simd, WithSimd};

use super::lanes::Lanes;
use super::ldl::LdlFactor;

/// Columns of L that are applied in one sweep over the rows.
const STRIP: usize = 4;

/// Solves `L D y = b` for `supernodes` in ascending order.
///
/// `own` holds the rows from `start` on. What the supernodes subtract from rows beyond `own` is
/// added (negated) to `outside`, at the places given by the schedule.
pub(super) struct Forward<'a, I> {
    pub(super) factor: &'a LdlFactor,
    pub(super) supernodes: I,
    pub(super) own: &'a mut [Lanes],
    pub(super) start: usize,
    pub(super) outside: &'a mut [Lanes],
}

/// Solves `Lᵀ x = y` for `supernodes` in descending order, with the rows beyond `own` known.
pub(super) struct Backward<'a, I> {
    pub(super) factor: &'a LdlFactor,
    pub(super) supernodes: I,
    pub(super) own: &'a mut [Lanes],
    pub(super) start: usize,
    pub(super) outside: &'a [Lanes],
}

impl<I: Iterator<Item = usize>> WithSimd for Forward<'_, I> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let symbolic = self.factor.symbolic();
        let mut sums = Vec::new();
        let end = self.start + self.own.len();
        for supernode in self.supernodes {
            let columns = symbolic.columns(supernode);
            let rows = symbolic.rows(supernode);
            let values = self.factor.supernode(supernode);
            let top = &mut self.own[columns.start - self.start..columns.end - self.start];
            let height = top.len() + rows.len();
            solve_unit_lower(simd, values, height, top);
            sums.clear();
            sums.resize(rows.len(), Lanes::ZERO);
            multiply_below(simd, values, height, top, &mut sums);
            // The diagonal is in the cache now; on the way back each entry would be waited for.
            for (at, row) in top.iter_mut().enumerate() {
                row.scale(1.0 / values[at * (height + 1)]);
            }
            let inside = rows.partition_point(|&row| row < end);
            for (&row, sum) in rows[..inside].iter().zip(&sums) {
                self.own[row - self.start].subtract(simd, sum);
            }
            if inside < rows.len() {
                let offset = symbolic.supernodes.col_ptr_for_row_idx()[supernode];
                let positions = &symbolic.schedule.outside_position[offset + inside..offset + rows.len()];
                for (&position, sum) in positions.iter().zip(&sums[inside..]) {
                    self.outside[position as usize].subtract(simd, sum);
                }
            }
        }
    }
}

impl<I: Iterator<Item = usize>> WithSimd for Backward<'_, I> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let symbolic = self.factor.symbolic();
        let mut below = Vec::new();
        let end = self.start + self.own.len();
        for supernode in self.supernodes {
            let columns = symbolic.columns(supernode);
            let rows = symbolic.rows(supernode);
            let values = self.factor.supernode(supernode);
            let inside = rows.partition_point(|&row| row < end);
            below.clear();
            below.extend(rows[..inside].iter().map(|&row| self.own[row - self.start]));
            if inside < rows.len() {
                let offset = symbolic.supernodes.col_ptr_for_row_idx()[supernode];
                let positions = &symbolic.schedule.outside_position[offset + inside..offset + rows.len()];
                below.extend(positions.iter().map(|&position| self.outside[position as usize]));
            }
            let top = &mut self.own[columns.start - self.start..columns.end - self.start];
            let height = top.len() + rows.len();
            multiply_below_transposed(simd, values, height, top, &below);
            solve_unit_lower_transposed(simd, values, height, top);
        }
    }
}

/// `top ← L₁₁⁻¹ top` for the unit lower triangle L₁₁ of a supernode.
#[inline(always)]
fn solve_unit_lower<S: Simd>(simd: S, values: &[f64], height: usize, top: &mut [Lanes]) {
    let width = top.len();
    for column in 0..width {
        let (done, rest) = top.split_at_mut(column + 1);
        let value = done[column];
        let factors = &values[column * height + column + 1..column * height + width];
        for (row, factor) in rest.iter_mut().zip(factors) {
            row.add_scaled(simd, -factor, &value);
        }
    }
}

/// `top ← L₁₁⁻ᵀ top`.
#[inline(always)]
fn solve_unit_lower_transposed<S: Simd>(simd: S, values: &[f64], height: usize, top: &mut [Lanes]) {
    let width = top.len();
    for column in (0..width).rev() {
        let (head, rest) = top.split_at_mut(column + 1);
        let factors = &values[column * height + column + 1..column * height + width];
        let mut sum = head[column];
        for (row, factor) in rest.iter().zip(factors) {
            sum.add_scaled(simd, -factor, row);
        }
        head[column] = sum;
    }
}

/// `sums ← sums + L₂₁ top`.
#[inline(always)]
fn multiply_below<S: Simd>(simd: S, values: &[f64], height: usize, top: &[Lanes], sums: &mut [Lanes]) {
    let width = top.len();
    let below = |column: usize| &values[column * height + width..][..height - width];
    let mut strips = top.chunks_exact(STRIP);
    let mut column = 0;
    for strip in &mut strips {
        let (fa, fb, fc, fd) = (below(column), below(column + 1), below(column + 2), below(column + 3));
        for ((((sum, fa), fb), fc), fd) in sums.iter_mut().zip(fa).zip(fb).zip(fc).zip(fd) {
            let mut next = *sum;
            next.add_scaled(simd, *fa, &strip[0]);
            next.add_scaled(simd, *fb, &strip[1]);
            next.add_scaled(simd, *fc, &strip[2]);
            next.add_scaled(simd, *fd, &strip[3]);
            *sum = next;
        }
        column += STRIP;
    }
    for row in strips.remainder() {
        for (sum, factor) in sums.iter_mut().zip(below(column)) {
            sum.add_scaled(simd, *factor, row);
        }
        column += 1;
    }
}

/// `top ← top − L₂₁ᵀ rows`.
#[inline(always)]
fn multiply_below_transposed<S: Simd>(
    simd: S,
    values: &[f64],
    height: usize,
    top: &mut [Lanes],
    rows: &[Lanes],
) {
    let width = top.len();
    let below = |column: usize| &values[column * height + width..][..height - width];
    let mut strips = top.chunks_exact_mut(STRIP);
    let mut column = 0;
    for strip in &mut strips {
        let mut sums = [Lanes::ZERO; STRIP];
        let (fa, fb, fc, fd) = (below(column), below(column + 1), below(column + 2), below(column + 3));
        for ((((row, fa), fb), fc), fd) in rows.iter().zip(fa).zip(fb).zip(fc).zip(fd) {
            sums[0].add_scaled(simd, *fa, row);
            sums[1].add_scaled(simd, *fb, row);
            sums[2].add_scaled(simd, *fc, row);
            sums[3].add_scaled(simd, *fd, row);
        }
        for (target, sum) in strip.iter_mut().zip(&sums) {
            target.subtract(simd, sum);
        }
        column += STRIP;
    }
    for target in strips.into_remainder() {
        let mut sum = Lanes::ZERO;
        for (row, factor) in rows.iter().zip(below(column)) {
            sum.add_scaled(simd, *factor, row);
        }
        target.subtract(simd, &sum);
        column += 1;
    }
}
