//! Which vertices of the target lie close enough to the deformed source to take its weights, and
//! where on it they lie.
//!
//! A match is tested by the angle of the normals, by distance (a limb's own thickness bounds it), by
//! its neighbours (places near along the target must lie near along the source), and by the way
//! back from the source. What fails is left to inpainting; a wrong rejection costs little, a wrong
//! match shows.

use glam::DVec3;

use super::geodesic::{Ball, joined_by_two_edges};
use super::icp::Surroundings;
use crate::mesh::{Adjacency, ClosestPoint, MeshError, TriangleMesh};
use crate::parallel::map_indices;
use crate::progress::Progress;
use crate::spectral::SpectralError;

/// How much longer than the straight way the way along the surface may be.
const DETOUR: f64 = 3.0;
/// Radius of the smallest patch of matches that may stand alone, as a share of the extent.
const SMALLEST_PATCH: f64 = 0.015;
/// Least share of a part that makes even a small patch stand.
const MOST_OF_PART: f64 = 0.5;

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
        let returns = edges.returns(v, &candidates[v], target, ball);
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

#[derive(Debug, Clone, Copy)]
struct Candidate {
    at: ClosestPoint,
    agreement: f64,
    passes: bool,
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

#[derive(Debug, Default)]
struct Verdict {
    /// Neighbours whose matches passed too, and whether they lie near along the source.
    consistent: Vec<(u32, bool)>,
    /// Whether the way back from the source ends near.
    returns: bool,
}

/// Edges of both surfaces with their seams closed.
struct Neighbours {
    source: TriangleMesh,
    target: TriangleMesh,
    source_edges: Adjacency,
    target_edges: Adjacency,
    stands_for: Vec<u32>,
    components: Vec<u32>,
}

impl Neighbours {
    fn new(target: Surroundings<'_>, source: &Surroundings<'_>) -> Result<Self, SpectralError> {
        let (source, target_mesh) = (source.shell.welded(source.mesh)?, target.shell.welded(target.mesh)?);
        let topology = target_mesh.topology();
        Ok(Self {
            source_edges: Adjacency::new(source.vertex_count(), &source.topology()),
            target_edges: Adjacency::new(target_mesh.vertex_count(), &topology),
            components: topology.components().to_vec(),
            stands_for: target.shell.stands_for().to_vec(),
            source,
            target: target_mesh,
        })
    }

    fn neighbours(&self, v: usize) -> &[u32] {
        self.target_edges.neighbours(self.stands_for[v] as usize)
    }

    /// Whether each neighbour's match lies near the vertex's own along the source.
    fn consistent(
        &self,
        v: usize,
        candidates: &[Candidate],
        source: Surroundings<'_>,
        ball: &mut Ball,
    ) -> Vec<(u32, bool)> {
        let own = &candidates[v].at;
        let coarse = |at: &ClosestPoint| {
            let [a, b, c] = source.mesh.corners(at.triangle as usize);
            a.distance(b).max(b.distance(c)).max(c.distance(a))
        };
        let neighbours = self.neighbours(v).iter().filter(|n| candidates[**n as usize].passes);
        let corners = |at: &ClosestPoint| self.source.triangles()[at.triangle as usize];
        let mut grown = -1.0;
        neighbours
            .map(|&n| {
                let at = &candidates[n as usize].at;
                if corners(at).iter().any(|corner| corners(own).contains(corner)) {
                    return (n, true);
                }
                let straight = self.target.vertices()[v].distance(self.target.vertices()[n as usize]);
                let slack = coarse(own) + coarse(at);
                let bound = DETOUR * straight + own.distance + at.distance + slack;
                // The way is mostly short and straight, and then a look around or a small ball decides.
                let ends = [own, at].map(|at| (corners(at), at.position));
                if joined_by_two_edges(&self.source, &self.source_edges, ends[0], ends[1], bound) {
                    return (n, true);
                }
                let likely = (1.2 * own.position.distance(at.position) + slack).min(bound);
                for radius in [likely, bound] {
                    if grown < radius {
                        ball.grow(&self.source, &self.source_edges, corners(own), own.position, radius);
                        grown = radius;
                    }
                    if ball.distance(&self.source, corners(at), at.position) <= bound {
                        return (n, true);
                    }
                }
                (n, false)
            })
            .collect()
    }

