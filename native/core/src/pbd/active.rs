//! The part of an island that a pose concerns: what is between bones that have moved relative to each
//! other, what may come into contact, and some rings of cells around it. The rest of the island is carried
//! rigidly by its bones and is not solved.

use glam::Affine3A;

use super::island::Island;
use super::parts::{MIXED, Parts, STILL_PART};

/// Rings of tetrahedra that are solved around what is deformed.
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

/// The concerned particles, and the inverse masses that hold all others.
#[derive(Debug, Clone, Default)]
pub(super) struct ActivePart {
    /// Inverse masses (P), 0 for particles that are not concerned.
    pub inverse_masses: Vec<f32>,
    /// True for particles that are free (P).
    pub free: Vec<bool>,
    concerned: Vec<bool>,
    /// Parts of the bones, and that of each particle (P).
    parts: Parts,
    part_of: Vec<u32>,
    /// Concerned particles, ring after ring.
    rings: Vec<u32>,
    /// Part that carries each particle rigidly (P), [`MIXED`] for those that are concerned.
    carriers: Vec<u32>,
}

impl ActivePart {
    /// Begins with the particles between bones that have moved relative to each other; what one rigid
    /// part carries keeps its shape. `transforms` are relative to the island's frame.
    pub(super) fn carry(&mut self, island: &Island, transforms: &[Affine3A]) {
        let Self { concerned, parts, part_of, rings, .. } = self;
        parts.find(island.dependencies(), transforms, island.extent);
        concerned.clear();
        concerned.resize(island.rest.len(), false);
        rings.clear();
        part_of.clear();
        part_of.extend((0..island.rest.len()).map(|particle| parts.of(island.weights.row(particle).0)));
        for particle in 0..island.rest.len() as u32 {
            if self.part_of[particle as usize] == MIXED {
                self.add(particle);
            }
        }
        for edge in &island.edges {
            let [a, b] = edge.map(|particle| self.part_of[particle as usize]);
            if a != b && a != MIXED && b != MIXED {
                edge.iter().for_each(|&particle| self.add(particle));
            }
        }
    }

    /// Adds a particle.
    pub(super) fn add(&mut self, particle: u32) {
        if !std::mem::replace(&mut self.concerned[particle as usize], true) {
            self.rings.push(particle);
        }
    }

    /// True for a particle that is not where it was in rest.
    pub(super) fn is_carried(&self, particle: usize) -> bool {
        self.part_of[particle] != STILL_PART
    }

    /// False for a point of the surface that is carried rigidly, as are the corners of its tetrahedron;
    /// `bones` are those of its vertex.
    pub(super) fn concerns(&self, corners: &[u32; 4], bones: &[u32]) -> bool {
        let part = self.parts.of(bones);
        part == MIXED || corners.iter().any(|&corner| self.carriers[corner as usize] != part)
    }

    /// Adds the rings around all that is there, and frees it.
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
        let Self { part_of, concerned, carriers, .. } = self;
        carriers.clear();
        let parts = part_of.iter().zip(&*concerned);
        carriers.extend(parts.map(|(&part, &concerned)| if concerned { MIXED } else { part }));
        self.inverse_masses.clear();
        let masses = island.inverse_masses.iter().zip(&self.concerned);
        self.inverse_masses.extend(masses.map(|(&mass, &concerned)| if concerned { mass } else { 0.0 }));
        self.free.clear();
        self.free.extend(self.inverse_masses.iter().map(|&mass| mass > 0.0));
    }
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
