//! What each bone of one skeleton is, from its name and, where schemes differ in what a word
//! means, from the other names and the tree.

use super::names::{BoneName, Part, Side};
use crate::rig::Skeleton;

/// The names of one skeleton taken apart, bone by bone; empty without names.
pub(super) struct Labels {
    names: Vec<BoneName>,
    /// Place of each bone in the skeleton's depth order.
    rank: Vec<usize>,
}

impl Labels {
    pub(super) fn new(skeleton: &Skeleton) -> Self {
        let mut names: Vec<BoneName> =
            skeleton.names().unwrap_or_default().iter().map(|n| BoneName::new(n)).collect();
        if names.iter().any(|name| name.deform) {
            // Where some bones say that they deform, all others are the animator's.
            names.iter_mut().for_each(|name| name.control |= !name.deform);
        }
        let mut rank = vec![0; skeleton.bone_count()];
        for (place, &bone) in skeleton.depth_order().iter().enumerate() {
            rank[bone as usize] = place;
        }
        let mut labels = Self { names, rank };
        labels.tell_limbs();
        labels.tell_spine(skeleton);
        labels
    }

    pub(super) fn get(&self, bone: u32) -> Option<&BoneName> {
        self.names.get(bone as usize)
    }

    pub(super) fn side(&self, bone: u32) -> Side {
        self.get(bone).map_or(Side::Middle, |name| name.side)
    }

    /// Bones of a part that may move skin, parents first.
    pub(super) fn bones(&self, side: Side, part: &Part) -> Vec<u32> {
        let mut found: Vec<u32> =
            (0..self.names.len() as u32).filter(|&bone| self.is(bone, side, part)).collect();
        found.sort_by_key(|&bone| self.rank[bone as usize]);
        found
    }

    /// All parts that occur, in a fixed order.
    pub(super) fn parts(&self) -> std::collections::BTreeSet<(Side, Part)> {
        let usable = self.names.iter().filter(|name| !name.control);
        usable.filter_map(|name| Some((name.side, name.part.clone()?))).collect()
    }

    /// Where only one of two skeletons names a neck, the neck counts as spine.
    pub(super) fn join_neck(&mut self, other: &mut Self) {
        let has = |labels: &Self, part| !labels.bones(Side::Middle, &part).is_empty();
        let counts = [&*self, &*other].map(|labels| (has(labels, Part::Neck), has(labels, Part::Spine)));
        if let [(true, true), (false, true)] | [(false, true), (true, true)] = counts {
            for labels in [self, other] {
                let neck = labels.bones(Side::Middle, &Part::Neck);
                labels.rename(&neck, &Part::Spine);
            }
        }
    }

    /// Whether a scheme knows the part that the bone is named after.
    pub(super) fn is_known(&self, bone: u32) -> bool {
        let name = self.get(bone);
        name.is_some_and(|name| name.part.as_ref().is_some_and(|part| !matches!(part, Part::Other(_))))
    }

    fn is(&self, bone: u32, side: Side, part: &Part) -> bool {
        let name = &self.names[bone as usize];
        !name.control && name.side == side && name.part.as_ref() == Some(part)
    }

    pub(super) fn rename(&mut self, bones: &[u32], part: &Part) {
        for &bone in bones {
            self.names[bone as usize].part = Some(part.clone());
        }
    }

    /// Gives bones of one series the parts of a limb in order, the last part to all that remain.
    fn rename_along(&mut self, series: &[u32], parts: &[Part]) {
        for (at, &bone) in series.iter().enumerate() {
            self.rename(&[bone], &parts[at.min(parts.len() - 1)]);
        }
    }

    /// "Leg" is a shin beside an upper leg and a thigh beside a knee; alone it is the whole leg, and
    /// "arm" likewise. A hip on a side is a thigh where no other thigh is.
    fn tell_limbs(&mut self) {
        for side in [Side::Left, Side::Right] {
            let [leg, thigh, shin] = [Part::Leg, Part::Thigh, Part::Shin].map(|part| self.bones(side, &part));
            if !thigh.is_empty() {
                self.rename(&leg, &Part::Shin);
            } else if !shin.is_empty() {
                self.rename(&leg, &Part::Thigh);
            } else if self.bones(side, &Part::Foot).is_empty() {
                self.rename_along(&leg, &[Part::Thigh, Part::Shin, Part::Foot, Part::Toes]);
            } else {
                self.rename_along(&leg, &[Part::Thigh, Part::Shin]);
            }
            if self.bones(side, &Part::LowerArm).is_empty() {
                let (arm, hand) = (self.bones(side, &Part::UpperArm), self.bones(side, &Part::Hand));
                let parts = [Part::UpperArm, Part::LowerArm, Part::Hand];
                self.rename_along(&arm, if hand.is_empty() { &parts } else { &parts[..2] });
            }
            if self.bones(side, &Part::Thigh).is_empty() {
                let hip = self.bones(side, &Part::Hips);
                self.rename(&hip, &Part::Thigh);
            }
        }
    }

