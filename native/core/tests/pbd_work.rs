//! What a pose costs, counted instead of timed: projections, islands, allocations, and how they grow
//! with the mesh.

#![allow(clippy::unwrap_used)]

use std::alloc::System;
use std::sync::Mutex;

use dermis::mesh::TriangleMesh;
use dermis::pbd::{PbdSettings, PbdSkin, Work};
use dermis::rig::Skeleton;
use dermis::skinning::SkinWeights;
use glam::{Affine3A, DVec3, Quat, Vec3};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Tests take turns, so that nobody counts the allocations of another.
static ALONE: Mutex<()> = Mutex::new(());

const JOINTS: usize = 4;
/// Radii between joints: so far apart that every joint is an island of its own.
const BONE: f64 = 10.0;

/// A limb of radius 1 along x with `sides` vertices around it and triangles as wide as long.
struct Limb {
    mesh: TriangleMesh,
    skeleton: Skeleton,
    weights: SkinWeights,
}

impl Limb {
    fn new(sides: usize) -> Self {
        Self::with_trace(sides, 0.0)
    }

    /// A limb whose last bone has a trace of weight around the first joint.
    fn with_trace(sides: usize, trace: f64) -> Self {
        let length = BONE * (JOINTS + 1) as f64;
        let rings = (length * sides as f64 / std::f64::consts::TAU) as usize;
        let place = |ring: usize, k: usize| {
            let angle = std::f64::consts::TAU * k as f64 / sides as f64;
            DVec3::new(length * ring as f64 / (rings - 1) as f64, angle.cos(), angle.sin())
        };
        let vertices: Vec<DVec3> =
            (0..rings).flat_map(|ring| (0..sides).map(move |k| place(ring, k))).collect();
        let at = |ring: usize, k: usize| (ring * sides + k % sides) as u32;
        let triangles = (0..rings - 1).flat_map(|ring| {
            (0..sides).flat_map(move |k| {
                let (a, b, c, d) = (at(ring, k), at(ring, k + 1), at(ring + 1, k + 1), at(ring + 1, k));
                [[a, b, c], [a, c, d]]
            })
        });
        let triangles = triangles.collect();
        let below = |x: f64, joint: usize| {
            let t = ((x - BONE * joint as f64 + 1.0) / 2.0).clamp(0.0, 1.0);
            t * t * (3.0 - 2.0 * t)
        };
        let entries: Vec<(i64, i64, f64)> = vertices
            .iter()
            .enumerate()
            .flat_map(|(v, p)| {
                let x = p.x;
                (0..=JOINTS).map(move |bone| {
                    let own = if bone == 0 { 1.0 } else { below(x, bone) };
                    let next = if bone == JOINTS { 0.0 } else { below(x, bone + 1) };
                    let trace = if (x - BONE).abs() < 3.0 { trace } else { 0.0 };
                    let last = if bone == JOINTS { trace } else { 0.0 };
                    (v as i64, bone as i64, (own - next) * (1.0 - trace) + last)
                })
            })
            .collect();
        let weights = SkinWeights::from_triplets(entries, vertices.len(), JOINTS + 1).unwrap();
        let heads: Vec<DVec3> = (0..=JOINTS).map(|bone| DVec3::X * BONE * bone as f64).collect();
        let tails = heads.iter().map(|head| *head + DVec3::X * BONE).collect();
        let parents: Vec<i64> = (-1..JOINTS as i64).collect();
        let skeleton = Skeleton::new(heads, tails, &parents, None).unwrap();
        Self { mesh: TriangleMesh::new(vertices, triangles).unwrap(), skeleton, weights }
    }

    fn vertex_count(&self) -> usize {
        self.mesh.vertex_count()
    }

    fn skin(&self) -> PbdSkin {
        PbdSkin::new(&self.mesh, &self.skeleton, &self.weights, &PbdSettings::default()).unwrap()
    }
}

/// Every joint bent by its angle in degrees.
fn bent(angles: [f32; JOINTS]) -> Vec<Affine3A> {
    let mut transforms = vec![Affine3A::IDENTITY];
    for (joint, angle) in (1..).zip(angles) {
        let head = Vec3::X * BONE as f32 * joint as f32;
        let turn = Quat::from_rotation_z(angle.to_radians());
        let own = Affine3A::from_rotation_translation(turn, head - turn * head);
        transforms.push(*transforms.last().unwrap() * own);
    }
    transforms
}

fn work(skin: &PbdSkin, angles: [f32; JOINTS]) -> Work {
    skin.solve_offsets(&bent(angles), None, None).unwrap().stats.work
}

/// Growth exponent of a count from one size to another.
fn exponent(sizes: [usize; 2], counts: [usize; 2]) -> f64 {
    (counts[1] as f64 / counts[0] as f64).ln() / (sizes[1] as f64 / sizes[0] as f64).ln()
}

#[test]
fn nothing_moved_is_no_work() {
    let _alone = ALONE.lock();
    let skin = Limb::new(24).skin();
    assert_eq!(work(&skin, [0.0; JOINTS]), Work::default());
    let turned = Affine3A::from_rotation_translation(Quat::from_rotation_y(0.7), Vec3::splat(3.0));
    let as_a_whole: Vec<Affine3A> = bent([0.0; JOINTS]).into_iter().map(|t| turned * t).collect();
    assert_eq!(skin.solve(&as_a_whole, None).unwrap().stats.work, Work::default());
}

