//! Weights of the whole target, part by part, as [`super::parts`] has planned. No vertex is left
//! without weights.

use rayon::prelude::*;

use super::inpaint::{InpaintSettings, Known, inpaint};
use super::loose_parts::follow;
use super::parts::{MATCHED, Part, PartPolicy, SourceWeights, mean_row};
use super::shell::{extent, tie_break};
use crate::mesh::{MeshError, Submesh, SurfaceQuery, TriangleMesh};
use crate::progress::Progress;
use crate::skinning::{Row, blend, normalized};
use crate::spectral::SpectralError;

/// Weights of the whole target.
#[derive(Debug, Clone, PartialEq)]
pub struct PartWeights {
    /// One row for each vertex (V), of sum 1.
    pub rows: Vec<Row>,
    /// Vertices that were inpainted, ascending.
    pub inpainted: Vec<u32>,
    /// The parts as they were treated: a part to be matched without any match follows.
    pub parts: Vec<Part>,
}

/// Gives every vertex its weights: matched parts keep the rows of `known` vertices and have the
/// others inpainted, then rigid and following parts take theirs from them.
///
/// # Errors
/// [`SpectralError`] for a target without surface or a source without weights, for a failed
/// factorisation, or when `progress` was cancelled.
pub fn weigh_parts(
    target: &TriangleMesh,
    parts: &[Part],
    rows: &[Row],
    known: &[Known],
    source: SourceWeights<'_>,
    settings: &InpaintSettings,
    progress: &Progress,
) -> Result<PartWeights, SpectralError> {
    let mut parts = parts.to_vec();
    let (mut rows, mut is_known) = (rows.to_vec(), vec![Known::Nothing; target.vertex_count()]);
    for part in parts.iter().filter(|part| part.policy == PartPolicy::Match) {
        for &v in &part.vertices {
            if !rows[v as usize].is_empty() {
                is_known[v as usize] = known[v as usize];
            }
        }
        let tells = |v: &&u32| is_known[**v as usize] != Known::Nothing;
        let matched = part.vertices.iter().filter(tells).count() as f64;
        let enough = matched >= MATCHED[2] * part.vertices.len() as f64;
        if let (Some(like), false) = (&part.like, enough) {
            for (v, row) in like_rows(target, &part.vertices, source, like)? {
                (rows[v as usize], is_known[v as usize]) = (row, Known::Exactly);
            }
        }
    }
    let filled = inpaint(target, &rows, &is_known, settings, progress)?;
    let mut rows = filled.rows;
    let mut done = vec![false; target.vertex_count()];
    for part in parts.iter_mut().filter(|part| part.policy == PartPolicy::Match) {
        let reached = part.vertices.iter().all(|&v| !rows[v as usize].is_empty());
        if !reached {
            // The body itself then follows the source, as nothing else is there.
            part.policy = PartPolicy::Follow;
        }
        part.vertices.iter().for_each(|&v| done[v as usize] = reached);
    }
    let nothing = |v: usize| is_known[v] == Known::Nothing;
    let inpainted =
        (0..target.vertex_count() as u32).filter(|&v| done[v as usize] && nothing(v as usize)).collect();
    // What the other parts go with: the matched parts, or the source where there are none.
    let body_rows: Vec<Row> =
        rows.iter().zip(&done).map(|(row, done)| if *done { row.clone() } else { Row::new() }).collect();
    let body = match Weighted::new(target, &body_rows) {
        Ok(body) => body,
        Err(_) => Weighted::new(source.surface.mesh, source.rows)?,
    };
    progress.report(1.0)?;
    for part in parts.iter().filter(|part| part.policy == PartPolicy::Follow) {
        let found: Vec<Row> = part.vertices.par_iter().map(|&v| body.at(target, v).0).collect();
        part.vertices.iter().zip(found).for_each(|(&v, row)| rows[v as usize] = row);
    }
    for (part, row) in rigid_rows(target, &parts, &body, source.rows) {
        part.vertices.iter().for_each(|&v| rows[v as usize].clone_from(&row));
    }
    Ok(PartWeights { rows, inpainted, parts })
}

/// A surface all of whose vertices have weights.
struct Weighted {
    surface: Submesh,
    query: SurfaceQuery,
    rows: Vec<Row>,
    extent: f64,
}

impl Weighted {
    fn new(mesh: &TriangleMesh, rows: &[Row]) -> Result<Self, MeshError> {
        let surface = Submesh::new(mesh, |v| !rows[v].is_empty())?;
        let query = SurfaceQuery::new(&surface.mesh)?;
        let rows = surface.to_whole.iter().map(|&v| normalized(rows[v as usize].clone())).collect();
        let extent = extent(&surface.mesh);
        Ok(Self { surface, query, rows, extent })
    }

