//! What becomes of the loose parts of the target: eyes, teeth and armour keep their shape, lashes,
//! hair cards and trims go with the surface below, garments are matched like the body.
//!
//! A part that the source has too, at the same place, follows the source's: rigidly if its weights
//! are those of a rigid thing. Otherwise its size, its volume and how much of it was matched decide.
//! Every choice can be overridden. [`super::part_weights`] carries them out.

use rayon::prelude::*;

use super::icp::Surroundings;
use super::inpaint::{Row, blend, normalized};
use super::loose_parts::follow;
use super::part_shapes::{PartShape, part_shapes};
use super::shell::extent;
use crate::mesh::{ResolvedChoice, TriangleMesh};

/// A part longer than this share of the target is large: a body or a garment.
const LARGE: f64 = 0.25;
/// A bulky part shorter than this share is rigid, whatever it lies on.
const SMALL: f64 = 0.08;
/// Without a part of this share of the whole area there is no body: all parts together are it.
const BODY: f64 = 0.3;
/// Mean difference (L1) of a part's rows to their mean, up to which it counts as rigid in the
/// source,
const RIGID_IN_SOURCE: f64 = 0.1;
/// and, judged by the surface below, in the target.
const RIGID_BELOW: f64 = 0.5;
/// Shares of a part's vertices that must be matched: for a large part, for one of a body in
/// pieces, and for any other.
pub(super) const MATCHED: [f64; 3] = [0.3, 0.5, 0.7];

/// How a loose part gets its weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PartPolicy {
    /// Chosen for each part.
    #[default]
    Auto,
    /// One row of weights for the whole part.
    Rigid,
    /// Every vertex takes the weights of the nearest point of the body.
    Follow,
    /// The part is matched with the source like the body.
    Match,
}

/// A part and what becomes of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Vertices, ascending.
    pub vertices: Vec<u32>,
    /// Its treatment; never `Auto`.
    pub policy: PartPolicy,
    /// Whether it is the body: the largest part by area.
    pub is_body: bool,
    /// Vertices of the source part that it is modelled on, if there is one.
    pub like: Option<Vec<u32>>,
}

/// The source as parts see it: deformed onto the target, with its weights.
#[derive(Clone, Copy)]
pub struct SourceWeights<'a> {
    /// The deformed surface.
    pub surface: Surroundings<'a>,
    /// One row for each of its vertices; may be empty.
    pub rows: &'a [Row],
}

/// Chooses the treatment of every part.
///
/// `matched` marks target vertices that have a match they can rely on.
#[must_use]
pub fn plan_parts(
    target: &TriangleMesh,
    matched: &[bool],
    source: SourceWeights<'_>,
    choice: &ResolvedChoice<PartPolicy>,
) -> Vec<Part> {
    let (shapes, _) = part_shapes(target);
    let (source_shapes, _) = part_shapes(source.surface.mesh);
    // A shoe alone is a small part of a character, so the source has a say in what is large.
    let whole = extent(target).max(source.surface.shell.extent);
    let area: f64 = shapes.iter().map(|shape| shape.area).sum();
    let body = (0..shapes.len()).rev().max_by(|&a, &b| shapes[a].area.total_cmp(&shapes[b].area));
    let in_pieces = body.is_none_or(|body| shapes[body].area < BODY * area);
    let source_body = largest(&source_shapes);
    let plan = |(index, shape): (usize, &PartShape)| {
        let is_body = Some(index) == body;
        let like = (!is_body).then(|| most_alike(shape, &source_shapes, source_body)).flatten();
        let share = shape.vertices.iter().filter(|v| matched[**v as usize]).count() as f64
            / shape.vertices.len().max(1) as f64;
        let automatic = || {
            if let Some(like) = like {
                return match is_rigid(&like.vertices, source.rows) {
                    true => PartPolicy::Rigid,
                    false => PartPolicy::Match,
                };
            }
            let below = || spread_below(shape, target, source);
            let large = shape.lengths[0] >= LARGE * whole;
            match shape {
                _ if shape.area <= 0.0 => PartPolicy::Follow,
                _ if in_pieces && share >= MATCHED[1] => PartPolicy::Match,
                _ if large && share >= MATCHED[0] => PartPolicy::Match,
                _ if large => PartPolicy::Follow,
                _ if shape.is_bulky() && shape.lengths[0] < SMALL * whole => PartPolicy::Rigid,
                _ if shape.is_bulky() && below() < RIGID_BELOW => PartPolicy::Rigid,
                _ if share >= MATCHED[2] => PartPolicy::Match,
                _ => PartPolicy::Follow,
            }
        };
        let policy = match choice.of(&shape.vertices, is_body) {
            PartPolicy::Auto if is_body => PartPolicy::Match,
            PartPolicy::Auto => automatic(),
            chosen => chosen,
        };
        let like = like.map(|like| like.vertices.clone());
        Part { vertices: shape.vertices.clone(), policy, is_body, like }
    };
    shapes.par_iter().enumerate().map(plan).collect()
}

/// Mean of rows, scaled to a sum of 1.
pub(super) fn mean_row(vertices: &[u32], rows: &[Row]) -> Row {
    normalized(blend(vertices.iter().map(|&v| (&rows[v as usize], 1.0))))
}

fn largest(shapes: &[PartShape]) -> Option<usize> {
    (0..shapes.len()).rev().max_by(|&a, &b| shapes[a].area.total_cmp(&shapes[b].area))
}

fn most_alike<'a>(shape: &PartShape, others: &'a [PartShape], body: Option<usize>) -> Option<&'a PartShape> {
    let candidates = others.iter().enumerate().filter(|(index, _)| Some(*index) != body);
    let alike = candidates.filter_map(|(_, other)| Some((shape.likeness(other)?, other)));
    alike.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, other)| other)
}

/// Whether the weights of a source part are those of a rigid thing.
fn is_rigid(vertices: &[u32], rows: &[Row]) -> bool {
    let mean = mean_row(vertices, rows);
    spread(&mean, vertices.iter().map(|&v| &rows[v as usize])) < RIGID_IN_SOURCE
}

/// Mean L1 difference of rows to their mean.
pub(super) fn spread<'a>(mean: &Row, rows: impl Iterator<Item = &'a Row>) -> f64 {
    let (mut total, mut count) = (0.0, 0usize);
    for row in rows.filter(|row| !row.is_empty()) {
        let sum: f64 = row.iter().map(|entry| entry.1).sum();
        let negative: Row = row.iter().map(|&(bone, weight)| (bone, -weight / sum)).collect();
        let mut difference: Row = mean.iter().chain(&negative).copied().collect();
        difference.sort_by_key(|entry| entry.0);
        let by_bone = difference.chunk_by(|a, b| a.0 == b.0);
        total += by_bone.map(|run| run.iter().map(|entry| entry.1).sum::<f64>().abs()).sum::<f64>();
        count += 1;
    }
    if count == 0 { f64::INFINITY } else { total / count as f64 }
}

/// How much the weights of the source's surface next to a part differ from vertex to vertex.
fn spread_below(shape: &PartShape, target: &TriangleMesh, source: SourceWeights<'_>) -> f64 {
    let mesh = source.surface.mesh;
    let row = |&v: &u32| follow(target.vertices()[v as usize], mesh, source.surface.query, source.rows).row;
    let rows: Vec<Row> = shape.vertices.iter().map(row).map(normalized).collect();
    let mean = normalized(blend(rows.iter().map(|row| (row, 1.0))));
    spread(&mean, rows.iter())
}
