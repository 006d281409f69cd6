//! The one entrance to fitting: embeds the template, judges the result, and falls back to the scaled
//! template where it is not good enough.

use glam::DVec3;

use super::body_part::{BodyPart, only_triangles};
use super::carry::Carrier;
use super::choices::{Choices, FitSettings};
use super::distance_field::DistanceField;
use super::error::FitError;
use super::joints::Joints;
use super::lengths::keep_lengths;
use super::reduced_skeleton::{ReducedSkeleton, without_ground_roots};
use super::score;
use super::shape::{Input, Shape};
use super::symmetry::TemplateMirror;
use super::template::{Similarity, scaled_template};
use crate::mesh::TriangleMesh;
use crate::progress::Progress;
use crate::rig::Skeleton;

/// Below this score an embedding is not given.
const LEAST_SCORE: f64 = 0.3;
/// Below this score the message says so.
const POOR_SCORE: f64 = 0.5;
/// The scaled template's score is at most this.
const TEMPLATE_SCORE: f64 = 0.25;
/// The largest piece must have this share of the mesh's area.
const LEAST_PIECE: f64 = 0.5;

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

/// Fits a template into a mesh. Both stand upright and face the same way; place, size, proportions and
/// the angles of limbs may differ.
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
    let body_bones = without_ground_roots(template, &choices.deform);
    let mirror = TemplateMirror::new(template, &joints, &body_bones);
    let reduced = ReducedSkeleton::new(template, &joints, body_bones, mirror.as_ref());
    let fit = Fit {
        template,
        joints: &joints,
        mirror: mirror.as_ref(),
        choices: &choices,
        field: &field,
        low,
        high,
    };
    let why = if part.share < LEAST_PIECE {
        "The mesh is in pieces far apart"
    } else if field.voxels.is_empty() {
        "The mesh encloses no volume"
    } else if let Some(reduced) = &reduced {
        let input = Input {
            body,
            field: &field,
            joints: &joints,
            reduced,
            mirror: mirror.as_ref(),
            choices: &choices,
            size_scale: fit.whole(&fit.in_body(&reduced.body_bones))?.scale,
        };
        match input.embed(progress)? {
            Some(shape) => {
                let fitted = fit.embedded(&shape, reduced)?;
                if fitted.score >= LEAST_SCORE {
                    progress.report(1.0)?;
                    return Ok(fitted);
                }
                "The body and the template do not look like the same kind of creature"
            }
            None => "No limbs were found in the mesh",
        }
    } else {
        "The template has no limbs"
    };
    progress.begin("Scaling the template", 0.95, 1.0)?;
    fit.scaled(reduced.as_ref(), why)
}

/// What both ways of fitting need.
struct Fit<'a> {
    template: &'a Skeleton,
    joints: &'a Joints,
    mirror: Option<&'a TemplateMirror>,
    choices: &'a Choices,
    field: &'a DistanceField,
    low: DVec3,
    high: DVec3,
}

