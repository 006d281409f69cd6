//! Target bones that no source bone stands for: the single fingers where the source has a mitten,
//! twist bones, toes. Where weights made from the target's skeleton alone give them a share, they
//! take it from the bone that they hang on and from all that hangs on it. They reach no farther than
//! their own size: a bone of an eyelid does not move the back of the head, though it be the nearest.

use glam::DVec3;

use crate::rig::{BoneMap, Skeleton, distance_to_segment};
use crate::skinning::{Row, SkinWeights};

/// Up to so many of its lengths away from it a bone gets all that it asks for,
const NEAR: f64 = 1.0;
/// and from here on nothing.
const OUT_OF_REACH: f64 = 2.0;

/// The bones that only the target has, and those that they take their weight from.
///
/// Let p be a claimed bone with unclaimed bones below it, and a their share of the weight that the
/// skeleton alone gives p and its descendants at a vertex. Then a of what p and its descendants have
/// goes to the unclaimed bones, in the proportions of the skeleton's weights.
pub(super) struct Unclaimed<'a> {
    families: Vec<Family>,
    skeleton: &'a Skeleton,
}

impl<'a> Unclaimed<'a> {
    /// `used` (B) marks target bones with weight. `None` where every bone is claimed.
    pub(super) fn new(bone_map: &BoneMap, used: &[bool], skeleton: &'a Skeleton) -> Option<Self> {
        let mut claimed = vec![false; skeleton.bone_count()];
        for bone in 0..bone_map.source_bone_count() {
            for &target in bone_map.targets(bone) {
                claimed[target as usize] = true;
            }
        }
        let families = families(&claimed, used, skeleton);
        (!families.is_empty()).then_some(Self { families, skeleton })
    }

    /// The unclaimed bones.
    pub(super) fn bones(&self) -> impl Iterator<Item = u32> + '_ {
        self.families.iter().flat_map(|family| family.unclaimed.iter().copied())
    }

    /// Weights (V×B) divided between the claimed and the unclaimed bones, as the skeleton's own rows
    /// (V) say; `vertices` (V) are where they lie. Sums of rows stay.
    pub(super) fn share(&self, weights: &SkinWeights, alone: &[Row], vertices: &[DVec3]) -> SkinWeights {
        let rows = alone.iter().enumerate().map(|(vertex, alone)| {
            let mut row: Row =
                weights.entries(vertex).map(|(bone, weight)| (bone, f64::from(weight))).collect();
            let reach = |bone: u32| self.reach(bone as usize, vertices[vertex]);
            self.families.iter().for_each(|family| family.divide(&mut row, alone, reach));
            row
        });
        SkinWeights::from_rows(rows, weights.bone_count())
    }

    /// How much of what it asks for a bone gets at a place, 0 to 1.
    fn reach(&self, bone: usize, point: DVec3) -> f64 {
        let (head, tail) = (self.skeleton.heads()[bone], self.skeleton.tails()[bone]);
        let lengths = distance_to_segment(point, head, tail) / self.skeleton.length(bone);
        ((OUT_OF_REACH - lengths) / (OUT_OF_REACH - NEAR)).clamp(0.0, 1.0)
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
    /// Divides a row; each unclaimed bone gets the share `reach` of what `alone` gives it.
    fn divide(&self, row: &mut Row, alone: &Row, reach: impl Fn(u32) -> f64) {
        let total = |row: &Row| -> f64 {
            row.iter().filter(|entry| self.members[entry.0 as usize]).map(|entry| entry.1).sum()
        };
        let is_unclaimed = |bone: u32| self.unclaimed.binary_search(&bone).is_ok();
        let (held, alone_total) = (total(row), total(alone));
        let asked: Row = alone
            .iter()
            .filter(|entry| is_unclaimed(entry.0))
            .map(|&(bone, weight)| (bone, weight * reach(bone)))
            .filter(|entry| entry.1 > 0.0)
            .collect();
        if held <= 0.0 || asked.is_empty() {
            return;
        }
        let share = asked.iter().map(|entry| entry.1).sum::<f64>() / alone_total;
        for entry in row.iter_mut().filter(|entry| self.members[entry.0 as usize]) {
            entry.1 *= 1.0 - share;
        }
        for (bone, weight) in asked {
            row.push((bone, held * weight / alone_total));
        }
        row.retain(|entry| entry.1 > 0.0);
        row.sort_by_key(|entry| entry.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        families[0].divide(&mut row, &vec![(0, 0.6), (1, 0.1), (3, 0.3)], |_| 1.0);
        let expected = [(0, 0.2), (1, 0.075), (2, 0.125), (3, 0.6)];
        assert!(row.iter().zip(expected).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() < 1e-12), "{row:?}");
        let before = row.clone();
        families[0].divide(&mut row, &vec![(0, 1.0)], |_| 1.0);
        assert_eq!(row, before, "where the skeleton gives it nothing, nothing changes");
    }

    #[test]
    fn a_bone_reaches_as_far_as_it_is_long() {
        let skeleton = hand();
        let families =
            families(&[true, true, true, false, false], &[false, true, true, false, false], &skeleton);
        let unclaimed = Unclaimed { families, skeleton: &skeleton };
        let weights = SkinWeights::from_dense(&[0.0, 1.0, 0.0, 0.0, 0.0].repeat(3), 5).unwrap();
        let vertices = [0.9, 1.5, 2.1].map(|away| DVec3::new(1.5, -away, 0.0));
        let shared = unclaimed.share(&weights, &vec![vec![(3, 1.0)]; 3], &vertices).to_dense();
        assert_eq!([shared[3], shared[5 + 3], shared[10 + 3]], [1.0, 0.5, 0.0]);
        assert_eq!([shared[1], shared[5 + 1], shared[10 + 1]], [0.0, 0.5, 1.0]);
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
