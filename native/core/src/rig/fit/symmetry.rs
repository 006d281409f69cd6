//! Mirror symmetry of template and mesh.

use glam::DVec3;
use rayon::prelude::*;

use super::joints::{Joints, bounds};
use crate::mesh::{SurfaceQuery, TriangleMesh};
use crate::rig::Skeleton;
use crate::rig::bind::{Plane, mirror_plane};

/// A joint's mirror image may miss its partner by this share of the template's size.
const TOLERANCE: f64 = 0.01;
/// A mirrored point of the mesh may miss the surface by this share of the mesh's size.
const MISS: f64 = 0.012;
/// Share of the points that must not miss it by more.
const MIRRORED: f64 = 0.9;
/// Points of the mesh to look at, and steps of the search for the plane.
const SAMPLES: usize = 1200;
const STEPS: usize = 12;

/// The template's mirror plane and partners of joints.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TemplateMirror {
    pub(super) plane: Plane,
    /// Partner of each joint (J): itself in the middle, `None` without one.
    pub(super) partner: Vec<Option<usize>>,
}

impl TemplateMirror {
    /// Finds the plane that most bones of the body are mirrored in.
    pub(super) fn new(template: &Skeleton, joints: &Joints, body_bones: &[bool]) -> Option<Self> {
        let ends = |bone: usize| [template.heads()[bone], template.tails()[bone]];
        let bones: Vec<(usize, [DVec3; 2])> =
            (0..body_bones.len()).filter(|&b| body_bones[b]).map(|b| (b, ends(b))).collect();
        let (low, high) = bounds(bones.iter().flat_map(|bone| bone.1));
        let tolerance = TOLERANCE * (high - low).max_element();
        let plane = mirror_plane(&bones, tolerance)?;
        let partner = joints
            .points
            .iter()
            .map(|&point| {
                let image = plane.mirrored(point);
                (0..joints.points.len())
                    .map(|j| (j, joints.points[j].distance(image)))
                    .filter(|(_, miss)| *miss < tolerance)
                    .min_by(|a, b| a.1.total_cmp(&b.1))
                    .map(|(j, _)| j)
            })
            .collect::<Vec<_>>();
        // Partners must be each other's.
        let mutual = |j: usize| partner[j].filter(|&p| partner[p] == Some(j));
        let partner = (0..partner.len()).map(mutual).collect();
        Some(Self { plane, partner })
    }
}

/// The plane across `normal` that a mesh is mirrored in, if there is one.
pub(super) fn mesh_mirror(mesh: &TriangleMesh, normal: DVec3) -> Option<Plane> {
    let (low, high) = mesh.bounds();
    let size = (high - low).max_element();
    let query = SurfaceQuery::new(mesh).ok()?;
    let every = mesh.vertex_count().div_ceil(SAMPLES).max(1);
    let points: Vec<DVec3> = mesh.vertices().iter().copied().step_by(every).collect();
    let heights = mesh.vertices().iter().map(|v| normal.dot(*v));
    let (least, most) =
        heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), h| (low.min(h), high.max(h)));
    let mut plane = Plane { normal, offset: 0.5 * (least + most) };
    let misses = |plane: &Plane| -> Vec<(f64, f64)> {
        points
            .par_iter()
            .filter_map(|&point| {
                let image = plane.mirrored(point);
                let found = query.closest_point(image)?;
                Some((found.distance, normal.dot(found.position - image)))
            })
            .collect()
    };
    for _ in 0..STEPS {
        // A plane that is off by a step mirrors to twice the step; the median ignores what has no image.
        let mut steps: Vec<f64> = misses(&plane).into_iter().map(|(_, along)| along).collect();
        steps.retain(|along| along.abs() > 1e-3 * MISS * size);
        if steps.len() * 4 < points.len() {
            break;
        }
        steps.sort_by(f64::total_cmp);
        plane.offset += 0.5 * steps[steps.len() / 2];
    }
    let good = misses(&plane).iter().filter(|(distance, _)| *distance <= MISS * size).count();
    (good as f64 >= MIRRORED * points.len() as f64).then_some(plane)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::fit::test_bodies::{bone, figure, skeleton, tubes};

    #[test]
    fn left_and_right_joints_are_partners() {
        let template = skeleton();
        let joints = Joints::new(&template);
        let mirror = TemplateMirror::new(&template, &joints, &vec![true; template.bone_count()]).unwrap();
        let head = |name: &str| joints.heads[bone(&template, name)];
        assert_eq!(mirror.partner[head("calf_l")], Some(head("calf_r")));
        assert_eq!(mirror.partner[head("neck")], Some(head("neck")));
    }

    #[test]
    fn the_plane_of_a_mesh_is_found_where_it_is() {
        let figure = figure(0.5);
        let step = DVec3::new(0.37, 0.1, 0.0);
        let moved = figure.vertices().iter().map(|&v| v + step).collect();
        let moved = TriangleMesh::new(moved, figure.triangles().to_vec()).unwrap();
        let plane = mesh_mirror(&moved, DVec3::X).unwrap();
        assert!((plane.offset - 0.37).abs() < 0.005, "{}", plane.offset);
        let bent = tubes(&[(DVec3::ZERO, DVec3::Z, 0.1), (DVec3::Z, DVec3::new(0.8, 0.0, 1.2), 0.1)]);
        assert_eq!(mesh_mirror(&bent, DVec3::X), None);
    }
}
