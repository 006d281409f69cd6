//! The linear algebra against dense oracles, on surfaces whose eigenvalues repeat, and on bad
//! input.

#![allow(clippy::unwrap_used)]

mod cholesky;
mod eigen;
mod selected_inverse;
mod sparse;
mod surfaces;
