//! A registered surface slides along the target until it lies there evenly.
//!
//! Closest points pull across a surface and never along it, so where the target bulges or hollows, a
//! registration keeps the places that the warp gave: the skin of a sagging belly lies too high. Stretch
//! tells better. Of all ways to lie on the target, the surface takes the one of least Dirichlet energy,
//! a harmonic map (Eells and Sampson 1964), held where it was as firmly as the warp is to be trusted:
//!
//! min ½ ∫ |∇x|² + ½ ∫ |x − x₀|² / ℓ², x on the target,
//!
//! integrals over the source at rest, but in the target's pose: what a bend stretches is no matter of
//! shape. ℓ is the length over which stretch evens out. The warp knows the place along a bone the better
//! the thinner the limb is, and a thin limb has the finer shape too: ℓ grows with the square of the
//! radius. A surface on a copy of itself stays where it is. Where shapes differ altogether, even stretch
//! is no more likely than any other, and nothing slides.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use super::bilaplacian::Bilaplacian;
use super::bone_rays::median;
use super::icp::{Surroundings, closest_pull};
use super::joint_system::largest_bone;
use super::shell::Shell;
use crate::linalg::{Ending, SymmetricMatrix, conjugate_gradients};
use crate::mesh::TriangleMesh;
use crate::parallel::map_indices;
use crate::progress::Progress;
use crate::rig::{Skeleton, distance_to_segment};
use crate::skinning::SkinWeights;
use crate::spectral::{Laplacian, SpectralError};

/// Radius, as a share of the square root of the area, at which stretch evens out over as much.
const AS_LONG_AS_THICK: f64 = 0.0175;
/// Stretch evens out at least over this share of the square root of the area.
const SHORTEST: f64 = 1e-4;
/// Share of the distance to a landmark of the user over which stretch may even out.
const OFF_LANDMARKS: f64 = 0.5;
/// Times ℓ where nothing of the target is near: what pulls there has no counterpart.
const UNMATCHED: f64 = 0.1;
/// A garment does not lie on a body as evenly as skin does: times ℓ the share of the surface, by area, that the
/// target holds, to this power.
const GARMENT: i32 = 4;
/// Rounds of closest points.
const ROUNDS: u32 = 3;
/// Largest angle of the normals, in degrees, and largest distance, as a share of the target's extent.
const MAX_ANGLE: f64 = 75.0;
const MAX_DISTANCE: f64 = 0.02;
/// When a round's system is solved.
const SOLVED: Ending = Ending { residual: 1e-9, steps: 3000 };

/// Length ℓ for every vertex (V), in the source's unit. `landmarks` are places of the source that stay;
/// where shapes differ, by a share from 0 to 1, stretch says less.
pub(super) fn lengths(
    (source, weights): (&TriangleMesh, &SkinWeights),
    skeleton: &Skeleton,
    landmarks: &[DVec3],
    difference: f64,
) -> Vec<f64> {
    let vertices = source.vertices();
    let mut of_bone = vec![Vec::new(); skeleton.bone_count()];
    for (v, &point) in vertices.iter().enumerate() {
        if let Some(bone) = largest_bone(weights, v).map(|bone| bone as usize) {
            of_bone[bone].push(distance_to_segment(point, skeleton.heads()[bone], skeleton.tails()[bone]));
        }
    }
    let radius: Vec<f64> = of_bone.into_iter().map(|radii| median(radii).unwrap_or(0.0)).collect();
    let area: f64 = (0..source.triangles().len()).map(|t| source.area_vector(t).length()).sum::<f64>() / 2.0;
    let size = area.sqrt();
    let length = |v: usize| {
        let sum: f64 =
            weights.entries(v).map(|(bone, weight)| f64::from(weight) * radius[bone as usize]).sum();
        let total = weights.total(v);
        let radius = if total > 0.0 { sum / total } else { 0.0 };
        let free = landmarks.iter().map(|mark| mark.distance(vertices[v])).fold(f64::INFINITY, f64::min);
        let evened = (1.0 - difference) * radius * radius / (AS_LONG_AS_THICK * size);
        evened.min(OFF_LANDMARKS * free).max(SHORTEST * size)
    };
    (0..vertices.len()).map(length).collect()
}

