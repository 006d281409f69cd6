//! Why bones cannot be mapped, naming the bone or both skeletons' bones.

/// A bone map that cannot be made or used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BoneMapError {
    /// No bone of the source corresponds to any bone of the target.
    #[error(
        "no bone of the source has a counterpart in the target; source: {source_bones}; target: {target_bones}"
    )]
    NothingInCommon {
        /// The source's bones, the first few of many.
        source_bones: String,
        /// The target's bones, the first few of many.
        target_bones: String,
    },
    /// The map has another number of entries than the source has bones.
    #[error("the bone map has {entries} entries, but the source has {bones} bones")]
    Count {
        /// Entries of the map.
        entries: usize,
        /// Bones of the source.
        bones: usize,
    },
    /// An entry names a target bone that does not exist.
    #[error("source bone {bone} is mapped to target bone {index}, but the target has {count} bones")]
    OutOfRange {
        /// What the source bone is called.
        bone: String,
        /// The index given.
        index: i64,
        /// Bones of the target.
        count: usize,
    },
    /// An entry names one target bone twice.
    #[error("source bone {bone} is mapped to target bone {target} twice")]
    Repeated {
        /// What the source bone is called.
        bone: String,
        /// What the target bone is called.
        target: String,
    },
    /// The target bones of one source bone do not lie one below the other.
    #[error(
        "source bone {bone} is mapped to {first} and {second}, which are not on one chain of the target; \
         give several target bones only from the top of a chain to its end"
    )]
    NotAChain {
        /// What the source bone is called.
        bone: String,
        /// A target bone.
        first: String,
        /// The next one, which is not on a chain with it.
        second: String,
    },
    /// The map was made for other skeletons.
    #[error("the bone map belongs to {expected} {side} bones, but there are {found}")]
    OtherSkeleton {
        /// "source" or "target".
        side: &'static str,
        /// Bones that the map was made for.
        expected: usize,
        /// Bones that were given.
        found: usize,
    },
}

/// The labels of a skeleton's bones, the first few of many.
pub(super) fn bone_list(skeleton: &crate::rig::Skeleton) -> String {
    const SHOWN: usize = 12;
    let count = skeleton.bone_count();
    let shown: Vec<String> = (0..count.min(SHOWN)).map(|bone| skeleton.label(bone)).collect();
    match count {
        0 => "none".to_owned(),
        n if n > SHOWN => format!("{} and {} more", shown.join(", "), n - SHOWN),
        _ => shown.join(", "),
    }
}
