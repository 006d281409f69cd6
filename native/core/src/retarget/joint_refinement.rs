//! Joints refined against the surfaces: the aligned skeleton is moved, turned and thickened so that
//! the warped source meets the target.
//!
//! A Gauss-Newton fit of joint positions, turns about the bones and girths to point-to-plane
//! distances (Chen and Medioni 1992). How far joints may move is a matter of measurement: their
//! given places count with an assumed error of a share of the extent, the surfaces with the
//! distances still left, bone by bone. What does not bring a bone's surfaces much nearer is taken
//! back: joints that were placed by eye find their place inside the limb, and shapes that differ do
//! not bend the skeleton.

use glam::DVec3;

use super::RetargetError;
use super::differing_shapes::{Difference, difference};
use super::icp::Surroundings;
use super::joint_system::{self, Meeting, Trust, Unknowns, largest_bone, typical_distances};
use super::surface_sample::{Sample, samples};
use super::warp::Warp;
use crate::parallel::map_indices;
use crate::progress::Progress;
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// Settings of the fit.
#[derive(Debug, Clone, Copy)]
pub(super) struct FitSettings {
    /// Number of Gauss-Newton steps.
    pub(super) steps: u32,
    /// How many of them move joints only: turns and girths must not make up for joints that are
    /// off.
    pub(super) joint_steps: u32,
    /// Assumed error of the given joints as a share of the character's extent.
    pub(super) joint_error: f64,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self { steps: 14, joint_steps: 6, joint_error: 0.025 }
    }
}

/// Largest change of the logarithm of a girth in a step, and in all.
const GIRTH_STEP: f64 = 0.2;
const GIRTH_LIMIT: f64 = 0.6;
/// Largest turn about a bone in a step, and in all, in radians.
const TWIST_STEP: f64 = 0.15;
const TWIST_LIMIT: f64 = 0.6;
/// Cosine of the largest angle between normals that may meet.
const NORMALS: f64 = 0.5;
/// Nothing meets beyond this share of the extent: a garment covers a part of the body.
const FARTHEST: f64 = 0.1;
/// Of a large surface about so many points of every bone take part.
const POINTS_OF_BONE: usize = 300;

/// A source and the skeleton that it is aligned to.
pub(super) struct Alignment<'a> {
    pub(super) source: Surroundings<'a>,
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

/// Fits the alignment to the target's surface, whose size is `extent`. Returns how much
/// the shapes differ.
///
/// # Errors
/// [`RetargetError::Cancelled`], [`RetargetError::Linalg`].
pub(super) fn refine(
    alignment: &mut Alignment<'_>,
    target: Surroundings<'_>,
    extent: f64,
    settings: &FitSettings,
    progress: &Progress,
) -> Result<Difference, RetargetError> {
    let unknowns = Unknowns::new(alignment.skeleton, &alignment.aligned, alignment.takes_part, extent);
    let given = (alignment.aligned.clone(), alignment.log_girths.clone());
    let points = PointsThatMeet::new(alignment);
    let mut before = Vec::new();
    for step in 0..settings.steps {
        let shares = [step, step + 1].map(|step| f64::from(step) / f64::from(settings.steps));
        let warp = alignment.warp();
        let moved = warp.apply(alignment.source.mesh.vertices(), alignment.weights);
        let meetings = points.meet(alignment, &moved, target, shares, progress)?;
        if before.is_empty() {
            before = typical_distances(alignment.weights, &meetings);
        }
        let trust =
            Trust { joint_error: settings.joint_error * extent, joints_only: step < settings.joint_steps };
        let step = joint_system::step(alignment, &warp, &moved, &meetings, &unknowns, trust);
        let step = step.map_err(|error| RetargetError::Spectral { side: "target", error: error.into() })?;
        update(alignment, &unknowns, &step, &given.1);
    }
    let moved = alignment.warp().apply(alignment.source.mesh.vertices(), alignment.weights);
    let meetings = points.meet(alignment, &moved, target, [1.0, 1.0], progress)?;
    let after = typical_distances(alignment.weights, &meetings);
    let helped: Vec<f64> =
        before.iter().zip(&after).map(|(&before, &after)| share_kept(before, after)).collect();
    keep(alignment, &unknowns, &given, &helped);
    let moved = alignment.warp().apply(alignment.source.mesh.vertices(), alignment.weights);
    let mut distances = vec![None; moved.len()];
    for meeting in points.meet(alignment, &moved, target, [1.0, 1.0], progress)? {
        distances[meeting.vertex as usize] = Some(meeting.distance);
    }
    Ok(difference(alignment, &moved, &distances))
}

/// How much of the fit a bone keeps: all where it explains most of the distance between the
/// surfaces, nothing where it does not, because the shapes differ in another way.
fn share_kept(before: f64, after: f64) -> f64 {
    const HELPED: f64 = 0.4;
    const USELESS: f64 = 0.55;
    let left = if before > 0.0 { after / before } else { 1.0 };
    ((USELESS - left) / (USELESS - HELPED)).clamp(0.0, 1.0)
}

