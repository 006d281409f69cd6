//! The last word on stretch (eq. 6): edges of the surface that its correction has made too long, longer than
//! plain skinning has them, give way. Where none is, nothing moves; all of it varies continuously with the pose.

use glam::{Affine3A, Vec3};
use rayon::prelude::*;

use super::fold_grid::{larger, smaller};
use crate::mesh::{Adjacency, TriangleMesh};
use crate::skinning::SkinWeights;

/// Length of an edge, in rest lengths, up to which it may be longer than plain skinning has it, as long as that
/// has one as long somewhere.
const MOST: f32 = 1.75;
/// Share of the mean length of the edges around it that an edge counts for in rest, at least: the stretch of one that
/// is next to nothing says nothing.
const LEAST: f32 = 0.2;
/// By how much the longest edge is to be shorter than that of plain skinning.
const SHORTER: f32 = 0.98;
/// Length of an edge, in rest lengths, from which on it is drawn out.
const DRAWN_OUT: f32 = 1.1;
/// Share of what it is too long that an edge asks of each of its ends: less than half, so that a row of edges comes
/// to rest.
const ASKED: f32 = 0.4;
/// Rounds.
const ROUNDS: usize = 10;
/// Bones whose scales differ by less have one.
const UNSCALED: f32 = 1e-5;
/// Vertices in one task.
const CHUNK: usize = 512;

/// What the limit keeps of the rest pose.
#[derive(Debug, Clone, Default)]
pub(super) struct SurfaceStretch {
    /// Edges of the moved vertices (M), each at one of its ends: the other end and one over the length that counts
    /// for that in rest.
    edges: Vec<(u32, f32)>,
    /// First edge of each moved vertex, and the end.
    starts: Vec<u32>,
    /// The heaviest bone of each vertex (V), which says how large the pose has scaled it.
    bones: Vec<u32>,
    /// Length that the edges of each vertex (V) count for in rest, at least.
    least: Vec<f32>,
}

/// Buffers of a pose.
#[derive(Debug, Clone, Default)]
pub(super) struct StretchScratch {
    /// One over how far each bone scales (B).
    per_scale: Vec<f32>,
    shortening: Shortening,
}

/// Buffers of the rounds.
#[derive(Debug, Clone, Default)]
struct Shortening {
    /// Vertices that a round looks at, each with the end of its edges in `spokes`.
    listed: Vec<(u32, u32)>,
    /// Other ends of their edges, and how long these may be.
    spokes: Vec<(u32, f32)>,
    /// Whether a vertex is listed (V).
    is_listed: Vec<bool>,
    steps: Vec<Vec3>,
}

/// A surface in a pose.
pub(super) struct PosedSurface<'a> {
    pub transforms: &'a [Affine3A],
    /// Rest positions (V), and those of plain skinning (V).
    pub rest: &'a [Vec3],
    pub plain: &'a [Vec3],
    pub adjacency: &'a Adjacency,
    /// The vertices that corrections move (M), and their corrections.
    pub moved: &'a [u32],
    pub corrections: &'a [Vec3],
}

/// The longest edges by plain skinning and now, as squares of rest lengths.
type Longest = [f32; 2];

/// What a look at the edges is for, in rest lengths.
#[derive(Debug, Clone, Copy)]
struct Looks {
    /// Longer edges are listed.
    limit: f32,
    /// Length from which on it counts how long plain skinning has an edge.
    plain_from: f32,
}

impl SurfaceStretch {
    /// For a surface of which corrections move the vertices `moved` (M).
    pub(super) fn new(
        mesh: &TriangleMesh,
        adjacency: &Adjacency,
        weights: &SkinWeights,
        moved: &[u32],
    ) -> Self {
        let mut is_moved = vec![false; mesh.vertex_count()];
        moved.iter().for_each(|&v| is_moved[v as usize] = true);
        let (mut edges, mut starts) = (Vec::new(), vec![0]);
        let distance =
            |a: u32, b: u32| mesh.vertices()[a as usize].distance(mesh.vertices()[b as usize]) as f32;
        let least_of = |vertex: usize| {
            let others = adjacency.neighbours(vertex);
            let sum: f32 = others.iter().map(|&other| distance(vertex as u32, other)).sum();
            LEAST * sum / others.len().max(1) as f32
        };
        let least: Vec<f32> = (0..mesh.vertex_count()).map(least_of).collect();
        for &vertex in moved {
            let others = adjacency.neighbours(vertex as usize).iter().copied();
            let own = others.filter(|&other| other > vertex || !is_moved[other as usize]);
            let per_rest = |other: u32| {
                distance(vertex, other).max(least[vertex as usize].min(least[other as usize])).recip()
            };
            let edge = own.map(|other| (other, per_rest(other)));
            edges.extend(edge.filter(|(_, per_rest)| per_rest.is_finite()));
            starts.push(edges.len() as u32);
        }
        let heaviest = |vertex: usize| weights.heaviest(vertex).map_or(0, |(bone, _)| bone);
        Self { edges, starts, bones: (0..mesh.vertex_count()).map(heaviest).collect(), least }
    }

