//! Biharmonic surface deformation: the smoothest displacement of a surface that takes marked places
//! near given positions, with wrong marks found and left out.
//!
//! Minimises A ∫ |Δ(u − a)|² + Σ_k w_k |x_k + u(x_k) − p_k|² over the displacement u, where a is
//! the affine displacement that fits the marks best and A the area (Botsch and Kobbelt 2004, on the
//! robust Laplacian). Weights have no unit: a mark of weight 100 pulls firmly on a body with some
//! hundreds of marks. A piece of the surface without any mark moves rigidly with the nearest one
//! that has some.

use glam::DVec3;
use rayon::prelude::*;

use super::bilaplacian::{Bilaplacian, factor};
pub use super::marks::{Anchor, Constraint};
use super::marks::{Mark, affine};
use super::rigid_fit::rigid_fit;
use super::shell::median;
use crate::linalg::{Cholesky, SymbolicCholesky, diagonal_of_inverse};
use crate::mesh::{Adjacency, Submesh, SurfaceQuery, TriangleMesh};
use crate::progress::Progress;
use crate::spectral::SpectralError;

/// Residuals below this share of the square root of the area are never too large.
const NEGLIGIBLE: f64 = 5e-3;

/// How wrong marks are found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeformSettings {
    /// Number of fits that leave out marks; 0 keeps all of them.
    pub trim_rounds: u32,
    /// A mark is left out when it misses the surface that the other marks give by more than this
    /// multiple of the median, both measured by what those marks leave open.
    pub trim_factor: f64,
}

impl Default for DeformSettings {
    fn default() -> Self {
        Self { trim_rounds: 3, trim_factor: 5.0 }
    }
}

/// A deformed surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Deformed {
    /// Vertices after the deformation (V).
    pub vertices: Vec<DVec3>,
    /// Which constraints were kept.
    pub kept: Vec<bool>,
    /// How far each place would lie from its position without its own mark, in the mesh's unit.
    pub residuals: Vec<f64>,
}

/// A surface with its marks, ready to be deformed. The symbolic part of the factorisation is made
/// once.
pub struct Deformer {
    surface: Bilaplacian,
    symbolic: SymbolicCholesky,
    marks: Vec<Mark>,
}

/// A pull on single vertices besides the marks: position and weight.
pub(super) type Pulls<'a> = &'a [Option<(DVec3, f64)>];

impl Deformer {
    /// Takes a surface and its constraints.
    ///
    /// # Errors
    /// [`SpectralError`] for a mesh without surface, or a constraint on a place that does not exist.
    pub fn new(mesh: &TriangleMesh, constraints: &[Constraint]) -> Result<Self, SpectralError> {
        let mut joined: Vec<u32> = Vec::new();
        for (position, constraint) in constraints.iter().enumerate() {
            let (index, count) = match constraint.anchor {
                Anchor::Vertex(vertex) => (vertex, mesh.vertex_count()),
                Anchor::Point { triangle, .. } => {
                    joined.push(triangle);
                    (triangle, mesh.triangles().len())
                }
            };
            if index as usize >= count {
                let vertex = i64::from(index);
                return Err(SpectralError::VertexOutOfRange { position, vertex, vertex_count: count });
            }
        }
        let surface = Bilaplacian::new(mesh, &joined)?;
        let marks = constraints.iter().map(|constraint| Mark::new(&surface, constraint)).collect();
        let symbolic = SymbolicCholesky::new(&surface.form)?;
        Ok(Self { surface, symbolic, marks })
    }

    /// The operators of the surface.
    #[must_use]
    pub fn surface(&self) -> &Bilaplacian {
        &self.surface
    }

