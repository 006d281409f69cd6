//! One patch: joint areas that share a cell size, their cage, and the islands in it.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::active::Neighbours;
use super::areas::{JointArea, JointAreas};
use super::contact::JointContact;
use super::contact_setup::joint_contacts;
use super::domains::Constraints;
use super::fit::cage_fit;
use super::island::{Bind, Island, SurfacePoint, spring_lengths};
use super::joint_blend::JointBlends;
use super::masks::{PatchMasks, geodesic_distances};
use super::particles::Particles;
use super::stiffness::{particle_shares, tetrahedron_share};
use super::{PbdError, Region};
use crate::cage::{
    BccLattice, CageError, Embedding, LatticeCage, Membership, WindingNumber, embed, extend_weights,
};
use crate::mesh::{Adjacency, SurfaceQuery, TriangleMesh};
use crate::rig::{Skeleton, closest_on_segment, distance_to_segment};
use crate::skinning::SkinWeights;

/// How far around a joint the cage may move even where weights do not blend, in radii: folds touch
/// beyond the blend. A limb of radius r bent by 120° touches itself up to 1.7 r from its joint.
const REACH: f64 = 2.0;
/// Width of the seam between free and held, in radii.
const REACH_FADE: f64 = 0.5;
/// Blend (1 − largest weight) from which a particle is wholly free.
const FREE_BLEND: f64 = 0.1;
/// Weights below this are dropped from particles, and the others lowered by as much, so that a
/// particle in a rigid part has one bone.
const LEAST_WEIGHT: f64 = 0.01;
/// Region "all": a particle this near to its bone, in radii of the nearest joint, is held.
const CORE: f64 = 0.3;
/// How closely the particles' weights follow the surface's (see [`extend_weights`]). Low: the cage
/// starts with smoother weights than the surface has, folds less, and the surface follows it.
const SMOOTH_FIDELITY: f64 = 0.1;
/// How closely they are made to follow in order to see whether the cage can speak for a vertex.
const FAITHFUL: f64 = 10.0;
/// Largest patch whose cell size was not asked for; more cannot be solved while animating.
pub(super) const MOST_TETRAHEDRA: usize = 100_000;
/// Growth of the cells of a patch that has more.
const COARSER: f64 = 1.3;
/// Rings of cells around what is free.
const MARGIN_CELLS: f64 = 2.0;

/// `(bone, weight)` entries of every particle.
pub(super) type Rows = Vec<Vec<(u32, f64)>>;

/// What every patch is built from.
pub(super) struct PatchInput<'a> {
    pub mesh: &'a TriangleMesh,
    /// Normals of its vertices, outwards.
    pub normals: &'a [DVec3],
    pub skeleton: &'a Skeleton,
    /// Normalised.
    pub weights: &'a SkinWeights,
    pub areas: &'a JointAreas,
    pub masks: &'a PatchMasks,
    pub winding: &'a WindingNumber,
    pub surface: &'a SurfaceQuery,
    pub adjacency: &'a Adjacency,
    pub region: Region,
    /// Share of the stiffness at each surface vertex, where it varies.
    pub stiffness_shares: Option<&'a [f32]>,
}

/// Builds the islands of a patch. A cell size that was not asked for grows until the patch has no
/// more than `most` tetrahedra.
pub(super) fn build_patch(
    input: &PatchInput<'_>,
    patch: u32,
    cell_size: Option<f64>,
    most: usize,
) -> Result<Vec<Island>, PbdError> {
    let mut size = input.areas.cell_sizes[patch as usize];
    loop {
        let islands = build_cells(input, patch, size);
        let too_many = match &islands {
            Ok(islands) => count(islands) > most,
            Err(PbdError::Cage(CageError::TooManyCells { .. })) => true,
            Err(_) => false,
        };
        if cell_size.is_some() || !too_many {
            return islands;
        }
        size *= COARSER;
    }
}

/// Tetrahedra of islands.
pub(super) fn count(islands: &[Island]) -> usize {
    islands.iter().map(|island| island.tetrahedra.len()).sum()
}

