//! Weights from a skeleton as heat gives them: every bone warms the skin that it is nearest to, and
//! the heat spreads over the surface (Baran and Popović 2007, "Automatic rigging and animation
//! of 3D characters", section 4).
//!
//! Many characters begin with such weights, because modelling programs offer them. As there,
//! a bone counts as farther where the skin does not face away from it, and small weights fade out.
//! Solves `(L + c M h / d²) W = c M h / d² S`: L the cotangent Laplacian, M the mixed Voronoi areas
//! (Meyer, Desbrun, Schröder and Barr 2003), d the distance to the nearest bones, h their number, S
//! equal shares of them.
//!
//! With lines of sight no bone warms skin that it does not see: where the way from the skin to its nearest
//! bone leaves the body and enters it again, or enters another piece, skin has only what flows to it.

use glam::DVec3;

use crate::linalg::{Cholesky, SymbolicCholesky};
use crate::mesh::{SurfaceQuery, TriangleMesh};
use crate::parallel::map_indices;
use crate::progress::{Cancelled, Progress};
use crate::rig::{Skeleton, closest_on_segment};
use crate::skinning::{Row, normalized};
use crate::spectral::Laplacian;

/// How well bones warm the skin beside how well the skin leads heat: c.
const WARMTH: f64 = 4.0;
/// Bones whose distances differ by less than this share are equally near.
const EQUALLY_NEAR: f64 = 1e-4;
/// A bone that the skin faces counts as farther by at most the inverse of this.
const LEAST_FACING: f64 = 5e-4;
/// Distances to the bone are at least this share of the extent.
const SMALLEST_DISTANCE: f64 = 1e-5;
/// Lines of sight end this share of their length before both ends,
const ENDS: f64 = 1e-5;
/// and one on either side of the straight one, this share of its length away, says whether a bone is seen: the
/// straight one would run along edges of a body's mirror plane.
const BESIDE: f64 = 1e-4;
/// A line that meets more walls sees nothing.
const MOST_WALLS: usize = 64;
/// Weights below the first bound are left out, from the second on they are whole.
const FADE: [f64; 2] = [0.025, 0.05];
/// Keeps the matrix regular at loose vertices; relative to the mean diagonal.
const REGULARISATION: f64 = 1e-10;
/// Rows with less heat than this have none.
const NO_HEAT: f64 = 1e-3;
/// Right-hand sides of one solve; more would only need memory.
const COLUMNS: usize = 32;

/// How a surface lies in space.
#[derive(Debug, Clone, Copy)]
pub struct Sides<'a> {
    /// −1 where the winding faces inward, else 1 (V).
    pub side: &'a [f64],
    /// Length of the surface, in the mesh's unit.
    pub extent: f64,
}

