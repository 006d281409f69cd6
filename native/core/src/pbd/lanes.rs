//! Particles and constraints as the solver's loops see them: four constraints at a time, one in each
//! lane of a SIMD register.
//!
//! Constraints are generic over lanes, and lanes round like scalars, without fused multiply-add: an
//! island solves to the same bits on SSE2, NEON or without SIMD.

use nalgebra::Vector3;
use simba::simd::WideF32x4;
use wide::f32x4;

/// Constraints in a batch.
pub(super) const LANES: usize = 4;

/// One number of each constraint in a batch.
pub(super) type Lanes = WideF32x4;

/// Position (x, y, z) and inverse mass of a particle.
pub(super) type Particle = f32x4;

/// The same number in all lanes.
#[inline]
pub(super) fn splat(value: f32) -> Lanes {
    WideF32x4(f32x4::splat(value))
}

/// Positions and inverse masses of the particles at one corner of each constraint in a batch.
#[inline]
pub(super) fn load(particles: &[Particle], indices: &[u32; LANES]) -> (Vector3<Lanes>, Lanes) {
    let [a, b, c, d] = *indices;
    let rows = [particles[a as usize], particles[b as usize], particles[c as usize], particles[d as usize]];
    let [x, y, z, mass] = f32x4::transpose(rows);
    (Vector3::new(WideF32x4(x), WideF32x4(y), WideF32x4(z)), WideF32x4(mass))
}

/// Writes back what [`load`] has read.
#[inline]
pub(super) fn store(
    particles: &mut [Particle],
    indices: &[u32; LANES],
    position: Vector3<Lanes>,
    inverse_mass: Lanes,
) {
    let columns = [position.x.0, position.y.0, position.z.0, inverse_mass.0];
    let rows = f32x4::transpose(columns);
    for lane in 0..LANES {
        particles[indices[lane] as usize] = rows[lane];
    }
}

/// Constraints over `K` particles each, in batches; no two in a batch share a particle.
#[derive(Debug, Clone, Default)]
pub(super) struct Batches<const K: usize> {
    /// Particles of each batch: corner by corner, one lane for each constraint.
    pub particles: Vec<[[u32; LANES]; K]>,
    /// Constraints of each batch; `None` where a lane is idle.
    members: Vec<[Option<u32>; LANES]>,
}

impl<const K: usize> Batches<K> {
    /// Puts each constraint into the first batch with room after all batches that hold one of its
    /// particles. So whatever shares a particle is still projected in the order given, and the result
    /// is that of one constraint after the other; an order that runs through space leaves more than
    /// enough that shares none. `idle` is a particle without mass: idle lanes name it.
    pub(super) fn new(constraints: &[[u32; K]], idle: u32) -> Self {
        let mut batches = Self::default();
        // First batch after those of each particle, and the first one with room from each batch on.
        let mut after = vec![0u32; idle as usize];
        let mut with_room: Vec<u32> = Vec::new();
        for (index, corners) in (0..).zip(constraints) {
            let earliest = corners.iter().map(|&corner| after[corner as usize]).max().unwrap_or(0);
            let batch = first_with_room(&mut with_room, earliest);
            if batch as usize == batches.members.len() {
                batches.particles.push([[idle; LANES]; K]);
                batches.members.push([None; LANES]);
            }
            let members = &mut batches.members[batch as usize];
            let lane = members.iter().position(Option::is_none).unwrap_or(0);
            members[lane] = Some(index);
            if lane + 1 == LANES {
                with_room[batch as usize] = batch + 1;
            }
            for (k, &corner) in corners.iter().enumerate() {
                batches.particles[batch as usize][k][lane] = corner;
                after[corner as usize] = batch + 1;
            }
        }
        batches
    }

    /// Numbers of each constraint, batch by batch; 1 where a lane is idle.
    pub(super) fn gather<const N: usize>(&self, values: impl Fn(usize) -> [f32; N]) -> Vec<[Lanes; N]> {
        let of_batch = |members: &[Option<u32>; LANES]| {
            let rows = members.map(|m| m.map_or([1.0; N], |index| values(index as usize)));
            std::array::from_fn(|n| WideF32x4(f32x4::new(rows.map(|row| row[n]))))
        };
        self.members.iter().map(of_batch).collect()
    }

