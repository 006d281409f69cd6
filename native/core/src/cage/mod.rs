//! The cage: lattice tetrahedra around a surface, the surface's embedding in them, and weights
//! extended from the surface to the lattice.

mod embedding;
mod error;
mod harmonic;
mod lattice;
mod tet_mesh;
mod tetrahedralize;
mod winding_number;

pub use embedding::{Embedding, embed};
pub use error::CageError;
pub(crate) use harmonic::stiffness_triplets;
pub use harmonic::{SurfaceWeights, extend_weights};
pub use lattice::{BccLattice, LatticePoint};
pub use tet_mesh::TetMesh;
pub use tetrahedralize::{LatticeCage, Membership, default_cell_size, tetrahedralize};
pub use winding_number::WindingNumber;
