//! Pairs the bones of two skeletons that are alike.

use std::collections::HashMap;

use crate::rig::Skeleton;

/// Target bone of each source bone: by name where both skeletons have names, otherwise by order.
/// `None` where that leaves a bone that carries weight without a partner, or orders differ in length.
#[must_use]
pub fn pair_bones(source: &Skeleton, target: &Skeleton, carries_weight: &[bool]) -> Option<Vec<Option<u32>>> {
    let count = source.bone_count();
    let pairs: Vec<Option<u32>> = match (source.names(), target.names()) {
        (Some(names), Some(target_names)) => {
            let by_name: HashMap<&str, u32> = target_names.iter().map(String::as_str).zip(0..).collect();
            names.iter().map(|name| by_name.get(name.as_str()).copied()).collect()
        }
        _ if count == target.bone_count() => (0..count as u32).map(Some).collect(),
        _ => return None,
    };
    let complete = pairs.iter().zip(carries_weight).all(|(pair, weighted)| pair.is_some() || !weighted);
    complete.then_some(pairs)
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
    fn a_weighted_bone_without_a_partner_is_no_pairing() {
        let (source, target) = (skeleton(&["hip", "arm"]), skeleton(&["hip", "Arm"]));
        assert_eq!(pair_bones(&source, &target, &[true, true]), None);
        assert_eq!(pair_bones(&source, &target, &[true, false]).unwrap(), [Some(0), None]);
    }

    #[test]
    fn without_names_counts_must_agree() {
        let points = vec![DVec3::ZERO; 2];
        let two = Skeleton::new(points.clone(), points, &[-1, 0], None).unwrap();
        assert_eq!(pair_bones(&two, &two, &[true; 2]).unwrap(), [Some(0), Some(1)]);
        assert_eq!(pair_bones(&two, &skeleton(&["hip"]), &[true; 2]), None);
    }
}
