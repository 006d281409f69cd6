//! First step of `method="auto"`: the source warped onto the target's skeleton and rest pose.

use super::RetargetError;
use super::bone_rays::{Fan, log_girths, shoot};
use super::icp::Surroundings;
use super::joint_refinement::{Alignment, FitSettings, refine};
use crate::progress::Progress;
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// Rays that measure girth.
const GIRTH_FAN: Fan<'static> = Fan { stations: &[0.1, 0.3, 0.5, 0.7, 0.9], directions: 8 };

/// Aligns a source with `aligned`, the same bones in the target's rest pose. Returns also how much
/// the shapes differ, 0 to 1.
///
/// # Errors
/// [`RetargetError`] when the fit fails or was cancelled.
pub(super) fn align<'a>(
    source: Surroundings<'a>,
    skeleton: &'a Skeleton,
    weights: &'a SkinWeights,
    takes_part: &'a [bool],
    target: Surroundings<'_>,
    aligned: Skeleton,
    progress: &Progress,
) -> Result<(Alignment<'a>, f64), RetargetError> {
    let bone_count = skeleton.bone_count();
    let zeros = vec![0.0; bone_count];
    let mut alignment = Alignment {
        source,
        skeleton,
        weights,
        takes_part,
        aligned,
        log_girths: zeros.clone(),
        twists: zeros,
    };
    let rotations: Vec<_> = alignment.warp().bones.iter().map(|bone| bone.rotation).collect();
    let rays =
        shoot((source, skeleton, weights), (target, &alignment.aligned, &rotations), takes_part, &GIRTH_FAN);
    alignment.log_girths = log_girths(&rays, bone_count);
    let difference = refine(&mut alignment, target, target.shell.extent, &FitSettings::default(), progress)?;
    Ok((alignment, difference))
}
