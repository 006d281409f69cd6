//! Limb against limb: parts of the body that are no neighbours, such as an arm and the trunk, do not pass
//! through each other. The last step of the surface, after the folds of the joints.

use std::collections::HashMap;

use glam::{Affine3A, DVec3, Vec3};
use rayon::prelude::*;

use super::limb_pair::{
    LimbPair, Meeting, PairScratch, PairTouch, SEAM, UNTOUCHED, overlaps_at_rest, seam_shares,
};
use super::limb_parts::{Bounds, LimbPart, limb_parts, ways_from};
use super::limb_rim::{LimbRim, soften_rim};
use crate::mesh::{Adjacency, TriangleMesh};
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// Rounds over all pairs that are near.
const ROUNDS: usize = 3;
/// Limbs whose bones have turned by less than this cannot have come into contact.
const UNMOVED: f32 = 1e-4;

/// The limbs of a body and what they keep from the rest pose.
#[derive(Debug, Clone, Default)]
pub(super) struct LimbContacts {
    parts: Vec<LimbPart>,
    parents: Vec<Option<u32>>,
    /// Of the pairs that are near each other in rest.
    touches: HashMap<[u32; 2], PairTouch>,
}

/// Buffers of a pose.
#[derive(Debug, Clone, Default)]
pub(super) struct LimbScratch {
    bounds: Vec<Bounds>,
    order: Vec<u32>,
    pair: PairScratch,
    rim: LimbRim,
}

impl LimbContacts {
    pub(super) fn new(
        mesh: &TriangleMesh,
        normals: &[DVec3],
        adjacency: &Adjacency,
        skeleton: &Skeleton,
        weights: &SkinWeights,
    ) -> Self {
        let parts = limb_parts(mesh, normals, adjacency, skeleton, weights);
        let mut contacts = Self { parts, parents: skeleton.parents().to_vec(), touches: HashMap::new() };
        let positions: Vec<Vec3> = mesh.vertices().iter().map(|v| v.as_vec3()).collect();
        let mut scratch = LimbScratch::default();
        contacts.bound(&positions, &mut scratch);
        let pairs = contacts.near_pairs(&scratch, |_| 1.0);
        let bounds = &scratch.bounds;
        let ways: Vec<HashMap<u32, f32>> = contacts
            .parts
            .par_iter()
            .map(|part| ways_from(part, mesh, adjacency, SEAM * part.radius))
            .collect();
        let touch = |scratch: &mut PairScratch, pair: [u32; 2]| {
            let parts = contacts.parts_of(pair);
            let seams = seam_shares(parts, pair.map(|part| &ways[part as usize]));
            (pair, overlaps_at_rest(parts, seams, contacts.bounds_of(pair, bounds), &positions, scratch))
        };
        contacts.touches = pairs.into_par_iter().map_init(PairScratch::default, touch).collect();
        contacts
    }

    /// Parts the limbs of a surface that is skinned by `transforms`. `shape` is the rest surface, where it
    /// is not the one of the mesh.
    pub(super) fn separate(
        &self,
        transforms: &[Affine3A],
        shape: Option<&[Vec3]>,
        adjacency: &Adjacency,
        positions: &mut [Vec3],
        scratch: &mut LimbScratch,
    ) {
        self.bound(positions, scratch);
        let scale = |part: &LimbPart| transforms[part.bone as usize].matrix3.determinant().abs().cbrt();
        let mut pairs = self.near_pairs(scratch, scale);
        pairs.retain(|pair| {
            let [a, b] = self.parts_of(*pair).map(|part| &transforms[part.bone as usize]);
            !a.abs_diff_eq(*b, UNMOVED)
        });
        if pairs.is_empty() {
            return;
        }
        let shaped = shape.map(|shape| self.touches_in(shape, &pairs, scratch));
        let touches = shaped.as_ref().unwrap_or(&self.touches);
        let untouched = UNTOUCHED;
        let pair_of = |pair: [u32; 2]| LimbPair {
            parts: self.parts_of(pair),
            transforms: self.parts_of(pair).map(|part| &transforms[part.bone as usize]),
            touch: touches.get(&pair).unwrap_or(&untouched),
        };
        let LimbScratch { bounds, rim, pair: buffers, .. } = scratch;
        let meet = |buffers: &mut PairScratch, pair: [u32; 2]| {
            (pair, pair_of(pair).meet(self.bounds_of(pair, bounds), positions, buffers))
        };
        let met = pairs.into_par_iter().map_init(PairScratch::default, meet);
        let met: Vec<([u32; 2], Option<Meeting>)> = met.collect();
        let mut met: Vec<([u32; 2], Meeting)> =
            met.into_iter().filter_map(|(pair, meeting)| Some((pair, meeting?))).collect();
        rim.clear();
        for round in 0..ROUNDS {
            // One pair after the other, so that what several of them press upon ends between all.
            met.retain_mut(|(pair, meeting)| {
                pair_of(*pair).part(meeting, round == 0, positions, buffers);
                for push in &buffers.pushes {
                    positions[push.vertex as usize] += push.offset;
                    rim.add(push.vertex, push.offset, positions.len());
                }
                !buffers.pushes.is_empty()
            });
        }
        soften_rim(rim, adjacency, positions);
    }

