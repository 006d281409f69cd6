//! Symbolic part of the sparse factorisation: ordering, supernodes, and the subtrees of the
//! elimination tree that triangular solves may visit at the same time.

use std::ops::Range;
use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::cholesky::{simplicial, supernodal};
use faer::sparse::linalg::{SymbolicSupernodalParams, amd};

use super::error::LinalgError;
use super::sparse::{SparsityPattern, SymmetricMatrix};

/// A subtree with less than one part in this many of the factor's entries is one task: small enough
/// to stay in a core's cache between two solves. Fixed, so that the order of additions does not depend
/// on the number of threads.
const SUBTREES: usize = 32;

/// What is named when memory runs out.
const ANALYSIS: &str = "symbolic factorisation";

/// Ordering and structure of the factor of every matrix with one sparsity pattern. Cheap to
/// clone; the analysis is shared.
#[derive(Debug, Clone)]
pub struct SymbolicCholesky {
    inner: Arc<Symbolic>,
}

impl SymbolicCholesky {
    /// Analyses the pattern of `matrix`: approximate minimum degree ordering and supernodes.
    ///
    /// # Errors
    /// [`LinalgError::OutOfMemory`].
    pub fn new(matrix: &SymmetricMatrix) -> Result<Self, LinalgError> {
        Ok(Self { inner: Arc::new(Symbolic::new(matrix.pattern())?) })
    }

    /// Size of the matrix.
    pub fn size(&self) -> usize {
        self.inner.size()
    }

    /// Number of values in the factor, explicit zeros of merged columns included.
    pub fn factor_entries(&self) -> usize {
        self.inner.supernodes.len_val()
    }

    pub(super) fn inner(&self) -> &Arc<Symbolic> {
        &self.inner
    }
}

/// What [`SymbolicCholesky`] shares. Rows and columns are those of the permuted matrix unless
/// said otherwise.
#[derive(Debug)]
pub(super) struct Symbolic {
    pattern: Arc<SparsityPattern>,
    /// Original index of every permuted one.
    pub(super) original: Vec<usize>,
    /// Lower triangle of the permuted matrix, and for each entry its place in the input values.
    pub(super) lower_starts: Vec<usize>,
    pub(super) lower_rows: Vec<usize>,
    pub(super) lower_source: Vec<usize>,
    pub(super) supernodes: supernodal::SymbolicSupernodalCholesky<usize>,
    pub(super) schedule: Schedule,
}

/// Which supernodes are visited in parallel.
#[derive(Debug)]
pub(super) struct Schedule {
    /// Disjoint subtrees of the elimination tree, ascending.
    pub(super) subtrees: Vec<Subtree>,
    /// The supernodes above them, ascending.
    pub(super) top: Vec<usize>,
    /// For every entry of the supernodes' row lists that lies outside of the supernode's own
    /// subtree: its place in [`Subtree::outside`].
    pub(super) outside_position: Vec<u32>,
}

/// A subtree: consecutive supernodes and columns, and the rows above it that it touches.
#[derive(Debug)]
pub(super) struct Subtree {
    pub(super) supernodes: Range<usize>,
    pub(super) columns: Range<usize>,
    pub(super) outside: Vec<usize>,
}

impl Symbolic {
    fn new(pattern: &Arc<SparsityPattern>) -> Result<Self, LinalgError> {
        let original = postordered(pattern, minimum_degree(pattern)?)?;
        let ((lower_starts, lower_rows, lower_source), analysed) = rayon::join(
            || triangle(pattern, &original, |row, column| row >= column),
            || {
                let (starts, rows, _) = triangle(pattern, &original, |row, column| row <= column);
                let supernodes = supernodes(&starts, &rows)?;
                let schedule = Schedule::new(&supernodes);
                Ok((supernodes, schedule))
            },
        );
        let (supernodes, schedule) = analysed?;
        Ok(Self {
            pattern: Arc::clone(pattern),
            original,
            lower_starts,
            lower_rows,
            lower_source,
            supernodes,
            schedule,
        })
    }

    pub(super) fn size(&self) -> usize {
        self.original.len()
    }

    /// Error unless `matrix` has the analysed pattern.
    pub(super) fn check_pattern(&self, matrix: &SymmetricMatrix) -> Result<(), LinalgError> {
        if Arc::ptr_eq(&self.pattern, matrix.pattern()) || *self.pattern == **matrix.pattern() {
            Ok(())
        } else {
            Err(LinalgError::PatternMismatch)
        }
    }

