//! Oracles for the constraint tests: random points and central differences.

use nalgebra::Vector3;
use proptest::prelude::*;

/// Random points that are not too near to one another.
pub(super) fn points<const N: usize>() -> impl Strategy<Value = [Vector3<f64>; N]> {
    prop::array::uniform::<_, N>(prop::array::uniform3(-2.0f64..2.0))
        .prop_map(|p| p.map(Vector3::from))
        .prop_filter("distances", |p: &[Vector3<f64>; N]| {
            (0..N).all(|i| (0..i).all(|j| (p[i] - p[j]).norm() > 0.2))
        })
}

/// Gradient of a function of points, by central differences.
pub(super) fn gradients<const N: usize>(
    p: &[Vector3<f64>; N],
    f: impl Fn(&[Vector3<f64>]) -> f64,
) -> [Vector3<f64>; N] {
    const H: f64 = 1e-5;
    std::array::from_fn(|i| {
        Vector3::from_fn(|axis, _| {
            let shifted = |h: f64| {
                let mut q = *p;
                q[i][axis] += h;
                f(&q)
            };
            (shifted(H) - shifted(-H)) / (2.0 * H)
        })
    })
}

/// Checks a full projection against eq. 11 with finite-difference gradients:
/// `Δp_i = −w_i C / Σ_j w_j |∇_j C|² · ∇_i C`.
pub(super) fn assert_step_follows_gradient<const N: usize>(
    p: &[Vector3<f64>; N],
    w: &[f64; N],
    step: &[Vector3<f64>; N],
    constraint: impl Fn(&[Vector3<f64>]) -> f64,
) {
    let gradients = gradients(p, &constraint);
    let divisor: f64 = gradients.iter().zip(w).map(|(g, w)| w * g.norm_squared()).sum();
    for i in 0..N {
        let expected = gradients[i] * (-w[i] * constraint(p) / divisor);
        assert!((step[i] - expected).norm() < 1e-6 * (1.0 + expected.norm()), "{} {expected}", step[i]);
    }
}
