//! Products of tall matrices, made of blocks of eight vectors.
//!
//! Rows are cut into chunks of fixed length. Sums over rows are formed per chunk and then added
//! in the order of the chunks, so the bits do not depend on the number of threads.

use faer::traits::pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::lanes::{Block, Coupling, Lanes, NO_COUPLING, WIDTH, vectorized};

/// Rows per chunk: a chunk of one block fits in the first-level cache of common processors.
const CHUNK: usize = 512;

/// What one sweep over the rows of a block does, in this order.
#[derive(Default)]
pub(super) struct Sweep<'a> {
    /// Multiplied from the right before anything else.
    pub(super) transform: Option<&'a Coupling>,
    /// Subtract `block · coupling` for each of these.
    pub(super) subtract: &'a [(&'a [Lanes], Coupling)],
    /// Form the products of these, transposed, with the result.
    pub(super) couple: &'a [&'a [Lanes]],
}

/// Applies a sweep to `block`. Returns the products that were asked for, and `blockᵀ block`.
pub(super) fn sweep(block: &mut [Lanes], sweep: &Sweep) -> (Vec<Coupling>, Coupling) {
    let partial: Vec<Vec<Coupling>> = block
        .par_chunks_mut(CHUNK)
        .enumerate()
        .map(|(chunk, rows)| vectorized(SweepChunk { start: chunk * CHUNK, rows, sweep }))
        .collect();
    let mut sums = vec![NO_COUPLING; sweep.couple.len() + 1];
    for partial in &partial {
        for (sum, partial) in sums.iter_mut().zip(partial) {
            for (sum, partial) in sum.iter_mut().zip(partial) {
                sum.add(partial);
            }
        }
    }
    let gram = sums.pop().unwrap_or(NO_COUPLING);
    (sums, gram)
}

/// `left ᵀ right` for every pair with `left ≤ right`, in the order (0, 0), (0, 1), (1, 1), …
pub(super) fn gram(blocks: &[Block]) -> Vec<Coupling> {
    let rows = blocks.first().map_or(0, Vec::len);
    let pairs = blocks.len() * (blocks.len() + 1) / 2;
    let partial: Vec<Vec<Coupling>> = (0..rows.div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| vectorized(GramChunk { rows: chunk * CHUNK..rows.min((chunk + 1) * CHUNK), blocks }))
        .collect();
    let mut sums = vec![NO_COUPLING; pairs];
    for partial in &partial {
        for (sum, partial) in sums.iter_mut().zip(partial) {
            for (sum, partial) in sum.iter_mut().zip(partial) {
                sum.add(partial);
            }
        }
    }
    sums
}

/// Linear combinations `Σ_i blocks[i] · couplings[o][i]` for every `o`.
pub(super) fn combine(blocks: &[&[Lanes]], couplings: &[Vec<Coupling>]) -> Vec<Block> {
    let rows = blocks.first().map_or(0, |block| block.len());
    let mut combined: Vec<Block> = couplings.par_iter().map(|_| vec![Lanes::ZERO; rows]).collect();
    // Chunk by chunk, so that a chunk of all blocks is read from memory once.
    let mut chunks: Vec<Vec<&mut [Lanes]>> = Vec::new();
    chunks.resize_with(rows.div_ceil(CHUNK), Vec::new);
    for block in &mut combined {
        chunks.iter_mut().zip(block.chunks_mut(CHUNK)).for_each(|(chunk, rows)| chunk.push(rows));
    }
    chunks.into_par_iter().enumerate().for_each(|(chunk, out)| {
        vectorized(CombineChunk { start: chunk * CHUNK, blocks, couplings, out });
    });
    combined
}

struct SweepChunk<'a> {
    start: usize,
    rows: &'a mut [Lanes],
    sweep: &'a Sweep<'a>,
}