    fn touches_in(
        &self,
        shape: &[Vec3],
        pairs: &[[u32; 2]],
        scratch: &mut LimbScratch,
    ) -> HashMap<[u32; 2], PairTouch> {
        let bounds: Vec<Bounds> = self.parts.iter().map(|part| part_bounds(part, shape)).collect();
        let touch = |&pair: &[u32; 2]| {
            let seams = self.touches.get(&pair).cloned().unwrap_or(UNTOUCHED);
            let of_pair = self.bounds_of(pair, &bounds);
            (pair, overlaps_at_rest(self.parts_of(pair), seams, of_pair, shape, &mut scratch.pair))
        };
        pairs.iter().map(touch).collect()
    }

    fn bound(&self, positions: &[Vec3], scratch: &mut LimbScratch) {
        scratch.bounds.clear();
        scratch.bounds.par_extend(self.parts.par_iter().map(|part| part_bounds(part, positions)));
        scratch.order.clear();
        scratch.order.extend(0..self.parts.len() as u32);
        let low = |&part: &u32| scratch.bounds[part as usize].low.x;
        scratch.order.sort_by(|a, b| low(a).total_cmp(&low(b)).then(a.cmp(b)));
    }

    /// Pairs of limbs whose bounds come near each other, ascending; not those of neighbouring bones, which fold.
    fn near_pairs(&self, scratch: &LimbScratch, scale: impl Fn(&LimbPart) -> f32) -> Vec<[u32; 2]> {
        let LimbScratch { bounds, order, .. } = scratch;
        let scales: Vec<f32> = self.parts.iter().map(scale).collect();
        let rooms = self.parts.iter().zip(&scales);
        let most = rooms.map(|(part, scale)| scale * (part.radius + 2.0 * part.sample_spacing));
        let most = most.fold(0.0, f32::max);
        let mut pairs = Vec::new();
        for (place, &a) in order.iter().enumerate() {
            let own = &bounds[a as usize];
            for &b in &order[place + 1..] {
                let other = &bounds[b as usize];
                if other.low.x > own.high.x + most {
                    break;
                }
                let pair = [a.min(b), a.max(b)];
                let parts = self.parts_of(pair);
                if !self.are_neighbours(parts)
                    && own.grown(scales[pair[0] as usize] * LimbPair::reach(parts)).meets(other)
                {
                    pairs.push(pair);
                }
            }
        }
        pairs.sort_unstable();
        pairs
    }

    /// True for bones that fold at the joint between them, and for a bone and its grandparent, which
    /// take part in the folds of the bone between them.
    fn are_neighbours(&self, [a, b]: [&LimbPart; 2]) -> bool {
        let parent = |bone: u32| self.parents[bone as usize];
        let is_above = |bone: u32, other: u32| {
            parent(bone) == Some(other) || parent(bone).and_then(parent) == Some(other)
        };
        is_above(a.bone, b.bone) || is_above(b.bone, a.bone)
    }

    fn parts_of(&self, pair: [u32; 2]) -> [&LimbPart; 2] {
        pair.map(|part| &self.parts[part as usize])
    }

