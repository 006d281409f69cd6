//! Pairs of bones found by their place in the tree and in space: what names left over, or all of
//! two skeletons whose names have nothing in common.

use glam::DMat3;

use super::by_name::Named;
use super::chain::shared_stretches;
use super::frame::{Placed, best_rotation, candidate_rotations};
use super::likeness::{Mirror, View, unlikeness};
use super::tree_edit::{LEFT_OUT, NEVER, Tree, match_trees};
use super::{Entry, How};
use crate::rig::Skeleton;

/// Pairs that names give tell how the skeletons lie only when there are at least this many.
const ENOUGH_PAIRS: usize = 4;

/// What any other rotation than none has to gain for each bone to be believed.
const TURNED: f64 = 0.02;

/// Bones in order may be this much less alike, for each bone, than the likest ones.
const IN_ORDER: f64 = 0.1;

/// Gives counterparts to bones that have none.
pub(super) fn map_the_rest(source: &Named<'_>, target: &Named<'_>, entries: &mut [Entry]) {
    let (from, to) = (source.skeleton, target.skeleton);
    if from.bone_count() == 0 || to.bone_count() == 0 {
        return;
    }
    let known: Vec<(usize, usize)> =
        (0..entries.len()).filter_map(|i| entries[i].targets.first().map(|&j| (i, j as usize))).collect();
    let nearest = nearest_known(from, to, entries);
    let rotations = match rotation_of(from, to, &known) {
        Some(rotation) => vec![rotation],
        None => candidate_rotations(from, to),
    };
    let mut best: Option<(f64, Vec<(u32, u32)>)> = None;
    for (at, &rotation) in rotations.iter().enumerate() {
        let placed = Placed::new(from, DMat3::IDENTITY);
        let turned = Placed::new(to, rotation);
        let mirrors = Mirror::of_both(Mirror::new(source, &placed), Mirror::new(target, &turned));
        let seen = View::new(source, placed, mirrors[0]);
        let other = View::new(target, turned, mirrors[1]);
        let cost = |i: usize, j: usize| pair_cost(&seen, &other, entries, &nearest, i, j);
        let tree = |skeleton: &Skeleton| Tree::new(skeleton.parents(), skeleton.depth_order());
        let (mut pairs, mut total) = match_trees(&tree(from), &tree(to), &cost);
        if known.is_empty() && from.parents() == to.parents() {
            let in_order: f64 = (0..entries.len()).map(|i| cost(i, i).min(1.0)).sum();
            if in_order <= total + IN_ORDER * entries.len() as f64 {
                pairs = (0..entries.len() as u32).map(|i| (i, i)).collect();
                total = in_order.min(total);
            }
        }
        total += if at == 0 { 0.0 } else { TURNED * entries.len() as f64 };
        if best.as_ref().is_none_or(|found| total < found.0) {
            best = Some((total, pairs));
        }
    }
    let pairs = best.map_or_else(Vec::new, |found| found.1);
    let mut added = vec![false; entries.len()];
    for (i, j) in pairs {
        let entry = &mut entries[i as usize];
        if entry.targets.is_empty() {
            *entry = Entry { targets: vec![j], how: How::Structure };
            added[i as usize] = true;
        }
    }
    even_out_chains(from, to, entries, &added);
}

/// Rotation that takes the target's pairs to the source's, from enough of them.
fn rotation_of(from: &Skeleton, to: &Skeleton, known: &[(usize, usize)]) -> Option<DMat3> {
    if known.len() < ENOUGH_PAIRS {
        return None;
    }
    let (a, b) = (Placed::new(from, DMat3::IDENTITY), Placed::new(to, DMat3::IDENTITY));
    let count = known.len() as f64;
    let middle_a = known.iter().map(|&(i, _)| a.heads[i]).sum::<glam::DVec3>() / count;
    let middle_b = known.iter().map(|&(_, j)| b.heads[j]).sum::<glam::DVec3>() / count;
    let pairs: Vec<_> = known.iter().map(|&(i, j)| (a.heads[i] - middle_a, b.heads[j] - middle_b)).collect();
    best_rotation(&pairs)
}

/// For each bone of either skeleton the nearest bone at or above its parent that has a counterpart.
struct Nearest {
    source: Vec<Option<u32>>,
    target: Vec<Option<u32>>,
    taken: Vec<bool>,
}

fn nearest_known(from: &Skeleton, to: &Skeleton, entries: &[Entry]) -> Nearest {
    let mut taken = vec![false; to.bone_count()];
    for &target in entries.iter().flat_map(|entry| &entry.targets) {
        taken[target as usize] = true;
    }
    let above = |skeleton: &Skeleton, known: &dyn Fn(u32) -> bool| {
        let parents = skeleton.parents();
        let find =
            |parent: Option<u32>| std::iter::successors(parent, |&b| parents[b as usize]).find(|&b| known(b));
        parents.iter().map(|&parent| find(parent)).collect()
    };
    let source = above(from, &|b| !entries[b as usize].targets.is_empty());
    let target = above(to, &|b| taken[b as usize]);
    Nearest { source, target, taken }
}

