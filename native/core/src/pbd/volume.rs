//! Volume constraint (eq. 7): a tetrahedron keeps its signed rest volume.
//!
//! `C = (p2 − p1) × (p3 − p1) · (p4 − p1) / 6 − V`, the triple product of eq. 7 with the sign that
//! makes a positively oriented tetrahedron positive. The step follows eq. 11. The sign of the
//! volume counts, so an inverted tetrahedron is driven back.

use nalgebra::Vector3;

use super::Real;
use super::real::{cross, dot};

/// Signed volume of a tetrahedron.
#[inline(always)]
pub fn signed_volume<T: Real>(p: [Vector3<T>; 4]) -> T {
    dot(&cross(&(p[1] - p[0]), &(p[2] - p[0])), &(p[3] - p[0])) / p[0].x.constant(6.0)
}

/// Gradients of [`signed_volume`] by the four corners.
#[inline(always)]
pub fn volume_gradients<T: Real>(p: [Vector3<T>; 4]) -> [Vector3<T>; 4] {
    let sixth = p[0].x.constant(1.0 / 6.0);
    product_gradients(p).map(|gradient| gradient * sixth)
}

/// Gradients of six times the volume.
#[inline(always)]
fn product_gradients<T: Real>(p: [Vector3<T>; 4]) -> [Vector3<T>; 4] {
    let (a, b, c) = (p[1] - p[0], p[2] - p[0], p[3] - p[0]);
    let (ga, gb, gc) = (cross(&b, &c), cross(&c, &a), cross(&a, &b));
    [-(ga + gb + gc), ga, gb, gc]
}

/// Smallest Σ w |∇C|² that [`project_volume`] takes for a solution: a share of the value at a regular
/// tetrahedron of this volume. Below it the corners are nearly in a point or a line.
#[must_use]
pub fn least_volume_divisor(rest_volume: f32) -> f32 {
    LEAST_DIVISOR * rest_volume.abs().powf(4.0 / 3.0)
}

const LEAST_DIVISOR: f32 = 1e-4;

/// Corrections of the four corners for a stiffness from 0 to 1; none where Σ w |∇C|² is at most
/// `least_divisor` (see [`least_volume_divisor`]), since dividing by it would throw corners away, or
/// where all are held.
#[inline(always)]
pub fn project_volume<T: Real>(
    positions: [Vector3<T>; 4],
    inverse_masses: [T; 4],
    rest_volume: T,
    least_divisor: T,
    stiffness: T,
) -> [Vector3<T>; 4] {
    let gradients = product_gradients(positions);
    let product = dot(&gradients[3], &(positions[3] - positions[0]));
    let mut divisor = inverse_masses[0] * dot(&gradients[0], &gradients[0]);
    for corner in 1..4 {
        divisor += inverse_masses[corner] * dot(&gradients[corner], &gradients[corner]);
    }
    let six = rest_volume.constant(6.0);
    let least = least_divisor * rest_volume.constant(36.0);
    let scale = (stiffness * (product - six * rest_volume) / divisor).where_above(divisor, least);
    let mut steps = gradients;
    for corner in 0..4 {
        steps[corner] *= -(scale * inverse_masses[corner]);
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pbd::finite_difference::{assert_step_follows_gradient, gradients, points};
    use proptest::prelude::*;

    fn volume(p: &[Vector3<f64>]) -> f64 {
        signed_volume([p[0], p[1], p[2], p[3]])
    }

    proptest! {
        #[test]
        fn gradients_match_differences_and_sum_to_zero(p in points::<4>()) {
            let exact = volume_gradients(p);
            for (exact, difference) in exact.iter().zip(gradients(&p, volume)) {
                prop_assert!((exact - difference).norm() < 1e-8);
            }
            prop_assert!(exact.iter().sum::<Vector3<f64>>().norm() < 1e-12);
        }

        #[test]
        fn a_projection_follows_the_gradient_and_keeps_the_centre_of_mass(
            p in points::<4>(), w in prop::array::uniform4(0.1f64..2.0), rest in 0.2f64..1.0
        ) {
            prop_assume!(volume(&p).abs() > 0.05);
            let step = project_volume(p, w, rest, 0.0, 1.0);
            assert_step_follows_gradient(&p, &w, &step, |q| volume(q) - rest);
            let momentum: Vector3<f64> = step.iter().zip(w).map(|(s, w)| s / w).sum();
            prop_assert!(momentum.norm() < 1e-9);
        }

        #[test]
        fn repeated_projection_restores_the_volume(p in points::<4>(), rest in 0.2f64..1.0) {
            prop_assume!(volume(&p) > 0.1);
            let mut q = p;
            for _ in 0..30 {
                let step = project_volume(q, [1.0; 4], rest, 0.0, 1.0);
                q.iter_mut().zip(step).for_each(|(q, s)| *q += s);
            }
            prop_assert!((volume(&q) - rest).abs() < 1e-9);
        }
    }

    #[test]
    fn an_inverted_tetrahedron_is_driven_back() {
        let mut p = [Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::z() * -0.5f64];
        let step = project_volume(p, [1.0; 4], 1.0 / 6.0, 0.0, 1.0);
        let before = volume(&p);
        p.iter_mut().zip(step).for_each(|(p, s)| *p += s);
        assert!(before < 0.0 && volume(&p) > before);
    }

    #[test]
    fn a_collapsed_tetrahedron_and_held_corners_stay() {
        let line = [0.0f32, 1.0, 2.0, 3.0].map(|x| Vector3::new(x * 1e-4, 0.0, 0.0));
        let least = least_volume_divisor(1.0);
        assert_eq!(project_volume(line, [1.0; 4], 1.0, least, 1.0), [Vector3::zeros(); 4]);
        let corner = [Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::z()];
        assert_eq!(project_volume(corner, [0.0; 4], 1.0, least, 1.0), [Vector3::zeros(); 4]);
    }
}
