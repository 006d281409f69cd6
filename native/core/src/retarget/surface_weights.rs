//! The weights of a source that lies on the target: matched by closest points, filled where no
//! match passes its tests, part by part.

use glam::DVec3;
use kdtree::KdTree;
use kdtree::distance::squared_euclidean;
use rayon::prelude::*;

use super::auto::{mesh_error, spectral_error};
use super::cloth::{Worn, laid, told};
use super::differing_shapes::on_vertices;
use super::icp::Surroundings;
use super::inpaint::{InpaintSettings, Known};
use super::part_weights::{PartWeights, weigh_parts};
use super::parts::{Part, PartPolicy, SourceWeights, plan_parts};
use super::rejection::{RejectionSettings, SurfaceMatch, match_surfaces};
use super::shell::Shell;
use super::{Origin, RetargetError};
use crate::mesh::{ResolvedChoice, SurfaceQuery, TriangleMesh};
use crate::progress::Progress;
use crate::skinning::Row;
use crate::skinning::SkinWeights;

/// Inpainting reaches this far from accepted matches, as a share of the extent.
const FAR_FROM_MATCHES: f64 = 0.02;

/// What the target takes from the source, over the source's bones.
pub(super) struct TakenOver {
    /// One row for each target vertex, of sum 1.
    pub(super) rows: Vec<Row>,
    pub(super) origin: Vec<Origin>,
    pub(super) matched: Vec<bool>,
    /// Source vertex for each target vertex.
    pub(super) correspondence: Vec<u32>,
    /// Source vertices around the match of each target vertex, and their shares.
    pub(super) matches: Vec<([u32; 3], [f64; 3])>,
    /// What became of each part.
    pub(super) parts: Vec<Part>,
}

/// Takes the weights of `source`, which lies on the target, over to it. `tests` are those of the matches,
/// `worn` says how the target is worn by the source, if it is.
pub(super) fn take_over(
    (source, weights): (&TriangleMesh, &SkinWeights),
    (tests, worn): (&RejectionSettings, Option<Worn>),
    target: Surroundings<'_>,
    choice: &ResolvedChoice<PartPolicy>,
    progress: &Progress,
) -> Result<TakenOver, RetargetError> {
    progress.begin("Matching surfaces", 0.63, 0.85)?;
    let query = SurfaceQuery::new(source).map_err(|error| mesh_error("source", error))?;
    let shell = {
        let _first = progress.section(0.0, 0.3);
        Shell::new(source, &query, progress)?
    };
    let surface = Surroundings { mesh: source, query: &query, shell: &shell };
    let spectral = |error| spectral_error("target", error);
    let hangs = worn == Some(Worn::Hanging);
    let on_skin = if hangs {
        let _laying = progress.section(0.3, 0.6);
        let mesh = laid(target.mesh, surface, progress).map_err(spectral)?;
        let query = SurfaceQuery::new(&mesh).map_err(|error| mesh_error("target", error))?;
        let shell = target.shell.moved(&mesh);
        Some((mesh, query, shell))
    } else {
        None
    };
    let placed = on_skin.as_ref().map_or(target, |(mesh, query, shell)| Surroundings { mesh, query, shell });
    let matches = {
        let _rest = progress.section(if hangs { 0.6 } else { 0.3 }, 1.0);
        match_surfaces(surface, placed, tests, progress).map_err(spectral)?
    };
    let accepted: Vec<bool> = matches.iter().map(|found| found.accepted).collect();
    let depth = FAR_FROM_MATCHES * target.shell.extent;
    let far = far_from_matches(target.mesh.vertices(), &accepted, depth);
    let known = |v: usize| match (accepted[v], worn) {
        (true, Some(_)) => told([target, placed], v, (source, &matches[v])),
        (true, None) => Known::Exactly,
        (false, worn) => Known::exactly(far[v] && worn.is_none()),
    };
    let known: Vec<Known> = (0..accepted.len()).map(known).collect();
    let vertices = placed.mesh.vertices().par_iter();
    let rows: Vec<Row> = matches
        .par_iter()
        .zip(vertices)
        .map(|(found, &point)| match surface.equally_close(point, found.distance, found.triangle) {
            Some(other) => {
                let places = [(found.triangle, found.barycentric), (other.triangle, other.barycentric)];
                let [own, other] = places.map(|place| blend(place, source, weights));
                crate::skinning::blend([(&own, 0.5), (&other, 0.5)].into_iter())
            }
            None => blend((found.triangle, found.barycentric), source, weights),
        })
        .collect();

    progress.begin("Filling weights", 0.85, 1.0)?;
    let source_rows: Vec<Row> = (0..source.vertex_count())
        .map(|v| weights.entries(v).map(|(bone, weight)| (bone, f64::from(weight))).collect())
        .collect();
    let weighted = SourceWeights { surface, rows: &source_rows };
    let parts = plan_parts(target.mesh, &accepted, weighted, choice);
    // What is a mean already needs no smoothing.
    let evened = InpaintSettings { smoothing_rounds: 0, harmonic: hangs };
    let filling = if worn.is_some() { evened } else { InpaintSettings::default() };
    let filled =
        weigh_parts(target.mesh, &parts, &rows, &known, weighted, &filling, progress).map_err(spectral)?;
    let origin = origins(&filled, &accepted);
    Ok(TakenOver {
        rows: filled.rows,
        parts: filled.parts,
        matched: origin.iter().map(|&origin| origin == Origin::Matched).collect(),
        origin,
        correspondence: matches.iter().map(|found| nearest(found, source)).collect(),
        matches: on_vertices(&matches, source),
    })
}

