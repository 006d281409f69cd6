//! Target bones that no source bone stands for: the single fingers where the source has a mitten,
//! twist bones, toes. Where weights made from the target's skeleton alone give them a share, they
//! take it from the bone that they hang on and from all that hangs on it.

use super::inpaint::Row;
use crate::rig::{BoneMap, Skeleton};
use crate::skinning::SkinWeights;

/// The bones that only the target has, and those that they take their weight from.
///
/// Let p be a claimed bone with unclaimed bones below it, and a their share of the weight that the
/// skeleton alone gives p and its descendants at a vertex. Then a of what p and its descendants have
/// goes to the unclaimed bones, in the proportions of the skeleton's weights.
pub(super) struct Unclaimed {
    families: Vec<Family>,
}

impl Unclaimed {
    /// `used` (B) marks target bones with weight. `None` where every bone is claimed.
    pub(super) fn new(bone_map: &BoneMap, used: &[bool], skeleton: &Skeleton) -> Option<Self> {
        let mut claimed = vec![false; skeleton.bone_count()];
        for bone in 0..bone_map.source_bone_count() {
            for &target in bone_map.targets(bone) {
                claimed[target as usize] = true;
            }
        }
        let families = families(&claimed, used, skeleton);
        (!families.is_empty()).then_some(Self { families })
    }

    /// The unclaimed bones.
    pub(super) fn bones(&self) -> impl Iterator<Item = u32> + '_ {
        self.families.iter().flat_map(|family| family.unclaimed.iter().copied())
    }

    /// Weights (V×B) divided between the claimed and the unclaimed bones, as the skeleton's own rows
    /// (V) say. Sums of rows stay.
    pub(super) fn share(&self, weights: &SkinWeights, alone: &[Row]) -> SkinWeights {
        let rows = alone.iter().enumerate().map(|(vertex, alone)| {
            let mut row: Row =
                weights.entries(vertex).map(|(bone, weight)| (bone, f64::from(weight))).collect();
            self.families.iter().for_each(|family| family.divide(&mut row, alone));
            row
        });
        SkinWeights::from_rows(rows, weights.bone_count())
    }
}

/// A claimed bone with weight that has unclaimed bones below it.
struct Family {
    /// Whether a bone (B) is the claimed bone or below it.
    members: Vec<bool>,
    /// Unclaimed bones whose nearest claimed ancestor it is, ascending.
    unclaimed: Vec<u32>,
}

/// All families, children before their parents. Bones without length mark a place and move no skin.
fn families(claimed: &[bool], used: &[bool], skeleton: &Skeleton) -> Vec<Family> {
    let count = claimed.len();
    let mut owner = vec![None; count];
    for &bone in skeleton.depth_order() {
        let at = bone as usize;
        owner[at] = match skeleton.parents()[at] {
            _ if claimed[at] => Some(bone),
            Some(parent) => owner[parent as usize].filter(|_| skeleton.length(at) > 0.0),
            None => None,
        };
    }
    let family = |&bone: &u32| {
        let unclaimed: Vec<u32> =
            (0..count as u32).filter(|&b| !claimed[b as usize] && owner[b as usize] == Some(bone)).collect();
        if unclaimed.is_empty() || !used[bone as usize] {
            return None;
        }
        let mut members = vec![false; count];
        for &other in skeleton.depth_order() {
            let parent = skeleton.parents()[other as usize];
            members[other as usize] = other == bone || parent.is_some_and(|p| members[p as usize]);
        }
        Some(Family { members, unclaimed })
    };
    skeleton.depth_order().iter().rev().filter_map(family).collect()
}

impl Family {
    fn divide(&self, row: &mut Vec<(u32, f64)>, alone: &[(u32, f64)]) {
        let total = |row: &[(u32, f64)]| -> f64 {
            row.iter().filter(|entry| self.members[entry.0 as usize]).map(|entry| entry.1).sum()
        };
        let is_unclaimed = |bone: u32| self.unclaimed.binary_search(&bone).is_ok();
        let (held, alone_total) = (total(row), total(alone));
        let asked: f64 = alone.iter().filter(|entry| is_unclaimed(entry.0)).map(|entry| entry.1).sum();
        if held <= 0.0 || asked <= 0.0 {
            return;
        }
        let share = asked / alone_total;
        for entry in row.iter_mut().filter(|entry| self.members[entry.0 as usize]) {
            entry.1 *= 1.0 - share;
        }
        for &(bone, weight) in alone.iter().filter(|entry| is_unclaimed(entry.0)) {
            row.push((bone, held * weight / alone_total));
        }
        row.retain(|entry| entry.1 > 0.0);
        row.sort_by_key(|entry| entry.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// A root, a hand with an index finger (2) and a middle one (3), a mark without length (4).
    fn hand() -> Skeleton {
        let x = |at: f64, y: f64| DVec3::new(at, y, 0.0);
        let heads = vec![x(-1.0, 0.0), x(0.0, 0.0), x(1.0, 1.0), x(1.0, 0.0), x(2.0, 0.0)];
        let tails = vec![x(0.0, 0.0), x(1.0, 0.0), x(2.0, 1.0), x(2.0, 0.0), x(2.0, 0.0)];
        Skeleton::new(heads, tails, &[-1, 0, 1, 1, 3], None).unwrap()
    }

    #[test]
    fn an_unclaimed_finger_takes_from_hand_and_index_what_the_skeleton_gives_it() {
        let families =
            families(&[true, true, true, false, false], &[false, true, true, false, false], &hand());
        assert_eq!(families.len(), 1);
        assert_eq!(families[0].unclaimed, [3], "the mark without length moves no skin");
        let mut row = vec![(0, 0.2), (1, 0.3), (2, 0.5)];
        families[0].divide(&mut row, &[(1, 0.1), (3, 0.3), (0, 0.6)]);
        let expected = [(0, 0.2), (1, 0.075), (2, 0.125), (3, 0.6)];
        assert!(row.iter().zip(expected).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() < 1e-12), "{row:?}");
        let before = row.clone();
        families[0].divide(&mut row, &[(0, 1.0)]);
        assert_eq!(row, before, "where the skeleton gives it nothing, nothing changes");
    }

    #[test]
    fn a_claimed_bone_without_weight_gives_nothing() {
        assert!(
            families(&[true, true, true, false, false], &[true, false, true, false, false], &hand())
                .is_empty()
        );
        assert!(families(&[true; 5], &[true; 5], &hand()).is_empty());
    }
}
