//! The part of an island that a pose concerns: what moved bones carry, what may come into contact,
//! and some rings of cells around it. The rest of the island is where it was and is not solved.

use glam::{Affine3A, Mat3A, Vec3A};

use super::island::{Island, STILL};

/// Rings of tetrahedra that are solved around what has moved.
const RINGS: usize = 4;

/// Particles that share a tetrahedron with each particle.
#[derive(Debug, Clone, Default)]
pub(super) struct Neighbours {
    starts: Vec<u32>,
    particles: Vec<u32>,
}

impl Neighbours {
    pub(super) fn new(particle_count: usize, tetrahedra: &[[u32; 4]]) -> Self {
        let corners = |t: &[u32; 4]| {
            let t = *t;
            (0..4).flat_map(move |i| (0..4).filter(move |&j| j != i).map(move |j| (t[i], t[j])))
        };
        let mut pairs: Vec<(u32, u32)> = tetrahedra.iter().flat_map(corners).collect();
        pairs.sort_unstable();
        pairs.dedup();
        let mut starts = vec![0; particle_count + 1];
        pairs.iter().for_each(|&(particle, _)| starts[particle as usize + 1] += 1);
        (0..particle_count).for_each(|i| starts[i + 1] += starts[i]);
        Self { starts, particles: pairs.into_iter().map(|(_, neighbour)| neighbour).collect() }
    }

    fn of(&self, particle: u32) -> &[u32] {
        let range = self.starts[particle as usize]..self.starts[particle as usize + 1];
        &self.particles[range.start as usize..range.end as usize]
    }
}

/// Constraints of the concerned part, and the inverse masses that hold everything else.
#[derive(Debug, Clone, Default)]
pub(super) struct ActivePart {
    /// Inverse masses (P), 0 for particles that are not concerned.
    pub inverse_masses: Vec<f32>,
    /// Batches of edges with a free end.
    pub edges: Vec<u32>,
    /// Batches of tetrahedra with a free corner.
    pub tetrahedra: Vec<u32>,
    free: Vec<bool>,
    concerned: Vec<bool>,
    /// Bones (B) that have moved relative to the island's frame.
    moved: Vec<bool>,
    /// Concerned particles, ring after ring.
    rings: Vec<u32>,
}

impl ActivePart {
    /// Begins with the particles that moved bones carry; `transforms` are relative to the island's
    /// frame.
    pub(super) fn carry(&mut self, island: &Island, transforms: &[Affine3A]) {
        self.moved.clear();
        self.moved.extend(transforms.iter().map(|t| !is_still(t, island.extent)));
        self.concerned.clear();
        self.concerned.resize(island.rest.len(), false);
        self.rings.clear();
        for particle in 0..island.rest.len() as u32 {
            if self.has_moved(island.weights.row(particle as usize).0) {
                self.add(particle);
            }
        }
    }

    /// Adds a particle.
    pub(super) fn add(&mut self, particle: u32) {
        if !std::mem::replace(&mut self.concerned[particle as usize], true) {
            self.rings.push(particle);
        }
    }

    /// True for a particle that has been added.
    pub(super) fn is_concerned(&self, particle: u32) -> bool {
        self.concerned[particle as usize]
    }

    /// True where one of the bones has moved.
    pub(super) fn has_moved(&self, bones: &[u32]) -> bool {
        bones.iter().any(|&bone| self.moved[bone as usize])
    }

    /// Adds the rings around all that is there, and finds the constraints.
    pub(super) fn complete(&mut self, island: &Island) {
        let mut done = 0;
        for _ in 0..RINGS {
            let end = self.rings.len();
            for place in done..end {
                let particle = self.rings[place];
                for &neighbour in island.neighbours.of(particle) {
                    self.add(neighbour);
                }
            }
            done = end;
        }
        self.inverse_masses.clear();
        let masses = island.inverse_masses.iter().zip(&self.concerned);
        self.inverse_masses.extend(masses.map(|(&mass, &concerned)| if concerned { mass } else { 0.0 }));
        self.free.clear();
        self.free.extend(self.inverse_masses.iter().map(|&mass| mass > 0.0).chain([false]));
        island.edge_batches.select(&self.free, &mut self.edges);
        island.tetrahedron_batches.select(&self.free, &mut self.tetrahedra);
    }
}

/// True for a transform that differs from the identity by rounding alone.
pub(super) fn is_still(transform: &Affine3A, extent: f32) -> bool {
    transform.matrix3.abs_diff_eq(Mat3A::IDENTITY, STILL)
        && transform.translation.abs_diff_eq(Vec3A::ZERO, STILL * extent)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_share_a_tetrahedron() {
        let neighbours = Neighbours::new(6, &[[0, 1, 2, 3], [1, 2, 3, 4]]);
        assert_eq!(neighbours.of(0), [1, 2, 3]);
        assert_eq!(neighbours.of(2), [0, 1, 3, 4]);
        assert!(neighbours.of(5).is_empty());
    }
}
