//! Which bones of a target skeleton stand for each bone of a source skeleton, and what that does to
//! weights.
//!
//! Bones are paired by equal names, by the common naming schemes, and what remains by its place in
//! the tree and in space. Chains of different length are matched by arc length: one bone may be
//! split over several, and several may go to one. A bone without a counterpart gives its weight to
//! its nearest mapped ancestor.

mod align;
mod assignment;
mod by_name;
mod by_structure;
mod chain;
mod detached;
mod error;
mod frame;
mod labels;
mod likeness;
mod names;
mod transfer;
mod tree_edit;

use super::Skeleton;
use by_name::Named;
use error::bone_list;
use labels::Labels;

pub use error::BoneMapError;

/// Whether a name means the bone that only says where the character stands.
pub(super) fn names_a_root(name: &str) -> bool {
    names::BoneName::new(name).part == Some(names::Part::Root)
}

/// How a source bone's counterparts were found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum How {
    /// Both bones have one name.
    Name,
    /// Both names mean one part of the body.
    Scheme,
    /// Place in the tree and in space.
    Structure,
    /// The user's choice.
    User,
    /// There is none.
    #[default]
    None,
}

impl How {
    /// The name in lower case: "name", "scheme", "structure", "user" or "none".
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Name => "name",
            Self::Scheme => "scheme",
            Self::Structure => "structure",
            Self::User => "user",
            Self::None => "none",
        }
    }
}

/// Counterparts of one source bone.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
struct Entry {
    targets: Vec<u32>,
    how: How,
}

/// For each bone of a source skeleton the bones of a target skeleton that stand for it.
///
/// No target bone: the weight goes to the nearest mapped ancestor, or, without one, to the nearest
/// mapped descendant, or else to the first mapped bone. One: it takes the weight; several source
/// bones may name it. Several: a chain, over which the weight is split by position along it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BoneMap {
    entries: Vec<Entry>,
    /// The mapped source bone that stands for each source bone: itself or the one that gathers
    /// its weight.
    carriers: Vec<u32>,
    target_bone_count: usize,
}

/// Maps the bones of `source` to those of `target`.
///
/// # Errors
/// [`BoneMapError::NothingInCommon`] when no bone has a counterpart.
pub fn map_bones(source: &Skeleton, target: &Skeleton) -> Result<BoneMap, BoneMapError> {
    let mut from = Named { skeleton: source, labels: Labels::new(source) };
    let mut to = Named { skeleton: target, labels: Labels::new(target) };
    from.labels.join_neck(&mut to.labels);
    let mut entries = by_name::map_by_name(&from, &to);
    by_structure::map_the_rest(&from, &to, &mut entries);
    detached::map_detached(&from, &to, &mut entries);
    BoneMap::new(source, target, entries)
}

impl BoneMap {
    /// The user's own map: for each source bone (B) its target bones.
    ///
    /// # Errors
    /// [`BoneMapError`] naming the first bone at fault: another number of entries than bones, an
    /// index out of range or repeated, target bones that do not lie one below the other, or no
    /// target bone at all.
    pub fn from_pairs(
        source: &Skeleton,
        target: &Skeleton,
        targets: &[Vec<i64>],
    ) -> Result<Self, BoneMapError> {
        if targets.len() != source.bone_count() {
            return Err(BoneMapError::Count { entries: targets.len(), bones: source.bone_count() });
        }
        let entry = |(bone, list): (usize, &Vec<i64>)| {
            let targets = checked(source, target, bone, list)?;
            let how = if targets.is_empty() { How::None } else { How::User };
            Ok(Entry { targets, how })
        };
        let entries: Result<Vec<Entry>, BoneMapError> = targets.iter().enumerate().map(entry).collect();
        Self::new(source, target, entries?)
    }

