//! The projection plane between two limbs that face each other (eq. 14): through the middle of what is
//! near, perpendicular to the mean of the normals there. All of it varies continuously with the pose.

use glam::Vec3;

use super::fold_field::smoothstep;

/// A surface point with its outward unit normal and how far rest lets it take part, from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Facet {
    pub position: Vec3,
    pub normal: Vec3,
    pub share: f32,
}

/// A plane between two limbs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LimbPlane {
    pub point: Vec3,
    /// From the first limb to the second.
    pub normal: Vec3,
    /// From 0, where nothing is near or the normals have no common direction, to 1.
    pub strength: f32,
}

/// Coherence of the normals from which on they have a direction, and have it for sure.
const COHERENT: [f32; 2] = [0.3, 0.6];

/// The plane between two limbs whose points are near: no farther than `reach`, and sunk into each other no
/// deeper than `deepest`. Points that see the back of the other limb have no say.
pub(super) fn limb_plane(first: &[Facet], second: &[Facet], reach: f32, deepest: f32) -> Option<LimbPlane> {
    let per_reach = reach.powi(2).recip();
    let (mut sum, mut normal, mut middle) = (0.0f32, Vec3::ZERO, Vec3::ZERO);
    let origin = first.first()?.position;
    for a in first {
        for b in second {
            let way = b.position - a.position;
            let near = 1.0 - way.length_squared() * per_reach;
            let facing = -a.normal.dot(b.normal);
            if near <= 0.0 || facing <= 0.0 {
                continue;
            }
            let axis = a.normal - b.normal;
            let open = smoothstep(1.0 + 0.5 * way.dot(axis) / deepest);
            let weight = (near * facing).powi(2) * open * a.share * b.share;
            sum += weight;
            normal += axis * weight;
            middle += (a.position.midpoint(b.position) - origin) * weight;
        }
    }
    let length = normal.length();
    if !(sum > 0.0 && length > 0.0 && length.is_finite()) {
        return None;
    }
    let [none, all] = COHERENT;
    let coherence = smoothstep((0.5 * length / sum - none) / (all - none));
    let strength = coherence * smoothstep(sum);
    let plane = LimbPlane { point: origin + middle / sum, normal: normal / length, strength };
    (strength > 0.0 && plane.point.is_finite() && plane.normal.is_finite()).then_some(plane)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch(normal: Vec3, centre: Vec3) -> Vec<Facet> {
        let (u, v) = normal.any_orthonormal_pair();
        let at = |i: i32, j: i32| centre + 0.1 * (u * i as f32 + v * j as f32);
        let nodes = (-3..=3).flat_map(|i| (-3..=3).map(move |j| (i, j)));
        nodes.map(|(i, j)| Facet { position: at(i, j), normal, share: 1.0 }).collect()
    }

    #[test]
    fn the_plane_is_half_way_between_what_faces_each_other() {
        let normal = Vec3::new(0.6, 0.0, 0.8);
        for gap in [0.1, -0.2] {
            let (first, second) = (patch(normal, -normal * gap * 0.5), patch(-normal, normal * gap * 0.5));
            let plane = limb_plane(&first, &second, 0.5, 1.0).unwrap();
            assert!(plane.normal.distance(normal) < 1e-4 && plane.point.length() < 1e-4, "{plane:?}");
            assert_eq!(plane.strength, 1.0);
            let other = limb_plane(&second, &first, 0.5, 1.0).unwrap();
            assert!(other.normal.distance(-normal) < 1e-4);
        }
    }

    #[test]
    fn what_is_far_looks_away_or_is_sunk_too_deep_has_no_plane() {
        let at = |z: f32, normal: Vec3| patch(normal, Vec3::Z * z);
        let first = at(0.0, Vec3::Z);
        assert_eq!(limb_plane(&first, &at(0.6, -Vec3::Z), 0.5, 1.0), None);
        assert_eq!(limb_plane(&first, &at(0.1, Vec3::Z), 0.5, 1.0), None);
        assert_eq!(limb_plane(&first, &at(-0.4, -Vec3::Z), 0.5, 0.3), None);
        let mut excluded = at(0.1, -Vec3::Z);
        excluded.iter_mut().for_each(|facet| facet.share = 0.0);
        assert_eq!(limb_plane(&first, &excluded, 0.5, 1.0), None);
        assert_eq!(limb_plane(&[], &first, 0.5, 1.0), None);
    }

    #[test]
    fn normals_without_a_common_direction_have_no_plane() {
        let ends = [patch(Vec3::X, -Vec3::X * 0.1), patch(-Vec3::X, Vec3::X * 0.1)].concat();
        let around = [patch(-Vec3::X, Vec3::ZERO), patch(Vec3::X, Vec3::ZERO)].concat();
        assert_eq!(limb_plane(&ends, &around, 0.5, 1.0), None);
    }
}
