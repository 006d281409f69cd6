//! `method="auto"`: the source is warped onto the target's skeleton and rest pose, deformed onto
//! its surface, and matched by closest points; what no match serves is filled smoothly.

use super::alignment::align;
use super::deform::{DeformSettings, Deformer};
use super::icp::{IcpSettings, Surroundings, register};
use super::inpaint::{InpaintSettings, Row, inpaint};
use super::ray_marks::ray_marks;
use super::rejection::{RejectionSettings, SurfaceMatch, match_surfaces};
use super::shell::Shell;
use super::{RetargetError, Retargeted, Settings, pair_bones};
use crate::mesh::{MeshError, SurfaceQuery, TriangleMesh};
use crate::progress::Progress;
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;
use crate::spectral::SpectralError;

pub(super) fn retarget(
    (source, source_skeleton): (&TriangleMesh, &Skeleton),
    source_weights: &SkinWeights,
    (target, target_skeleton): (&TriangleMesh, &Skeleton),
    settings: &Settings,
    progress: &Progress,
) -> Result<Retargeted, RetargetError> {
    let stage: u32 = std::env::var("STAGE").ok().and_then(|s| s.parse().ok()).unwrap_or(9);
    progress.begin("Reading the characters", 0.0, 0.05)?;
    let carries_weight = super::paper::weighted_bones(source_weights);
    let pairs = pair_bones(source_skeleton, target_skeleton, &carries_weight)?;
    let aligned = target_skeleton.renumbered(source_skeleton, &pairs);
    let takes_part = carries_weight;
    let on = |side| move |error: MeshError| RetargetError::Mesh { side, error };
    let spectral = |side| move |error| spectral_error(side, error);

    let source_query = SurfaceQuery::new(source).map_err(on("source"))?;
    let source_shell = Shell::new(source, &source_query, progress)?;
    let target_query = SurfaceQuery::new(target).map_err(on("target"))?;
    let target_shell = Shell::new(target, &target_query, progress)?;
    let on_source = Surroundings { mesh: source, query: &source_query, shell: &source_shell };
    let on_target = Surroundings { mesh: target, query: &target_query, shell: &target_shell };

    progress.begin("Aligning the skeletons", 0.05, 0.4)?;
    let alignment =
        align(on_source, source_skeleton, source_weights, &takes_part, on_target, aligned, progress)?;
    let warped = alignment.warp().apply(source.vertices(), source_weights);
    let weighted: Vec<[u32; 3]> = source
        .triangles()
        .iter()
        .filter(|t| t.iter().all(|&v| !source_weights.row(v as usize).0.is_empty()))
        .copied()
        .collect();
    let mut moved = TriangleMesh::new(warped, weighted).map_err(on("source"))?;

    progress.begin("Deforming the surface", 0.4, 0.8)?;
    let mut query = SurfaceQuery::new(&moved).map_err(on("source"))?;
    let mut shell = Shell::new(&moved, &query, progress)?;
    if stage >= 1 {
        let surface = Surroundings { mesh: &moved, query: &query, shell: &shell };
        let marks = if stage == 2 {
            vec![]
        } else {
            ray_marks((surface, source_weights), on_target, &alignment.aligned, &takes_part)
        };
        let deformer = Deformer::new(&moved, &marks).map_err(spectral("source"))?;
        let mut fitted = deformer.fit(&DeformSettings::default(), progress).map_err(spectral("source"))?;
        if stage >= 2 {
            fitted.vertices = register(&deformer, &fitted, on_target, &IcpSettings::default(), progress)
                .map_err(spectral("source"))?
                .vertices;
        }
        moved = TriangleMesh::new(fitted.vertices, moved.triangles().to_vec()).map_err(on("source"))?;
        query = SurfaceQuery::new(&moved).map_err(on("source"))?;
        shell = Shell::new(&moved, &query, progress)?;
    }
    progress.begin("Matching surfaces", 0.8, 0.9)?;
    let surface = Surroundings { mesh: &moved, query: &query, shell: &shell };
    let matches = match_surfaces(surface, on_target, &RejectionSettings::default(), progress)
        .map_err(spectral("target"))?;
    let rows: Vec<Row> =
        matches.iter().map(|found| renumber(&blend(found, &moved, source_weights), &pairs)).collect();
    let known: Vec<bool> = matches.iter().map(|found| found.accepted || stage < 4).collect();
    progress.begin("Filling weights", 0.9, 1.0)?;
    let mut filled =
        inpaint(target, &rows, &known, &InpaintSettings::default(), progress).map_err(spectral("target"))?;
    for &v in &filled.unreached {
        filled.rows[v as usize] = rows[v as usize].clone();
    }
    let weights = SkinWeights::from_rows(filled.rows, target_skeleton.bone_count());
    let weights = match settings.max_influences {
        Some(count) => weights.limited(count),
        None => weights,
    };
    let nearest = |found: &SurfaceMatch| {
        let b = found.barycentric;
        let largest = (0..3).rev().max_by(|&i, &j| b[i].total_cmp(&b[j])).unwrap_or(0);
        moved.triangles()[found.triangle as usize][largest]
    };
    Ok(Retargeted {
        weights: weights.normalized(),
        correspondence: matches.iter().map(nearest).collect(),
        matched: known,
        landmarks: vec![],
    })
}

fn spectral_error(side: &'static str, error: SpectralError) -> RetargetError {
    match error {
        SpectralError::Cancelled(cancelled) => cancelled.into(),
        error => RetargetError::Spectral { side, error },
    }
}

/// Weights of the source at a match.
fn blend(found: &SurfaceMatch, mesh: &TriangleMesh, weights: &SkinWeights) -> Row {
    let mut row = Row::new();
    for (&corner, share) in mesh.triangles()[found.triangle as usize].iter().zip(found.barycentric) {
        let total = weights.total(corner as usize);
        for (bone, weight) in weights.entries(corner as usize) {
            let part = share * f64::from(weight) / total;
            match row.binary_search_by_key(&bone, |entry| entry.0) {
                Ok(at) => row[at].1 += part,
                Err(at) => row.insert(at, (bone, part)),
            }
        }
    }
    row
}

fn renumber(row: &[(u32, f64)], pairs: &[Option<u32>]) -> Row {
    let mut renamed: Row =
        row.iter().filter_map(|&(bone, weight)| Some((pairs[bone as usize]?, weight))).collect();
    renamed.sort_unstable_by_key(|entry| entry.0);
    renamed
}
