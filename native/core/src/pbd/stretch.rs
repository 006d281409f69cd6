//! Stretch constraint (eq. 6): an edge keeps its rest length.
//!
//! `C(p1, p2) = |p1 − p2| − d`, with the gradients `∇p1 C = n`, `∇p2 C = −n`, `n = (p1 − p2)/|p1 − p2|`.
//! The step follows eq. 11, so that inverse masses count: `Δp_i = −w_i C / (w_1 + w_2) ∇_i C`
//! (Müller et al. 2007).

use nalgebra::Vector3;

use super::Real;
use super::real::dot;

/// Corrections of both particles for a stiffness from 0 to 1; none where the two coincide, since
/// the edge then has no direction, or where both are held.
///
/// The function is generic over [`Real`]: `f32`, `f64`, or a SIMD register of them.
#[inline(always)]
pub fn project_stretch<T: Real>(
    positions: [Vector3<T>; 2],
    inverse_masses: [T; 2],
    rest_length: T,
    stiffness: T,
) -> [Vector3<T>; 2] {
    let edge = positions[0] - positions[1];
    let length = dot(&edge, &edge).root();
    let mass = inverse_masses[0] + inverse_masses[1];
    let divisor = length * mass;
    let scale = (stiffness * (length - rest_length) / divisor).where_above(divisor, divisor.constant(0.0));
    let step = edge * scale;
    [-step * inverse_masses[0], step * inverse_masses[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pbd::finite_difference::{assert_step_follows_gradient, points};
    use proptest::prelude::*;

    fn constraint(p: &[Vector3<f64>], rest_length: f64) -> f64 {
        (p[0] - p[1]).norm() - rest_length
    }

    proptest! {
        #[test]
        fn one_projection_restores_the_length_and_keeps_the_centre_of_mass(
            p in points::<2>(), w in prop::array::uniform2(0.1f64..3.0), rest in 0.1f64..3.0
        ) {
            let step = project_stretch(p, w, rest, 1.0);
            let after = [p[0] + step[0], p[1] + step[1]];
            prop_assert!(constraint(&after, rest).abs() < 1e-12);
            prop_assert!((step[0] / w[0] + step[1] / w[1]).norm() < 1e-12);
            assert_step_follows_gradient(&p, &w, &step, |q| constraint(q, rest));
        }

        #[test]
        fn a_held_particle_stays(p in points::<2>(), rest in 0.1f64..3.0) {
            let step = project_stretch(p, [0.0, 1.0], rest, 1.0);
            prop_assert_eq!(step[0].norm(), 0.0);
            prop_assert!(constraint(&[p[0], p[1] + step[1]], rest).abs() < 1e-12);
        }
    }

    #[test]
    fn nothing_moves_without_a_direction_or_without_a_free_particle() {
        let p = Vector3::new(0.5f32, 0.0, 0.0);
        assert_eq!(project_stretch([p, p], [1.0, 1.0], 1.0, 1.0), [Vector3::zeros(); 2]);
        assert_eq!(project_stretch([p, -p], [0.0, 0.0], 3.0, 1.0), [Vector3::zeros(); 2]);
    }
}