    /// Columns of a supernode.
    #[inline]
    pub(super) fn columns(&self, supernode: usize) -> Range<usize> {
        self.supernodes.supernode_begin()[supernode]..self.supernodes.supernode_end()[supernode]
    }

    /// Rows of a supernode below its columns, ascending.
    #[inline]
    pub(super) fn rows(&self, supernode: usize) -> &[usize] {
        self.supernodes.supernode(supernode).pattern()
    }

    /// Where the supernode's values lie in the factor: column-major, columns first.
    #[inline]
    pub(super) fn values(&self, supernode: usize) -> Range<usize> {
        let starts = self.supernodes.col_ptr_for_val();
        starts[supernode]..starts[supernode + 1]
    }

    /// Parent of every supernode in the elimination tree: the owner of its first row below.
    pub(super) fn parents(&self) -> Vec<Option<usize>> {
        parents(&self.supernodes)
    }
}

impl Schedule {
    fn new(supernodes: &supernodal::SymbolicSupernodalCholesky<usize>) -> Self {
        let count = supernodes.n_supernodes();
        let parents = parents(supernodes);
        let starts = supernodes.col_ptr_for_val();
        // A subtree ends with its root. The ordering is nearly, not always, a postorder: a subtree
        // is a task of its own only where all supernodes from its first to its root belong to it.
        let mut first: Vec<usize> = (0..count).collect();
        let mut members = vec![1_usize; count];
        for supernode in 0..count {
            if let Some(parent) = parents[supernode] {
                first[parent] = first[parent].min(first[supernode]);
                members[parent] += members[supernode];
            }
        }
        let largest = supernodes.len_val().div_ceil(SUBTREES);
        let weight = |root: usize| starts[root + 1] - starts[first[root]];
        let mut subtrees = Vec::new();
        let mut top = Vec::new();
        let mut outside_position = vec![0_u32; supernodes.row_idx().len()];
        let mut in_subtree = vec![false; count];
        for root in (0..count).rev() {
            if parents[root].is_some_and(|parent| in_subtree[parent]) {
                in_subtree[root] = true;
            } else if weight(root) > largest || members[root] != root + 1 - first[root] {
                top.push(root);
            } else {
                in_subtree[root] = true;
                let columns = supernodes.supernode_begin()[first[root]]..supernodes.supernode_end()[root];
                let outside = supernodes.supernode(root).pattern().to_vec();
                for supernode in first[root]..=root {
                    let offset = supernodes.col_ptr_for_row_idx()[supernode];
                    let rows = supernodes.supernode(supernode).pattern();
                    let inside = rows.partition_point(|&row| row < columns.end);
                    for (at, row) in (offset + inside..).zip(&rows[inside..]) {
                        // Rows above a subtree are among the rows of its root.
                        outside_position[at] = outside.partition_point(|other| other < row) as u32;
                    }
                }
                subtrees.push(Subtree { supernodes: first[root]..root + 1, columns, outside });
            }
        }
        subtrees.reverse();
        top.reverse();
        Self { subtrees, top, outside_position }
    }
}

fn parents(supernodes: &supernodal::SymbolicSupernodalCholesky<usize>) -> Vec<Option<usize>> {
    (0..supernodes.n_supernodes())
        .map(|supernode| {
            let first = supernodes.supernode(supernode).pattern().first()?;
            Some(supernodes.supernode_end().partition_point(|end| end <= first))
        })
        .collect()
}

/// Fill-reducing ordering: original index of each permuted one.
fn minimum_degree(pattern: &SparsityPattern) -> Result<Vec<usize>, LinalgError> {
    const WHAT: &str = "fill-reducing ordering";
    let size = pattern.size();
    let (mut original, mut permuted) = (vec![0; size], vec![0; size]);
    let mut memory = allocate(amd::order_scratch::<usize>(size, pattern.rows().len()), WHAT)?;
    amd::order(
        &mut original,
        &mut permuted,
        SymbolicSparseColMatRef::new_checked(size, size, pattern.column_starts(), None, pattern.rows()),
        amd::Control::default(),
        MemStack::new(&mut memory),
    )
    .map_err(|_| LinalgError::OutOfMemory { what: WHAT })?;
    Ok(original)
}

