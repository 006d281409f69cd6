//! Keeps bones of one side off the other: where a skeleton has a mirror plane, the weight of a bone
//! that has a mirror image fades out across the plane.
//!
//! Two collar bones, or two thighs, meet in the middle of a body, and a smooth falloff would let
//! each reach into the other's half.

use glam::DVec3;

use super::body::Body;
use super::labels::{Row, scale_to_one};
use super::skeleton_length;
use crate::rig::Skeleton;

/// A bone's mirror image may miss its partner by this share of the skeleton's length.
const TOLERANCE: f64 = 0.01;
/// Share of the bones that must have a mirror image, themselves included.
const MIRRORED: f64 = 0.75;
/// On each side of the plane a weight fades over this share of the character's length.
const FADE: f64 = 0.01;
/// Siblings fade over at most this share of the distance between them.
const NARROW: f64 = 0.1;
/// Where less than this would be left of a row, the row stays.
const SMALLEST_REST: f64 = 1e-3;

/// A plane: `normal · p = offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::rig) struct Plane {
    pub(in crate::rig) normal: DVec3,
    pub(in crate::rig) offset: f64,
}

impl Plane {
    pub(in crate::rig) fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.offset
    }

    pub(in crate::rig) fn mirrored(&self, point: DVec3) -> DVec3 {
        point - self.normal * (2.0 * self.height(point))
    }
}

/// What a bone keeps to: its side of a plane, 1 or -1, and how far it fades on each side.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Side {
    plane: Plane,
    sign: f64,
    width: f64,
}

/// Fades weights across the mirror plane of the bones that take part. Where they have none, as in
/// a character that is posed, siblings that are mirrored about their parent keep apart.
pub(super) fn keep_sides(body: &Body, rows: &mut [Row], skeleton: &Skeleton, takes_part: &[bool]) {
    let bones: Vec<(usize, [DVec3; 2])> = (0..takes_part.len())
        .filter(|&bone| takes_part[bone])
        .map(|bone| (bone, [body.heads[bone], body.tails[bone]]))
        .collect();
    let tolerance = TOLERANCE * skeleton_length(&body.heads, &body.tails, takes_part);
    let width = FADE * body.length;
    let sides = match mirror_plane(&bones, tolerance) {
        Some(plane) => mirrored_sides(plane, width, &bones, takes_part.len(), tolerance),
        None => sibling_sides(body, skeleton, &bones, width, tolerance),
    };
    if sides.iter().all(Option::is_none) {
        return;
    }
    for (row, &vertex) in rows.iter_mut().zip(body.mesh.vertices()) {
        let share = |bone: u32| {
            sides[bone as usize].map_or(1.0, |side| share(side.sign * side.plane.height(vertex) / side.width))
        };
        let faded = row.iter().map(|&(bone, weight)| (bone, weight * share(bone)));
        let mut faded: Row = faded.filter(|entry| entry.1 > 0.0).collect();
        if faded.iter().map(|entry| entry.1).sum::<f64>() > SMALLEST_REST {
            scale_to_one(&mut faded);
            *row = faded;
        }
    }
}

/// Side of a bone that lies wholly on one side of a plane.
fn side(plane: Plane, width: f64, ends: &[DVec3; 2]) -> Option<Side> {
    let heights = ends.map(|end| plane.height(end));
    (heights[0] * heights[1] > 0.0).then_some(Side { plane, sign: heights[0].signum(), width })
}

/// Sides of the bones (B) that have an image in the plane; a bone in the middle is its own.
fn mirrored_sides(
    plane: Plane,
    width: f64,
    bones: &[(usize, [DVec3; 2])],
    bone_count: usize,
    tolerance: f64,
) -> Vec<Option<Side>> {
    let mut sides = vec![None; bone_count];
    for (bone, ends) in bones {
        if image(&plane, ends, bones, tolerance).is_some_and(|partner| partner != *bone) {
            sides[*bone] = side(plane, width, ends);
        }
    }
    sides
}

