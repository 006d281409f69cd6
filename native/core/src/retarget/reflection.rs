//! Targets that are mirror images, such as an object with a negative scale: left bones lie on the right, and
//! no motion brings the source there. Their own mirror image gets the weights instead.
//!
//! Where bones lie tells it between rigs that place them alike. Between others, and between poses, it is told by
//! how far neighbouring bones turn against each other on the way from the source: in a pose a little at each joint,
//! in a mirror image half way round at hips, shoulders and hands, whose left and right have changed places.

use glam::{DQuat, DVec3};

use super::bone_rotations::bone_rotations;
use super::similarity::{Pair, fit};
use super::{RetargetError, auto::mesh_error};
use crate::mesh::TriangleMesh;
use crate::rig::{BoneMap, Skeleton};

/// A target is a mirror image where that image fits the source's bones by this factor better,
const BETTER: f64 = 0.5;
/// or where its joints turn by this factor less. A target of which neither is true is taken as it is.
const TURNS_LESS: f64 = 0.6;
/// Bones that fit to this share of the extent need no image: those in a plane are their own.
const FITS: f64 = 1e-3;
/// Bones that tell it, at least.
const LEAST_BONES: usize = 4;

/// Mesh and skeleton of the target's mirror image, where that is what resembles the source.
///
/// # Errors
/// [`RetargetError::Mesh`] where the mesh overflows.
pub(super) fn mirror_image(
    mesh: &TriangleMesh,
    (from, to): (&Skeleton, &Skeleton),
    bone_map: &BoneMap,
    carries_weight: &[bool],
) -> Result<Option<(TriangleMesh, Skeleton)>, RetargetError> {
    let pairs = (0..from.bone_count()).filter(|&bone| carries_weight[bone]);
    let pairs: Vec<(usize, usize)> = pairs
        .filter_map(|bone| match bone_map.targets(bone) {
            [target] => Some((bone, *target as usize)),
            _ => None,
        })
        .collect();
    if pairs.len() < LEAST_BONES {
        return Ok(None);
    }
    let reflected = |points: &[DVec3]| points.iter().map(|&point| reflect(point)).collect::<Vec<_>>();
    let skeleton = to.placed(reflected(to.heads()), reflected(to.tails()));
    let (own, of_image) = (misfit(&pairs, from, to), misfit(&pairs, from, &skeleton));
    let (low, high) = mesh.bounds();
    if own <= FITS * low.distance(high) || own < BETTER * of_image {
        return Ok(None);
    }
    let turns = |to: &Skeleton| {
        Ok::<_, RetargetError>(turns(from, &bone_map.aligned_skeleton(from, to)?, carries_weight))
    };
    if of_image >= BETTER * own && turns(&skeleton)? >= TURNS_LESS * turns(to)? {
        return Ok(None);
    }
    let triangles = mesh.triangles().iter().map(|&[a, b, c]| [a, c, b]).collect();
    let mesh = TriangleMesh::new(reflected(mesh.vertices()), triangles);
    Ok(Some((mesh.map_err(|error| mesh_error("target", error))?, skeleton)))
}

/// How far apart bones stay when one skeleton is moved onto the other.
fn misfit(pairs: &[(usize, usize)], from: &Skeleton, to: &Skeleton) -> f64 {
    let ends = |skeleton: &Skeleton, bone: usize| [skeleton.heads()[bone], skeleton.tails()[bone]];
    let of_bone = |&(a, b): &(usize, usize)| {
        let (a, b) = (ends(from, a), ends(to, b));
        [0, 1].map(|end| (a[end], b[end], 1.0))
    };
    let points: Vec<Pair> = pairs.iter().flat_map(of_bone).collect();
    fit(&points, &mut [])
}

/// Root mean square turn of a bone against its parent, in radians, on the way to `aligned`.
fn turns(from: &Skeleton, aligned: &Skeleton, takes_part: &[bool]) -> f64 {
    let rotations = bone_rotations(from, aligned, takes_part);
    let bones = (0..takes_part.len()).filter(|&bone| takes_part[bone]);
    let joints = bones.filter_map(|bone| Some((bone, from.parents()[bone]? as usize)));
    let turns: Vec<f64> = joints
        .filter(|&(_, parent)| takes_part[parent])
        .map(|(bone, parent)| {
            let turn = DQuat::from_mat3(&(rotations[bone] * rotations[parent].transpose()));
            2.0 * libm::acos(turn.w.abs().min(1.0))
        })
        .collect();
    (turns.iter().map(|turn| turn * turn).sum::<f64>() / turns.len().max(1) as f64).sqrt()
}

