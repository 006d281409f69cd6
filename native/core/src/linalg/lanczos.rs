//! Block Lanczos iteration with full re-orthogonalisation.
//!
//! Builds an orthonormal basis of a block Krylov space of a symmetric operator and the projection
//! of the operator on it (Golub & Underwood 1977; Grimes, Lewis & Simon 1994). The basis is a
//! queue: the operator is applied to the oldest block that it has not been applied to yet, and
//! what is new in the result joins at the end. Fresh random blocks may join at any time, which
//! brings in what the start block missed.

use super::dense::symmetric_eigen;
use super::error::LinalgError;
use super::lanes::{Block, Coupling, Lanes, NO_COUPLING, WIDTH};
use super::random::SplitMix64;
use super::tall::{Sweep, combine, sweep};

/// A new direction is rounding noise when its squared length, relative to the vector that it
/// comes from, is below this.
const NEGLIGIBLE: f64 = 1e-22;

/// Squared sine between a vector and those before it, above which orthonormalisation keeps the
/// block orthogonal to the basis to 1e-12.
const WELL_CONDITIONED: f64 = 1e-6;

/// Squared sine above which a Gram matrix in double precision shows it with some digits.
const RELIABLE: f64 = 1e-12;

/// Rounds of orthonormalisation before the space counts as exhausted.
const ROUNDS: usize = 8;

/// Orthonormal basis and projected operator.
pub(super) struct BlockLanczos {
    rows: usize,
    /// Blocks that everything is kept orthogonal to; unused lanes are zero.
    deflated: Vec<Block>,
    deflated_vectors: usize,
    blocks: Vec<Block>,
    /// For each block that the operator was applied to: the result's coordinates in the basis.
    images: Vec<Vec<Coupling>>,
    /// Whether random blocks joined after the first one, which makes couplings wider.
    several_starts: bool,
    random: SplitMix64,
}

/// Eigenpairs of the projected operator.
pub(super) struct Ritz {
    /// Ritz values μ.
    pub(super) values: Vec<f64>,
    /// Norms of `Op y − μ y` for the unit Ritz vectors y.
    pub(super) residuals: Vec<f64>,
    /// Coordinates of `Op y` in the basis, column-major.
    images: Vec<f64>,
    /// Length of a column of `images`.
    dimension: usize,
}

impl BlockLanczos {
    /// An empty basis of vectors with `rows` entries, orthogonal to `deflated` (orthonormal).
    pub(super) fn new(rows: usize, deflated: Vec<Block>, deflated_vectors: usize, seed: u64) -> Self {
        Self {
            rows,
            deflated,
            deflated_vectors,
            blocks: Vec::new(),
            images: Vec::new(),
            several_starts: false,
            random: SplitMix64::new(seed),
        }
    }

    /// Vectors that the operator was applied to.
    pub(super) fn dimension(&self) -> usize {
        self.images.len() * WIDTH
    }

    /// Adds a random block, after `smooth` was applied to it. False when the whole space is
    /// spanned already.
    pub(super) fn add_random_block(&mut self, smooth: impl Fn(&[Lanes]) -> Block) -> bool {
        let block: Block =
            (0..self.rows).map(|_| Lanes([0.0; WIDTH].map(|_| self.random.uniform()))).collect();
        self.add_block(smooth(&block))
    }

    /// Adds the space of a block. False when the whole space is spanned already.
    pub(super) fn add_block(&mut self, block: Block) -> bool {
        self.several_starts |= !self.blocks.is_empty();
        self.join(block, 0).is_some()
    }

    /// Applies the operator to the next block. False when the whole space is spanned.
    pub(super) fn step(&mut self, operator: impl Fn(&[Lanes]) -> Block) -> bool {
        let Some(source) = self.blocks.get(self.images.len()) else {
            return false;
        };
        let image = operator(source);
        // An image meets only its own block and the one before, unless chains were mixed.
        let near = if self.several_starts { 0 } else { self.images.len().saturating_sub(1) };
        match self.join(image, near) {
            Some(coordinates) => {
                self.images.push(coordinates);
                true
            }
            None => false,
        }
    }