fn build_cells(input: &PatchInput<'_>, patch: u32, cell_size: f64) -> Result<Vec<Island>, PbdError> {
    let areas: Vec<JointArea> =
        input.areas.areas.iter().filter(|area| area.patch == patch).copied().collect();
    let (low, high) = input.mesh.bounds();
    let lattice = BccLattice::new((low + high) * 0.5, cell_size);
    let in_region = region_vertices(input, patch, &areas, cell_size);
    let triangles: Vec<Membership> =
        input.mesh.triangles().iter().map(|t| membership(t, &in_region)).collect();
    let region = |position: DVec3| {
        let triangle = input.surface.closest_point(position).map(|closest| closest.triangle);
        triangle.is_some_and(|t| triangles[t as usize] == Membership::Inside)
    };
    let cage = LatticeCage::new(input.mesh, input.winding, lattice, &triangles, &region)?;
    let embeddings: Vec<Option<Embedding>> = (0..input.mesh.vertex_count())
        .into_par_iter()
        .map(|v| {
            (in_region[v] > 0.0).then(|| embed(&lattice, &cage.index_of, input.mesh.vertices()[v])).flatten()
        })
        .collect();
    let [rows, faithful] = particle_weights(input, &cage, &embeddings)?;
    let fit = cage_fit(input, &faithful, &embeddings, cell_size);
    let freedom: Vec<f64> = (0..rows.len())
        .map(|i| match cage.is_cut[i] {
            true => 0.0,
            false => freedom(input, &areas, &rows[i], cage.mesh.vertices()[i]),
        })
        .collect();
    let stiffness_shares = match input.stiffness_shares {
        Some(shares) => particle_shares(&cage, &embeddings, shares)?,
        None => Vec::new(),
    };
    let shares_of = |members: &[u32]| match stiffness_shares.as_slice() {
        [] => Vec::new(),
        shares => {
            members.iter().map(|&t| tetrahedron_share(cage.mesh.tetrahedra()[t as usize], shares)).collect()
        }
    };
    // Across a wide seam a patch reaches what blends at its neighbour's joints: that is the neighbour's alone.
    let is_own = |point: &SurfacePoint| input.masks.is_own(point.vertex as usize, patch);
    Ok(split(&freedom, cage.mesh.tetrahedra())
        .into_par_iter()
        .map(|tetrahedra| {
            let shares = shares_of(&tetrahedra);
            build_island(
                input,
                patch,
                &areas,
                &cage,
                &rows,
                &fit,
                &freedom,
                &embeddings,
                &tetrahedra,
                &shares,
            )
        })
        .filter(|island| island.surface.iter().any(is_own))
        .collect())
}

/// 1 for vertices within the margin of what is free, 0.5 for a border as wide, 0 elsewhere.
fn region_vertices(input: &PatchInput<'_>, patch: u32, areas: &[JointArea], cell_size: f64) -> Vec<f64> {
    let is_free = |&v: &usize| {
        let row: Vec<(u32, f64)> = input.weights.entries(v).map(|(b, w)| (b, w.into())).collect();
        input.masks.mask(v, patch) > 0.0 && freedom(input, areas, &row, input.mesh.vertices()[v]) > 0.0
    };
    let seeds: Vec<usize> = (0..input.mesh.vertex_count()).into_par_iter().filter(is_free).collect();
    let margin = MARGIN_CELLS * cell_size;
    geodesic_distances(input.mesh, input.adjacency, seeds.into_iter(), 2.0 * margin)
        .into_iter()
        .map(|distance| match distance {
            Some(d) if d <= margin => 1.0,
            Some(_) => 0.5,
            None => 0.0,
        })
        .collect()
}

fn membership(triangle: &[u32; 3], in_region: &[f64]) -> Membership {
    let largest = triangle.iter().map(|&v| in_region[v as usize]).fold(0.0, f64::max);
    match largest {
        1.0 => Membership::Inside,
        0.5 => Membership::Border,
        _ => Membership::Outside,
    }
}