fn reflect(point: DVec3) -> DVec3 {
    DVec3::new(-point.x, point.y, point.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::test_surfaces::{icosphere, similarity};
    use crate::rig::map_bones;

    /// A trunk, two arms and two feet that point forwards, by name.
    fn skeleton(place: impl Fn(DVec3) -> DVec3) -> Skeleton {
        let names = ["hips", "arm_l", "arm_r", "foot_l", "foot_r"].map(str::to_owned).to_vec();
        let heads = [[0.0, 0.0, 1.0], [0.2, 0.0, 1.4], [-0.2, 0.0, 1.4], [0.1, 0.0, 0.1], [-0.1, 0.0, 0.1]];
        let tails =
            [[0.0, 0.05, 1.5], [0.9, 0.05, 1.3], [-0.9, 0.05, 1.3], [0.1, -0.25, 0.0], [-0.1, -0.25, 0.0]];
        let [heads, tails] =
            [heads, tails].map(|ends| ends.map(|end| place(DVec3::from_array(end))).to_vec());
        Skeleton::new(heads, tails, &[-1, 0, 0, 0, 0], Some(names)).unwrap()
    }

    #[test]
    fn a_mirror_image_is_turned_back_and_nothing_else_is() {
        let from = skeleton(|p| p);
        let taller = |p: DVec3| p * DVec3::new(0.97, 1.0, 1.05);
        let motion = similarity(3.0);
        let moved = |p: DVec3| motion.transform_point3(taller(p));
        let mesh = icosphere(1);
        let image = |to: &Skeleton| {
            let bone_map = map_bones(&from, to).unwrap();
            mirror_image(&mesh, (&from, to), &bone_map, &[true; 5]).unwrap()
        };
        assert!(image(&skeleton(moved)).is_none());
        let (turned_back, bones) = image(&skeleton(|p| reflect(moved(p)))).unwrap();
        assert_eq!(bones, skeleton(moved));
        assert_eq!(turned_back.vertices()[3], reflect(mesh.vertices()[3]));
        let corner = |v: u32| turned_back.vertices()[v as usize];
        let volume = |&[a, b, c]: &[u32; 3]| corner(a).dot(corner(b).cross(corner(c)));
        assert!(turned_back.triangles().iter().map(volume).sum::<f64>() > 0.0, "they still face outwards");
    }

    /// Children of a hip, a chest and two hands, each turned about its parent's end by some degrees.
    fn posed(degrees: f64, place: impl Fn(DVec3) -> DVec3) -> Skeleton {
        const PARENTS: [i64; 11] = [-1, 0, 1, 1, 2, 2, 3, 3, 0, 0, 0];
        let ends = [
            [[0.0, 0.0, 1.0], [0.0, 0.0, 1.2]],
            [[0.0, 0.0, 1.2], [0.0, 0.02, 1.5]],
            [[0.2, 0.0, 1.4], [0.7, 0.05, 1.4]],
            [[-0.2, 0.0, 1.4], [-0.7, 0.05, 1.4]],
            [[0.72, -0.04, 1.38], [0.8, -0.1, 1.35]],
            [[0.74, 0.05, 1.4], [0.84, 0.06, 1.4]],
            [[-0.72, -0.04, 1.38], [-0.8, -0.1, 1.35]],
            [[-0.74, 0.05, 1.4], [-0.84, 0.06, 1.4]],
            [[0.1, 0.0, 0.95], [0.1, -0.05, 0.1]],
            [[-0.1, 0.0, 0.95], [-0.1, -0.05, 0.1]],
            [[0.0, 0.1, 1.0], [0.0, 0.3, 0.9]],
        ]
        .map(|ends| ends.map(DVec3::from_array));
        let mut moves = vec![glam::DAffine3::IDENTITY; ends.len()];
        for (bone, &parent) in PARENTS.iter().enumerate().filter(|(_, parent)| **parent >= 0) {
            let axis = DVec3::new(0.3 + bone as f64, 4.0 - bone as f64, 2.0).normalize();
            let joint = ends[bone][0];
            let turn = glam::DAffine3::from_translation(joint)
                * glam::DAffine3::from_axis_angle(axis, degrees.to_radians())
                * glam::DAffine3::from_translation(-joint);
            moves[bone] = moves[parent as usize] * turn;
        }
        let at =
            |end: usize| ends.iter().zip(&moves).map(|(b, m)| place(m.transform_point3(b[end]))).collect();
        let names = (0..ends.len()).map(|bone| format!("bone {bone}")).collect();
        Skeleton::new(at(0), at(1), &PARENTS, Some(names)).unwrap()
    }

    #[test]
    fn a_mirror_image_in_another_pose_is_turned_back_and_the_pose_alone_is_not() {
        let from = posed(0.0, |p| p);
        let motion = similarity(0.1);
        let is_image = |degrees: f64, place: &dyn Fn(DVec3) -> DVec3| {
            let to = posed(degrees, |p| motion.transform_point3(place(p)));
            let bone_map = map_bones(&from, &to).unwrap();
            mirror_image(&icosphere(1), (&from, &to), &bone_map, &[true; 11]).unwrap().is_some()
        };
        for degrees in [0.0, 15.0, -30.0, 30.0] {
            assert!(!is_image(degrees, &|p| p), "{degrees}");
            assert!(is_image(degrees, &reflect), "{degrees}");
        }
    }

    #[test]
    fn a_few_bones_or_flat_ones_tell_nothing() {
        let from = skeleton(|p| p);
        let mirrored = skeleton(reflect);
        let bone_map = map_bones(&from, &mirrored).unwrap();
        let few = [true, true, true, false, false];
        assert!(mirror_image(&icosphere(1), (&from, &mirrored), &bone_map, &few).unwrap().is_none());
        let flat = |p: DVec3| DVec3::new(p.x, 0.0, p.z);
        let (from, to) = (skeleton(flat), skeleton(|p| reflect(flat(p))));
        assert!(mirror_image(&icosphere(1), (&from, &to), &bone_map, &[true; 5]).unwrap().is_none());
    }
}
