//! The source skeleton at the target's rest positions.

use glam::{DQuat, DVec3};

use super::chain::joints;
use super::{BoneMap, BoneMapError};
use crate::rig::Skeleton;

impl BoneMap {
    /// The source skeleton, its bones numbered and named as they are, placed on the target: a bone
    /// with one target bone lies on it, a bone that is split over a chain reaches from the chain's
    /// start to its end, bones that share a target bone follow each other along it, each as long
    /// a part as its own length says. A bone without a counterpart moves with the nearest mapped
    /// ancestor, by the similarity that takes that ancestor to its place.
    ///
    /// # Errors
    /// [`BoneMapError::OtherSkeleton`] when the map belongs to skeletons with other numbers of bones.
    pub fn aligned_skeleton(&self, source: &Skeleton, target: &Skeleton) -> Result<Skeleton, BoneMapError> {
        self.check_skeletons(Some(source), target)?;
        let mut heads = vec![DVec3::ZERO; source.bone_count()];
        let mut tails = heads.clone();
        let shares = self.shares(source);
        for bone in (0..source.bone_count()).filter(|&bone| !self.targets(bone).is_empty()) {
            (heads[bone], tails[bone]) = self.place(target, bone, &shares);
        }
        for bone in (0..source.bone_count()).filter(|&bone| self.targets(bone).is_empty()) {
            let carrier = self.carrier(bone) as usize;
            let carry = Similarity::new(
                [source.heads()[carrier], source.tails()[carrier]],
                [heads[carrier], tails[carrier]],
                self.scale(source, target),
            );
            heads[bone] = carry.apply(source.heads()[bone]);
            tails[bone] = carry.apply(source.tails()[bone]);
        }
        Ok(source.placed(heads, tails))
    }

    /// For each source bone and each of its target bones the part of that bone, 0 to 1, which the
    /// source bone takes.
    fn shares(&self, source: &Skeleton) -> Vec<Vec<[f64; 2]>> {
        let parents = source.parents();
        let above =
            |bone: usize| std::iter::successors(parents[bone], |&b| parents[b as usize]).map(|b| b as usize);
        let length = |bone: usize| source.length(bone) / self.targets(bone).len() as f64;
        let mut shares: Vec<Vec<[f64; 2]>> = vec![vec![]; source.bone_count()];
        let mut longest = vec![0.0f64; self.target_bone_count];
        for &bone in source.depth_order() {
            let bone = bone as usize;
            for &target in self.targets(bone) {
                let before: f64 =
                    above(bone).filter(|&b| self.targets(b).contains(&target)).map(length).sum();
                let after = before + length(bone);
                longest[target as usize] = longest[target as usize].max(after);
                shares[bone].push([before, after]);
            }
        }
        for (bone, parts) in shares.iter_mut().enumerate() {
            for (part, &target) in parts.iter_mut().zip(&self.entries[bone].targets) {
                let whole = longest[target as usize];
                *part = if whole > 0.0 { part.map(|at| at / whole) } else { [0.0, 1.0] };
            }
        }
        shares
    }

    fn place(&self, target: &Skeleton, bone: usize, shares: &[Vec<[f64; 2]>]) -> (DVec3, DVec3) {
        let targets = self.targets(bone);
        let ends: Vec<[DVec3; 2]> = match *targets {
            [only] => vec![[target.heads()[only as usize], target.tails()[only as usize]]],
            _ => joints(target, targets).windows(2).map(|pair| [pair[0], pair[1]]).collect(),
        };
        let last = targets.len() - 1;
        let at = |segment: [DVec3; 2], share: f64| segment[0].lerp(segment[1], share);
        (at(ends[0], shares[bone][0][0]), at(ends[last], shares[bone][last][1]))
    }

    /// How much larger the target is: the middle ratio of the lengths of bones mapped one to one.
    fn scale(&self, source: &Skeleton, target: &Skeleton) -> f64 {
        let lengths = |bone: usize| match *self.targets(bone) {
            [only] => Some(target.length(only as usize) / source.length(bone)),
            _ => None,
        };
        let usable = |ratio: &f64| ratio.is_finite() && *ratio > 0.0;
        let mut ratios: Vec<f64> = (0..source.bone_count()).filter_map(lengths).filter(usable).collect();
        ratios.sort_by(f64::total_cmp);
        ratios.get(ratios.len() / 2).copied().unwrap_or(1.0)
    }
}

/// Rotation, uniform scale and translation.
struct Similarity {
    rotation: DQuat,
    scale: f64,
    from: DVec3,
    to: DVec3,
}

impl Similarity {
    /// Takes one segment to another by the shortest rotation; `scale` serves where one has no length.
    fn new(from: [DVec3; 2], to: [DVec3; 2], scale: f64) -> Self {
        let (before, after) = (from[1] - from[0], to[1] - to[0]);
        let both = before.length() > 0.0 && after.length() > 0.0;
        let rotation = if both {
            DQuat::from_rotation_arc(before.normalize(), after.normalize())
        } else {
            DQuat::IDENTITY
        };
        let ratio = if both { after.length() / before.length() } else { scale };
        Self { rotation, scale: if ratio.is_finite() { ratio } else { scale }, from: from[0], to: to[0] }
    }

    fn apply(&self, point: DVec3) -> DVec3 {
        self.to + self.rotation * ((point - self.from) * self.scale)
    }
}
