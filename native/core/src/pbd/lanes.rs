//! The machine's SIMD registers, chosen at run time: constraints are projected as many at a time as
//! a register has lanes.
//!
//! Constraints are written once, over [`Real`], and lanes round like scalars, without fused
//! multiply-add: an island solves to the same bits on AVX2, SSE2, NEON and without SIMD.

use nalgebra::Vector3;
use wide::f32x4;

use super::Real;
use super::corners::BatchCorners;
#[cfg(target_arch = "x86_64")]
use super::lanes_avx2::Avx2;

/// Position (x, y, z) and inverse mass of a particle.
pub(super) type Particle = f32x4;

/// Constraints in a batch: the widest register's lanes.
pub(super) const BATCH: usize = 8;

/// A kind of registers.
pub(super) trait Lanes: Copy {
    /// A register of numbers.
    type Real: Real;
    /// Registers that a batch takes: `part` counts them.
    const PARTS: usize;

    /// The same number in all lanes.
    fn splat(self, value: f32) -> Self::Real;

    /// Positions and inverse masses of the particles at a corner, one in each lane.
    fn load<const K: usize>(
        self,
        batch: &BatchCorners<'_, K>,
        corner: usize,
        part: usize,
    ) -> (Vector3<Self::Real>, Self::Real);

    /// Writes back what [`Self::load`] has read.
    fn store<const K: usize>(
        self,
        batch: &mut BatchCorners<'_, K>,
        corner: usize,
        part: usize,
        position: Vector3<Self::Real>,
        inverse_mass: Self::Real,
    );

    /// Numbers of the constraints in a batch.
    fn read(self, numbers: &[f32; BATCH], part: usize) -> Self::Real;

    /// Writes back what [`Self::read`] has read.
    fn write(self, numbers: &mut [f32; BATCH], part: usize, values: Self::Real);
}

/// What can run on any registers. Its `run` is `inline(always)`, with everything that it calls for
/// every batch, so that it is compiled for each kind of registers.
pub(super) trait OnLanes {
    fn run<L: Lanes>(self, lanes: L);
}

/// Runs on the widest registers that this machine has.
pub(super) fn on_widest_lanes(task: impl OnLanes) {
    #[cfg(test)]
    if tests::are_portable() {
        return task.run(Portable);
    }
    #[cfg(target_arch = "x86_64")]
    if let Some(avx2) = Avx2::detect() {
        return avx2.run(task);
    }
    task.run(Portable);
}

/// Four lanes, which every supported machine has or can do without.
#[derive(Debug, Clone, Copy)]
pub(super) struct Portable;

impl Lanes for Portable {
    type Real = f32x4;
    const PARTS: usize = 2;

    #[inline(always)]
    fn splat(self, value: f32) -> f32x4 {
        f32x4::splat(value)
    }

    #[inline(always)]
    fn load<const K: usize>(
        self,
        batch: &BatchCorners<'_, K>,
        corner: usize,
        part: usize,
    ) -> (Vector3<f32x4>, f32x4) {
        let row = |lane: usize| batch.get(corner, 4 * part + lane);
        let [x, y, z, mass] = f32x4::transpose([row(0), row(1), row(2), row(3)]);
        (Vector3::new(x, y, z), mass)
    }

    #[inline(always)]
    fn store<const K: usize>(
        self,
        batch: &mut BatchCorners<'_, K>,
        corner: usize,
        part: usize,
        position: Vector3<f32x4>,
        inverse_mass: f32x4,
    ) {
        let rows = f32x4::transpose([position.x, position.y, position.z, inverse_mass]);
        for (lane, row) in rows.into_iter().enumerate() {
            batch.set(corner, 4 * part + lane, row);
        }
    }

    #[inline(always)]
    fn read(self, numbers: &[f32; BATCH], part: usize) -> f32x4 {
        let number = |lane: usize| numbers[4 * part + lane];
        f32x4::new([number(0), number(1), number(2), number(3)])
    }

    #[inline(always)]
    fn write(self, numbers: &mut [f32; BATCH], part: usize, values: f32x4) {
        numbers[4 * part..4 * part + 4].copy_from_slice(&values.to_array());
    }
}

