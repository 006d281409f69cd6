//! Diagonals of the inverse of a sparse matrix, without the inverse.
//!
//! The entries of Z = A⁻¹ on the pattern of the factor follow from one another, from the last
//! column to the first (Takahashi, Fagan & Chin 1973; Erisman & Tinney 1975). For a supernode
//! with columns J, rows P below them, `S = L_JJ D_J L_JJᵀ` and `Y = L_PJ L_JJ⁻¹`,
//!
//! ```text
//! Z_PJ = −Z_PP Y,        Z_JJ = S⁻¹ + Yᵀ Z_PP Y.
//! ```
//!
//! The diagonal of A⁻¹ M A⁻¹ is −d/dt diag((A + t M)⁻¹) at t = 0. The derivative is taken
//! exactly: through the elimination, from the leaves of the elimination tree to its roots, and
//! then through the recurrence above. For a surface Laplacian with one vertex per component
//! removed these are the diagonals of the harmonic and the biharmonic Green's function.

use std::collections::BTreeMap;

use faer::linalg::triangular_solve::{
    solve_unit_lower_triangular_in_place, solve_unit_upper_triangular_in_place,
};
use faer::{MatRef, Par};
use rayon::prelude::*;

use super::cholesky::Cholesky;
use super::dense::Dense;
use super::error::LinalgError;
use super::ldl::LdlFactor;
use super::sparse::check_length;
use super::symbolic::Symbolic;

/// The n diagonal entries of A⁻¹, A being the matrix that was factored.
pub fn diagonal_of_inverse(cholesky: &Cholesky) -> Vec<f64> {
    Recurrence::new(cholesky.ldl(), None).diagonals().0
}

/// The n diagonal entries of A⁻¹ M A⁻¹, A being the matrix that was factored and M the diagonal
/// matrix `mass`.
///
/// # Errors
/// [`LinalgError::DimensionMismatch`], [`LinalgError::NonFinite`].
pub fn diagonal_of_inverse_mass_inverse(cholesky: &Cholesky, mass: &[f64]) -> Result<Vec<f64>, LinalgError> {
    check_length("mass", cholesky.size(), mass.len())?;
    if let Some(row) = mass.iter().position(|value| !value.is_finite()) {
        return Err(LinalgError::NonFinite { what: "mass", row, column: 0 });
    }
    let mut diagonal = Recurrence::new(cholesky.ldl(), Some(mass)).diagonals().1;
    for value in &mut diagonal {
        *value = -*value;
    }
    Ok(diagonal)
}

/// A quantity and its derivative with respect to t; the latter only when it is asked for.
#[derive(Debug, Clone)]
struct Dual {
    value: Dense,
    derivative: Option<Dense>,
}

impl Dual {
    fn gather(&self, at: &[usize]) -> Self {
        Self { value: self.value.gather(at), derivative: self.derivative.as_ref().map(|d| d.gather(at)) }
    }
}

struct Recurrence<'a> {
    factor: &'a LdlFactor,
    mass: Option<&'a [f64]>,
    parents: Vec<Option<usize>>,
    children: Vec<Vec<usize>>,
}

/// Derivatives of the columns J of the partially eliminated matrix, one matrix of columns' rows
/// and rows below per supernode.
type Columns = BTreeMap<usize, Dense>;

/// Blocks that wait for the supernode they belong to.
type Waiting<T> = BTreeMap<usize, T>;

impl<'a> Recurrence<'a> {
    fn new(factor: &'a LdlFactor, mass: Option<&'a [f64]>) -> Self {
        let parents = factor.symbolic().parents();
        let mut children = vec![Vec::new(); parents.len()];
        for (child, parent) in parents.iter().enumerate() {
            if let Some(parent) = parent {
                children[*parent].push(child);
            }
        }
        Self { factor, mass, parents, children }
    }