    /// Orthonormalises a block against the basis and appends it. Blocks of the basis before `near`
    /// are known to be orthogonal to it but for rounding. Returns the block's coordinates, the new
    /// block included; `None` when there is no room for eight more directions.
    fn join(&mut self, mut block: Block, near: usize) -> Option<Vec<Coupling>> {
        let spanned = self.deflated_vectors + self.blocks.len() * WIDTH;
        if spanned + WIDTH > self.rows {
            return None;
        }
        let deflated = self.deflated.len();
        let all: Vec<&[Lanes]> = self.deflated.iter().chain(&self.blocks).map(Vec::as_slice).collect();
        let near: Vec<usize> = (0..deflated).chain(deflated + near..all.len()).collect();
        let near_blocks: Vec<&[Lanes]> = near.iter().map(|&at| all[at]).collect();
        let (near_couplings, gram) = sweep(&mut block, &Sweep { couple: &near_blocks, ..Sweep::default() });
        let mut floor: [f64; WIDTH] = std::array::from_fn(|lane| gram[lane][lane] * NEGLIGIBLE);
        let mut coordinates = vec![NO_COUPLING; all.len()];
        for (&at, coupling) in near.iter().zip(&near_couplings) {
            coordinates[at] = *coupling;
        }
        let subtract: Vec<_> = near_blocks.iter().copied().zip(near_couplings).collect();
        let (mut couplings, _) =
            sweep(&mut block, &Sweep { subtract: &subtract, couple: &all, ..Sweep::default() });

        // From here on the block that came in is `basis · coordinates + block · total`.
        let mut total = identity();
        for _ in 0..ROUNDS {
            for (sum, coupling) in coordinates.iter_mut().zip(&couplings) {
                add_product(sum, coupling, &total);
            }
            let subtract: Vec<_> = all.iter().copied().zip(couplings).collect();
            let (_, mut gram) = sweep(&mut block, &Sweep { subtract: &subtract, ..Sweep::default() });
            let mut settled = true;
            let mut dropped = [false; WIDTH];
            for _ in 0..2 {
                let triangular = triangularize(&gram, &mut floor);
                let transform = Some(&triangular.inverse);
                (_, gram) = sweep(&mut block, &Sweep { transform, ..Sweep::default() });
                total = product(&triangular.factor, &total);
                settled &= triangular.settled;
                dropped = triangular.dropped;
            }
            if settled {
                coordinates.push(total);
                coordinates.drain(..deflated);
                self.blocks.push(block);
                return Some(coordinates);
            }
            // Vectors that lie in the basis make room for unrelated directions.
            let lanes: Vec<usize> = (0..WIDTH).filter(|&lane| dropped[lane]).collect();
            for row in block.iter_mut().filter(|_| !lanes.is_empty()) {
                for &lane in &lanes {
                    row[lane] = self.random.uniform();
                }
            }
            let (next, gram) = sweep(&mut block, &Sweep { couple: &all, ..Sweep::default() });
            couplings = next;
            floor =
                std::array::from_fn(
                    |lane| {
                        if dropped[lane] { gram[lane][lane] * NEGLIGIBLE } else { floor[lane] }
                    },
                );
        }
        None
    }

    /// Rayleigh–Ritz on the blocks that the operator was applied to.
    pub(super) fn ritz(&self) -> Result<Ritz, LinalgError> {
        let applied = self.images.len();
        let size = applied * WIDTH;
        let dimension = self.blocks.len() * WIDTH;
        // Images in coordinates, including those of blocks that joined later, by symmetry.
        let entry = |row: usize, column: usize| {
            let (row_block, row_lane) = (row / WIDTH, row % WIDTH);
            let (column_block, column_lane) = (column / WIDTH, column % WIDTH);
            self.images[column_block].get(row_block).map(|coupling| coupling[row_lane][column_lane])
        };
        let mut projected = vec![0.0; size * size];
        for column in 0..size {
            for row in column..size {
                let value = match (entry(row, column), entry(column, row)) {
                    (Some(lower), Some(upper)) => 0.5 * (lower + upper),
                    (Some(value), None) | (None, Some(value)) => value,
                    (None, None) => 0.0,
                };
                projected[column * size + row] = value;
            }
        }
        let (values, vectors) = symmetric_eigen(size, &projected)?;
        let mut images = vec![0.0; dimension * size];
        let mut residuals = vec![0.0; size];
        for (at, &value) in values.iter().enumerate() {
            let vector = &vectors[at * size..(at + 1) * size];
            let image = &mut images[at * dimension..(at + 1) * dimension];
            for (image, coordinate) in image.iter_mut().zip(vector) {
                *image = value * coordinate;
            }
            for (row, out) in image.iter_mut().enumerate().skip(size) {
                for (block, image) in self.images.iter().enumerate() {
                    if let Some(coupling) = image.get(row / WIDTH) {
                        let part = &vector[block * WIDTH..][..WIDTH];
                        *out += coupling[row % WIDTH].0.iter().zip(part).map(|(a, b)| a * b).sum::<f64>();
                    }
                }
            }
            residuals[at] = image[size..].iter().map(|value| value * value).sum::<f64>().sqrt();
        }
        Ok(Ritz { values, residuals, images, dimension })
    }

