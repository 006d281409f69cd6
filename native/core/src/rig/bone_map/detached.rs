//! Bones that hang on the root, though they belong to a limb: game rigs set the feet beside the legs,
//! so that a foot can stay where it stands. Where the limbs are a pair and names and tree say nothing
//! of what belongs to their ends, that is a pair too.

use super::by_name::Named;
use super::names::Side;
use super::{Entry, How};

/// What lies farther from the end of a limb than this many lengths of the limb does not belong to it.
const NEAR: f64 = 1.0;

/// A bone beside a limb.
struct Detached {
    /// It, or where it is a control, the first bone below it that is none.
    bone: usize,
    /// All bones of its branch.
    branch: Vec<usize>,
    /// Last bone of the limb.
    end: usize,
}

/// Pairs what belongs to limbs whose ends are a pair, where none of it has a counterpart yet.
pub(super) fn map_detached(source: &Named<'_>, target: &Named<'_>, entries: &mut [Entry]) {
    let theirs = detached(target);
    for own in detached(source) {
        if own.branch.iter().any(|&bone| !entries[bone].targets.is_empty()) {
            continue;
        }
        let at_end = &entries[own.end].targets;
        let is_free = |other: &&Detached| {
            let taken = |&bone: &usize| entries.iter().any(|entry| entry.targets.contains(&(bone as u32)));
            at_end.contains(&(other.end as u32)) && !other.branch.iter().any(taken)
        };
        if let Some(other) = theirs.iter().find(is_free) {
            entries[own.bone] = Entry { targets: vec![other.bone as u32], how: How::Structure };
        }
    }
}

/// Every such bone with the nearest end of a limb of its side, one bone to an end.
fn detached(named: &Named<'_>) -> Vec<Detached> {
    let (skeleton, labels) = (named.skeleton, &named.labels);
    let parents = skeleton.parents();
    let count = skeleton.bone_count();
    let is_control = |bone: usize| labels.get(bone as u32).is_some_and(|name| name.control);
    let side = |bone: usize| labels.side(bone as u32);
    let on_root = |bone: usize| parents[bone].is_none_or(|parent| parents[parent as usize].is_none());
    let up = |bone: usize| {
        std::iter::successors(Some(bone as u32), |&b| parents[b as usize]).map(|bone| bone as usize)
    };
    let mut tops: Vec<Detached> = Vec::new();
    for top in (0..count).filter(|&bone| side(bone) != Side::Middle && on_root(bone)) {
        let branch = skeleton.depth_order().iter().map(|&b| b as usize).filter(|&b| up(b).any(|a| a == top));
        let branch: Vec<usize> = branch.collect();
        // Controls alone, such as a pole, are no part of a limb.
        if let Some(&bone) = branch.iter().find(|&&bone| !is_control(bone)) {
            tops.push(Detached { bone, branch, end: top });
        }
    }
    let mut has_children = vec![false; count];
    parents.iter().flatten().for_each(|&parent| has_children[parent as usize] = true);
    let ends: Vec<usize> =
        (0..count).filter(|&b| !has_children[b] && !tops.iter().any(|top| top.branch.contains(&b))).collect();
    let mut near: Vec<(f64, usize, usize)> = Vec::new();
    for (at, top) in tops.iter().enumerate() {
        for &end in ends.iter().filter(|&&end| side(end) == side(top.end)) {
            let (head, tail) = (skeleton.heads()[top.end], skeleton.tails()[top.end]);
            let away = crate::rig::distance_to_segment(skeleton.tails()[end], head, tail);
            let limb: f64 = up(end).take_while(|&b| side(b) == side(end)).map(|b| skeleton.length(b)).sum();
            if away <= NEAR * limb {
                near.push((away, at, end));
            }
        }
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut end_of: Vec<Option<usize>> = vec![None; tops.len()];
    for (_, at, end) in near {
        if end_of[at].is_none() && !end_of.contains(&Some(end)) {
            end_of[at] = Some(end);
        }
    }
    tops.into_iter().zip(end_of).filter_map(|(top, end)| Some(Detached { end: end?, ..top })).collect()
}

#[cfg(test)]
mod tests {
    use super::super::map_bones;
    use crate::rig::Skeleton;
    use glam::DVec3;

    /// Hips on a root, two legs, and the feet beside them, in words of one rig or of another, where
    /// a control holds them, with poles in front of the knees.
    fn rig(words: [&str; 3], foot_away: f64, held: bool) -> Skeleton {
        let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
        let mut bones = vec![
            ("root".to_owned(), at(0.0, 0.0, 0.0), at(0.0, 0.0, 0.1), -1),
            ("hips".to_owned(), at(0.0, 0.0, 1.0), at(0.0, 0.0, 1.2), 0),
        ];
        for (x, side) in [(0.2, "L"), (-0.2, "R")] {
            let first = bones.len() as i64;
            let y = foot_away;
            bones.push((format!("{}.{side}", words[0]), at(x, 0.0, 1.0), at(x, 0.05, 0.5), 1));
            bones.push((format!("{}.{side}", words[1]), at(x, 0.05, 0.5), at(x, 0.0, 0.1), first));
            if held {
                bones.push((format!("IKleg.{side}"), at(x, y, 0.1), at(x, y, 0.05), -1));
                bones.push((format!("Pole.{side}"), at(x, 0.3, 0.5), at(x, 0.4, 0.5), 0));
            }
            let above = if held { first + 2 } else { 0 };
            bones.push((format!("{}.{side}", words[2]), at(x, y, 0.05), at(x, y - 0.2, 0.0), above));
        }
        let names = bones.iter().map(|bone| bone.0.clone()).collect();
        let parents: Vec<i64> = bones.iter().map(|bone| bone.3).collect();
        let points = |tail: bool| bones.iter().map(|b| if tail { b.2 } else { b.1 }).collect();
        Skeleton::new(points(false), points(true), &parents, Some(names)).unwrap()
    }

    fn partner(from: &Skeleton, to: &Skeleton, name: &str) -> Option<String> {
        let bone = from.names().unwrap().iter().position(|n| n == name).unwrap();
        let map = map_bones(from, to).unwrap();
        map.targets(bone).first().map(|&other| to.names().unwrap()[other as usize].clone())
    }

    #[test]
    fn feet_beside_legs_are_a_pair() {
        let one = rig(["thigh", "shin", "paw"], -0.1, false);
        let other = rig(["thigh", "shin", "claw"], 0.3, true);
        for side in ["L", "R"] {
            assert_eq!(partner(&one, &other, &format!("paw.{side}")), Some(format!("claw.{side}")));
            assert_eq!(partner(&other, &one, &format!("claw.{side}")), Some(format!("paw.{side}")));
            assert_eq!(partner(&other, &one, &format!("Pole.{side}")), None);
        }
    }

    #[test]
    fn what_is_far_from_every_limb_belongs_to_none() {
        let one = rig(["thigh", "shin", "paw"], -0.1, false);
        let other = rig(["thigh", "shin", "claw"], 5.0, true);
        assert_eq!(partner(&one, &other, "paw.L"), None);
    }
}
