//! Surface weights extended to the vertices of a cage.
//!
//! For each bone the field w minimises the Dirichlet energy over the tetrahedra (linear finite
//! elements, so it is discretely harmonic away from the surface) plus the squared distance from the
//! surface's own weights where vertices are embedded: `(K + λ Bᵀ D B) w = λ Bᵀ D w_surface`, with K
//! the stiffness matrix, B the barycentric embedding and D giving every cell one vote, however many
//! vertices it holds. λ is `fidelity` times the mean diagonal of K.

use std::collections::BTreeMap;

use glam::DVec3;

use super::{CageError, Embedding, TetMesh};
use crate::linalg::{Cholesky, LinalgError, SymbolicCholesky, SymmetricMatrix};

/// Keeps the matrix regular where a part of the cage holds no vertex; relative to the mean diagonal.
const REGULARISATION: f64 = 1e-9;

/// An embedded surface vertex and its weights as `(column, weight)`.
pub type SurfaceWeights = (Embedding, Vec<(u32, f64)>);

/// Extends the weights of embedded surface vertices to all vertices of the cage, once for each
/// `fidelity`: high follows the surface closely, low is smoother. Returns, for each fidelity, one
/// row of `columns` weights for each cage vertex. Rows of a part of the cage without any surface
/// vertex are zero.
///
/// # Errors
/// [`CageError::Weights`] when the factorisation fails.
pub fn extend_weights(
    cage: &TetMesh,
    surface: &[SurfaceWeights],
    columns: usize,
    fidelities: &[f64],
) -> Result<Vec<Vec<Vec<f64>>>, CageError> {
    let size = cage.vertices().len();
    if size == 0 {
        return Ok(vec![Vec::new(); fidelities.len()]);
    }
    let stiffness = stiffness_triplets(cage);
    let scale =
        stiffness.iter().filter(|(row, column, _)| row == column).map(|t| t.2).sum::<f64>() / size as f64;
    let mut votes: BTreeMap<[u32; 4], u32> = BTreeMap::new();
    for (embedding, _) in surface {
        *votes.entry(embedding.corners).or_default() += 1;
    }
    let mut symbolic = None;
    let mut tables = Vec::with_capacity(fidelities.len());
    for fidelity in fidelities {
        let mut triplets = stiffness.clone();
        triplets.extend((0..size).map(|i| (i, i, REGULARISATION * scale)));
        let mut right_hand_sides = vec![0.0; size * columns];
        for (embedding, weights) in surface {
            let lambda = fidelity * scale / f64::from(votes[&embedding.corners]);
            let corners = || embedding.corners.iter().map(|&c| c as usize).zip(embedding.barycentric);
            for (i, (a, s)) in corners().enumerate() {
                triplets.extend(corners().skip(i).map(|(b, t)| (a, b, lambda * s * t)));
                for &(column, weight) in weights {
                    right_hand_sides[column as usize * size + a] += lambda * s * weight;
                }
            }
        }
        solve(size, &triplets, columns, &mut right_hand_sides, &mut symbolic)
            .map_err(|error| CageError::Weights(error.to_string()))?;
        let row = |i: usize| (0..columns).map(|column| right_hand_sides[column * size + i]).collect();
        tables.push((0..size).map(row).collect());
    }
    Ok(tables)
}

/// Solves in place; the patterns of all fidelities agree, so one analysis serves them.
fn solve(
    size: usize,
    triplets: &[(usize, usize, f64)],
    columns: usize,
    right_hand_sides: &mut [f64],
    symbolic: &mut Option<SymbolicCholesky>,
) -> Result<(), LinalgError> {
    let matrix = SymmetricMatrix::from_triplets(size, triplets)?;
    let symbolic = match symbolic {
        Some(symbolic) => symbolic,
        None => symbolic.insert(SymbolicCholesky::new(&matrix)?),
    };
    Cholesky::factor(symbolic, &matrix)?.solve_in_place(right_hand_sides, columns)
}

