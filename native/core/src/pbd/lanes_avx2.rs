//! Eight lanes: AVX2, where the machine has it.

use std::arch::x86_64::__m256;
use std::fmt;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use nalgebra::Vector3;
use pulp::x86::V3;
use pulp::{NullaryFnOnce, cast};

use super::Real;
use super::corners::BatchCorners;
use super::lanes::{BATCH, Lanes, OnLanes, Particle};

/// Proof that the machine has AVX2.
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx2(V3);

/// A task, to be compiled for AVX2.
struct Task<T>(Avx2, T);

impl<T: OnLanes> NullaryFnOnce for Task<T> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.1.run(self.0);
    }
}

impl Avx2 {
    pub(super) fn detect() -> Option<Self> {
        V3::try_new().map(Self)
    }

    pub(super) fn run(self, task: impl OnLanes) {
        self.0.vectorize(Task(self, task));
    }

    /// Transposes the two halves of four registers, each a 4 × 4 matrix.
    #[inline(always)]
    fn transposed(self, [a, b, c, d]: [__m256; 4]) -> [__m256; 4] {
        let avx = self.0.avx;
        let (ab_low, ab_high) = (avx._mm256_unpacklo_ps(a, b), avx._mm256_unpackhi_ps(a, b));
        let (cd_low, cd_high) = (avx._mm256_unpacklo_ps(c, d), avx._mm256_unpackhi_ps(c, d));
        [
            avx._mm256_shuffle_ps::<0b01_00_01_00>(ab_low, cd_low),
            avx._mm256_shuffle_ps::<0b11_10_11_10>(ab_low, cd_low),
            avx._mm256_shuffle_ps::<0b01_00_01_00>(ab_high, cd_high),
            avx._mm256_shuffle_ps::<0b11_10_11_10>(ab_high, cd_high),
        ]
    }
}

impl Lanes for Avx2 {
    type Real = Eight;
    const PARTS: usize = 1;

    #[inline(always)]
    fn splat(self, value: f32) -> Eight {
        Eight(self.0.avx._mm256_set1_ps(value), self)
    }

    #[inline(always)]
    fn load<const K: usize>(
        self,
        batch: &BatchCorners<'_, K>,
        corner: usize,
        _part: usize,
    ) -> (Vector3<Eight>, Eight) {
        let rows = |lane: usize| cast([batch.get(corner, lane), batch.get(corner, lane + 4)]);
        let [x, y, z, mass] = self.transposed([rows(0), rows(1), rows(2), rows(3)]);
        (Vector3::new(Eight(x, self), Eight(y, self), Eight(z, self)), Eight(mass, self))
    }

    #[inline(always)]
    fn store<const K: usize>(
        self,
        batch: &mut BatchCorners<'_, K>,
        corner: usize,
        _part: usize,
        position: Vector3<Eight>,
        inverse_mass: Eight,
    ) {
        let rows = self.transposed([position.x.0, position.y.0, position.z.0, inverse_mass.0]);
        for (lane, row) in rows.into_iter().enumerate() {
            let [low, high] = cast::<__m256, [Particle; 2]>(row);
            batch.set(corner, lane, low);
            batch.set(corner, lane + 4, high);
        }
    }

    #[inline(always)]
    fn read(self, numbers: &[f32; BATCH], _part: usize) -> Eight {
        Eight(cast(*numbers), self)
    }

    #[inline(always)]
    fn write(self, numbers: &mut [f32; BATCH], _part: usize, values: Eight) {
        *numbers = cast(values.0);
    }
}

/// Eight numbers, with the proof that the machine can compute with them.
#[derive(Clone, Copy)]
pub(super) struct Eight(__m256, Avx2);

impl Eight {
    fn to_array(self) -> [f32; 8] {
        cast(self.0)
    }
}

impl PartialEq for Eight {
    fn eq(&self, other: &Self) -> bool {
        self.to_array() == other.to_array()
    }
}

impl fmt::Debug for Eight {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.to_array().fmt(formatter)
    }
}

macro_rules! operator {
    ($trait:ident, $function:ident, $instruction:ident) => {
        impl $trait for Eight {
            type Output = Self;

            #[inline(always)]
            fn $function(self, other: Self) -> Self {
                Self(self.1.0.avx.$instruction(self.0, other.0), self.1)
            }
        }
    };
}

macro_rules! assignment {
    ($trait:ident, $function:ident, $instruction:ident) => {
        impl $trait for Eight {
            #[inline(always)]
            fn $function(&mut self, other: Self) {
                self.0 = self.1.0.avx.$instruction(self.0, other.0);
            }
        }
    };
}

operator!(Add, add, _mm256_add_ps);
operator!(Sub, sub, _mm256_sub_ps);
operator!(Mul, mul, _mm256_mul_ps);
operator!(Div, div, _mm256_div_ps);
assignment!(AddAssign, add_assign, _mm256_add_ps);
assignment!(SubAssign, sub_assign, _mm256_sub_ps);
assignment!(MulAssign, mul_assign, _mm256_mul_ps);

impl Neg for Eight {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        let avx = self.1.0.avx;
        Self(avx._mm256_xor_ps(self.0, avx._mm256_set1_ps(-0.0)), self.1)
    }
}

impl Real for Eight {
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        self.1.splat(value as f32)
    }

    #[inline(always)]
    fn root(self) -> Self {
        Self(self.1.0.avx._mm256_sqrt_ps(self.0), self.1)
    }

    #[inline(always)]
    fn where_above(self, value: Self, bound: Self) -> Self {
        let avx = self.1.0.avx;
        let above = avx._mm256_cmp_ps::<{ std::arch::x86_64::_CMP_GT_OQ }>(value.0, bound.0);
        Self(avx._mm256_and_ps(self.0, above), self.1)
    }
}
