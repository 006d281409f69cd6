//! The linear system of one step of the joint refinement.

use glam::DVec3;

use super::bone_rays::median;
use super::joint_refinement::Alignment;
use super::warp::Warp;
use crate::linalg::{Cholesky, LinalgError, SymbolicCholesky, SymmetricMatrix};
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// What the given joints weigh at least against the surfaces.
const LEAST_PRIOR: f64 = 0.01;
/// What no turn about a bone weighs against the surfaces.
const NO_TWIST: f64 = 0.1;
/// How firmly a step holds the girth.
const GIRTH_DAMPING: f64 = 0.02;
/// A bone that fewer points belong to stays as it is.
const FEW: usize = 12;
/// What holds it.
const HELD: f64 = 1e3;
/// Points farther than this multiple of a bone's median distance do not count.
const TRIM: f64 = 3.0;

/// Joints that several bone ends share, and the numbering of the fit's unknowns: three for each
/// joint, then one turn and one girth for each bone.
pub(super) struct Unknowns {
    head: Vec<usize>,
    tail: Vec<usize>,
    given: Vec<DVec3>,
    bone_count: usize,
}

impl Unknowns {
    /// Bone ends that coincide in both skeletons are one joint.
    pub(super) fn new(source: &Skeleton, aligned: &Skeleton, takes_part: &[bool], extent: f64) -> Self {
        let bone_count = source.bone_count();
        let (mut head, mut tail) = (vec![0; bone_count], vec![0; bone_count]);
        let (mut given, mut at): (Vec<DVec3>, Vec<DVec3>) = (Vec::new(), Vec::new());
        let source_extent = source
            .heads()
            .iter()
            .chain(source.tails())
            .fold(0.0f64, |largest, p| largest.max(p.distance(source.heads()[0])));
        for b in (0..bone_count).filter(|&b| takes_part[b]) {
            let ends = [
                (source.heads()[b], aligned.heads()[b], &mut head),
                (source.tails()[b], aligned.tails()[b], &mut tail),
            ];
            for (from, to, joint) in ends {
                let same = |j: &usize| {
                    at[*j].distance(from) <= 1e-6 * source_extent && given[*j].distance(to) <= 1e-6 * extent
                };
                joint[b] = (0..at.len()).find(same).unwrap_or(at.len());
                if joint[b] == at.len() {
                    at.push(from);
                    given.push(to);
                }
            }
        }
        Self { head, tail, given, bone_count }
    }

    /// Joint at the head of a bone.
    pub(super) fn head(&self, bone: usize) -> usize {
        self.head[bone]
    }

    /// Joint at the tail of a bone.
    pub(super) fn tail(&self, bone: usize) -> usize {
        self.tail[bone]
    }

    /// Number of joints.
    pub(super) fn joint_count(&self) -> usize {
        self.given.len()
    }

    fn count(&self) -> usize {
        3 * self.given.len() + 2 * self.bone_count
    }

    pub(super) fn twist(&self, bone: usize) -> usize {
        3 * self.given.len() + bone
    }

    pub(super) fn girth(&self, bone: usize) -> usize {
        3 * self.given.len() + self.bone_count + bone
    }
}

/// A source point that meets the target: its plane's normal, how far it is along it and away.
pub(super) struct Meeting {
    pub(super) vertex: u32,
    /// Number of points that it stands for.
    pub(super) count: f64,
    pub(super) normal: DVec3,
    pub(super) gap: f64,
    pub(super) distance: f64,
    /// 0 where the normals differ most, 1 where they agree.
    pub(super) agreement: f64,
}

/// What may move in a step and how far.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trust {
    /// Assumed error of the given joints, in the mesh's unit.
    pub(super) joint_error: f64,
    /// Whether turns and girths stay.
    pub(super) joints_only: bool,
}

/// Solves the normal equations of one step: changes of all unknowns.
///
/// # Errors
/// [`LinalgError`] when the system cannot be factored.
pub(super) fn step(
    alignment: &Alignment<'_>,
    warp: &Warp,
    points: &[DVec3],
    meetings: &[Meeting],
    unknowns: &Unknowns,
    trust: Trust,
) -> Result<Vec<f64>, LinalgError> {
    let mut system = System::new(unknowns);
    let typical = typical_distances(alignment.weights, meetings);
    let points_of = points_of_bones(alignment.weights, meetings);
    let mut row = Vec::new();
    for meeting in meetings {
        let vertex = meeting.vertex as usize;
        let Some(bone) = largest_bone(alignment.weights, vertex) else { continue };
        let few = points_of[bone as usize] < FEW;
        let typical = typical[bone as usize];
        if meeting.distance > TRIM * typical {
            continue;
        }
        row.clear();
        jacobian(alignment, warp, vertex, points[vertex], meeting.normal, unknowns, &mut row);
        if trust.joints_only {
            row.retain(|entry| entry.0 < 3 * unknowns.given.len());
        }
        let share = if typical > 0.0 { meeting.distance / (2.0 * typical) } else { 0.0 };
        // Both fade out, so that no single point decides.
        let fading = 1.0 - (2.0 * share / TRIM).powi(2);
        let weight = meeting.count * fading * fading * meeting.agreement / (1.0 + share * share);
        let doubt = if few { HELD } else { LEAST_PRIOR + (typical / trust.joint_error).powi(2) };
        system.add_row(&row, weight, meeting.gap, doubt);
    }
    system.add_priors(alignment, unknowns, &points_of);
    system.solve()
}

/// Bone with the largest weight of a vertex, the lower one where two are equal.
pub(super) fn largest_bone(weights: &SkinWeights, vertex: usize) -> Option<u32> {
    weights
        .entries(vertex)
        .reduce(|best, entry| if entry.1 > best.1 { entry } else { best })
        .map(|entry| entry.0)
}