/// Stiffness matrix of linear finite elements, each pair of vertices once.
pub(crate) fn stiffness_triplets(cage: &TetMesh) -> Vec<(usize, usize, f64)> {
    let mut triplets = Vec::with_capacity(10 * cage.tetrahedra().len());
    for (t, corners) in cage.tetrahedra().iter().enumerate() {
        let gradients = shape_gradients(cage.corners(t));
        let volume = cage.volume(t);
        for i in 0..4 {
            for j in i..4 {
                let value = volume * gradients[i].dot(gradients[j]);
                triplets.push((corners[i] as usize, corners[j] as usize, value));
            }
        }
    }
    triplets
}

/// Gradients of the four barycentric coordinates.
fn shape_gradients(p: [DVec3; 4]) -> [DVec3; 4] {
    let (a, b, c) = (p[1] - p[0], p[2] - p[0], p[3] - p[0]);
    let six_volumes = a.cross(b).dot(c);
    let (ga, gb, gc) = (b.cross(c) / six_volumes, c.cross(a) / six_volumes, a.cross(b) / six_volumes);
    [-(ga + gb + gc), ga, gb, gc]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cage::{BccLattice, LatticeCage, Membership, WindingNumber, embed, tetrahedralize};
    use crate::mesh::TriangleMesh;

    /// A box of 2 × 1 × 1.
    fn cuboid() -> TriangleMesh {
        let vertices =
            (0..8).map(|i| DVec3::new(f64::from(i & 1) * 2.0, f64::from(i >> 1 & 1), f64::from(i >> 2 & 1)));
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        TriangleMesh::new(vertices.collect(), triangles.collect()).unwrap()
    }

    fn cage_of(mesh: &TriangleMesh, cell: f64) -> LatticeCage {
        let everywhere = vec![Membership::Inside; mesh.triangles().len()];
        let lattice = BccLattice::new(DVec3::ZERO, cell);
        LatticeCage::new(mesh, &WindingNumber::new(mesh), lattice, &everywhere, &|_| true).unwrap()
    }

    #[test]
    fn gradients_of_a_linear_function_are_exact() {
        let cage = tetrahedralize(&cuboid(), Some(0.5)).unwrap();
        let normal = DVec3::new(0.3, -1.2, 0.7);
        for t in 0..cage.tetrahedra().len() {
            let p = cage.corners(t);
            let gradient: DVec3 = shape_gradients(p).iter().zip(p).map(|(&g, q)| g * normal.dot(q)).sum();
            assert!(gradient.distance(normal) < 1e-12);
        }
    }

    #[test]
    fn weights_sum_to_one_and_follow_the_surface() {
        let mesh = cuboid();
        let cage = cage_of(&mesh, 0.4);
        let surface: Vec<SurfaceWeights> = mesh
            .vertices()
            .iter()
            .map(|&v| (embed(&cage.lattice, &cage.index_of, v).unwrap(), vec![(u32::from(v.x > 1.0), 1.0)]))
            .collect();
        let tables = extend_weights(&cage.mesh, &surface, 2, &[100.0, 0.01]).unwrap();
        let misfit = |table: &Vec<Vec<f64>>| -> f64 {
            let at = |e: &Embedding, column: usize| -> f64 {
                e.corners.iter().zip(e.barycentric).map(|(&c, b)| table[c as usize][column] * b).sum()
            };
            surface.iter().map(|(e, w)| (at(e, w[0].0 as usize) - 1.0).abs()).fold(0.0, f64::max)
        };
        for table in &tables {
            assert!(table.iter().all(|row| (row[0] + row[1] - 1.0).abs() < 1e-4));
        }
        assert!(misfit(&tables[0]) < 0.05, "{}", misfit(&tables[0]));
        assert!(misfit(&tables[1]) > misfit(&tables[0]), "low fidelity is smoother");
    }

    #[test]
    fn an_empty_cage_has_no_weights() {
        assert_eq!(extend_weights(&TetMesh::default(), &[], 3, &[1.0]), Ok(vec![vec![]]));
    }
}