    /// Batches with a particle of which `free` is true, into `found`.
    pub(super) fn select(&self, free: &[bool], found: &mut Vec<u32>) {
        found.clear();
        let is_free = |corners: &[[u32; LANES]; K]| corners.iter().flatten().any(|&c| free[c as usize]);
        found.extend((0..).zip(&self.particles).filter(|(_, corners)| is_free(corners)).map(|(i, _)| i));
    }
}

/// First batch from `start` on that has room: a full one refers to the next, and chains of them are
/// shortened on the way.
fn first_with_room(with_room: &mut Vec<u32>, start: u32) -> u32 {
    let mut batch = start as usize;
    loop {
        if batch >= with_room.len() {
            with_room.extend(with_room.len() as u32..=batch as u32);
        }
        let next = with_room[batch] as usize;
        if next == batch {
            return batch as u32;
        }
        if let Some(&beyond) = with_room.get(next) {
            with_room[batch] = beyond;
        }
        batch = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triples of neighbours in a row of particles.
    fn triples(count: u32) -> Vec<[u32; 3]> {
        (0..count).map(|i| [i, i + 1, i + 2]).collect()
    }

    #[test]
    fn every_constraint_has_one_lane_and_no_batch_shares_a_particle() {
        for count in [0, 1, 2, 7, 100] {
            let (constraints, idle) = (triples(count), count + 2);
            let batches = Batches::new(&constraints, idle);
            let mut seen: Vec<u32> = batches.members.iter().flatten().copied().flatten().collect();
            seen.sort_unstable();
            assert_eq!(seen, Vec::from_iter(0..count));
            for (particles, members) in batches.particles.iter().zip(&batches.members) {
                let mut used: Vec<u32> = particles.iter().flatten().copied().filter(|&p| p != idle).collect();
                used.sort_unstable();
                assert!(used.windows(2).all(|pair| pair[0] < pair[1]), "{particles:?}");
                for (lane, member) in members.iter().enumerate() {
                    let corners: [u32; 3] = std::array::from_fn(|corner| particles[corner][lane]);
                    assert_eq!(corners, member.map_or([idle; 3], |m| constraints[m as usize]));
                }
            }
        }
    }

    #[test]
    fn what_shares_a_particle_stays_in_order() {
        // Pairs all over a row, so that some share a particle and most do not.
        let pairs: Vec<[u32; 2]> = (0..200).map(|i| [i * 7 % 50, 50 + i * 11 % 50]).collect();
        let batches = Batches::new(&pairs, 100);
        let mut batch_of = vec![0; pairs.len()];
        for (batch, members) in batches.members.iter().enumerate() {
            members.iter().flatten().for_each(|&index| batch_of[index as usize] = batch);
        }
        for (later, pair) in pairs.iter().enumerate() {
            for (earlier, other) in pairs[..later].iter().enumerate() {
                if pair[0] == other[0] || pair[1] == other[1] {
                    assert!(batch_of[earlier] < batch_of[later], "{earlier} {later}");
                }
            }
        }
        assert!(batches.particles.len() < 60, "{} batches", batches.particles.len());
    }

    #[test]
    fn values_follow_their_constraints_and_selection_follows_particles() {
        let batches = Batches::new(&triples(9), 11);
        let values = batches.gather(|index| [index as f32]);
        for (members, [values]) in batches.members.iter().zip(values) {
            assert_eq!(values.0.to_array(), members.map(|m| m.map_or(1.0, |index| index as f32)));
        }
        let mut free = vec![false; 12];
        free[4] = true;
        let mut found = vec![77];
        batches.select(&free, &mut found);
        let holds = |b: &u32| batches.particles[*b as usize].iter().flatten().any(|&p| p == 4);
        assert!(!found.is_empty() && found.iter().all(holds));
        assert_eq!(found.len(), (0..batches.particles.len() as u32).filter(holds).count());
    }

    #[test]
    fn what_is_loaded_comes_back() {
        let before: Vec<Particle> = (0..6).map(|i| f32x4::new([i as f32, 0.5, 2.0, -1.0])).collect();
        let mut particles = before.clone();
        let (position, mass) = load(&particles, &[3, 0, 5, 2]);
        assert_eq!(position.x.0.to_array(), [3.0, 0.0, 5.0, 2.0]);
        assert_eq!(mass.0.to_array(), [-1.0; 4]);
        store(&mut particles, &[3, 0, 5, 2], position, mass);
        assert_eq!(particles, before);
    }
}
