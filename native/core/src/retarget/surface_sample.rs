//! Places that stand for all vertices of a large surface where a fit needs many closest points.
//!
//! A fit of some hundred unknowns gains nothing from a hundred thousand points. Beyond
//! [`ALL_UP_TO`] vertices each group of them (those of a bone, or the whole surface) is therefore
//! thinned to about one vertex for each cell of a grid, and counts for all vertices of its cell. The
//! grid stands in a frame of the skeleton, so that the choice depends on the place of the vertices
//! on the character alone: neither on their order nor on where the character stands and how large
//! it is.

use glam::{DMat3, DVec3, I64Vec3};

use crate::mesh::TriangleMesh;
use crate::rig::Skeleton;

/// Surfaces with up to this many vertices are taken as they are.
const ALL_UP_TO: usize = 20_000;
/// Where the frame's origin lies in its cell: off every plane of symmetry.
const OFF_CENTRE: DVec3 = DVec3::new(0.37, 0.41, 0.29);
/// Cells that a surface crosses for each square of a cell's side.
const CROSSED: f64 = 1.5;

/// A vertex and the number of vertices that it stands for, itself among them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    pub(super) vertex: u32,
    pub(super) count: f64,
}

/// Samples of a surface, ascending: all vertices that have a group, or, of a large surface, about
/// `most` of each group. `skeleton` is the surface's own.
pub(super) fn samples(
    mesh: &TriangleMesh,
    skeleton: &Skeleton,
    group: impl Fn(usize) -> Option<u32>,
    most: usize,
) -> Vec<Sample> {
    samples_beyond(ALL_UP_TO, mesh, skeleton, group, most)
}

fn samples_beyond(
    all_up_to: usize,
    mesh: &TriangleMesh,
    skeleton: &Skeleton,
    group: impl Fn(usize) -> Option<u32>,
    most: usize,
) -> Vec<Sample> {
    let groups: Vec<Option<u32>> = (0..mesh.vertex_count()).map(group).collect();
    let with_group = (0u32..).zip(&groups).filter_map(|(vertex, group)| Some((vertex, (*group)?)));
    if mesh.vertex_count() <= all_up_to {
        return with_group.map(|(vertex, _)| Sample { vertex, count: 1.0 }).collect();
    }
    let cells = cells(mesh, &groups, most);
    let (origin, axes) = frame(skeleton);
    let to_frame = axes.transpose();
    let mut placed: Vec<(u32, [i64; 3], f64, u32)> = with_group
        .map(|(vertex, group)| {
            let Some(cell) = cells[group as usize] else {
                return (group, [i64::from(vertex), 0, 0], 0.0, vertex);
            };
            let at = to_frame * (mesh.vertices()[vertex as usize] - origin) / cell + OFF_CENTRE;
            let corner = at.floor();
            let off_middle = (at - corner).distance_squared(DVec3::splat(0.5));
            (
                group,
                I64Vec3::new(corner.x as i64, corner.y as i64, corner.z as i64).to_array(),
                off_middle,
                vertex,
            )
        })
        .collect();
    placed.sort_unstable_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)).then(a.3.cmp(&b.3)));
    let mut samples: Vec<Sample> = placed
        .chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
        .map(|cell| Sample { vertex: cell[0].3, count: cell.len() as f64 })
        .collect();
    samples.sort_unstable_by_key(|sample| sample.vertex);
    samples
}

/// Side of the cells of every group; `None` for a group that is small enough as it is.
fn cells(mesh: &TriangleMesh, groups: &[Option<u32>], most: usize) -> Vec<Option<f64>> {
    let count = groups.iter().flatten().max().map_or(0, |&last| last as usize + 1);
    let (mut members, mut areas) = (vec![0usize; count], vec![0.0; count]);
    groups.iter().flatten().for_each(|&group| members[group as usize] += 1);
    for (t, triangle) in mesh.triangles().iter().enumerate() {
        let share = mesh.area_vector(t).length() / 6.0;
        for group in triangle.iter().filter_map(|&v| groups[v as usize]) {
            areas[group as usize] += share;
        }
    }
    let side = |(members, area): (usize, f64)| {
        (members > most && area > 0.0).then(|| (CROSSED * area / most as f64).sqrt())
    };
    members.into_iter().zip(areas).map(side).collect()
}

