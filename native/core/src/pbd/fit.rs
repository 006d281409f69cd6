//! Where a cage speaks for its surface, and where it does not.
//!
//! A cell that spans a gap, such as the one between two lips, welds what has to move apart. It shows
//! in the weights: even those that follow the surface closely cannot be those of both sides. Around
//! such vertices the surface fades into plain skinning.

use std::collections::BTreeMap;

use super::masks::geodesic_distances;
use super::patch::{PatchInput, Rows, smoothstep};
use crate::cage::Embedding;

/// Difference between a vertex's own weights and those of its cell (half the sum of absolute
/// differences) from which on the cage does not speak for the vertex.
const WORST_MISFIT: f64 = 0.35;
/// Width of the fade around such vertices, in cells.
const FADE_CELLS: f64 = 1.5;

/// How far the cage speaks for each vertex (V), from 0 to 1, judged by the `faithful` weights of its
/// particles.
pub(super) fn cage_fit(
    input: &PatchInput<'_>,
    faithful: &Rows,
    embeddings: &[Option<Embedding>],
    cell_size: f64,
) -> Vec<f64> {
    let welded = embeddings.iter().enumerate().filter(|(vertex, embedding)| {
        embedding.is_some_and(|embedding| misfit(input, faithful, *vertex, &embedding) > WORST_MISFIT)
    });
    let width = FADE_CELLS * cell_size;
    let welded = welded.map(|(vertex, _)| vertex);
    geodesic_distances(input.mesh, input.adjacency, welded, width)
        .into_iter()
        .map(|distance| distance.map_or(1.0, |d| smoothstep(d / width)))
        .collect()
}

fn misfit(input: &PatchInput<'_>, rows: &Rows, vertex: usize, embedding: &Embedding) -> f64 {
    let mut difference: BTreeMap<u32, f64> = BTreeMap::new();
    for (bone, weight) in input.weights.entries(vertex) {
        *difference.entry(bone).or_default() += f64::from(weight);
    }
    for (&corner, share) in embedding.corners.iter().zip(embedding.barycentric) {
        for &(bone, weight) in &rows[corner as usize] {
            *difference.entry(bone).or_default() -= share * weight;
        }
    }
    0.5 * difference.values().map(|d| d.abs()).sum::<f64>()
}