    fn symbolic(&self) -> &'a Symbolic {
        self.factor.symbolic()
    }

    /// The diagonal of Z and of its derivative, in the order of the input matrix.
    fn diagonals(&self) -> (Vec<f64>, Vec<f64>) {
        let symbolic = self.symbolic();
        let schedule = &symbolic.schedule;
        // Up the tree: derivatives of the eliminated columns. Subtrees run side by side; what
        // they leave for their parents is added in a fixed order.
        let mut eliminated: Vec<Columns> = Vec::new();
        let mut top_eliminated = Columns::new();
        if self.mass.is_some() {
            let done: Vec<(Columns, Waiting<Dense>)> = schedule
                .subtrees
                .par_iter()
                .map(|subtree| {
                    let (mut columns, mut waiting) = (Columns::new(), Waiting::new());
                    self.eliminate(subtree.supernodes.clone(), &mut columns, &mut waiting);
                    (columns, waiting)
                })
                .collect();
            let mut waiting = Waiting::new();
            for (columns, left) in done {
                eliminated.push(columns);
                waiting.extend(left);
            }
            self.eliminate(schedule.top.iter().copied(), &mut top_eliminated, &mut waiting);
        } else {
            eliminated.resize_with(schedule.subtrees.len(), Columns::new);
        }
        // Down the tree: entries of the inverse.
        let mut diagonals = vec![(0.0, 0.0); symbolic.size()];
        let mut known = Waiting::new();
        self.invert(schedule.top.iter().rev().copied(), &mut top_eliminated, &mut known, |column, pair| {
            diagonals[column] = pair;
        });
        let parts: Vec<Vec<(f64, f64)>> = schedule
            .subtrees
            .par_iter()
            .zip(eliminated)
            .map(|(subtree, mut eliminated)| {
                let root = subtree.supernodes.end - 1;
                let mut known: Waiting<Dual> =
                    known.get(&root).map(|block| (root, block.clone())).into_iter().collect();
                let mut part = vec![(0.0, 0.0); subtree.columns.len()];
                self.invert(subtree.supernodes.clone().rev(), &mut eliminated, &mut known, |column, pair| {
                    part[column - subtree.columns.start] = pair;
                });
                part
            })
            .collect();
        for (subtree, part) in schedule.subtrees.iter().zip(parts) {
            diagonals[subtree.columns.clone()].copy_from_slice(&part);
        }
        let (mut values, mut derivatives) = (vec![0.0; diagonals.len()], vec![0.0; diagonals.len()]);
        for (&index, (value, derivative)) in symbolic.original.iter().zip(diagonals) {
            values[index] = value;
            derivatives[index] = derivative;
        }
        (values, derivatives)
    }

    /// Derivative of block elimination. With F the derivative of the matrix before a supernode is
    /// eliminated, what remains for its rows below is
    /// `F_PP − Y F_JP − F_PJ Yᵀ + Y F_JJ Yᵀ`.
    fn eliminate(
        &self,
        supernodes: impl Iterator<Item = usize>,
        columns: &mut Columns,
        waiting: &mut Waiting<Dense>,
    ) {
        let symbolic = self.symbolic();
        let mass = self.mass.unwrap_or(&[]);
        for supernode in supernodes {
            let own = symbolic.columns(supernode);
            let (width, below) = (own.len(), symbolic.rows(supernode).len());
            let height = width + below;
            let mut front = Dense::zeros(height, height);
            for (at, column) in own.enumerate() {
                front.values[at * (height + 1)] = mass[symbolic.original[column]];
            }
            for child in &self.children[supernode] {
                if let Some(rest) = waiting.remove(child) {
                    let at = self.positions(*child, supernode);
                    for (column, values) in at.iter().zip(rest.values.chunks_exact(rest.rows)) {
                        let target = &mut front.values[column * height..(column + 1) * height];
                        for (&row, value) in at.iter().zip(values) {
                            target[row] += value;
                        }
                    }
                }
            }
            if below > 0 {
                let y = self.y(supernode);
                let (left, right) = front.view().split_at_col(width);
                let (pivot, side) = left.split_at_row(width);
                // With H = F_PJ − ½ Y F_JJ the rest is F_PP − Y Hᵀ − H Yᵀ.
                let mut half = Dense::zeros(below, width);
                half.view_mut().copy_from(side);
                half.add_product(-0.5, y.view(), pivot);
                let mut outer = Dense::zeros(below, below);
                outer.add_product(1.0, y.view(), half.view().transpose());
                let rest = right.subrows(width, below);
                let mut remaining = Dense::zeros(below, below);
                for column in 0..below {
                    for row in 0..below {
                        remaining.values[column * below + row] = rest[(row, column)]
                            - outer.values[column * below + row]
                            - outer.values[row * below + column];
                    }
                }
                waiting.insert(supernode, remaining);
            }
            front.truncate(width);
            columns.insert(supernode, front);
        }
    }

    /// Takahashi's recurrence and its derivative. `known` holds `Z_PP` for supernodes whose parent
    /// was visited, and gets it for their children.
    fn invert(
        &self,
        supernodes: impl Iterator<Item = usize>,
        eliminated: &mut Columns,
        known: &mut Waiting<Dual>,
        mut diagonal: impl FnMut(usize, (f64, f64)),
    ) {
        let symbolic = self.symbolic();
        for supernode in supernodes {
            let own = symbolic.columns(supernode);
            let (width, below) = (own.len(), symbolic.rows(supernode).len());
            let height = width + below;
            let eliminated = eliminated.remove(&supernode);
            // A root has no rows below it.
            let z = known.remove(&supernode).unwrap_or_else(|| Dual {
                value: Dense::zeros(0, 0),
                derivative: eliminated.as_ref().map(|_| Dense::zeros(0, 0)),
            });
            let y = self.y(supernode);
            let pivot_inverse = self.pivot_inverse(supernode);
            let mut u = Dense::zeros(below, width);
            u.add_product(1.0, z.value.view(), y.view());
            let mut corner = pivot_inverse.clone();
            corner.add_product(1.0, y.view().transpose(), u.view());
            let derivative = eliminated.zip(z.derivative.as_ref()).map(|(eliminated, z_derivative)| {
                let (pivot, side) = eliminated.view().split_at_row(width);
                // Y' = (F_PJ − Y F_JJ) S⁻¹
                let mut rest = Dense::zeros(below, width);
                rest.view_mut().copy_from(side);
                rest.add_product(-1.0, y.view(), pivot);
                let mut y_derivative = Dense::zeros(below, width);
                y_derivative.add_product(1.0, rest.view(), pivot_inverse.view());
                let mut u_derivative = Dense::zeros(below, width);
                u_derivative.add_product(1.0, z_derivative.view(), y.view());
                u_derivative.add_product(1.0, z.value.view(), y_derivative.view());
                let mut half = Dense::zeros(width, width);
                half.add_product(1.0, pivot, pivot_inverse.view());
                let mut corner = Dense::zeros(width, width);
                corner.add_product(-1.0, pivot_inverse.view(), half.view());
                corner.add_product(1.0, y_derivative.view().transpose(), u.view());
                corner.add_product(1.0, y.view().transpose(), u_derivative.view());
                (corner, u_derivative)
            });
            for (at, column) in own.enumerate() {
                let at = at * (width + 1);
                diagonal(
                    column,
                    (corner.values[at], derivative.as_ref().map_or(0.0, |(corner, _)| corner.values[at])),
                );
            }
            let children = &self.children[supernode];
            if children.is_empty() {
                continue;
            }
            let front = Dual {
                value: assemble(height, &corner, &u, &z.value),
                derivative: derivative
                    .zip(z.derivative.as_ref())
                    .map(|((corner, u), z)| assemble(height, &corner, &u, z)),
            };
            for &child in children {
                known.insert(child, front.gather(&self.positions(child, supernode)));
            }
        }
    }

    /// `Y = L_PJ L_JJ⁻¹`.
    fn y(&self, supernode: usize) -> Dense {
        let width = self.symbolic().columns(supernode).len();
        let values = self.factor.supernode(supernode);
        let factor = MatRef::from_column_major_slice(values, values.len() / width, width);
        let (triangle, side) = factor.split_at_row(width);
        let mut y = Dense::zeros(side.nrows(), width);
        y.view_mut().copy_from(side);
        solve_unit_upper_triangular_in_place(triangle.transpose(), y.view_mut().transpose_mut(), Par::Seq);
        y
    }

    /// `S⁻¹ = L_JJ⁻ᵀ D_J⁻¹ L_JJ⁻¹`.
    fn pivot_inverse(&self, supernode: usize) -> Dense {
        let width = self.symbolic().columns(supernode).len();
        let values = self.factor.supernode(supernode);
        let height = values.len() / width;
        let triangle = MatRef::from_column_major_slice(values, height, width).subrows(0, width);
        let mut inverse = Dense::zeros(width, width);
        for at in 0..width {
            inverse.values[at * (width + 1)] = 1.0;
        }
        solve_unit_lower_triangular_in_place(triangle, inverse.view_mut(), Par::Seq);
        let mut scaled = inverse.clone();
        for column in 0..width {
            for row in 0..width {
                scaled.values[column * width + row] /= values[row * (height + 1)];
            }
        }
        let mut product = Dense::zeros(width, width);
        product.add_product(1.0, inverse.view().transpose(), scaled.view());
        product
    }

    /// Where the rows below `child` lie among the columns and rows of its parent.
    fn positions(&self, child: usize, parent: usize) -> Vec<usize> {
        let symbolic = self.symbolic();
        debug_assert_eq!(self.parents[child], Some(parent));
        let columns = symbolic.columns(parent);
        let rows = symbolic.rows(parent);
        let mut next = 0;
        symbolic
            .rows(child)
            .iter()
            .map(|&row| {
                if row < columns.end {
                    row - columns.start
                } else {
                    next += rows[next..].partition_point(|&other| other < row);
                    columns.len() + next
                }
            })
            .collect()
    }
}

/// The symmetric matrix with blocks `corner`, `−u` and `rest`.
fn assemble(height: usize, corner: &Dense, u: &Dense, rest: &Dense) -> Dense {
    let width = corner.rows;
    let below = height - width;
    let mut front = Dense::zeros(height, height);
    for column in 0..width {
        let target = &mut front.values[column * height..(column + 1) * height];
        target[..width].copy_from_slice(&corner.values[column * width..(column + 1) * width]);
        for row in 0..below {
            target[width + row] = -u.values[column * below + row];
        }
    }
    for column in 0..below {
        let target = &mut front.values[(width + column) * height..(width + column + 1) * height];
        for (row, target) in target[..width].iter_mut().enumerate() {
            *target = -u.values[row * below + column];
        }
        target[width..].copy_from_slice(&rest.values[column * below..(column + 1) * below]);
    }
    front
}
