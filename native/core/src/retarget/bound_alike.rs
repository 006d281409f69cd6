//! Source and target bound to their skeletons in one way: the way that explains the source's own
//! weights best.
//!
//! Whoever paints weights begins with some that a program makes from the skeleton, or ends with such
//! as they would make. Two ways stand for all: heat over the surface ([`super::bone_heat`]) and walks
//! through the volume. The share of each is the one whose mix differs least (L1) from what was
//! painted on the source; the target is bound by the same mix.

use super::RetargetError;
use super::bone_heat::bone_heat;
use super::icp::Surroundings;
use super::inpaint::{Row, blend, normalized};
use super::parts::spread;
use crate::progress::Progress;
use crate::rig::{BindSettings, Skeleton, bind_weights};
use crate::skinning::SkinWeights;

/// Shares of heat that are tried: multiples of the inverse of this.
const SHARES: usize = 20;

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
}

/// Binds both characters as the source's `weights` tell.
///
/// # Errors
/// [`RetargetError::Bind`] where a mesh cannot be bound, and for cancelled work.
pub(super) fn bind_alike(
    source: Bindable<'_>,
    weights: &SkinWeights,
    target: Bindable<'_>,
    progress: &Progress,
) -> Result<BoundAlike, RetargetError> {
    let painted: Vec<Row> = (0..weights.vertex_count()).map(|v| row_of(weights, v)).collect();
    let volumetric = by_volume(source, progress)?;
    let heat = by_heat(source, Some(&volumetric), progress)?;
    let off = |share: f64| -> f64 {
        let rows = painted.iter().zip(heat.iter().zip(&volumetric)).filter(|(row, _)| !row.is_empty());
        rows.map(|(row, (heat, volumetric))| spread(row, [&mixed(heat, volumetric, share)].into_iter())).sum()
    };
    let tried = (0..=SHARES).map(|k| k as f64 / SHARES as f64).map(|share| (share, off(share)));
    let share = tried.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0.5, |tried| tried.0);
    let of_target = match share {
        share if share >= 1.0 => by_heat(target, None, progress)?,
        share if share <= 0.0 => by_volume(target, progress)?,
        share => {
            let volumetric = by_volume(target, progress)?;
            mix(&by_heat(target, Some(&volumetric), progress)?, &volumetric, share)
        }
    };
    Ok(BoundAlike { source: mix(&heat, &volumetric, share), target: of_target })
}

/// A row of weights, of sum 1; empty without weights.
pub(super) fn row_of(weights: &SkinWeights, vertex: usize) -> Row {
    normalized(weights.entries(vertex).map(|(bone, weight)| (bone, f64::from(weight))).collect())
}

fn by_volume(character: Bindable<'_>, progress: &Progress) -> Result<Vec<Row>, RetargetError> {
    let settings = BindSettings { bones: Some(character.takes_part.to_vec()), ..BindSettings::default() };
    let weights = bind_weights(character.surface.mesh, character.skeleton, &settings, progress)?;
    Ok((0..weights.vertex_count()).map(|v| row_of(&weights, v)).collect())
}

/// Rows by heat, by `otherwise` where there is none; made here where it is not given.
fn by_heat(
    character: Bindable<'_>,
    otherwise: Option<&[Row]>,
    progress: &Progress,
) -> Result<Vec<Row>, RetargetError> {
    progress.begin("Spreading heat", 0.9, 1.0)?;
    let mut rows = bone_heat(character.surface, character.skeleton, character.takes_part, progress)?;
    if rows.iter().any(Row::is_empty) {
        let made = match otherwise {
            Some(_) => Vec::new(),
            None => by_volume(character, progress)?,
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
