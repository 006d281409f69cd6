//! Energy preservation (eq. 8-11): four springs between a tetrahedron's corners and its barycentre.
//!
//! Two forms. [`project_energy_paper`] is eq. 9-11 as printed: the stiffness cancels (the
//! constraint and its gradient are both proportional to it), the barycentre's own motion is left
//! out of the gradient, and each step can only halve the energy. [`project_energy`] is what the
//! text asks for: each spring is a compliant constraint with a Lagrange multiplier (XPBD, Macklin
//! et al. 2016) and compliance 1/k, so that the stiffness k decides how far a soft material
//! follows its springs and the number of iterations does not.

use nalgebra::Vector3;

use super::Real;
use super::real::dot;

/// Barycentre of equal corner masses (eq. 8).
#[inline(always)]
pub fn barycentre<T: Real>(p: &[Vector3<T>; 4]) -> Vector3<T> {
    (p[0] + p[1] + p[2] + p[3]) * p[0].x.constant(0.25)
}

/// Projects the four springs one after the other (see [`project_spring`]). Moves `positions` and
/// adds to `multipliers`, which start at zero with the first iteration. `compliance` is 1/k.
#[inline(always)]
pub fn project_energy<T: Real>(
    positions: &mut [Vector3<T>; 4],
    inverse_masses: [T; 4],
    rest_lengths: [T; 4],
    compliance: T,
    multipliers: &mut [T; 4],
) {
    for spring in 0..4 {
        let multiplier = &mut multipliers[spring];
        project_spring(positions, inverse_masses, spring, rest_lengths[spring], compliance, multiplier);
    }
}

/// Projects one spring, `C = |p_i − p_0| − d_i` with the full gradient `∇_i C = ¾ n`,
/// `∇_j C = −¼ n`: the barycentre moves with its corners, so the centre of mass stays. None for a
/// spring without length: it has no direction.
#[inline(always)]
pub fn project_spring<T: Real>(
    positions: &mut [Vector3<T>; 4],
    inverse_masses: [T; 4],
    spring: usize,
    rest_length: T,
    compliance: T,
    multiplier: &mut T,
) {
    let (quarter, half) = (compliance.constant(0.25), compliance.constant(0.5));
    let arm = positions[spring] - barycentre(positions);
    let length = dot(&arm, &arm).root();
    // Σ_j w_j |∇_j C|²: a sixteenth for every corner, and half more for the spring's own.
    let all = inverse_masses[0] + inverse_masses[1] + inverse_masses[2] + inverse_masses[3];
    let mass = all * quarter * quarter + inverse_masses[spring] * half;
    let (solvable, zero) = (length * mass, length.constant(0.0));
    let violation = length - rest_length + compliance * *multiplier;
    let step = (-violation / (mass + compliance)).where_above(solvable, zero);
    *multiplier += step;
    let along = arm * (step / length).where_above(solvable, zero);
    for corner in 0..4 {
        positions[corner] -= along * (quarter * inverse_masses[corner]);
    }
    positions[spring] += along * inverse_masses[spring];
}

