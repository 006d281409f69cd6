//! Parts of the mesh that no bone reaches through the body (eyes, buttons, specks): they follow the
//! nearest surface that has weights. Small parts move as one, whether reached or not.

use glam::DVec3;
use rayon::prelude::*;

use super::body::Body;
use super::labels::{Row, scale_to_one};
use crate::mesh::{ClosestPoint, Submesh, SurfaceQuery};
use crate::rig::distance_to_segment;

/// A component whose bounds have a diagonal below this share of the character moves as one.
const SMALL: f64 = 0.03;

/// Gives every row of the body's vertices weights. `takes_part` (B) marks the bones that count, of
/// which there is at least one.
pub(super) fn attach(body: &Body, rows: &mut [Row], takes_part: &[bool]) {
    let parts = parts(body);
    let is_bare: Vec<bool> =
        parts.iter().map(|part| part.iter().all(|&v| rows[v as usize].is_empty())).collect();
    let has_row: Vec<bool> = rows.iter().map(|row| !row.is_empty()).collect();
    let surface = Submesh::new(&body.mesh, |v| has_row[v])
        .ok()
        .and_then(|body| SurfaceQuery::new(&body.mesh).ok().map(|query| (body, query)));
    let follow = |point: DVec3, rows: &[Row]| match &surface {
        Some((part, query)) => follow(point, part, query, rows),
        None => nearest_bone(point, body, takes_part),
    };
    let found: Vec<Vec<(u32, Row)>> = parts
        .par_iter()
        .zip(is_bare)
        .map(|(part, is_bare)| {
            let points = || part.iter().map(|&v| body.mesh.vertices()[v as usize]);
            let (low, high) = points()
                .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
            let is_small = low.distance(high) < SMALL * body.length;
            match (is_small, is_bare) {
                (true, bare) => {
                    let row = match bare {
                        true => follow((low + high) * 0.5, rows),
                        false => mean(part.iter().map(|&v| &rows[v as usize])),
                    };
                    part.iter().map(|&v| (v, row.clone())).collect()
                }
                (false, _) => part
                    .iter()
                    .filter(|&&v| rows[v as usize].is_empty())
                    .map(|&v| (v, follow(body.mesh.vertices()[v as usize], rows)))
                    .collect(),
            }
        })
        .collect();
    for (vertex, row) in found.into_iter().flatten() {
        rows[vertex as usize] = row;
    }
}

/// Vertices of each component, ascending.
fn parts(body: &Body) -> Vec<Vec<u32>> {
    let topology = body.mesh.topology();
    let mut parts = vec![Vec::new(); topology.component_count()];
    for (vertex, &component) in (0..).zip(topology.components()) {
        parts[component as usize].push(vertex);
    }
    parts
}

/// Interpolates the rows at the point of the surface that is nearest.
fn follow(point: DVec3, surface: &Submesh, query: &SurfaceQuery, rows: &[Row]) -> Row {
    let Some(ClosestPoint { triangle, barycentric, .. }) = query.closest_point(point) else {
        return surface.to_whole.first().map_or_else(Row::new, |&v| rows[v as usize].clone());
    };
    let corners = surface.mesh.triangles()[triangle as usize].map(|v| surface.to_whole[v as usize]);
    weighted(corners.iter().zip(barycentric).map(|(&v, share)| (&rows[v as usize], share)))
}

fn mean<'a>(rows: impl Iterator<Item = &'a Row>) -> Row {
    weighted(rows.map(|row| (row, 1.0)))
}

fn weighted<'a>(rows: impl Iterator<Item = (&'a Row, f64)>) -> Row {
    let mut sum = Row::new();
    for (row, share) in rows.filter(|(_, share)| *share > 0.0) {
        for &(bone, weight) in row {
            match sum.binary_search_by_key(&bone, |entry| entry.0) {
                Ok(entry) => sum[entry].1 += share * weight,
                Err(entry) => sum.insert(entry, (bone, share * weight)),
            }
        }
    }
    scale_to_one(&mut sum);
    sum
}

/// The bone whose segment is nearest through the air, where there is no surface to follow.
fn nearest_bone(point: DVec3, body: &Body, takes_part: &[bool]) -> Row {
    let bones = (0..takes_part.len()).filter(|&bone| takes_part[bone]);
    bones
        .map(|bone| (bone as u32, distance_to_segment(point, body.heads[bone], body.tails[bone])))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or_else(Row::new, |(bone, _)| vec![(bone, 1.0)])
}