    /// Row at the nearest point, and its distance. Between two that are equally near, as on the
    /// mirror plane of a body, both count.
    fn at(&self, mesh: &TriangleMesh, vertex: u32) -> (Row, f64) {
        let point = mesh.vertices()[vertex as usize];
        let [a, b] = [1.0, -1.0].map(|side| {
            follow(point + tie_break(self.extent) * side, &self.surface.mesh, &self.query, &self.rows)
        });
        let row = normalized(blend([(&a.row, 0.5), (&b.row, 0.5)].into_iter()));
        (row, 0.5 * (a.distance + b.distance))
    }
}

/// Rows of the rigid parts. A part inside of another one goes with it: all layers of an eye turn
/// together.
fn rigid_rows<'a>(
    target: &TriangleMesh,
    parts: &'a [Part],
    body: &Weighted,
    source_rows: &[Row],
) -> Vec<(&'a Part, Row)> {
    let mut rigid: Vec<(&Part, glam::DVec3, f64)> = parts
        .iter()
        .filter(|part| part.policy == PartPolicy::Rigid)
        .map(|part| {
            let points = part.vertices.iter().map(|&v| target.vertices()[v as usize]);
            let centre = points.clone().sum::<glam::DVec3>() / part.vertices.len().max(1) as f64;
            (part, centre, points.map(|p| p.distance(centre)).fold(0.0, f64::max))
        })
        .collect();
    rigid.sort_by(|a, b| b.2.total_cmp(&a.2));
    let mut done: Vec<(&Part, Row)> = Vec::with_capacity(rigid.len());
    for (at, &(part, centre, radius)) in rigid.iter().enumerate() {
        let holds = |other: &(&Part, glam::DVec3, f64)| other.1.distance(centre) + radius <= 1.1 * other.2;
        let row = match rigid[..at].iter().position(holds) {
            Some(outer) => done[outer].1.clone(),
            None => rigid_row(target, part, radius, body, source_rows),
        };
        done.push((part, row));
    }
    done
}

/// The mean row of the source part that a rigid part is modelled on, or of the surface where it
/// lies on it.
fn rigid_row(target: &TriangleMesh, part: &Part, radius: f64, body: &Weighted, source_rows: &[Row]) -> Row {
    if let Some(like) = &part.like {
        let row = mean_row(like, source_rows);
        if !row.is_empty() {
            return row;
        }
    }
    let below: Vec<(Row, f64)> = part.vertices.par_iter().map(|&v| body.at(target, v)).collect();
    let nearest = below.iter().map(|(_, distance)| *distance).fold(f64::INFINITY, f64::min);
    let reach = (0.25 * radius).max(f64::MIN_POSITIVE);
    let share = |distance: f64| libm::exp(-libm::pow((distance - nearest) / reach, 2.0));
    normalized(blend(below.iter().map(|(row, distance)| (row, share(*distance)))))
}

/// Rows of a part from the source part that it is modelled on, both brought to one place and size.
fn like_rows(
    target: &TriangleMesh,
    vertices: &[u32],
    source: SourceWeights<'_>,
    like: &[u32],
) -> Result<Vec<(u32, Row)>, MeshError> {
    let mesh = source.surface.mesh;
    let frame = |mesh: &TriangleMesh, vertices: &[u32]| {
        let points = vertices.iter().map(|&v| mesh.vertices()[v as usize]);
        let centre = points.clone().sum::<glam::DVec3>() / vertices.len().max(1) as f64;
        let square: f64 = points.map(|p| p.distance_squared(centre)).sum();
        (centre, (square / vertices.len().max(1) as f64).sqrt().max(f64::MIN_POSITIVE))
    };
    let ((from, size), (to, source_size)) = (frame(target, vertices), frame(mesh, like));
    let mut rows = vec![Row::new(); mesh.vertex_count()];
    like.iter().for_each(|&v| rows[v as usize].clone_from(&source.rows[v as usize]));
    let Ok(part) = Weighted::new(mesh, &rows) else {
        return Ok(Vec::new());
    };
    let moved = target.vertices().iter().map(|&p| to + (p - from) * (source_size / size)).collect();
    let moved = TriangleMesh::new(moved, Vec::new())?;
    Ok(vertices.par_iter().map(|&v| (v, part.at(&moved, v).0)).collect())
}

#[cfg(test)]
mod tests {
    use super::super::icp::Surroundings;
    use super::super::parts::{plan_parts, spread};
    use super::super::shell::Shell;
    use super::*;
    use crate::mesh::PartChoice;
    use crate::mesh::test_surfaces::{grid, icosphere, joined, mapped, permuted, similarity, tube};
    use glam::{DAffine3, DVec3};