/// Takes back what did not help: turns and girths bone by bone, joints by the mean of their bones.
fn keep(alignment: &mut Alignment<'_>, unknowns: &Unknowns, given: &(Skeleton, Vec<f64>), helped: &[f64]) {
    let mut shares = vec![(0.0, 0.0); unknowns.joint_count()];
    for bone in (0..helped.len()).filter(|&b| alignment.takes_part[b]) {
        alignment.twists[bone] *= helped[bone];
        let girth = &mut alignment.log_girths[bone];
        *girth = given.1[bone] + (*girth - given.1[bone]) * helped[bone];
        for joint in [unknowns.head(bone), unknowns.tail(bone)] {
            shares[joint].0 += helped[bone];
            shares[joint].1 += 1.0;
        }
    }
    let back = |now: &[DVec3], then: &[DVec3], joint: &dyn Fn(usize) -> usize| -> Vec<DVec3> {
        let place = |b: usize| {
            let (sum, count) = shares[joint(b)];
            if alignment.takes_part[b] && count > 0.0 { then[b].lerp(now[b], sum / count) } else { now[b] }
        };
        (0..now.len()).map(place).collect()
    };
    let (now, then) = (&alignment.aligned, &given.0);
    let heads = back(now.heads(), then.heads(), &|b| unknowns.head(b));
    let tails = back(now.tails(), then.tails(), &|b| unknowns.tail(b));
    alignment.aligned = alignment.aligned.placed(heads, tails);
}

/// The source vertices that the fit brings to the target.
struct PointsThatMeet {
    samples: Vec<Sample>,
    /// Triangles around each of them.
    around: Vec<Vec<u32>>,
}

impl PointsThatMeet {
    fn new(alignment: &Alignment<'_>) -> Self {
        let source = alignment.source;
        let bone = |vertex| largest_bone(alignment.weights, vertex);
        let samples = samples(source.mesh, alignment.skeleton, bone, POINTS_OF_BONE);
        let around = source.shell.triangles_around(source.mesh, samples.iter().map(|sample| sample.vertex));
        Self { samples, around }
    }

    /// Closest points of the target for the moved vertices, those whose normals agree.
    fn meet(
        &self,
        alignment: &Alignment<'_>,
        moved: &[DVec3],
        target: Surroundings<'_>,
        shares: [f64; 2],
        progress: &Progress,
    ) -> Result<Vec<Meeting>, RetargetError> {
        let source = alignment.source;
        let find = |at: usize, (): &mut ()| {
            let Sample { vertex, count } = self.samples[at];
            let point = moved[vertex as usize];
            let own = source.shell.normal_of(source.mesh, moved, vertex, &self.around[at]);
            let closest = target.query.closest_point(point)?;
            let (normal, both) = target.shell.normal_at(target.mesh, &closest);
            let cosine = normal.dot(own);
            let cosine = if both || source.shell.two_sided[vertex as usize] { cosine.abs() } else { cosine };
            let agreement = ((cosine - NORMALS) / (0.4 * (1.0 - NORMALS))).clamp(0.0, 1.0);
            // Skin beyond the edge of a garment has nothing to meet.
            let near = (2.0 * (1.0 - closest.distance / (FARTHEST * target.shell.extent))).clamp(0.0, 1.0);
            let agreement = agreement * near;
            (agreement > 0.0 && !target.shell.is_on_open_edge(target.mesh, &closest)).then(|| Meeting {
                vertex,
                count,
                normal,
                gap: normal.dot(closest.position - point),
                distance: closest.distance,
                agreement,
            })
        };
        let found = map_indices(self.samples.len(), progress, shares, find)?;
        Ok(found.into_iter().flatten().collect())
    }
}

/// Takes a step of the fit.
fn update(alignment: &mut Alignment<'_>, unknowns: &Unknowns, step: &[f64], given_girths: &[f64]) {
    let shifted = |points: &[DVec3], joint: &dyn Fn(usize) -> usize| -> Vec<DVec3> {
        let shift = |(b, &point): (usize, &DVec3)| {
            let at = 3 * joint(b);
            if alignment.takes_part[b] { point + DVec3::from_slice(&step[at..at + 3]) } else { point }
        };
        points.iter().enumerate().map(shift).collect()
    };
    let heads = shifted(alignment.aligned.heads(), &|b| unknowns.head(b));
    let tails = shifted(alignment.aligned.tails(), &|b| unknowns.tail(b));
    alignment.aligned = alignment.aligned.placed(heads, tails);
    for bone in 0..alignment.takes_part.len() {
        let twist = &mut alignment.twists[bone];
        *twist += step[unknowns.twist(bone)].clamp(-TWIST_STEP, TWIST_STEP);
        *twist = twist.clamp(-TWIST_LIMIT, TWIST_LIMIT);
        let girth = &mut alignment.log_girths[bone];
        *girth += step[unknowns.girth(bone)].clamp(-GIRTH_STEP, GIRTH_STEP);
        *girth = girth.clamp(given_girths[bone] - GIRTH_LIMIT, given_girths[bone] + GIRTH_LIMIT);
    }
}
