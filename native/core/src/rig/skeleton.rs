//! The skeleton: bones as segments with parents and, where known, names.

use std::collections::HashMap;

use glam::DVec3;

/// A skeleton that cannot be used, naming the bone at fault.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SkeletonError {
    /// Heads, tails, parents and names differ in number.
    #[error("{heads} heads, {tails} tails, {parents} parents and {names} names were given; they must agree")]
    Counts {
        /// Number of heads.
        heads: usize,
        /// Number of tails.
        tails: usize,
        /// Number of parents.
        parents: usize,
        /// Number of names.
        names: usize,
    },
    /// A bone's end is NaN or infinite.
    #[error("the {end} of bone {bone} is not finite")]
    NonFinite {
        /// Index of the bone.
        bone: usize,
        /// "head" or "tail".
        end: &'static str,
    },
    /// A bone's parent does not exist.
    #[error("bone {bone} has parent {parent}, but there are {bone_count} bones (-1 means none)")]
    ParentOutOfRange {
        /// Index of the bone.
        bone: usize,
        /// Its parent.
        parent: i64,
        /// Number of bones.
        bone_count: usize,
    },
    /// Following the parents of a bone leads back to it.
    #[error("bone {bone} is its own ancestor")]
    Cycle {
        /// Index of the bone.
        bone: usize,
    },
    /// Two bones have one name.
    #[error("bones {first} and {second} are both named \"{name}\"")]
    DuplicateName {
        /// The name.
        name: String,
        /// The first bone with it.
        first: usize,
        /// The second bone with it.
        second: usize,
    },
}

/// Bones as head and tail points in the mesh's space. Parents form a forest; they may stand
/// anywhere in the order. A bone may have no length.
#[derive(Debug, Clone, PartialEq)]
pub struct Skeleton {
    heads: Vec<DVec3>,
    tails: Vec<DVec3>,
    parents: Vec<Option<u32>>,
    names: Option<Vec<String>>,
    depth_order: Vec<u32>,
}

impl Skeleton {
    /// Takes heads, tails and parents (-1 for a root) of B bones, and their names where known.
    ///
    /// # Errors
    /// [`SkeletonError`] naming the first bone at fault.
    pub fn new(
        heads: Vec<DVec3>,
        tails: Vec<DVec3>,
        parents: &[i64],
        names: Option<Vec<String>>,
    ) -> Result<Self, SkeletonError> {
        let bone_count = heads.len();
        let name_count = names.as_ref().map_or(bone_count, Vec::len);
        if [tails.len(), parents.len(), name_count].iter().any(|&n| n != bone_count) {
            let (heads, tails, parents) = (bone_count, tails.len(), parents.len());
            return Err(SkeletonError::Counts { heads, tails, parents, names: name_count });
        }
        for bone in 0..bone_count {
            for (end, point) in [("head", heads[bone]), ("tail", tails[bone])] {
                if !point.is_finite() {
                    return Err(SkeletonError::NonFinite { bone, end });
                }
            }
        }
        let mut checked = Vec::with_capacity(bone_count);
        for (bone, &parent) in parents.iter().enumerate() {
            checked.push(match u32::try_from(parent) {
                Ok(p) if (p as usize) < bone_count => Some(p),
                Err(_) if parent == -1 => None,
                _ => return Err(SkeletonError::ParentOutOfRange { bone, parent, bone_count }),
            });
        }
        if let Some(names) = &names {
            let mut seen = HashMap::with_capacity(bone_count);
            for (second, name) in names.iter().enumerate() {
                if let Some(first) = seen.insert(name, second) {
                    return Err(SkeletonError::DuplicateName { name: name.clone(), first, second });
                }
            }
        }
        let depth_order = parents_first(&checked)?;
        Ok(Self { heads, tails, parents: checked, names, depth_order })
    }

    /// Number of bones.
    #[must_use]
    pub fn bone_count(&self) -> usize {
        self.heads.len()
    }

    /// Heads (B).
    #[must_use]
    pub fn heads(&self) -> &[DVec3] {
        &self.heads
    }

    /// Tails (B).
    #[must_use]
    pub fn tails(&self) -> &[DVec3] {
        &self.tails
    }

    /// Parents (B), `None` for a root.
    #[must_use]
    pub fn parents(&self) -> &[Option<u32>] {
        &self.parents
    }

    /// Names (B), where known.
    #[must_use]
    pub fn names(&self) -> Option<&[String]> {
        self.names.as_deref()
    }

    /// What to call a bone in a message.
    #[must_use]
    pub fn label(&self, bone: usize) -> String {
        self.names.as_ref().map_or_else(|| format!("bone {bone}"), |names| format!("\"{}\"", names[bone]))
    }