    /// A limb along z with two bones that blend around its middle.
    fn limb() -> TriangleMesh {
        tube(0.5, 4.0, 32, 64)
    }

    fn ramp(p: DVec3) -> Row {
        let upper = (p.z - 1.5).clamp(0.0, 1.0);
        [(0, 1.0 - upper), (1, upper)].into_iter().filter(|entry| entry.1 > 0.0).collect()
    }

    fn button() -> TriangleMesh {
        mapped(&icosphere(1), |p| p * 0.1 + DVec3::new(0.62, 0.0, 2.0))
    }

    /// A strip of hair or cloth along the limb.
    fn strip() -> TriangleMesh {
        mapped(&grid(10), |p| DVec3::new(-0.52, 0.04 * (p.x - 0.5), 1.6 + 0.8 * p.y))
    }

    /// Whether a point is a vertex of the limb itself.
    fn on_limb(p: DVec3) -> bool {
        (p.truncate().length() - 0.5).abs() < 1e-9
    }

    struct Scene {
        source: TriangleMesh,
        source_rows: Vec<Row>,
        target: TriangleMesh,
        matched: Vec<bool>,
    }

    impl Scene {
        fn new(source: TriangleMesh, target: TriangleMesh, matched: impl Fn(DVec3) -> bool) -> Self {
            let source_rows = source.vertices().iter().map(|&p| ramp(p)).collect();
            let matched = target.vertices().iter().map(|&p| matched(p)).collect();
            Self { source, source_rows, target, matched }
        }

        fn run(&self, wish: PartPolicy, place: DAffine3) -> PartWeights {
            let [source, target] =
                [&self.source, &self.target].map(|mesh| mapped(mesh, |p| place.transform_point3(p)));
            let query = SurfaceQuery::new(&source).unwrap();
            let shell = Shell::new(&source, &query, &Progress::new()).unwrap();
            let surface = Surroundings { mesh: &source, query: &query, shell: &shell };
            let source = SourceWeights { surface, rows: &self.source_rows };
            let choice = PartChoice::All(wish).resolved(&target).unwrap();
            let parts = plan_parts(&target, &self.matched, source, &choice);
            let rows: Vec<Row> = self.target.vertices().iter().map(|&p| ramp(p)).collect();
            let settings = InpaintSettings::default();
            let known: Vec<Known> = self.matched.iter().map(|&matched| Known::exactly(matched)).collect();
            weigh_parts(&target, &parts, &rows, &known, source, &settings, &Progress::new()).unwrap()
        }

        fn weigh(&self, wish: PartPolicy) -> PartWeights {
            let found = self.run(wish, DAffine3::IDENTITY);
            for row in &found.rows {
                assert!((row.iter().map(|entry| entry.1).sum::<f64>() - 1.0).abs() < 1e-9);
            }
            found
        }
    }

    fn policies(found: &PartWeights) -> Vec<PartPolicy> {
        found.parts.iter().map(|part| part.policy).collect()
    }

    /// The limb with a button and a strip; only the limb is matched.
    fn dressed() -> Scene {
        let target = joined(&joined(&limb(), &button()), &strip());
        Scene::new(limb(), target, on_limb)
    }

    #[test]
    fn buttons_are_rigid_and_strips_follow() {
        let found = dressed().weigh(PartPolicy::Auto);
        assert_eq!(policies(&found), [PartPolicy::Match, PartPolicy::Rigid, PartPolicy::Follow]);
        let [button, strip] = [1, 2].map(|part: usize| &found.parts[part].vertices);
        let first = &found.rows[button[0] as usize];
        assert!(button.iter().all(|&v| found.rows[v as usize] == *first));
        assert!((first.iter().find(|entry| entry.0 == 1).unwrap().1 - 0.5).abs() < 0.05);
        for &v in strip {
            let expected = ramp(dressed().target.vertices()[v as usize]);
            assert!(spread(&expected, [&found.rows[v as usize]].into_iter()) < 0.02);
        }
    }

    #[test]
    fn a_wish_overrides_the_choice_but_for_the_body() {
        let scene = dressed();
        for (wish, expected) in [
            (PartPolicy::Rigid, [PartPolicy::Match, PartPolicy::Rigid, PartPolicy::Rigid]),
            (PartPolicy::Follow, [PartPolicy::Match, PartPolicy::Follow, PartPolicy::Follow]),
            // Nothing of these parts is matched, so that they follow after all.
            (PartPolicy::Match, [PartPolicy::Match, PartPolicy::Follow, PartPolicy::Follow]),
        ] {
            assert_eq!(policies(&scene.weigh(wish)), expected);
        }
    }