    /// Fits the marks and leaves out, round after round, those that miss the others.
    ///
    /// # Errors
    /// [`SpectralError`] when a factorisation fails or `progress` was cancelled.
    pub fn fit(&self, settings: &DeformSettings, progress: &Progress) -> Result<Deformed, SpectralError> {
        let rest = self.surface.welded.vertices();
        let usable: Vec<bool> = self.marks.iter().map(|mark| mark.weight > 0.0).collect();
        let mut kept = usable.clone();
        let mut round = 0;
        loop {
            progress.report(f64::from(round) / f64::from(settings.trim_rounds + 1))?;
            let (vertices, cholesky) = self.solve(&affine(&self.surface, &self.marks, &kept), &kept, &[])?;
            let inverse = cholesky.map_or_else(|| vec![0.0; rest.len()], |c| diagonal_of_inverse(&c));
            let residuals = self.residuals(&vertices, &kept, &inverse);
            let next = self.trimmed(&residuals, &usable, settings);
            let residuals = residuals.into_iter().map(|(residual, _)| residual).collect();
            if round == settings.trim_rounds || next == kept {
                progress.report(1.0)?;
                return Ok(Deformed { vertices, kept, residuals });
            }
            kept = next;
            round += 1;
        }
    }

    /// Which marks stay, by their residuals in a fit. They are judged in units of what the other
    /// marks leave open, so that a lone mark at the end of a limb is no outlier.
    fn trimmed(&self, residuals: &[(f64, f64)], usable: &[bool], settings: &DeformSettings) -> Vec<bool> {
        let score = |&(residual, open): &(f64, f64)| residual / open;
        let scores = residuals.iter().zip(usable).filter(|(_, usable)| **usable).map(|(r, _)| score(r));
        let bound = settings.trim_factor * median(scores.collect());
        let negligible = NEGLIGIBLE * self.surface.area.sqrt();
        let stays = |((mark, usable), found): ((&Mark, &bool), &(f64, f64))| {
            *usable && (mark.trusted || found.0 <= negligible || score(found) <= bound)
        };
        self.marks.iter().zip(usable).zip(residuals).map(stays).collect()
    }

    /// Residual of every mark as if it had not taken part, and the deviation to expect of it: with
    /// C the compliance of its place under the other marks, √(C + 1/w). Its own share in its place
    /// is h = w (A⁻¹)_kk, `inverse` being the diagonal of A⁻¹ (Cook 1977).
    fn residuals(&self, vertices: &[DVec3], kept: &[bool], inverse: &[f64]) -> Vec<(f64, f64)> {
        let residual = |(mark, kept): (&Mark, &bool)| {
            let own: f64 = mark.corners.iter().zip(mark.barycentric).map(|(&v, b)| b * inverse[v]).sum();
            let weight = mark.weight.max(f64::MIN_POSITIVE);
            let left = if *kept { (1.0 - weight * own).clamp(1e-6, 1.0) } else { 1.0 / (1.0 + weight * own) };
            let miss = mark.at(vertices).distance(mark.position);
            (if *kept { miss / left } else { miss }, (1.0 / (weight * left)).sqrt())
        };
        self.marks.iter().zip(kept).map(residual).collect()
    }

    /// The positions nearest to `base` in smoothness, under the kept marks and the pulls. Returns
    /// them with the factor; no factor when nothing pulls, and then `base` itself.
    pub(super) fn solve(
        &self,
        base: &[DVec3],
        kept: &[bool],
        pulls: Pulls<'_>,
    ) -> Result<(Vec<DVec3>, Option<Cholesky>), SpectralError> {
        let count = base.len();
        let mut held = vec![false; self.surface.component_count];
        let mut triplets = Vec::with_capacity(count);
        let mut right = vec![0.0; 3 * count];
        let mut add = |v: usize, force: DVec3| {
            for (axis, value) in force.to_array().into_iter().enumerate() {
                right[axis * count + v] += value;
            }
        };
        for (mark, _) in self.marks.iter().zip(kept).filter(|(_, kept)| **kept) {
            let force = (mark.position - mark.at(base)) * mark.weight;
            for (at, (&v, b)) in mark.corners.iter().zip(mark.barycentric).enumerate() {
                held[self.surface.components[v] as usize] |= self.surface.shares[v] > 0.0;
                add(v, force * b);
                for (&w, c) in mark.corners[at..].iter().zip(&mark.barycentric[at..]) {
                    triplets.push((v, w, mark.weight * b * c));
                }
            }
        }
        for (v, pull) in pulls.iter().enumerate() {
            if let Some((position, weight)) = pull {
                held[self.surface.components[v] as usize] |= self.surface.shares[v] > 0.0 && *weight > 0.0;
                add(v, (*position - base[v]) * *weight);
                triplets.push((v, v, *weight));
            }
        }
        if !held.contains(&true) {
            return Ok((base.to_vec(), None));
        }
        let free: Vec<bool> = (0..count)
            .map(|v| self.surface.shares[v] <= 0.0 || !held[self.surface.components[v] as usize])
            .collect();
        // Rows that nothing holds get a diagonal of their own, so that the matrix is regular.
        triplets.extend((0..count).filter(|&v| free[v]).map(|v| (v, v, 1.0)));
        let matrix = self.surface.form.add_triplets(&triplets)?;
        let cholesky = factor(&self.symbolic, &matrix)?;
        cholesky.solve_in_place(&mut right, 3)?;
        let mut moved: Vec<DVec3> = (0..count)
            .map(|v| base[v] + DVec3::new(right[v], right[count + v], right[2 * count + v]))
            .collect();
        self.carry(&free, base, &mut moved)?;
        for (v, &stand) in self.surface.stands_for.iter().enumerate() {
            moved[v] = moved[stand as usize];
        }
        Ok((moved, Some(cholesky)))
    }

