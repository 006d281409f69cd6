//! What can go wrong in the linear algebra, with the row, column or pair at fault.

use thiserror::Error;

/// Failure of a linear algebra routine; whatever was passed in is unchanged.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum LinalgError {
    /// An array has another length than the matrix asks for.
    #[error("{what} has {found} entries where {expected} are needed")]
    DimensionMismatch {
        /// Name of the argument.
        what: &'static str,
        /// Length that is needed.
        expected: usize,
        /// Length that was passed.
        found: usize,
    },
    /// A row or column index is not below the size of the matrix.
    #[error("entry ({row}, {column}) is outside of a matrix of size {size}")]
    IndexOutOfRange {
        /// Row index.
        row: usize,
        /// Column index.
        column: usize,
        /// Size of the matrix.
        size: usize,
    },
    /// The same row was asked for twice.
    #[error("index {index} occurs twice among the kept rows")]
    DuplicateIndex {
        /// Index that occurs again.
        index: usize,
    },
    /// A matrix entry, or an entry of an argument, is NaN or infinite.
    #[error("{what} has a NaN or infinite entry at ({row}, {column})")]
    NonFinite {
        /// Name of the argument.
        what: &'static str,
        /// Row index.
        row: usize,
        /// Column index.
        column: usize,
    },
    /// A diagonal mass is zero or negative.
    #[error("mass {index} is {value:e}; masses must be positive")]
    NonPositiveMass {
        /// Row of the mass.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// A matrix that must be positive definite is not, to working precision.
    #[error("the matrix is not positive definite: its pivot in column {column} is {pivot:e}")]
    NotPositiveDefinite {
        /// Column of the input matrix whose pivot failed.
        column: usize,
        /// Value of the pivot.
        pivot: f64,
    },
    /// A pivot of an indefinite factorisation vanishes: the shift is too close to an eigenvalue
    /// of a leading block. Another shift nearby works.
    #[error("shift {shift:e} gives a vanishing pivot in column {column}")]
    VanishingPivot {
        /// Column of the input matrix.
        column: usize,
        /// Shift that was asked for.
        shift: f64,
    },
    /// The symbolic factorisation belongs to a matrix with another sparsity pattern.
    #[error("the matrix has another sparsity pattern than the symbolic factorisation")]
    PatternMismatch,
    /// A vector handed in as part of the null space is not mapped to zero, or depends on others.
    #[error(
        "null space vector {vector} is not in the null space or depends on the ones before it ({residual:e})"
    )]
    NotANullVector {
        /// Index of the vector.
        vector: usize,
        /// Relative size of what should vanish.
        residual: f64,
    },
    /// More pairs were asked for than the matrix has besides its null space.
    #[error("{requested} eigenpairs were requested, the matrix has {available}")]
    TooManyPairs {
        /// Pairs asked for.
        requested: usize,
        /// Pairs that exist.
        available: usize,
    },
    /// An eigenpair misses the residual tolerance.
    #[error("eigenpair {pair} has relative residual {residual:e}, above {tolerance:e}")]
    ResidualNotReached {
        /// Index of the pair, ascending by eigenvalue.
        pair: usize,
        /// Relative residual that was reached.
        residual: f64,
        /// Largest residual that is accepted.
        tolerance: f64,
    },
    /// A matrix that must be positive semi-definite is not.
    #[error("eigenvalue {pair} is {value:e}; the matrix must be positive semi-definite")]
    NegativeEigenvalue {
        /// Index of the pair, ascending by eigenvalue.
        pair: usize,
        /// The eigenvalue.
        value: f64,
    },
    /// Two eigenvectors are not orthonormal.
    #[error("eigenvectors {first} and {second} miss orthonormality by {deviation:e}")]
    NotOrthonormal {
        /// Index of the first vector.
        first: usize,
        /// Index of the second vector.
        second: usize,
        /// Absolute deviation of their inner product.
        deviation: f64,
    },
    /// Counting by inertia shows other eigenvalues than those that were found.
    #[error("{expected} eigenvalues lie below {below:e}, {found} were found")]
    MissingPairs {
        /// Number of eigenvalues that exist.
        expected: usize,
        /// Number that was found.
        found: usize,
        /// Upper bound of the counted interval.
        below: f64,
    },
    /// The eigenvalue iteration did not converge.
    #[error("the eigenvalue iteration did not converge on a matrix of size {size}")]
    NoConvergence {
        /// Size of the matrix.
        size: usize,
    },
    /// The problem does not fit in memory or in the index type.
    #[error("not enough memory for a {what}")]
    OutOfMemory {
        /// What was to be allocated.
        what: &'static str,
    },
    /// The progress callback asked to stop.
    #[error("cancelled")]
    Cancelled,
}