/// Weights of the source at a place on it.
fn blend((triangle, barycentric): (u32, [f64; 3]), mesh: &TriangleMesh, weights: &SkinWeights) -> Row {
    let mut row = Row::new();
    for (&corner, share) in mesh.triangles()[triangle as usize].iter().zip(barycentric) {
        let total = weights.total(corner as usize);
        for (bone, weight) in weights.entries(corner as usize) {
            let part = share * f64::from(weight) / total;
            match row.binary_search_by_key(&bone, |entry| entry.0) {
                Ok(at) => row[at].1 += part,
                Err(at) => row.insert(at, (bone, part)),
            }
        }
    }
    row
}

/// Corner of the matched triangle that is nearest to the match.
fn nearest(found: &SurfaceMatch, mesh: &TriangleMesh) -> u32 {
    let shares = found.barycentric;
    let largest = (0..3).rev().max_by(|&a, &b| shares[a].total_cmp(&shares[b])).unwrap_or(0);
    mesh.triangles()[found.triangle as usize][largest]
}

/// Vertices without an accepted match that have none within `depth` of them either: there is
/// nothing to inpaint from, and the closest point of the source is the better guess.
fn far_from_matches(vertices: &[DVec3], accepted: &[bool], depth: f64) -> Vec<bool> {
    let mut tree = KdTree::new(3);
    for (vertex, point) in vertices.iter().enumerate().filter(|(vertex, _)| accepted[*vertex]) {
        // Coordinates of a mesh are finite, so adding them cannot fail.
        let _ = tree.add(point.to_array(), vertex);
    }
    let is_far = |(point, accepted): (&DVec3, &bool)| {
        let nearest = tree.nearest(&point.to_array(), 1, &squared_euclidean);
        !accepted && nearest.is_ok_and(|found| found.first().is_none_or(|found| found.0 > depth * depth))
    };
    vertices.par_iter().zip(accepted).map(is_far).collect()
}

fn origins(filled: &PartWeights, accepted: &[bool]) -> Vec<Origin> {
    let origin = |accepted: &bool| if *accepted { Origin::Matched } else { Origin::Nearest };
    let mut origin: Vec<Origin> = accepted.iter().map(origin).collect();
    filled.inpainted.iter().for_each(|&v| origin[v as usize] = Origin::Inpainted);
    for part in filled.parts.iter().filter(|part| part.policy != PartPolicy::Match) {
        part.vertices.iter().for_each(|&v| origin[v as usize] = Origin::Part);
    }
    origin
}