#[test]
fn a_joint_costs_its_own_island_and_no_other() {
    let _alone = ALONE.lock();
    let skin = Limb::new(24).skin();
    let all = work(&skin, [60.0, 50.0, 40.0, 30.0]);
    assert_eq!((all.solved_islands, all.reused_islands), (JOINTS, 0));
    let one = work(&skin, [0.0, 0.0, 40.0, 0.0]);
    assert_eq!(one.solved_islands + one.reused_islands, 1);
    let fresh = Limb::new(24).skin();
    let one = work(&fresh, [0.0, 0.0, 40.0, 0.0]);
    assert_eq!(one.solved_islands, 1);
    assert!(4 * one.projections < 2 * all.projections, "{one:?} {all:?}");
    assert!(4 * one.corrected_vertices < 2 * all.corrected_vertices, "{one:?} {all:?}");
}

#[test]
fn islands_that_did_not_change_are_not_solved_again_and_keep_their_bits() {
    let _alone = ALONE.lock();
    let limb = Limb::new(24);
    let skin = limb.skin();
    let first = work(&skin, [60.0, 50.0, 40.0, 30.0]);
    let again = work(&skin, [60.0, 50.0, 40.0, 30.0]);
    assert_eq!((again.solved_islands, again.reused_islands, again.projections), (0, JOINTS, 0));
    assert_eq!(again.corrected_vertices, first.corrected_vertices);
    // The end of the limb moves: what comes before it has not changed.
    let pose = bent([60.0, 50.0, 40.0, 45.0]);
    let reused = skin.solve_offsets(&pose, None, None).unwrap();
    assert_eq!((reused.stats.work.solved_islands, reused.stats.work.reused_islands), (1, JOINTS - 1));
    let fresh = limb.skin().solve_offsets(&pose, None, None).unwrap();
    assert_eq!(fresh.stats.work.solved_islands, JOINTS);
    let bits = |offsets: &[Vec3]| offsets.iter().map(|o| o.to_array().map(f32::to_bits)).collect::<Vec<_>>();
    assert_eq!(bits(&reused.offsets), bits(&fresh.offsets));
    assert_eq!(reused.limited, fresh.limited);
    // And through the other door.
    assert_eq!(skin.solve(&pose, None).unwrap().vertices, limb.skin().solve(&pose, None).unwrap().vertices);
}

#[test]
fn an_island_depends_on_bones_that_only_its_surface_follows() {
    let _alone = ALONE.lock();
    let solved = |trace: f64| {
        let skin = Limb::with_trace(24, trace).skin();
        work(&skin, [60.0, 0.0, 0.0, 0.0]);
        let work = work(&skin, [60.0, 0.0, 0.0, 45.0]);
        (work.solved_islands, work.reused_islands)
    };
    assert_eq!(solved(0.0), (1, 1));
    assert_eq!(solved(0.004), (2, 0));
}

#[test]
fn the_cage_does_not_grow_with_the_mesh() {
    let _alone = ALONE.lock();
    let (coarse, fine) = (Limb::new(24), Limb::new(96));
    let angles = [60.0, 50.0, 40.0, 30.0];
    let (few, many) = (work(&coarse.skin(), angles), work(&fine.skin(), angles));
    assert!(fine.vertex_count() > 14 * coarse.vertex_count());
    assert!(many.projections < 2 * few.projections, "{few:?} {many:?}");
    assert!(many.contact_candidates < 4 * few.contact_candidates.max(1000), "{few:?} {many:?}");
    let sizes = [coarse.vertex_count(), fine.vertex_count()];
    let grown = exponent(sizes, [few.corrected_vertices, many.corrected_vertices]);
    assert!(grown < 1.05, "{grown}");
}

#[test]
fn a_frame_allocates_little_more_than_its_result() {
    let _alone = ALONE.lock();
    let mut counts = Vec::new();
    for sides in [24, 96] {
        let limb = Limb::new(sides);
        let skin = limb.skin();
        let poses = [bent([60.0, 50.0, 40.0, 30.0]), bent([50.0, 40.0, 30.0, 20.0])];
        // The first poses fill the buffers.
        for pose in poses.iter().cycle().take(4) {
            skin.solve_offsets(pose, None, None).unwrap();
        }
        let region = Region::new(ALLOCATOR);
        let solved = skin.solve_offsets(&poses[0], None, None).unwrap();
        let change = region.change();
        drop(solved);
        let result = limb.vertex_count() * size_of::<Vec3>();
        assert!(change.bytes_allocated < 8 * result + (1 << 18), "{change:?} for {result} bytes");
        counts.push(change.allocations + change.reallocations);
    }
    assert!(counts.iter().all(|&count| count < 400), "{counts:?}");
    assert!(counts[1] < 2 * counts[0] + 64, "not by vertices: {counts:?}");
}

#[test]
fn building_allocates_in_proportion_to_the_mesh() {
    let _alone = ALONE.lock();
    let measured: Vec<(usize, usize)> = [32, 64, 128]
        .into_iter()
        .map(|sides| {
            let limb = Limb::new(sides);
            let region = Region::new(ALLOCATOR);
            let skin = limb.skin();
            let bytes = region.change().bytes_allocated;
            drop(skin);
            (limb.vertex_count(), bytes)
        })
        .collect();
    for pair in measured.windows(2) {
        let grown = exponent([pair[0].0, pair[1].0], [pair[0].1, pair[1].1]);
        assert!(grown < 1.1, "{measured:?}: {grown}");
    }
}
