//! Joints refined against the surfaces: the aligned skeleton is moved, turned and thickened so that
//! the warped source meets the target.
//!
//! A Gauss-Newton fit of joint positions, turns about the bones and girths to point-to-plane
//! distances (Chen and Medioni 1992; rigid parts as in Pauly et al. 2005 are replaced by the skin's
//! own blend). How far joints may move is a matter of measurement: their given places count with
//! an assumed error of a share of the height, the surfaces with the distances still left, bone by
//! bone. Skeletons that are right stay, shapes that are far apart move nothing, and joints that
//! were placed by eye find their place inside the limb.

use glam::DVec3;
use rayon::prelude::*;

use super::RetargetError;
use super::bone_rays::Surface;
use super::joint_system::{self, Meeting, Unknowns};
use super::warp::Warp;
use crate::mesh::TriangleMesh;
use crate::progress::Progress;
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// Settings of the fit.
#[derive(Debug, Clone, Copy)]
pub(super) struct FitSettings {
    /// Number of Gauss-Newton steps.
    pub(super) steps: u32,
    /// Assumed error of the given joints as a share of the character's extent.
    pub(super) joint_error: f64,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self { steps: 12, joint_error: 0.015 }
    }
}

/// Largest change of the logarithm of a girth in a step.
const GIRTH_STEP: f64 = 0.2;
/// Cosine of the largest angle between normals that may meet.
const NORMALS: f64 = 0.5;

/// A source and the skeleton that it is aligned to.
pub(super) struct Alignment<'a> {
    pub(super) mesh: &'a TriangleMesh,
    pub(super) outward: f64,
    pub(super) skeleton: &'a Skeleton,
    pub(super) weights: &'a SkinWeights,
    pub(super) takes_part: &'a [bool],
    /// Heads and tails in the target, bones numbered as in the source.
    pub(super) aligned: Skeleton,
    /// Logarithm of the ratio of girths (B).
    pub(super) log_girths: Vec<f64>,
    /// Turn about each aligned bone (B), radians.
    pub(super) twists: Vec<f64>,
}

impl Alignment<'_> {
    pub(super) fn warp(&self) -> Warp {
        let girths: Vec<f64> = self.log_girths.iter().map(|&g| libm::exp(g)).collect();
        Warp::new(self.skeleton, &self.aligned, self.takes_part, &girths, &self.twists)
    }
}

/// Fits the alignment to the target's surface, whose size is `extent`.
///
/// # Errors
/// [`RetargetError::Cancelled`], [`RetargetError::Linalg`].
pub(super) fn refine(
    alignment: &mut Alignment<'_>,
    target: &Surface<'_>,
    extent: f64,
    settings: &FitSettings,
    progress: &Progress,
) -> Result<(), RetargetError> {
    let unknowns = Unknowns::new(alignment.skeleton, &alignment.aligned, alignment.takes_part, extent);
    let target_normals: Vec<DVec3> =
        target.mesh.vertex_normals().into_iter().map(|n| n * target.outward).collect();
    for step in 0..settings.steps {
        progress.report(f64::from(step) / f64::from(settings.steps))?;
        let warp = alignment.warp();
        let points = warp.apply(alignment.mesh.vertices(), alignment.weights);
        let meetings = meet(alignment, &points, target, &target_normals, progress)?;
        let step = joint_system::step(alignment, &warp, &points, &meetings, &unknowns, settings.joint_error * extent);
        let step = step.map_err(|error| RetargetError::Spectral { side: "target", error: error.into() })?;
        update(alignment, &unknowns, &step);
    }
    Ok(())
}

/// Closest points of the target for the warped vertices, those whose normals agree.
fn meet(
    alignment: &Alignment<'_>,
    points: &[DVec3],
    target: &Surface<'_>,
    target_normals: &[DVec3],
    progress: &Progress,
) -> Result<Vec<Option<Meeting>>, RetargetError> {
    const CHUNK: usize = 1 << 14;
    let normals = vertex_normals(points, alignment.mesh.triangles(), alignment.outward);
    let find = |(vertex, &point): (usize, &DVec3)| {
        if alignment.weights.row(vertex).0.is_empty() {
            return None;
        }
        let closest = target.query.closest_point(point)?;
        let corners = target.mesh.triangles()[closest.triangle as usize];
        let normal: DVec3 =
            corners.iter().zip(closest.barycentric).map(|(&c, share)| target_normals[c as usize] * share).sum();
        let normal = normal.normalize_or_zero();
        (normal.dot(normals[vertex]) > NORMALS).then(|| Meeting {
            normal,
            gap: normal.dot(closest.position - point),
            distance: closest.distance,
        })
    };
    let mut meetings = Vec::with_capacity(points.len());
    for (chunk, some) in points.chunks(CHUNK).enumerate() {
        let found: Vec<_> =
            some.par_iter().enumerate().map(|(i, point)| find((chunk * CHUNK + i, point))).collect();
        meetings.extend(found);
        if progress.is_cancelled() {
            return Err(crate::progress::Cancelled.into());
        }
    }
    Ok(meetings)
}

/// Area-weighted normals of moved vertices.
pub(super) fn vertex_normals(points: &[DVec3], triangles: &[[u32; 3]], outward: f64) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; points.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|v| points[v as usize]);
        let normal = (b - a).cross(c - a) * outward;
        triangle.iter().for_each(|&v| normals[v as usize] += normal);
    }
    normals.into_iter().map(DVec3::normalize_or_zero).collect()
}

/// Takes a step of the fit.
fn update(alignment: &mut Alignment<'_>, unknowns: &Unknowns, step: &[f64]) {
    let shifted = |points: &[DVec3], joint: &dyn Fn(usize) -> usize| -> Vec<DVec3> {
        let shift = |(b, &point): (usize, &DVec3)| {
            let at = 3 * joint(b);
            if alignment.takes_part[b] { point + DVec3::from_slice(&step[at..at + 3]) } else { point }
        };
        points.iter().enumerate().map(shift).collect()
    };
    let heads = shifted(alignment.aligned.heads(), &|b| unknowns.head(b));
    let tails = shifted(alignment.aligned.tails(), &|b| unknowns.tail(b));
    alignment.aligned = alignment.aligned.moved(heads, tails);
    for bone in 0..alignment.takes_part.len() {
        alignment.twists[bone] += step[unknowns.twist(bone)];
        alignment.log_girths[bone] += step[unknowns.girth(bone)].clamp(-GIRTH_STEP, GIRTH_STEP);
    }
}
