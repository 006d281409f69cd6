//! Shift-invert block Lanczos iteration for the smallest eigenpairs.
//!
//! The part of the spectrum of B next to a shift σ is the dominant one of X = (B − σ)⁻¹ (Ericsson &
//! Ruhe 1980; Grimes, Lewis & Simon 1994). The iteration runs on X (X − ρ), whose parabola leaves
//! the eigenvalues of X between 0 and ρ, the unwanted ones, below zero. It ends when enough pairs
//! have converged, are followed by a gap, and are as many as the inertia of B minus a shift in that
//! gap says.

use rayon::prelude::*;

use super::cholesky::{Cholesky, SymbolicCholesky, factor_indefinite, negative_pivots};
use super::eigen::{Problem, Progress, Solution};
use super::error::LinalgError;
use super::lanczos::{BlockLanczos, Ritz};
use super::lanes::{Block, Lanes, WIDTH};

/// Distance of the shift below zero, as a fraction of the estimated largest wanted eigenvalue:
/// small, so that the wanted end of the spectrum is spread out, but enough for a well conditioned
/// matrix.
const SHIFT: f64 = 0.03;

/// Where the unwanted part of the spectrum is taken to begin, as a multiple of the largest wanted
/// eigenvalue by Weyl's law.
const CUT: f64 = 1.5;

/// Residual, relative to the eigenvalue, at which a pair counts as converged.
const CONVERGED: f64 = 1e-10;

/// Residual at which an eigenvalue is known well enough to place a shift below it.
const LOCATED: f64 = 1e-3;

/// Smallest relative gap above the last pair in which the eigenvalues can be counted.
const GAP: f64 = 1e-7;

/// Gaps that are tried before the iteration goes on.
const GAPS: usize = 3;

/// Attempts to find pairs that the count shows to be missing.
const ATTEMPTS: usize = 6;

/// When the iteration has not converged, problems up to this size are solved dense.
const DENSE_FALLBACK: usize = 4096;

/// Seed of the start block.
const SEED: u64 = 0x0de2_315e_ed00_0001;

