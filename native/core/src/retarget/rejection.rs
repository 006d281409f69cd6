//! Which vertices of the target lie close enough to the deformed source to take its weights, and
//! where on it they lie.
//!
//! A match is tested by the angle of the normals, by distance (a limb's own thickness bounds it), by
//! its neighbours (places near along the target must lie near along the source), and by the way
//! back from the source. What fails is left to inpainting; a wrong rejection costs little, a wrong
//! match shows.

use glam::DVec3;

use super::geodesic::Ball;
use super::icp::Surroundings;
use super::match_neighbours::{Neighbours, Verdict};
use crate::mesh::{ClosestPoint, MeshError};
use crate::parallel::map_indices;
use crate::progress::Progress;
use crate::spectral::SpectralError;

/// Radius of the smallest patch of matches that may stand alone, as a share of the extent.
const SMALLEST_PATCH: f64 = 0.015;

/// Bounds of the tests.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RejectionSettings {
    /// Largest angle of the normals, in degrees.
    pub max_angle: f64,
    /// Largest distance, as a share of the source's extent.
    pub max_distance: f64,
    /// Largest distance, as a share of the thinner body's thickness at that place; a quarter of
    /// `max_distance` is always allowed.
    pub max_depth: f64,
    /// Whether a match on the body's other wall may stand in for a closest point that fails.
    pub other_wall: bool,
    /// Whether the target's point closest to the match must lie near the vertex along the target.
    pub way_back: bool,
    /// Largest factor by which the ends of an edge may lie farther apart on the source.
    pub max_stretch: f64,
}

impl Default for RejectionSettings {
    fn default() -> Self {
        Self {
            max_angle: 60.0,
            max_distance: 0.02,
            max_depth: 0.5,
            other_wall: true,
            way_back: true,
            max_stretch: f64::INFINITY,
        }
    }
}

/// Where a target vertex lies on the source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceMatch {
    /// Triangle of the source.
    pub triangle: u32,
    /// Barycentric coordinates there; not negative, sum 1.
    pub barycentric: [f64; 3],
    /// Distance, in the meshes' unit.
    pub distance: f64,
    /// Cosine of the angle between the outward normals; its size where a surface has two outsides.
    pub agreement: f64,
    /// Whether the match passed all tests.
    pub accepted: bool,
}

/// Matches every target vertex with the deformed source and tests the matches. Both surfaces are
/// in one space; both shells belong to them.
///
/// # Errors
/// [`SpectralError::Cancelled`], and [`SpectralError::Mesh`] for a source without surface.
pub fn match_surfaces(
    source: Surroundings<'_>,
    target: Surroundings<'_>,
    settings: &RejectionSettings,
    progress: &Progress,
) -> Result<Vec<SurfaceMatch>, SpectralError> {
    let limits = Limits { settings, farthest: settings.max_distance * source.shell.extent };
    let count = target.mesh.vertex_count();
    let found = map_indices(count, progress, [0.0, 0.4], |v, (): &mut ()| best(v, source, target, &limits))?;
    let candidates: Option<Vec<Candidate>> = found.into_iter().collect();
    let candidates = candidates.ok_or(MeshError::NoSurface)?;

    let edges = Neighbours::new(target, &source)?;
    let verdicts = map_indices(count, progress, [0.4, 0.95], |v, ball: &mut Ball| {
        if !candidates[v].passes {
            return Verdict::default();
        }
        let consistent = edges.consistent(v, &candidates, source, ball);
        let returns = !settings.way_back || edges.returns(v, &candidates[v], target, ball);
        Verdict { consistent, returns }
    })?;
    let passes: Vec<bool> = (0..count)
        .map(|v| {
            let verdict = &verdicts[v];
            let agreeing = verdict.consistent.iter().filter(|(_, agrees)| *agrees).count();
            let holds = verdict.returns && 2 * agreeing >= verdict.consistent.len();
            candidates[v].passes && holds && !edges.tears(v, &candidates, settings.max_stretch)
        })
        .collect();
    let smallest = std::f64::consts::PI * (SMALLEST_PATCH * source.shell.extent).powi(2);
    let accepted = edges.without_small_patches(&passes, &verdicts, target.mesh, smallest);
    progress.report(1.0)?;
    Ok(candidates
        .into_iter()
        .zip(accepted)
        .map(|(Candidate { at, agreement, .. }, accepted)| SurfaceMatch {
            triangle: at.triangle,
            barycentric: at.barycentric,
            distance: at.distance,
            agreement,
            accepted,
        })
        .collect())
}

