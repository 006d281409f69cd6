//! A template skeleton fitted into a mesh, after Baran & Popović (2007), "Automatic rigging and
//! animation of 3D characters" (Pinocchio).

mod body_part;
mod distance_field;
mod error;
mod joints;
mod template;

pub use error::FitError;

use body_part::{BodyPart, only_triangles};
use distance_field::DistanceField;
use joints::{Joints, bounds};
use template::{Similarity, scaled_template};

use crate::mesh::TriangleMesh;
use crate::progress::Progress;
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

/// How a skeleton was fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FitMethod {
    /// Embedded into the shape.
    Embedding,
    /// Scaled and moved as a whole, and its joints pulled inside.
    Template,
}

/// A skeleton in a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedSkeleton {
    /// The template's bones at their new places.
    pub skeleton: Skeleton,
    /// How they were found.
    pub method: FitMethod,
    /// How well the skeleton fits, from 0 to 1.
    pub score: f64,
    /// What was not found, or why the template was only scaled; empty when all is well.
    pub message: String,
    /// Bones (B) that were placed by the shape; the others were carried along.
    pub found: Vec<bool>,
    /// Whether a mirror plane of mesh and template was used.
    pub symmetric: bool,
}

/// Fits a template into a mesh.
///
/// # Errors
/// [`FitError`] for a mesh or template without size, and choices that are not the template's.
pub fn fit_skeleton(
    mesh: &TriangleMesh,
    template: &Skeleton,
    settings: &FitSettings,
    progress: &Progress,
) -> Result<FittedSkeleton, FitError> {
    let choices = Choices::new(template, settings)?;
    if mesh.triangles().is_empty() {
        return Err(FitError::NoTriangles);
    }
    progress.begin("Filling the body", 0.0, 0.4)?;
    let part = BodyPart::new(mesh);
    let body = only_triangles(mesh, &part.belongs);
    let body = body.as_ref().unwrap_or(mesh);
    let (low, high) = body.bounds();
    if (high - low).max_element().partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return Err(FitError::NoExtent);
    }
    let field = DistanceField::new(body, progress)?;
    let joints = Joints::new(template);
    let mut in_body = vec![false; joints.points.len()];
    for bone in (0..template.bone_count()).filter(|&bone| choices.deform[bone]) {
        in_body[joints.heads[bone]] = true;
        in_body[joints.tails[bone]] = true;
    }
    let places = joints.points.iter().zip(&in_body).filter(|(_, in_body)| **in_body).map(|(&p, _)| p);
    let similarity = Similarity::between(places, low, high).ok_or(FitError::NoTemplateExtent)?;
    let points = scaled_template(&joints, &in_body, similarity, &field);
    let inside = points.iter().filter(|&&p| field.voxel_at(p).is_some()).count();
    Ok(FittedSkeleton {
        skeleton: choices.keep_fixed(template, joints.place(template, &points)),
        method: FitMethod::Template,
        score: 0.5 * inside as f64 / points.len() as f64,
        message: "The template was only scaled.".to_owned(),
        found: vec![false; template.bone_count()],
        symmetric: false,
    })
}

/// Settings with nothing left open, checked against the template.
struct Choices {
    deform: Vec<bool>,
    fixed: Vec<bool>,
}

impl Choices {
    fn new(template: &Skeleton, settings: &FitSettings) -> Result<Self, FitError> {
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
        let ends = template.heads().iter().chain(template.tails()).copied();
        let (low, high) = bounds(ends);
        if !((high - low).is_finite() && (high - low).max_element() > 0.0) {
            return Err(FitError::NoTemplateExtent);
        }
        Ok(Self { deform, fixed })
    }

    /// Puts the ends of fixed bones back where the template has them.
    fn keep_fixed(&self, template: &Skeleton, fitted: Skeleton) -> Skeleton {
        let ends = |fitted: &[glam::DVec3], template: &[glam::DVec3]| {
            (0..fitted.len()).map(|b| if self.fixed[b] { template[b] } else { fitted[b] }).collect()
        };
        fitted.placed(ends(fitted.heads(), template.heads()), ends(fitted.tails(), template.tails()))
    }
}
