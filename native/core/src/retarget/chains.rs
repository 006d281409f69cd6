//! Chains of a skeleton: where its limbs end, and whether it is a biped (head, two arms, two legs).
//!
//! Only the tree and its lengths decide, never a name, so any naming scheme works.

use glam::DVec3;

use crate::rig::Skeleton;

/// A branch shorter than this share of the skeleton's extent is part of the bone that it grows
/// from, unless it continues that bone: a finger of the hand, an ear of the head, a twist bone.
const TWIG: f64 = 0.1;

/// A bone continues its parent when it starts within this share of the parent's length of its tail.
const CONTINUES: f64 = 0.25;

/// The end of a chain once twigs are folded in.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainEnd {
    /// Last bone of the chain.
    pub bone: u32,
    /// Bone whose tail is the farthest point of the chain: `bone` itself or the tip of a twig.
    pub tip: u32,
}

/// The five ends of a biped as indices into the list of chain ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Biped {
    /// End of the neck.
    pub head: usize,
    /// Ends of the arms, lower bone first.
    pub hands: [usize; 2],
    /// Ends of the legs, lower bone first.
    pub feet: [usize; 2],
}

/// The chains of a skeleton, seen without the branches that move no skin.
pub struct Chains<'a> {
    skeleton: &'a Skeleton,
    /// Where the chains end, in the order of their bones.
    pub ends: Vec<ChainEnd>,
    /// First bones that carry weight and continue in one chain only: such a start is an end too.
    pub free_starts: Vec<u32>,
}

impl<'a> Chains<'a> {
    /// Finds the chains. `carries_weight` marks the bones (B) that move any skin; branches
    /// without such a bone (IK targets, poles) are left out.
    #[must_use]
    pub fn new(skeleton: &'a Skeleton, carries_weight: &[bool]) -> Self {
        let children = skeleton.children();
        let mut alive = carries_weight.to_vec();
        let mut reach = vec![0.0f64; skeleton.bone_count()];
        for &bone in skeleton.depth_order().iter().rev() {
            let b = bone as usize;
            let heads = skeleton.heads();
            let below = children[b].iter().map(|&c| c as usize).filter(|&c| alive[c]);
            let longest = below.map(|c| heads[b].distance(heads[c]) + reach[c]).reduce(f64::max);
            alive[b] |= longest.is_some();
            reach[b] = longest.unwrap_or_else(|| skeleton.length(b));
        }
        let twig = TWIG * extent(skeleton, &alive);
        let branches = |bone: usize| children[bone].iter().filter(|&&c| alive[c as usize]).count();
        let mut kept = alive.clone();
        for &bone in skeleton.depth_order() {
            let b = bone as usize;
            if let Some(parent) = skeleton.parents()[b] {
                let p = parent as usize;
                let gap = skeleton.tails()[p].distance(skeleton.heads()[b]);
                let continues = branches(p) == 1 && gap <= CONTINUES * skeleton.length(p);
                let side_branch = reach[b] < twig && !continues;
                kept[b] &= kept[p] && !side_branch;
            }
        }
        let is_end = |b: usize| kept[b] && !children[b].iter().any(|&c| kept[c as usize]);
        let ends: Vec<ChainEnd> = (0..skeleton.bone_count())
            .filter(|&b| is_end(b))
            .map(|b| ChainEnd { bone: b as u32, tip: farthest_tip(skeleton, &children, &alive, b) })
            .collect();
        let above =
            |b: usize| std::iter::successors(skeleton.parents()[b], |&p| skeleton.parents()[p as usize]);
        let free_starts = (0..skeleton.bone_count())
            .filter(|&b| kept[b] && carries_weight[b] && !above(b).any(|p| carries_weight[p as usize]))
            .filter(|&b| children[b].iter().filter(|&&c| kept[c as usize]).count() < 2)
            .map(|b| b as u32)
            .collect();
        Self { skeleton, ends, free_starts }
    }