impl Real for f32x4 {
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self::splat(value as f32)
    }

    #[inline(always)]
    fn root(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn where_above(self, value: Self, bound: Self) -> Self {
        value.simd_gt(bound) & self
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::pbd::corners::CornerIndices;
    use crate::pbd::{project_energy, project_stretch, project_volume};

    thread_local! {
        static PORTABLE: Cell<bool> = const { Cell::new(false) };
    }

    pub(super) fn are_portable() -> bool {
        PORTABLE.get()
    }

    /// Runs with the lanes that every machine has, on a thread of its own.
    pub(in crate::pbd) fn on_portable_lanes<T: Send>(run: impl FnOnce() -> T + Send) -> T {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        pool.install(|| {
            PORTABLE.set(true);
            run()
        })
    }

    fn particle(i: usize) -> Particle {
        let x = i as f32;
        f32x4::new([(x * 0.7).sin(), (x * 1.3).cos(), (x * 2.1).sin(), [1.0, 0.25, 0.0][i % 3]])
    }

    const CORNERS: [[u32; BATCH]; 4] = [
        [3, 0, 5, 2, 31, 30, 9, 8],
        [1, 4, 6, 7, 10, 11, 12, 13],
        [14, 15, 16, 17, 18, 19, 20, 21],
        [22, 23, 24, 25, 26, 27, 28, 29],
    ];

    /// All constraints, one after the other on the same batch.
    struct Everything<'a>(BatchCorners<'a, 4>, &'a mut [f32; BATCH]);

    impl OnLanes for Everything<'_> {
        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) {
            let Self(mut batch, numbers) = self;
            for part in 0..L::PARTS {
                let ((p, s), (q, t)) = (lanes.load(&batch, 0, part), lanes.load(&batch, 1, part));
                let ((m, u), (n, v)) = (lanes.load(&batch, 2, part), lanes.load(&batch, 3, part));
                let steps = project_stretch([p, q], [s, t], lanes.read(numbers, part), lanes.splat(0.7));
                let mut corners = [p + steps[0], q + steps[1], m, n];
                let w = [s, t, u, v];
                let steps = project_volume(corners, w, lanes.splat(0.1), lanes.splat(1e-4), lanes.splat(0.9));
                corners.iter_mut().zip(steps).for_each(|(corner, step)| *corner += step);
                let mut multipliers = [lanes.read(numbers, part); 4];
                let rest = [lanes.splat(0.5); 4];
                project_energy(&mut corners, w, rest, lanes.splat(0.8), &mut multipliers);
                for k in 0..4 {
                    lanes.store(&mut batch, k, part, corners[k], w[k]);
                }
                lanes.write(numbers, part, multipliers[3]);
            }
        }
    }

    fn everything_on(run: impl FnOnce(Everything<'_>)) -> (Vec<[u32; 4]>, [u32; BATCH]) {
        let mut particles: Vec<Particle> = (0..32).map(particle).collect();
        let mut numbers: [f32; BATCH] = std::array::from_fn(|lane| 0.3 + 0.1 * lane as f32);
        run(Everything(CornerIndices::new(vec![CORNERS]).of(&mut particles).batch(0), &mut numbers));
        (particles.iter().map(|p| p.to_array().map(f32::to_bits)).collect(), numbers.map(f32::to_bits))
    }

    #[test]
    fn the_widest_lanes_give_the_bits_of_portable_ones() {
        let portable = everything_on(|task| task.run(Portable));
        assert_eq!(everything_on(|task| on_widest_lanes(task)), portable);
        let rest: Vec<[u32; 4]> = (0..32).map(|i| particle(i).to_array().map(f32::to_bits)).collect();
        assert_ne!(portable.0, rest);
    }

    #[test]
    fn lanes_are_selected_one_by_one() {
        let x = f32x4::new([1.0, f32::NAN, 3.0, f32::INFINITY]);
        let value = f32x4::new([2.0, 0.0, 5.0, f32::NAN]);
        assert_eq!(x.where_above(value, f32x4::splat(1.0)).to_array(), [1.0, 0.0, 3.0, 0.0]);
        assert_eq!(f32::NAN.where_above(0.0, 1.0), 0.0);
    }
}
