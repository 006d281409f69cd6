//! The quadratic form of biharmonic smoothness, A · uᵀ K M⁻¹ K u: K the robust stiffness matrix, M
//! the lumped areas and A their sum. It measures A ∫ |Δu|² and depends neither on the unit nor on
//! how fine the mesh is.
//!
//! Seams that only an export had opened are closed first: a vertex that another one stands for has
//! no row of its own. Neither has a vertex without area; the form is zero there.

use rayon::prelude::*;

use crate::linalg::{Cholesky, LinalgError, SymbolicCholesky, SymmetricMatrix};
use crate::mesh::{TriangleMesh, weld_seams};
use crate::spectral::{Laplacian, SpectralError};

/// Least area of a vertex in M⁻¹, as a share of the mean: smaller ones would swamp all others.
const LEAST_AREA: f64 = 1e-4;

/// Shares of the diagonal that are added, one after the other, to a matrix that rounding made
/// indefinite.
const SHIFTS: [f64; 4] = [1e-13, 1e-11, 1e-9, 1e-7];

/// Biharmonic smoothness of functions on a surface.
#[derive(Debug, Clone)]
pub struct Bilaplacian {
    /// The surface with its seams closed; vertices keep their numbers.
    pub welded: TriangleMesh,
    /// Vertex that stands for each vertex (V).
    pub stands_for: Vec<u32>,
    /// The form (V×V); its pattern is the two-ring, and the corners of the joined triangles.
    pub form: SymmetricMatrix,
    /// Area of each vertex as a share of the whole (V); 0 for a vertex without a row.
    pub shares: Vec<f64>,
    /// Area of the surface, in square units.
    pub area: f64,
    /// Component of each vertex of the welded surface (V).
    pub components: Vec<u32>,
    /// Number of components.
    pub component_count: usize,
}

impl Bilaplacian {
    /// Builds the form. The corners of every triangle in `joined` get entries in the pattern, so
    /// that a term that couples them can be added later.
    ///
    /// # Errors
    /// [`SpectralError::Mesh`] for a mesh without surface.
    pub fn new(mesh: &TriangleMesh, joined: &[u32]) -> Result<Self, SpectralError> {
        let stands_for = weld_seams(mesh);
        let triangles = mesh.triangles().iter().map(|t| t.map(|v| stands_for[v as usize])).collect();
        let welded = TriangleMesh::new(mesh.vertices().to_vec(), triangles)?;
        let Laplacian { stiffness, areas } = Laplacian::new(&welded)?;
        let area: f64 = areas.iter().sum();
        let occupied = areas.iter().filter(|&&a| a > 0.0).count().max(1);
        let least = LEAST_AREA * area / occupied as f64;
        let mut triplets: Vec<(usize, usize, f64)> = (0..areas.len())
            .into_par_iter()
            .flat_map_iter(|k| products(&stiffness, k, area / areas[k].max(least)))
            .collect();
        for &t in joined {
            let [a, b, c] = welded.triangles()[t as usize].map(|v| v as usize);
            triplets.extend([(a, b, 0.0), (b, c, 0.0), (c, a, 0.0)]);
        }
        let form = SymmetricMatrix::from_triplets(areas.len(), &triplets)?;
        let shares = areas.iter().map(|a| a / area).collect();
        let topology = welded.topology();
        Ok(Self {
            stands_for,
            form,
            shares,
            area,
            components: topology.components().to_vec(),
            component_count: topology.component_count(),
            welded,
        })
    }

    /// Number of vertices.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.shares.len()
    }
}

/// The products of the entries of one column of K, each pair once.
fn products(stiffness: &SymmetricMatrix, column: usize, scale: f64) -> Vec<(usize, usize, f64)> {
    let (rows, values) = stiffness.column(column);
    let mut products = Vec::with_capacity(rows.len() * (rows.len() + 1) / 2);
    for (at, (&a, x)) in rows.iter().zip(values).enumerate() {
        products.extend(rows[at..].iter().zip(&values[at..]).map(|(&b, y)| (a, b, scale * x * y)));
    }
    products
}

/// Factors a matrix that is positive definite but for rounding.
///
/// # Errors
/// [`LinalgError`] when the matrix is indefinite beyond rounding.
pub fn factor(symbolic: &SymbolicCholesky, matrix: &SymmetricMatrix) -> Result<Cholesky, LinalgError> {
    let mut outcome = Cholesky::factor(symbolic, matrix);
    for shift in SHIFTS {
        if !matches!(outcome, Err(LinalgError::NotPositiveDefinite { .. })) {
            break;
        }
        outcome = Cholesky::factor(symbolic, &matrix.add_scaled_diagonal(shift, &matrix.diagonal())?);
    }
    outcome
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::test_surfaces::{icosphere, scaled};

    fn energy(form: &SymmetricMatrix, u: &[f64]) -> f64 {
        form.mul_vec(u).unwrap().iter().zip(u).map(|(a, b)| a * b).sum()
    }

    #[test]
    fn first_harmonics_of_a_sphere_have_their_eigenvalue() {
        // Δz = −2 z on the unit sphere: A ∫ |Δz|² = 4π · 4 · 4π/3, at any size of the mesh.
        let exact = 4.0 * (4.0 * std::f64::consts::PI).powi(2) / 3.0;
        for (level, tolerance) in [(2, 0.06), (3, 0.02)] {
            let sphere = icosphere(level);
            let form = Bilaplacian::new(&sphere, &[]).unwrap().form;
            let z: Vec<f64> = sphere.vertices().iter().map(|p| p.z).collect();
            assert!((energy(&form, &z) / exact - 1.0).abs() < tolerance, "{}", energy(&form, &z) / exact);
            let far = Bilaplacian::new(&scaled(&sphere, 1e3), &[]).unwrap().form;
            assert!((energy(&far, &z) / energy(&form, &z) - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn constants_are_smooth() {
        let form = Bilaplacian::new(&icosphere(2), &[0, 5]).unwrap().form;
        let ones = vec![1.0; form.size()];
        assert!(form.mul_vec(&ones).unwrap().iter().all(|x| x.abs() < 1e-9));
    }
}
