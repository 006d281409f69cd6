//! The particles at the corners of constraints, read and written without bounds checks: the only `unsafe`
//! code of the crate.
//!
//! A batch of tetrahedra takes 64 checks for its 32 corners, and a sweep a twelfth of its time. Instead one
//! look at all indices when they are built, and one at the count of the particles when a sweep begins, prove
//! what `unsafe` needs: every offset of [`CornerIndices`] is that of a particle below its bound, and [`Corners`]
//! hold at least so many particles. The fields that this hangs on are private to this file and never change.

#![allow(unsafe_code)]

use super::lanes::{BATCH, Particle};

/// Bytes from a particle to the next.
const STRIDE: u32 = size_of::<Particle>() as u32;

/// Particles of the constraints in each batch: corner by corner, one lane for each constraint.
#[derive(Debug, Clone, Default)]
pub(super) struct CornerIndices<const K: usize> {
    /// Their places in bytes: what a sweep adds to the first one's address, without multiplying.
    offsets: Vec<[[u32; BATCH]; K]>,
    /// All indices are below.
    bound: usize,
}

impl<const K: usize> CornerIndices<K> {
    /// # Panics
    /// Where a place in bytes is beyond 32 bits: from 268 million particles on.
    pub(super) fn new(mut batches: Vec<[[u32; BATCH]; K]>) -> Self {
        let indices = batches.iter().flatten().flatten();
        let bound = indices.max().map_or(0, |&last| last as usize + 1);
        assert!(bound <= (u32::MAX / STRIDE) as usize, "{bound} particles in an island");
        batches.iter_mut().flatten().flatten().for_each(|index| *index *= STRIDE);
        Self { offsets: batches, bound }
    }

    /// The particles of each batch.
    pub(super) fn batches(&self) -> impl ExactSizeIterator<Item = [[u32; BATCH]; K]> + '_ {
        self.offsets.iter().map(|corners| corners.map(indices_of))
    }

    /// The corners of all batches.
    ///
    /// # Panics
    /// Where an index is beyond the particles.
    pub(super) fn of<'a>(&'a self, particles: &'a mut [Particle]) -> Corners<'a, K> {
        assert!(self.bound <= particles.len(), "{} particles, {} named", particles.len(), self.bound);
        Corners { offsets: &self.offsets, particles }
    }
}

/// Batches with the particles that they name.
pub(super) struct Corners<'a, const K: usize> {
    offsets: &'a [[[u32; BATCH]; K]],
    /// As many as the indices are below, or more.
    particles: &'a mut [Particle],
}

impl<const K: usize> Corners<'_, K> {
    /// One of the batches.
    #[inline(always)]
    pub(super) fn batch(&mut self, batch: usize) -> BatchCorners<'_, K> {
        BatchCorners { offsets: &self.offsets[batch], particles: self.particles }
    }
}

/// One batch with its particles.
pub(super) struct BatchCorners<'a, const K: usize> {
    offsets: &'a [[u32; BATCH]; K],
    particles: &'a mut [Particle],
}

impl<const K: usize> BatchCorners<'_, K> {
    /// The particles of a corner.
    #[inline(always)]
    pub(super) fn indices(&self, corner: usize) -> [u32; BATCH] {
        indices_of(self.offsets[corner])
    }

    /// The particle at a corner of the constraint in a lane.
    #[inline(always)]
    pub(super) fn get(&self, corner: usize, lane: usize) -> Particle {
        let offset = self.offsets[corner][lane] as usize;
        // SAFETY: the offset is that of a particle below the bound of its `CornerIndices`, and
        // `CornerIndices::of`, which alone makes `Corners`, has seen that there are at least so many.
        unsafe { *self.particles.as_ptr().byte_add(offset) }
    }

    /// Overwrites the particle at a corner of the constraint in a lane.
    #[inline(always)]
    pub(super) fn set(&mut self, corner: usize, lane: usize, particle: Particle) {
        let offset = self.offsets[corner][lane] as usize;
        // SAFETY: as in `get`.
        unsafe { *self.particles.as_mut_ptr().byte_add(offset) = particle };
    }
}

fn indices_of(offsets: [u32; BATCH]) -> [u32; BATCH] {
    offsets.map(|offset| offset / STRIDE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use wide::f32x4;

    #[test]
    fn corners_are_the_particles_that_are_named() {
        let indices = CornerIndices::new(vec![[[3; BATCH], [0, 1, 2, 3, 4, 5, 6, 7]]]);
        let mut particles: Vec<Particle> = (0..8).map(|i| f32x4::splat(i as f32)).collect();
        let mut corners = indices.of(&mut particles);
        let mut batch = corners.batch(0);
        assert_eq!((batch.get(0, 5), batch.get(1, 5)), (f32x4::splat(3.0), f32x4::splat(5.0)));
        batch.set(1, 7, f32x4::splat(-1.0));
        assert_eq!(particles[7], f32x4::splat(-1.0));
        assert_eq!(particles[6], f32x4::splat(6.0));
    }

    #[test]
    #[should_panic(expected = "7 particles, 8 named")]
    fn an_index_beyond_the_particles_is_refused() {
        let indices = CornerIndices::new(vec![[[0, 1, 2, 3, 4, 5, 6, 7]]]);
        let _ = indices.of(&mut [f32x4::ZERO; 7]);
    }

    #[test]
    #[should_panic(expected = "out of bounds")]
    fn a_batch_that_is_not_there_is_refused() {
        let _ = CornerIndices::<2>::default().of(&mut []).batch(0);
    }
}