    #[test]
    fn a_part_that_the_source_has_goes_like_the_source_s() {
        let eye = mapped(&icosphere(2), |p| p * 0.2 + DVec3::new(0.3, 0.0, 2.0));
        let source = joined(&limb(), &eye);
        let target = joined(&limb(), &mapped(&eye, |p| p + DVec3::new(0.05, 0.0, 0.02)));
        let mut scene = Scene::new(source, target, |p| p.truncate().length() > 0.499);
        let base = limb().vertex_count();
        // Rigid in the source with weights that the surface around does not have.
        scene.source_rows[base..].fill(vec![(7, 1.0)]);
        let found = scene.weigh(PartPolicy::Auto);
        assert_eq!(policies(&found), [PartPolicy::Match, PartPolicy::Rigid]);
        assert!(found.rows[base..].iter().all(|row| *row == [(7, 1.0)]));
        // Not rigid: matched with that part alone.
        for (row, p) in scene.source_rows[base..].iter_mut().zip(icosphere(2).vertices()) {
            *row = normalized(vec![(7, 1.0 + p.z), (8, 1.0 - p.z)]);
        }
        let found = scene.weigh(PartPolicy::Auto);
        assert_eq!(policies(&found), [PartPolicy::Match, PartPolicy::Match]);
        for (row, p) in found.rows[base..].iter().zip(icosphere(2).vertices()) {
            assert!(spread(&normalized(vec![(7, 1.0 + p.z), (8, 1.0 - p.z)]), [row].into_iter()) < 0.05);
        }
    }

    #[test]
    fn garments_are_matched() {
        let sleeve = mapped(&tube(0.55, 2.0, 24, 20), |p| p + DVec3::Z);
        let scene =
            Scene::new(limb(), joined(&limb(), &sleeve), |p| p.z < 1.9 || p.truncate().length() < 0.52);
        let found = scene.weigh(PartPolicy::Auto);
        assert_eq!(policies(&found), [PartPolicy::Match; 2]);
        assert!(found.inpainted.len() > 100);
        assert!(found.inpainted.iter().all(|&v| !scene.matched[v as usize]));
    }

    #[test]
    fn a_target_of_pieces_and_one_without_any_match_get_weights() {
        let ball = |z: f64| mapped(&icosphere(2), |p| p * 0.45 + DVec3::Z * z);
        let pieces =
            (1..8).map(|k| ball(0.5 * f64::from(k))).fold(ball(0.0), |all, next| joined(&all, &next));
        let all = Scene::new(limb(), pieces.clone(), |_| true).weigh(PartPolicy::Auto);
        assert_eq!(policies(&all), [PartPolicy::Match; 8]);
        let none = Scene::new(limb(), pieces, |_| false).weigh(PartPolicy::Auto);
        assert!(none.parts.iter().all(|part| part.policy != PartPolicy::Match));
    }

    #[test]
    fn layers_of_an_eye_turn_together() {
        let centre = DVec3::new(0.55, 0.0, 2.3);
        let layer = |size: f64, shift: f64| mapped(&icosphere(1), |p| p * size + centre + DVec3::Z * shift);
        let target = joined(&joined(&limb(), &layer(0.05, 0.04)), &layer(0.1, 0.0));
        let scene = Scene::new(limb(), target, |p| p.truncate().length() < 0.5001 && p.x < 0.5);
        let found = scene.weigh(PartPolicy::Auto);
        let base = limb().vertex_count();
        assert!(found.rows[base..].iter().all(|row| *row == found.rows[base]));
    }

    #[test]
    fn neither_order_nor_place_nor_scale_matters() {
        let scene = dressed();
        let found = scene.weigh(PartPolicy::Auto);
        let (target, new) = permuted(&scene.target);
        let shuffled = Scene::new(permuted(&scene.source).0, target, on_limb);
        let again = shuffled.weigh(PartPolicy::Auto);
        for (v, &n) in new.iter().enumerate() {
            let (a, b) = (&found.rows[v], &again.rows[n as usize]);
            assert!(spread(a, [b].into_iter()) < 1e-6, "{}: {a:?} {b:?}", scene.target.vertices()[v]);
        }
        for scale in [1e-2, 1e2] {
            let again = scene.run(PartPolicy::Auto, similarity(scale));
            for (a, b) in found.rows.iter().zip(&again.rows) {
                assert!(spread(a, [b].into_iter()) < 1e-4);
            }
        }
    }

    #[test]
    fn the_number_of_threads_does_not_change_a_bit() {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| dressed().weigh(PartPolicy::Auto))
        };
        assert_eq!(on(1), on(3));
    }
}
