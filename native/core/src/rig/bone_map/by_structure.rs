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

/// Rounds of turning one skeleton to the other by the pairs found, and pairing again, at most.
const REFINEMENTS: usize = 4;

/// Bones in order may be this much less alike, for each bone, than the likest ones.
const IN_ORDER: f64 = 0.1;

/// Gives counterparts to bones that have none.
pub(super) fn map_the_rest(source: &Named<'_>, target: &Named<'_>, entries: &mut [Entry]) {
    let (from, to) = (source.skeleton, target.skeleton);
    if from.bone_count() == 0 || to.bone_count() == 0 {
        return;
    }
    let known: Vec<(usize, usize)> =
        (0..entries.len()).filter_map(|i| Some((i, *entries[i].targets.first()? as usize))).collect();
    let rotations = match rotation_of(from, to, &known) {
        Some(rotation) => vec![rotation],
        None => candidate_rotations(from, to),
    };
    let trees = [from, to].map(|skeleton| Tree::new(skeleton.parents(), skeleton.depth_order()));
    let pair = |rotation: DMat3| {
        let (placed, turned) = (Placed::new(from, DMat3::IDENTITY), Placed::new(to, rotation));
        let mirrors = Mirror::of_both(Mirror::new(source, &placed), Mirror::new(target, &turned));
        let views = [View::new(source, placed, mirrors[0]), View::new(target, turned, mirrors[1])];
        pair_by_place(&views, [from, to], &trees, entries)
    };
    let mut best: Option<(f64, Vec<(u32, u32)>)> = None;
    for (at, &rotation) in rotations.iter().enumerate() {
        let (pairs, mut total) = pair(rotation);
        total += if at == 0 { 0.0 } else { TURNED * entries.len() as f64 };
        if best.as_ref().is_none_or(|found| total < found.0) {
            best = Some((total, pairs));
        }
    }
    let mut pairs = best.map_or_else(Vec::new, |found| found.1);
    // What was paired tells the rotation better than the first guess did.
    for _ in 0..if known.is_empty() { REFINEMENTS } else { 0 } {
        let found: Vec<_> = pairs.iter().map(|&(i, j)| (i as usize, j as usize)).collect();
        let Some((again, _)) = rotation_of(from, to, &found).map(pair) else { break };
        if again == pairs {
            break;
        }
        pairs = again;
    }
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

/// Pairs the bones as they are placed. Returns the pairs and how unlike they are.
fn pair_by_place(
    views: &[View<'_>; 2],
    skeletons: [&Skeleton; 2],
    trees: &[Tree; 2],
    entries: &[Entry],
) -> (Vec<(u32, u32)>, f64) {
    let [seen, other] = views;
    let [from, to] = skeletons;
    let named = Anchors::new(from, to, entries.iter().map(|entry| &entry.targets[..]));
    let first = |i: usize, j: usize| pair_cost(seen, other, entries, &named, i, j);
    let (pairs, total) = match_trees(&trees[0], &trees[1], &first);
    if entries.iter().any(|entry| !entry.targets.is_empty()) {
        return (pairs, total);
    }
    if from.parents() == to.parents() {
        let in_order: f64 = (0..entries.len()).map(|i| first(i, i).min(1.0)).sum();
        if in_order <= total + IN_ORDER * entries.len() as f64 {
            return ((0..entries.len() as u32).map(|i| (i, i)).collect(), in_order.min(total));
        }
    }
    (pairs, total)
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

/// For each bone of either skeleton the nearest bone above it that has a counterpart.
struct Anchors {
    source: Vec<Option<u32>>,
    target: Vec<Option<u32>>,
    /// Counterparts of each source bone.
    partners: Vec<Vec<u32>>,
    taken: Vec<bool>,
}

impl Anchors {
    fn new<'a>(from: &Skeleton, to: &Skeleton, partners: impl Iterator<Item = &'a [u32]>) -> Self {
        let partners: Vec<Vec<u32>> = partners.map(<[u32]>::to_vec).collect();
        let mut taken = vec![false; to.bone_count()];
        partners.iter().flatten().for_each(|&target| taken[target as usize] = true);
        let above = |skeleton: &Skeleton, known: &dyn Fn(u32) -> bool| {
            let parents = skeleton.parents();
            let find = |parent: Option<u32>| {
                std::iter::successors(parent, |&b| parents[b as usize]).find(|&b| known(b))
            };
            parents.iter().map(|&parent| find(parent)).collect()
        };
        let source = above(from, &|b| !partners[b as usize].is_empty());
        let target = above(to, &|b| taken[b as usize]);
        Self { source, target, partners, taken }
    }

    /// The bones above two bones, when they are a pair.
    fn of(&self, i: usize, j: usize) -> Option<(usize, usize)> {
        let (a, b) = (self.source[i]?, self.target[j]?);
        self.partners[a as usize].contains(&b).then_some((a as usize, b as usize))
    }

    /// Whether there is no bone with a counterpart above either bone.
    fn none(&self, i: usize, j: usize) -> bool {
        self.source[i].is_none() && self.target[j].is_none()
    }
}

/// Cost of a pair beside the pairs that names gave.
fn pair_cost(
    seen: &View<'_>,
    other: &View<'_>,
    entries: &[Entry],
    named: &Anchors,
    i: usize,
    j: usize,
) -> f64 {
    if let Some(&partner) = entries[i].targets.first() {
        return if partner as usize == j { 0.0 } else { NEVER };
    }
    if named.taken[j] || (seen.is_known(i) && other.is_known(j)) {
        return NEVER;
    }
    let anchors = named.of(i, j);
    if anchors.is_none() && !named.none(i, j) {
        return NEVER;
    }
    let cost = unlikeness((seen, i), (other, j), anchors);
    // Among bones that have names, only what lies close together is believed.
    if anchors.is_some() && cost > LEFT_OUT { NEVER } else { cost }
}

/// Gives bones that were left out between two pairs, or below the last pair of a chain, to each
/// other by arc length. Only stretches that start at a pair found by structure are touched.
fn even_out_chains(from: &Skeleton, to: &Skeleton, entries: &mut [Entry], added: &[bool]) {
    let anchors = Anchors::new(from, to, entries.iter().map(|entry| &entry.targets[..]));
    let mut next: Vec<Vec<u32>> = vec![vec![]; entries.len()];
    for bone in (0..entries.len() as u32).filter(|&bone| !entries[bone as usize].targets.is_empty()) {
        if let Some(above) = anchors.source[bone as usize] {
            next[above as usize].push(bone);
        }
    }
    for start in (0..entries.len() as u32).filter(|&bone| added[bone as usize]) {
        let start_target = anchors.partners[start as usize][0];
        let [own, mut theirs] = match next[start as usize][..] {
            [only] => [
                path_down(from, start, only),
                path_down(to, start_target, anchors.partners[only as usize][0]),
            ],
            [] => [
                to_the_tip(from, start, &|b| !anchors.partners[b as usize].is_empty()),
                to_the_tip(to, start_target, &|b| anchors.taken[b as usize]),
            ],
            _ => continue,
        };
        if next[start as usize].is_empty() && own.len() == 1 && theirs.len() == 2 {
            // A single bone below the last one only gives it its tail.
            theirs.pop();
        }
        if own.is_empty() || theirs.is_empty() || own.len() + theirs.len() == 2 {
            continue;
        }
        for (&bone, targets) in own.iter().zip(shared_stretches((from, &own), (to, &theirs))) {
            entries[bone as usize] = Entry { targets, how: How::Structure };
        }
    }
}

/// Bones from one down to before another, which lies below it; empty when it does not.
fn path_down(skeleton: &Skeleton, top: u32, below: u32) -> Vec<u32> {
    let parents = skeleton.parents();
    let mut path: Vec<u32> = Vec::new();
    for bone in std::iter::successors(parents[below as usize], |&b| parents[b as usize]) {
        path.push(bone);
        if bone == top {
            path.reverse();
            return path;
        }
    }
    Vec::new()
}

/// A bone and those without branches below it.
fn to_the_tip(skeleton: &Skeleton, bone: u32, known: &dyn Fn(u32) -> bool) -> Vec<u32> {
    let parents = skeleton.parents();
    let below = |&bone: &u32| {
        let mut children = (0..parents.len() as u32).filter(|&b| parents[b as usize] == Some(bone));
        let only = children.next().filter(|_| children.next().is_none());
        only.filter(|&child| !known(child))
    };
    std::iter::successors(Some(bone), below).collect()
}
