//! Non-rigid iterative closest points: a deformed surface snaps onto another one where both are
//! alike, and follows its marks and its neighbours elsewhere.
//!
//! Each round pulls every vertex to the closest point of the target, if that lies near and faces
//! the same way, and solves for the smoothest change (see [`super::deform`]). From round to round
//! shorter waves are allowed.

use glam::DVec3;

use super::deform::{Deformed, Deformer};
use super::shell::{Shell, median, tie_break};
use crate::mesh::{ClosestPoint, SurfaceQuery, TriangleMesh};
use crate::parallel::map_indices;
use crate::progress::Progress;
use crate::spectral::SpectralError;

/// Closest points on an open edge count up to this share of the extent.
const NEGLIGIBLE: f64 = 2e-3;
/// Distances above this multiple of the median are too large,
const FAR: f64 = 4.0;
/// but those below this share of the largest distance are not.
const NEVER_FAR: f64 = 0.25;

/// Places whose distances differ by less than this share of the extent are equally near.
const EQUALLY_NEAR: f64 = 1e-7;
/// Two places nearer to each other than this share are one.
const SAME_PLACE: f64 = 1e-5;

/// Settings of the rounds.
#[derive(Debug, Clone, PartialEq)]
pub struct IcpSettings {
    /// For each round the length that the surface smooths over, as a share of the square root of
    /// its area.
    pub smoothing_lengths: Vec<f64>,
    /// Largest angle of the two surfaces' normals, in degrees.
    pub max_angle: f64,
    /// Largest distance, as a share of the target's extent.
    pub max_distance: f64,
}

impl Default for IcpSettings {
    fn default() -> Self {
        Self { smoothing_lengths: vec![0.1, 0.06, 0.035, 0.02], max_angle: 45.0, max_distance: 0.05 }
    }
}

/// A surface after the rounds.
#[derive(Debug, Clone, PartialEq)]
pub struct Registered {
    /// Vertices (V).
    pub vertices: Vec<DVec3>,
    /// Whether the target pulled the vertex in the last round (V).
    pub pulled: Vec<bool>,
}

/// The target of a registration, prepared for queries.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// The surface.
    pub mesh: &'a TriangleMesh,
    /// Queries on it.
    pub query: &'a SurfaceQuery,
    /// Its outside and thickness.
    pub shell: &'a Shell,
}

impl Surroundings<'_> {
    /// The closest point of the surface.
    pub(super) fn closest(&self, point: DVec3) -> Option<ClosestPoint> {
        let mut found = self.query.closest_point(point + tie_break(self.shell.extent))?;
        found.distance = found.position.distance(point);
        Some(found)
    }

    /// The place on the other side of a point that is as near to it as that on a triangle at a distance, if there is
    /// one: both count, as on the mirror plane of a body, or the order of triangles and the axes would decide.
    pub(super) fn equally_close(&self, point: DVec3, distance: f64, triangle: u32) -> Option<ClosestPoint> {
        let extent = self.shell.extent;
        let mut other = self.query.closest_point(point - tie_break(extent))?;
        other.distance = other.position.distance(point);
        let is_tie = (other.distance - distance).abs() <= EQUALLY_NEAR * extent;
        (is_tie && other.triangle != triangle).then_some(other)
    }
}

/// Pulls the surface of `deformer`, which starts as `start`, onto the target.
///
/// # Errors
/// [`SpectralError`] when a factorisation fails or `progress` was cancelled.
pub fn register(
    deformer: &Deformer,
    start: &Deformed,
    target: Surroundings<'_>,
    settings: &IcpSettings,
    progress: &Progress,
) -> Result<Registered, SpectralError> {
    let surface = deformer.surface();
    let triangles = surface.welded.triangles();
    let mut vertices = start.vertices.clone();
    let mut pulled = vec![false; vertices.len()];
    let mut current = TriangleMesh::new(vertices.clone(), triangles.to_vec())?;
    let shell = {
        let _first = progress.section(0.0, 0.2);
        Shell::new(&current, &SurfaceQuery::new(&current)?, progress)?
    };
    let _rest = progress.section(0.2, 1.0);
    let rounds = settings.smoothing_lengths.len();
    for (round, length) in settings.smoothing_lengths.iter().enumerate() {
        let shares = [round, round + 1].map(|r| r as f64 / rounds.max(1) as f64);
        let normals = shell.normals_of(&current);
        let found = map_indices(vertices.len(), progress, shares, |v, (): &mut ()| {
            let agrees =
                |p: &ClosestPull| p.distance <= reach(&shell, v, settings.max_distance * target.shell.extent);
            (surface.shares[v] > 0.0)
                .then(|| {
                    closest_pull(vertices[v], normals[v], shell.two_sided[v], target, settings.max_angle)
                })
                .flatten()
                .filter(agrees)
        })?;
        let typical = median(found.iter().flatten().map(|p| p.distance).collect());
        let bound = (FAR * typical).max(NEVER_FAR * settings.max_distance * target.shell.extent);
        let closeness = length.powi(-4);
        let pulls: Vec<Option<(DVec3, f64)>> = found
            .iter()
            .enumerate()
            .map(|(v, pull)| {
                let pull = pull.as_ref()?;
                // Fading out instead of dropping out keeps the result a smooth function of the input.
                let near = (1.0 - (pull.distance / bound).powi(2)).max(0.0);
                let weight = closeness * surface.shares[v] * near * near * pull.agreement;
                (weight > 0.0).then_some((pull.position, weight))
            })
            .collect();
        vertices = deformer.solve(&start.vertices, &start.kept, &pulls)?.0;
        pulled = pulls.iter().map(Option::is_some).collect();
        current = TriangleMesh::new(vertices.clone(), triangles.to_vec())?;
    }
    for (v, &stand) in surface.stands_for.iter().enumerate() {
        pulled[v] = pulled[stand as usize];
    }
    progress.report(1.0)?;
    Ok(Registered { vertices, pulled })
}