    /// Recognises a biped: five ends, the legs joined nearer the root than arms and head are,
    /// both pairs of nearly equal length.
    #[must_use]
    pub fn biped(&self) -> Option<Biped> {
        const LENGTHS_DIFFER: f64 = 0.25;
        if self.ends.len() != 5 {
            return None;
        }
        let paths: Vec<Vec<u32>> = self.ends.iter().map(|end| self.path_from_root(end.bone)).collect();
        let shared = |a: usize, b: usize| paths[a].iter().zip(&paths[b]).take_while(|(x, y)| x == y).count();
        let mismatch = |a: usize, b: usize| {
            let joint = shared(a, b);
            (self.length_below(&paths[a], joint) / self.length_below(&paths[b], joint)).ln().abs()
        };
        let mut best: Option<(f64, Biped)> = None;
        for head in 0..5 {
            let rest: Vec<usize> = (0..5).filter(|&e| e != head).collect();
            for hands in [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]] {
                let feet: Vec<usize> = (0..4).filter(|i| !hands.contains(i)).map(|i| rest[i]).collect();
                let (hands, feet) = (hands.map(|i| rest[i]), [feet[0], feet[1]]);
                let at_hips = shared(hands[0], feet[0]);
                let legs_low = shared(feet[0], feet[1]) >= at_hips
                    && hands.iter().all(|&hand| feet.iter().all(|&foot| shared(hand, foot) == at_hips))
                    && shared(head, feet[0]) == at_hips;
                let arms_high = shared(hands[0], hands[1]) > at_hips && shared(head, hands[0]) > at_hips;
                let error = mismatch(hands[0], hands[1]).max(mismatch(feet[0], feet[1]));
                if legs_low && arms_high && error < LENGTHS_DIFFER && best.is_none_or(|(e, _)| error < e) {
                    best = Some((error, Biped { head, hands, feet }));
                }
            }
        }
        best.map(|(_, biped)| biped)
    }

    /// Bone whose head is the knee: on the way from the hip to the end of the leg, the joint
    /// nearest to half of its length. `None` for a leg of one bone.
    #[must_use]
    pub fn knee(&self, biped: &Biped, side: usize) -> Option<u32> {
        let paths = biped.feet.map(|foot| self.path_from_root(self.ends[foot].bone));
        let hip = paths[0].iter().zip(&paths[1]).take_while(|(a, b)| a == b).count();
        let leg = &paths[side][hip..];
        let half = 0.5 * self.length_below(&paths[side], hip);
        let heads = self.skeleton.heads();
        let mut along = 0.0;
        let joints = leg.windows(2).map(|pair| {
            along += heads[pair[0] as usize].distance(heads[pair[1] as usize]);
            (pair[1], (along - half).abs())
        });
        joints.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(bone, _)| bone)
    }

    /// Bones from the root to a bone.
    fn path_from_root(&self, bone: u32) -> Vec<u32> {
        let mut path: Vec<u32> =
            std::iter::successors(Some(bone), |&b| self.skeleton.parents()[b as usize]).collect();
        path.reverse();
        path
    }

    /// Length of a path from its bone number `from` to the tail of its last bone.
    fn length_below(&self, path: &[u32], from: usize) -> f64 {
        let heads = self.skeleton.heads();
        let below = &path[from.min(path.len() - 1)..];
        let joints: f64 = below.windows(2).map(|p| heads[p[0] as usize].distance(heads[p[1] as usize])).sum();
        joints + self.skeleton.length(path[path.len() - 1] as usize)
    }
}

/// Diagonal of the bounding box of the living bones.
fn extent(skeleton: &Skeleton, alive: &[bool]) -> f64 {
    let points =
        (0..alive.len()).filter(|&b| alive[b]).flat_map(|b| [skeleton.heads()[b], skeleton.tails()[b]]);
    let bounds = points.fold(None, |bounds: Option<(DVec3, DVec3)>, p| {
        Some(bounds.map_or((p, p), |(low, high)| (low.min(p), high.max(p))))
    });
    bounds.map_or(0.0, |(low, high)| low.distance(high))
}

