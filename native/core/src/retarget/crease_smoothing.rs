//! Smoothing around what inpainting has filled: it takes away the crease at the border of a hole, and moves
//! nothing else.

use rayon::prelude::*;

use crate::mesh::Adjacency;
use crate::progress::Progress;
use crate::skinning::{Row, blend, normalized};
use crate::spectral::SpectralError;

/// How far one round of smoothing moves a filled row towards its neighbours.
const STEP: f64 = 0.2;
/// Rings of known rows around a hole that are smoothed too, less and less.
const RINGS: u32 = 2;

/// Moves the rows in and around the holes towards the mean of their neighbours.
pub(super) fn smooth(
    adjacency: &Adjacency,
    known: &[bool],
    rows: &mut [Row],
    rounds: u32,
    progress: &Progress,
) -> Result<(), SpectralError> {
    let steps = steps(adjacency, known, rows);
    for round in 0..rounds {
        progress.report(0.8 + 0.2 * f64::from(round) / f64::from(rounds))?;
        let moved: Vec<Row> = steps
            .par_iter()
            .map(|&(v, step)| {
                let around = mean(adjacency.neighbours(v).iter().map(|&n| &rows[n as usize]));
                let share = if around.is_empty() { 0.0 } else { step };
                blend([(&rows[v], 1.0 - share), (&around, share)].into_iter())
            })
            .collect();
        for (&(v, _), row) in steps.iter().zip(moved) {
            rows[v] = row;
        }
    }
    Ok(())
}

/// Vertices to smooth and how far: filled ones, and known ones a few rings around.
fn steps(adjacency: &Adjacency, known: &[bool], rows: &[Row]) -> Vec<(usize, f64)> {
    let mut ring: Vec<Option<u32>> =
        known.iter().zip(rows).map(|(known, row)| (!known && !row.is_empty()).then_some(0)).collect();
    for step in 1..=RINGS {
        let next: Vec<usize> = (0..rows.len())
            .filter(|&v| ring[v].is_none() && !rows[v].is_empty())
            .filter(|&v| adjacency.neighbours(v).iter().any(|&n| ring[n as usize] == Some(step - 1)))
            .collect();
        next.into_iter().for_each(|v| ring[v] = Some(step));
    }
    let share = |ring: u32| STEP * f64::from(RINGS + 1 - ring) / f64::from(RINGS + 1);
    ring.iter().enumerate().filter_map(|(v, ring)| Some((v, share((*ring)?)))).collect()
}

/// Mean of the rows that are not empty.
pub(super) fn mean<'a>(rows: impl Iterator<Item = &'a Row>) -> Row {
    normalized(blend(rows.map(|row| (row, 1.0))))
}
