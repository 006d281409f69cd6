//! The Laplace–Beltrami operator that survives bad meshes: cotangent weights on the intrinsic
//! Delaunay triangulation of the tufted cover, with lumped areas.
//!
//! After N. Sharp and K. Crane, "A Laplacian for nonmanifold triangle meshes", 2020. On a
//! well-shaped closed mesh this is the usual cotangent Laplacian; on any other it keeps its
//! properties: symmetric, positive semi-definite, constants in the kernel, no negative weight
//! beyond rounding.

use super::intrinsic::{IntrinsicTriangulation, Side};
use super::tufted_cover::tufted_cover;
use crate::linalg::SymmetricMatrix;
use crate::mesh::{MeshError, TriangleMesh};

/// Stiffness matrix and lumped vertex areas.
#[derive(Debug, Clone)]
pub struct Laplacian {
    /// Positive semi-definite stiffness matrix (V×V), no unit.
    pub stiffness: SymmetricMatrix,
    /// Lumped mass: the area that belongs to each vertex (V), square units; 0 for a loose vertex.
    pub areas: Vec<f64>,
}

impl Laplacian {
    /// Builds the operator of a mesh.
    ///
    /// # Errors
    /// [`MeshError::NoSurface`] when no triangle has three different vertices or all of them are
    /// one point.
    pub fn new(mesh: &TriangleMesh) -> Result<Self, MeshError> {
        let mut cover = tufted_cover(mesh);
        cover.flip_to_delaunay();
        Self::of_cover(&cover, mesh)
    }

    /// The plain cotangent Laplacian on the mesh's own edges, whose weights may be negative.
    ///
    /// # Errors
    /// As [`Laplacian::new`].
    pub fn cotangent(mesh: &TriangleMesh) -> Result<Self, MeshError> {
        Self::of_cover(&tufted_cover(mesh), mesh)
    }

    fn of_cover(cover: &IntrinsicTriangulation, mesh: &TriangleMesh) -> Result<Self, MeshError> {
        let mut areas = vec![0.0; mesh.vertex_count()];
        let mut diagonal = vec![0.0; mesh.vertex_count()];
        let mut entries = Vec::with_capacity(3 * cover.triangle_count() + mesh.vertex_count());
        for t in 0..cover.triangle_count() {
            // The cover has every triangle twice, hence the halves.
            let share = 0.5 * cover.area(t) / 3.0;
            for s in 0..3 {
                let side = Side::new(t, s);
                let (i, j) = (cover.corner(side) as usize, cover.corner(Side::new(t, s + 1)) as usize);
                areas[i] += share;
                let weight = 0.5 * 0.5 * cover.cotangent(side);
                if i != j && weight.is_finite() {
                    diagonal[i] += weight;
                    diagonal[j] += weight;
                    entries.push((i, j, -weight));
                }
            }
        }
        if areas.iter().all(|&area| area <= 0.0) {
            return Err(MeshError::NoSurface);
        }
        entries.extend(diagonal.into_iter().enumerate().map(|(i, weight)| (i, i, weight)));
        let stiffness = SymmetricMatrix::from_triplets(mesh.vertex_count(), &entries)
            .map_err(|_| MeshError::NoSurface)?;
        Ok(Self { stiffness, areas })
    }
}