impl WithSimd for SweepChunk<'_> {
    type Output = Vec<Coupling>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<Coupling> {
        let range = self.start..self.start + self.rows.len();
        if let Some(transform) = self.sweep.transform {
            for row in self.rows.iter_mut() {
                let old = *row;
                *row = Lanes::ZERO;
                for (factor, other) in old.0.iter().zip(transform) {
                    row.add_scaled(simd, *factor, other);
                }
            }
        }
        for (block, coupling) in self.sweep.subtract {
            let mut negative = *coupling;
            negative.iter_mut().for_each(|row| row.scale(-1.0));
            accumulate(simd, self.rows, &block[range.clone()], &negative);
        }
        let mut products = Vec::with_capacity(self.sweep.couple.len() + 1);
        // A closure here would be compiled without the wide instructions.
        for block in self.sweep.couple {
            products.push(couple(simd, &block[range.clone()], self.rows));
        }
        products.push(couple(simd, self.rows, self.rows));
        products
    }
}

struct GramChunk<'a> {
    rows: std::ops::Range<usize>,
    blocks: &'a [Block],
}

impl WithSimd for GramChunk<'_> {
    type Output = Vec<Coupling>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<Coupling> {
        let mut products = Vec::with_capacity(self.blocks.len() * (self.blocks.len() + 1) / 2);
        for (at, right) in self.blocks.iter().enumerate() {
            for left in &self.blocks[..=at] {
                products.push(couple(simd, &left[self.rows.clone()], &right[self.rows.clone()]));
            }
        }
        products
    }
}

struct CombineChunk<'a> {
    start: usize,
    blocks: &'a [&'a [Lanes]],
    couplings: &'a [Vec<Coupling>],
    /// The chunk's rows of every result.
    out: Vec<&'a mut [Lanes]>,
}

impl WithSimd for CombineChunk<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (out, couplings) in self.out.into_iter().zip(self.couplings) {
            for (block, coupling) in self.blocks.iter().zip(couplings) {
                accumulate(simd, out, &block[self.start..self.start + out.len()], coupling);
            }
        }
    }
}

/// `sums += factors · coupling`, four rows at a time so that the coupling is loaded less often.
#[inline(always)]
fn accumulate<S: Simd>(simd: S, sums: &mut [Lanes], factors: &[Lanes], coupling: &Coupling) {
    const ROWS: usize = 4;
    let mut many = sums.chunks_exact_mut(ROWS);
    let mut many_factors = factors.chunks_exact(ROWS);
    for (sums, factors) in (&mut many).zip(&mut many_factors) {
        let (mut a, mut b, mut c, mut d) = (sums[0], sums[1], sums[2], sums[3]);
        for (lane, other) in coupling.iter().enumerate() {
            a.add_scaled(simd, factors[0].0[lane], other);
            b.add_scaled(simd, factors[1].0[lane], other);
            c.add_scaled(simd, factors[2].0[lane], other);
            d.add_scaled(simd, factors[3].0[lane], other);
        }
        sums.copy_from_slice(&[a, b, c, d]);
    }
    for (sum, factors) in many.into_remainder().iter_mut().zip(many_factors.remainder()) {
        for (factor, other) in factors.0.iter().zip(coupling) {
            sum.add_scaled(simd, *factor, other);
        }
    }
}

/// `leftᵀ right`, four lanes of the left at a time so that the sums stay in registers.
#[inline(always)]
fn couple<S: Simd>(simd: S, left: &[Lanes], right: &[Lanes]) -> Coupling {
    let lower = couple_half::<0, S>(simd, left, right);
    let upper = couple_half::<{ WIDTH / 2 }, S>(simd, left, right);
    let mut product = NO_COUPLING;
    product[..WIDTH / 2].copy_from_slice(&lower);
    product[WIDTH / 2..].copy_from_slice(&upper);
    product
}

