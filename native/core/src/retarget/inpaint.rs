//! Biharmonic inpainting of weights: rows that are known stay, the others become as smooth as
//! possible (Abdrashitov, Raichstat, Monsen, Hill: "Robust skin weights transfer via weight
//! inpainting", 2023).
//!
//! A row may also be known within a reach only: a closest point tells the weights of cloth that hangs off
//! the body no sharper than over some distance. Where that is most of a surface, a harmonic form in place of
//! the biharmonic one evens such rows out without overshoot.
//!
//! Every hole is solved by itself, with one right-hand side for each bone that occurs around it.
//! Negative values are cut off and rows scaled to a sum of 1. Around what was filled, and nowhere
//! else, some rounds of smoothing take away the crease at the border.

use rayon::prelude::*;

use super::bilaplacian::{Bilaplacian, factor};
use super::crease_smoothing::{mean, smooth};
use crate::linalg::SymbolicCholesky;
use crate::mesh::{Adjacency, TriangleMesh};
use crate::progress::Progress;
use crate::skinning::{Row, normalized};
use crate::spectral::{Laplacian, SpectralError};

/// Weights below this are dropped from filled rows.
const NEGLIGIBLE: f64 = 1e-5;

/// What is known of a vertex's row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Known {
    /// It is the row.
    Exactly,
    /// It tells the row no better than over this reach around the vertex, in the mesh's unit, above 0.
    Within(f64),
    /// Nothing.
    Nothing,
}

impl Known {
    /// The row itself, or nothing.
    #[must_use]
    pub fn exactly(known: bool) -> Self {
        if known { Self::Exactly } else { Self::Nothing }
    }
}

/// Settings of inpainting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InpaintSettings {
    /// Rounds of smoothing next to what was filled; 0 for none.
    pub smoothing_rounds: u32,
    /// Whether weights that are known within a reach are evened out, min ∫ |∇w|² + ∫ |w − w₀|² / ℓ²: such
    /// weights never leave the range of those around.
    pub harmonic: bool,
}

impl Default for InpaintSettings {
    fn default() -> Self {
        Self { smoothing_rounds: 4, harmonic: false }
    }
}

/// Weights without holes.
#[derive(Debug, Clone, PartialEq)]
pub struct Inpainted {
    /// Weights of every vertex (V); each row sums to 1, but those of `unreached` are empty.
    pub rows: Vec<Row>,
    /// Vertices on components without a known row, ascending.
    pub unreached: Vec<u32>,
}