impl Fit<'_> {
    /// The template's body laid onto the mesh's bounds.
    fn whole(&self, in_body: &[bool]) -> Result<Similarity, FitError> {
        let points = self.joints.points.iter().zip(in_body).filter(|(_, inside)| **inside);
        Similarity::between(points.map(|(&p, _)| p), self.low, self.high).ok_or(FitError::NoTemplateExtent)
    }

    /// Joints (J) of bones that follow the body.
    fn in_body(&self, body_bones: &[bool]) -> Vec<bool> {
        let mut in_body = vec![false; self.joints.points.len()];
        for bone in (0..body_bones.len()).filter(|&bone| body_bones[bone]) {
            in_body[self.joints.heads[bone]] = true;
            in_body[self.joints.tails[bone]] = true;
        }
        in_body
    }

    fn embedded(&self, shape: &Shape, reduced: &ReducedSkeleton) -> Result<FittedSkeleton, FitError> {
        let whole = self.whole(&self.in_body(&reduced.body_bones))?;
        let mut known = shape.places.clone();
        let fixed = self.choices.fixed_joints(self.joints);
        for (place, fixed) in known.iter_mut().zip(&fixed) {
            *place = fixed.or(*place);
        }
        let carrier = Carrier {
            template: self.template,
            joints: self.joints,
            reduced,
            field: self.field,
            scale: shape.scale,
            whole,
        };
        let mut points = carrier.run(&known);
        let fixed: Vec<bool> = fixed.iter().map(Option::is_some).collect();
        keep_lengths(self.template, self.joints, shape.scale, &fixed, &mut points);
        let skeleton = self.choices.keep_fixed(self.template, &self.joints.place(self.template, &points));
        let is_found = |bone: usize| {
            let ends = [self.joints.heads[bone], self.joints.tails[bone]];
            reduced.body_bones[bone] && ends.iter().all(|&j| shape.places[j].is_some() && !shape.missing[j])
        };
        let found: Vec<bool> = (0..self.template.bone_count()).map(is_found).collect();
        let bones = || (0..found.len()).filter(|&bone| found[bone]);
        let segments: Vec<_> = bones().map(|b| (skeleton.heads()[b], skeleton.tails()[b])).collect();
        let lengths: Vec<_> = bones().map(|b| (self.template.length(b), skeleton.length(b))).collect();
        let (lost, all) = shape.limbs;
        let inside = score::share_inside(&segments, self.field);
        let share = (all - lost) as f64 / all.max(1) as f64;
        let trunk = shape.trunk.iter().filter_map(|&j| Some((self.joints.points[j], shape.places[j]?)));
        let across = self.mirror.map(|mirror| mirror.plane.normal);
        let bare = score::bare_tips(&segments, self.field, &shape.tips, shape.diameter);
        let score = inside
            * score::of_cost(shape.cost)
            * score::of_lengths(&lengths)
            * score::of_trunk(&trunk.collect::<Vec<_>>(), across)
            * score::of_bare_tips(&bare)
            * share
            * share;
        let message = match lost {
            0 if !bare.is_empty() => {
                let limbs = match bare.len() {
                    1 => "1 limb of the mesh has".to_owned(),
                    count => format!("{count} limbs of the mesh have"),
                };
                format!("{limbs} no bones; the template may be of another kind of creature.")
            }
            0 if score < POOR_SCORE => {
                "The fit is poor; the template may be of another kind of creature.".to_owned()
            }
            0 => String::new(),
            1 => format!("1 of {all} limbs was not found in the mesh; it was carried along."),
            _ => format!("{lost} of {all} limbs were not found in the mesh; they were carried along."),
        };
        Ok(FittedSkeleton {
            skeleton,
            method: FitMethod::Embedding,
            score,
            message: self.with_lengthless(message),
            found,
            symmetric: shape.symmetric,
        })
    }

    fn scaled(&self, reduced: Option<&ReducedSkeleton>, why: &str) -> Result<FittedSkeleton, FitError> {
        let body_bones = reduced.map_or(&self.choices.deform, |reduced| &reduced.body_bones);
        let in_body = self.in_body(body_bones);
        let whole = self.whole(&in_body)?;
        let mut points = scaled_template(self.joints, &in_body, whole, self.field);
        let fixed = self.choices.fixed_joints(self.joints);
        for (point, fixed) in points.iter_mut().zip(&fixed) {
            *point = fixed.unwrap_or(*point);
        }
        let fixed: Vec<bool> = fixed.iter().map(Option::is_some).collect();
        keep_lengths(self.template, self.joints, whole.scale, &fixed, &mut points);
        let fitted = self.joints.place(self.template, &points);
        let skeleton = self.choices.keep_fixed(self.template, &fitted);
        let bones = (0..body_bones.len()).filter(|&bone| body_bones[bone]);
        let segments: Vec<_> = bones.map(|b| (skeleton.heads()[b], skeleton.tails()[b])).collect();
        let inside = score::share_inside(&segments, self.field);
        let message = format!("{why}, so the template was only moved and scaled as a whole.");
        Ok(FittedSkeleton {
            skeleton,
            method: FitMethod::Template,
            score: TEMPLATE_SCORE * inside,
            message: self.with_lengthless(message),
            found: vec![false; self.template.bone_count()],
            symmetric: false,
        })
    }

    /// Adds a sentence about bones without length.
    fn with_lengthless(&self, message: String) -> String {
        let lengthless: Vec<usize> = (0..self.template.bone_count())
            .filter(|&bone| self.joints.heads[bone] == self.joints.tails[bone])
            .collect();
        let note = match lengthless[..] {
            [] => return message,
            [bone] => format!("{} has no length and was left so.", self.template.label(bone)),
            [bone, ..] => format!(
                "{} and {} other bones have no length and were left so.",
                self.template.label(bone),
                lengthless.len() - 1
            ),
        };
        if message.is_empty() { note } else { format!("{message} {note}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::fit::FitError;
    use crate::rig::fit::test_bodies::{bone, figure, skeleton, tubes};

    fn fitted(mesh: &TriangleMesh, settings: &FitSettings) -> FittedSkeleton {
        fit_skeleton(mesh, &skeleton(), settings, &Progress::new()).unwrap()
    }

    #[test]
    fn arms_follow_another_pose_and_left_stays_left() {
        for lowered in [0.0, 0.5, 0.9] {
            let found = fitted(&figure(lowered), &FitSettings::default());
            assert_eq!((found.method, found.symmetric), (FitMethod::Embedding, true));
            assert!(found.score > 0.7 && found.message.is_empty(), "{} {}", found.score, found.message);
            for (side, sign) in [("l", 1.0), ("r", -1.0)] {
                let along = DVec3::new(sign * lowered.cos(), 0.0, -lowered.sin());
                let shoulder = DVec3::new(0.14 * sign, 0.0, 1.36);
                for (name, length) in [("lowerarm", 0.27), ("hand", 0.53)] {
                    let head = found.skeleton.heads()[bone(&found.skeleton, &format!("{name}_{side}"))];
                    let miss = head.distance(shoulder + along * length);
                    assert!(miss < 0.08, "{name}_{side} {lowered} misses by {miss}");
                }
                let knee = found.skeleton.heads()[bone(&found.skeleton, &format!("calf_{side}"))];
                assert!(knee.distance(DVec3::new(0.1 * sign, 0.0, 0.48)) < 0.08, "{knee}");
            }
            assert!(
                !found.found[bone(&found.skeleton, "root")] && found.found[bone(&found.skeleton, "hand_l")]
            );
        }
    }

    #[test]
    fn fixed_bones_stay_and_connected_bones_stay_connected() {
        let template = skeleton();
        let mut fixed = vec![false; template.bone_count()];
        let calf = bone(&template, "calf_l");
        fixed[calf] = true;
        let found = fitted(&figure(0.5), &FitSettings { fixed: Some(fixed), ..FitSettings::default() });
        assert_eq!(found.skeleton.heads()[calf], template.heads()[calf]);
        assert_eq!(found.skeleton.tails()[calf], template.tails()[calf]);
        for (child, parent) in [("calf_l", "thigh_l"), ("foot_l", "calf_l"), ("lowerarm_r", "upperarm_r")] {
            let head = found.skeleton.heads()[bone(&template, child)];
            assert_eq!(head, found.skeleton.tails()[bone(&template, parent)]);
        }
    }

    #[test]
    fn what_has_no_shape_gets_the_scaled_template() {
        let sheet = figure(0.5).vertices().iter().map(|v| DVec3::new(v.x, 0.0, v.z)).collect();
        let sheet = TriangleMesh::new(sheet, figure(0.5).triangles().to_vec()).unwrap();
        let ball = tubes(&[(DVec3::ZERO, DVec3::Z * 1e-3, 1.0)]);
        for mesh in [sheet, ball] {
            let found = fitted(&mesh, &FitSettings::default());
            assert_eq!(found.method, FitMethod::Template);
            assert!(found.score < LEAST_SCORE && !found.message.is_empty());
            assert!(found.skeleton.heads().iter().all(|head| head.is_finite()));
        }
    }

    #[test]
    fn wrong_input_is_named() {
        let template = skeleton();
        let error = |mesh: &TriangleMesh, template: &Skeleton, settings: &FitSettings| {
            fit_skeleton(mesh, template, settings, &Progress::new()).unwrap_err()
        };
        let point = TriangleMesh::new(vec![DVec3::ONE; 3], vec![[0, 1, 2]]).unwrap();
        let all = FitSettings::default();
        assert_eq!(error(&point, &template, &all), FitError::NoExtent);
        let nothing = TriangleMesh::new(vec![DVec3::ONE], vec![]).unwrap();
        assert_eq!(error(&nothing, &template, &all), FitError::NoTriangles);
        let one = Skeleton::new(vec![DVec3::ZERO], vec![DVec3::X], &[-1], None).unwrap();
        assert_eq!(error(&figure(0.5), &one, &all), FitError::TooFewBones(1));
        let short = FitSettings { fixed: Some(vec![true]), ..FitSettings::default() };
        let expected = template.bone_count();
        let counts = FitError::BoneCounts { argument: "fixed", given: 1, expected };
        assert_eq!(error(&figure(0.5), &template, &short), counts);
        let progress = Progress::new();
        progress.cancel();
        let cancelled = fit_skeleton(&figure(0.5), &template, &all, &progress);
        assert!(matches!(cancelled, Err(FitError::Cancelled(_))));
    }
}