/// The closest point of a target that faces the same way.
pub(super) struct ClosestPull {
    pub(super) position: DVec3,
    /// Outward normal of the target there.
    pub(super) normal: DVec3,
    pub(super) distance: f64,
    /// 0 at the largest angle, 1 from two thirds of it on.
    pub(super) agreement: f64,
}

/// A limb is never pulled across its own thickness; an eighth of the reach is always allowed.
fn reach(shell: &Shell, v: usize, farthest: f64) -> f64 {
    shell.thickness[v].clamp(0.125 * farthest, farthest)
}

/// What pulls a point of a surface with its outward normal; nothing beyond a sheet's open edge.
pub(super) fn closest_pull(
    point: DVec3,
    normal: DVec3,
    two_sided: bool,
    target: Surroundings<'_>,
    max_angle: f64,
) -> Option<ClosestPull> {
    let found = target.closest(point)?;
    let own = pull_to(&found, normal, two_sided, target, max_angle);
    let is_elsewhere =
        |other: &ClosestPoint| other.position.distance(found.position) > SAME_PLACE * target.shell.extent;
    let other = target.equally_close(point, found.distance, found.triangle).filter(is_elsewhere);
    let Some(other) = other else { return own };
    let other = pull_to(&other, normal, two_sided, target, max_angle);
    let (Some(own), Some(other)) = (&own, &other) else { return own.or(other) };
    let total = own.agreement + other.agreement;
    let mean = |a: DVec3, b: DVec3| (a * own.agreement + b * other.agreement) / total;
    Some(ClosestPull {
        position: mean(own.position, other.position),
        normal: mean(own.normal, other.normal).normalize_or_zero(),
        distance: own.distance,
        agreement: total / 2.0,
    })
}

/// What a place that is closest to a point does with it.
fn pull_to(
    found: &ClosestPoint,
    normal: DVec3,
    two_sided: bool,
    target: Surroundings<'_>,
    max_angle: f64,
) -> Option<ClosestPull> {
    let (facing, both) = target.shell.normal_at(target.mesh, found);
    let cosine = normal.dot(facing);
    let angle = if both || two_sided { cosine.abs() } else { cosine }.clamp(-1.0, 1.0);
    let angle = libm::acos(angle).to_degrees();
    let open =
        target.shell.is_on_open_edge(target.mesh, found) && found.distance > NEGLIGIBLE * target.shell.extent;
    let agreement = (3.0 * (1.0 - angle / max_angle)).clamp(0.0, 1.0);
    (agreement > 0.0 && !open).then_some(ClosestPull {
        position: found.position,
        normal: facing,
        distance: found.distance,
        agreement,
    })
}

#[cfg(test)]
mod tests {
    use super::super::deform::{Anchor, Constraint, DeformSettings};
    use super::*;
    use crate::mesh::test_surfaces::{icosphere, joined, mapped, permuted, similarity, tube};

    fn run(source: &TriangleMesh, target: &TriangleMesh, constraints: &[Constraint]) -> Registered {
        let progress = Progress::new();
        let deformer = Deformer::new(source, constraints).unwrap();
        let start = deformer.fit(&DeformSettings::default(), &progress).unwrap();
        let query = SurfaceQuery::new(target).unwrap();
        let shell = Shell::new(target, &query, &progress).unwrap();
        let target = Surroundings { mesh: target, query: &query, shell: &shell };
        // The shapes of these tests are as far apart as they are small.
        let settings = IcpSettings { max_distance: 0.3, ..IcpSettings::default() };
        register(&deformer, &start, target, &settings, &progress).unwrap()
    }