    /// Unit vectors along `Op y` for the chosen Ritz vectors y, in blocks of eight; unused lanes
    /// are zero. `Op y` is smoother than y: it has lost the part of the error that a last
    /// application of the operator damps (Ericsson & Ruhe 1980).
    pub(super) fn vectors(&self, ritz: &Ritz, chosen: &[usize]) -> Vec<Block> {
        let blocks: Vec<&[Lanes]> = self.blocks.iter().map(Vec::as_slice).collect();
        let couplings: Vec<Vec<Coupling>> = chosen
            .chunks(WIDTH)
            .map(|chosen| {
                let mut couplings = vec![NO_COUPLING; blocks.len()];
                for (lane, &at) in chosen.iter().enumerate() {
                    let image = &ritz.images[at * ritz.dimension..(at + 1) * ritz.dimension];
                    let norm = image.iter().map(|value| value * value).sum::<f64>().sqrt();
                    for (row, value) in image.iter().enumerate() {
                        couplings[row / WIDTH][row % WIDTH][lane] = value / norm;
                    }
                }
                couplings
            })
            .collect();
        combine(&blocks, &couplings)
    }
}

/// Cholesky factor R of a Gram matrix, `G = Rᵀ R`.
struct Triangularized {
    factor: Coupling,
    /// Inverse of the factor, with zero columns for dropped lanes.
    inverse: Coupling,
    /// Lanes without a part of their own.
    dropped: [bool; WIDTH],
    /// No lane was dropped and none lost more digits than a later check forgives.
    settled: bool,
}

/// Factors a Gram matrix. Lanes whose new part has a squared norm below `floor` are dropped; the
/// floor of those that get unit length follows.
fn triangularize(gram: &Coupling, floor: &mut [f64; WIDTH]) -> Triangularized {
    let mut factor = NO_COUPLING;
    let mut inverse = NO_COUPLING;
    let mut dropped = [false; WIDTH];
    let mut settled = true;
    for column in 0..WIDTH {
        let norm = gram[column][column];
        if norm.is_nan() || norm <= floor[column] {
            dropped[column] = true;
            settled = false;
            continue;
        }
        let mut rest = norm;
        for row in 0..column {
            if !dropped[row] {
                let known: f64 = (0..row).map(|at| factor[at][row] * factor[at][column]).sum();
                factor[row][column] = (gram[row][column] - known) / factor[row][row];
                rest -= factor[row][column] * factor[row][column];
            }
        }
        settled &= rest > WELL_CONDITIONED * norm;
        factor[column][column] = if rest > RELIABLE * norm {
            floor[column] = NEGLIGIBLE;
            rest.sqrt()
        } else {
            // Cancellation hides the length of the rest: the next Gram matrix will show it.
            1.0
        };
        inverse[column][column] = 1.0 / factor[column][column];
        for row in (0..column).rev() {
            let known: f64 = (row..column).map(|at| inverse[row][at] * factor[at][column]).sum();
            inverse[row][column] = -known * inverse[column][column];
        }
    }
    Triangularized { factor, inverse, dropped, settled }
}

fn identity() -> Coupling {
    let mut identity = NO_COUPLING;
    for (lane, row) in identity.iter_mut().enumerate() {
        row[lane] = 1.0;
    }
    identity
}

fn product(left: &Coupling, right: &Coupling) -> Coupling {
    let mut product = NO_COUPLING;
    add_product(&mut product, left, right);
    product
}

/// `sum += left · right`
fn add_product(sum: &mut Coupling, left: &Coupling, right: &Coupling) {
    for (sum, left) in sum.iter_mut().zip(left) {
        for (factor, right) in left.0.iter().zip(right) {
            for (sum, right) in sum.0.iter_mut().zip(&right.0) {
                *sum += factor * right;
            }
        }
    }
}
