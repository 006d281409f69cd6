//! Targets that are mirror images, such as an object with a negative scale: left bones lie on the right, and
//! no motion brings the source there. Their own mirror image gets the weights instead.

use glam::DVec3;

use super::similarity::{Pair, fit};
use super::{RetargetError, auto::mesh_error};
use crate::mesh::TriangleMesh;
use crate::rig::{BoneMap, Skeleton};

/// A target is a mirror image where that image fits the source's bones by this factor better. Between rigs that
/// place their bones differently, and between poses, both fit alike; such a target is taken as it is.
const BETTER: f64 = 0.5;
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
    if pairs.len() < LEAST_BONES || !is_mirrored(mesh, &pairs, from, to) {
        return Ok(None);
    }
    let reflected = |points: &[DVec3]| points.iter().map(|&point| reflect(point)).collect::<Vec<_>>();
    let triangles = mesh.triangles().iter().map(|&[a, b, c]| [a, c, b]).collect();
    let mesh = TriangleMesh::new(reflected(mesh.vertices()), triangles);
    let skeleton = to.placed(reflected(to.heads()), reflected(to.tails()));
    Ok(Some((mesh.map_err(|error| mesh_error("target", error))?, skeleton)))
}

fn is_mirrored(mesh: &TriangleMesh, pairs: &[(usize, usize)], from: &Skeleton, to: &Skeleton) -> bool {
    let ends = |skeleton: &Skeleton, bone: usize| [skeleton.heads()[bone], skeleton.tails()[bone]];
    let error = |place: fn(DVec3) -> DVec3| {
        let of_bone = |&(a, b): &(usize, usize)| {
            let (a, b) = (ends(from, a), ends(to, b));
            [0, 1].map(|end| (a[end], place(b[end]), 1.0))
        };
        let points: Vec<Pair> = pairs.iter().flat_map(of_bone).collect();
        fit(&points, &mut [])
    };
    let own = error(|point| point);
    let (low, high) = mesh.bounds();
    own > FITS * low.distance(high) && error(reflect) < BETTER * own
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