    #[test]
    fn two_places_that_are_equally_near_pull_alike_however_the_target_stands() {
        let limb = |x: f64| mapped(&tube(0.1, 1.0, 32, 20), |p| p + DVec3::X * x);
        let limbs = joined(&limb(-0.2), &limb(0.2));
        for turn in [0.0, 0.7, 2.0, 4.0] {
            let turn = glam::DQuat::from_axis_angle(DVec3::new(0.3, 0.5, -0.8).normalize(), turn);
            let target = mapped(&limbs, |p| turn * p);
            let query = SurfaceQuery::new(&target).unwrap();
            let shell = Shell::new(&target, &query, &Progress::new()).unwrap();
            let target = Surroundings { mesh: &target, query: &query, shell: &shell };
            // Half way between a vertex of each.
            let between = turn * DVec3::new(0.0, 0.0, 0.5);
            let pull = closest_pull(between, turn * DVec3::Y, false, target, 120.0).unwrap();
            assert!(pull.position.distance(between) < 1e-6, "{} {between}", pull.position);
            assert!((pull.distance - 0.1).abs() < 1e-6);
        }
    }

    fn ellipsoid(level: usize) -> TriangleMesh {
        mapped(&icosphere(level), |p| p * DVec3::new(1.15, 0.9, 1.0))
    }

    /// A sphere turned out of the axes: a point inside then never has two closest points.
    fn turned_sphere(level: usize) -> TriangleMesh {
        let turn = glam::DQuat::from_axis_angle(DVec3::new(0.3, 0.5, -0.8).normalize(), 0.4);
        mapped(&icosphere(level), |p| turn * p)
    }

    fn worst(vertices: &[DVec3]) -> f64 {
        vertices.iter().map(|p| (p.length() - 1.0).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn an_ellipsoid_is_pulled_onto_a_sphere() {
        let (source, target) = (ellipsoid(3), icosphere(4));
        assert!(worst(source.vertices()) > 0.14);
        let found = run(&source, &target, &[]);
        assert!(worst(&found.vertices) < 0.01, "{}", worst(&found.vertices));
        assert!(found.pulled.iter().all(|pulled| *pulled));
        // Vertices stay near their own meridian: nothing slides or folds.
        for (p, q) in source.vertices().iter().zip(&found.vertices) {
            assert!(p.normalize().dot(q.normalize()) > 0.98);
        }
    }

    #[test]
    fn an_inside_out_target_is_the_same_target() {
        let target = turned_sphere(3);
        let flipped = target.triangles().iter().map(|&[a, b, c]| [b, a, c]).collect();
        let flipped = TriangleMesh::new(target.vertices().to_vec(), flipped).unwrap();
        let (a, b) = (run(&ellipsoid(2), &target, &[]), run(&ellipsoid(2), &flipped, &[]));
        for (a, b) in a.vertices.iter().zip(&b.vertices) {
            assert!(a.distance(*b) < 1e-9, "{}", a.distance(*b));
        }
    }

    #[test]
    fn marks_hold_against_the_surface() {
        let source = ellipsoid(3);
        let position = DVec3::new(0.0, 0.0, 1.3);
        let top = (0..source.vertex_count())
            .max_by(|&a, &b| source.vertices()[a].z.total_cmp(&source.vertices()[b].z));
        let vertex = top.unwrap() as u32;
        let anchor = Anchor::Vertex(vertex);
        let found =
            run(&source, &icosphere(4), &[Constraint { anchor, position, weight: 1e7, trusted: true }]);
        assert!(found.vertices[vertex as usize].distance(position) < 0.01);
    }

    #[test]
    fn a_far_piece_comes_along() {
        let button = mapped(&icosphere(1), |p| p * 0.05 + DVec3::new(1.25, 0.0, 0.0));
        let mesh = joined(&ellipsoid(3), &button);
        let found = run(&mesh, &icosphere(4), &[]);
        let centre: DVec3 = found.vertices[642..].iter().sum::<DVec3>() / 42.0;
        assert!(centre.x < 1.15 && centre.x > 1.0, "{centre}");
    }

    #[test]
    fn neither_order_nor_place_nor_scale_matters() {
        let (source, target) = (ellipsoid(3), turned_sphere(3));
        let found = run(&source, &target, &[]);
        let ((shuffled, new), (target_shuffled, _)) = (permuted(&source), permuted(&target));
        let again = run(&shuffled, &target_shuffled, &[]);
        for (v, &n) in new.iter().enumerate() {
            let difference = found.vertices[v].distance(again.vertices[n as usize]);
            assert!(difference < 1e-6, "vertex {v}: {difference}");
        }
        for scale in [1e-2, 1e2] {
            let motion = similarity(scale);
            let moved = |mesh: &TriangleMesh| mapped(mesh, |p| motion.transform_point3(p));
            let again = run(&moved(&source), &moved(&target), &[]);
            for (p, q) in found.vertices.iter().zip(&again.vertices) {
                assert!(motion.transform_point3(*p).distance(*q) < 1e-4 * scale);
            }
        }
    }

    #[test]
    fn the_number_of_threads_does_not_change_a_bit() {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| run(&ellipsoid(3), &turned_sphere(3), &[]))
        };
        assert_eq!(on(1), on(3));
    }
}
