//! The surface's own analysis: Laplace–Beltrami operator, its spectrum, biharmonic distance
//! (section 5.1).

mod biharmonic;
mod component;
mod embedding;
mod error;
mod exact_distance;
mod intrinsic;
mod laplacian;
mod tail;
mod tufted_cover;

pub use biharmonic::BiharmonicDistance;
pub use error::SpectralError;
pub use exact_distance::ExactDistance;
pub use laplacian::Laplacian;