struct Limits<'a> {
    settings: &'a RejectionSettings,
    farthest: f64,
}

impl Limits<'_> {
    fn distance(&self, thickness: f64) -> f64 {
        (self.settings.max_depth * thickness).clamp(0.25 * self.farthest, self.farthest)
    }
}

/// A match before its neighbours are asked.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) at: ClosestPoint,
    agreement: f64,
    pub(super) passes: bool,
}

/// The closest point of the source, or else a point near the closest one of its other wall that
/// passes where that one fails: between fingers and lips the nearest wall is not the own one.
fn best(
    v: usize,
    source: Surroundings<'_>,
    target: Surroundings<'_>,
    limits: &Limits<'_>,
) -> Option<Candidate> {
    let (point, normal) = (target.mesh.vertices()[v], target.shell.normals[v]);
    let both = target.shell.two_sided[v];
    let judge = |query: DVec3| {
        let mut at = source.closest(query)?;
        at.distance = at.position.distance(point);
        let (facing, source_both) = source.shell.normal_at(source.mesh, &at);
        let cosine = normal.dot(facing);
        let agreement = if both || source_both { cosine.abs() } else { cosine };
        let thickness = target.shell.thickness[v].min(source.shell.thickness_at(source.mesh, &at));
        let near = at.distance <= limits.distance(thickness);
        let angle = agreement >= libm::cos(limits.settings.max_angle.to_radians());
        let beyond = source.shell.is_on_open_edge(source.mesh, &at) && at.distance > 0.25 * limits.farthest;
        Some(Candidate { at, agreement, passes: near && angle && !beyond })
    };
    let closest = judge(point)?;
    if closest.passes || !limits.settings.other_wall || closest.at.distance > limits.farthest {
        return Some(closest);
    }
    let step = closest.at.distance.max(0.25 * limits.farthest);
    let others = [1.0, -1.0].into_iter().filter_map(|side| judge(point + normal * (side * step)));
    let passing = others.filter(|other| other.passes);
    Some(passing.min_by(|a, b| a.at.distance.total_cmp(&b.at.distance)).unwrap_or(closest))
}

#[cfg(test)]
mod tests {
    use super::super::shell::Shell;
    use super::*;
    use crate::mesh::test_surfaces::{icosphere, joined, mapped, permuted, similarity, tube};
    use crate::mesh::{SurfaceQuery, TriangleMesh};

    fn run(source: &TriangleMesh, target: &TriangleMesh) -> Vec<SurfaceMatch> {
        let progress = Progress::new();
        let queries = [source, target].map(|mesh| SurfaceQuery::new(mesh).unwrap());
        let shells = [source, target]
            .iter()
            .zip(&queries)
            .map(|(mesh, query)| Shell::new(mesh, query, &progress).unwrap())
            .collect::<Vec<_>>();
        let side = |at: usize, mesh| Surroundings { mesh, query: &queries[at], shell: &shells[at] };
        match_surfaces(side(0, source), side(1, target), &RejectionSettings::default(), &progress).unwrap()
    }

    fn turned_sphere(level: usize) -> TriangleMesh {
        let turn = glam::DQuat::from_axis_angle(DVec3::new(0.3, 0.5, -0.8).normalize(), 0.4);
        mapped(&icosphere(level), |p| turn * p)
    }

    #[test]
    fn equal_surfaces_match_everywhere() {
        let (source, target) = (icosphere(4), turned_sphere(3));
        let found = run(&source, &target);
        for (found, point) in found.iter().zip(target.vertices()) {
            assert!(found.accepted && found.distance < 0.01 && found.agreement > 0.99);
            let corners = source.corners(found.triangle as usize);
            let at: DVec3 = corners.iter().zip(found.barycentric).map(|(&c, b)| c * b).sum();
            assert!((at.distance(*point) - found.distance).abs() < 1e-12);
        }
    }

    #[test]
    fn a_bump_beyond_the_limit_is_rejected() {
        // The extent of the unit sphere is 2, so 0.04 is the limit.
        let bump = |p: DVec3| 1.0 + 0.2 * (-(p - DVec3::X).length_squared() / 0.08).exp();
        let target = mapped(&turned_sphere(4), |p| p * bump(p));
        for (found, point) in run(&icosphere(4), &target).iter().zip(target.vertices()) {
            let height = point.length() - 1.0;
            assert!(height < 0.05 || !found.accepted, "{height}");
            assert!(height > 0.005 || found.accepted, "{height}");
        }
    }

