//! Source and target bound to their skeletons in one way: the way that explains the source's own
//! weights best.
//!
//! Whoever paints weights begins with some that a program makes from the skeleton, or ends with such
//! as they would make. Two ways stand for all: heat over the surface ([`bone_heat`]) and walks
//! through the volume. The share of each is the one whose mix differs least (L1) from what was
//! painted on the source; the target is bound by the same mix. Programs differ in whether a bone warms skin that
//! it does not see; the source tells that too, and where it has no such skin, bones warm what they see.
//!
//! A bone without weight may be one that nobody was to use, or one that the bind itself gave nothing, such as the
//! end of a toe deep in a foot. Where heat prevails and leaves such a bone cold on the source, it may warm the target.

use super::RetargetError;
use super::icp::Surroundings;
use super::parts::spread;
use crate::progress::Progress;
use crate::rig::{BindSettings, BoneMap, Sides, Skeleton, bind_weights, bone_heat};
use crate::skinning::SkinWeights;
use crate::skinning::{Row, blend, row_of};

/// Shares of heat that are tried: multiples of the inverse of this.
const SHARES: usize = 20;
/// Heat prevails from this share on.
const PREVAILS: f64 = 0.5;

/// A character that can be bound.
#[derive(Clone, Copy)]
pub(super) struct Bindable<'a> {
    pub(super) surface: Surroundings<'a>,
    pub(super) skeleton: &'a Skeleton,
    /// The bones (B) that move skin.
    pub(super) takes_part: &'a [bool],
}

/// Rows of both characters over their own bones, of sum 1.
pub(super) struct BoundAlike {
    pub(super) source: Vec<Row>,
    pub(super) target: Vec<Row>,
    /// Mean difference (L1) of the source's weights from its rows, 0 to 2.
    pub(super) unexplained: f64,
}

/// Binds both characters as the source's `weights` tell. Counterparts of the bones that its way of binding leaves
/// without weight take part in the target too.
///
/// # Errors
/// [`RetargetError::Bind`] where a mesh cannot be bound, and for cancelled work.
pub(super) fn bind_alike(
    source: Bindable<'_>,
    weights: &SkinWeights,
    target: Bindable<'_>,
    bone_map: &BoneMap,
    progress: &Progress,
) -> Result<BoundAlike, RetargetError> {
    let painted: Vec<Row> = (0..weights.vertex_count()).map(|v| row_of(weights, v)).collect();
    let (volumetric, seen) = {
        let _source = progress.part(0.0, 0.4);
        both(source, true, progress)?
    };
    let unseen = {
        let _source = progress.part(0.4, 0.5);
        by_heat(source, false, Some(&volumetric), progress)?
    };
    let _target = progress.part(0.5, 1.0);
    let off = |heat: &[Row], share: f64| -> f64 {
        let rows = painted.iter().zip(heat.iter().zip(&volumetric)).filter(|(row, _)| !row.is_empty());
        rows.map(|(row, (heat, volumetric))| spread(row, [&mixed(heat, volumetric, share)].into_iter())).sum()
    };
    let counted = painted.iter().filter(|row| !row.is_empty()).count().max(1) as f64;
    let best = |heat: &[Row]| {
        let tried = (0..=SHARES).map(|k| k as f64 / SHARES as f64).map(|share| (share, off(heat, share)));
        tried.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0.5, 0.0))
    };
    let (of_seen, of_all) = (best(&seen), best(&unseen));
    let sight = of_seen.1 <= of_all.1;
    let ((share, left), heat) = if sight { (of_seen, seen) } else { (of_all, unseen) };
    let mut takes_part = target.takes_part.to_vec();
    if share >= PREVAILS {
        let cold = cold_bones((source, sight), bone_map, &heat, progress)?;
        cold.iter()
            .flat_map(|&bone| bone_map.targets(bone))
            .for_each(|&bone| takes_part[bone as usize] = true);
    }
    let target = Bindable { takes_part: &takes_part, ..target };
    let of_target = match share {
        share if share >= 1.0 => by_heat(target, sight, None, progress)?,
        share if share <= 0.0 => by_volume(target, progress)?,
        share => {
            let (volumetric, heat) = both(target, sight, progress)?;
            mix(&heat, &volumetric, share)
        }
    };
    let source = mix(&heat, &volumetric, share);
    Ok(BoundAlike { source, target: of_target, unexplained: left / counted })
}