    fn new(source: &Skeleton, target: &Skeleton, entries: Vec<Entry>) -> Result<Self, BoneMapError> {
        let mapped = |bone: u32| !entries[bone as usize].targets.is_empty();
        let Some(&first) = source.depth_order().iter().find(|&&bone| mapped(bone)) else {
            return Err(BoneMapError::NothingInCommon {
                source_bones: bone_list(source),
                target_bones: bone_list(target),
            });
        };
        // Steps down to the nearest mapped descendant, and that bone; the lower one where two are as near.
        let mut below: Vec<Option<(usize, u32)>> =
            (0..entries.len() as u32).map(|bone| mapped(bone).then_some((0, bone))).collect();
        for &bone in source.depth_order().iter().rev() {
            let reached = below[bone as usize].map(|(steps, found)| (steps + 1, found));
            if let (Some(parent), Some(reached)) = (source.parents()[bone as usize], reached) {
                let known = &mut below[parent as usize];
                *known = Some(known.map_or(reached, |known| known.min(reached)));
            }
        }
        let mut carriers = vec![first; entries.len()];
        for &bone in source.depth_order() {
            let above = source.parents()[bone as usize].map(|p| p as usize);
            let gathering = above.filter(|&p| has_mapped_ancestor(source, &entries, p)).map(|p| carriers[p]);
            carriers[bone as usize] = match (mapped(bone), gathering) {
                (true, _) => bone,
                (false, Some(carrier)) => carrier,
                (false, None) => below[bone as usize].map_or(first, |(_, found)| found),
            };
        }
        Ok(Self { entries, carriers, target_bone_count: target.bone_count() })
    }

    /// Number of source bones.
    #[must_use]
    pub fn source_bone_count(&self) -> usize {
        self.entries.len()
    }

    /// Number of target bones.
    #[must_use]
    pub fn target_bone_count(&self) -> usize {
        self.target_bone_count
    }

    /// Target bones of a source bone, along their chain; empty for a bone without a counterpart.
    #[must_use]
    pub fn targets(&self, bone: usize) -> &[u32] {
        &self.entries[bone].targets
    }

    /// How the target bones of a source bone were found.
    #[must_use]
    pub fn how(&self, bone: usize) -> How {
        self.entries[bone].how
    }

    /// Whether the user chose any of the target bones.
    #[must_use]
    pub fn is_by_hand(&self) -> bool {
        self.entries.iter().any(|entry| entry.how == How::User)
    }

    /// Mapped source bone that takes the weight of a source bone: itself, or for a bone without a
    /// counterpart the one that gathers it.
    #[must_use]
    pub fn carrier(&self, bone: usize) -> u32 {
        self.carriers[bone]
    }

    /// Whether every source bone has one target bone and no two the same: columns are renamed, and
    /// nothing is split or gathered.
    #[must_use]
    pub fn is_renaming(&self) -> bool {
        let mut seen = vec![false; self.target_bone_count];
        self.entries.iter().all(|entry| match entry.targets[..] {
            [only] => !std::mem::replace(&mut seen[only as usize], true),
            _ => false,
        })
    }

    /// Refuses skeletons with other numbers of bones than those that the map is of.
    pub(crate) fn check_skeletons(
        &self,
        source: Option<&Skeleton>,
        target: &Skeleton,
    ) -> Result<(), BoneMapError> {
        let counts = [
            ("source", self.source_bone_count(), source.map(Skeleton::bone_count)),
            ("target", self.target_bone_count, Some(target.bone_count())),
        ];
        for (side, expected, found) in counts {
            if let Some(found) = found.filter(|&found| found != expected) {
                return Err(BoneMapError::OtherSkeleton { side, expected, found });
            }
        }
        Ok(())
    }
}

fn has_mapped_ancestor(source: &Skeleton, entries: &[Entry], from: usize) -> bool {
    std::iter::successors(Some(from as u32), |&b| source.parents()[b as usize])
        .any(|bone| !entries[bone as usize].targets.is_empty())
}

fn checked(
    source: &Skeleton,
    target: &Skeleton,
    bone: usize,
    list: &[i64],
) -> Result<Vec<u32>, BoneMapError> {
    let count = target.bone_count();
    let mut targets: Vec<u32> = Vec::with_capacity(list.len());
    for &index in list {
        let Some(found) = u32::try_from(index).ok().filter(|&i| (i as usize) < count) else {
            return Err(BoneMapError::OutOfRange { bone: source.label(bone), index, count });
        };
        if targets.contains(&found) {
            return Err(BoneMapError::Repeated {
                bone: source.label(bone),
                target: target.label(found as usize),
            });
        }
        targets.push(found);
    }
    // One below the other, or a twist bone beside its limb: the same parent.
    let parents = target.parents();
    let above = |bone: u32| std::iter::successors(parents[bone as usize], |&b| parents[b as usize]);
    for pair in targets.windows(2) {
        let (first, second) = (pair[0], pair[1]);
        let related = above(second).any(|b| b == first)
            || above(first).any(|b| b == second)
            || (parents[first as usize].is_some() && parents[first as usize] == parents[second as usize]);
        if !related {
            let [first, second] = [first, second].map(|b| target.label(b as usize));
            return Err(BoneMapError::NotAChain { bone: source.label(bone), first, second });
        }
    }
    Ok(targets)
}

#[cfg(test)]
mod tests;