    /// Moves every piece with free vertices rigidly with the surface nearest to it that is held.
    fn carry(&self, free: &[bool], base: &[DVec3], moved: &mut [DVec3]) -> Result<(), SpectralError> {
        let mut pieces: Vec<Vec<usize>> = vec![Vec::new(); self.surface.component_count];
        for (v, _) in free.iter().enumerate().filter(|(_, free)| **free) {
            pieces[self.surface.components[v] as usize].push(v);
        }
        pieces.retain(|piece| !piece.is_empty());
        if pieces.is_empty() {
            return Ok(());
        }
        let whole = TriangleMesh::new(base.to_vec(), self.surface.welded.triangles().to_vec())?;
        let held = Submesh::new(&whole, |v| !free[v])?;
        let query = SurfaceQuery::new(&held.mesh)?;
        let edges = Adjacency::new(held.mesh.vertex_count(), &held.mesh.topology());
        for piece in pieces {
            let found: Vec<_> = piece.par_iter().map(|&v| query.closest_point(base[v])).collect();
            let nearest = found.iter().flatten().map(|c| c.distance).fold(f64::INFINITY, f64::min);
            let centre = piece.iter().map(|&v| base[v]).sum::<DVec3>() / piece.len() as f64;
            let size = piece.iter().map(|&v| base[v].distance(centre)).fold(0.0, f64::max);
            // The side that faces the surface leads; a size of zero leaves all pairs equal.
            let reach = 0.5 * size + 1e-3 * self.surface.area.sqrt();
            let mut pairs = Vec::with_capacity(3 * found.len());
            for closest in found.iter().flatten() {
                let weight = libm::exp(-libm::pow((closest.distance - nearest) / reach, 2.0));
                // Whole rings, not the triangle: where a place lies on an edge, rounding picks among two.
                for (corner, share) in
                    held.mesh.triangles()[closest.triangle as usize].into_iter().zip(closest.barycentric)
                {
                    for &near in edges.neighbours(corner as usize).iter().chain([&corner]) {
                        let v = held.to_whole[near as usize] as usize;
                        pairs.push((base[v], moved[v], weight * share));
                    }
                }
            }
            let motion = rigid_fit(&pairs);
            for v in piece {
                moved[v] = motion.apply(base[v]);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::test_surfaces::{grid, icosphere, joined, mapped, permuted, similarity};
    use glam::{DAffine3, DMat3};

    fn fit(mesh: &TriangleMesh, constraints: &[Constraint], settings: &DeformSettings) -> Deformed {
        Deformer::new(mesh, constraints).unwrap().fit(settings, &Progress::new()).unwrap()
    }

    fn pin(vertex: usize, position: DVec3) -> Constraint {
        Constraint { anchor: Anchor::Vertex(vertex as u32), position, weight: 1e3, trusted: false }
    }

    fn farthest(a: &[DVec3], b: &[DVec3]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
    }

    #[test]
    fn a_loose_piece_over_an_edge_follows_what_is_on_both_sides() {
        // The sheet's two halves tilt; the piece above the edge between them does not follow one alone.
        let sheet = mapped(&grid(4), |p| p - DVec3::new(0.5, 0.5, 0.0));
        let flat = |p: DVec3| DVec3::new(p.x * 1e-6, p.y * 0.02 + 0.125, p.z * 0.02 + 0.1);
        let button = mapped(&icosphere(0), flat);
        let roof = |p: DVec3| DVec3::new(p.x, p.y, p.z - 0.3 * p.x.abs());
        let marks: Vec<Constraint> =
            (0..sheet.vertex_count()).map(|v| pin(v, roof(sheet.vertices()[v]))).collect();
        let mesh = joined(&sheet, &button);
        let keep = DeformSettings { trim_rounds: 0, ..DeformSettings::default() };
        let found = fit(&mesh, &marks, &keep).vertices;
        for shift in [-1e-9, 1e-9] {
            let moved = mapped(&button, |p| p + DVec3::new(shift, -shift, 0.0));
            let again = fit(&joined(&sheet, &moved), &marks, &keep).vertices;
            assert!(farthest(&found, &again) < 1e-6, "{}", farthest(&found, &again));
        }
    }

    /// An affine map that stretches, shears, turns and moves by about the size of the sphere.
    fn affine() -> DAffine3 {
        let linear = DMat3::from_cols_array(&[1.3, 0.2, 0.0, -0.1, 0.8, 0.3, 0.1, 0.0, 1.1]);
        DAffine3::from_mat3_translation(linear, DVec3::new(0.5, -1.0, 0.2))
    }

    #[test]
    fn affine_displacements_are_reproduced() {
        let sphere = icosphere(3);
        let marks: Vec<Constraint> = (0..sphere.vertex_count())
            .step_by(5)
            .map(|v| pin(v, affine().transform_point3(sphere.vertices()[v])))
            .collect();
        let found = fit(&sphere, &marks, &DeformSettings::default());
        let expected = mapped(&sphere, |p| affine().transform_point3(p));
        assert!(farthest(&found.vertices, expected.vertices()) < 1e-6);
        assert!(found.kept.iter().all(|kept| *kept));
    }

    /// Smooth marks on a sphere, every tenth of them wrong by more than the radius.
    fn with_outliers(sphere: &TriangleMesh) -> (Vec<Constraint>, Vec<DVec3>) {
        let bend = |p: DVec3| p + DVec3::new(0.1 * p.y * p.y, 0.15 * p.x * p.z, 0.1 * p.y);
        let marks = (0..sphere.vertex_count()).step_by(8).enumerate().map(|(k, v)| {
            let wrong = if k % 10 == 3 {
                DVec3::new(-0.9, 0.7, 0.8) * sphere.vertices()[v].abs()
            } else {
                DVec3::ZERO
            };
            pin(v, bend(sphere.vertices()[v]) + wrong)
        });
        (marks.collect(), sphere.vertices().iter().map(|&p| bend(p)).collect())
    }

    #[test]
    fn wrong_marks_are_left_out() {
        let sphere = icosphere(3);
        let (marks, expected) = with_outliers(&sphere);
        let all = fit(&sphere, &marks, &DeformSettings { trim_rounds: 0, ..DeformSettings::default() });
        let found = fit(&sphere, &marks, &DeformSettings::default());
        for (k, kept) in found.kept.iter().enumerate() {
            assert_eq!(*kept, k % 10 != 3, "mark {k}: {}", found.residuals[k]);
        }
        assert!(farthest(&all.vertices, &expected) > 0.3);
        assert!(farthest(&found.vertices, &expected) < 0.02, "{}", farthest(&found.vertices, &expected));
    }

    #[test]
    fn trusted_marks_stay() {
        let sphere = icosphere(2);
        let mut marks: Vec<Constraint> =
            (0..sphere.vertex_count()).step_by(4).map(|v| pin(v, sphere.vertices()[v])).collect();
        marks[7].position += DVec3::X;
        assert!(!fit(&sphere, &marks, &DeformSettings::default()).kept[7]);
        marks[7].trusted = true;
        assert!(fit(&sphere, &marks, &DeformSettings::default()).kept[7]);
    }

    #[test]
    fn pieces_without_marks_move_rigidly_with_the_nearest() {
        let sphere = icosphere(2);
        let button = mapped(&icosphere(0), |p| p * 0.05 + DVec3::new(1.06, 0.0, 0.0));
        let mesh = joined(&sphere, &button);
        let motion = similarity(1.0);
        let marks: Vec<Constraint> = (0..sphere.vertex_count())
            .step_by(3)
            .map(|v| pin(v, motion.transform_point3(sphere.vertices()[v])))
            .collect();
        let found = fit(&mesh, &marks, &DeformSettings::default());
        let expected = mapped(&mesh, |p| motion.transform_point3(p));
        assert!(farthest(&found.vertices, expected.vertices()) < 1e-4);
        let none = fit(&mesh, &[], &DeformSettings::default());
        assert_eq!(none.vertices, mesh.vertices());
    }

    #[test]
    fn a_point_inside_of_a_triangle_can_be_marked() {
        let sphere = icosphere(2);
        let barycentric = [0.2, 0.3, 0.5];
        let at: DVec3 = sphere.corners(40).iter().zip(barycentric).map(|(&c, b)| c * b).sum();
        let mut marks: Vec<Constraint> =
            (0..sphere.vertex_count()).step_by(9).map(|v| pin(v, sphere.vertices()[v])).collect();
        let position = at * 1.1;
        marks.push(Constraint {
            anchor: Anchor::Point { triangle: 40, barycentric },
            position,
            weight: 1e6,
            trusted: true,
        });
        let found = fit(&sphere, &marks, &DeformSettings::default());
        let corners = sphere.triangles()[40].map(|v| found.vertices[v as usize]);
        let moved: DVec3 = corners.iter().zip(barycentric).map(|(&c, b)| c * b).sum();
        assert!(moved.distance(position) < 1e-3, "{}", moved.distance(position));
    }

    #[test]
    fn a_place_that_does_not_exist_is_named() {
        let error = Deformer::new(&icosphere(0), &[pin(0, DVec3::X), pin(12, DVec3::X)]).err();
        let expected = SpectralError::VertexOutOfRange { position: 1, vertex: 12, vertex_count: 12 };
        assert_eq!(error, Some(expected));
    }

    #[test]
    fn neither_order_nor_place_nor_scale_matters() {
        let sphere = icosphere(3);
        let (marks, _) = with_outliers(&sphere);
        let found = fit(&sphere, &marks, &DeformSettings::default());
        let (shuffled, new) = permuted(&sphere);
        let moved_marks: Vec<Constraint> =
            marks.iter().enumerate().map(|(k, mark)| pin(new[8 * k] as usize, mark.position)).collect();
        let again = fit(&shuffled, &moved_marks, &DeformSettings::default());
        for (v, &n) in new.iter().enumerate() {
            assert!(found.vertices[v].distance(again.vertices[n as usize]) < 1e-6);
        }
        for scale in [1e-2, 1e2] {
            let motion = similarity(scale);
            let marks: Vec<Constraint> = marks
                .iter()
                .map(|mark| Constraint { position: motion.transform_point3(mark.position), ..*mark })
                .collect();
            let again =
                fit(&mapped(&sphere, |p| motion.transform_point3(p)), &marks, &DeformSettings::default());
            let expected: Vec<DVec3> = found.vertices.iter().map(|&p| motion.transform_point3(p)).collect();
            assert!(farthest(&again.vertices, &expected) < 1e-4 * scale);
        }
    }

    #[test]
    fn a_cancelled_fit_stops() {
        let progress = Progress::new();
        progress.cancel();
        let deformer = Deformer::new(&icosphere(1), &[pin(0, DVec3::X)]).unwrap();
        let outcome = deformer.fit(&DeformSettings::default(), &progress);
        assert!(matches!(outcome, Err(SpectralError::Cancelled(_))));
    }
}
