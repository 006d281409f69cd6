//! Weights from a skeleton as heat gives them: every bone warms the skin that it sees from nearby,
//! and the heat spreads over the surface (Baran and Popović 2007, "Automatic rigging and animation
//! of 3D characters", section 4).
//!
//! Many characters begin with such weights, because modelling programs offer them. As there,
//! a bone counts as farther where the skin does not face away from it, and small weights fade out.
//! Solves `(L + c M h / d²) W = c M h / d² S`: L the robust Laplacian, M the areas, d the distance to
//! the nearest bones in sight, h their number, S equal shares of them.

use glam::DVec3;

use super::icp::Surroundings;
use super::inpaint::{Row, normalized};
use super::parallel::map_indices;
use crate::linalg::{Cholesky, SymbolicCholesky};
use crate::mesh::TriangleMesh;
use crate::progress::{Cancelled, Progress};
use crate::rig::{Skeleton, closest_on_segment};
use crate::spectral::Laplacian;

/// How well bones warm the skin beside how well the skin leads heat: c.
const WARMTH: f64 = 4.0;
/// Bones whose distances differ by less than this share are equally near.
const EQUALLY_NEAR: f64 = 1e-4;
/// A bone that the skin faces counts as farther by at most the inverse of this.
const LEAST_FACING: f64 = 5e-4;
/// Distances to the bone are at least this share of the extent.
const SMALLEST_DISTANCE: f64 = 1e-5;
/// Lines of sight end this share of their length before both ends.
const ENDS: f64 = 1e-5;
/// A line of sight passes at most this many walls; beyond, nothing is in sight.
const MOST_WALLS: usize = 32;
/// Weights below the first bound are left out, from the second on they are whole.
const FADE: [f64; 2] = [0.025, 0.05];
/// Keeps the matrix regular where a piece sees no bone; relative to the mean diagonal.
const REGULARISATION: f64 = 1e-10;
/// Rows with less heat than this have seen no bone.
const NO_HEAT: f64 = 1e-3;
/// Right-hand sides of one solve; more would only need memory.
const COLUMNS: usize = 32;

/// One row for each vertex, of sum 1; empty where no bone warms the piece, or where the solve
/// fails. `takes_part` (B) marks the bones that count.
///
/// # Errors
/// [`Cancelled`] when `progress` was cancelled.
pub(super) fn bone_heat(
    surface: Surroundings<'_>,
    skeleton: &Skeleton,
    takes_part: &[bool],
    progress: &Progress,
) -> Result<Vec<Row>, Cancelled> {
    let Surroundings { mesh, shell, .. } = surface;
    let bones: Vec<usize> = (0..takes_part.len()).filter(|&bone| takes_part[bone]).collect();
    let Ok(welded) = shell.welded(mesh) else { return Ok(vec![Row::new(); mesh.vertex_count()]) };
    let normals = normals(&welded, &shell.side);
    let topology = welded.topology();
    let pieces: Vec<u32> = shell.stands_for().iter().map(|&v| topology.components()[v as usize]).collect();
    let sources = map_indices(mesh.vertex_count(), progress, [0.0, 0.5], |v, (): &mut ()| {
        if shell.stands_for()[v] as usize == v {
            in_sight((v, normals[v]), (surface, &pieces), skeleton, &bones)
        } else {
            None
        }
    })?;
    let empty = || vec![Row::new(); mesh.vertex_count()];
    let Some((cholesky, pull)) = factored(&welded, &sources) else { return Ok(empty()) };
    progress.report(0.7)?;
    let size = mesh.vertex_count();
    let mut by_bone = vec![Vec::new(); takes_part.len()];
    for (vertex, source) in sources.iter().enumerate() {
        for &bone in source.iter().flat_map(|source| &source.bones) {
            by_bone[bone as usize].push(vertex);
        }
    }
    let mut rows = empty();
    let warm: Vec<usize> = bones.into_iter().filter(|&bone| !by_bone[bone].is_empty()).collect();
    for (batch, chunk) in warm.chunks(COLUMNS).enumerate() {
        let mut block = vec![0.0; size * chunk.len()];
        for (column, &bone) in block.chunks_exact_mut(size).zip(chunk) {
            for &vertex in &by_bone[bone] {
                let count = sources[vertex].as_ref().map_or(1, |source| source.bones.len());
                column[vertex] = pull[vertex] / count as f64;
            }
        }
        if cholesky.solve_in_place(&mut block, chunk.len()).is_err() {
            return Ok(empty());
        }
        for (column, &bone) in block.chunks_exact(size).zip(chunk) {
            for (row, &weight) in rows.iter_mut().zip(column) {
                if weight > 0.0 {
                    row.push((bone as u32, weight));
                }
            }
        }
        progress.report(0.7 + 0.3 * (batch + 1) as f64 / warm.len().div_ceil(COLUMNS) as f64)?;
    }
    rows.iter_mut().for_each(|row| *row = faded(std::mem::take(row)));
    Ok(shell.stands_for().iter().map(|&v| rows[v as usize].clone()).collect())
}

