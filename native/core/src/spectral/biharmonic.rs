//! Biharmonic distance (section 5.1, eq. 17–19; Lipman, Rustamov, Funkhouser 2010).
//!
//! Distances from one vertex are exact: a column of the Green's function by two sparse solves.
//! Distances of arbitrary pairs come from a truncated eigenbasis, O(eigenpairs) each, with an
//! estimate of what the truncation leaves out. Vertices of different pieces have no path over the
//! surface: their distance is infinite. Distances scale with the mesh's unit.

use rayon::prelude::*;

use super::SpectralError;
use super::embedding::Embedding;
use super::exact_distance::ExactDistance;
use super::tail::TailCorrelation;
use crate::mesh::TriangleMesh;
use crate::progress::Progress;

/// Biharmonic distance on the pieces of a surface.
pub struct BiharmonicDistance {
    exact: ExactDistance,
    embeddings: Vec<Embedding>,
    correlation: TailCorrelation,
}

impl BiharmonicDistance {
    /// Prepares a surface with up to `eigenpairs` non-zero eigenpairs for each of its pieces.
    ///
    /// # Errors
    /// [`SpectralError`] when the mesh has no surface, the eigen solve does not reach its
    /// residual bound, or `progress` was cancelled.
    pub fn new(mesh: &TriangleMesh, eigenpairs: usize, progress: &Progress) -> Result<Self, SpectralError> {
        let exact = ExactDistance::new(mesh)?;
        progress.report(0.1)?;
        let mut positions: Vec<Vec<_>> = exact.components.iter().map(|_| Vec::new()).collect();
        for (place, &position) in exact.places.iter().zip(mesh.vertices()) {
            if let Some((piece, _)) = place {
                positions[*piece as usize].push(position);
            }
        }
        let total: usize = positions.iter().map(Vec::len).sum();
        let mut embeddings = Vec::with_capacity(exact.components.len());
        let mut done = 0;
        for (component, positions) in exact.components.iter().zip(positions) {
            let vertex_count = component.vertex_count();
            let mut report = |share: f64| {
                let done = (done as f64 + share * vertex_count as f64) / total as f64;
                progress.report(0.1 + 0.9 * done).is_ok()
            };
            embeddings.push(Embedding::new(component, positions, eigenpairs, &mut report)?);
            done += vertex_count;
        }
        progress.report(1.0)?;
        Ok(Self { exact, embeddings, correlation: TailCorrelation::new() })
    }

    /// Number of vertices of the mesh.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.exact.vertex_count()
    }

    /// Non-zero eigenvalues of all pieces, ascending; unit: one over area.
    #[must_use]
    pub fn eigenvalues(&self) -> Vec<f64> {
        let mut values: Vec<f64> =
            self.embeddings.iter().flat_map(|embedding| embedding.eigenvalues.iter().copied()).collect();
        values.sort_by(f64::total_cmp);
        values
    }

    /// Distance of two vertices by the truncated eigenbasis; infinite between pieces.
    ///
    /// # Panics
    /// When a vertex does not exist; see [`BiharmonicDistance::between`] for unchecked input.
    #[must_use]
    pub fn pair(&self, i: usize, j: usize) -> f64 {
        match (self.exact.places[i], self.exact.places[j]) {
            _ if i == j => 0.0,
            (Some((a, x)), Some((b, y))) if a == b => {
                self.embeddings[a as usize].distance(x, y, &self.correlation)
            }
            _ => f64::INFINITY,
        }
    }

    /// Distances of vertex pairs by the truncated eigenbasis; infinite between pieces.
    ///
    /// # Errors
    /// [`SpectralError`] when the lists differ in length or name a vertex that does not exist.
    pub fn between(&self, i: &[i64], j: &[i64]) -> Result<Vec<f64>, SpectralError> {
        if i.len() != j.len() {
            return Err(SpectralError::PairCounts { first: i.len(), second: j.len() });
        }
        let (i, j) = (self.exact.check(i)?, self.exact.check(j)?);
        Ok(i.par_iter().zip(&j).map(|(&i, &j)| self.pair(i, j)).collect())
    }

    /// Exact distances of every vertex (V) to one vertex; infinite on other pieces.
    ///
    /// # Errors
    /// [`SpectralError`] when the vertex does not exist or the factorisation breaks down.
    pub fn from_vertex(&self, vertex: i64) -> Result<Vec<f64>, SpectralError> {
        self.exact.from_vertex(vertex)
    }

    /// The exact distances alone.
    #[must_use]
    pub fn exact(&self) -> &ExactDistance {
        &self.exact
    }
}
