//! Which bone a vertex belongs to, softly: the bone that a walk from the vertex is likely to meet
//! first and that is near through the body.

use rayon::prelude::*;

use super::body::Body;
use super::sources::Source;
use crate::cage::LatticeCage;
use crate::rig::distance_to_segment;
use crate::skinning::{Row, normalized};

/// How much nearness counts beside the chance to be met first.
const NEARNESS: f64 = 3.0;
/// How decided the choice is: the larger, the narrower the belt of vertices between two bones.
const DECISION: f64 = 6.0;
/// Chances below this are rounding.
const SMALLEST_CHANCE: f64 = 1e-12;
/// Vertices nearer to a bone than this share of the mesh's length are on it.
const ON_BONE: f64 = 1e-4;
/// A path through the cage is at most this much longer than the straight line that it stands for,
/// as a share of it and in cells.
const DETOUR: f64 = 1.1;
const DETOUR_CELLS: f64 = 1.0;
/// About what a path gains at its ends, in cells.
const EXCESS_CELLS: f64 = 0.5;
/// Shares below this are left out.
const SMALLEST_SHARE: f64 = 1e-6;

/// What is known of each vertex before smoothing.
pub(super) struct Labels {
    /// Shares; empty for vertices that no bone reaches through the body.
    pub(super) rows: Vec<Row>,
    /// Distance to the nearest bone through the body.
    pub(super) distances: Vec<f64>,
}

/// Shares of every vertex of the body from the fields on its cage: for each bone (B) the chance to
/// be met first and the distance of every cage vertex. Where the way from a vertex to a bone is
/// straight, the straight distance to the bone's `sources` is finer than the cage's.
pub(super) fn labels(
    body: &Body,
    cage: &LatticeCage,
    sources: &[Source],
    chances: &[Vec<f64>],
    distances: &[Vec<f64>],
) -> Labels {
    let corners = cage.mesh.vertices();
    let cell = cage.lattice.cell_size();
    let mut of_bone: Vec<Vec<Source>> = vec![Vec::new(); distances.len()];
    sources.iter().for_each(|source| of_bone[source.bone as usize].push(*source));
    let (rows, distances) = body
        .mesh
        .vertices()
        .par_iter()
        .map(|&vertex| {
            let Some(at) = body.embed(vertex) else { return (Row::new(), f64::INFINITY) };
            let places = || at.corners.iter().map(|&c| c as usize).zip(at.barycentric);
            let mut nearest = f64::INFINITY;
            let mut scores = Vec::new();
            for (bone, (chance, distance)) in chances.iter().zip(distances).enumerate() {
                if chance.is_empty() || distance.is_empty() {
                    continue;
                }
                let chance: f64 = places().map(|(corner, share)| share * chance[corner]).sum();
                let distance = places()
                    .map(|(corner, _)| distance[corner] + corners[corner].distance(vertex))
                    .fold(f64::INFINITY, f64::min);
                if distance.is_finite() {
                    nearest = nearest.min(distance);
                    let straight = of_bone[bone]
                        .iter()
                        .map(|source| distance_to_segment(vertex, source.head, source.tail))
                        .fold(f64::INFINITY, f64::min);
                    let distance = through(distance, straight, cell);
                    let score = chance.max(SMALLEST_CHANCE).ln() - NEARNESS * distance.max(ON_BONE).ln();
                    scores.push((bone as u32, DECISION * score));
                }
            }
            (shares(scores), nearest)
        })
        .unzip();
    Labels { rows, distances }
}

/// Distance through the body from the length of the path through the cage and the straight line.
fn through(path: f64, straight: f64, cell: f64) -> f64 {
    match path <= DETOUR * straight + DETOUR_CELLS * cell {
        true => straight,
        false => straight.max(path - EXCESS_CELLS * cell),
    }
}

/// Shares from logarithms.
fn shares(mut scores: Row) -> Row {
    let best = scores.iter().map(|entry| entry.1).fold(f64::NEG_INFINITY, f64::max);
    scores.iter_mut().for_each(|entry| entry.1 = (entry.1 - best).exp());
    let mut shares = normalized(scores);
    shares.retain(|entry| entry.1 >= SMALLEST_SHARE);
    normalized(shares)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_way_has_its_straight_length() {
        assert_eq!(through(1.15, 1.0, 0.1), 1.0);
        assert_eq!(through(1.55, 1.0, 0.1), 1.5);
    }

    #[test]
    fn shares_sum_to_one_and_keep_the_order() {
        let row = shares(vec![(0, -700.0), (2, -700.7), (5, -900.0)]);
        assert_eq!(row.iter().map(|entry| entry.0).collect::<Vec<_>>(), [0, 2]);
        assert!((row.iter().map(|entry| entry.1).sum::<f64>() - 1.0).abs() < 1e-15);
        assert!((row[0].1 / row[1].1 - 0.7f64.exp()).abs() < 1e-12);
        assert_eq!(shares(vec![]), []);
    }
}