/// The step of eq. 9-11 to the letter, all stiffnesses equal (they cancel). None where all springs
/// have their rest length: the gradient vanishes there.
#[inline(always)]
pub fn project_energy_paper<T: Real>(
    positions: [Vector3<T>; 4],
    inverse_masses: [T; 4],
    rest_lengths: [T; 4],
) -> [Vector3<T>; 4] {
    let centre = barycentre(&positions);
    let zero = centre.x.constant(0.0);
    let (half, least) = (zero.constant(0.5), zero.constant(1e-30));
    let mut gradients = positions;
    let mut energy = zero;
    let mut divisor = zero;
    for i in 0..4 {
        let arm = positions[i] - centre;
        let length = dot(&arm, &arm).root();
        let stretch = length - rest_lengths[i];
        energy += stretch * stretch * half;
        gradients[i] = arm * (stretch / length).where_above(length, zero);
        divisor += inverse_masses[i] * dot(&gradients[i], &gradients[i]);
    }
    let step = (energy / divisor).where_above(divisor, least);
    let mut steps = gradients;
    for i in 0..4 {
        steps[i] *= -(step * inverse_masses[i]);
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pbd::finite_difference::{assert_step_follows_gradient, points};
    use proptest::prelude::*;

    fn regular() -> [Vector3<f64>; 4] {
        [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]].map(Vector3::from)
    }

    fn lengths(p: [Vector3<f64>; 4]) -> [f64; 4] {
        p.map(|corner| (corner - barycentre(&p)).norm())
    }

    proptest! {
        #[test]
        fn a_stiff_spring_follows_its_full_gradient(
            p in points::<4>(), w in prop::array::uniform4(0.1f64..2.0), spring in 0usize..4, rest in 0.2f64..2.0
        ) {
            prop_assume!(lengths(p)[spring] > 0.2);
            let (mut q, mut multiplier) = (p, 0.0);
            project_spring(&mut q, w, spring, rest, 0.0, &mut multiplier);
            let step: [Vector3<f64>; 4] = std::array::from_fn(|i| q[i] - p[i]);
            let constraint = |q: &[Vector3<f64>]| {
                let q = [q[0], q[1], q[2], q[3]];
                (q[spring] - barycentre(&q)).norm() - rest
            };
            assert_step_follows_gradient(&p, &w, &step, constraint);
        }

        #[test]
        fn the_centre_of_mass_stays(p in points::<4>(), k in 0.01f64..100.0) {
            let (mut q, mut multipliers) = (p, [0.0; 4]);
            for _ in 0..12 {
                project_energy(&mut q, [1.0; 4], lengths(regular()), 1.0 / k, &mut multipliers);
            }
            prop_assert!((barycentre(&q) - barycentre(&p)).norm() < 1e-12);
        }

        #[test]
        fn stiffness_decides_how_far_and_iterations_do_not(stretch in 0.3f64..3.0) {
            let rest = lengths(regular());
            let solve = |k: f64, iterations: usize| {
                let (mut q, mut multipliers) = (regular().map(|p| p * stretch), [0.0; 4]);
                for _ in 0..iterations {
                    project_energy(&mut q, [1.0; 4], rest, 1.0 / k, &mut multipliers);
                }
                (lengths(q)[0] - rest[0]).abs()
            };
            let left = [0.01, 0.1, 1.0, 10.0, 100.0].map(|k| solve(k, 100));
            prop_assume!((stretch - 1.0).abs() > 0.05);
            prop_assert!(left.windows(2).all(|pair| pair[1] < pair[0]), "{:?}", left);
            prop_assert!((solve(1.0, 100) - solve(1.0, 200)).abs() < 1e-9);
        }

        #[test]
        fn the_paper_step_is_equation_11(p in points::<4>(), w in prop::array::uniform4(0.1f64..2.0)) {
            let rest = lengths(regular());
            let centre = barycentre(&p);
            let gradient = |i: usize| {
                let arm = p[i] - centre;
                arm.normalize() * (arm.norm() - rest[i])
            };
            prop_assume!((0..4).all(|i| (p[i] - centre).norm() > 0.1));
            let energy: f64 = (0..4).map(|i| 0.5 * gradient(i).norm_squared()).sum();
            let divisor: f64 = (0..4).map(|i| w[i] * gradient(i).norm_squared()).sum();
            let steps = project_energy_paper(p, w, rest);
            for i in 0..4 {
                prop_assert!((steps[i] + gradient(i) * (w[i] * energy / divisor)).norm() < 1e-9);
            }
        }
    }

    #[test]
    fn nothing_moves_at_rest_or_in_one_point() {
        let rest = lengths(regular());
        let (mut p, mut multipliers) = (regular(), [0.0; 4]);
        project_energy(&mut p, [1.0; 4], rest, 0.01, &mut multipliers);
        assert!(p.iter().zip(regular()).all(|(a, b)| (a - b).norm() < 1e-12));
        assert_eq!(project_energy_paper(regular(), [1.0; 4], rest).map(|s| s.norm() < 1e-6), [true; 4]);
        let mut point = [Vector3::new(1.0, 2.0, 3.0); 4];
        project_energy(&mut point, [1.0; 4], rest, 0.01, &mut multipliers);
        assert_eq!(point, [Vector3::new(1.0, 2.0, 3.0); 4]);
    }
}