/// Bones without weight that hang on one with weight, and that heat leaves without.
fn cold_bones(
    (source, sight): (Bindable<'_>, bool),
    bone_map: &BoneMap,
    otherwise: &[Row],
    progress: &Progress,
) -> Result<Vec<usize>, RetargetError> {
    let hangs = |bone: usize| source.skeleton.parents()[bone].is_some_and(|p| source.takes_part[p as usize]);
    let idle: Vec<usize> = (0..source.takes_part.len())
        .filter(|&bone| !source.takes_part[bone] && hangs(bone) && !bone_map.targets(bone).is_empty())
        .collect();
    if idle.is_empty() {
        return Ok(idle);
    }
    let mut takes_part = source.takes_part.to_vec();
    idle.iter().for_each(|&bone| takes_part[bone] = true);
    let rows = by_heat(Bindable { takes_part: &takes_part, ..source }, sight, Some(otherwise), progress)?;
    let mut warm = vec![false; takes_part.len()];
    rows.iter().flatten().for_each(|&(bone, _)| warm[bone as usize] = true);
    Ok(idle.into_iter().filter(|&bone| !warm[bone]).collect())
}

/// Rows by volume and by heat.
fn both(
    character: Bindable<'_>,
    sight: bool,
    progress: &Progress,
) -> Result<(Vec<Row>, Vec<Row>), RetargetError> {
    let volumetric = {
        let _volumetric = progress.part(0.0, 0.7);
        by_volume(character, progress)?
    };
    let _heat = progress.part(0.7, 1.0);
    let heat = by_heat(character, sight, Some(&volumetric), progress)?;
    Ok((volumetric, heat))
}

fn by_volume(character: Bindable<'_>, progress: &Progress) -> Result<Vec<Row>, RetargetError> {
    let settings = BindSettings { bones: Some(character.takes_part.to_vec()), ..BindSettings::default() };
    let weights = bind_weights(character.surface.mesh, character.skeleton, &settings, progress)?;
    Ok((0..weights.vertex_count()).map(|v| row_of(&weights, v)).collect())
}

/// Rows by heat, by `otherwise` where there is none; made here where it is not given.
fn by_heat(
    character: Bindable<'_>,
    sight: bool,
    otherwise: Option<&[Row]>,
    progress: &Progress,
) -> Result<Vec<Row>, RetargetError> {
    progress.begin("Spreading heat", 0.0, 0.5)?;
    let Surroundings { mesh, shell, query } = character.surface;
    let mut rows = match shell.welded(mesh) {
        Ok(welded) => {
            let sides = Sides { side: &shell.side, extent: shell.extent };
            let warmed = bone_heat(
                &welded,
                sides,
                character.skeleton,
                character.takes_part,
                sight.then_some(query),
                progress,
            )?;
            shell.stands_for().iter().map(|&v| warmed[v as usize].clone()).collect()
        }
        Err(_) => vec![Row::new(); mesh.vertex_count()],
    };
    if rows.iter().any(Row::is_empty) {
        let made = match otherwise {
            Some(_) => Vec::new(),
            None => {
                let _volumetric = progress.part(0.5, 1.0);
                by_volume(character, progress)?
            }
        };
        let otherwise = otherwise.unwrap_or(&made);
        let cold = rows.iter_mut().zip(otherwise).filter(|(row, _)| row.is_empty());
        cold.for_each(|(row, otherwise)| row.clone_from(otherwise));
    }
    Ok(rows)
}

fn mixed(heat: &Row, volumetric: &Row, share: f64) -> Row {
    blend([(heat, share), (volumetric, 1.0 - share)].into_iter())
}

fn mix(heat: &[Row], volumetric: &[Row], share: f64) -> Vec<Row> {
    heat.iter().zip(volumetric).map(|(heat, volumetric)| mixed(heat, volumetric, share)).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::shell::Shell;
    use super::*;
    use crate::mesh::SurfaceQuery;
    use crate::mesh::TriangleMesh;
    use crate::mesh::test_surfaces::{joined, mapped, tube};
    use crate::rig::map_bones;

    /// Two limbs side by side; the bone of the second ends where the limb has three quarters of its length to go.
    fn limbs() -> (TriangleMesh, Skeleton) {
        let limb = |x: f64| mapped(&tube(0.5, 4.0, 24, 48), |p| p + DVec3::X * x);
        let (heads, tails) =
            ([DVec3::ZERO, DVec3::X * 1.2], [DVec3::new(0.0, 0.0, 4.0), DVec3::new(1.2, 0.0, 1.0)]);
        let skeleton = Skeleton::new(heads.to_vec(), tails.to_vec(), &[-1, -1], None).unwrap();
        (joined(&limb(0.0), &limb(1.2)), skeleton)
    }

    #[test]
    fn the_source_s_weights_tell_whether_bones_warm_what_they_do_not_see() {
        let (mesh, skeleton) = limbs();
        let query = SurfaceQuery::new(&mesh).unwrap();
        let shell = Shell::new(&mesh, &query, &Progress::new()).unwrap();
        let surface = Surroundings { mesh: &mesh, query: &query, shell: &shell };
        let bindable = Bindable { surface, skeleton: &skeleton, takes_part: &[true, true] };
        let bone_map = map_bones(&skeleton, &skeleton).unwrap();
        let made = [true, false].map(|sight| by_heat(bindable, sight, None, &Progress::new()).unwrap());
        let far = |a: &[Row], b: &[Row]| -> f64 {
            a.iter().zip(b).map(|(a, b)| spread(a, [b].into_iter())).fold(0.0, f64::max)
        };
        assert!(far(&made[0], &made[1]) > 1.0);
        for rows in made {
            let painted = SkinWeights::from_rows(rows.iter().cloned(), 2);
            let found = bind_alike(bindable, &painted, bindable, &bone_map, &Progress::new()).unwrap();
            assert!(found.unexplained < 1e-6 && far(&found.target, &rows) < 1e-9);
        }
    }

    #[test]
    fn an_idle_bone_is_cold_where_others_are_nearer_to_all_skin() {
        let limb = tube(0.5, 4.0, 32, 64);
        let query = SurfaceQuery::new(&limb).unwrap();
        let shell = Shell::new(&limb, &query, &Progress::new()).unwrap();
        let surface = Surroundings { mesh: &limb, query: &query, shell: &shell };
        // Two bones with weight, one beyond the end of the limb, one below its skin, and one that hangs on none.
        let at = |x: f64, z: f64| DVec3::new(x, 0.0, z);
        let heads = vec![at(0.0, 0.0), at(0.0, 2.0), at(0.0, 4.2), at(0.4, 0.5), at(0.0, 9.0)];
        let tails = vec![at(0.0, 2.0), at(0.0, 4.0), at(0.0, 4.3), at(0.4, 1.5), at(0.0, 9.5)];
        let skeleton = Skeleton::new(heads, tails, &[-1, 0, 1, 0, -1], None).unwrap();
        let takes_part = [true, true, false, false, false];
        let bindable = Bindable { surface, skeleton: &skeleton, takes_part: &takes_part };
        let bone_map = map_bones(&skeleton, &skeleton).unwrap();
        let otherwise = vec![Row::new(); limb.vertex_count()];
        assert_eq!(cold_bones((bindable, false), &bone_map, &otherwise, &Progress::new()).unwrap(), [2]);
    }
}
