//! Bind constraint (section 4.2 c, after Rumman & Fratarcangeli 2015): a particle keeps its
//! distance from its projection on the nearest bone, which follows the pose.

use nalgebra::Vector3;

use super::Real;
use super::real::dot;

/// Correction of the particle alone: the anchor on the bone is held. `C(p) = |p − q| − d`. None
/// where the particle is on the anchor or is held: there is no direction.
#[inline(always)]
pub fn project_bind<T: Real>(
    position: Vector3<T>,
    anchor: Vector3<T>,
    rest_length: T,
    stiffness: T,
) -> Vector3<T> {
    let arm = position - anchor;
    let length = dot(&arm, &arm).root();
    let scale = (stiffness * (length - rest_length) / length).where_above(length, length.constant(0.0));
    -arm * scale
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pbd::finite_difference::{assert_step_follows_gradient, points};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn one_projection_restores_the_distance_along_the_gradient(p in points::<2>(), rest in 0.1f64..3.0) {
            let [position, anchor] = p;
            let step = project_bind(position, anchor, rest, 1.0);
            prop_assert!(((position + step - anchor).norm() - rest).abs() < 1e-12);
            assert_step_follows_gradient(&[position], &[1.0], &[step], |q| (q[0] - anchor).norm() - rest);
            let half = project_bind(position, anchor, rest, 0.5);
            prop_assert!((half * 2.0 - step).norm() < 1e-12);
        }
    }

    #[test]
    fn a_particle_on_its_bone_has_no_direction() {
        let p = Vector3::new(0.3f32, 0.2, 0.1);
        assert_eq!(project_bind(p, p, 1.0, 1.0), Vector3::zeros());
    }
}
