//! A template skeleton fitted into a mesh, after Baran & Popović (2007), "Automatic rigging and
//! animation of 3D characters" (Pinocchio).
//!
//! 1. The body: the largest cluster of the mesh (`body_part`) and its distance field
//!    (`voxel_grid`, `distance_field`).
//! 2. Its shape: distances through it (`geodesic`), tips (`tips`), medial samples (`medial_surface`),
//!    spheres and their graph (`sphere_graph`), the mirror plane (`symmetry`).
//! 3. The template: its joints (`joints`), limbs and trunk (`reduced_skeleton`).
//! 4. The discrete embedding: a best-first search (`embedding`) over penalties (`penalties`).
//! 5. Joints along the limbs' centrelines (`centreline`, `limbs`), then all at once (`refinement`).
//! 6. What is carried along (`carry`), no bone without length (`lengths`), and how well everything fits (`score`).
//!
//! Where the shape says nothing, or too little, the template is moved and scaled as a
//! whole (`template`).

mod body_part;
mod carry;
mod centreline;
mod choices;
mod distance_field;
mod embedding;
mod error;
mod fitted;
mod geodesic;
mod joints;
mod lengths;
mod limbs;
mod medial_surface;
mod penalties;
mod reduced_skeleton;
mod refinement;
mod score;
mod shape;
mod sphere_graph;
mod symmetry;
mod template;
#[cfg(test)]
mod test_bodies;
mod tips;
mod voxel_grid;

pub use choices::FitSettings;
pub use error::FitError;
pub use fitted::{FitMethod, FittedSkeleton, fit_skeleton};