    /// Whether the match leaps by more than `stretch` times an edge, from limb to limb.
    fn tears(&self, v: usize, candidates: &[Candidate], stretch: f64) -> bool {
        let (at, place) = (self.target.vertices(), |v: usize| candidates[v].at.position);
        let leaps = |n: usize| place(v).distance(place(n)) > stretch * at[v].distance(at[n]);
        self.neighbours(v).iter().any(|&n| leaps(n as usize))
    }

    /// Whether the target's point closest to the match lies near the vertex along the target.
    fn returns(&self, v: usize, candidate: &Candidate, target: Surroundings<'_>, ball: &mut Ball) -> bool {
        let Some(home) = target.closest(candidate.at.position) else {
            return false;
        };
        let point = target.mesh.vertices()[v];
        let longest = |v: usize| {
            let from = self.target.vertices()[self.stands_for[v] as usize];
            let length = |n: &u32| from.distance(self.target.vertices()[*n as usize]);
            self.neighbours(v).iter().map(length).fold(0.0, f64::max)
        };
        let radius = DETOUR * home.position.distance(point) + 2.0 * longest(v);
        let own = self.stands_for[v];
        let corners = self.target.triangles()[home.triangle as usize];
        // Another layer or part right there is no contradiction: it lies where this one does.
        if self.components[corners[0] as usize] != self.components[own as usize] {
            return true;
        }
        let near = |corner: &u32| *corner == own || self.neighbours(v).contains(corner);
        if corners.iter().any(near) {
            return true;
        }
        let ends = [([own; 3], point), (corners, home.position)];
        if joined_by_two_edges(&self.target, &self.target_edges, ends[0], ends[1], radius) {
            return true;
        }
        ball.grow(&self.target, &self.target_edges, [own; 3], point, radius);
        ball.distance(&self.target, corners, home.position) <= radius
    }

    /// Takes away small patches of matches that contradict or miss what is around them.
    fn without_small_patches(
        &self,
        passes: &[bool],
        verdicts: &[Verdict],
        target: &TriangleMesh,
        smallest: f64,
    ) -> Vec<bool> {
        let count = passes.len();
        let mut areas = vec![0.0; count];
        for (t, triangle) in self.target.triangles().iter().enumerate() {
            let share = target.area_vector(t).length() / 6.0;
            triangle.iter().for_each(|&v| areas[v as usize] += share);
        }
        let mut part_areas = vec![0.0; count];
        for (v, area) in areas.iter().enumerate() {
            part_areas[self.components[v] as usize] += area;
        }
        let mut accepted = passes.to_vec();
        let mut seen = vec![false; count];
        for first in (0..count).filter(|&v| passes[v] && self.stands_for[v] as usize == v) {
            if std::mem::replace(&mut seen[first], true) {
                continue;
            }
            let (mut patch, mut next, mut area) = (vec![first], 0, 0.0);
            while let Some(&v) = patch.get(next) {
                next += 1;
                area += areas[v];
                for (n, agrees) in &verdicts[v].consistent {
                    let n = *n as usize;
                    if *agrees && passes[n] && !std::mem::replace(&mut seen[n], true) {
                        patch.push(n);
                    }
                }
            }
            let part = part_areas[self.components[first] as usize];
            if area < smallest && area < MOST_OF_PART * part {
                patch.iter().for_each(|&v| accepted[v] = false);
            }
        }
        (0..count).map(|v| accepted[v] && accepted[self.stands_for[v] as usize]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::shell::Shell;
    use super::*;
    use crate::mesh::SurfaceQuery;
    use crate::mesh::test_surfaces::{icosphere, joined, mapped, permuted, similarity, tube};

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