    /// Shortens what has become too long among the edges of vertices that have been corrected; `positions` are the
    /// whole surface.
    pub(super) fn limit(
        &self,
        surface: &PosedSurface<'_>,
        positions: &mut [Vec3],
        scratch: &mut StretchScratch,
    ) {
        let StretchScratch { per_scale, shortening } = scratch;
        per_scale.clear();
        per_scale.extend(surface.transforms.iter().map(|t| t.matrix3.determinant().abs().cbrt().recip()));
        let first = per_scale.first().copied().unwrap_or(1.0);
        let has_one_scale = per_scale.iter().all(|other| (other - first).abs() <= UNSCALED * first);
        let by_bone = |vertex: u32| per_scale[self.bones[vertex as usize] as usize];
        let per_scale = |vertex: u32| if has_one_scale { first } else { by_bone(vertex) };
        let chunks = 0..surface.moved.len().div_ceil(CHUNK);
        let look = |chunk, looks: Looks| match has_one_scale {
            true => self.look(surface, positions, chunk, looks, &|_| first),
            false => self.look(surface, positions, chunk, looks, &by_bone),
        };
        let look_everywhere = |looks: Looks| {
            let found: Vec<(Longest, Vec<[u32; 2]>)> =
                chunks.clone().into_par_iter().map(|chunk| look(chunk, looks)).collect();
            let [plain, own] =
                [0, 1].map(|k| found.iter().map(|found| found.0[k]).fold(0.0, f32::max).sqrt());
            (MOST.min(SHORTER * plain), own, found)
        };
        // What plain skinning has where edges are long now is mostly enough to see that nothing is to be done.
        let (mut limit, own, mut found) = look_everywhere(Looks { limit: MOST, plain_from: DRAWN_OUT });
        if own <= limit {
            return;
        }
        if limit < MOST {
            (limit, _, found) = look_everywhere(Looks { limit: MOST, plain_from: 0.0 });
            if own <= limit {
                return;
            }
        }
        let long: Vec<[u32; 2]> = match limit < MOST {
            true => chunks.flat_map(|chunk| look(chunk, Looks { limit, plain_from: 0.0 }).1).collect(),
            false => found.into_iter().flat_map(|(_, long)| long).collect(),
        };
        let allowed = |a: u32, b: u32| {
            let [plain, rest] = [surface.plain, surface.rest].map(|p| p[a as usize].distance(p[b as usize]));
            let rest = rest.max(self.least[a as usize].min(self.least[b as usize]));
            plain.max(limit * rest / per_scale(a).min(per_scale(b)))
        };
        shortening.shorten(&long, surface.adjacency, allowed, positions);
    }

    /// The longest edges of some vertices, and those that are longer than `looks.limit` and plain skinning allow.
    fn look(
        &self,
        surface: &PosedSurface<'_>,
        positions: &[Vec3],
        chunk: usize,
        looks: Looks,
        per_scale: &impl Fn(u32) -> f32,
    ) -> (Longest, Vec<[u32; 2]>) {
        let PosedSurface { moved, corrections, .. } = *surface;
        let enough = (MOST / SHORTER).powi(2);
        let [limit, plain_from] = [looks.limit, looks.plain_from].map(|length| length * length);
        let (mut longest, mut long) = ([0.0f32; 2], Vec::new());
        let places = chunk * CHUNK..moved.len().min((chunk + 1) * CHUNK);
        // The rim of what is corrected has next to no correction: an edge may count from its other end alone.
        for place in places.filter(|&place| corrections[place] != Vec3::ZERO) {
            let vertex = moved[place];
            let [plain, own] = [surface.plain, positions].map(|p| p[vertex as usize]);
            let scale = per_scale(vertex);
            let edges = self.starts[place] as usize..self.starts[place + 1] as usize;
            for &(other, per_rest) in &self.edges[edges] {
                let per_rest = (per_rest * smaller(scale, per_scale(other))).powi(2);
                let own = per_rest * own.distance_squared(positions[other as usize]);
                longest[1] = larger(longest[1], own);
                // Beyond enough it does not matter how long the longest is.
                if own > limit || (own >= plain_from && longest[0] < enough) {
                    let plain = per_rest * plain.distance_squared(surface.plain[other as usize]);
                    longest[0] = larger(longest[0], plain);
                    if own > limit && own > plain {
                        long.push([vertex, other]);
                    }
                }
            }
        }
        (longest, long)
    }
}