/// Number of meetings of every bone (B), by each vertex's largest weight.
fn points_of_bones(weights: &SkinWeights, meetings: &[Meeting]) -> Vec<usize> {
    let mut counts = vec![0; weights.bone_count()];
    for meeting in meetings {
        if let Some(bone) = largest_bone(weights, meeting.vertex as usize) {
            counts[bone as usize] += 1;
        }
    }
    counts
}

/// Median distance of the meetings of every bone (B), by each vertex's largest weight.
pub(super) fn typical_distances(weights: &SkinWeights, meetings: &[Meeting]) -> Vec<f64> {
    let mut of_bone = vec![Vec::new(); weights.bone_count()];
    for meeting in meetings {
        if let Some(bone) = largest_bone(weights, meeting.vertex as usize) {
            of_bone[bone as usize].push(meeting.distance);
        }
    }
    of_bone.into_iter().map(|distances| median(distances).unwrap_or(0.0)).collect()
}

/// How the unknowns move a vertex along a normal: entries `(unknown, factor)`, ascending.
fn jacobian(
    alignment: &Alignment<'_>,
    warp: &Warp,
    vertex: usize,
    point: DVec3,
    normal: DVec3,
    unknowns: &Unknowns,
    row: &mut Vec<(usize, f64)>,
) {
    let total = alignment.weights.total(vertex);
    for (bone, weight) in alignment.weights.entries(vertex) {
        let b = bone as usize;
        let share = f64::from(weight) / total;
        let map = &warp.bones[b];
        let along = map.along(alignment.source.mesh.vertices()[vertex]);
        for k in 0..3 {
            row.push((3 * unknowns.head[b] + k, share * (1.0 - along) * normal[k]));
            row.push((3 * unknowns.tail[b] + k, share * along * normal[k]));
        }
        let offset = point - map.aligned_head;
        let across = offset - map.aligned_axis * offset.dot(map.aligned_axis);
        row.push((unknowns.twist(b), share * map.aligned_axis.cross(offset).dot(normal)));
        row.push((unknowns.girth(b), share * across.dot(normal)));
    }
    row.sort_by_key(|entry| entry.0);
    row.dedup_by(|next, kept| {
        let same = next.0 == kept.0;
        if same {
            kept.1 += next.1;
        }
        same
    });
}

/// Normal equations: the upper triangle row by row, the right-hand side, and what holds each
/// unknown where it was given.
struct System {
    count: usize,
    normal: Vec<f64>,
    right: Vec<f64>,
    prior: Vec<f64>,
    /// Way back to where each unknown was given.
    pull: Vec<f64>,
}

impl System {
    fn new(unknowns: &Unknowns) -> Self {
        let count = unknowns.count();
        let zeros = || vec![0.0; count];
        Self { count, normal: vec![0.0; count * count], right: zeros(), prior: zeros(), pull: zeros() }
    }

    fn add_row(&mut self, row: &[(usize, f64)], weight: f64, gap: f64, doubt: f64) {
        for (at, &(i, a)) in row.iter().enumerate() {
            self.right[i] += weight * a * gap;
            self.prior[i] += weight * a * a * doubt;
            for &(j, b) in &row[at..] {
                self.normal[i * self.count + j] += weight * a * b;
            }
        }
    }

    fn add_priors(&mut self, alignment: &Alignment<'_>, unknowns: &Unknowns, points_of: &[usize]) {
        let joints = 3 * unknowns.given.len();
        // A joint's prior is the same in every direction.
        for joint in self.prior[..joints].as_chunks_mut::<3>().0 {
            *joint = [joint.iter().sum(); 3];
        }
        for bone in (0..unknowns.bone_count).filter(|&b| alignment.takes_part[b]) {
            let aligned = &alignment.aligned;
            for (joint, now) in
                [(unknowns.head[bone], aligned.heads()[bone]), (unknowns.tail[bone], aligned.tails()[bone])]
            {
                // All bone ends of a joint stand at one place, so the last one speaks for all.
                let pull = unknowns.given[joint] - now;
                for k in 0..3 {
                    self.pull[3 * joint + k] = pull[k];
                }
            }
        }
        for (bone, &points) in points_of.iter().enumerate() {
            let (twist, girth) = (unknowns.twist(bone), unknowns.girth(bone));
            let firm = |usual: f64| if points < FEW { HELD } else { usual };
            self.prior[twist] = firm(NO_TWIST) * self.normal[twist * self.count + twist];
            self.prior[girth] = firm(GIRTH_DAMPING) * self.normal[girth * self.count + girth];
            self.pull[twist] = -alignment.twists[bone];
        }
    }

    fn solve(mut self) -> Result<Vec<f64>, LinalgError> {
        let mut triplets = Vec::new();
        for i in 0..self.count {
            self.right[i] += self.prior[i] * self.pull[i];
            for j in i..self.count {
                let value = self.normal[i * self.count + j];
                if i == j {
                    // An unknown that nothing concerns stays.
                    let diagonal = value * (1.0 + 1e-9) + self.prior[i];
                    triplets.push((i, i, if diagonal > 0.0 { diagonal } else { 1.0 }));
                } else if value != 0.0 {
                    triplets.push((j, i, value));
                }
            }
        }
        let matrix = SymmetricMatrix::from_triplets(self.count, &triplets)?;
        let symbolic = SymbolicCholesky::new(&matrix)?;
        Cholesky::factor(&symbolic, &matrix)?.solve_in_place(&mut self.right, 1)?;
        Ok(self.right)
    }
}
