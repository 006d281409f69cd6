//! Retargeting between skeletons whose bones differ: the source skeleton is laid onto the target's
//! rest positions, weights are found for it, and then go over the bone map to the target's bones.
//! Target bones that no source bone stands for get their share last.

use super::auto::BOUND;
use super::differing_shapes::{Differing, Side};
use super::reflection::mirror_image;
use super::unclaimed::Unclaimed;
use super::{Character, Method, RetargetError, Retargeted, Settings, by_method, check_counts, pair_bones};
use crate::mesh::TriangleMesh;
use crate::progress::Progress;
use crate::rig::{BindSettings, BoneMap, Skeleton, bind_weights, map_bones};
use crate::skinning::{Row, SkinWeights, row_of};

/// Gives the target the weights of the source.
///
/// Without landmarks both skeletons are needed, and landmarks are chosen on them. Where both
/// skeletons are given, their bones are paired by [`map_bones`], unless `bone_map` is given.
///
/// # Errors
/// [`RetargetError`]; nothing was changed.
pub fn retarget_weights(
    source: Character<'_>,
    source_weights: &SkinWeights,
    target: Character<'_>,
    bone_map: Option<&BoneMap>,
    landmarks: Option<&[[i64; 2]]>,
    settings: &Settings,
    progress: &Progress,
) -> Result<Retargeted, RetargetError> {
    check_counts(source, source_weights)?;
    let by_method = |target, pairs: Option<&[_]>, settings: &Settings, binds: bool| {
        by_method((source, source_weights), target, pairs, landmarks, (settings, binds), progress)
    };
    let (Some(from), Some(to)) = (source.skeleton, target.skeleton) else {
        return if bone_map.is_some() {
            Err(RetargetError::MapWithoutSkeletons)
        } else {
            by_method(target, None, settings, false).map(|found| found.0)
        };
    };
    let found;
    let bone_map = match bone_map {
        Some(bone_map) => bone_map,
        None => {
            found = map_bones(from, to)?;
            &found
        }
    };
    bone_map.check_skeletons(Some(from), to)?;
    let carries_weight = source_weights.used_bones();
    let image = match settings.method {
        Method::Auto => mirror_image(target.mesh, (from, to), bone_map, &carries_weight)?,
        Method::Paper => None,
    };
    let (mesh, to) = image.as_ref().map_or((target.mesh, to), |(mesh, skeleton)| (mesh, skeleton));
    let target = Character { mesh, skeleton: Some(to) };
    let binds = unclaimed(bone_map, &vec![true; to.bone_count()], to).is_some();
    // A limit is of influences of the target's bones.
    let unlimited = Settings { max_influences: None, ..settings.clone() };
    let (mut result, differing) = match pairs_that_agree(bone_map, &carries_weight, from, to) {
        Some(pairs) => by_method(target, Some(&pairs), &unlimited, binds)?,
        None => {
            let aligned = bone_map.aligned_skeleton(from, to)?;
            let pairs: Vec<Option<u32>> = (0..from.bone_count() as u32).map(Some).collect();
            let aligned = Character { skeleton: Some(&aligned), ..target };
            let (result, differing) = by_method(aligned, Some(&pairs), &unlimited, binds)?;
            let weights = bone_map.transfer(&result.weights, target.mesh.vertices(), to)?;
            (Retargeted { weights, ..result }, differing)
        }
    };
    if settings.method == Method::Auto {
        let characters =
            (Side { mesh: source.mesh, skeleton: from, weights: source_weights }, target.mesh, to);
        result.weights = on_own_bones(result.weights, characters, bone_map, differing, progress)?;
    }
    progress.begin("Limiting influences", 1.0, 1.0)?;
    if let Some(count) = settings.max_influences {
        result.weights = result.weights.limited(count);
    }
    Ok(Retargeted { weights: result.weights.normalized(), ..result })
}

/// Weights of the target with what its own skeleton has to say: where shapes differ, and about
/// bones that only the target has. A map made by hand is taken as it is and leaves those out.
fn on_own_bones(
    weights: SkinWeights,
    (source, mesh, skeleton): (Side<'_>, &TriangleMesh, &Skeleton),
    bone_map: &BoneMap,
    differing: Option<Differing>,
    progress: &Progress,
) -> Result<SkinWeights, RetargetError> {
    let mut used = weights.used_bones();
    let unclaimed = unclaimed(bone_map, &used, skeleton);
    let _binding = progress.part(BOUND, 1.0);
    if let Some(differing) = differing {
        let target = Side { mesh, skeleton, weights: &weights };
        let handed = differing.hand_over(source, target, bone_map, unclaimed.as_ref(), progress)?;
        if let Some(weights) = handed {
            return Ok(weights);
        }
    }
    let Some(unclaimed) = unclaimed else { return Ok(weights) };
    unclaimed.bones().for_each(|bone| used[bone as usize] = true);
    let settings = BindSettings { bones: Some(used), ..BindSettings::default() };
    let alone = bind_weights(mesh, skeleton, &settings, progress)?;
    let alone: Vec<Row> = (0..alone.vertex_count()).map(|v| row_of(&alone, v)).collect();
    Ok(unclaimed.share(&weights, &alone, mesh.vertices()))
}

/// The bones that only the target has; none by a map made by hand.
fn unclaimed<'a>(bone_map: &BoneMap, used: &[bool], skeleton: &'a Skeleton) -> Option<Unclaimed<'a>> {
    if bone_map.is_by_hand() { None } else { Unclaimed::new(bone_map, used, skeleton) }
}

/// The pairs of equal names (or order, without names), if a map says nothing else as far as weights go.
fn pairs_that_agree(
    bone_map: &BoneMap,
    carries_weight: &[bool],
    from: &Skeleton,
    to: &Skeleton,
) -> Option<Vec<Option<u32>>> {
    let pairs = pair_bones(from, to, carries_weight)?;
    let same = |(bone, pair): (usize, &Option<u32>)| {
        !carries_weight[bone] || bone_map.targets(bone) == pair.as_slice()
    };
    pairs.iter().enumerate().all(same).then_some(pairs)
}