impl Problem<'_> {
    /// The smallest eigenpairs by block Lanczos iteration from a random block, or from `start`
    /// (rows in the matrix's order). `None` when a dense solver is the better choice.
    pub(super) fn solve_sparse(
        &self,
        pairs: usize,
        start: Option<&Block>,
        progress: &mut Progress,
    ) -> Result<Option<Solution>, LinalgError> {
        let size = self.matrix.size();
        let symbolic = SymbolicCholesky::new(self.matrix)?;
        progress.report(0.03)?;
        let filter = self.filter(&symbolic, pairs)?;
        progress.report(0.08)?;
        let original = &symbolic.inner().original;
        let operator = |block: &[Lanes]| filter.factor.ldl().solve_twice(block, filter.root);
        let mut lanczos = BlockLanczos::new(size, self.null_blocks(original), self.null.len(), SEED);
        let started = match start {
            Some(start) => lanczos.add_block(original.iter().map(|&index| start[index]).collect()),
            None => lanczos.add_random_block(operator),
        };
        let mut room = started;
        let mut target = 3 * pairs / 2 + 5 * WIDTH;
        let mut attempts = 0;
        while room && target < 6 * pairs + 64 * WIDTH {
            while room && lanczos.dimension() < target {
                let done = lanczos.dimension() as f64 / (2.5 * pairs as f64 + 64.0);
                progress.report(0.08 + 0.8 * done.min(1.0))?;
                room = lanczos.step(operator);
            }
            if !room {
                break;
            }
            let ritz = lanczos.ritz()?;
            let found = Found::new(&ritz, &filter, pairs);
            if found.gaps.is_empty() {
                target += (target / 24).max(WIDTH);
                continue;
            }
            // The count is nearly always right, and keeps one core busy.
            let (counted, vectors) = rayon::join(
                || self.count(&symbolic, &found.gaps),
                || lanczos.vectors(&ritz, &found.order[..pairs]),
            );
            let Some((below, count, gap)) = counted? else {
                target += (target / 24).max(WIDTH);
                continue;
            };
            progress.report(0.9)?;
            let expected = count.saturating_sub(self.null.len());
            if expected == gap.below {
                let vectors = vectors.par_iter().map(|block| to_original_order(block, original)).collect();
                return Ok(Some((found.values[..pairs].to_vec(), vectors)));
            }
            attempts += 1;
            if attempts == ATTEMPTS {
                return Err(LinalgError::MissingPairs { expected, found: gap.below, below });
            }
            room = lanczos.add_random_block(operator);
            target += (target / 8).max(4 * WIDTH);
        }
        if size <= DENSE_FALLBACK { Ok(None) } else { Err(LinalgError::NoConvergence { size }) }
    }

    /// The null space in blocks of eight, rows in permuted order.
    fn null_blocks(&self, original: &[usize]) -> Vec<Block> {
        self.null
            .chunks(WIDTH)
            .map(|vectors| {
                let mut block = vec![Lanes::ZERO; original.len()];
                for (row, &index) in block.iter_mut().zip(original) {
                    for (lane, vector) in vectors.iter().enumerate() {
                        row[lane] = vector[index];
                    }
                }
                block
            })
            .collect()
    }

    /// What the iteration runs on: a shift just below the spectrum, the factor of the shifted
    /// matrix, and the root.
    fn filter(&self, symbolic: &SymbolicCholesky, pairs: usize) -> Result<Filter, LinalgError> {
        // On a surface a diagonal entry of B is about 3.5 / area of the vertex, and by Weyl's law
        // there are area · λ / 4π eigenvalues below λ. Only speed depends on this estimate.
        let diagonal = self.matrix.diagonal();
        let mut sorted: Vec<f64> = diagonal.iter().copied().filter(|entry| *entry > 0.0).collect();
        sorted.sort_by(f64::total_cmp);
        // A few vertices with hardly any coupling must not count as most of the area.
        let least = sorted.get(sorted.len() / 2).map_or(1.0, |median| median / 16.0);
        let area: f64 = sorted.iter().map(|entry| 1.0 / entry.max(least)).sum();
        let estimate = if area > 0.0 { 3.6 * pairs as f64 / area } else { 1.0 };
        let shift = -SHIFT * estimate;
        let shifted = self.matrix.add_scaled_diagonal(-shift, &vec![1.0; diagonal.len()])?;
        let (factor, cut) =
            rayon::join(|| Cholesky::factor(symbolic, &shifted), || self.cut(symbolic, pairs));
        let root = cut?.map_or(0.0, |cut| 1.0 / (cut - shift));
        Ok(Filter { shift, root, factor: factor? })
    }

    /// A point above the wanted eigenvalues, but not far above. `None` where a count does not
    /// confirm it, as on what is no surface.
    fn cut(&self, symbolic: &SymbolicCholesky, pairs: usize) -> Result<Option<f64>, LinalgError> {
        let cut = CUT * 4.0 * std::f64::consts::PI * pairs as f64 / self.area;
        let counted = self
            .matrix
            .add_scaled_diagonal(-cut, &vec![1.0; self.matrix.size()])
            .and_then(|shifted| factor_indefinite(symbolic, &shifted, cut));
        let below = match counted {
            Ok(factor) => negative_pivots(&factor).saturating_sub(self.null.len()),
            Err(LinalgError::VanishingPivot { .. } | LinalgError::NonFinite { .. }) => return Ok(None),
            Err(error) => return Err(error),
        };
        let confirmed = (pairs + (pairs / 8).max(2)..=3 * pairs + 4 * WIDTH).contains(&below);
        Ok(confirmed.then_some(cut))
    }

    /// Counts the eigenvalues, null space included, below a point in one of the `gaps`: that
    /// point, the number, and the gap. `None` when elimination is unstable in all of them.
    fn count(
        &self,
        symbolic: &SymbolicCholesky,
        gaps: &[Gap],
    ) -> Result<Option<(f64, usize, Gap)>, LinalgError> {
        let ones = vec![1.0; self.matrix.size()];
        for &gap in gaps.iter().take(GAPS) {
            for fraction in [0.5, 0.35, 0.65] {
                let shift = gap.lower + fraction * (gap.upper - gap.lower);
                let shifted = self.matrix.add_scaled_diagonal(-shift, &ones)?;
                match factor_indefinite(symbolic, &shifted, shift) {
                    Ok(factor) => return Ok(Some((shift, negative_pivots(&factor), gap))),
                    Err(LinalgError::VanishingPivot { .. }) => {}
                    Err(error) => return Err(error),
                }
            }
        }
        Ok(None)
    }
}

