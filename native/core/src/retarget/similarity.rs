//! The plainest alignment: the source moved, turned and scaled as a whole. A garment on the body
//! that wears it, or one body with two rigs, already lies where it belongs; bending it to another
//! rig's idea of the joints would only do harm.

use glam::DVec3;

use super::icp::Surroundings;
use super::rigid_fit::rigid_fit;
use super::shell::median;
use super::surface_sample::Sample;
use crate::mesh::{SurfaceQuery, TriangleMesh};
use crate::parallel::map_indices;
use crate::progress::{Cancelled, Progress};
use crate::rig::Skeleton;

/// Joints that agree to this share of the extent tell the place exactly.
pub(super) const EXACT: f64 = 1e-3;
/// Rounds of closest points where joints do not,
const ROUNDS: u32 = 30;
/// which end when points move less than this share of the extent,
const SETTLED: f64 = 1e-5;
/// and do not begin where the surfaces are farther apart than this share: poses or shapes differ.
const HOPELESS: f64 = 0.03;
/// Most points of a round's fit come this near, as a multiple of the median distance.
const NEAR: f64 = 3.0;
/// Of a large surface about so many points are compared.
pub(super) const POINTS: usize = 5_000;

/// The source's vertices after the similarity that takes its joints to the aligned ones, corrected
/// by closest points of the target where the joints disagree, and whether they agree exactly. `samples`
/// stand for all vertices.
///
/// # Errors
/// [`Cancelled`] when `progress` was cancelled.
pub(super) fn similar(
    (vertices, samples): (&[DVec3], &[Sample]),
    (skeleton, aligned): (&Skeleton, &Skeleton),
    takes_part: &[bool],
    target: Surroundings<'_>,
    progress: &Progress,
) -> Result<(Vec<DVec3>, bool), Cancelled> {
    let bones = (0..takes_part.len()).filter(|&b| takes_part[b]);
    let joints: Vec<Pair> = bones.map(|b| (skeleton.heads()[b], aligned.heads()[b], 1.0)).collect();
    let mut moved: Vec<DVec3> = vertices.to_vec();
    let error = fit(&joints, &mut moved);
    if error <= EXACT * target.shell.extent {
        return Ok((moved, true));
    }
    for round in 0..ROUNDS {
        let shares = [round, round + 1].map(|round| 0.6 * f64::from(round) / f64::from(ROUNDS));
        let found = map_indices(samples.len(), progress, shares, |at, (): &mut ()| {
            let point = moved[samples[at].vertex as usize];
            target.query.closest_point(point).map(|closest| (point, closest.position, samples[at].count))
        })?;
        let distance = |pair: &Pair| pair.0.distance(pair.1);
        let typical = median(found.iter().flatten().map(distance).collect());
        if typical > HOPELESS * target.shell.extent {
            break;
        }
        let bound = NEAR * typical;
        let near: Vec<Pair> = found.into_iter().flatten().filter(|pair| distance(pair) <= bound).collect();
        let before = moved.clone();
        fit(&near, &mut moved);
        let step = before.iter().zip(&moved).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        if step < SETTLED * target.shell.extent {
            break;
        }
    }
    Ok((moved, false))
}

/// Two points that belong together, and how much they count.
pub(super) type Pair = (DVec3, DVec3, f64);

/// Moves points by the similarity that best fits pairs, and returns the root mean square error.
pub(super) fn fit(pairs: &[Pair], points: &mut [DVec3]) -> f64 {
    if pairs.is_empty() {
        return f64::INFINITY;
    }
    let count: f64 = pairs.iter().map(|pair| pair.2).sum();
    let from = pairs.iter().map(|pair| pair.0 * pair.2).sum::<DVec3>() / count;
    let to = pairs.iter().map(|pair| pair.1 * pair.2).sum::<DVec3>() / count;
    let rotation = rigid_fit(pairs).rotation;
    let spread: f64 = pairs.iter().map(|pair| pair.2 * pair.0.distance_squared(from)).sum();
    let along: f64 = pairs.iter().map(|pair| pair.2 * (rotation * (pair.0 - from)).dot(pair.1 - to)).sum();
    let scale = if spread > 0.0 && along > 0.0 { along / spread } else { 1.0 };
    let place = |point: DVec3| to + rotation * (point - from) * scale;
    points.iter_mut().for_each(|point| *point = place(*point));
    (pairs.iter().map(|pair| pair.2 * place(pair.0).distance_squared(pair.1)).sum::<f64>() / count).sqrt()
}

