//! Algorithm 2 of the paper: match surfaces by their biharmonic distances to landmarks, then
//! interpolate weights.
//!
//! Two readings where the text is silent: eq. 22 compares the normalised vectors of eq. 20 and 21,
//! and "other four points" of eq. 23 are the second to fifth best match, because the best match is
//! the point x′ itself. A vertex whose distances agree with its match to the last digits takes that
//! match's weights unchanged.

use rayon::prelude::*;

use super::body::{Body, Pieces, pieces_with_landmarks};
use super::landmarks::{check_landmarks, landmarks_from_skeletons};
use super::loose_parts::follow;
use super::matching::{Descriptors, Match, best_matches};
use super::shepard::{NEIGHBOURS, shepard};
use super::{Character, Origin, RetargetError, Retargeted, Settings};
use crate::mesh::{MeshError, SurfaceQuery, TriangleMesh};
use crate::progress::Progress;
use crate::rig::{Skeleton, decompose};
use crate::skinning::SkinWeights;
use crate::spectral::{BiharmonicDistance, ExactDistance, SpectralError};

/// Vectors of normalised distances that differ by less than this are the same.
const EXACT: f64 = 1e-12;

pub(super) fn retarget(
    (source, source_weights): (Character<'_>, &SkinWeights),
    target: Character<'_>,
    bone_pairs: Option<&[Option<u32>]>,
    landmarks: Option<&[[i64; 2]]>,
    settings: &Settings,
    progress: &Progress,
) -> Result<Retargeted, RetargetError> {
    progress.begin("Reading the characters", 0.0, 0.05)?;
    let carries_weight = source_weights.used_bones();
    // Both skeletons in the source's numbering, so that ties are broken alike on either side.
    let paired_skeleton = match (source.skeleton, target.skeleton, bone_pairs) {
        (Some(from), Some(to), Some(pairs)) => Some((from, to.renumbered(from, pairs))),
        _ => None,
    };
    let (source_pieces, target_pieces) = (pieces("source", source.mesh)?, pieces("target", target.mesh)?);

    let given = match landmarks {
        Some(pairs) => check_landmarks(pairs, source.mesh.vertex_count(), target.mesh.vertex_count())?,
        None => Vec::new(),
    };
    let [on_source, on_target] = pieces_with_landmarks(&source_pieces, &target_pieces, &given)?;
    let source_body = body("source", source_pieces, on_source)?;
    let target_body = body("target", target_pieces, on_target)?;
    let pairs: Vec<[u32; 2]> = match (landmarks, &paired_skeleton) {
        (None, Some((from, to))) => landmarks_from_skeletons(
            (&source_body.surface.mesh, from),
            (&target_body.surface.mesh, to),
            &carries_weight,
        )?,
        _ => local_pairs(&given, &source_body, &target_body),
    };
    if pairs.len() < 2 {
        return Err(RetargetError::TooFewLandmarks { count: pairs.len() });
    }

    // The source also answers the pair distances of eq. 23; the target needs landmark columns only.
    progress.begin("Distances on the source", 0.05, 0.5)?;
    let spectral = |side| move |error| spectral_error(side, error);
    let distance = BiharmonicDistance::new(&source_body.surface.mesh, settings.eigenpairs, progress)
        .map_err(spectral("source"))?;
    let source_vectors =
        descriptors(distance.exact(), pairs.iter().map(|pair| pair[0])).map_err(spectral("source"))?;
    progress.begin("Distances on the target", 0.5, 0.8)?;
    let target_distance = ExactDistance::new(&target_body.surface.mesh).map_err(spectral("target"))?;
    let target_vectors =
        descriptors(&target_distance, pairs.iter().map(|pair| pair[1])).map_err(spectral("target"))?;

    progress.begin("Matching surfaces", 0.8, 0.95)?;
    let body_weights = rows_of(&source_body, source_weights);
    let candidate: Vec<bool> =
        (0..body_weights.vertex_count()).map(|v| !body_weights.row(v).0.is_empty()).collect();
    if !candidate.contains(&true) {
        return Err(RetargetError::NoWeights);
    }
    let regions = paired_skeleton.as_ref().map(|(from, to)| {
        [(&source_body, *from), (&target_body, to)]
            .map(|(body, skeleton)| decompose(body.surface.mesh.vertices(), skeleton, &carries_weight))
    });
    let regions = regions.as_ref().map(|[source, target]| (&source[..], &target[..]));
    let matches = best_matches(&source_vectors, &target_vectors, &candidate, regions, 1 + NEIGHBOURS);
    progress.begin("Interpolating weights", 0.95, 1.0)?;
    let rows: Vec<Vec<(u32, f64)>> =
        matches.par_iter().map(|found| interpolate(found, &body_weights, &distance)).collect();
    let best: Vec<u32> = matches.iter().map(|found| found.first().map_or(0, |m| m.vertex)).collect();

    let whole = spread(target.mesh, &target_body, &rows, &best)?;
    progress.report(1.0)?;
    let bone_count = target
        .skeleton
        .filter(|_| bone_pairs.is_some())
        .map_or(source_weights.bone_count(), Skeleton::bone_count);
    let correspondence = whole.iter().map(|found| source_body.whole(found.best)).collect();
    let matched: Vec<bool> = whole.iter().map(|found| found.matched).collect();
    let origin =
        matched.iter().map(|&matched| if matched { Origin::Matched } else { Origin::Part }).collect();
    let renamed = whole.into_iter().map(|found| renumber(found.row, bone_pairs));
    let mut weights = SkinWeights::from_rows(renamed, bone_count);
    if let Some(count) = settings.max_influences {
        weights = weights.limited(count);
    }
    Ok(Retargeted {
        weights: weights.normalized(),
        correspondence,
        matched,
        origin,
        parts: Vec::new(),
        landmarks: pairs.iter().map(|&[s, t]| [source_body.whole(s), target_body.whole(t)]).collect(),
    })
}

fn pieces(side: &'static str, mesh: &TriangleMesh) -> Result<Pieces, RetargetError> {
    Pieces::new(mesh).map_err(|error| RetargetError::Mesh { side, error })
}

fn body(side: &'static str, pieces: Pieces, component: u32) -> Result<Body, RetargetError> {
    pieces.body(component).map_err(|error: MeshError| RetargetError::Mesh { side, error })
}

fn spectral_error(side: &'static str, error: SpectralError) -> RetargetError {
    match error {
        SpectralError::Cancelled(cancelled) => cancelled.into(),
        error => RetargetError::Spectral { side, error },
    }
}

/// The user's pairs in the numbering of the bodies; repeats that closing a seam made are dropped.
fn local_pairs(pairs: &[[u32; 2]], source: &Body, target: &Body) -> Vec<[u32; 2]> {
    let mut local: Vec<[u32; 2]> = Vec::with_capacity(pairs.len());
    for pair in pairs {
        if let (Some(s), Some(t)) = (source.local(pair[0]), target.local(pair[1]))
            && !local.contains(&[s, t])
        {
            local.push([s, t]);
        }
    }
    local
}

/// Distance vectors (eq. 20, 21) to landmarks, from exact distance columns.
fn descriptors(
    distance: &ExactDistance,
    landmarks: impl Iterator<Item = u32>,
) -> Result<Descriptors, SpectralError> {
    let columns: Result<Vec<_>, _> =
        landmarks.map(|vertex| distance.from_vertex(i64::from(vertex))).collect();
    Ok(Descriptors::new(&columns?))
}

/// The source's weight rows in the numbering of its body.
fn rows_of(body: &Body, weights: &SkinWeights) -> SkinWeights {
    let rows = body.surface.to_whole.iter().map(|&vertex| {
        weights.entries(vertex as usize).map(|(bone, weight)| (bone, f64::from(weight))).collect::<Vec<_>>()
    });
    SkinWeights::from_rows(rows, weights.bone_count())
}

/// Weights of one target vertex from its matches, best first (eq. 23).
fn interpolate(found: &[Match], weights: &SkinWeights, distance: &BiharmonicDistance) -> Vec<(u32, f64)> {
    let Some((best, others)) = found.split_first() else {
        return Vec::new();
    };
    if others.is_empty() || best.difference <= EXACT {
        return shepard(weights, &[(best.vertex, 0.0)]);
    }
    let neighbours: Vec<(u32, f64)> =
        others.iter().map(|m| (m.vertex, distance.pair(m.vertex as usize, best.vertex as usize))).collect();
    shepard(weights, &neighbours)
}

/// What one vertex of the whole target gets.
struct Finding {
    row: Vec<(u32, f64)>,
    best: u32,
    matched: bool,
}

fn spread(
    mesh: &TriangleMesh,
    body: &Body,
    rows: &[Vec<(u32, f64)>],
    best: &[u32],
) -> Result<Vec<Finding>, RetargetError> {
    let query = SurfaceQuery::new(&body.surface.mesh)
        .map_err(|error| RetargetError::Mesh { side: "target", error })?;
    let finding = |(vertex, &point)| match body.local(vertex as u32) {
        Some(local) => {
            Finding { row: rows[local as usize].clone(), best: best[local as usize], matched: true }
        }
        None => {
            let follower = follow(point, &body.surface.mesh, &query, rows);
            Finding { row: follower.row, best: best[follower.nearest as usize], matched: false }
        }
    };
    Ok(mesh.vertices().par_iter().enumerate().map(finding).collect())
}

/// A row with the target's bone numbers, ascending. Bones with weight always have a partner.
fn renumber(row: Vec<(u32, f64)>, bone_pairs: Option<&[Option<u32>]>) -> Vec<(u32, f64)> {
    let Some(pairs) = bone_pairs else {
        return row;
    };
    let mut renamed: Vec<(u32, f64)> =
        row.into_iter().filter_map(|(bone, weight)| Some((pairs[bone as usize]?, weight))).collect();
    renamed.sort_unstable_by_key(|entry| entry.0);
    renamed
}
