//! The rim of a dent: vertices around those that a contact pushed go along a little, so that the skin
//! bends where the contact ends instead of creasing.

use glam::Vec3;

use crate::mesh::Adjacency;

/// Rings of vertices that go along.
const RINGS: usize = 6;
/// How far each round takes a vertex to the mean of its neighbours.
const RATE: f32 = 0.7;

/// Shifts of vertices, and which have one.
#[derive(Debug, Clone, Default)]
pub(super) struct LimbRim {
    shifts: Vec<Vec3>,
    is_listed: Vec<bool>,
    listed: Vec<u32>,
    next: Vec<(u32, Vec3)>,
}

impl LimbRim {
    pub(super) fn clear(&mut self) {
        for &vertex in &self.listed {
            self.shifts[vertex as usize] = Vec3::ZERO;
            self.is_listed[vertex as usize] = false;
        }
        self.listed.clear();
    }

    /// Adds to the shift of one of `count` vertices.
    pub(super) fn add(&mut self, vertex: u32, shift: Vec3, count: usize) {
        if self.shifts.len() != count {
            self.shifts.resize(count, Vec3::ZERO);
            self.is_listed.resize(count, false);
        }
        self.list(vertex);
        self.shifts[vertex as usize] += shift;
    }

    fn list(&mut self, vertex: u32) {
        if !std::mem::replace(&mut self.is_listed[vertex as usize], true) {
            self.listed.push(vertex);
        }
    }
}

/// Lets the neighbours of shifted vertices go along, by less than the mean of their own neighbours; no
/// shift gets smaller. Adds what that gives to the positions.
pub(super) fn soften_rim(rim: &mut LimbRim, adjacency: &Adjacency, positions: &mut [Vec3]) {
    let pushed = rim.listed.len();
    let before: Vec<Vec3> = rim.listed.iter().map(|&v| rim.shifts[v as usize]).collect();
    let mut done = 0;
    for _ in 0..RINGS {
        let end = rim.listed.len();
        for place in done..end {
            for &neighbour in adjacency.neighbours(rim.listed[place] as usize) {
                rim.list(neighbour);
            }
        }
        done = end;
        let LimbRim { shifts, listed, next, .. } = &mut *rim;
        next.clear();
        next.extend(listed.iter().map(|&vertex| {
            let own = shifts[vertex as usize];
            let ring = adjacency.neighbours(vertex as usize);
            let sum: Vec3 = ring.iter().map(|&n| shifts[n as usize]).sum();
            let mean = sum / ring.len().max(1) as f32;
            let length = mean.length();
            // Nothing where the vertex is shifted as far already, so that a dent keeps its depth.
            let rate = if length > 0.0 { RATE * (1.0 - own.length() / length).max(0.0) } else { 0.0 };
            (vertex, own.lerp(mean, rate))
        }));
        next.iter().for_each(|&(vertex, shift)| shifts[vertex as usize] = shift);
    }
    for (place, &vertex) in rim.listed.iter().enumerate() {
        let before = if place < pushed { before[place] } else { Vec3::ZERO };
        positions[vertex as usize] += rim.shifts[vertex as usize] - before;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriangleMesh;
    use glam::DVec3;

    #[test]
    fn the_rim_goes_along_and_the_dent_keeps_its_depth() {
        let vertices = (0..21).flat_map(|i| [0.0, 1.0].map(|y| DVec3::new(f64::from(i), y, 0.0)));
        let triangles = (0..20u32).flat_map(|i| {
            let a = 2 * i;
            [[a, a + 2, a + 1], [a + 2, a + 3, a + 1]]
        });
        let mesh = TriangleMesh::new(vertices.collect(), triangles.collect()).unwrap();
        let adjacency = Adjacency::new(mesh.vertex_count(), &mesh.topology());
        let mut rim = LimbRim::default();
        for _ in 0..2 {
            rim.clear();
            let mut positions = vec![Vec3::ZERO; 42];
            for vertex in 18..24 {
                positions[vertex as usize] -= Vec3::Z;
                rim.add(vertex, -Vec3::Z, 42);
            }
            soften_rim(&mut rim, &adjacency, &mut positions);
            assert!((18..24).all(|v| positions[v] == -Vec3::Z));
            assert!(positions[16].z < -0.2 && positions[16].z > -0.9);
            assert!((0..16).step_by(2).all(|v| positions[v].z >= positions[v + 2].z), "{positions:?}");
            assert_eq!((positions[0], positions[41]), (Vec3::ZERO, Vec3::ZERO));
        }
    }
}