/// A frame that moves with the skeleton: the middle of its joints, the way to the joint that lies
/// farthest from it, and the way to the one that lies farthest off that axis. Of joints that are
/// equally far the first counts.
fn frame(skeleton: &Skeleton) -> (DVec3, DMat3) {
    const TIE: f64 = 1e-6;
    let joints = || skeleton.heads().iter().chain(skeleton.tails()).copied();
    let middle = joints().sum::<DVec3>() / (2 * skeleton.bone_count()).max(1) as f64;
    let farthest = |off: &dyn Fn(DVec3) -> DVec3| {
        joints().map(|joint| off(joint - middle)).fold(DVec3::ZERO, |best, offset| {
            if offset.length() > (1.0 + TIE) * best.length() { offset } else { best }
        })
    };
    let first = farthest(&|offset| offset).try_normalize().unwrap_or(DVec3::Z);
    let second = farthest(&|offset| offset.reject_from_normalized(first));
    let second = second.try_normalize().unwrap_or_else(|| first.any_orthonormal_vector());
    (middle, DMat3::from_cols(first, second, first.cross(second)))
}

#[cfg(test)]
mod tests {
    use super::super::test_surfaces::{mapped, permuted, similarity, tube};
    use super::*;

    fn limb() -> (TriangleMesh, Skeleton) {
        let ends = [DVec3::ZERO, DVec3::new(0.1, 0.0, 1.5), DVec3::new(0.0, 0.2, 3.0)];
        let skeleton = Skeleton::new(ends[..2].to_vec(), ends[1..].to_vec(), &[-1, 0], None);
        // Turned off the grid, so that no cell's border runs along a row of vertices.
        let turn = glam::DQuat::from_axis_angle(DVec3::new(0.3, 0.5, -0.8).normalize(), 0.4);
        (mapped(&tube(0.4, 3.0, 40, 100), |p| turn * p), skeleton.unwrap())
    }

    fn of_half(mesh: &TriangleMesh) -> impl Fn(usize) -> Option<u32> {
        let upper: Vec<u32> = mesh.vertices().iter().map(|p| u32::from(p.length() > 1.5)).collect();
        move |v| Some(upper[v])
    }

    #[test]
    fn every_group_is_thinned_evenly_and_counts_as_before() {
        let (mesh, skeleton) = limb();
        let found = samples_beyond(100, &mesh, &skeleton, of_half(&mesh), 200);
        assert!(found.len() > 250 && found.len() < 600, "{}", found.len());
        let total: f64 = found.iter().map(|sample| sample.count).sum();
        assert_eq!(total, mesh.vertex_count() as f64);
        let near = |p: DVec3| {
            let distances = found.iter().map(|s| mesh.vertices()[s.vertex as usize].distance(p));
            distances.fold(f64::INFINITY, f64::min)
        };
        assert!(mesh.vertices().iter().all(|&p| near(p) < 0.3));
    }

    #[test]
    fn small_surfaces_and_small_groups_are_taken_whole() {
        let (mesh, skeleton) = limb();
        let few = |v: usize| (v < 50).then_some(0);
        let all = samples(&mesh, &skeleton, few, 10);
        assert_eq!(all.len(), 50);
        assert!(all.iter().enumerate().all(|(v, s)| *s == Sample { vertex: v as u32, count: 1.0 }));
        assert_eq!(samples_beyond(100, &mesh, &skeleton, few, 50), all);
    }

    #[test]
    fn neither_order_nor_place_nor_scale_matters() {
        let (mesh, skeleton) = limb();
        let found = samples_beyond(100, &mesh, &skeleton, of_half(&mesh), 200);
        let (shuffled, new) = permuted(&mesh);
        let mut again = samples_beyond(100, &shuffled, &skeleton, of_half(&shuffled), 200);
        let mut expected: Vec<Sample> =
            found.iter().map(|s| Sample { vertex: new[s.vertex as usize], ..*s }).collect();
        again.sort_unstable_by_key(|sample| sample.vertex);
        expected.sort_unstable_by_key(|sample| sample.vertex);
        assert_eq!(again, expected);
        for scale in [1e-2, 1e2] {
            let motion = similarity(scale);
            let moved = mapped(&mesh, |p| motion.transform_point3(p));
            let carry = |points: &[DVec3]| points.iter().map(|&p| motion.transform_point3(p)).collect();
            let turned = skeleton.placed(carry(skeleton.heads()), carry(skeleton.tails()));
            assert_eq!(samples_beyond(100, &moved, &turned, of_half(&mesh), 200), found);
        }
    }
}