    /// All bones, every parent before its children.
    #[must_use]
    pub fn depth_order(&self) -> &[u32] {
        &self.depth_order
    }

    /// Children of each bone, ascending.
    #[must_use]
    pub fn children(&self) -> Vec<Vec<u32>> {
        let mut children = vec![Vec::new(); self.bone_count()];
        for (bone, parent) in self.parents.iter().enumerate() {
            if let Some(parent) = parent {
                children[*parent as usize].push(bone as u32);
            }
        }
        children
    }

    /// This skeleton with its bones numbered as in `like`: bone b takes the place of the bone
    /// `partners[b]`, and the parents are those of `like`. A bone without a partner is a point at
    /// the origin.
    #[must_use]
    pub fn renumbered(&self, like: &Self, partners: &[Option<u32>]) -> Self {
        let place = |points: &[DVec3]| {
            partners.iter().map(|partner| partner.map_or(DVec3::ZERO, |p| points[p as usize])).collect()
        };
        Self { heads: place(&self.heads), tails: place(&self.tails), ..like.clone() }
    }

    /// This skeleton with its bones at other places: finite heads and tails (B).
    pub(crate) fn placed(&self, heads: Vec<DVec3>, tails: Vec<DVec3>) -> Self {
        Self { heads, tails, ..self.clone() }
    }

    /// Length of a bone.
    #[must_use]
    pub fn length(&self, bone: usize) -> f64 {
        self.heads[bone].distance(self.tails[bone])
    }

    /// Bone whose segment is nearest to a point (the lower index where two are equally near) and
    /// its distance; `None` without bones.
    #[must_use]
    pub fn nearest_bone(&self, point: DVec3) -> Option<(usize, f64)> {
        (0..self.bone_count())
            .map(|bone| (bone, super::distance_to_segment(point, self.heads[bone], self.tails[bone])))
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

fn parents_first(parents: &[Option<u32>]) -> Result<Vec<u32>, SkeletonError> {
    let mut order = Vec::with_capacity(parents.len());
    let mut placed = vec![false; parents.len()];
    let mut path = Vec::new();
    for bone in 0..parents.len() {
        let mut current = Some(bone as u32);
        while let Some(b) = current.filter(|&b| !placed[b as usize]) {
            if path.len() > parents.len() {
                return Err(SkeletonError::Cycle { bone });
            }
            path.push(b);
            current = parents[b as usize];
        }
        while let Some(b) = path.pop() {
            placed[b as usize] = true;
            order.push(b);
        }
    }
    Ok(order)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn skeleton(parents: &[i64]) -> Result<Skeleton, SkeletonError> {
        let heads: Vec<DVec3> = (0..parents.len()).map(|i| DVec3::X * i as f64).collect();
        let tails = heads.iter().map(|&h| h + DVec3::X).collect();
        Skeleton::new(heads, tails, parents, None)
    }

    #[test]
    fn parents_may_come_after_their_children() {
        let skeleton = skeleton(&[2, 0, -1, 2]).unwrap();
        assert_eq!(skeleton.depth_order(), [2, 0, 1, 3]);
        assert_eq!(skeleton.children(), [vec![1], vec![], vec![0, 3], vec![]]);
    }

    #[test]
    fn names_the_bone_at_fault() {
        assert_eq!(skeleton(&[-1, 2, 1]), Err(SkeletonError::Cycle { bone: 1 }));
        assert!(matches!(
            skeleton(&[-1, 5]),
            Err(SkeletonError::ParentOutOfRange { bone: 1, parent: 5, .. })
        ));
        assert!(matches!(skeleton(&[-1, -2]), Err(SkeletonError::ParentOutOfRange { bone: 1, .. })));
        let twice = Some(vec!["arm".to_owned(), "arm".to_owned()]);
        let points = vec![DVec3::ZERO; 2];
        assert!(matches!(
            Skeleton::new(points.clone(), points.clone(), &[-1, 0], twice),
            Err(SkeletonError::DuplicateName { first: 0, second: 1, .. })
        ));
        let tails = vec![DVec3::ZERO, DVec3::splat(f64::NAN)];
        let error = Skeleton::new(points, tails, &[-1, 0], None).unwrap_err();
        assert_eq!(error, SkeletonError::NonFinite { bone: 1, end: "tail" });
    }

    #[test]
    fn nearest_bone_prefers_the_lower_index() {
        let skeleton = skeleton(&[-1, 0]).unwrap();
        assert_eq!(skeleton.nearest_bone(DVec3::new(1.0, 1.0, 0.0)), Some((0, 1.0)));
        assert_eq!(skeleton.nearest_bone(DVec3::new(1.5, 1.0, 0.0)), Some((1, 1.0)));
    }
}
