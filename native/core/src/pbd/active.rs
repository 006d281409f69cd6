//! The part of an island that a pose concerns: what is between bones that have moved relative to each
//! other, what may come into contact, and some rings of cells around it. The rest of the island is carried
//! rigidly by its bones and is not solved.

use glam::Affine3A;

use super::island::Island;
use super::parts::{MIXED, Parts, STILL_PART};

/// Rings of tetrahedra that are solved around what is deformed.
const RINGS: u8 = 4;
const NOT_REACHED: u8 = RINGS + 1;

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

/// The concerned particles, and the inverse masses that hold all others. Kept from pose to pose for one island:
/// what depends on which bones move as one, and on which particles are concerned, is found anew only where that
/// has changed.
#[derive(Debug, Clone, Default)]
pub(super) struct ActivePart {
    /// Inverse masses (P), 0 for particles that are not concerned.
    pub inverse_masses: Vec<f32>,
    /// True for particles that are free (P).
    pub free: Vec<bool>,
    /// Parts of the bones, those that all below is for, and that of each particle (P).
    parts: Parts,
    known: Parts,
    part_of: Vec<u32>,
    /// Rings from what lies between bones that have moved relative to each other to each particle (P), at most
    /// [`NOT_REACHED`], and those from all that is deformed or may touch.
    rings_between: Vec<u8>,
    rings: Vec<u8>,
    /// What was concerned in the pose that all below is for (P).
    completed: Vec<bool>,
    reached: Vec<u32>,
    /// Part that carries each particle rigidly (P), [`MIXED`] for those that are concerned.
    carriers: Vec<u32>,
    /// How often anything of it has changed.
    pub changes: u64,
}

impl ActivePart {
    /// Begins with the particles between bones that have moved relative to each other, and the rings around them;
    /// what one rigid part carries keeps its shape. `transforms` are relative to the island's frame.
    pub(super) fn carry(&mut self, island: &Island, transforms: &[Affine3A]) {
        self.parts.find(island.dependencies(), transforms, island.extent);
        if self.parts.is_like(&self.known) {
            self.rings.clone_from(&self.rings_between);
            return;
        }
        self.known.clone_from(&self.parts);
        self.completed.clear();
        let Self { parts, part_of, rings, .. } = self;
        part_of.clear();
        part_of.extend((0..island.rest.len()).map(|particle| parts.of(island.weights.row(particle).0)));
        rings.clear();
        rings.resize(island.rest.len(), NOT_REACHED);
        let mixed =
            (0..).zip(&*self.part_of).filter(|(_, part)| **part == MIXED).map(|(particle, _)| particle);
        let is_cut = |edge: &&[u32; 2]| {
            let [a, b] = edge.map(|particle| self.part_of[particle as usize]);
            a != b && a != MIXED && b != MIXED
        };
        let cut = island.edges.iter().filter(is_cut).flatten().copied();
        reach(mixed.chain(cut), &island.neighbours, &mut self.rings, &mut self.reached);
        self.rings_between.clone_from(&self.rings);
    }

    /// Adds particles and the rings around them, and frees what is concerned. False where that is what it was.
    pub(super) fn complete(&mut self, island: &Island, added: impl Iterator<Item = u32>) -> bool {
        reach(added, &island.neighbours, &mut self.rings, &mut self.reached);
        let concerned = self.rings.iter().map(|&rings| rings < NOT_REACHED);
        if concerned.clone().eq(self.completed.iter().copied()) {
            return false;
        }
        self.completed.clear();
        self.completed.extend(concerned);
        self.changes += 1;
        let Self { part_of, completed, carriers, inverse_masses, free, .. } = self;
        carriers.clear();
        let parts = part_of.iter().zip(&*completed);
        carriers.extend(parts.map(|(&part, &concerned)| if concerned { MIXED } else { part }));
        inverse_masses.clear();
        let masses = island.inverse_masses.iter().zip(&*completed);
        inverse_masses.extend(masses.map(|(&mass, &concerned)| if concerned { mass } else { 0.0 }));
        free.clear();
        free.extend(inverse_masses.iter().map(|&mass| mass > 0.0));
        true
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
}

/// Lowers the `rings` (P) to those from some particles where these are nearer; `reached` is a buffer.
fn reach(
    particles: impl Iterator<Item = u32>,
    neighbours: &Neighbours,
    rings: &mut [u8],
    reached: &mut Vec<u32>,
) {
    let mut is_nearer = |particle: &u32, ring: u8| {
        let known = &mut rings[*particle as usize];
        let is_nearer = ring < *known;
        *known = ring.min(*known);
        is_nearer
    };
    reached.clear();
    reached.extend(particles.filter(|particle| is_nearer(particle, 0)));
    let mut done = 0;
    for ring in 1..NOT_REACHED {
        let end = reached.len();
        for place in done..end {
            let around = neighbours.of(reached[place]).iter();
            reached.extend(around.filter(|particle| is_nearer(particle, ring)));
        }
        done = end;
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

    #[test]
    fn rings_count_from_whatever_is_nearest() {
        // A strip, in which a ring reaches three particles farther.
        let strip: Vec<[u32; 4]> = (0..60).map(|i| [i, i + 1, i + 2, i + 3]).collect();
        let neighbours = Neighbours::new(63, &strip);
        let far = |particle: usize, from: &[usize]| {
            let steps = from.iter().map(|&other| particle.abs_diff(other).div_ceil(3));
            steps.min().unwrap().min(NOT_REACHED.into()) as u8
        };
        let expected = |from: &[usize]| (0..63).map(|particle| far(particle, from)).collect::<Vec<u8>>();
        let (mut rings, mut buffer) = (vec![NOT_REACHED; 63], vec![7]);
        reach([20, 21].into_iter(), &neighbours, &mut rings, &mut buffer);
        assert_eq!(rings, expected(&[20, 21]));
        reach([24, 50, 50].into_iter(), &neighbours, &mut rings, &mut buffer);
        assert_eq!(rings, expected(&[20, 21, 24, 50]));
        reach([].into_iter(), &neighbours, &mut rings, &mut buffer);
        assert_eq!(rings, expected(&[20, 21, 24, 50]));
    }
}
