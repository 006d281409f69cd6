//! Creases: where contact has pressed the surface together, at the end of a fold, skin bunches up and passes
//! through itself within a few triangles. Vertices around which it is bent far more than in rest go towards the
//! middle of their neighbours (eq. 15 with equal coordinates, as those of the rest pose mean nothing in a knot).
//! Continuous in the positions; where nothing is bent, nothing moves.

use glam::Vec3;
use rayon::prelude::*;

use super::fold_field::smoothstep;
use crate::mesh::{Adjacency, TriangleMesh};

/// Flatness, as a share of that in rest, from which on the surface around a vertex is no crease, and up to which it
/// is one for sure: a bend of 52° and of 106°.
const CREASED: [f32; 2] = [0.9, 0.6];
/// Share that the neighbours of a crease take in it.
const BESIDE: f32 = 0.5;
/// How far each round takes a vertex to the middle of its neighbours.
const RATE: f32 = 0.5;
/// Rounds.
const ROUNDS: usize = 10;
/// Vertices in one task.
const CHUNK: usize = 256;

/// The triangles around the moved vertices, and how flat they lie in rest.
#[derive(Debug, Clone, Default)]
pub(super) struct SurfaceCreases {
    /// The side across from a vertex of each triangle around it; of vertices on a border none.
    sides: Vec<[u32; 2]>,
    /// First side of each vertex (V), and the end.
    starts: Vec<u32>,
    /// One over the flatness of each vertex (V) in rest.
    per_rest: Vec<f32>,
}

/// Buffers of a pose.
#[derive(Debug, Clone, Default)]
pub(super) struct CreaseScratch {
    /// Those of the touched vertices that are in a crease.
    found: Vec<u32>,
    listed: Vec<u32>,
    is_listed: Vec<bool>,
    /// How far each listed vertex is in a crease, and the middle of its neighbours.
    own: Vec<(f32, Vec3)>,
    /// How far each vertex (V) is in a crease; 0 for all between calls.
    shares: Vec<f32>,
}