/// Outward normals (V), every triangle of a vertex counting alike; zero for a vertex without area.
fn normals(mesh: &TriangleMesh, side: &[f64]) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; mesh.vertex_count()];
    for (t, triangle) in mesh.triangles().iter().enumerate() {
        let normal = mesh.area_vector(t).normalize_or_zero();
        triangle.iter().for_each(|&v| sums[v as usize] += normal * side[v as usize]);
    }
    sums.into_iter().map(DVec3::normalize_or_zero).collect()
}

/// What warms a vertex.
struct Source {
    /// The nearest bones in sight, ascending.
    bones: Vec<u32>,
    distance: f64,
}

/// The nearest of the bones that a vertex sees.
fn in_sight(
    (v, normal): (usize, DVec3),
    (surface, pieces): (Surroundings<'_>, &[u32]),
    skeleton: &Skeleton,
    bones: &[usize],
) -> Option<Source> {
    let point = surface.mesh.vertices()[v];
    let smallest = SMALLEST_DISTANCE * surface.shell.extent;
    let mut found: Vec<(f64, u32, DVec3)> = bones
        .iter()
        .map(|&bone| {
            let at = closest_on_segment(point, skeleton.heads()[bone], skeleton.tails()[bone]).0;
            let away = (point - at).normalize_or_zero().dot(normal);
            let facing = (0.5 * (1.0 + away)).max(LEAST_FACING);
            (point.distance(at).max(smallest) / facing, bone as u32, at)
        })
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut source: Option<Source> = None;
    for (distance, bone, at) in found {
        match &mut source {
            Some(source) if distance > source.distance * (1.0 + EQUALLY_NEAR) => break,
            _ if !sees(surface, at, point, &|corner| pieces[corner] == pieces[v]) => {}
            Some(source) => source.bones.push(bone),
            None => source = Some(Source { bones: vec![bone], distance }),
        }
    }
    if let Some(source) = &mut source {
        source.bones.sort_unstable();
    }
    source
}

/// Whether the way from a bone to the skin of a piece never leaves that piece before its end: where
/// pieces overlap, as in a body made of them, the walls of others are no walls.
fn sees(surface: Surroundings<'_>, bone: DVec3, skin: DVec3, is_own: &dyn Fn(usize) -> bool) -> bool {
    let Surroundings { mesh, query, shell } = surface;
    let way = skin - bone;
    let length = way.length();
    let Some(direction) = way.try_normalize() else { return true };
    let mut at = ENDS * length;
    for _ in 0..MOST_WALLS {
        let Some(hit) = query.cast_ray(bone + direction * at, direction) else { return true };
        at += hit.distance;
        if at >= (1.0 - ENDS) * length {
            return true;
        }
        let corner = mesh.triangles()[hit.triangle as usize][0] as usize;
        let outward = mesh.area_vector(hit.triangle as usize) * shell.side[corner];
        if is_own(corner) && !shell.two_sided[corner] && outward.dot(direction) > 0.0 {
            return false;
        }
        at += ENDS * length;
    }
    false
}

/// The factor of the left-hand side, and what shares are multiplied by (V).
fn factored(mesh: &TriangleMesh, sources: &[Option<Source>]) -> Option<(Cholesky, Vec<f64>)> {
    let laplacian = Laplacian::new(mesh).ok()?;
    let diagonal = laplacian.stiffness.diagonal();
    let mean = diagonal.iter().sum::<f64>() / diagonal.len().max(1) as f64;
    let pull: Vec<f64> = sources
        .iter()
        .zip(&laplacian.areas)
        .map(|(source, area)| {
            source.as_ref().map_or(0.0, |s| WARMTH * area * s.bones.len() as f64 / (s.distance * s.distance))
        })
        .collect();
    let shift: Vec<f64> = pull.iter().map(|pull| pull.max(REGULARISATION * mean)).collect();
    let matrix = laplacian.stiffness.add_scaled_diagonal(1.0, &shift).ok()?;
    Some((Cholesky::factor(&SymbolicCholesky::new(&matrix).ok()?, &matrix).ok()?, pull))
}

/// A row without its small weights, of sum 1; empty where there is no heat.
fn faded(row: Row) -> Row {
    if row.iter().map(|entry| entry.1).sum::<f64>() < NO_HEAT {
        return Row::new();
    }
    let row = normalized(row);
    let fade = |weight: f64| match weight {
        w if w < FADE[0] => 0.0,
        w if w < FADE[1] => FADE[1] * (w - FADE[0]) / (FADE[1] - FADE[0]),
        w => w,
    };
    let kept: Row = row.iter().map(|&(bone, w)| (bone, fade(w))).filter(|entry| entry.1 > 0.0).collect();
    normalized(if kept.is_empty() { row } else { kept })
}