impl Shortening {
    /// In each round every vertex goes where its edges ask for, by the mean of that, the longest before all. Begins
    /// with the `long` edges and lists others as they come to be too long.
    fn shorten(
        &mut self,
        long: &[[u32; 2]],
        adjacency: &Adjacency,
        allowed: impl Fn(u32, u32) -> f32,
        positions: &mut [Vec3],
    ) {
        let Self { listed, spokes, is_listed, steps } = self;
        listed.clear();
        spokes.clear();
        is_listed.resize(positions.len(), false);
        let list = |v: u32, listed: &mut Vec<(u32, u32)>, spokes: &mut Vec<_>, is_listed: &mut [bool]| {
            if !std::mem::replace(&mut is_listed[v as usize], true) {
                spokes
                    .extend(adjacency.neighbours(v as usize).iter().map(|&other| (other, allowed(v, other))));
                listed.push((v, spokes.len() as u32));
            }
        };
        long.iter().flatten().for_each(|&v| list(v, listed, spokes, is_listed));
        for _ in 0..ROUNDS {
            steps.clear();
            let mut first = 0;
            steps.extend(listed.iter().map(|&(vertex, end)| {
                let spokes = &spokes[std::mem::replace(&mut first, end as usize)..end as usize];
                step(positions[vertex as usize], spokes, positions)
            }));
            for (&(vertex, _), step) in listed.iter().zip(&*steps) {
                positions[vertex as usize] += *step;
            }
            let mut first = 0;
            for place in 0..steps.len() {
                let (vertex, end) = listed[place];
                for spoke in std::mem::replace(&mut first, end as usize)..end as usize {
                    let (other, allowed) = spokes[spoke];
                    let squared = positions[vertex as usize].distance_squared(positions[other as usize]);
                    if squared > allowed * allowed {
                        list(other, listed, spokes, is_listed);
                    }
                }
            }
        }
        listed.iter().for_each(|&(vertex, _)| is_listed[vertex as usize] = false);
    }
}

