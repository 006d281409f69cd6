//! `method="auto"`: warp the source onto the target's skeleton, refine the joints against the
//! surfaces, match by closest points.

use glam::DVec3;
use rayon::prelude::*;

use super::bone_rays::{Fan, Surface, extent, log_girths, outward, shoot};
use super::joint_refinement::{Alignment, FitSettings, refine};
use super::{Character, RetargetError, Retargeted, Settings, pair_bones};
use crate::mesh::{MeshError, SurfaceQuery, TriangleMesh};
use crate::progress::Progress;
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// Rays that measure girth.
const GIRTH_FAN: Fan<'static> = Fan { stations: &[0.1, 0.3, 0.5, 0.7, 0.9], directions: 8 };

pub(super) fn retarget(
    (source, source_skeleton): (&TriangleMesh, &Skeleton),
    source_weights: &SkinWeights,
    (target, target_skeleton): (&TriangleMesh, &Skeleton),
    settings: &Settings,
    progress: &Progress,
) -> Result<Retargeted, RetargetError> {
    progress.begin("Reading the characters", 0.0, 0.05)?;
    let carries_weight = super::paper::weighted_bones(source_weights);
    let pairs = pair_bones(source_skeleton, target_skeleton, &carries_weight)?;
    let aligned = target_skeleton.renumbered(source_skeleton, &pairs);
    let takes_part = carries_weight;
    let on = |side| move |error: MeshError| RetargetError::Mesh { side, error };
    let source_surface = surface(source, source_skeleton, &takes_part).map_err(on("source"))?;
    let target_surface = surface(target, &aligned, &takes_part).map_err(on("target"))?;
    let size = extent(target);

    progress.begin("Aligning the skeletons", 0.05, 0.4)?;
    let bone_count = source_skeleton.bone_count();
    let mut alignment = Alignment {
        mesh: source,
        outward: source_surface.outward,
        skeleton: source_skeleton,
        weights: source_weights,
        takes_part: &takes_part,
        aligned,
        log_girths: vec![0.0; bone_count],
        twists: vec![0.0; bone_count],
    };
    let rays = shoot(
        (&source_surface, source_skeleton, source_weights),
        (&target_surface, &alignment.aligned),
        &alignment.warp(),
        &takes_part,
        &GIRTH_FAN,
    );
    alignment.log_girths = log_girths(&rays, bone_count);
    if std::env::var("NOFIT").is_err() {
    refine(&mut alignment, &target_surface, size, &FitSettings::default(), progress)?;
    }
    let warped = alignment.warp().apply(source.vertices(), source_weights);

    progress.begin("Matching surfaces", 0.4, 0.9)?;
    let weighted: Vec<[u32; 3]> = source
        .triangles()
        .iter()
        .filter(|t| t.iter().all(|&v| !source_weights.row(v as usize).0.is_empty()))
        .copied()
        .collect();
    let warped = TriangleMesh::new(warped, weighted).map_err(on("source"))?;
    let query = SurfaceQuery::new(&warped).map_err(on("source"))?;
    let found: Vec<(Vec<(u32, f64)>, u32)> = target
        .vertices()
        .par_iter()
        .map(|&point| interpolate(point, &warped, &query, source_weights))
        .collect();
    let rows = found.iter().map(|f| renumber(&f.0, &pairs));
    let weights = SkinWeights::from_rows(rows, target_skeleton.bone_count());
    let weights = match settings.max_influences {
        Some(count) => weights.limited(count),
        None => weights,
    };
    Ok(Retargeted {
        weights: weights.normalized(),
        correspondence: found.iter().map(|f| f.1).collect(),
        matched: vec![true; target.vertex_count()],
        landmarks: vec![],
    })
}

fn surface<'a>(
    mesh: &'a TriangleMesh,
    skeleton: &Skeleton,
    takes_part: &[bool],
) -> Result<Surface<'a>, MeshError> {
    let query = SurfaceQuery::new(mesh)?;
    let outward = outward(mesh, &query, skeleton, takes_part);
    Ok(Surface { mesh, query, outward })
}

fn interpolate(point: DVec3, mesh: &TriangleMesh, query: &SurfaceQuery, weights: &SkinWeights) -> (Vec<(u32, f64)>, u32) {
    let Some(closest) = query.closest_point(point) else { return (Vec::new(), 0) };
    let corners = mesh.triangles()[closest.triangle as usize];
    let mut row: Vec<(u32, f64)> = Vec::new();
    for (&corner, share) in corners.iter().zip(closest.barycentric) {
        let total = weights.total(corner as usize);
        for (bone, weight) in weights.entries(corner as usize) {
            let part = share * f64::from(weight) / total;
            match row.binary_search_by_key(&bone, |entry| entry.0) {
                Ok(at) => row[at].1 += part,
                Err(at) => row.insert(at, (bone, part)),
            }
        }
    }
    let largest = (0..3).rev().max_by(|&a, &b| closest.barycentric[a].total_cmp(&closest.barycentric[b])).unwrap_or(0);
    (row, corners[largest])
}

fn renumber(row: &[(u32, f64)], pairs: &[Option<u32>]) -> Vec<(u32, f64)> {
    let mut renamed: Vec<(u32, f64)> =
        row.iter().filter_map(|&(bone, weight)| Some((pairs[bone as usize]?, weight))).collect();
    renamed.sort_unstable_by_key(|entry| entry.0);
    renamed
}

#[allow(dead_code)]
fn _unused(_: Character<'_>) {}
