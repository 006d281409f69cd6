//! The template embedded into the shape of a body: from the distance field to joints.

use glam::DVec3;

use super::centreline::Centreline;
use super::choices::Choices;
use super::distance_field::DistanceField;
use super::embedding::{Embedding, Place, Search};
use super::error::FitError;
use super::geodesic::Ways;
use super::joints::Joints;
use super::limbs::{FoundLimb, common_scale, share_bases};
use super::medial_surface::medial_surface;
use super::reduced_skeleton::{Limb, ReducedSkeleton};
use super::refinement::{Refinement, Target};
use super::sphere_graph::SphereGraph;
use super::symmetry::{TemplateMirror, mesh_mirror};
use super::tips::Tips;
use crate::mesh::TriangleMesh;
use crate::progress::Progress;

/// Scales that the search tries, beside the one at which the longest ways are equal.
const SCALES: [f64; 5] = [1.0, 0.87, 1.15, 0.75, 1.32];

/// Joints in the body.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shape {
    /// Places of the joints (J) of limbs and trunk, `None` for others.
    pub(super) places: Vec<Option<DVec3>>,
    /// Joints (J) of limbs that were not found.
    pub(super) missing: Vec<bool>,
    /// Limbs that were not found, and all.
    pub(super) limbs: (usize, usize),
    /// Length in the body for a length in the template.
    pub(super) scale: f64,
    /// Mean penalty of the embedding.
    pub(super) cost: f64,
    pub(super) symmetric: bool,
    /// Joints of the trunk: branchings and where limbs begin, ascending.
    pub(super) trunk: Vec<usize>,
    /// Voxels at the body's tips.
    pub(super) tips: Vec<u32>,
    /// Longest way through the body.
    pub(super) diameter: f64,
}

/// What is embedded where.
pub(super) struct Input<'a> {
    pub(super) body: &'a TriangleMesh,
    pub(super) field: &'a DistanceField,
    pub(super) joints: &'a Joints,
    pub(super) reduced: &'a ReducedSkeleton,
    /// Partners of the template's joints.
    pub(super) mirror: Option<&'a TemplateMirror>,
    pub(super) choices: &'a Choices,
    /// Scale between the sizes of template and body.
    pub(super) size_scale: f64,
}

impl Input<'_> {
    /// Embeds the template; `None` where the body has no tips or the template no limbs.
    pub(super) fn embed(&self, progress: &Progress) -> Result<Option<Shape>, FitError> {
        progress.begin("Finding limbs", 0.4, 0.7)?;
        let ways = Ways::new(self.field);
        let wanted = self.mirror.filter(|_| self.choices.mirror);
        let plane = wanted.and_then(|mirror| mesh_mirror(self.body, mirror.plane.normal));
        let mirrors = wanted.zip(plane);
        progress.report(0.2)?;
        let Some(tips) = Tips::new(&ways, plane.as_ref()) else { return Ok(None) };
        progress.report(0.7)?;
        let graph = SphereGraph::new(self.field, &medial_surface(self.field));
        progress.begin("Embedding the skeleton", 0.7, 0.85)?;
        let first = tips.diameter / self.reduced.diameter;
        let search = |factor: f64| Search {
            reduced: self.reduced,
            points: &self.joints.points,
            tips: &tips,
            tip_places: tips.tips.iter().map(|tip| self.field.position(tip.voxel)).collect(),
            graph: &graph,
            scale: factor * first,
            mirror: self.mirror,
            plane,
        };
        let mut best: Option<(f64, Embedding)> = None;
        for factor in SCALES {
            progress.report(0.5)?;
            if let Some(found) = search(factor).run()
                && best.as_ref().is_none_or(|(_, known)| found.cost < known.cost - 1e-9)
            {
                best = Some((factor, found));
            }
        }
        let Some((factor, embedding)) = best else { return Ok(None) };
        progress.begin("Placing joints", 0.85, 0.95)?;
        let first = factor * first;
        let (mut found, lost) = self.found_limbs(&ways, &tips, &embedding, first);
        if let Some(mirror) = self.mirror {
            share_bases(&mut found, mirror);
        }
        if found.is_empty() {
            return Ok(None);
        }
        let scale = common_scale(&found, self.size_scale);
        let mut trunk = self.reduced.branchings.clone();
        trunk.extend(found.iter().filter_map(|limb| limb.base(scale)));
        trunk.sort_unstable();
        trunk.dedup();
        let mut targets: Vec<Option<Target>> = vec![None; self.joints.points.len()];
        for limb in &found {
            for (joint, place, is_base) in limb.targets(scale, tips.diameter) {
                targets[joint] = Some(Target { place, is_base });
            }
        }
        let refinement = Refinement {
            points: &self.joints.points,
            links: &self.reduced.links,
            targets,
            fixed: self.choices.fixed_joints(self.joints),
            mirrors,
            scale,
            field: self.field,
        };
        let Some(places) = refinement.run() else { return Ok(None) };
        let mut missing = vec![false; places.len()];
        for limb in &lost {
            for &joint in &limb.joints[..limb.joints.len() - 1] {
                missing[joint] = true;
            }
        }
        Ok(Some(Shape {
            places,
            missing,
            limbs: (lost.len(), self.reduced.limbs.len()),
            scale,
            cost: embedding.mean,
            symmetric: mirrors.is_some(),
            trunk,
            tips: tips.tips.iter().filter(|tip| !tip.is_middle).map(|tip| tip.voxel).collect(),
            diameter: tips.diameter,
        }))
    }

    /// Limbs with a tip and their centrelines, and those without.
    fn found_limbs(
        &self,
        ways: &Ways,
        tips: &Tips,
        embedding: &Embedding,
        scale: f64,
    ) -> (Vec<FoundLimb<'_>>, Vec<&Limb>) {
        let (mut found, mut lost) = (Vec::new(), Vec::new());
        for limb in &self.reduced.limbs {
            let place = embedding.nodes.iter().find(|node| node.0 == limb.joints[0]).map(|node| node.1);
            match place {
                Some(Place::Tip(tip)) => {
                    let line = Centreline::new(ways, &tips.tips[tip], tips.middle);
                    let end = limb.joints[0];
                    let is_middle = self.mirror.is_some_and(|m| m.partner[end] == Some(end));
                    let is_shared = embedding.nodes.iter().any(|n| n.0 != end && n.1 == Place::Tip(tip));
                    let beside = match (self.mirror, is_shared) {
                        (Some(mirror), true) => {
                            mirror.plane.normal * mirror.plane.height(self.joints.points[end]).signum()
                        }
                        _ => DVec3::ZERO,
                    };
                    found.push(FoundLimb::new(limb, line, is_middle, beside, scale, tips.diameter));
                }
                _ => lost.push(limb),
            }
        }
        (found, lost)
    }
}