/// Where the edges of a vertex, as other ends and lengths that they may have, ask it to go.
fn step(own: Vec3, spokes: &[(u32, f32)], positions: &[Vec3]) -> Vec3 {
    let (mut sum, mut total) = (Vec3::ZERO, 0.0);
    for &(other, allowed) in spokes {
        let way = positions[other as usize] - own;
        let squared = way.length_squared();
        if squared > allowed * allowed {
            let length = squared.sqrt();
            let excess = length - allowed;
            sum += way * (ASKED * excess * excess / length);
            total += excess;
        }
    }
    if total > 0.0 { sum / total } else { Vec3::ZERO }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    const SIDE: u32 = 15;
    const MIDDLE: u32 = SIDE * (SIDE / 2) + SIDE / 2;

    /// A sheet of quads of side 1, of which plain skinning has stretched a corner to 2.5 times its length.
    struct Sheet {
        rest: Vec<Vec3>,
        plain: Vec<Vec3>,
        adjacency: Adjacency,
        stretch: SurfaceStretch,
        edges: Vec<[u32; 2]>,
    }

    impl Sheet {
        fn new(corner: f32) -> Self {
            Self::with_gap(corner, 1.0)
        }

        /// One with such a gap between the middle and its neighbour.
        fn with_gap(corner: f32, gap: f64) -> Self {
            let at = |i: u32| DVec3::new(f64::from(i % SIDE), f64::from(i / SIDE), 0.0);
            let mut vertices: Vec<DVec3> = (0..SIDE * SIDE).map(at).collect();
            vertices[MIDDLE as usize].x += 1.0 - gap;
            let quads = (0..SIDE - 1).flat_map(|j| (0..SIDE - 1).map(move |i| j * SIDE + i));
            let triangles = quads.flat_map(|a| [[a, a + 1, a + SIDE], [a + 1, a + SIDE + 1, a + SIDE]]);
            let mesh = TriangleMesh::new(vertices, triangles.collect()).unwrap();
            let topology = mesh.topology();
            let adjacency = Adjacency::new(mesh.vertex_count(), &topology);
            let entries = (0..mesh.vertex_count() as i64).map(|v| (v, 0, 1.0));
            let weights = SkinWeights::from_triplets(entries, mesh.vertex_count(), 1).unwrap();
            let moved: Vec<u32> = (0..SIDE * SIDE).collect();
            let stretch = SurfaceStretch::new(&mesh, &adjacency, &weights, &moved);
            let rest: Vec<Vec3> = mesh.vertices().iter().map(|v| v.as_vec3()).collect();
            let mut plain = rest.clone();
            plain[0].x -= corner;
            let edges = topology.edges().iter().map(|&(edge, _)| edge).collect();
            Self { rest, plain, adjacency, stretch, edges }
        }

        /// The surface after the limit where the middle has been drawn out of it, all of it scaled.
        fn limited(&self, drawn: Vec3, scale: f32) -> [Vec<Vec3>; 2] {
            let plain: Vec<Vec3> = self.plain.iter().map(|&p| p * scale).collect();
            let mut before = plain.clone();
            before[MIDDLE as usize] += drawn * scale;
            let surface = PosedSurface {
                transforms: &[Affine3A::from_scale(Vec3::splat(scale))],
                rest: &self.rest,
                plain: &plain,
                adjacency: &self.adjacency,
                moved: &(0..SIDE * SIDE).collect::<Vec<u32>>(),
                // All count as corrected, as in the middle of a joint.
                corrections: &vec![Vec3::Z; self.rest.len()],
            };
            let mut after = before.clone();
            self.stretch.limit(&surface, &mut after, &mut StretchScratch::default());
            [before, after]
        }

        fn longest(&self, positions: &[Vec3]) -> f32 {
            let length = |p: &[Vec3], [a, b]: [u32; 2]| p[a as usize].distance(p[b as usize]);
            let corner = |edge: &&[u32; 2]| !edge.contains(&0);
            let ratios =
                self.edges.iter().filter(corner).map(|&e| length(positions, e) / length(&self.rest, e));
            ratios.fold(0.0, f32::max)
        }
    }

    #[test]
    fn what_is_drawn_out_comes_back_and_its_neighbours_go_along() {
        let sheet = Sheet::new(1.5);
        let [before, after] = sheet.limited(Vec3::new(0.5, 0.2, 3.0), 1.0);
        assert!(sheet.longest(&before) > 2.9);
        assert!(sheet.longest(&after) < 1.05 * MOST, "{}", sheet.longest(&after));
        assert!(after[MIDDLE as usize].z > 0.8 && after[MIDDLE as usize + 1].z > 0.1);
        assert_eq!(after[..SIDE as usize], before[..SIDE as usize], "far away");
    }

    #[test]
    fn what_is_no_longer_than_plain_skinning_has_it_stays_to_the_last_bit() {
        let [before, after] = Sheet::new(1.5).limited(Vec3::Z * 1.2, 1.0);
        assert_eq!(before, after, "1.56 rest lengths");
        // Without anything as long, no edge may be so.
        let even = Sheet::new(0.2);
        let [before, after] = even.limited(Vec3::Z * 1.2, 1.0);
        assert!(even.longest(&before) > 1.5 && even.longest(&after) < 1.25, "{}", even.longest(&after));
    }

    #[test]
    fn an_edge_that_is_next_to_nothing_says_nothing() {
        let sheet = Sheet::with_gap(1.5, 1e-3);
        let [before, after] = sheet.limited(Vec3::Z * 0.2, 1.0);
        assert!(sheet.longest(&before) > 100.0);
        assert_eq!(before, after);
        let [before, after] = sheet.limited(Vec3::Z, 1.0);
        assert_ne!(before, after, "beyond those around it");
    }

    #[test]
    fn the_limit_sets_in_without_a_jump_and_scales_with_the_body() {
        let sheet = Sheet::new(1.5);
        let mut last: Option<Vec<Vec3>> = None;
        for step in 0..=100 {
            let drawn = Vec3::new(0.3, 0.1, 0.04 * step as f32);
            let [_, after] = sheet.limited(drawn, 1.0);
            let [_, scaled] = sheet.limited(drawn, 8.0);
            let alike = after.iter().zip(&scaled).all(|(a, b)| (*a * 8.0).distance(*b) < 1e-3);
            assert!(alike, "{step}");
            if let Some(last) = last.replace(after) {
                let most = last.iter().zip(&scaled).map(|(a, b)| a.distance(*b / 8.0)).fold(0.0, f32::max);
                assert!(most < 0.1, "{step}: {most}");
            }
        }
    }
}
