//! Sparse factorisation `P A Pᵀ = L D Lᵀ` with unit lower triangular L and diagonal D, without
//! pivoting, and triangular solves with eight right-hand sides at once.

use std::sync::Arc;

use faer::Par;
use faer::dyn_stack::MemStack;
use faer::linalg::cholesky::ldlt::factor::{LdltError, LdltRegularization};
use faer::sparse::linalg::cholesky::supernodal;
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use rayon::prelude::*;

use super::error::LinalgError;
use super::lanes::{Block, Lanes, vectorized};
use super::sparse::SymmetricMatrix;
use super::symbolic::{Subtree, Symbolic, allocate};
use super::triangular::{Backward, Forward};

/// Values of L and D in the layout of the supernodes: each one is a column-major matrix of its
/// columns' rows followed by the rows below, with D on the diagonal.
#[derive(Debug, Clone)]
pub(super) struct LdlFactor {
    symbolic: Arc<Symbolic>,
    values: Vec<f64>,
}

/// A pivot was exactly zero, or the factor overflowed.
pub(super) struct Breakdown {
    /// Column of the input matrix.
    pub(super) column: usize,
    pub(super) pivot: f64,
}

impl LdlFactor {
    /// Factors a matrix with the analysed pattern. The inner result is an error when elimination
    /// breaks down.
    pub(super) fn new(
        symbolic: &Arc<Symbolic>,
        matrix: &SymmetricMatrix,
    ) -> Result<Result<Self, Breakdown>, LinalgError> {
        const WHAT: &str = "sparse factorisation";
        symbolic.check_pattern(matrix)?;
        let size = symbolic.size();
        let mut values: Vec<f64> = Vec::new();
        let entries = symbolic.supernodes.len_val();
        values.try_reserve_exact(entries).map_err(|_| LinalgError::OutOfMemory { what: WHAT })?;
        values.resize(entries, 0.0);
        let lower: Vec<f64> = symbolic.lower_source.iter().map(|&at| matrix.values()[at]).collect();
        let lower = SparseColMatRef::new(
            SymbolicSparseColMatRef::new_checked(
                size,
                size,
                &symbolic.lower_starts,
                None,
                &symbolic.lower_rows,
            ),
            &lower,
        );
        let scratch = supernodal::factorize_supernodal_numeric_ldlt_scratch::<usize, f64>(
            &symbolic.supernodes,
            Par::Seq,
            Default::default(),
        );
        let mut memory = allocate(scratch, WHAT)?;
        let outcome = supernodal::factorize_supernodal_numeric_ldlt(
            &mut values,
            lower,
            LdltRegularization::default(),
            &symbolic.supernodes,
            // A parallel elimination would add in an order that depends on the threads.
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        );
        if let Err(LdltError::ZeroPivot { index }) = outcome {
            return Ok(Err(Breakdown { column: symbolic.original[index], pivot: 0.0 }));
        }
        let factor = Self { symbolic: Arc::clone(symbolic), values };
        for (column, pivot) in factor.pivots().enumerate() {
            if !pivot.is_finite() || pivot == 0.0 {
                return Ok(Err(Breakdown { column: symbolic.original[column], pivot }));
            }
        }
        Ok(Ok(factor))
    }

    pub(super) fn symbolic(&self) -> &Arc<Symbolic> {
        &self.symbolic
    }

    /// Values of one supernode: column-major, its columns' rows first, D on the diagonal.
    #[inline]
    pub(super) fn supernode(&self, supernode: usize) -> &[f64] {
        &self.values[self.symbolic.values(supernode)]
    }