/// Sides of the bones (B) that have a sibling of the same length, their parent being in the middle.
fn sibling_sides(
    body: &Body,
    skeleton: &Skeleton,
    bones: &[(usize, [DVec3; 2])],
    width: f64,
    tolerance: f64,
) -> Vec<Option<Side>> {
    let mut sides = vec![None; skeleton.bone_count()];
    for (bone, ends) in bones {
        let Some(parent) = skeleton.parents()[*bone] else { continue };
        let middle = [body.heads[parent as usize], body.tails[parent as usize]];
        let planes =
            bones.iter().filter(|(other, _)| other != bone && skeleton.parents()[*other] == Some(parent));
        let plane = planes
            .filter_map(|(_, other)| bisector(ends, other, tolerance))
            .find(|(plane, _)| middle.iter().all(|&end| plane.height(end).abs() < tolerance));
        sides[*bone] = plane.and_then(|(plane, gap)| side(plane, width.min(NARROW * gap), ends));
    }
    sides
}

/// The plane between the heads of two bones of one length, and the distance of the heads.
fn bisector(one: &[DVec3; 2], other: &[DVec3; 2], tolerance: f64) -> Option<(Plane, f64)> {
    let between = one[0] - other[0];
    let gap = between.length();
    let same_length = (one[0].distance(one[1]) - other[0].distance(other[1])).abs() < tolerance;
    (gap >= 4.0 * tolerance && same_length).then(|| {
        let normal = between / gap;
        (Plane { normal, offset: normal.dot((one[0] + other[0]) * 0.5) }, gap)
    })
}

/// 1 on the bone's own side, 0 on the other, smooth in between.
fn share(height: f64) -> f64 {
    let t = (0.5 + 0.5 * height).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// The plane between two bones of one length that most bones are mirrored in.
pub(in crate::rig) fn mirror_plane(bones: &[(usize, [DVec3; 2])], tolerance: f64) -> Option<Plane> {
    let mut best: Option<(usize, Plane)> = None;
    let mut tried: Vec<Plane> = Vec::new();
    for (i, (_, ends)) in bones.iter().enumerate() {
        for (_, other) in &bones[..i] {
            let Some((plane, _)) = bisector(ends, other, tolerance) else { continue };
            let is_known = |known: &Plane| {
                let turn = known.normal.dot(plane.normal);
                turn.abs() > 0.9999 && (known.offset * turn.signum() - plane.offset).abs() < 0.2 * tolerance
            };
            if plane.mirrored(ends[1]).distance(other[1]) > tolerance || tried.iter().any(is_known) {
                continue;
            }
            tried.push(plane);
            let count =
                bones.iter().filter(|(_, ends)| image(&plane, ends, bones, tolerance).is_some()).count();
            if best.is_none_or(|(most, _)| count > most) {
                best = Some((count, plane));
            }
        }
    }
    best.filter(|(count, _)| *count as f64 >= MIRRORED * bones.len() as f64).map(|(_, plane)| plane)
}

/// The bone that is nearest to the mirror image of a bone, within the tolerance.
fn image(plane: &Plane, ends: &[DVec3; 2], bones: &[(usize, [DVec3; 2])], tolerance: f64) -> Option<usize> {
    let [head, tail] = ends.map(|end| plane.mirrored(end));
    bones
        .iter()
        .map(|(bone, [h, t])| (*bone, h.distance(head).max(t.distance(tail))))
        .filter(|(_, miss)| *miss < tolerance)
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(bone, _)| bone)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_plane_of_a_spine_and_two_arms() {
        let turn = glam::DQuat::from_rotation_y(0.4);
        let at = |x: f64, z: f64| turn * DVec3::new(x, 0.0, z) + DVec3::new(0.3, 0.1, 0.2);
        let mut bones = vec![(0, [at(0.0, 0.0), at(0.0, 1.0)]), (1, [at(0.0, 1.0), at(0.0, 1.5)])];
        for side in [1.0, -1.0] {
            bones.push((bones.len(), [at(0.1 * side, 1.4), at(0.5 * side, 1.3)]));
            bones.push((bones.len(), [at(0.5 * side, 1.3), at(0.9 * side, 1.1)]));
        }
        let plane = mirror_plane(&bones, 0.01).unwrap();
        assert!((plane.normal.dot(turn * DVec3::X).abs() - 1.0).abs() < 1e-9);
        assert!(plane.height(at(0.0, 0.7)).abs() < 1e-9);
        bones.truncate(3);
        assert_eq!(mirror_plane(&bones, 0.01), None, "one arm has no image");
    }

    #[test]
    fn weights_fade_across_the_plane() {
        assert_eq!([share(-1.0), share(1.0), share(0.0), share(-9.0)], [0.0, 1.0, 0.5, 0.0]);
        assert!((share(0.5) + share(-0.5) - 1.0).abs() < 1e-12 && share(0.5) > 0.5);
    }
}