/// Where the vertices of a surface go that lies on the target as `start` and whose vertices at rest are
/// `posed`, each with its length. The outside is that of `shell`.
///
/// # Errors
/// [`SpectralError`] for a surface without area, or when `progress` was cancelled.
pub(super) fn slide(
    (surface, start): (&Bilaplacian, &[DVec3]),
    (posed, lengths): (&[DVec3], &[f64]),
    shell: &Shell,
    target: Surroundings<'_>,
    progress: &Progress,
) -> Result<Vec<DVec3>, SpectralError> {
    let triangles = surface.welded.triangles();
    let rest = TriangleMesh::new(posed.to_vec(), triangles.to_vec())?;
    let Laplacian { stiffness, areas } = Laplacian::new(&rest)?;
    let bias = Bias::new(&stiffness, posed, shell.normals_of(&rest));
    let shortest = SHORTEST * areas.iter().sum::<f64>().sqrt();
    let mut is_open = vec![false; start.len()];
    let boundary = surface.welded.topology().boundary_edges();
    boundary.iter().flatten().for_each(|&v| is_open[v as usize] = true);
    let mut vertices = start.to_vec();
    for round in 0..ROUNDS {
        let shares = [round, round + 1].map(|round| f64::from(round) / f64::from(ROUNDS));
        let current = TriangleMesh::new(vertices.clone(), triangles.to_vec())?;
        let normals = shell.normals_of(&current);
        let farthest = MAX_DISTANCE * target.shell.extent;
        let planes = map_indices(vertices.len(), progress, shares, |v, (): &mut ()| {
            if surface.shares[v] <= 0.0 || is_open[v] {
                return Plane::default();
            }
            match closest_pull(vertices[v], normals[v], shell.two_sided[v], target, MAX_ANGLE) {
                Some(pull) => {
                    let near = (2.0 * (1.0 - pull.distance / farthest)).clamp(0.0, 1.0);
                    Plane {
                        step: pull.position - vertices[v],
                        normal: pull.normal,
                        hold: near * pull.agreement,
                    }
                }
                None => Plane::default(),
            }
        })?;
        let held: f64 = areas.iter().zip(&planes).map(|(area, plane)| area * plane.hold).sum();
        let covered = (held / areas.iter().sum::<f64>()).powi(GARMENT);
        let pulls = (0..vertices.len()).map(|v| {
            // Nothing pulls outward at an open edge: without a hold there it would contract.
            let length = if is_open[v] {
                shortest
            } else {
                (covered * lengths[v] * (UNMATCHED + (1.0 - UNMATCHED) * planes[v].hold)).max(shortest)
            };
            areas[v] / length.powi(2)
        });
        let pulls: Vec<f64> = pulls.collect();
        let diagonal = stiffness.diagonal().into_iter().zip(&pulls);
        let diagonal = diagonal.map(|(a, b)| if a + b > 0.0 { a + b } else { 1.0 }).collect();
        let system = Tangential { stiffness: &stiffness, pulls, diagonal, planes: &planes };
        let base: Vec<DVec3> =
            vertices.iter().zip(&planes).map(|(&p, plane)| p + plane.step * plane.hold).collect();
        let bias = bias.at(&stiffness, &vertices, &normals);
        vertices = system.solve(&base, start, &bias, progress)?;
    }
    for (v, &stand) in surface.stands_for.iter().enumerate() {
        vertices[v] = vertices[stand as usize];
    }
    progress.report(1.0)?;
    Ok(vertices)
}

/// The target's tangent plane for a vertex.
#[derive(Debug, Clone, Copy, Default)]
struct Plane {
    /// Way to it.
    step: DVec3,
    normal: DVec3,
    /// How firmly it holds the vertex, 0 to 1.
    hold: f64,
}

