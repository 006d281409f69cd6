//! Dermis: skin weights and volume-keeping skin for articulated characters.
//!
//! The crate implements, and extends, "Automatic skinning and weight retargeting of articulated
//! characters using extended position-based dynamics" (Pan, Chen, Yang, Qin 2017). Its modules
//! are the sections of that paper; each file holds one algorithm. Imports go one way:
//! {pbd, retarget, rig} → {skinning, cage, spectral} → {mesh, linalg}.
//!
//! Conventions: right-handed coordinates in the caller's unit; `f64` for geometry that is
//! computed once, `f32` in the per-frame path; the same input gives the same bits on any number
//! of threads. Nothing here panics on user data: every fallible function returns a typed error
//! that names the element at fault.

pub mod cage;
pub mod linalg;
mod median;
pub mod mesh;
mod parallel;
pub mod pbd;
pub mod progress;
pub mod retarget;
pub mod rig;
pub mod skinning;
pub mod spectral;

/// Version of the library, the one that the wheel and the extension carry too.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