impl SurfaceCreases {
    /// For a surface of which corrections move the vertices `moved`.
    pub(super) fn new(mesh: &TriangleMesh, adjacency: &Adjacency, moved: &[u32]) -> Self {
        let mut around = vec![Vec::new(); mesh.vertex_count()];
        let mut is_moved = vec![false; mesh.vertex_count()];
        moved.iter().for_each(|&vertex| is_moved[vertex as usize] = true);
        for &[a, b, c] in mesh.triangles() {
            for (vertex, side) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
                if is_moved[vertex as usize] {
                    around[vertex as usize].push(side);
                }
            }
        }
        let mut creases = Self { starts: vec![0], ..Self::default() };
        for (vertex, sides) in around.iter().enumerate() {
            // As many triangles as neighbours: the surface goes once around it.
            if sides.len() == adjacency.neighbours(vertex).len() {
                creases.sides.extend(sides);
            }
            creases.starts.push(creases.sides.len() as u32);
        }
        let rest: Vec<Vec3> = mesh.vertices().iter().map(|v| v.as_vec3()).collect();
        let per_rest = |v: u32| creases.look(v, &rest).map_or(0.0, |(flatness, _)| flatness.recip());
        let per_rest: Vec<f32> = (0..mesh.vertex_count() as u32).map(per_rest).collect();
        Self { per_rest, ..creases }
    }

    /// Opens the creases at and around the `touched` vertices.
    pub(super) fn open(
        &self,
        touched: &[u32],
        adjacency: &Adjacency,
        positions: &mut [Vec3],
        scratch: &mut CreaseScratch,
    ) {
        let CreaseScratch { found, listed, is_listed, own, shares } = scratch;
        is_listed.resize(positions.len(), false);
        shares.resize(positions.len(), 0.0);
        listed.clear();
        let list = |vertex: u32, listed: &mut Vec<u32>, is_listed: &mut [bool]| {
            if !std::mem::replace(&mut is_listed[vertex as usize], true) {
                listed.push(vertex);
            }
        };
        found.clear();
        let touched = touched.par_iter().with_min_len(CHUNK);
        found.par_extend(touched.filter(|&&vertex| self.creased(vertex, positions).0 > 0.0).copied());
        found.iter().for_each(|&vertex| list(vertex, listed, is_listed));
        for _ in 0..ROUNDS {
            own.clear();
            for place in 0..listed.len() {
                let vertex = listed[place];
                let (share, middle) = self.creased(vertex, positions);
                own.push((share, middle));
                shares[vertex as usize] = share;
                if share > 0.0 {
                    let beside = adjacency.neighbours(vertex as usize);
                    beside.iter().for_each(|&other| list(other, listed, is_listed));
                }
            }
            // What has just been listed has no share of its own, but one in its neighbours'.
            let new = listed[own.len()..].iter().map(|&vertex| (0.0, self.creased(vertex, positions).1));
            own.extend(new);
            for (&vertex, (share, middle)) in listed.iter().zip(&*own) {
                let beside = adjacency.neighbours(vertex as usize);
                let sum: f32 = beside.iter().map(|&other| shares[other as usize]).sum();
                let share = share.max(BESIDE * sum / beside.len().max(1) as f32);
                if share > 0.0 {
                    let position = &mut positions[vertex as usize];
                    *position = position.lerp(*middle, RATE * share);
                }
            }
        }
        for &vertex in &*listed {
            is_listed[vertex as usize] = false;
            shares[vertex as usize] = 0.0;
        }
    }

    /// How far a vertex is in a crease, from 0 to 1, and the middle of its neighbours.
    fn creased(&self, vertex: u32, positions: &[Vec3]) -> (f32, Vec3) {
        let per_rest = self.per_rest[vertex as usize];
        let Some((flatness, middle)) = self.look(vertex, positions).filter(|_| per_rest > 0.0) else {
            return (0.0, positions[vertex as usize]);
        };
        let [none, all] = CREASED;
        (smoothstep((none - flatness * per_rest) / (none - all)), middle)
    }

    /// Length of the vector area around a vertex over the area, and the middle of its neighbours; `None` on a border
    /// and where there is no area.
    fn look(&self, vertex: u32, positions: &[Vec3]) -> Option<(f32, Vec3)> {
        let sides =
            &self.sides[self.starts[vertex as usize] as usize..self.starts[vertex as usize + 1] as usize];
        let own = positions[vertex as usize];
        let (mut vector, mut area, mut sum) = (Vec3::ZERO, 0.0, Vec3::ZERO);
        for side in sides {
            let [a, b] = side.map(|v| positions[v as usize] - own);
            let cross = a.cross(b);
            vector += cross;
            area += cross.length();
            sum += a;
        }
        let flatness = vector.length() / area;
        (flatness.is_finite() && flatness > 0.0).then(|| (flatness, own + sum / sides.len() as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    const SIDE: u32 = 15;
    const MIDDLE: u32 = SIDE * (SIDE / 2) + SIDE / 2;

    /// A sheet of quads of side 1, with heights in rest.
    fn sheet(height: impl Fn(u32) -> f64) -> (TriangleMesh, Adjacency, SurfaceCreases) {
        let at = |i: u32| DVec3::new(f64::from(i % SIDE), f64::from(i / SIDE), height(i));
        let quads = (0..SIDE - 1).flat_map(|j| (0..SIDE - 1).map(move |i| j * SIDE + i));
        let triangles = quads.flat_map(|a| [[a, a + 1, a + SIDE], [a + 1, a + SIDE + 1, a + SIDE]]);
        let mesh = TriangleMesh::new((0..SIDE * SIDE).map(at).collect(), triangles.collect()).unwrap();
        let adjacency = Adjacency::new(mesh.vertex_count(), &mesh.topology());
        let moved: Vec<u32> = (0..SIDE * SIDE).collect();
        let creases = SurfaceCreases::new(&mesh, &adjacency, &moved);
        (mesh, adjacency, creases)
    }

    fn positions(mesh: &TriangleMesh) -> Vec<Vec3> {
        mesh.vertices().iter().map(|v| v.as_vec3()).collect()
    }

    #[test]
    fn walls_of_a_slit_cross_half_as_far_and_what_is_around_them_stays() {
        const SLIT: [(f32, f32); 5] = [(5.0, -0.5), (5.4, -1.5), (5.2, -2.2), (5.0, -1.5), (5.4, -0.5)];
        let (mesh, adjacency, creases) = sheet(|_| 0.0);
        let mut scratch = CreaseScratch::default();
        for scale in [1.0, 1e-3] {
            let mut slit = positions(&mesh);
            for position in &mut slit {
                let column = position.x as usize;
                match column {
                    0..5 => {}
                    5..10 => (position.x, position.z) = SLIT[column - 5],
                    _ => position.x -= 4.0,
                }
            }
            let slit: Vec<Vec3> = slit.iter().map(|p| *p * scale).collect();
            let touched: Vec<u32> = (0..SIDE * SIDE).filter(|v| (5..10).contains(&(v % SIDE))).collect();
            let mut opened = slit.clone();
            creases.open(&touched, &adjacency, &mut opened, &mut scratch);
            for line in 4..SIDE - 4 {
                let x = |p: &[Vec3], column: u32| p[(line * SIDE + column) as usize].x;
                let crossed = |p: &[Vec3]| (x(p, 6) - x(p, 8)) / scale;
                assert!(crossed(&slit) > 0.39 && crossed(&opened) < 0.2, "{line}: {}", crossed(&opened));
                let root = opened[(line * SIDE + 7) as usize].z / scale;
                assert!(root > -2.0, "{line}: {root}");
            }
            let far = |v: &usize| (13..SIDE).contains(&(*v as u32 % SIDE));
            assert!((0..slit.len()).filter(far).all(|v| opened[v] == slit[v]));
        }
    }

    #[test]
    fn what_is_not_bent_more_than_in_rest_stays_to_the_last_bit() {
        let mut scratch = CreaseScratch::default();
        let all: Vec<u32> = (0..SIDE * SIDE).collect();
        // A spike that rest has, and a gentle wave that it has not.
        let (mesh, adjacency, creases) = sheet(|i| if i == MIDDLE { 4.0 } else { 0.0 });
        let mut after = positions(&mesh);
        for position in &mut after {
            position.z += 0.4 * position.x.sin();
        }
        let before = after.clone();
        creases.open(&all, &adjacency, &mut after, &mut scratch);
        assert_eq!(before, after);
        // One that it has not goes, but nothing on the border does.
        let (mesh, adjacency, creases) = sheet(|_| 0.0);
        let mut after = positions(&mesh);
        for spike in [0, MIDDLE as usize] {
            after[spike].z = 4.0;
        }
        creases.open(&all, &adjacency, &mut after, &mut scratch);
        assert!(after[MIDDLE as usize].z < 1.5 && after[0].z == 4.0);
    }

    #[test]
    fn creases_open_without_a_jump() {
        let (mesh, adjacency, creases) = sheet(|_| 0.0);
        let mut scratch = CreaseScratch::default();
        let mut last: Option<Vec<Vec3>> = None;
        for step in 0..=200 {
            let mut now = positions(&mesh);
            now[MIDDLE as usize].z = 0.02 * step as f32;
            creases.open(&[MIDDLE], &adjacency, &mut now, &mut scratch);
            if let Some(last) = last.replace(now.clone()) {
                let jump = last.iter().zip(&now).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
                assert!(jump < 0.06, "{step}: {jump}");
            }
        }
    }
}