/// Fills the rows that are not known. Known rows are scaled to a sum of 1; one without weight
/// counts as unknown. On a seam that only an export had opened, a known vertex speaks for all. Rows w₀ that
/// are known within a reach ℓ only pull what is filled: min ∫ |Δw|² + ∫ |w − w₀|² / ℓ⁴.
///
/// # Errors
/// [`SpectralError`] for a mesh without surface, a failed factorisation, or a cancelled `progress`.
///
/// # Panics
/// Unless there is one row and one flag for each vertex.
pub fn inpaint(
    mesh: &TriangleMesh,
    rows: &[Row],
    known: &[Known],
    settings: &InpaintSettings,
    progress: &Progress,
) -> Result<Inpainted, SpectralError> {
    assert!(rows.len() == mesh.vertex_count() && known.len() == rows.len(), "one row for each vertex");
    let mut surface = Bilaplacian::new(mesh, &[])?;
    if settings.harmonic {
        surface.form = Laplacian::new(&surface.welded)?.stiffness;
    }
    progress.report(0.2)?;
    let count = mesh.vertex_count();
    let mut filled: Vec<Row> = vec![Row::new(); count];
    let mut pulls: Vec<Option<Pull>> = vec![None; count];
    for (v, row) in rows.iter().enumerate() {
        let stand = surface.stands_for[v] as usize;
        let total: f64 = row.iter().map(|entry| entry.1).sum();
        let own = || row.iter().map(|&(bone, weight)| (bone, weight / total)).collect();
        // The vertex itself comes before those that it stands for, so the lowest known one speaks.
        match known[v] {
            Known::Exactly if total > 0.0 && filled[stand].is_empty() => filled[stand] = own(),
            Known::Within(reach) if total > 0.0 && pulls[stand].is_none() => {
                let firm = surface.area / reach.powi(2);
                let firmness = surface.shares[stand] * if settings.harmonic { firm } else { firm * firm };
                pulls[stand] = Some(Pull { row: own(), firmness });
            }
            _ => {}
        }
    }
    let is_known: Vec<bool> = filled.iter().map(|row| !row.is_empty()).collect();
    let topology = surface.welded.topology();
    let adjacency = Adjacency::new(count, &topology);
    let mut reached = vec![false; surface.component_count];
    let tells = |v: &usize| is_known[*v] || pulls[*v].is_some();
    (0..count).filter(tells).for_each(|v| reached[surface.components[v] as usize] = true);
    let to_fill = |v: usize| {
        surface.stands_for[v] as usize == v && !is_known[v] && reached[surface.components[v] as usize]
    };

    let holes = holes(&surface, |v| to_fill(v) && surface.shares[v] > 0.0);
    let total: usize = holes.iter().map(Vec::len).sum();
    let mut done = 0;
    for hole in &holes {
        for (&v, row) in hole.iter().zip(fill(&surface, hole, &filled, &pulls)?) {
            filled[v] = row;
        }
        done += hole.len();
        progress.report(0.2 + 0.6 * done as f64 / total as f64)?;
    }
    fill_without_area(&adjacency, to_fill, &mut filled);
    smooth(&adjacency, &is_known, &mut filled, settings.smoothing_rounds, progress)?;

    for (v, &stand) in surface.stands_for.iter().enumerate() {
        if v != stand as usize {
            filled[v] = filled[stand as usize].clone();
        }
    }
    let unreached = (0u32..).zip(&filled).filter(|(_, row)| row.is_empty()).map(|(v, _)| v).collect();
    progress.report(1.0)?;
    Ok(Inpainted { rows: filled, unreached })
}

/// Groups of vertices to fill that depend on each other, each ascending.
fn holes(surface: &Bilaplacian, to_fill: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
    let mut seen = vec![false; surface.vertex_count()];
    let mut holes = Vec::new();
    for first in 0..surface.vertex_count() {
        if seen[first] || !to_fill(first) {
            continue;
        }
        seen[first] = true;
        let (mut hole, mut next) = (vec![first], 0);
        while let Some(&v) = hole.get(next) {
            next += 1;
            for &n in surface.form.column(v).0 {
                if !seen[n] && to_fill(n) {
                    seen[n] = true;
                    hole.push(n);
                }
            }
        }
        hole.sort_unstable();
        holes.push(hole);
    }
    holes
}

/// A row w₀ that what is filled is drawn to, and how firmly: A² share / ℓ⁴, as the form is A · uᵀ K M⁻¹ K u, or
/// A share / ℓ² beside uᵀ K u.
#[derive(Debug, Clone)]
struct Pull {
    row: Row,
    firmness: f64,
}

/// Rows of one hole: (Q_uu + P) w_u = P w₀ − Q_uk w_k for every bone in and around it.
fn fill(
    surface: &Bilaplacian,
    hole: &[usize],
    rows: &[Row],
    pulls: &[Option<Pull>],
) -> Result<Vec<Row>, SpectralError> {
    let mut bones: Vec<u32> = Vec::new();
    for &v in hole {
        let around = surface.form.column(v).0.iter().flat_map(|&n| &rows[n]);
        let own = pulls[v].iter().flat_map(|pull| &pull.row);
        bones.extend(around.chain(own).map(|entry| entry.0));
    }
    bones.sort_unstable();
    bones.dedup();
    let mut right = vec![0.0; hole.len() * bones.len()];
    for (at, &v) in hole.iter().enumerate() {
        if let Some(Pull { row, firmness }) = &pulls[v] {
            for (bone, weight) in row {
                if let Ok(column) = bones.binary_search(bone) {
                    right[column * hole.len() + at] += firmness * weight;
                }
            }
        }
        let (neighbours, values) = surface.form.column(v);
        for (&n, value) in neighbours.iter().zip(values) {
            for (bone, weight) in &rows[n] {
                if let Ok(column) = bones.binary_search(bone) {
                    right[column * hole.len() + at] -= value * weight;
                }
            }
        }
    }
    let firmness: Vec<f64> = hole.iter().map(|&v| pulls[v].as_ref().map_or(0.0, |p| p.firmness)).collect();
    let matrix = surface.form.principal_submatrix(hole)?.add_scaled_diagonal(1.0, &firmness)?;
    let cholesky = factor(&SymbolicCholesky::new(&matrix)?, &matrix)?;
    cholesky.solve_in_place(&mut right, bones.len())?;
    let row = |at: usize| {
        let value = |column: usize| right[column * hole.len() + at].max(0.0);
        let total: f64 = (0..bones.len()).map(value).sum();
        let bound = NEGLIGIBLE * total;
        let entries = (0..bones.len()).filter(|&c| value(c) > bound).map(|c| (bones[c], value(c)));
        normalized(entries.collect())
    };
    Ok((0..hole.len()).into_par_iter().map(row).collect())
}

