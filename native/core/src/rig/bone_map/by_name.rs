//! Pairs of bones found by their names: the parts of the body that both skeletons have, each
//! matched chain against chain, and equal names.

use super::chain::{end_of, shared_stretches};
use super::labels::{Labels, longest_path};
use super::names::{Part, Side};
use super::{Entry, How};
use crate::rig::Skeleton;

/// A twist bone that starts within this share of its limb twists the upper part of it.
const AT_THE_START: f64 = 0.25;

/// A skeleton and what its bones are.
pub(super) struct Named<'a> {
    pub(super) skeleton: &'a Skeleton,
    pub(super) labels: Labels,
}

/// Entry of each source bone that has a counterpart by name.
pub(super) fn map_by_name(source: &Named<'_>, target: &Named<'_>) -> Vec<Entry> {
    let mut entries = vec![Entry::default(); source.skeleton.bone_count()];
    let theirs = target.labels.parts();
    for key in source.labels.parts() {
        let counterpart = if theirs.contains(&key) { Some(key.clone()) } else { substitute(&key, target) };
        if let Some(counterpart) = counterpart {
            map_part((source, &key), (target, &counterpart), &mut entries);
        }
    }
    map_equal_names(source.skeleton, target.skeleton, &mut entries);
    entries
}

/// Where the target lacks a part: a finger is taken along by its neighbour, towards the little
/// finger first, a side of the pelvis by the pelvis, a toe by all toes.
fn substitute((side, part): &(Side, Part), target: &Named<'_>) -> Option<(Side, Part)> {
    let has = |key: &(Side, Part)| !target.labels.bones(key.0, &key.1).is_empty();
    let candidates: Vec<(Side, Part)> = match *part {
        Part::Finger(finger) if finger > 0 => {
            let mut others: Vec<u8> = (1..5).filter(|&other| other != finger).collect();
            others.sort_by_key(|&other| (other.abs_diff(finger), 4 - other));
            others.into_iter().map(|other| (*side, Part::Finger(other))).collect()
        }
        Part::Hips if *side != Side::Middle => vec![(Side::Middle, Part::Hips)],
        Part::Toe(_) => vec![(*side, Part::Toes)],
        _ => vec![],
    };
    candidates.into_iter().find(has)
}

/// The main chain of a part and its twist bones.
struct Limb {
    main: Vec<u32>,
    twists: Vec<u32>,
    /// Bones of the part that lie on neither.
    others: Vec<u32>,
}

fn limb(side: &Named<'_>, key: &(Side, Part)) -> Limb {
    let bones = side.labels.bones(key.0, &key.1);
    let is_twist = |bone: &u32| side.labels.get(*bone).is_some_and(|name| name.twist);
    let is_tip = |bone: &u32| side.labels.get(*bone).is_some_and(|name| name.tip);
    let (twists, rest): (Vec<u32>, Vec<u32>) = bones.iter().partition(|&bone| is_twist(bone));
    let (main, twists) = if rest.iter().all(is_tip) { (bones, vec![]) } else { (rest, twists) };
    let path = longest_path(side.skeleton, &main);
    let others = main.into_iter().filter(|bone| !path.contains(bone)).collect();
    Limb { main: path, twists, others }
}

fn map_part(source: (&Named<'_>, &(Side, Part)), target: (&Named<'_>, &(Side, Part)), entries: &mut [Entry]) {
    let (mut from, mut to) = (limb(source.0, source.1), limb(target.0, target.1));
    let (source, part, target) = (source.0, &source.1.1, target.0);
    if matches!(part, Part::Finger(_)) {
        let lengths = [from.main.len(), to.main.len()];
        drop_fingertip(source.skeleton, &mut from.main, lengths[1]);
        drop_fingertip(target.skeleton, &mut to.main, lengths[0]);
    }
    let is_series = from.others.is_empty() && to.others.is_empty();
    if !is_series && matches!(part, Part::Other(_)) {
        // Bones side by side: only equal numbers say which is which.
        let numbers = |side: &Named<'_>, bone| side.labels.get(bone).map(|name| name.numbers.clone());
        let all = |limb: &Limb| [&limb.main[..], &limb.others[..]].concat();
        for bone in all(&from) {
            let alike: Vec<u32> = all(&to)
                .into_iter()
                .filter(|&other| numbers(target, other) == numbers(source, bone))
                .collect();
            if let [only] = alike[..] {
                set(entries, source.skeleton, target.skeleton, bone, vec![only]);
            }
        }
        return;
    }
    if !from.twists.is_empty() && from.twists.len() == to.twists.len() && from.main.len() == to.main.len() {
        from.main.append(&mut from.twists);
        to.main.append(&mut to.twists);
        for (&bone, &other) in from.main.iter().zip(&to.main) {
            set(entries, source.skeleton, target.skeleton, bone, vec![other]);
        }
        return;
    }
    let from = with_twists(source.skeleton, from);
    let to = with_twists(target.skeleton, to);
    let shared = shared_stretches((source.skeleton, &from), (target.skeleton, &to));
    for (&bone, targets) in from.iter().zip(shared) {
        set(entries, source.skeleton, target.skeleton, bone, targets);
    }
}

/// The fourth bone of a finger only gives the third its tail, where the other's finger has three.
fn drop_fingertip(skeleton: &Skeleton, finger: &mut Vec<u32>, other_length: usize) {
    let last_is_leaf = finger.last().is_some_and(|&last| !skeleton.parents().contains(&Some(last)));
    if finger.len() == 4 && other_length == 3 && last_is_leaf {
        finger.pop();
    }
}

/// The bones of a limb in the order in which they take over along it.
fn with_twists(skeleton: &Skeleton, limb: Limb) -> Vec<u32> {
    let Limb { mut main, mut twists, .. } = limb;
    let (Some(&first), Some(&last)) = (main.first(), main.last()) else {
        return twists;
    };
    let start = skeleton.heads()[first as usize];
    let axis = end_of(skeleton, last, &twists) - start;
    let along =
        |bone: u32| (skeleton.heads()[bone as usize] - start).dot(axis) / axis.length_squared().max(1e-300);
    twists.sort_by(|&a, &b| along(a).total_cmp(&along(b)));
    let mut all: Vec<u32> = twists.iter().copied().filter(|&bone| along(bone) < AT_THE_START).collect();
    all.append(&mut main);
    for bone in twists.into_iter().filter(|&bone| along(bone) >= AT_THE_START) {
        let place = all.iter().rposition(|&other| along(other) <= along(bone)).map_or(0, |at| at + 1);
        all.insert(place, bone);
    }
    all
}

fn set(entries: &mut [Entry], source: &Skeleton, target: &Skeleton, bone: u32, targets: Vec<u32>) {
    let equal = match targets[..] {
        [only] => source.names().map(|n| &n[bone as usize]) == target.names().map(|n| &n[only as usize]),
        _ => false,
    };
    let how = if equal { How::Name } else { How::Scheme };
    entries[bone as usize] = Entry { targets, how };
}

/// Pairs equal names among the bones that have no counterpart yet.
fn map_equal_names(source: &Skeleton, target: &Skeleton, entries: &mut [Entry]) {
    let (Some(from), Some(to)) = (source.names(), target.names()) else {
        return;
    };
    let by_name: std::collections::HashMap<&str, u32> = to.iter().map(String::as_str).zip(0..).collect();
    for (name, entry) in from.iter().zip(entries) {
        if let (true, Some(&bone)) = (entry.targets.is_empty(), by_name.get(name.as_str())) {
            *entry = Entry { targets: vec![bone], how: How::Name };
        }
    }
}