/// How far the points of a surface lie from another one.
pub(super) struct Distances {
    /// Ascending, each with the area that it stands for.
    of_areas: Vec<(f64, f64)>,
}

impl Distances {
    /// The distance below which a share of the area lies. Not of the vertices: of a coarse body most of
    /// them make up the head.
    pub(super) fn below(&self, share: f64) -> f64 {
        let total: f64 = self.of_areas.iter().map(|(_, area)| area).sum();
        let mut below = 0.0;
        let found = self.of_areas.iter().find(|(_, area)| {
            below += area;
            below > share * total
        });
        found.or(self.of_areas.last()).map_or(f64::INFINITY, |(distance, _)| *distance)
    }
}

/// Distances of the target's vertices, for which `samples` stand, to a surface.
///
/// # Errors
/// [`Cancelled`] when `progress` was cancelled.
pub(super) fn distances_to(
    query: &SurfaceQuery,
    (mesh, samples): (&TriangleMesh, &[Sample]),
    shares: [f64; 2],
    progress: &Progress,
) -> Result<Distances, Cancelled> {
    let found = map_indices(samples.len(), progress, shares, |at, (): &mut ()| {
        let point = mesh.vertices()[samples[at].vertex as usize];
        query.closest_point(point).map_or(f64::INFINITY, |closest| closest.distance)
    })?;
    let mut areas = vec![0.0; mesh.vertex_count()];
    for (t, triangle) in mesh.triangles().iter().enumerate() {
        let share = mesh.area_vector(t).length() / 6.0;
        triangle.iter().for_each(|&v| areas[v as usize] += share);
    }
    let area = |sample: &Sample| sample.count * areas[sample.vertex as usize];
    let mut of_areas: Vec<(f64, f64)> = found.into_iter().zip(samples.iter().map(area)).collect();
    of_areas.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    Ok(Distances { of_areas })
}

#[cfg(test)]
mod tests {
    use super::super::shell::Shell;
    use super::*;
    use crate::mesh::test_surfaces::{icosphere, joined, mapped, similarity, tube};

    #[test]
    fn joints_that_agree_tell_the_place_and_others_are_corrected() {
        let source = mapped(&tube(0.4, 3.0, 24, 30), |p| p * DVec3::new(1.4, 1.0, 1.0));
        let motion = similarity(3.0);
        let target = mapped(&source, |p| motion.transform_point3(p));
        let query = SurfaceQuery::new(&target).unwrap();
        let shell = Shell::new(&target, &query, &Progress::new()).unwrap();
        let around = Surroundings { mesh: &target, query: &query, shell: &shell };
        let heads = vec![DVec3::ZERO, DVec3::new(0.2, 0.0, 1.0), DVec3::new(0.0, 0.3, 2.0)];
        let skeleton = Skeleton::new(heads.clone(), heads.clone(), &[-1, 0, 1], None).unwrap();
        for (slip, tolerance) in [(0.0, 1e-9), (0.05, 0.02)] {
            let aligned: Vec<DVec3> = heads
                .iter()
                .map(|&p| motion.transform_point3(p + slip * DVec3::new(p.y, p.z, p.x)))
                .collect();
            let aligned = Skeleton::new(aligned.clone(), aligned, &[-1, 0, 1], None).unwrap();
            let all: Vec<Sample> =
                (0..source.vertex_count() as u32).map(|vertex| Sample { vertex, count: 1.0 }).collect();
            let rigs = (&skeleton, &aligned);
            let moved = similar((source.vertices(), &all), rigs, &[true; 3], around, &Progress::new());
            let (found, exact) = moved.unwrap();
            assert_eq!(exact, slip == 0.0);
            let worst = found.iter().map(|p| query.closest_point(*p).unwrap().distance).fold(0.0, f64::max);
            assert!(worst < tolerance * 3.0, "{worst}");
        }
    }

    #[test]
    fn areas_count_and_not_vertices() {
        // A fine ball on the other surface and a coarse one of the same size that is away from it.
        let (fine, coarse) = (icosphere(4), mapped(&icosphere(1), |p| p + DVec3::X * 5.0));
        let both = joined(&fine, &coarse);
        let samples: Vec<Sample> =
            (0..both.vertex_count() as u32).map(|vertex| Sample { vertex, count: 1.0 }).collect();
        let query = SurfaceQuery::new(&fine).unwrap();
        let found = distances_to(&query, (&both, &samples), [0.0, 1.0], &Progress::new()).unwrap();
        assert!(found.below(0.4) < 1e-9 && found.below(0.6) > 2.0, "{}", found.below(0.6));
        assert!(found.below(1.0) > 4.0);
    }
}