/// Vertices without area have no row in the form: they take the mean of their neighbours, from
/// known ones inward.
fn fill_without_area(adjacency: &Adjacency, to_fill: impl Fn(usize) -> bool, rows: &mut [Row]) {
    let mut left: Vec<usize> = (0..rows.len()).filter(|&v| rows[v].is_empty() && to_fill(v)).collect();
    while !left.is_empty() {
        let found: Vec<Row> =
            left.iter().map(|&v| mean(adjacency.neighbours(v).iter().map(|&n| &rows[n as usize]))).collect();
        let before = left.len();
        for (&v, row) in left.iter().zip(found) {
            rows[v] = row;
        }
        left.retain(|&v| rows[v].is_empty());
        if left.len() == before {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::test_surfaces::{grid, icosphere, joined, mapped, permuted, similarity, tube};

    const UNSMOOTHED: InpaintSettings = InpaintSettings { smoothing_rounds: 0, harmonic: false };

    fn run(mesh: &TriangleMesh, rows: &[Row], known: &[bool], settings: &InpaintSettings) -> Inpainted {
        let known: Vec<Known> = known.iter().map(|&known| Known::exactly(known)).collect();
        inpaint(mesh, rows, &known, settings, &Progress::new()).unwrap()
    }

    /// Weight of bone 1 falls from 1 to 0 along x; bone 0 has the rest.
    fn ramp(mesh: &TriangleMesh) -> Vec<Row> {
        mesh.vertices().iter().map(|p| vec![(0, p.x), (1, 1.0 - p.x)]).collect()
    }

    fn weight(row: &Row, bone: u32) -> f64 {
        row.iter().find(|entry| entry.0 == bone).map_or(0.0, |entry| entry.1)
    }

    #[test]
    fn linear_weights_on_a_flat_grid_are_reproduced() {
        let grid = grid(20);
        let rows = ramp(&grid);
        let known: Vec<bool> =
            grid.vertices().iter().map(|p| p.distance(glam::DVec3::new(0.5, 0.45, 0.0)) > 0.3).collect();
        let found = run(&grid, &rows, &known, &UNSMOOTHED);
        assert!(known.iter().filter(|known| !**known).count() > 80);
        for (row, point) in found.rows.iter().zip(grid.vertices()) {
            assert!((weight(row, 0) - point.x).abs() < 1e-8);
            assert!((row.iter().map(|entry| entry.1).sum::<f64>() - 1.0).abs() < 1e-12);
        }
        // Smoothing leaves linear weights alone inside of the grid.
        let smoothed = run(&grid, &rows, &known, &InpaintSettings::default());
        for (row, point) in smoothed.rows.iter().zip(grid.vertices()) {
            assert!((weight(row, 0) - point.x).abs() < 1e-8);
        }
    }

    #[test]
    fn a_hole_between_two_plateaus_is_bridged_smoothly() {
        let tube = tube(0.3, 3.0, 32, 90);
        let rows: Vec<Row> =
            tube.vertices().iter().map(|p| vec![(if p.z < 1.5 { 3 } else { 7 }, 1.0)]).collect();
        let known: Vec<bool> = tube.vertices().iter().map(|p| (p.z - 1.5).abs() > 0.5).collect();
        let found = run(&tube, &rows, &known, &UNSMOOTHED);
        for (row, point) in found.rows.iter().zip(tube.vertices()) {
            // On a tube the solution is the cubic between the plateaus.
            let t = ((point.z - 1.0) / 1.0).clamp(0.0, 1.0);
            let cubic = t * t * (3.0 - 2.0 * t);
            assert!((weight(row, 7) - cubic).abs() < 0.05, "{} {cubic}", weight(row, 7));
        }
    }

    #[test]
    fn rows_known_within_a_reach_are_means_over_it() {
        let tube = tube(0.3, 3.0, 32, 90);
        let rows: Vec<Row> =
            tube.vertices().iter().map(|p| vec![(if p.z < 1.5 { 3 } else { 7 }, 1.0)]).collect();
        // Where the weight of the upper bone is a half: half way between the plateaus, and how fast it grows.
        let slope = |reach: f64| {
            let known = vec![Known::Within(reach); rows.len()];
            let found = inpaint(&tube, &rows, &known, &UNSMOOTHED, &Progress::new()).unwrap();
            assert!(found.unreached.is_empty());
            let ring = |z: f64| {
                let near = (0..rows.len()).filter(|&v| (tube.vertices()[v].z - z).abs() < 0.01);
                near.map(|v| weight(&found.rows[v], 7)).sum::<f64>() / 32.0
            };
            for (row, point) in found.rows.iter().zip(tube.vertices()) {
                assert!((row.iter().map(|entry| entry.1).sum::<f64>() - 1.0).abs() < 1e-12);
                let plateau = if point.z < 1.5 { 0.0 } else { 1.0 };
                let is_far = (point.z - 1.5).abs() > 8.0 * reach.max(0.01);
                assert!(!is_far || (weight(row, 7) - plateau).abs() < 0.01, "{point}");
            }
            ring(1.6) - ring(1.4)
        };
        let [sharp, soft, softer] = [1e-3, 0.05, 0.1].map(slope);
        assert!((sharp - 1.0).abs() < 1e-3 && sharp > soft + 0.02 && soft > softer + 0.1, "{soft} {softer}");
    }

    #[test]
    fn a_step_that_is_evened_out_harmonically_decays_with_its_reach() {
        let (tube, reach) = (tube(0.3, 3.0, 32, 90), 0.2);
        let rows: Vec<Row> =
            tube.vertices().iter().map(|p| vec![(if p.z < 1.5 { 3 } else { 7 }, 1.0)]).collect();
        let known = vec![Known::Within(reach); rows.len()];
        let settings = InpaintSettings { harmonic: true, ..UNSMOOTHED };
        let found = inpaint(&tube, &rows, &known, &settings, &Progress::new()).unwrap();
        for (row, point) in found.rows.iter().zip(tube.vertices()) {
            // ℓ² w″ = w − w₀, the step half way between two rings.
            let from = point.z - (1.5 - 0.5 * 3.0 / 90.0);
            let tail = 0.5 * (-from.abs() / reach).exp();
            let expected = if from > 0.0 { 1.0 - tail } else { tail };
            assert!((weight(row, 7) - expected).abs() < 0.01, "{from} {} {expected}", weight(row, 7));
        }
    }

    #[test]
    fn what_is_known_exactly_stays_and_nearer_rows_say_more() {
        let grid = grid(20);
        let at = |p: &glam::DVec3| p.x < 0.05;
        let rows: Vec<Row> = grid.vertices().iter().map(|p| vec![(u32::from(!at(p)), 1.0)]).collect();
        let fill = |reach: f64| {
            let known = |p: &glam::DVec3| if at(p) { Known::Exactly } else { Known::Within(reach) };
            let known: Vec<Known> = grid.vertices().iter().map(known).collect();
            inpaint(&grid, &rows, &known, &UNSMOOTHED, &Progress::new()).unwrap().rows
        };
        let [near, far] = [fill(0.05), fill(0.3)];
        let mut differ = 0;
        for (v, p) in grid.vertices().iter().enumerate() {
            if at(p) {
                assert_eq!([&near[v], &far[v]], [&rows[v]; 2]);
            } else if p.x < 0.3 {
                assert!(weight(&near[v], 1) >= weight(&far[v], 1) - 1e-9);
                differ += usize::from(weight(&near[v], 1) > weight(&far[v], 1) + 0.1);
            }
        }
        assert!(differ > 20, "{differ}");
    }

    #[test]
    fn pieces_without_a_known_row_are_named() {
        let far = mapped(&icosphere(1), |p| p * 0.1 + glam::DVec3::X * 3.0);
        let mesh = joined(&icosphere(2), &far);
        let mut rows = vec![vec![(2, 2.0)]; mesh.vertex_count()];
        let mut known = vec![false; mesh.vertex_count()];
        known[5] = true;
        known[170] = true;
        rows[170].clear();
        let found = run(&mesh, &rows, &known, &InpaintSettings::default());
        assert_eq!(found.unreached, (162..204).collect::<Vec<u32>>());
        assert!(found.rows[..162].iter().all(|row| row.len() == 1 && (row[0].1 - 1.0).abs() < 1e-12));
    }

    #[test]
    fn known_rows_far_from_the_hole_keep_their_bits() {
        let sphere = icosphere(4);
        let rows: Vec<Row> = sphere
            .vertices()
            .iter()
            .map(|p| normalized(vec![(0, 1.1 + p.z), (1, 1.0 + p.x * p.y)]))
            .collect();
        let known: Vec<bool> = sphere.vertices().iter().map(|p| p.x < 0.8).collect();
        let found = run(&sphere, &rows, &known, &InpaintSettings::default());
        for (v, point) in sphere.vertices().iter().enumerate().filter(|(_, p)| p.x < 0.5) {
            assert_eq!(found.rows[v], normalized(rows[v].clone()), "{point}");
        }
        assert!(found.unreached.is_empty() && found.rows.iter().all(|row| !row.is_empty()));
    }

    #[test]
    fn both_sides_of_a_seam_get_the_same_rows() {
        // Two halves of a grid that only share positions along x = 0.5.
        let half = mapped(&grid(8), |p| p * glam::DVec3::new(0.5, 1.0, 1.0));
        let other = mapped(&half, |p| p + glam::DVec3::X * 0.5);
        let mesh = joined(&half, &other);
        let known: Vec<bool> = mesh.vertices().iter().map(|p| (p.x - 0.5).abs() > 0.3).collect();
        let found = run(&mesh, &ramp(&mesh), &known, &InpaintSettings::default());
        for (v, stand) in crate::mesh::weld_seams(&mesh).into_iter().enumerate() {
            assert_eq!(found.rows[v], found.rows[stand as usize]);
        }
        assert!(found.unreached.is_empty());
    }

    #[test]
    fn neither_order_nor_place_nor_scale_matters() {
        let sphere = icosphere(3);
        let rows: Vec<Row> =
            sphere.vertices().iter().map(|p| normalized(vec![(0, 1.1 + p.z), (1, 1.0)])).collect();
        let known: Vec<bool> = sphere.vertices().iter().map(|p| p.x < 0.3).collect();
        let settings = InpaintSettings::default();
        let found = run(&sphere, &rows, &known, &settings);
        let (shuffled, new) = permuted(&sphere);
        let (mut moved_rows, mut moved_known) = (rows.clone(), known.clone());
        for (v, &n) in new.iter().enumerate() {
            (moved_rows[n as usize], moved_known[n as usize]) = (rows[v].clone(), known[v]);
        }
        let again = run(&shuffled, &moved_rows, &moved_known, &settings);
        for (v, &n) in new.iter().enumerate() {
            assert!((weight(&found.rows[v], 0) - weight(&again.rows[n as usize], 0)).abs() < 1e-6);
        }
        for scale in [1e-2, 1e2] {
            let motion = similarity(scale);
            let again = run(&mapped(&sphere, |p| motion.transform_point3(p)), &rows, &known, &settings);
            for (a, b) in found.rows.iter().zip(&again.rows) {
                assert!((weight(a, 0) - weight(b, 0)).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn a_cancelled_job_stops() {
        let progress = Progress::new();
        progress.cancel();
        let mesh = icosphere(1);
        let rows = vec![vec![(0, 1.0)]; mesh.vertex_count()];
        let known = vec![Known::Exactly; mesh.vertex_count()];
        let outcome = inpaint(&mesh, &rows, &known, &InpaintSettings::default(), &progress);
        assert!(matches!(outcome, Err(SpectralError::Cancelled(_))));
    }
}