    /// The diagonal of D, in permuted order.
    pub(super) fn pivots(&self) -> impl Iterator<Item = f64> + '_ {
        (0..self.symbolic.supernodes.n_supernodes()).flat_map(move |supernode| {
            let width = self.symbolic.columns(supernode).len();
            let height = width + self.symbolic.rows(supernode).len();
            let values = self.supernode(supernode);
            (0..width).map(move |at| values[at * (height + 1)])
        })
    }

    /// The diagonal of |L| |D| |L|ᵀ, in permuted order.
    pub(super) fn row_sizes(&self) -> Vec<f64> {
        let mut sizes = vec![0.0; self.symbolic.size()];
        for supernode in 0..self.symbolic.supernodes.n_supernodes() {
            let columns = self.symbolic.columns(supernode);
            let rows = self.symbolic.rows(supernode);
            let height = columns.len() + rows.len();
            for (at, values) in self.supernode(supernode).chunks_exact(height).enumerate() {
                let pivot = values[at].abs();
                sizes[columns.start + at] += pivot;
                let below = (columns.start + at + 1..columns.end).chain(rows.iter().copied());
                for (row, value) in below.zip(&values[at + 1..]) {
                    sizes[row] += value * value * pivot;
                }
            }
        }
        sizes
    }

    /// Applies the inverse to eight vectors; rows are in permuted order.
    pub(super) fn solve(&self, block: &mut [Lanes]) {
        let owed = self.subtrees(block, |mut part| part.forward());
        let known = self.solve_top(block, &owed);
        self.subtrees(block, |mut part| part.backward(&known[part.at]));
    }

    /// `X (X − root) block` for the inverse X of the matrix; rows are in permuted order.
    pub(super) fn solve_twice(&self, block: &[Lanes], root: f64) -> Block {
        let mut image = block.to_vec();
        let owed = self.subtrees(&mut image, |mut part| part.forward());
        let known = self.solve_top(&mut image, &owed);
        let top = self.symbolic.schedule.top.iter().flat_map(|&supernode| self.symbolic.columns(supernode));
        top.for_each(|row| image[row].subtract_scaled(root, &block[row]));
        // The second solve begins where the first one ends, while the factor is in the cache.
        let owed = self.subtrees(&mut image, |mut part| {
            part.backward(&known[part.at]);
            for (row, before) in part.own.iter_mut().zip(&block[part.subtree.columns.clone()]) {
                row.subtract_scaled(root, before);
            }
            part.forward()
        });
        let known = self.solve_top(&mut image, &owed);
        self.subtrees(&mut image, |mut part| part.backward(&known[part.at]));
        image
    }

    /// Both passes over the supernodes above the subtrees. Takes what each subtree owes to the
    /// rows above it, and returns the solution there.
    fn solve_top(&self, block: &mut [Lanes], owed: &[Block]) -> Vec<Block> {
        let schedule = &self.symbolic.schedule;
        // In the fixed order of the subtrees.
        for (subtree, owed) in schedule.subtrees.iter().zip(owed) {
            for (&row, owed) in subtree.outside.iter().zip(owed) {
                block[row].add(owed);
            }
        }
        let top = schedule.top.iter().copied();
        vectorized(Forward { factor: self, supernodes: top.clone(), own: block, start: 0, outside: &mut [] });
        vectorized(Backward { factor: self, supernodes: top.rev(), own: block, start: 0, outside: &[] });
        let solution = |subtree: &Subtree| subtree.outside.iter().map(|&row| block[row]).collect();
        schedule.subtrees.iter().map(solution).collect()
    }

    /// Runs `work` on every subtree and its rows, side by side.
    fn subtrees<T: Send>(&self, block: &mut [Lanes], work: impl Fn(Part) -> T + Send + Sync) -> Vec<T> {
        let mut rest = block;
        let mut start = 0;
        let mut parts = Vec::with_capacity(self.symbolic.schedule.subtrees.len());
        for (at, subtree) in self.symbolic.schedule.subtrees.iter().enumerate() {
            let (_, tail) = rest.split_at_mut(subtree.columns.start - start);
            let (own, tail) = tail.split_at_mut(subtree.columns.len());
            rest = tail;
            start = subtree.columns.end;
            parts.push(Part { factor: self, subtree, own, at });
        }
        parts.into_par_iter().map(work).collect()
    }
}

/// The rows of one subtree.
struct Part<'a> {
    factor: &'a LdlFactor,
    subtree: &'a Subtree,
    own: &'a mut [Lanes],
    /// Index of the subtree.
    at: usize,
}

impl Part<'_> {
    /// Solves with L D; returns what the subtree owes to the rows above it.
    fn forward(&mut self) -> Block {
        let mut owed = vec![Lanes::ZERO; self.subtree.outside.len()];
        vectorized(Forward {
            factor: self.factor,
            supernodes: self.subtree.supernodes.clone(),
            own: self.own,
            start: self.subtree.columns.start,
            outside: &mut owed,
        });
        owed
    }

    /// Solves with Lᵀ, given the solution in the rows above.
    fn backward(&mut self, known: &[Lanes]) {
        vectorized(Backward {
            factor: self.factor,
            supernodes: self.subtree.supernodes.clone().rev(),
            own: self.own,
            start: self.subtree.columns.start,
            outside: known,
        });
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::random::SplitMix64;
    use super::super::symbolic::SymbolicCholesky;
    use super::*;

    #[test]
    fn two_solves_at_once_are_two_solves() {
        // Wide enough for several subtrees and rows above them.
        let side = 40;
        let at = |x: usize, y: usize| y * side + x;
        let mut triplets = Vec::new();
        for y in 0..side {
            for x in 0..side {
                triplets.push((at(x, y), at(x, y), 4.1));
                if x > 0 {
                    triplets.push((at(x, y), at(x - 1, y), -1.0));
                }
                if y > 0 {
                    triplets.push((at(x, y), at(x, y - 1), -1.0));
                }
            }
        }
        let matrix = SymmetricMatrix::from_triplets(side * side, &triplets).unwrap();
        let symbolic = SymbolicCholesky::new(&matrix).unwrap();
        assert!(symbolic.inner().schedule.subtrees.len() > 1 && !symbolic.inner().schedule.top.is_empty());
        let Ok(factor) = LdlFactor::new(symbolic.inner(), &matrix).unwrap() else {
            panic!("the matrix is definite");
        };
        let mut random = SplitMix64::new(7);
        let block: Block = (0..side * side).map(|_| Lanes([0.0; 8].map(|_| random.uniform()))).collect();
        for root in [0.0, 0.3] {
            let mut expected = block.clone();
            factor.solve(&mut expected);
            for (row, before) in expected.iter_mut().zip(&block) {
                row.subtract_scaled(root, before);
            }
            factor.solve(&mut expected);
            assert_eq!(factor.solve_twice(&block, root), expected);
        }
    }
}
