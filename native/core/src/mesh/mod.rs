//! Surfaces: triangles over shared vertices, their topology, and queries on them.
//!
//! Any polygon mesh is welcome: open, in pieces, non-manifold, with degenerate triangles. What
//! cannot be used (an index out of range, a coordinate that is not finite) is refused by name.

mod adjacency;
mod closest_point;
mod error;
mod outward_normals;
mod part_choice;
mod polygons;
mod submesh;
#[cfg(test)]
pub(crate) mod test_surfaces;
mod topology;
mod triangle_mesh;

pub use adjacency::Adjacency;
pub use closest_point::{ClosestPoint, RayHit, SurfaceQuery};
pub use error::MeshError;
pub use part_choice::{PartChoice, PartChoiceError, ResolvedChoice};
pub use polygons::triangulate_polygons;
pub use submesh::{Submesh, weld_seams};
pub use topology::Topology;
pub use triangle_mesh::TriangleMesh;
