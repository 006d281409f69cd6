//! Closed surfaces with cotangent Laplacians, and dense oracles.

use std::collections::HashMap;
use std::f64::consts::TAU;

use dermis::linalg::SymmetricMatrix;
use nalgebra::{DMatrix, DVector, Vector3};
use proptest::prelude::*;

pub(crate) struct Surface {
    pub(crate) vertices: Vec<Vector3<f64>>,
    pub(crate) triangles: Vec<[usize; 3]>,
}

/// An octahedron, subdivided and projected to the unit sphere.
pub(crate) fn sphere(subdivisions: usize) -> Surface {
    let mut vertices =
        vec![Vector3::x(), Vector3::y(), Vector3::z(), -Vector3::x(), -Vector3::y(), -Vector3::z()];
    let mut triangles = Vec::new();
    for (x, y, z) in [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2)] {
        triangles.push([x, y, z]);
        triangles.push([y, x, 5]);
    }
    for _ in 0..subdivisions {
        let mut middles = HashMap::new();
        let mut middle = |a: usize, b: usize| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                vertices.push((vertices[a] + vertices[b]).normalize());
                vertices.len() - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    Surface { vertices, triangles }
}

/// A torus with radii 1 and 0.4. `warp` moves the grid lines along the ring.
pub(crate) fn torus(around: usize, across: usize, warp: impl Fn(f64) -> f64) -> Surface {
    let mut surface = Surface { vertices: Vec::new(), triangles: Vec::new() };
    for i in 0..around {
        for j in 0..across {
            let (u, v) = (TAU * warp(i as f64 / around as f64), TAU * j as f64 / across as f64);
            let radius = 1.0 + 0.4 * v.cos();
            surface.vertices.push(Vector3::new(radius * u.cos(), radius * u.sin(), 0.4 * v.sin()));
            let (next_i, next_j) = ((i + 1) % around, (j + 1) % across);
            let corner = |i: usize, j: usize| i * across + j;
            surface.triangles.push([corner(i, j), corner(next_i, j), corner(next_i, next_j)]);
            surface.triangles.push([corner(i, j), corner(next_i, next_j), corner(i, next_j)]);
        }
    }
    surface
}

/// Two surfaces side by side, without a common vertex.
pub(crate) fn both(first: Surface, second: &Surface) -> Surface {
    let offset = first.vertices.len();
    let Surface { mut vertices, mut triangles } = first;
    vertices.extend(&second.vertices);
    triangles.extend(second.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + offset)));
    Surface { vertices, triangles }
}

/// Cotangent Laplacian (positive semi-definite) and lumped masses.
pub(crate) fn laplacian(surface: &Surface) -> (SymmetricMatrix, Vec<f64>) {
    let size = surface.vertices.len();
    let mut triplets = Vec::new();
    let mut mass = vec![0.0; size];
    for triangle in &surface.triangles {
        for corner in 0..3 {
            let [at, left, right] = [0, 1, 2].map(|step| triangle[(corner + step) % 3]);
            let (a, b) = (
                surface.vertices[left] - surface.vertices[at],
                surface.vertices[right] - surface.vertices[at],
            );
            let double_area = a.cross(&b).norm();
            let weight = 0.5 * a.dot(&b) / double_area;
            triplets.extend([(left, right, -weight), (left, left, weight), (right, right, weight)]);
            mass[at] += double_area / 6.0;
        }
    }
    (SymmetricMatrix::from_triplets(size, &triplets).unwrap(), mass)
}

pub(crate) fn dense(matrix: &SymmetricMatrix) -> DMatrix<f64> {
    let mut dense = DMatrix::zeros(matrix.size(), matrix.size());
    for column in 0..matrix.size() {
        let (rows, values) = matrix.column(column);
        for (&row, &value) in rows.iter().zip(values) {
            dense[(row, column)] = value;
        }
    }
    dense
}

/// All eigenvalues of `A x = λ M x`, ascending, by nalgebra.
pub(crate) fn dense_eigenvalues(matrix: &SymmetricMatrix, mass: &[f64]) -> Vec<f64> {
    let scale = DMatrix::from_diagonal(&DVector::from_iterator(
        mass.len(),
        mass.iter().map(|mass| 1.0 / mass.sqrt()),
    ));
    let mut values: Vec<f64> =
        (&scale * dense(matrix) * &scale).symmetric_eigenvalues().iter().copied().collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Runs `work` on a pool of `threads` threads.
pub(crate) fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

/// Reproducible numbers in [-1, 1) without a generator.
pub(crate) fn noise(index: usize) -> f64 {
    let x = (index as f64 + 1.0) * 0.754_877_666_246_692_7;
    2.0 * (x - x.floor()) - 1.0
}

pub(crate) fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Positive definite matrices of random patterns, up to 40 rows.
pub(crate) fn patterns() -> impl Strategy<Value = SymmetricMatrix> {
    let edges = prop::collection::vec((0_usize..40, 0_usize..40, 0.1..2.0_f64), 0..80);
    (1_usize..40, edges).prop_map(|(size, edges)| {
        let mut triplets: Vec<_> = (0..size).map(|at| (at, at, 0.05)).collect();
        for (a, b, weight) in edges {
            let (a, b) = (a % size, b % size);
            if a != b {
                triplets.extend([(a, b, -weight), (a, a, weight), (b, b, weight)]);
            }
        }
        SymmetricMatrix::from_triplets(size, &triplets).unwrap()
    })
}