/// One row for each vertex of a mesh whose seams are closed, of sum 1; empty for loose vertices, and
/// where the solve fails. `takes_part` (B) marks the bones that count; `sight` is the mesh, to be searched,
/// where lines of sight count.
///
/// # Errors
/// [`Cancelled`] when `progress` was cancelled.
pub fn bone_heat(
    mesh: &TriangleMesh,
    sides: Sides<'_>,
    skeleton: &Skeleton,
    takes_part: &[bool],
    sight: Option<&SurfaceQuery>,
    progress: &Progress,
) -> Result<Vec<Row>, Cancelled> {
    let bones: Vec<usize> = (0..takes_part.len()).filter(|&bone| takes_part[bone]).collect();
    let empty = || vec![Row::new(); mesh.vertex_count()];
    let normals = normals(mesh, sides.side);
    let smallest = SMALLEST_DISTANCE * sides.extent;
    let sources = map_indices(mesh.vertex_count(), progress, [0.0, 0.5], |v, (): &mut ()| {
        let point = mesh.vertices()[v];
        let mut source = nearest(point, normals[v], smallest, skeleton, &bones);
        if let Some(query) = sight {
            source.bones.retain(|&bone| {
                let (head, tail) = (skeleton.heads()[bone as usize], skeleton.tails()[bone as usize]);
                let way = closest_on_segment(point, head, tail).0 - point;
                is_seen((point, normals[v]), way, (mesh, sides.side, query))
            });
        }
        source
    })?;
    let Some((cholesky, pull)) = factored(mesh, &sources) else { return Ok(empty()) };
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
    Ok(rows)
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

/// Whether a way from the skin to a bone enters the surface nowhere.
fn is_seen(
    (point, normal): (DVec3, DVec3),
    way: DVec3,
    (mesh, side, query): (&TriangleMesh, &[f64], &SurfaceQuery),
) -> bool {
    let length = way.length();
    let aside = normal.cross(way).normalize_or_zero() * (BESIDE * length);
    let is_clear = |way: DVec3| {
        let Some(direction) = way.try_normalize() else { return true };
        let mut at = ENDS * length;
        for _ in 0..MOST_WALLS {
            let Some(hit) = query.cast_ray(point + direction * at, direction) else { return true };
            at += hit.distance;
            if at >= (1.0 - ENDS) * length {
                return true;
            }
            let corner = mesh.triangles()[hit.triangle as usize][0] as usize;
            if (mesh.area_vector(hit.triangle as usize) * side[corner]).dot(direction) < 0.0 {
                return false;
            }
            at += ENDS * length;
        }
        false
    };
    [aside, -aside].into_iter().any(|aside| is_clear(way + aside))
}

/// What warms a vertex.
struct Source {
    /// The nearest bones, ascending; those in sight, where that counts.
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
    let pull: Vec<f64> = sources.iter().zip(&mixed_areas(mesh)).map(pull).collect();
    let shift: Vec<f64> = pull.iter().map(|pull| pull.max(REGULARISATION * mean)).collect();
    let matrix = laplacian.stiffness.add_scaled_diagonal(1.0, &shift).ok()?;
    Some((Cholesky::factor(&SymbolicCholesky::new(&matrix).ok()?, &matrix).ok()?, pull))
}

/// The area nearest to each vertex (V) on its triangles; an obtuse one is cut half for its wide corner.
fn mixed_areas(mesh: &TriangleMesh) -> Vec<f64> {
    let mut areas = vec![0.0; mesh.vertex_count()];
    for (t, triangle) in mesh.triangles().iter().enumerate() {
        let (corners, area) = (mesh.corners(t), mesh.area_vector(t).length() / 2.0);
        let (from, to) = (|k: usize| corners[k % 3], |k: usize| corners[(k + 1) % 3]);
        // Products of the two sides at each corner, and squares of the sides that begin there.
        let dots = [0, 1, 2].map(|k| (to(k) - from(k)).dot(from(k + 2) - from(k)));
        let squares = [0, 1, 2].map(|k| (to(k) - from(k)).length_squared());
        let obtuse = dots.iter().position(|&dot| dot < 0.0);
        for (k, &vertex) in triangle.iter().enumerate() {
            areas[vertex as usize] += match obtuse {
                Some(wide) if wide == k => area / 2.0,
                Some(_) => area / 4.0,
                None if area <= 0.0 => 0.0,
                // An edge's share is its square times the cotangent across from it, by eight.
                None => {
                    let (next, last) = ((k + 1) % 3, (k + 2) % 3);
                    (squares[k] * dots[last] + squares[last] * dots[next]) / (16.0 * area)
                }
            };
        }
    }
    areas
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
    use super::*;
    use crate::mesh::test_surfaces::{joined, mapped, similarity, tube};

    fn heat(mesh: &TriangleMesh, skeleton: &Skeleton) -> Vec<Row> {
        let (low, high) = mesh.bounds();
        let sides = Sides { side: &vec![1.0; mesh.vertex_count()], extent: low.distance(high) };
        bone_heat(mesh, sides, skeleton, &vec![true; skeleton.bone_count()], None, &Progress::new()).unwrap()
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
    fn a_bone_does_not_warm_another_piece_s_skin_that_it_does_not_see() {
        let limb = |x: f64| mapped(&tube(0.5, 4.0, 32, 64), |p| p + DVec3::X * x);
        let limbs = joined(&limb(0.0), &limb(1.2));
        // The second bone is so short that the first is nearer to much of its limb.
        let (heads, tails) = ([0.0, 1.2].map(|x| DVec3::X * x), [(0.0, 3.8), (1.2, 1.0)]);
        let tails = tails.map(|(x, z)| DVec3::new(x, 0.0, z));
        let skeleton = Skeleton::new(heads.to_vec(), tails.to_vec(), &[-1, -1], None).unwrap();
        for motion in [similarity(1.0), similarity(100.0)] {
            let moved = mapped(&limbs, |p| motion.transform_point3(p));
            let place = |points: &[DVec3]| points.iter().map(|&p| motion.transform_point3(p)).collect();
            let skeleton = skeleton.placed(place(skeleton.heads()), place(skeleton.tails()));
            let query = SurfaceQuery::new(&moved).unwrap();
            let sides = Sides { side: &vec![1.0; moved.vertex_count()], extent: 4.0 };
            let rows =
                |sight| bone_heat(&moved, sides, &skeleton, &[true, true], sight, &Progress::new()).unwrap();
            let own = |row: &Row, point: &DVec3| *row == [(u32::from(point.x > 0.6), 1.0)];
            let share = |rows: &[Row]| {
                let own = rows.iter().zip(limbs.vertices()).filter(|(row, point)| own(row, point)).count();
                own as f64 / rows.len() as f64
            };
            assert!(share(&rows(None)) < 0.8);
            assert_eq!(share(&rows(Some(&query))), 1.0);
        }
    }

    #[test]
    fn areas_are_those_of_the_nearest_points() {
        let [a, b, c] = [(0.0, 0.0), (3.0, 0.0), (1.0, 2.5)].map(|(x, y)| DVec3::new(x, y, 1.0));
        let acute = TriangleMesh::new(vec![a, b, c], vec![[0, 1, 2]]).unwrap();
        const STEPS: usize = 400;
        let mut counts = [0.0; 3];
        for (i, j) in (0..STEPS).flat_map(|i| (0..STEPS - i).map(move |j| (i, j))) {
            let at = |k: usize| (k as f64 + 1.0 / 3.0) / STEPS as f64;
            let point = a + (b - a) * at(i) + (c - a) * at(j);
            let distances = [a, b, c].map(|corner| corner.distance(point));
            counts[(0..3).min_by(|&k, &l| distances[k].total_cmp(&distances[l])).unwrap()] += 1.0;
        }
        let total: f64 = counts.iter().sum();
        for (found, count) in mixed_areas(&acute).iter().zip(counts) {
            assert!((found / acute.area() - count / total).abs() < 0.005, "{found}");
        }
        let obtuse = TriangleMesh::new(vec![a, b, DVec3::new(1.0, 0.5, 1.0)], vec![[0, 1, 2]]).unwrap();
        let shares = mixed_areas(&obtuse).into_iter().map(|area| area / obtuse.area());
        assert!(shares.zip([0.25, 0.25, 0.5]).all(|(found, expected)| (found - expected).abs() < 1e-12));
    }

    #[test]
    fn skin_belongs_to_the_bone_that_it_faces_away_from() {
        let [left, right] = [-0.55, 0.55].map(|x| mapped(&tube(0.5, 4.0, 32, 64), |p| p + DVec3::X * x));
        let limbs = joined(&left, &right);
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
