//! Constraints in batches that can be projected at once, in the lanes of a SIMD register.

use super::corners::CornerIndices;
use super::lanes::BATCH;

/// Constraints over `K` particles each, in batches; no two in a batch share a particle.
#[derive(Debug, Clone, Default)]
pub(super) struct Batches<const K: usize> {
    /// Particles of each batch.
    pub corners: CornerIndices<K>,
    /// Constraints of each batch; `None` where a lane is idle.
    members: Vec<[Option<u32>; BATCH]>,
}

impl<const K: usize> Batches<K> {
    /// Puts each constraint into the first batch with room after all batches that hold one of its
    /// particles: the result is that of one constraint after the other, in the order of
    /// [`shuffled`]. `idle` is a particle without mass: idle lanes name it.
    pub(super) fn new(constraints: &[[u32; K]], idle: u32) -> Self {
        let (mut particles, mut members) = (Vec::new(), Vec::new());
        // First batch after those of each particle, and the first one with room from each batch on.
        let mut after = vec![0u32; idle as usize];
        let mut with_room: Vec<u32> = Vec::new();
        for index in shuffled(constraints, idle) {
            let corners = &constraints[index as usize];
            let earliest = corners.iter().map(|&corner| after[corner as usize]).max().unwrap_or(0);
            let batch = first_with_room(&mut with_room, earliest);
            if batch as usize == members.len() {
                particles.push([[idle; BATCH]; K]);
                members.push([None; BATCH]);
            }
            let lanes: &mut [Option<u32>; BATCH] = &mut members[batch as usize];
            let lane = lanes.iter().position(Option::is_none).unwrap_or(0);
            lanes[lane] = Some(index);
            if lane + 1 == BATCH {
                with_room[batch as usize] = batch + 1;
            }
            for (k, &corner) in corners.iter().enumerate() {
                particles[batch as usize][k][lane] = corner;
                after[corner as usize] = batch + 1;
            }
        }
        Self { corners: CornerIndices::new(particles), members }
    }

    /// Numbers of each constraint, batch by batch; 1 where a lane is idle.
    pub(super) fn gather<const N: usize>(
        &self,
        values: impl Fn(usize) -> [f32; N],
    ) -> Vec<[[f32; BATCH]; N]> {
        let of_batch = |members: &[Option<u32>; BATCH]| {
            let rows = members.map(|m| m.map_or([1.0; N], |index| values(index as usize)));
            std::array::from_fn(|n| rows.map(|row| row[n]))
        };
        self.members.iter().map(of_batch).collect()
    }

    /// Batches with a particle of which `free` is true, into `found`.
    pub(super) fn select(&self, free: &[bool], found: &mut Vec<u32>) {
        found.clear();
        let is_free = |corners: &[[u32; BATCH]; K]| corners.iter().flatten().any(|&c| free[c as usize]);
        found.extend(
            (0..).zip(self.corners.batches()).filter(|(_, corners)| is_free(corners)).map(|(i, _)| i),
        );
    }
}

/// Constraints that are shuffled together, at most.
const LARGEST_WINDOW: usize = 512;
/// Windows that an island has at least.
const WINDOWS: usize = 20;

/// An order of the constraints. One that runs through space, as the one given does, carries a
/// change through the whole island in one sweep, but what follows each other shares particles and
/// has to wait. So neighbours are shuffled within windows: by colours, which share none.
fn shuffled<const K: usize>(constraints: &[[u32; K]], idle: u32) -> Vec<u32> {
    let window = (constraints.len() / WINDOWS).clamp(1, LARGEST_WINDOW);
    let mut taken = vec![0u128; idle as usize];
    let mut order = Vec::with_capacity(constraints.len());
    for (start, members) in (0..).step_by(window).zip(constraints.chunks(window)) {
        let mut coloured: Vec<(u32, u32)> = Vec::with_capacity(window);
        for (index, corners) in (start..).zip(members) {
            let around = corners.iter().fold(0, |around, &corner| around | taken[corner as usize]);
            // A tetrahedron of the lattice has fewer than 93 neighbours. More than there are colours
            // share the last one, and wait for each other.
            let colour = around.trailing_ones().min(u128::BITS - 1);
            corners.iter().for_each(|&corner| taken[corner as usize] |= 1 << colour);
            coloured.push((colour, index));
        }
        members.iter().flatten().for_each(|&corner| taken[corner as usize] = 0);
        coloured.sort_unstable();
        order.extend(coloured.into_iter().map(|(_, index)| index));
    }
    order
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
            for (particles, members) in batches.corners.batches().zip(&batches.members) {
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
    fn what_shares_a_particle_is_projected_in_the_shuffled_order() {
        // Pairs all over a row, so that some share a particle and most do not.
        let pairs: Vec<[u32; 2]> = (0..200).map(|i| [i * 7 % 50, 50 + i * 11 % 50]).collect();
        let batches = Batches::new(&pairs, 100);
        let mut batch_of = vec![0; pairs.len()];
        for (batch, members) in batches.members.iter().enumerate() {
            members.iter().flatten().for_each(|&index| batch_of[index as usize] = batch);
        }
        let order: Vec<usize> = shuffled(&pairs, 100).into_iter().map(|index| index as usize).collect();
        for (rank, &later) in order.iter().enumerate() {
            for &earlier in &order[..rank] {
                let (pair, other) = (pairs[later], pairs[earlier]);
                if pair[0] == other[0] || pair[1] == other[1] {
                    assert!(batch_of[earlier] < batch_of[later], "{earlier} {later}");
                }
            }
        }
        assert!(
            batches.corners.batches().len() < 35,
            "{} batches for {} pairs",
            batches.corners.batches().len(),
            pairs.len()
        );
    }

    #[test]
    fn shuffling_stays_within_windows_and_puts_apart_what_shares_a_particle() {
        let constraints = triples(6000);
        let order = shuffled(&constraints, 6002);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, Vec::from_iter(0..6000));
        let moved = |(place, &index): (usize, &u32)| place.abs_diff(index as usize);
        assert!(order.iter().enumerate().map(moved).max().unwrap() < LARGEST_WINDOW);
        let near = order.windows(2).filter(|pair| pair[0].abs_diff(pair[1]) < 3).count();
        assert!(near < 100, "{near}");
    }

    #[test]
    fn crowded_particles_do_not_run_out_of_batches() {
        let batches = Batches::new(&vec![[0, 1]; 6000], 2);
        assert_eq!(batches.members.iter().flatten().flatten().count(), 6000);
        assert_eq!(batches.corners.batches().len(), 6000);
    }

    #[test]
    fn values_follow_their_constraints_and_selection_follows_particles() {
        let batches = Batches::new(&triples(9), 11);
        let values = batches.gather(|index| [index as f32]);
        for (members, [values]) in batches.members.iter().zip(values) {
            assert_eq!(values, members.map(|m| m.map_or(1.0, |index| index as f32)));
        }
        let mut free = vec![false; 12];
        free[4] = true;
        let mut found = vec![77];
        batches.select(&free, &mut found);
        let corners = Vec::from_iter(batches.corners.batches());
        let holds = |b: &u32| corners[*b as usize].iter().flatten().any(|&p| p == 4);
        assert!(!found.is_empty() && found.iter().all(holds));
        assert_eq!(found.len(), (0..batches.corners.batches().len() as u32).filter(holds).count());
    }
}