pub(super) fn smoothstep(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// How free a particle is, from 0 (held by its bones) to 1.
fn freedom(input: &PatchInput<'_>, areas: &[JointArea], row: &[(u32, f64)], position: DVec3) -> f64 {
    if row.is_empty() {
        return 0.0;
    }
    let blend = 1.0 - row.iter().map(|entry| entry.1).fold(0.0, f64::max);
    let mut free = smoothstep(blend / FREE_BLEND);
    for area in areas {
        let radii = position.distance(area.centre) / area.radius;
        free = free.max(smoothstep((REACH + REACH_FADE - radii) / REACH_FADE));
    }
    if input.region == Region::All && !areas.is_empty() {
        let (heads, tails) = (input.skeleton.heads(), input.skeleton.tails());
        let near = |b: u32| distance_to_segment(position, heads[b as usize], tails[b as usize]);
        let distance = row.iter().map(|&(bone, _)| near(bone)).fold(f64::INFINITY, f64::min);
        let by_centre = |a: &&JointArea, b: &&JointArea| {
            position.distance_squared(a.centre).total_cmp(&position.distance_squared(b.centre))
        };
        let radius = areas.iter().min_by(by_centre).map_or(0.0, |area| area.radius);
        free = free.max(smoothstep((distance / radius - CORE) / CORE));
    }
    free
}

/// Weights of the particles, extended from the surface, without their small change: smooth ones to
/// start from, and faithful ones to see how well the cage speaks for its vertices.
fn particle_weights(
    input: &PatchInput<'_>,
    cage: &LatticeCage,
    embeddings: &[Option<Embedding>],
) -> Result<[Rows; 2], PbdError> {
    let mut column_of = BTreeMap::new();
    let embedded = || embeddings.iter().enumerate().filter_map(|(v, e)| Some((v, (*e)?)));
    for (vertex, _) in embedded() {
        for (bone, _) in input.weights.entries(vertex) {
            column_of.entry(bone).or_insert(0usize);
        }
    }
    let bones: Vec<u32> = column_of.keys().copied().collect();
    column_of.values_mut().enumerate().for_each(|(column, slot)| *slot = column);
    let data: Vec<(Embedding, Vec<(u32, f64)>)> = embedded()
        .filter(|&(vertex, _)| !input.weights.row(vertex).0.is_empty())
        .map(|(vertex, embedding)| {
            let entries = input.weights.entries(vertex);
            (embedding, entries.map(|(bone, w)| (column_of[&bone] as u32, w.into())).collect())
        })
        .collect();
    let tables = extend_weights(&cage.mesh, &data, bones.len(), &[SMOOTH_FIDELITY, FAITHFUL])?;
    let sparse = |row: &Vec<f64>| {
        let lowered = bones.iter().zip(row).map(|(&bone, &w)| (bone, (w - LEAST_WEIGHT).max(0.0)));
        let mut kept: Vec<(u32, f64)> = lowered.filter(|entry| entry.1 > 0.0).collect();
        let sum: f64 = kept.iter().map(|entry| entry.1).sum();
        kept.iter_mut().for_each(|entry| entry.1 /= sum);
        kept
    };
    let rows = |table: usize| tables.get(table).map_or_else(Rows::new, |t| t.iter().map(sparse).collect());
    Ok([rows(0), rows(1)])
}

/// Groups tetrahedra that share a free vertex; those without one are left out.
fn split(freedom: &[f64], tetrahedra: &[[u32; 4]]) -> Vec<Vec<u32>> {
    let mut parent: Vec<u32> = (0..freedom.len() as u32).collect();
    fn root(parent: &mut [u32], mut v: u32) -> u32 {
        while parent[v as usize] != v {
            parent[v as usize] = parent[parent[v as usize] as usize];
            v = parent[v as usize];
        }
        v
    }
    let free = |t: &[u32; 4]| t.iter().copied().filter(|&v| freedom[v as usize] > 0.0).collect::<Vec<_>>();
    for t in tetrahedra {
        for pair in free(t).windows(2) {
            let (a, b) = (root(&mut parent, pair[0]), root(&mut parent, pair[1]));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut groups: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (index, t) in (0..).zip(tetrahedra) {
        if let Some(&first) = free(t).first() {
            groups.entry(root(&mut parent, first)).or_default().push(index);
        }
    }
    groups.into_values().collect()
}

#[allow(clippy::too_many_arguments)]
fn build_island(
    input: &PatchInput<'_>,
    patch: u32,
    areas: &[JointArea],
    cage: &LatticeCage,
    rows: &[Vec<(u32, f64)>],
    fit: &[f64],
    freedom: &[f64],
    embeddings: &[Option<Embedding>],
    members: &[u32],
    stiffness_shares: &[f32],
) -> Island {
    let global: Vec<[u32; 4]> = members.iter().map(|&t| cage.mesh.tetrahedra()[t as usize]).collect();
    let position = |p: u32| cage.mesh.vertices()[p as usize];
    let particles = Particles::new(&global, freedom, position);
    let Particles { at, edges: global_edges, layout, .. } = &particles;
    let local: HashMap<u32, u32> = (0..).zip(at).filter_map(|(place, p)| Some(((*p)?, place))).collect();
    let tetrahedra: Vec<[u32; 4]> = global.iter().map(|t| t.map(|v| local[&v])).collect();
    let edges: Vec<[u32; 2]> = global_edges.iter().map(|e| e.map(|v| local[&v])).collect();
    let inverse_masses: Vec<f32> = at.iter().map(|p| p.map_or(0.0, |p| freedom[p as usize] as f32)).collect();
    let island_rows =
        || at.iter().map(|p| p.map_or(&[][..], |p| rows[p as usize].as_slice()).iter().copied());
    let weights = SkinWeights::from_rows(island_rows(), input.skeleton.bone_count());
    let free = |place: &u32| inverse_masses[*place as usize] > 0.0;
    let binds = (0..).zip(at).filter(|(place, _)| free(place)).filter_map(|(place, p)| {
        let p = (*p)?;
        bind(input.skeleton, place, position(p), &rows[p as usize])
    });
    let lengths: Vec<f32> =
        global_edges.iter().map(|&[a, b]| position(a).distance(position(b)) as f32).collect();
    let springs: Vec<[f32; 4]> = global.iter().map(|t| spring_lengths(t.map(position))).collect();
    let domains = layout.domains(&Constraints {
        edges: &edges,
        edge_lengths: &lengths,
        tetrahedra: &tetrahedra,
        spring_lengths: &springs,
        stiffness_shares,
        binds: &binds.collect::<Vec<Bind>>(),
    });
    let used: BTreeSet<[u32; 4]> = global.iter().map(|t| sorted(*t)).collect();
    let surface = surface_points(input, patch, fit, freedom, embeddings, &used, &local);
    let (cage_contacts, contacts) =
        joint_contacts(input, areas, &surface).into_iter().map(|c| (c.cage, c.surface)).unzip();
    let cage_contacts: Vec<JointContact> = cage_contacts;
    let points_of =
        |contact: &JointContact| contact.vertices.iter().map(|v| surface[v.element as usize]).collect();
    let mut heaviness: BTreeMap<u32, f64> = BTreeMap::new();
    island_rows().flatten().for_each(|(bone, w)| *heaviness.entry(bone).or_default() += w);
    let mut bones: Vec<(u32, f64)> = heaviness.into_iter().collect();
    bones.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let surface_bones: BTreeSet<u32> =
        surface.iter().flat_map(|point| input.weights.row(point.vertex as usize).0).copied().collect();
    let is_new = |bone: &u32| bones.iter().all(|entry| entry.0 != *bone);
    let surface_bones = surface_bones.into_iter().filter(is_new).collect();
    // Particles without mass are anywhere in the island.
    let anywhere = global[0][0];
    let rest: Vec<Vec3> = at.iter().map(|p| position(p.unwrap_or(anywhere)).as_vec3()).collect();
    let (low, high) = rest.iter().fold((rest[0], rest[0]), |(l, h), &p| (l.min(p), h.max(p)));
    Island {
        neighbours: Neighbours::new(rest.len(), &tetrahedra),
        cage_points: cage_contacts.iter().map(points_of).collect(),
        blends: JointBlends::new(&cage_contacts, &weights, &inverse_masses, &tetrahedra),
        cage_contacts,
        contacts,
        weights,
        inverse_masses,
        edges,
        rest_volume: cage.lattice.tetrahedron_volume() as f32,
        domains,
        surface,
        bones,
        surface_bones,
        extent: (high - low).length(),
        tetrahedra,
        rest,
    }
}

fn sorted(mut corners: [u32; 4]) -> [u32; 4] {
    corners.sort_unstable();
    corners
}

/// The projection of a particle on the nearest of its bones; none where it is on the axis.
fn bind(skeleton: &Skeleton, particle: u32, position: DVec3, row: &[(u32, f64)]) -> Option<Bind> {
    let on_bone = |bone: u32| {
        let (head, tail) = (skeleton.heads()[bone as usize], skeleton.tails()[bone as usize]);
        closest_on_segment(position, head, tail).0
    };
    let nearest = row.iter().map(|&(bone, _)| (bone, on_bone(bone)));
    let (bone, anchor) = nearest.min_by(|a, b| position.distance(a.1).total_cmp(&position.distance(b.1)))?;
    let rest_length = position.distance(anchor) as f32;
    (rest_length > 0.0).then(|| Bind { particle, bone, anchor: anchor.as_vec3(), rest_length })
}

/// Surface vertices in the island's tetrahedra, each with the share that the island has in it.
fn surface_points(
    input: &PatchInput<'_>,
    patch: u32,
    fit: &[f64],
    freedom: &[f64],
    embeddings: &[Option<Embedding>],
    used: &BTreeSet<[u32; 4]>,
    local: &HashMap<u32, u32>,
) -> Vec<SurfacePoint> {
    let mut points = Vec::new();
    for (vertex, embedding) in embeddings.iter().enumerate() {
        let Some(embedding) = embedding else { continue };
        if !used.contains(&sorted(embedding.corners)) || input.weights.row(vertex).0.is_empty() {
            continue;
        }
        let corners = || embedding.corners.iter().map(|&c| c as usize).zip(embedding.barycentric);
        let free: f64 = corners().map(|(corner, b)| freedom[corner] * b).sum();
        let share = input.masks.mask(vertex, patch) * fit[vertex] * smoothstep(2.0 * free);
        if share > 0.0 {
            points.push(SurfacePoint {
                vertex: vertex as u32,
                corners: embedding.corners.map(|c| local[&c]),
                barycentric: embedding.barycentric.map(|b| b as f32),
                share: share as f32,
            });
        }
    }
    points
}