#[inline(always)]
fn couple_half<const FIRST: usize, S: Simd>(simd: S, left: &[Lanes], right: &[Lanes]) -> [Lanes; WIDTH / 2] {
    let (mut a, mut b, mut c, mut d) = (Lanes::ZERO, Lanes::ZERO, Lanes::ZERO, Lanes::ZERO);
    for (left, right) in left.iter().zip(right) {
        a.add_scaled(simd, left.0[FIRST], right);
        b.add_scaled(simd, left.0[FIRST + 1], right);
        c.add_scaled(simd, left.0[FIRST + 2], right);
        d.add_scaled(simd, left.0[FIRST + 3], right);
    }
    [a, b, c, d]
}

#[cfg(test)]
mod tests {
    use super::super::random::SplitMix64;
    use super::*;

    /// More rows than one chunk, and no multiple of anything.
    const ROWS: usize = 2 * CHUNK + 37;

    fn block(seed: u64) -> Block {
        let mut random = SplitMix64::new(seed);
        (0..ROWS).map(|_| Lanes([0.0; WIDTH].map(|_| random.uniform()))).collect()
    }

    fn coupling(seed: u64) -> Coupling {
        let block = block(seed);
        std::array::from_fn(|row| block[row])
    }

    fn naive_product(left: &[Lanes], right: &[Lanes], a: usize, b: usize) -> f64 {
        left.iter().zip(right).map(|(left, right)| left[a] * right[b]).sum()
    }

    #[test]
    fn a_sweep_transforms_subtracts_and_couples_in_this_order() {
        let (mut swept, first, second) = (block(1), block(2), block(3));
        let (transform, factor) = (coupling(4), coupling(5));
        let mut expected = block(1);
        for (row, other) in expected.iter_mut().zip(&first) {
            let old = *row;
            for lane in 0..WIDTH {
                row[lane] =
                    (0..WIDTH).map(|at| old[at] * transform[at][lane] - other[at] * factor[at][lane]).sum();
            }
        }
        let (couplings, gram) = sweep(
            &mut swept,
            &Sweep { transform: Some(&transform), subtract: &[(&first, factor)], couple: &[&first, &second] },
        );
        for (row, expected) in swept.iter().zip(&expected) {
            for lane in 0..WIDTH {
                assert!((row[lane] - expected[lane]).abs() < 1e-13);
            }
        }
        for (left, product) in [(&first, couplings[0]), (&second, couplings[1]), (&expected, gram)] {
            for (a, row) in product.iter().enumerate() {
                for (b, value) in row.0.iter().enumerate() {
                    assert!((value - naive_product(left, &expected, a, b)).abs() < 1e-10);
                }
            }
        }
    }

    #[test]
    fn combinations_and_gram_matrices_match_naive_sums() {
        let blocks = [block(1), block(2), block(3)];
        let factors =
            [vec![coupling(4), coupling(5), coupling(6)], vec![coupling(7), coupling(8), coupling(9)]];
        let slices: Vec<&[Lanes]> = blocks.iter().map(Vec::as_slice).collect();
        let combined = combine(&slices, &factors);
        assert_eq!(combined.len(), 2);
        for (combined, factors) in combined.iter().zip(&factors) {
            assert_eq!(combined.len(), ROWS);
            for (at, row) in combined.iter().enumerate() {
                for lane in 0..WIDTH {
                    let expected: f64 = blocks
                        .iter()
                        .zip(factors)
                        .flat_map(|(block, factor)| (0..WIDTH).map(move |a| block[at][a] * factor[a][lane]))
                        .sum();
                    assert!((row[lane] - expected).abs() < 1e-13);
                }
            }
        }
        let mut products = gram(&blocks).into_iter();
        for right in 0..blocks.len() {
            for left in &blocks[..=right] {
                let product = products.next().unwrap_or(NO_COUPLING);
                for (a, row) in product.iter().enumerate() {
                    for (b, value) in row.0.iter().enumerate() {
                        assert!((value - naive_product(left, &blocks[right], a, b)).abs() < 1e-10);
                    }
                }
            }
        }
        assert!(products.next().is_none());
    }
}