    #[test]
    fn a_finger_does_not_match_its_neighbour() {
        // Two thin fingers on the source side by side; the target's only finger leans from one to
        // the other and lies in between for some of its length.
        let finger = |x: f64| mapped(&tube(0.1, 4.0, 16, 60), |p| p + DVec3::X * x);
        let source = joined(&finger(0.0), &finger(0.26));
        let target = mapped(&tube(0.1, 4.0, 16, 60), |p| p + DVec3::X * (0.01 + 0.06 * p.z / 4.0));
        let found = run(&source, &target);
        let half = source.triangles().len() as u32 / 2;
        let accepted = found.iter().filter(|m| m.accepted).count();
        assert!(accepted > found.len() / 2, "{accepted}");
        assert!(found.iter().all(|m| !m.accepted || m.triangle < half));
    }

    #[test]
    fn cloth_over_a_body_matches_on_both_of_its_sides() {
        let outer = mapped(&tube(0.5, 1.0, 48, 24), |p| p * DVec3::new(1.02, 1.02, 1.0) + DVec3::Z * 0.5);
        let inside_out: Vec<[u32; 3]> = outer.triangles().iter().map(|&[a, b, c]| [a, c, b]).collect();
        let inner = mapped(&outer, |p| p * DVec3::new(0.995, 0.995, 1.0));
        let inner = TriangleMesh::new(inner.vertices().to_vec(), inside_out).unwrap();
        let body = tube(0.5, 2.0, 48, 60);
        for cloth in [outer.clone(), inner.clone()] {
            let found = run(&body, &cloth);
            assert!(found.iter().all(|m| m.accepted), "one layer");
        }
        let found = run(&body, &joined(&outer, &inner));
        let share = found.iter().filter(|m| m.accepted).count() as f64 / found.len() as f64;
        assert!(share > 0.95, "{share}");
    }

    #[test]
    fn a_cloth_of_two_layers_that_a_hem_joins_matches_on_both() {
        // Up outside, around the hem, down inside.
        let profile = |s: f64| match s - 1.0 {
            up if up < -0.002 => (0.52, 0.5 + up + 1.0),
            down if down > 0.002 => (0.516, 1.5 - down),
            _ => (0.518, 1.502),
        };
        let cloth = mapped(&tube(1.0, 2.0, 48, 96), |p| {
            let (radius, height) = profile(p.z);
            DVec3::new(radius * p.x, radius * p.y, height)
        });
        let found = run(&tube(0.5, 2.0, 48, 60), &cloth);
        let share = found.iter().filter(|m| m.accepted).count() as f64 / found.len() as f64;
        assert!(share > 0.95, "{share}");
    }

    #[test]
    fn what_hangs_beyond_an_open_edge_is_rejected() {
        let (short, long) = (tube(0.5, 1.0, 48, 24), tube(0.5, 2.0, 47, 50));
        for (found, point) in run(&short, &long).iter().zip(long.vertices()) {
            assert_eq!(found.accepted, point.z <= 1.02, "{point}");
        }
    }

    #[test]
    fn neither_order_nor_place_nor_scale_matters() {
        let bump = |p: DVec3| 1.0 + 0.2 * (-(p - DVec3::X).length_squared() / 0.08).exp();
        let (source, target) = (icosphere(3), mapped(&turned_sphere(3), |p| p * bump(p)));
        let found = run(&source, &target);
        let place = |mesh: &TriangleMesh, m: &SurfaceMatch| -> DVec3 {
            mesh.corners(m.triangle as usize).iter().zip(m.barycentric).map(|(&c, b)| c * b).sum()
        };
        let ((source_shuffled, _), (shuffled, new)) = (permuted(&source), permuted(&target));
        let again = run(&source_shuffled, &shuffled);
        for (v, &n) in new.iter().enumerate() {
            let (a, b) = (&found[v], &again[n as usize]);
            assert_eq!(a.accepted, b.accepted);
            assert!(place(&source, a).distance(place(&source_shuffled, b)) < 1e-6);
        }
        for scale in [1e-2, 1e2] {
            let motion = similarity(scale);
            let [s, t] = [&source, &target].map(|mesh| mapped(mesh, |p| motion.transform_point3(p)));
            for (a, b) in found.iter().zip(run(&s, &t)) {
                assert_eq!(a.accepted, b.accepted);
                let expected = motion.transform_point3(place(&source, a));
                assert!(expected.distance(place(&s, &b)) < 1e-4 * scale);
            }
        }
    }

    #[test]
    fn the_number_of_threads_does_not_change_a_bit() {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| run(&icosphere(3), &turned_sphere(3)))
        };
        assert_eq!(on(1), on(3));
    }
}