/// The operator of the iteration, X (X − root) with X = (B − shift)⁻¹.
struct Filter {
    shift: f64,
    /// Zero where nothing is known of the unwanted part of the spectrum.
    root: f64,
    factor: Cholesky,
}

impl Filter {
    /// The eigenvalue λ of B whose vector has the eigenvalue `value` > 0 of the operator, and the
    /// residual that a purified vector has at most for each unit of the Ritz pair's.
    fn eigenvalue(&self, value: f64) -> (f64, f64) {
        let inverse = 0.5 * (self.root + (self.root * self.root + 4.0 * value).sqrt());
        let distance = 1.0 / inverse;
        // With x the eigenvalue of X, p(x) = x (x − ρ) and f the Ritz pair's residual, the purified
        // vector's is (λⱼ − λ) p(xⱼ) fⱼ / (p(xⱼ) − p(x)) / p(x) along the j-th vector. The parabola
        // is convex, so that |xⱼ − x| ≤ |p(xⱼ) − p(x)| x / p(x) below x and ≤ … xⱼ / p(xⱼ) above.
        (self.shift + distance, (self.root / value).max(distance) / value)
    }
}

/// An interval between converged Ritz values.
#[derive(Debug, Clone, Copy)]
struct Gap {
    lower: f64,
    upper: f64,
    /// Number of converged pairs below, at least as many as wanted.
    below: usize,
}

/// The part of a Ritz decomposition that may be wanted.
struct Found {
    /// Ritz pairs by ascending eigenvalue.
    order: Vec<usize>,
    values: Vec<f64>,
    /// Where enough converged pairs can be told from the rest, the widest first.
    gaps: Vec<Gap>,
}

impl Found {
    fn new(ritz: &Ritz, filter: &Filter, pairs: usize) -> Self {
        let mut list: Vec<(f64, f64, usize)> = Vec::new();
        for (at, (&value, &residual)) in ritz.values.iter().zip(&ritz.residuals).enumerate() {
            if value > 0.0 {
                let (eigenvalue, factor) = filter.eigenvalue(value);
                list.push((eigenvalue, factor * residual, at));
            }
        }
        list.sort_by(|a, b| a.0.total_cmp(&b.0));
        // A null vector that was not handed in has no relative residual.
        let floor = 1e-3 * filter.shift.abs();
        let within = |limit: f64| {
            list.iter().take_while(|(value, residual, _)| *residual <= limit * value.max(floor)).count()
        };
        let mut gaps: Vec<Gap> = (pairs..=within(CONVERGED).min(within(LOCATED).saturating_sub(1)))
            .map(|below| Gap {
                lower: list[below - 1].0 + list[below - 1].1,
                upper: list[below].0 - list[below].1,
                below,
            })
            .filter(|gap| gap.upper - gap.lower > GAP * gap.upper.max(floor))
            .collect();
        // Stable, so that equal widths keep their order.
        gaps.sort_by(|a, b| (b.upper - b.lower).total_cmp(&(a.upper - a.lower)));
        Self {
            order: list.iter().map(|entry| entry.2).collect(),
            values: list.iter().map(|entry| entry.0).collect(),
            gaps,
        }
    }
}

