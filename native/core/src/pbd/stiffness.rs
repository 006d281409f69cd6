//! A stiffness that varies over the surface: shares painted on its vertices, extended to the
//! tetrahedra of the cage.

use super::PbdError;
use crate::cage::{Embedding, LatticeCage, SurfaceWeights, extend_weights};

/// How closely the cage follows the painted shares.
const FIDELITY: f64 = 10.0;
/// Softest share: a spring of no stiffness has no compliance that could be written down.
const LEAST_SHARE: f32 = 1e-6;

/// Checks shares (V), 0 to 1, of an argument `name`.
///
/// # Errors
/// [`PbdError::Mismatch`] for another number of them, [`PbdError::Share`] naming the first vertex
/// whose share is out of range.
pub(super) fn check_shares(name: &'static str, shares: &[f32], vertex_count: usize) -> Result<(), PbdError> {
    if shares.len() != vertex_count {
        return Err(PbdError::Mismatch {
            element: "vertices",
            left: "mesh",
            left_count: vertex_count,
            right: name,
            right_count: shares.len(),
        });
    }
    match shares.iter().position(|share| !(0.0..=1.0).contains(share)) {
        Some(vertex) => Err(PbdError::Share { name, vertex, share: shares[vertex] }),
        None => Ok(()),
    }
}

/// Shares of all vertices of a cage, extended harmonically from the embedded surface vertices; 1
/// where no surface vertex is near.
///
/// # Errors
/// [`PbdError::Cage`] when the factorisation fails.
pub(super) fn particle_shares(
    cage: &LatticeCage,
    embeddings: &[Option<Embedding>],
    shares: &[f32],
) -> Result<Vec<f32>, PbdError> {
    let painted: Vec<SurfaceWeights> = embeddings
        .iter()
        .zip(shares)
        .filter_map(|(embedding, &share)| {
            let share = f64::from(share);
            Some(((*embedding)?, vec![(0, share), (1, 1.0 - share)]))
        })
        .collect();
    let table = extend_weights(&cage.mesh, &painted, 2, &[FIDELITY])?;
    let share = |row: &Vec<f64>| {
        let sum = row[0] + row[1];
        if sum > 0.0 { (row[0] / sum) as f32 } else { 1.0 }
    };
    Ok(table.first().map_or_else(Vec::new, |rows| rows.iter().map(share).collect()))
}

/// Mean share of a tetrahedron's corners.
pub(super) fn tetrahedron_share(corners: [u32; 4], shares: &[f32]) -> f32 {
    (corners.map(|corner| shares[corner as usize]).iter().sum::<f32>() / 4.0).max(LEAST_SHARE)
}
