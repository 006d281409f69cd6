//! The smooth falloff between bones: labels diffused over the surface, farther where the bone lies
//! deeper.
//!
//! Solves `(M/(k r²) + L) W = M/(k r²) S`: L the robust Laplacian, M the areas, r the distance to the
//! nearest bone, S the labels. Rows of W stay positive and sum to 1, since L has constants in its
//! kernel and no positive off-diagonal entry.

use crate::linalg::{Cholesky, LinalgError, SymbolicCholesky};
use crate::mesh::TriangleMesh;
use crate::progress::{Cancelled, Progress};
use crate::skinning::{Row, normalized};
use crate::spectral::Laplacian;

use super::labels::Labels;

/// Width of the falloff: k, in squared distances to the bone.
const WIDTH: f64 = 0.1;
/// Distances to the bone are at least this share of the mesh's length.
const SMALLEST_DISTANCE: f64 = 1e-4;
/// Pull of vertices without a label, relative to the mean diagonal: only what keeps the matrix regular.
const REGULARISATION: f64 = 1e-10;
/// Weights below this are left out.
const SMALLEST_WEIGHT: f64 = 1e-3;
/// Right-hand sides of one solve; more would only need memory.
const COLUMNS: usize = 32;

/// Smoothed rows; vertices whose whole component has no label keep an empty row. Where the surface
/// has no area, or the solve fails, the labels themselves.
pub(super) fn smoothed(
    mesh: &TriangleMesh,
    labels: Labels,
    bone_count: usize,
    progress: &Progress,
) -> Result<Vec<Row>, Cancelled> {
    let Ok(laplacian) = Laplacian::new(mesh) else { return Ok(labels.rows) };
    progress.report(0.2)?;
    let Ok((cholesky, pull)) = factored(&laplacian, &labels) else { return Ok(labels.rows) };
    progress.report(0.5)?;
    let size = labels.rows.len();
    let mut by_bone = vec![Vec::new(); bone_count];
    for (vertex, row) in labels.rows.iter().enumerate() {
        for &(bone, share) in row {
            by_bone[bone as usize].push((vertex, share));
        }
    }
    let bones: Vec<usize> = (0..bone_count).filter(|&bone| !by_bone[bone].is_empty()).collect();
    let mut rows = vec![Row::new(); size];
    for (batch, chunk) in bones.chunks(COLUMNS).enumerate() {
        let mut block = vec![0.0; size * chunk.len()];
        for (column, &bone) in block.chunks_exact_mut(size).zip(chunk) {
            by_bone[bone].iter().for_each(|&(vertex, share)| column[vertex] = pull[vertex] * share);
        }
        if cholesky.solve_in_place(&mut block, chunk.len()).is_err() {
            return Ok(labels.rows);
        }
        for (column, &bone) in block.chunks_exact(size).zip(chunk) {
            for (row, &weight) in rows.iter_mut().zip(column) {
                if weight >= SMALLEST_WEIGHT {
                    row.push((bone as u32, weight));
                }
            }
        }
        progress.report(0.5 + 0.5 * (batch + 1) as f64 / bones.len().div_ceil(COLUMNS) as f64)?;
    }
    for (row, label) in rows.iter_mut().zip(labels.rows) {
        *row = normalized(if row.is_empty() { label } else { std::mem::take(row) });
    }
    Ok(rows)
}

/// The factor of the left-hand side, and what the labels are multiplied by (V).
fn factored(laplacian: &Laplacian, labels: &Labels) -> Result<(Cholesky, Vec<f64>), LinalgError> {
    let diagonal = laplacian.stiffness.diagonal();
    let size = diagonal.len();
    let mean = diagonal.iter().sum::<f64>() / size.max(1) as f64;
    let pull: Vec<f64> = (0..size)
        .map(|v| match labels.rows[v].is_empty() {
            true => 0.0,
            false => laplacian.areas[v] / (WIDTH * labels.distances[v].max(SMALLEST_DISTANCE).powi(2)),
        })
        .collect();
    let shift: Vec<f64> = (0..size).map(|v| pull[v].max(REGULARISATION * mean)).collect();
    let matrix = laplacian.stiffness.add_scaled_diagonal(1.0, &shift)?;
    Ok((Cholesky::factor(&SymbolicCholesky::new(&matrix)?, &matrix)?, pull))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// A strip of n squares along X.
    fn strip(n: u32) -> TriangleMesh {
        let vertices = (0..=n).flat_map(|i| [0.0, 1.0].map(|y| DVec3::new(f64::from(i), y, 0.0))).collect();
        let squares = (0..n).map(|i| 2 * i);
        TriangleMesh::new(
            vertices,
            squares.flat_map(|i| [[i, i + 2, i + 1], [i + 1, i + 2, i + 3]]).collect(),
        )
        .unwrap()
    }

    #[test]
    fn the_falloff_is_as_wide_as_the_bone_is_deep() {
        let mesh = strip(40);
        let width = |depth: f64| {
            let rows = mesh.vertices().iter().map(|v| vec![(u32::from(v.x > 20.0), 1.0)]).collect();
            let labels = Labels { rows, distances: vec![depth; mesh.vertex_count()] };
            let rows = smoothed(&mesh, labels, 2, &Progress::new()).unwrap();
            for row in &rows {
                assert!((row.iter().map(|entry| entry.1).sum::<f64>() - 1.0).abs() < 1e-12);
                assert!(row.iter().all(|entry| entry.1 > 0.0));
            }
            rows.iter().filter(|row| row.iter().all(|entry| entry.1 < 0.98)).count()
        };
        assert!(width(6.0) > 2 * width(2.0), "{} {}", width(6.0), width(2.0));
    }

    #[test]
    fn an_unlabelled_component_stays_empty_and_an_unlabelled_vertex_is_filled() {
        let mut vertices = strip(2).vertices().to_vec();
        let mut triangles = strip(2).triangles().to_vec();
        triangles.extend(strip(2).triangles().iter().map(|t| t.map(|v| v + 6)));
        vertices.extend(strip(2).vertices().iter().map(|v| v + DVec3::Z * 9.0));
        let mesh = TriangleMesh::new(vertices, triangles).unwrap();
        let rows = (0..12).map(|v| if v < 5 { vec![(3, 1.0)] } else { vec![] }).collect();
        let labels = Labels { rows, distances: vec![1.0; 12] };
        let rows = smoothed(&mesh, labels, 4, &Progress::new()).unwrap();
        assert!(rows[..6].iter().all(|row| row.len() == 1 && row[0] == (3, 1.0)), "{rows:?}");
        assert!(rows[6..].iter().all(Vec::is_empty), "{rows:?}");
    }
}