/// An equivalent ordering in which every subtree of the elimination tree is consecutive.
fn postordered(pattern: &SparsityPattern, original: Vec<usize>) -> Result<Vec<usize>, LinalgError> {
    let size = original.len();
    let (starts, rows, _) = triangle(pattern, &original, |row, column| row <= column);
    let tree = elimination_tree(&starts, &rows)?;
    // Children in descending order, so that the walk pops them in ascending order.
    let mut children = vec![Vec::new(); size];
    let mut open = Vec::new();
    for column in (0..size).rev() {
        // The tree marks roots by a negative parent.
        match usize::try_from(tree[column]) {
            Ok(parent) => children[parent].push(column),
            Err(_) => open.push((column, false)),
        }
    }
    let mut order = Vec::with_capacity(size);
    while let Some((column, done)) = open.pop() {
        if done {
            order.push(original[column]);
        } else {
            open.push((column, true));
            open.extend(children[column].iter().map(|&child| (child, false)));
        }
    }
    Ok(order)
}

/// Column starts, rows, and places in the input of one triangle of the permuted matrix.
fn triangle(
    pattern: &SparsityPattern,
    original: &[usize],
    keep: impl Fn(usize, usize) -> bool,
) -> (Vec<usize>, Vec<usize>, Vec<usize>) {
    let mut permuted = vec![0; original.len()];
    for (at, &index) in original.iter().enumerate() {
        permuted[index] = at;
    }
    let half = pattern.rows().len() / 2 + original.len();
    let mut starts = Vec::with_capacity(original.len() + 1);
    starts.push(0);
    let (mut rows, mut source) = (Vec::with_capacity(half), Vec::with_capacity(half));
    let mut entries = Vec::new();
    for (column, &old) in original.iter().enumerate() {
        entries.clear();
        entries.extend(
            (pattern.column_starts()[old]..pattern.column_starts()[old + 1])
                .map(|at| (permuted[pattern.rows()[at]], at))
                .filter(|entry| keep(entry.0, column)),
        );
        entries.sort_unstable();
        rows.extend(entries.iter().map(|entry| entry.0));
        source.extend(entries.iter().map(|entry| entry.1));
        starts.push(rows.len());
    }
    (starts, rows, source)
}

/// Parent of each column in the elimination tree, negative for roots, from the upper triangle.
fn elimination_tree(starts: &[usize], rows: &[usize]) -> Result<Vec<isize>, LinalgError> {
    let size = starts.len() - 1;
    let scratch = simplicial::prefactorize_symbolic_cholesky_scratch::<usize>(size, rows.len());
    let mut memory = allocate(scratch, ANALYSIS)?;
    let (mut tree, mut counts) = (vec![0; size], vec![0; size]);
    let upper = SymbolicSparseColMatRef::new_checked(size, size, starts, None, rows);
    simplicial::prefactorize_symbolic_cholesky(&mut tree, &mut counts, upper, MemStack::new(&mut memory));
    Ok(tree)
}

/// Supernodes from the upper triangle of the permuted matrix.
fn supernodes(
    starts: &[usize],
    rows: &[usize],
) -> Result<supernodal::SymbolicSupernodalCholesky<usize>, LinalgError> {
    let size = starts.len() - 1;
    let upper = SymbolicSparseColMatRef::new_checked(size, size, starts, None, rows);
    let mut memory = allocate(
        StackReq::any_of(&[
            simplicial::prefactorize_symbolic_cholesky_scratch::<usize>(size, rows.len()),
            supernodal::factorize_supernodal_symbolic_cholesky_scratch::<usize>(size),
        ]),
        ANALYSIS,
    )?;
    let stack = MemStack::new(&mut memory);
    let (mut tree, mut counts) = (vec![0; size], vec![0; size]);
    let tree = simplicial::prefactorize_symbolic_cholesky(&mut tree, &mut counts, upper, stack);
    supernodal::factorize_supernodal_symbolic_cholesky(
        upper,
        tree,
        &counts,
        stack,
        SymbolicSupernodalParams::default(),
    )
    .map_err(|_| LinalgError::OutOfMemory { what: ANALYSIS })
}

/// Scratch memory for faer, with an error where it would abort.
pub(super) fn allocate(request: StackReq, what: &'static str) -> Result<MemBuffer, LinalgError> {
    MemBuffer::try_new(request).map_err(|_| LinalgError::OutOfMemory { what })
}