impl Plane {
    /// A step in which the firmness of the plane has no unit, as a displacement.
    fn eased(&self, step: DVec3) -> DVec3 {
        step - self.normal * ((1.0 - (1.0 - self.hold).sqrt()) * self.normal.dot(step))
    }
}

/// The energy's second derivative A = K + diag(pulls), and the planes.
struct Tangential<'a> {
    stiffness: &'a SymmetricMatrix,
    pulls: Vec<f64>,
    /// Of A (V); not zero.
    diagonal: Vec<f64>,
    planes: &'a [Plane],
}

impl Tangential<'_> {
    /// (P A P + D) u for a step u without units, P u being the displacement.
    fn product(&self, u: &[DVec3]) -> Vec<DVec3> {
        let eased: Vec<DVec3> = (0..u.len()).into_par_iter().map(|v| self.planes[v].eased(u[v])).collect();
        let row = |v: usize| {
            let plane = &self.planes[v];
            let bent = plane.eased(stretch(self.stiffness, &eased, v) + eased[v] * self.pulls[v]);
            bent + plane.normal * (self.diagonal[v] * plane.hold * plane.normal.dot(u[v]))
        };
        (0..u.len()).into_par_iter().map(row).collect()
    }

    /// The least energy among base + P u: P A P u = −P (K base + pulls (base − start) − bias).
    fn solve(
        &self,
        base: &[DVec3],
        start: &[DVec3],
        bias: &[DVec3],
        progress: &Progress,
    ) -> Result<Vec<DVec3>, SpectralError> {
        let vectors = |u: &[f64]| -> Vec<DVec3> { u.chunks_exact(3).map(DVec3::from_slice).collect() };
        let product = |u: &[f64]| {
            let product = (!progress.is_cancelled()).then(|| self.product(&vectors(u)))?;
            Some(product.into_iter().flat_map(|p| p.to_array()).collect())
        };
        let force = |v: usize| {
            let force = stretch(self.stiffness, base, v) + (base[v] - start[v]) * self.pulls[v] - bias[v];
            (-self.planes[v].eased(force)).to_array()
        };
        let right: Vec<f64> = (0..base.len()).flat_map(force).collect();
        let diagonal: Vec<f64> = self.diagonal.iter().flat_map(|&entry| [entry; 3]).collect();
        let u = conjugate_gradients(product, &diagonal, &right, SOLVED)?;
        let moved = base.iter().zip(vectors(&u)).zip(self.planes);
        Ok(moved.map(|((&p, step), plane)| p + plane.eased(step)).collect())
    }
}

/// K x at a vertex.
fn stretch(stiffness: &SymmetricMatrix, x: &[DVec3], v: usize) -> DVec3 {
    let (rows, values) = stiffness.column(v);
    rows.iter().zip(values).map(|(&n, &value)| x[n] * value).sum()
}

/// What K x shows of an even stretch, which should show nothing along the surface.
///
/// K x is a normal of the surface wherever it lies evenly, but only up to how fine it is, and the
/// target's normal is another one in a crease. So its share along the surface's own normal does not
/// count, nor does what the surface at rest has across its normal.
struct Bias {
    normals: Vec<DVec3>,
    /// K x at rest, across the normals.
    across: Vec<DVec3>,
    /// Sum of the squared lengths of the edges at a vertex.
    edges: Vec<f64>,
}

impl Bias {
    fn new(stiffness: &SymmetricMatrix, rest: &[DVec3], normals: Vec<DVec3>) -> Self {
        let across = |v: usize| {
            let stretch = stretch(stiffness, rest, v);
            stretch - normals[v] * normals[v].dot(stretch)
        };
        let across = (0..rest.len()).into_par_iter().map(across).collect();
        Self { across, edges: edges(stiffness, rest), normals }
    }