    /// Rigify numbers hips, spine, neck and head in one series: what lies above the arms is neck and
    /// head, and the first bone is the hips where no other is named so.
    fn tell_spine(&mut self, skeleton: &Skeleton) {
        let named = |labels: &Self, part| !labels.bones(Side::Middle, &part).is_empty();
        let neck = longest_path(skeleton, &self.bones(Side::Middle, &Part::Neck));
        if let (false, Some((head, [_, ..]))) = (named(self, Part::Head), neck.split_last()) {
            self.rename(&[*head], &Part::Head);
        }
        self.tell_other_backs(skeleton);
        let spine = longest_path(skeleton, &self.bones(Side::Middle, &Part::Spine));
        if spine.len() < 2 {
            return;
        }
        let arms: Vec<u32> = [Part::Clavicle, Part::UpperArm]
            .into_iter()
            .map(|part| [self.bones(Side::Left, &part), self.bones(Side::Right, &part)].concat())
            .find(|bones| !bones.is_empty())
            .unwrap_or_default();
        let parents = || arms.iter().filter_map(|&bone| skeleton.parents()[bone as usize]);
        let chest = parents().filter_map(|parent| spine.iter().position(|&b| b == parent)).max();
        let above_chest = match (named(self, Part::Neck), named(self, Part::Head), chest) {
            (false, false, Some(chest)) => &spine[chest + 1..],
            _ => &[],
        };
        if let Some((head, neck)) = above_chest.split_last() {
            self.rename(&[*head], &Part::Head);
            self.rename(neck, &Part::Neck);
        }
        if !named(self, Part::Hips) {
            self.rename(&spine[..1], &Part::Hips);
        }
    }

    /// The spine carries the head, or the neck: where some bone named after it does, another one that
    /// does not is no spine, such as the "Back" of a dinosaur, on which its tail hangs.
    fn tell_other_backs(&mut self, skeleton: &Skeleton) {
        let ends = [Part::Neck, Part::Head].map(|part| self.bones(Side::Middle, &part)).concat();
        let carries = |bone: u32| {
            let mut above = ends
                .iter()
                .flat_map(|&end| std::iter::successors(Some(end), |&b| skeleton.parents()[b as usize]));
            above.any(|b| b == bone)
        };
        let (spine, others): (Vec<u32>, Vec<u32>) =
            self.bones(Side::Middle, &Part::Spine).into_iter().partition(|&bone| carries(bone));
        if spine.is_empty() {
            return;
        }
        let Some(names) = skeleton.names() else { return };
        for bone in others {
            let word = names[bone as usize].to_lowercase();
            self.rename(&[bone], &Part::Other(word));
        }
    }
}

/// The longest path of bones that lie one below the other, among bones given parents first.
pub(super) fn longest_path(skeleton: &Skeleton, bones: &[u32]) -> Vec<u32> {
    let mut best: Vec<u32> = Vec::new();
    for &bone in bones {
        let above = std::iter::successors(Some(bone), |&b| skeleton.parents()[b as usize]);
        let mut path: Vec<u32> = above.filter(|b| bones.contains(b)).collect();
        if path.len() > best.len() {
            path.reverse();
            best = path;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// The dinosaur's "Back" comes first and carries its tail.
    #[test]
    fn the_spine_carries_the_head() {
        let bones =
            [("Body", -1), ("Back", 0), ("Tail1", 1), ("Hips", 0), ("Torso", 3), ("Neck", 4), ("Head", 5)];
        let place = |at: usize| DVec3::X * at as f64;
        let parents: Vec<i64> = bones.iter().map(|bone| bone.1).collect();
        let skeleton = |count: usize| {
            let names = bones[..count].iter().map(|bone| bone.0.to_owned()).collect();
            let heads = (0..count).map(place).collect();
            Skeleton::new(heads, (1..=count).map(place).collect(), &parents[..count], Some(names)).unwrap()
        };
        let spine = |skeleton: &Skeleton| Labels::new(skeleton).bones(Side::Middle, &Part::Spine);
        assert_eq!(spine(&skeleton(7)), [4]);
        // Where nothing says which of them carries a head, all of them may.
        assert_eq!(spine(&skeleton(5)), [1, 4]);
    }
}