fn to_original_order(block: &Block, original: &[usize]) -> Block {
    let mut rows = vec![Lanes::ZERO; block.len()];
    for (row, &index) in block.iter().zip(original) {
        rows[index] = *row;
    }
    rows
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::super::sparse::SymmetricMatrix;
    use super::*;

    /// Two rings without a common vertex: every eigenvalue of a ring occurs twice, most of them
    /// four times.
    fn rings(length: usize) -> SymmetricMatrix {
        let mut triplets = Vec::new();
        for ring in 0..2 {
            for at in 0..length {
                let (a, b) = (ring * length + at, ring * length + (at + 1) % length);
                triplets.extend([(a, b, -1.0), (a, a, 1.0), (b, b, 1.0)]);
            }
        }
        SymmetricMatrix::from_triplets(2 * length, &triplets).unwrap()
    }

    fn filter(shift: f64, root: f64) -> Filter {
        let matrix = SymmetricMatrix::from_triplets(1, &[(0, 0, 1.0)]).unwrap();
        let factor = Cholesky::factor(&SymbolicCholesky::new(&matrix).unwrap(), &matrix).unwrap();
        Filter { shift, root, factor }
    }

    #[test]
    fn the_parabola_is_inverted_and_bounds_the_residual_of_every_vector() {
        let shift = -0.5;
        let inverse = |eigenvalue: f64| 1.0 / (eigenvalue - shift);
        for root in [0.0, inverse(3.0)] {
            let filter = filter(shift, root);
            let parabola = |x: f64| x * (x - root);
            for wanted in [0.01, 0.5, 1.7, 2.9] {
                let value = parabola(inverse(wanted));
                let (eigenvalue, factor) = filter.eigenvalue(value);
                assert!((eigenvalue - wanted).abs() < 1e-12);
                for step in 1..400 {
                    // Other eigenvalues from 0.001 to 2e7.
                    let other = 0.001 * 1.061_f64.powi(step);
                    let image = parabola(inverse(other));
                    let share = (other - wanted) * image / (image - value) / value;
                    assert!(share.abs() <= factor * (1.0 + 1e-9), "{other} beside {wanted}, root {root}");
                }
            }
        }
    }

    #[test]
    fn a_surface_gets_a_root_that_a_count_confirms_and_a_ring_none() {
        let side = 40;
        let mut triplets = Vec::new();
        for at in 0..side * side {
            for other in [at / side * side + (at + 1) % side, (at + side) % (side * side)] {
                triplets.extend([(at, other, -1.0), (at, at, 1.0), (other, other, 1.0)]);
            }
        }
        let grid = SymmetricMatrix::from_triplets(side * side, &triplets).unwrap();
        for (matrix, is_surface) in [(grid, true), (rings(800), false)] {
            let problem = Problem { matrix: &matrix, null: Vec::new(), area: matrix.size() as f64 };
            let symbolic = SymbolicCholesky::new(&matrix).unwrap();
            let filter = problem.filter(&symbolic, 60).unwrap();
            assert_eq!(filter.root > 0.0, is_surface);
        }
    }

    #[test]
    fn pairs_that_the_start_block_cannot_see_are_missed_counted_and_found() {
        let length = 500;
        let matrix = rings(length);
        let norm = 1.0 / (length as f64).sqrt();
        let null = [0, 1]
            .map(|ring| (0..2 * length).map(|at| if at / length == ring { norm } else { 0.0 }).collect());
        let problem = Problem { matrix: &matrix, null: null.to_vec(), area: 2.0 * length as f64 };
        // The second ring is exactly zero, and stays so under the operator.
        let start: Block =
            (0..2 * length)
                .map(|at| {
                    Lanes(std::array::from_fn(|lane| {
                        if at < length { ((at * (lane + 3)) as f64).sin() } else { 0.0 }
                    }))
                })
                .collect();
        let mut reports = Vec::new();
        let mut callback = |fraction| {
            reports.push(fraction);
            true
        };
        let found = problem.solve_sparse(24, Some(&start), &mut Progress::new(&mut callback)).unwrap();
        let (values, _) = found.unwrap();
        for (pair, value) in values.iter().enumerate() {
            let frequency = std::f64::consts::PI * (pair / 4 + 1) as f64 / length as f64;
            let expected = 4.0 * frequency.sin().powi(2);
            assert!((value / expected - 1.0).abs() < 1e-9, "pair {pair}: {value} instead of {expected}");
        }
        // The first count came too early: the iteration went on after reaching 0.9.
        assert!(reports.iter().filter(|fraction| **fraction >= 0.9).count() > 2);
    }
}
