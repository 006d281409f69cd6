//! Parts of the mesh that no bone reaches through the body (eyes, buttons, specks): they follow the
//! nearest surface that has weights. Small parts move as one, whether reached or not. Every choice
//! can be overridden.

use glam::DVec3;
use rayon::prelude::*;

use super::body::Body;
use super::labels::{Row, scale_to_one};
use crate::mesh::{ClosestPoint, ResolvedChoice, Submesh, SurfaceQuery};
use crate::rig::distance_to_segment;

/// A component whose bounds have a diagonal below this share of the character moves as one.
const SMALL: f64 = 0.03;

/// How a loose part gets its weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BindPartPolicy {
    /// Chosen for each part.
    #[default]
    Auto,
    /// One row of weights for the whole part.
    Rigid,
    /// Every vertex takes the weights of the nearest point of the body.
    Follow,
    /// The part is bound to the bones by itself, where they reach it.
    Own,
}

/// Gives every row of the body's vertices weights. `takes_part` (B) marks the bones that count, of
/// which there is at least one; `choice` is about the caller's vertices.
pub(super) fn attach(
    body: &Body,
    rows: &mut [Row],
    takes_part: &[bool],
    choice: &ResolvedChoice<BindPartPolicy>,
) {
    let parts = parts(body);
    let policies = policies(body, &parts, choice);
    let is_bare: Vec<bool> =
        parts.iter().map(|part| part.iter().all(|&v| rows[v as usize].is_empty())).collect();
    let mut leads: Vec<bool> = rows.iter().map(|row| !row.is_empty()).collect();
    let with_row = leads.clone();
    for (part, policy) in parts.iter().zip(&policies) {
        if matches!(policy, BindPartPolicy::Rigid | BindPartPolicy::Follow) {
            part.iter().for_each(|&v| leads[v as usize] = false);
        }
    }
    // Parts that are to go with the body do not lead others, unless there is nothing else.
    let surface = [leads, with_row].into_iter().find_map(|leads| {
        let surface = Submesh::new(&body.mesh, |v| leads[v]).ok()?;
        let query = SurfaceQuery::new(&surface.mesh).ok()?;
        Some((surface, query))
    });
    let follow = |point: DVec3, rows: &[Row]| match &surface {
        Some((part, query)) => follow(point, part, query, rows),
        None => nearest_bone(point, body, takes_part),
    };
    let point = |v: u32| body.mesh.vertices()[v as usize];
    let found: Vec<Vec<(u32, Row)>> = parts
        .par_iter()
        .zip(is_bare)
        .zip(policies)
        .map(|((part, is_bare), policy)| {
            let (low, high) = part
                .iter()
                .map(|&v| point(v))
                .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
            let is_rigid = match policy {
                BindPartPolicy::Auto => low.distance(high) < SMALL * body.length,
                policy => policy == BindPartPolicy::Rigid,
            };
            if is_rigid {
                let row = match is_bare {
                    true => follow((low + high) * 0.5, rows),
                    false => mean(part.iter().map(|&v| &rows[v as usize])),
                };
                return part.iter().map(|&v| (v, row.clone())).collect();
            }
            let all = policy == BindPartPolicy::Follow;
            let followers = part.iter().filter(|&&v| all || rows[v as usize].is_empty());
            followers.map(|&v| (v, follow(point(v), rows))).collect()
        })
        .collect();
    for (vertex, row) in found.into_iter().flatten() {
        rows[vertex as usize] = row;
    }
}

/// What was chosen for each part.
fn policies(body: &Body, parts: &[Vec<u32>], choice: &ResolvedChoice<BindPartPolicy>) -> Vec<BindPartPolicy> {
    let mut part_of = vec![0; body.mesh.vertex_count()];
    for (index, part) in parts.iter().enumerate() {
        part.iter().for_each(|&v| part_of[v as usize] = index);
    }
    let mut areas = vec![0.0; parts.len()];
    for (t, triangle) in body.mesh.triangles().iter().enumerate() {
        areas[part_of[triangle[0] as usize]] += body.mesh.area_vector(t).length();
    }
    let largest = (0..parts.len()).rev().max_by(|&a, &b| areas[a].total_cmp(&areas[b]));
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); parts.len()];
    for (vertex, &welded) in (0u32..).zip(&body.welded) {
        members[part_of[welded as usize]].push(vertex);
    }
    let chosen = |(index, part): (usize, &Vec<u32>)| choice.of(part, Some(index) == largest);
    members.iter().enumerate().map(chosen).collect()
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
