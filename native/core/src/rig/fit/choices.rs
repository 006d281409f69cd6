//! Choices of a fit, checked against the template.

use glam::DVec3;

use super::error::FitError;
use super::joints::{Joints, bounds};
use crate::rig::Skeleton;

/// Choices of a fit.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FitSettings {
    /// Bones (B) that follow the body; the others, such as controls, are carried along. `None`: all.
    pub deform: Option<Vec<bool>>,
    /// Bones (B) whose ends stay exactly where the template has them. `None`: no bone.
    pub fixed: Option<Vec<bool>>,
    /// Whether to use the mirror plane; `None`: where mesh and template have one.
    pub symmetric: Option<bool>,
}

/// Settings with nothing left open.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Choices {
    /// Bones (B) that follow the body.
    pub(super) deform: Vec<bool>,
    /// Bones (B) that stay.
    pub(super) fixed: Vec<bool>,
    /// Whether a mirror plane may be used.
    pub(super) mirror: bool,
}

impl Choices {
    /// Checks settings against a template.
    pub(super) fn new(template: &Skeleton, settings: &FitSettings) -> Result<Self, FitError> {
        let expected = template.bone_count();
        if expected < 2 {
            return Err(FitError::TooFewBones(expected));
        }
        let chosen = |argument, choice: &Option<Vec<bool>>, otherwise| match choice {
            None => Ok(vec![otherwise; expected]),
            Some(mask) if mask.len() == expected => Ok(mask.clone()),
            Some(mask) => Err(FitError::BoneCounts { argument, given: mask.len(), expected }),
        };
        let deform = chosen("deform", &settings.deform, true)?;
        let fixed = chosen("fixed", &settings.fixed, false)?;
        if !deform.contains(&true) {
            return Err(FitError::NoDeformBones);
        }
        let counted = (0..expected).filter(|&bone| deform[bone]);
        let (low, high) = bounds(counted.flat_map(|b| [template.heads()[b], template.tails()[b]]));
        if !((high - low).is_finite() && (high - low).max_element() > 0.0) {
            return Err(FitError::NoTemplateExtent);
        }
        Ok(Self { deform, fixed, mirror: settings.symmetric != Some(false) })
    }

    /// Places of joints (J) that may not change.
    pub(super) fn fixed_joints(&self, joints: &Joints) -> Vec<Option<DVec3>> {
        let mut fixed = vec![None; joints.points.len()];
        for bone in (0..self.fixed.len()).filter(|&bone| self.fixed[bone]) {
            for joint in [joints.heads[bone], joints.tails[bone]] {
                fixed[joint] = Some(joints.points[joint]);
            }
        }
        fixed
    }

    /// Puts the ends of fixed bones exactly where the template has them.
    pub(super) fn keep_fixed(&self, template: &Skeleton, fitted: &Skeleton) -> Skeleton {
        let ends = |fitted: &[DVec3], template: &[DVec3]| {
            (0..fitted.len()).map(|b| if self.fixed[b] { template[b] } else { fitted[b] }).collect()
        };
        fitted.placed(ends(fitted.heads(), template.heads()), ends(fitted.tails(), template.tails()))
    }
}