    /// The bias once the vertices have moved and have these normals.
    fn at(&self, stiffness: &SymmetricMatrix, points: &[DVec3], normals: &[DVec3]) -> Vec<DVec3> {
        let edges = edges(stiffness, points);
        let bias = |v: usize| {
            let along = normals[v] * normals[v].dot(stretch(stiffness, points, v));
            if self.edges[v] <= 0.0 {
                return along;
            }
            let turn = DQuat::from_rotation_arc(self.normals[v], normals[v]);
            along + turn * self.across[v] * (edges[v] / self.edges[v]).sqrt()
        };
        (0..points.len()).into_par_iter().map(bias).collect()
    }
}

/// For each vertex the sum of the squared lengths of its edges.
fn edges(stiffness: &SymmetricMatrix, points: &[DVec3]) -> Vec<f64> {
    let sum = |v: usize| stiffness.column(v).0.iter().map(|&n| points[n].distance_squared(points[v])).sum();
    (0..points.len()).into_par_iter().map(sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::SurfaceQuery;
    use crate::mesh::test_surfaces::{icosphere, mapped, permuted, similarity, tube};

    /// Slides `start` along `target`; `rest` is the surface at rest, its lengths all `length`.
    fn run(rest: &TriangleMesh, start: &TriangleMesh, target: &TriangleMesh, length: f64) -> Vec<DVec3> {
        let progress = Progress::new();
        let queries = [rest, target].map(|mesh| SurfaceQuery::new(mesh).unwrap());
        let shells = [(rest, &queries[0]), (target, &queries[1])]
            .map(|(mesh, query)| Shell::new(mesh, query, &progress).unwrap());
        let at = |i: usize, mesh| Surroundings { mesh, query: &queries[i], shell: &shells[i] };
        let surface = Bilaplacian::new(start, &[]).unwrap();
        let lengths = vec![length; rest.vertex_count()];
        slide((&surface, start.vertices()), (rest.vertices(), &lengths), &shells[0], at(1, target), &progress)
            .unwrap()
    }

    /// A sphere turned out of the axes: a point inside then never has two closest points.
    fn turned_sphere(level: usize) -> TriangleMesh {
        let turn = DQuat::from_axis_angle(DVec3::new(0.3, 0.5, -0.8).normalize(), 0.4);
        mapped(&icosphere(level), |p| turn * p)
    }

    /// Points of the unit sphere moved along it, off its waist. (Lifting all of them would not do: that
    /// map is conformal and as harmonic as none.)
    fn stretched(sphere: &TriangleMesh) -> TriangleMesh {
        mapped(sphere, |p| (p + DVec3::Z * 0.25 * p.z).normalize())
    }

    fn mean_distance(a: &[DVec3], b: &[DVec3]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a.distance(*b)).sum::<f64>() / a.len() as f64
    }

    #[test]
    fn a_surface_on_a_copy_of_itself_stays() {
        for rest in [icosphere(3), tube(0.3, 2.0, 24, 40)] {
            let found = run(&rest, &rest, &rest, 1.0);
            let off = mean_distance(&found, rest.vertices());
            assert!(off < 1e-4, "{off}");
        }
        // A finer copy, in whose creases the normals are others.
        let ridged = |level| mapped(&icosphere(level), |p| p * (1.0 + 0.1 * (8.0 * p.z).sin()));
        let (coarse, fine) = (ridged(3), ridged(4));
        let found = run(&coarse, &coarse, &fine, 0.5);
        let off = mean_distance(&found, coarse.vertices());
        assert!(off < 4e-3, "{off}");
    }

    #[test]
    fn uneven_stretch_evens_out_as_far_as_the_length_says() {
        // A ball of two thirds of the target's size, laid on it with its waist too wide.
        let (sphere, target) = (icosphere(3), turned_sphere(4));
        let rest = mapped(&sphere, |p| p * 2.0 / 3.0);
        let start = stretched(&sphere);
        let off = |found: &[DVec3]| mean_distance(found, sphere.vertices());
        let before = off(start.vertices());
        assert!(before > 0.06, "{before}");
        let [long, short] = [2.0, 0.01].map(|length| run(&rest, &start, &target, length));
        assert!(off(&long) < 0.3 * before, "{} of {before}", off(&long));
        assert!(off(&short) > 0.95 * before, "{} of {before}", off(&short));
        let lies = |found: &[DVec3]| found.iter().map(|p| (p.length() - 1.0).abs()).fold(0.0, f64::max);
        assert!(lies(&long) < 0.01, "{}", lies(&long));
    }

    #[test]
    fn what_has_no_counterpart_stays() {
        // The upper half of the target is missing: what lies beyond its rim is not drawn together.
        let sphere = icosphere(3);
        let half: Vec<[u32; 3]> = (0..sphere.triangles().len())
            .filter(|&t| sphere.corners(t).iter().all(|p| p.z < 0.1))
            .map(|t| sphere.triangles()[t])
            .collect();
        let target = TriangleMesh::new(sphere.vertices().to_vec(), half).unwrap();
        let found = run(&sphere, &sphere, &target, 0.2);
        for (p, q) in found.iter().zip(sphere.vertices()) {
            assert!(p.distance(*q) < 0.03, "{q} goes to {p}");
        }
    }

    #[test]
    fn neither_order_nor_place_nor_scale_matters() {
        let (rest, target) = (icosphere(3), turned_sphere(3));
        let start = stretched(&rest);
        let found = run(&rest, &start, &target, 0.5);
        let ((rest_shuffled, new), (target_shuffled, _)) = (permuted(&rest), permuted(&target));
        let again = run(&rest_shuffled, &permuted(&start).0, &target_shuffled, 0.5);
        for (v, &n) in new.iter().enumerate() {
            assert!(found[v].distance(again[n as usize]) < 1e-7, "vertex {v}");
        }
        // The source has a unit of its own, in which the length is.
        for scale in [1e-2, 1e2] {
            let motion = similarity(scale);
            let moved = |mesh: &TriangleMesh| mapped(mesh, |p| motion.transform_point3(p));
            let again = run(&rest, &moved(&start), &moved(&target), 0.5);
            let smaller = mapped(&rest, |p| p * scale);
            let rescaled = run(&smaller, &start, &target, 0.5 * scale);
            for v in 0..found.len() {
                assert!(motion.transform_point3(found[v]).distance(again[v]) < 1e-4 * scale);
                assert!(rescaled[v].distance(found[v]) < 1e-6);
            }
        }
    }

    #[test]
    fn the_number_of_threads_does_not_change_a_bit() {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| run(&icosphere(3), &stretched(&icosphere(3)), &turned_sphere(3), 0.5))
        };
        assert_eq!(on(1), on(3));
    }

    #[test]
    fn thick_limbs_slide_far_and_landmarks_not_at_all() {
        use crate::rig::Skeleton;
        let source = mapped(&tube(0.3, 4.0, 24, 60), |p| {
            p * if p.z > 2.0 { DVec3::new(0.2, 0.2, 1.0) } else { DVec3::ONE }
        });
        let at = |z| DVec3::new(0.0, 0.0, z);
        let skeleton = Skeleton::new(vec![at(0.0), at(2.0)], vec![at(2.0), at(4.0)], &[-1, 0], None).unwrap();
        let rows = source.vertices().iter().map(|p| vec![(u32::from(p.z > 2.0), 1.0)]);
        let weights = SkinWeights::from_rows(rows, 2);
        let mark = source.vertices()[0];
        let all = lengths((&source, &weights), &skeleton, &[], 0.0);
        let marked = lengths((&source, &weights), &skeleton, &[mark], 0.0);
        let differing = lengths((&source, &weights), &skeleton, &[], 1.0);
        let (low, high) = (0, source.vertex_count() - 1);
        assert!((all[low] / all[high] / 25.0 - 1.0).abs() < 0.2, "{} {}", all[low], all[high]);
        assert!(marked[low] < 1e-3 && (marked[high] - all[high]).abs() < 1e-12);
        assert!(differing.iter().all(|length| *length < 1e-3));
    }
}