    fn bounds_of<'a>(&self, pair: [u32; 2], bounds: &'a [Bounds]) -> [&'a Bounds; 2] {
        pair.map(|part| &bounds[part as usize])
    }
}

fn part_bounds(part: &LimbPart, positions: &[Vec3]) -> Bounds {
    Bounds::of(part.vertices.iter().map(|&v| positions[v as usize]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Topology;

    const AROUND: u32 = 24;
    const RINGS: u32 = 25;

    /// Two limbs of radius 1 along x, a gap of 0.4 between them, each with a bone of its own below a root.
    struct Limbs {
        rest: Vec<Vec3>,
        adjacency: Adjacency,
        contacts: LimbContacts,
    }

    impl Limbs {
        fn new(gap: f64) -> Self {
            let vertex = |limb: u32, ring: u32, k: u32| {
                let angle = std::f64::consts::TAU * f64::from(k) / f64::from(AROUND);
                let centre = if limb == 0 { 0.0 } else { 2.0 + gap };
                DVec3::new(0.25 * f64::from(ring) - 3.0, angle.cos(), angle.sin() + centre)
            };
            let all = (0..2).flat_map(|l| (0..RINGS).flat_map(move |r| (0..AROUND).map(move |k| (l, r, k))));
            let vertices: Vec<DVec3> = all.map(|(l, r, k)| vertex(l, r, k)).collect();
            let at = |l: u32, r: u32, k: u32| (l * RINGS + r) * AROUND + k % AROUND;
            let quads =
                (0..2).flat_map(|l| (0..RINGS - 1).flat_map(move |r| (0..AROUND).map(move |k| (l, r, k))));
            let triangles = quads.flat_map(|(l, r, k)| {
                let (a, b, c, d) = (at(l, r, k), at(l, r, k + 1), at(l, r + 1, k + 1), at(l, r + 1, k));
                [[a, c, b], [a, d, c]]
            });
            let mesh = TriangleMesh::new(vertices, triangles.collect()).unwrap();
            let heads = [DVec3::new(-5.0, 0.0, 1.0), DVec3::X * -3.0, DVec3::new(-3.0, 0.0, 2.0 + gap)];
            let tails = [DVec3::new(-4.0, 0.0, 1.0), DVec3::X * 3.0, DVec3::new(3.0, 0.0, 2.0 + gap)];
            let skeleton = Skeleton::new(heads.to_vec(), tails.to_vec(), &[-1, 0, 0], None).unwrap();
            let bone = |v: usize| if v < (RINGS * AROUND) as usize { 1 } else { 2 };
            let entries = (0..mesh.vertex_count()).map(|v| (v as i64, bone(v), 1.0));
            let weights = SkinWeights::from_triplets(entries, mesh.vertex_count(), 3).unwrap();
            let topology: Topology = mesh.topology();
            let adjacency = Adjacency::new(mesh.vertex_count(), &topology);
            let normals = mesh.outward_normals(&topology);
            let contacts = LimbContacts::new(&mesh, &normals, &adjacency, &skeleton, &weights);
            Self { rest: mesh.vertices().iter().map(|v| v.as_vec3()).collect(), adjacency, contacts }
        }

        /// The surface with the second limb moved, skinned and parted.
        fn moved(&self, by: Affine3A) -> [Vec<Vec3>; 2] {
            let pose = [Affine3A::IDENTITY, Affine3A::IDENTITY, by];
            let first = (RINGS * AROUND) as usize;
            let skinned: Vec<Vec3> = (0..)
                .zip(&self.rest)
                .map(|(v, &p)| if v < first { p } else { by.transform_point3(p) })
                .collect();
            let mut parted = skinned.clone();
            let mut scratch = LimbScratch::default();
            self.contacts.separate(&pose, None, &self.adjacency, &mut parted, &mut scratch);
            [skinned, parted]
        }

        fn down(&self, by: f32) -> [Vec<Vec3>; 2] {
            self.moved(Affine3A::from_translation(-Vec3::Z * by))
        }
    }

    /// How far the limbs are in each other, seen from where the first one is highest.
    fn overlap(positions: &[Vec3]) -> f32 {
        let (first, second) = positions.split_at((RINGS * AROUND) as usize);
        let highest = first.iter().map(|p| p.z).fold(f32::NEG_INFINITY, f32::max);
        highest - second.iter().map(|p| p.z).fold(f32::INFINITY, f32::min)
    }

    fn largest(differences: impl Iterator<Item = Vec3>) -> f32 {
        differences.map(Vec3::length).fold(0.0, f32::max)
    }

    fn change([a, b]: &[Vec<Vec3>; 2]) -> f32 {
        largest(a.iter().zip(b).map(|(a, b)| *b - *a))
    }

    #[test]
    fn limbs_that_pass_into_each_other_are_parted_and_share_the_way() {
        let limbs = Limbs::new(0.4);
        for sunk in [0.1, 0.3, 0.5] {
            let [skinned, parted] = limbs.down(0.4 + sunk);
            assert!((overlap(&skinned) - sunk).abs() < 1e-4);
            assert!(overlap(&parted) < 0.02, "{sunk}: {}", overlap(&parted));
            let (first, second) = parted.split_at((RINGS * AROUND) as usize);
            let highest = first.iter().map(|p| p.z).fold(f32::NEG_INFINITY, f32::max);
            let lowest = second.iter().map(|p| p.z).fold(f32::INFINITY, f32::min);
            assert!((highest - (1.0 - 0.5 * sunk)).abs() < 0.06 && lowest >= highest - 0.02);
        }
    }

    #[test]
    fn what_does_not_meet_or_did_not_move_stays_to_the_last_bit() {
        let limbs = Limbs::new(0.4);
        for by in [0.0, 0.2, -1.0] {
            let [skinned, parted] = limbs.down(by);
            assert_eq!(skinned, parted);
        }
        let overlapping = Limbs::new(-0.3);
        let [skinned, parted] = overlapping.down(0.0);
        assert_eq!(skinned, parted);
        // What overlaps at rest is parted no farther than it was there.
        let nearly = overlapping.down(0.01);
        assert!(change(&nearly) < 0.03, "{}", change(&nearly));
    }

    #[test]
    fn the_push_sets_in_and_fades_out_without_a_jump() {
        let limbs = Limbs::new(0.4);
        let mut before: Option<Vec<Vec3>> = None;
        let (mut most, mut through) = (0.0f32, 0.0);
        for step in 0..=96 {
            let [skinned, parted] = limbs.down(0.3 + 0.04 * step as f32);
            let pushes: Vec<Vec3> = skinned.iter().zip(&parted).map(|(a, b)| *b - *a).collect();
            let last = largest(pushes.iter().copied());
            if let Some(before) = &before {
                let jump = largest(pushes.iter().zip(before).map(|(a, b)| *a - *b));
                assert!(jump < 0.08, "{step}: {jump}");
            }
            most = most.max(last);
            // Axis beyond axis; from there on it comes out on the other side.
            if step == 52 {
                through = last;
            }
            before = Some(pushes);
        }
        assert!(most > 0.3 && most < 1.2, "{most}");
        assert!(through < 0.1 * most, "right through each other, next to nothing is done: {through}");
    }

    #[test]
    fn place_and_size_of_the_body_do_not_matter() {
        let limbs = Limbs::new(0.4);
        let [_, parted] = limbs.down(0.7);
        let whole = Affine3A::from_scale_rotation_translation(
            Vec3::splat(10.0),
            glam::Quat::from_euler(glam::EulerRot::XYZ, 0.4, 1.0, -0.7),
            Vec3::new(3.0, -20.0, 5.0),
        );
        let second = whole * Affine3A::from_translation(-Vec3::Z * 0.7);
        let pose = [whole, whole, second];
        let first = (RINGS * AROUND) as usize;
        let of = |(v, p): (usize, &Vec3)| if v < first { &whole } else { &second }.transform_point3(*p);
        let mut positions: Vec<Vec3> = limbs.rest.iter().enumerate().map(of).collect();
        let mut scratch = LimbScratch::default();
        limbs.contacts.separate(&pose, None, &limbs.adjacency, &mut positions, &mut scratch);
        for (moved, parted) in positions.iter().zip(&parted) {
            assert!(moved.distance(whole.transform_point3(*parted)) < 0.02);
        }
    }

    /// A slab of quads of side 1 whose top is z = 0, and over it, between two rows of its vertices, a limb of
    /// radius 0.8 of much smaller ones that just touches it.
    #[test]
    fn a_thin_limb_does_not_sink_between_the_vertices_of_a_coarse_one() {
        const ROW: u32 = 9;
        let grid = (0..2u32).flat_map(|k| (0..ROW * ROW).map(move |n| (n % ROW, n / ROW, k)));
        let slab =
            grid.map(|(i, j, k)| DVec3::new(f64::from(i) - 4.0, f64::from(j) - 4.0, -2.0 * f64::from(k)));
        let limb = (0..RINGS * AROUND).map(|n| {
            let angle = std::f64::consts::TAU * f64::from(n % AROUND) / f64::from(AROUND);
            let x = 0.15 * f64::from(n / AROUND) - 1.8;
            DVec3::new(x, 0.5 + 0.8 * angle.sin(), 0.8 - 0.8 * angle.cos())
        });
        let first = 2 * ROW * ROW;
        let vertices: Vec<DVec3> = slab.chain(limb).collect();
        let mut triangles: Vec<[u32; 3]> = Vec::new();
        let mut quad = |[a, b, c, d]: [u32; 4]| triangles.extend([[a, b, c], [a, c, d]]);
        for (i, j) in (0..ROW - 1).flat_map(|j| (0..ROW - 1).map(move |i| (i, j))) {
            let (a, b) = (j * ROW + i, ROW * ROW + j * ROW + i);
            quad([a, a + 1, a + ROW + 1, a + ROW]);
            quad([b, b + ROW, b + ROW + 1, b + 1]);
        }
        for (ring, k) in (0..RINGS - 1).flat_map(|ring| (0..AROUND).map(move |k| (ring, k))) {
            let at = |ring: u32, k: u32| first + ring * AROUND + k % AROUND;
            quad([at(ring, k), at(ring, k + 1), at(ring + 1, k + 1), at(ring + 1, k)]);
        }
        let mesh = TriangleMesh::new(vertices, triangles).unwrap();
        let heads = [DVec3::Z * -9.0, DVec3::new(-4.0, 0.0, -1.0), DVec3::new(-2.0, 0.5, 0.8)];
        let tails = [DVec3::Z * -8.0, DVec3::new(4.0, 0.0, -1.0), DVec3::new(2.0, 0.5, 0.8)];
        let skeleton = Skeleton::new(heads.to_vec(), tails.to_vec(), &[-1, 0, 0], None).unwrap();
        let entries =
            (0..mesh.vertex_count()).map(|v| (v as i64, if v < first as usize { 1 } else { 2 }, 1.0));
        let weights = SkinWeights::from_triplets(entries, mesh.vertex_count(), 3).unwrap();
        let topology = mesh.topology();
        let adjacency = Adjacency::new(mesh.vertex_count(), &topology);
        let normals: Vec<DVec3> = mesh.vertex_normals().to_vec();
        let contacts = LimbContacts::new(&mesh, &normals, &adjacency, &skeleton, &weights);
        for sunk in [0.1f32, 0.2, 0.3] {
            let down = Affine3A::from_translation(-Vec3::Z * sunk);
            let mut positions: Vec<Vec3> = mesh.vertices().iter().map(|v| v.as_vec3()).collect();
            positions[first as usize..].iter_mut().for_each(|p| *p = down.transform_point3(*p));
            let pose = [Affine3A::IDENTITY, Affine3A::IDENTITY, down];
            contacts.separate(&pose, None, &adjacency, &mut positions, &mut LimbScratch::default());
            let (slab, limb) = positions.split_at(first as usize);
            let lowest = limb.iter().filter(|p| p.x.abs() < 1.0).map(|p| p.z).fold(f32::INFINITY, f32::min);
            let highest =
                slab.iter().filter(|p| p.x.abs() < 1.0).map(|p| p.z).fold(f32::NEG_INFINITY, f32::max);
            let left = highest - lowest;
            assert!(left < 0.3 * sunk, "{sunk}: {left}");
        }
    }
}
