//! Sparse symmetric linear algebra in double precision, the only place that knows `faer`.
//!
//! Matrices are [`SymmetricMatrix`] (compressed columns, both triangles), vectors are plain
//! slices, and several vectors are the columns of one column-major slice. Everything is a pure
//! function of its arguments: the same input gives the same bits on any number of threads.

pub mod cholesky;
pub mod conjugate_gradients;
mod dense;
pub mod eigen;
pub mod error;
mod lanczos;
mod lanes;
mod ldl;
mod random;
pub mod selected_inverse;
mod shift_invert;
pub mod sparse;
mod symbolic;
mod tall;
mod triangular;

pub use cholesky::{Cholesky, SymbolicCholesky, negative_eigenvalue_count};
pub use conjugate_gradients::{Ending, conjugate_gradients};
pub use eigen::{Eigenpairs, smallest_eigenpairs};
pub use error::LinalgError;
pub use selected_inverse::{diagonal_of_inverse, diagonal_of_inverse_mass_inverse};
pub use sparse::{SparsityPattern, SymmetricMatrix};