fn pair_cost(
    seen: &View<'_>,
    other: &View<'_>,
    entries: &[Entry],
    nearest: &Nearest,
    i: usize,
    j: usize,
) -> f64 {
    if let Some(&partner) = entries[i].targets.first() {
        return if partner as usize == j { 0.0 } else { NEVER };
    }
    if nearest.taken[j] || (seen.is_known(i) && other.is_known(j)) {
        return NEVER;
    }
    let anchors = match (nearest.source[i], nearest.target[j]) {
        (Some(a), Some(b)) if entries[a as usize].targets.contains(&b) => Some((a as usize, b as usize)),
        (None, None) => None,
        _ => return NEVER,
    };
    let cost = unlikeness((seen, i), (other, j), anchors);
    // Among bones that have names, only what lies close together is believed.
    if anchors.is_some() && cost > LEFT_OUT { NEVER } else { cost }
}

/// Gives limbs of different length to each other by arc length. A limb starts below a bone where
/// branches part and ends at the next such bone or at its tip; only limbs found by structure
/// are touched.
fn even_out_chains(from: &Skeleton, to: &Skeleton, entries: &mut [Entry], added: &[bool]) {
    let mapped: Vec<bool> = entries.iter().map(|entry| !entry.targets.is_empty()).collect();
    let up = |bone: u32| {
        std::iter::successors(from.parents()[bone as usize], |&b| from.parents()[b as usize])
            .find(|&b| mapped[b as usize])
    };
    let mut next: Vec<Vec<u32>> = vec![vec![]; entries.len()];
    for bone in (0..entries.len() as u32).filter(|&b| mapped[b as usize]) {
        if let Some(above) = up(bone) {
            next[above as usize].push(bone);
        }
    }
    let goes_on = |bone: u32| match next[bone as usize][..] {
        [only] if added[bone as usize] && added[only as usize] => Some(only),
        _ => None,
    };
    let starts = (0..entries.len() as u32)
        .filter(|&b| added[b as usize] && up(b).is_none_or(|above| goes_on(above) != Some(b)));
    let limbs: Vec<Vec<u32>> =
        starts.map(|start| std::iter::successors(Some(start), |&b| goes_on(b)).collect()).collect();
    let taken: Vec<bool> = {
        let mut taken = vec![false; to.bone_count()];
        entries.iter().flat_map(|entry| &entry.targets).for_each(|&t| taken[t as usize] = true);
        taken
    };
    for limb in limbs {
        let (first, last) = (limb[0], limb[limb.len() - 1]);
        let [first_target, last_target] = [first, last].map(|b| entries[b as usize].targets[0]);
        let is_end = next[last as usize].is_empty();
        let own = run(from, first, last, is_end, &|b| mapped[b as usize]);
        let theirs = run(to, first_target, last_target, is_end, &|b| taken[b as usize]);
        if own.len() == limb.len() && theirs.len() == limb.len() {
            continue;
        }
        for (&bone, targets) in own.iter().zip(shared_stretches((from, &own), (to, &theirs))) {
            entries[bone as usize] = Entry { targets, how: How::Structure };
        }
    }
}

/// Bones of a limb from the bones above its first that no other limb has down to its last, and on
/// to the tip where the limb ends there.
fn run(
    skeleton: &Skeleton,
    first: u32,
    last: u32,
    to_the_tip: bool,
    known: &dyn Fn(u32) -> bool,
) -> Vec<u32> {
    let parents = skeleton.parents();
    let children = |bone: u32| {
        let all: Vec<u32> =
            (0..parents.len() as u32).filter(|&b| parents[b as usize] == Some(bone)).collect();
        all
    };
    let mut bones: Vec<u32> = Vec::new();
    let mut current = Some(last);
    while let Some(bone) = current {
        bones.push(bone);
        current = if bone == first { None } else { parents[bone as usize] };
    }
    // Above the first only bones below a known one that do not branch: a root is no part of a limb.
    let mut above = Vec::new();
    let mut current = parents[first as usize];
    while let Some(bone) = current.filter(|&b| !known(b)) {
        if children(bone).len() > 1 {
            break;
        }
        above.push(bone);
        current = parents[bone as usize];
    }
    if current.is_some_and(known) {
        bones.append(&mut above);
    }
    bones.reverse();
    if to_the_tip {
        let below = |&bone: &u32| match children(bone)[..] {
            [only] if !known(only) => Some(only),
            _ => None,
        };
        bones.extend(std::iter::successors(Some(last), below).skip(1));
    }
    bones
}