/// The living bone at or below `bone` whose tail lies farthest along the bone's direction.
fn farthest_tip(skeleton: &Skeleton, children: &[Vec<u32>], alive: &[bool], bone: usize) -> u32 {
    let head = skeleton.heads()[bone];
    let direction = skeleton.tails()[bone] - head;
    let mut best = (bone as u32, direction.length_squared());
    let mut below = children[bone].clone();
    while let Some(b) = below.pop() {
        if alive[b as usize] {
            let along = (skeleton.tails()[b as usize] - head).dot(direction);
            if along > best.1 {
                best = (b, along);
            }
            below.extend(&children[b as usize]);
        }
    }
    best.0
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A biped with fingers, an ear, a twist bone and an IK target; `order` renumbers its bones.
    pub(crate) fn person(order: impl Fn(usize) -> usize) -> (Skeleton, Vec<bool>) {
        let joint = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
        let mut bones: Vec<(DVec3, DVec3, i64, bool)> = vec![
            (joint(0.0, 0.0, 1.0), joint(0.0, 0.0, 1.1), -1, true), // 0 hips
            (joint(0.0, 0.0, 1.1), joint(0.0, 0.0, 1.45), 0, true), // 1 chest
            (joint(0.0, 0.0, 1.45), joint(0.0, 0.0, 1.55), 1, true), // 2 neck
            (joint(0.0, 0.0, 1.55), joint(0.0, 0.0, 1.8), 2, true), // 3 head
            (joint(0.1, 0.0, 1.7), joint(0.12, 0.0, 1.72), 3, true), // 4 ear
        ];
        for side in [1.0, -1.0] {
            let arm = bones.len() as i64;
            bones.push((joint(0.1 * side, 0.0, 1.4), joint(0.45 * side, 0.0, 1.4), 1, true));
            bones.push((joint(0.45 * side, 0.0, 1.4), joint(0.7 * side, 0.0, 1.4), arm, true));
            bones.push((joint(0.7 * side, 0.0, 1.4), joint(0.78 * side, 0.0, 1.4), arm + 1, true));
            for finger in [-0.02, 0.0, 0.02] {
                bones.push((joint(0.78 * side, finger, 1.4), joint(0.86 * side, finger, 1.4), arm + 2, true));
            }
            bones.push((joint(0.2 * side, 0.0, 1.4), joint(0.3 * side, 0.0, 1.4), arm, true)); // twist
            let leg = bones.len() as i64;
            bones.push((joint(0.1 * side, 0.0, 0.95), joint(0.1 * side, 0.0, 0.5), 0, true));
            bones.push((joint(0.1 * side, 0.0, 0.5), joint(0.1 * side, 0.0, 0.1), leg, true));
            bones.push((joint(0.1 * side, 0.0, 0.1), joint(0.1 * side, -0.2, 0.0), leg + 1, true));
        }
        bones.push((joint(0.0, -2.0, 0.0), joint(0.0, -3.0, 0.0), -1, false)); // IK target
        let count = bones.len();
        let mut placed = vec![bones[0]; count];
        for (i, bone) in bones.iter().enumerate() {
            let parent = if bone.2 < 0 { -1 } else { order(bone.2 as usize) as i64 };
            placed[order(i)] = (bone.0, bone.1, parent, bone.3);
        }
        let skeleton = Skeleton::new(
            placed.iter().map(|b| b.0).collect(),
            placed.iter().map(|b| b.1).collect(),
            &placed.iter().map(|b| b.2).collect::<Vec<_>>(),
            None,
        );
        (skeleton.unwrap(), placed.iter().map(|b| b.3).collect())
    }

    #[test]
    fn finds_head_hands_and_knees_in_any_order() {
        for reversed in [false, true] {
            let (skeleton, weighted) = person(|i| if reversed { 25 - i } else { i });
            let chains = Chains::new(&skeleton, &weighted);
            let biped = chains.biped().expect("a biped");
            let tip = |end: usize| skeleton.tails()[chains.ends[end].tip as usize];
            assert_eq!(tip(biped.head), DVec3::new(0.0, 0.0, 1.8));
            assert!(biped.hands.iter().all(|&hand| (tip(hand).x.abs() - 0.86).abs() < 1e-12));
            for side in 0..2 {
                let knee = chains.knee(&biped, side).unwrap();
                assert_eq!(skeleton.heads()[knee as usize].z, 0.5);
            }
        }
    }

    #[test]
    fn a_quadruped_is_not_a_biped() {
        let mut heads = vec![DVec3::ZERO, DVec3::X, DVec3::X * 2.0, DVec3::ZERO];
        let mut tails = vec![DVec3::X, DVec3::X * 2.0, DVec3::new(3.0, 0.0, 0.5), -DVec3::X];
        let mut parents = vec![-1, 0, 1, 0];
        for (x, parent) in [(0.0, 0), (1.8, 1)] {
            for y in [-0.3, 0.3] {
                heads.push(DVec3::new(x, y, 0.0));
                tails.push(DVec3::new(x, y, -1.0));
                parents.push(parent);
            }
        }
        let skeleton = Skeleton::new(heads, tails, &parents, None).unwrap();
        let chains = Chains::new(&skeleton, &[true; 8]);
        assert_eq!(chains.ends.len(), 6);
        assert!(chains.free_starts.is_empty());
        assert_eq!(chains.biped(), None);
    }

    #[test]
    fn a_single_chain_has_two_ends() {
        // A control bone without weight, then an arm of three bones.
        let heads: Vec<DVec3> = [-5.0, 0.0, 1.0, 2.0].map(|x| DVec3::X * x).to_vec();
        let tails = heads.iter().map(|&head| head + DVec3::X).collect();
        let skeleton = Skeleton::new(heads, tails, &[-1, 0, 1, 2], None).unwrap();
        let chains = Chains::new(&skeleton, &[false, true, true, true]);
        assert_eq!(chains.ends, [ChainEnd { bone: 3, tip: 3 }]);
        assert_eq!(chains.free_starts, [1]);
    }
}
