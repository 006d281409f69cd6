//! The numbers that constraints are written in: scalars, or as many numbers as a SIMD register has
//! lanes, one for each of as many constraints.

use std::ops::{Div, Neg};

use nalgebra::{ClosedAddAssign, ClosedMulAssign, ClosedSubAssign, Scalar, Vector3};

/// A real number in every lane. Operations round like those of scalars in each lane.
pub trait Real:
    Scalar + Copy + ClosedAddAssign + ClosedSubAssign + ClosedMulAssign + Div<Output = Self> + Neg<Output = Self>
{
    /// A constant in as many lanes as `self` has.
    #[must_use]
    fn constant(self, value: f64) -> Self;

    /// The square root.
    #[must_use]
    fn root(self) -> Self;

    /// `self` where `value` is greater than `bound`, 0 in all other lanes, whatever `self` is there.
    #[must_use]
    fn where_above(self, value: Self, bound: Self) -> Self;
}

macro_rules! real_scalar {
    ($t:ty) => {
        impl Real for $t {
            #[inline(always)]
            fn constant(self, value: f64) -> Self {
                value as $t
            }

            #[inline(always)]
            fn root(self) -> Self {
                self.sqrt()
            }

            #[inline(always)]
            fn where_above(self, value: Self, bound: Self) -> Self {
                if value > bound { self } else { 0.0 }
            }
        }
    };
}

real_scalar!(f32);
real_scalar!(f64);

#[inline(always)]
pub(super) fn dot<T: Real>(a: &Vector3<T>, b: &Vector3<T>) -> T {
    a.x * b.x + a.y * b.y + a.z * b.z
}

#[inline(always)]
pub(super) fn cross<T: Real>(a: &Vector3<T>, b: &Vector3<T>) -> Vector3<T> {
    Vector3::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
}
