//! Pairs the bones of two skeletons.

use std::collections::HashMap;

use super::RetargetError;
use crate::rig::Skeleton;

/// Target bone of each source bone: by name where both skeletons have names, otherwise by order.
/// A bone that carries no weight may stay without a partner.
///
/// # Errors
/// [`RetargetError::BoneCounts`] when bones without names differ in number, and
/// [`RetargetError::UnmatchedBones`] with the weighted source bones that the target lacks.
pub fn pair_bones(
    source: &Skeleton,
    target: &Skeleton,
    carries_weight: &[bool],
) -> Result<Vec<Option<u32>>, RetargetError> {
    let (Some(source_names), Some(target_names)) = (source.names(), target.names()) else {
        if source.bone_count() != target.bone_count() {
            return Err(RetargetError::BoneCounts {
                source_bones: source.bone_count(),
                target_bones: target.bone_count(),
            });
        }
        return Ok((0..source.bone_count() as u32).map(Some).collect());
    };
    let by_name: HashMap<&str, u32> = target_names.iter().map(String::as_str).zip(0..).collect();
    let pairs: Vec<Option<u32>> =
        source_names.iter().map(|name| by_name.get(name.as_str()).copied()).collect();
    let missing: Vec<&str> = source_names
        .iter()
        .zip(&pairs)
        .zip(carries_weight)
        .filter(|((_, pair), weighted)| pair.is_none() && **weighted)
        .map(|((name, _), _)| name.as_str())
        .collect();
    if missing.is_empty() {
        return Ok(pairs);
    }
    let unused = target_names.iter().filter(|name| !source_names.contains(name)).map(String::as_str);
    Err(RetargetError::UnmatchedBones {
        count: missing.len(),
        missing: list(missing.iter().copied()),
        target_only: list(unused),
    })
}

/// Names for a message, the first few of many.
fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    const SHOWN: usize = 8;
    let names: Vec<&str> = names.collect();
    let shown = names.iter().take(SHOWN).copied().collect::<Vec<_>>().join(", ");
    match names.len() {
        0 => "none".to_owned(),
        n if n > SHOWN => format!("{shown} and {} more", n - SHOWN),
        _ => shown,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn skeleton(names: &[&str]) -> Skeleton {
        let points: Vec<DVec3> = names.iter().map(|_| DVec3::ZERO).collect();
        let names = Some(names.iter().map(|&n| n.to_owned()).collect());
        Skeleton::new(points.clone(), points.clone(), &vec![-1; points.len()], names).unwrap()
    }

    #[test]
    fn pairs_by_name_in_any_order() {
        let (source, target) = (skeleton(&["hip", "arm", "ik"]), skeleton(&["arm", "toe", "hip"]));
        let pairs = pair_bones(&source, &target, &[true, true, false]).unwrap();
        assert_eq!(pairs, [Some(2), Some(0), None]);
    }

    #[test]
    fn says_which_weighted_bones_are_missing() {
        let (source, target) = (skeleton(&["hip", "arm"]), skeleton(&["hip", "Arm"]));
        let error = pair_bones(&source, &target, &[true, true]).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("arm") && text.contains("Arm"), "{text}");
    }

    #[test]
    fn without_names_counts_must_agree() {
        let points = vec![DVec3::ZERO; 2];
        let two = Skeleton::new(points.clone(), points, &[-1, 0], None).unwrap();
        assert_eq!(pair_bones(&two, &two, &[true; 2]).unwrap(), [Some(0), Some(1)]);
        let error = pair_bones(&two, &skeleton(&["hip"]), &[true; 2]).unwrap_err();
        assert_eq!(error, RetargetError::BoneCounts { source_bones: 2, target_bones: 1 });
    }
}
