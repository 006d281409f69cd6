//! Which bone a random walk through the body meets first: for each bone a harmonic field that is 1
//! on the bone, 0 on the others, and whose flow stops at the surface.
//!
//! A walk that starts in the chin stays in the head, since the way down through the neck is narrow.
//! A distance does not know that; it gives the chin to the neck.

use crate::cage::{LatticeCage, stiffness_triplets};
use crate::linalg::{Cholesky, LinalgError, SymbolicCholesky, SymmetricMatrix};

use super::geodesic::Entrance;

/// Cage vertices this near to a bone, in cells, are on it.
const ON_BONE: f64 = 0.6;
/// Bones whose distances differ by less, in cells, are equally near: both ends of a joint.
const EQUALLY_NEAR: f64 = 1e-3;
/// How strongly a bone holds a walk that touches it, relative to the mean diagonal.
const HOLD: f64 = 1e3;
/// A bone outside of the body holds less, the farther it is; relative to the mean diagonal.
const HOLD_OUTSIDE: f64 = 1.0;
/// Keeps the matrix regular where a part of the cage meets no bone; relative to the mean diagonal.
const REGULARISATION: f64 = 1e-8;

/// Chance (B) of every cage vertex to meet each bone first, empty for a bone without an entrance.
///
/// # Errors
/// [`LinalgError`] when the factorisation fails.
pub(super) fn first_met(cage: &LatticeCage, entrances: &[Entrance]) -> Result<Vec<Vec<f64>>, LinalgError> {
    let size = cage.mesh.vertices().len();
    let mut triplets = stiffness_triplets(&cage.mesh);
    let scale = triplets.iter().filter(|t| t.0 == t.1).map(|t| t.2).sum::<f64>() / size.max(1) as f64;
    triplets.extend((0..size).map(|i| (i, i, REGULARISATION * scale)));
    let columns: Vec<usize> = (0..entrances.len()).filter(|&bone| !entrances[bone].is_empty()).collect();
    let mut right_hand_sides = vec![0.0; size * columns.len()];
    for (vertex, bone, hold) in holds(cage, entrances) {
        triplets.push((vertex, vertex, hold * scale));
        let column = columns.partition_point(|&c| c < bone);
        right_hand_sides[column * size + vertex] += hold * scale;
    }
    let matrix = SymmetricMatrix::from_triplets(size, &triplets)?;
    drop(triplets);
    let cholesky = Cholesky::factor(&SymbolicCholesky::new(&matrix)?, &matrix)?;
    cholesky.solve_in_place(&mut right_hand_sides, columns.len())?;
    let mut chances = vec![Vec::new(); entrances.len()];
    for (chance, &bone) in right_hand_sides.chunks_exact(size.max(1)).zip(&columns) {
        chances[bone] = chance.to_vec();
    }
    Ok(chances)
}

/// Cage vertices that are on a bone: `(vertex, bone, strength)`. Each goes to its nearest bone, in
/// equal parts where several are equally near; a bone that gets none this way shares its nearest.
fn holds(cage: &LatticeCage, entrances: &[Entrance]) -> Vec<(usize, usize, f64)> {
    let on_bone = ON_BONE * cage.lattice.cell_size();
    let equal = EQUALLY_NEAR * cage.lattice.cell_size();
    let mut owners: Vec<Vec<(usize, f64)>> = vec![Vec::new(); cage.mesh.vertices().len()];
    for (bone, entrance) in entrances.iter().enumerate() {
        for &(vertex, distance) in entrance.iter().filter(|entry| entry.1 < on_bone) {
            owners[vertex as usize].push((bone, distance));
        }
    }
    let mut has_vertex = vec![false; entrances.len()];
    let mut holds = Vec::new();
    for (vertex, owners) in owners.iter_mut().enumerate() {
        let nearest = owners.iter().map(|owner| owner.1).fold(f64::INFINITY, f64::min);
        owners.retain(|owner| owner.1 <= nearest + equal);
        for &(bone, _) in owners.iter() {
            has_vertex[bone] = true;
            holds.push((vertex, bone, HOLD / owners.len() as f64));
        }
    }
    for (bone, entrance) in entrances.iter().enumerate().filter(|(bone, _)| !has_vertex[*bone]) {
        let Some(nearest) = entrance.iter().map(|entry| entry.1).min_by(f64::total_cmp) else { continue };
        // Everything about as near as the nearest: the whole length of a bone beside a sheet.
        for &(vertex, distance) in entrance.iter().filter(|entry| entry.1 <= nearest + on_bone) {
            let strength = match distance < on_bone {
                true => HOLD,
                false => HOLD_OUTSIDE * (on_bone / distance).powi(2),
            };
            holds.push((vertex as usize, bone, strength));
        }
    }
    holds
}
