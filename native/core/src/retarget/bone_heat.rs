//! Weights from a skeleton as heat gives them: every bone warms the skin that it is nearest to, and
//! the heat spreads over the surface (Baran and Popović 2007, "Automatic rigging and animation
//! of 3D characters", section 4).
//!
//! Many characters begin with such weights, because modelling programs offer them. As there,
//! a bone counts as farther where the skin does not face away from it, and small weights fade out.
//! Solves `(L + c M h / d²) W = c M h / d² S`: L the cotangent Laplacian, M the areas, d the
//! distance to the nearest bones, h their number, S equal shares of them.

use glam::DVec3;

use super::icp::Surroundings;
use super::inpaint::{Row, normalized};
use super::parallel::map_indices;
use super::shell::Shell;
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
/// Weights below the first bound are left out, from the second on they are whole.
const FADE: [f64; 2] = [0.025, 0.05];
/// Keeps the matrix regular at loose vertices; relative to the mean diagonal.
const REGULARISATION: f64 = 1e-10;
/// Rows with less heat than this have none.
const NO_HEAT: f64 = 1e-3;
/// Right-hand sides of one solve; more would only need memory.
const COLUMNS: usize = 32;

/// One row for each vertex, of sum 1; empty for loose vertices, and where the solve fails.
/// `takes_part` (B) marks the bones that count.
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
    let empty = || vec![Row::new(); mesh.vertex_count()];
    let Ok(welded) = shell.welded(mesh) else { return Ok(empty()) };
    let normals = normals(&welded, shell);
    let smallest = SMALLEST_DISTANCE * shell.extent;
    let sources = map_indices(mesh.vertex_count(), progress, [0.0, 0.5], |v, (): &mut ()| {
        nearest(welded.vertices()[v], normals[v], smallest, skeleton, &bones)
    })?;
    let Some((cholesky, pull)) = factored(&welded, &sources) else { return Ok(empty()) };
    progress.report(0.7)?;
    let size = mesh.vertex_count();
    let mut by_bone = vec![Vec::new(); takes_part.len()];
    for (vertex, source) in sources.iter().enumerate() {
        source.bones.iter().for_each(|&bone| by_bone[bone as usize].push(vertex));
    }
    let mut rows = empty();
    let warm: Vec<usize> = bones.into_iter().filter(|&bone| !by_bone[bone].is_empty()).collect();
    for (batch, chunk) in warm.chunks(COLUMNS).enumerate() {
        let mut block = vec![0.0; size * chunk.len()];
        for (column, &bone) in block.chunks_exact_mut(size).zip(chunk) {
            for &vertex in &by_bone[bone] {
                column[vertex] = pull[vertex] / sources[vertex].bones.len() as f64;
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
fn normals(mesh: &TriangleMesh, shell: &Shell) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; mesh.vertex_count()];
    for (t, triangle) in mesh.triangles().iter().enumerate() {
        let normal = mesh.area_vector(t).normalize_or_zero();
        triangle.iter().for_each(|&v| sums[v as usize] += normal * shell.side[v as usize]);
    }
    sums.into_iter().map(DVec3::normalize_or_zero).collect()
}

/// What warms a vertex.
struct Source {
    /// The nearest bones, ascending.
    bones: Vec<u32>,
    distance: f64,
}

/// The nearest of the bones, seen from a vertex with its outward normal.
fn nearest(point: DVec3, normal: DVec3, smallest: f64, skeleton: &Skeleton, bones: &[usize]) -> Source {
    let distance = |&bone: &usize| {
        let at = closest_on_segment(point, skeleton.heads()[bone], skeleton.tails()[bone]).0;
        let away = (point - at).normalize_or_zero().dot(normal);
        point.distance(at).max(smallest) / (0.5 * (1.0 + away)).max(LEAST_FACING)
    };
    let distances: Vec<f64> = bones.iter().map(distance).collect();
    let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
    let is_near = |(_, distance): &(&usize, &f64)| **distance <= least * (1.0 + EQUALLY_NEAR);
    let near = bones.iter().zip(&distances).filter(is_near).map(|(&bone, _)| bone as u32);
    Source { bones: near.collect(), distance: least }
}

/// The factor of the left-hand side, and what shares are multiplied by (V).
fn factored(mesh: &TriangleMesh, sources: &[Source]) -> Option<(Cholesky, Vec<f64>)> {
    let laplacian = Laplacian::cotangent(mesh).ok()?;
    let diagonal = laplacian.stiffness.diagonal();
    let mean = diagonal.iter().sum::<f64>() / diagonal.len().max(1) as f64;
    let pull = |(source, area): (&Source, &f64)| {
        WARMTH * area * source.bones.len() as f64 / (source.distance * source.distance)
    };
    let pull: Vec<f64> = sources.iter().zip(&laplacian.areas).map(pull).collect();
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

#[cfg(test)]
mod tests {
    use super::super::test_surfaces::{mapped, similarity, tube};
    use super::*;
    use crate::mesh::SurfaceQuery;

    fn heat(mesh: &TriangleMesh, skeleton: &Skeleton) -> Vec<Row> {
        let query = SurfaceQuery::new(mesh).unwrap();
        let shell = Shell::new(mesh, &query, &Progress::new()).unwrap();
        let takes_part = vec![true; skeleton.bone_count()];
        bone_heat(
            Surroundings { mesh, query: &query, shell: &shell },
            skeleton,
            &takes_part,
            &Progress::new(),
        )
        .unwrap()
    }

    /// Two bones along a limb from z = 0 to z = 4.
    fn bones(joint: f64) -> Skeleton {
        let joints = [0.0, joint, 4.0].map(|z| DVec3::Z * z);
        Skeleton::new(joints[..2].to_vec(), joints[1..].to_vec(), &[-1, 0], None).unwrap()
    }

    #[test]
    fn heat_passes_from_bone_to_bone_within_the_limb_s_radius() {
        let limb = tube(0.5, 4.0, 32, 64);
        let rows = heat(&limb, &bones(2.0));
        let second = |row: &Row| row.iter().find(|entry| entry.0 == 1).map_or(0.0, |entry| entry.1);
        for (row, point) in rows.iter().zip(limb.vertices()) {
            assert!((row.iter().map(|entry| entry.1).sum::<f64>() - 1.0).abs() < 1e-12);
            // Along a tube of radius r the heat falls off like exp(-2 z / r).
            let away = point.z - 2.0;
            let expected = 0.5 + 0.5 * away.signum() * (1.0 - libm::exp(-4.0 * away.abs()));
            assert!(
                !(0.1..=0.9).contains(&expected) || (second(row) - expected).abs() < 0.05,
                "{point} {row:?}"
            );
        }
    }

    #[test]
    fn skin_belongs_to_the_bone_that_it_faces_away_from() {
        let [left, right] = [-0.55, 0.55].map(|x| mapped(&tube(0.5, 4.0, 32, 64), |p| p + DVec3::X * x));
        let limbs = super::super::test_surfaces::joined(&left, &right);
        let (heads, tails) =
            ([-0.3, 0.55].map(|x| DVec3::X * x), [-0.3, 0.55].map(|x| DVec3::new(x, 0.0, 4.0)));
        let skeleton = Skeleton::new(heads.to_vec(), tails.to_vec(), &[-1, -1], None).unwrap();
        for motion in [similarity(1.0), similarity(100.0)] {
            let moved = mapped(&limbs, |p| motion.transform_point3(p));
            let place = |points: &[DVec3]| points.iter().map(|&p| motion.transform_point3(p)).collect();
            let rows = heat(&moved, &skeleton.placed(place(skeleton.heads()), place(skeleton.tails())));
            for (row, point) in rows.iter().zip(limbs.vertices()).filter(|(_, p)| (0.5..3.5).contains(&p.z)) {
                assert_eq!(row[0].0, u32::from(point.x > 0.0), "{point} {row:?}");
            }
        }
    }
}
