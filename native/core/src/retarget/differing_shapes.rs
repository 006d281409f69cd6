//! Where source and target differ in shape, the target's own skeleton decides, in the manner of
//! the source.
//!
//! On like bodies the source knows best to the last crease. Where the shapes are far apart, every
//! match is a guess. There the target is bound to its skeleton in the way that explains the source
//! best ([`super::bound_alike`]), and takes over from the source what that way does not explain: the
//! difference of the source's weights from its own bind, as far as the match is to be trusted. It is,
//! where it was accepted, and the less the farther the two binds are apart there, which say whether
//! both are the same place of the body, and the more the shapes differ. Little of it counts where the bind
//! explains the source nearly: that is how another program rounds, not what somebody painted.
//! A garment has no inside for its bones, and no bind says anything of it: there the match decides.
//!
//! How far apart the shapes are is measured after the alignment: the distance left between the
//! surfaces relative to the limb's radius, bone by bone, and of the bones the median by area. Most bones
//! of a hand are fingers, which on a coarse body are prisms, and say little of its shape.

use glam::DVec3;
use rayon::prelude::*;

use super::bone_rays::median;
use super::bound_alike::{Bindable, bind_alike};
use super::icp::Surroundings;
use super::joint_refinement::Alignment;
use super::joint_system::largest_bone;
use super::part_shapes::{PartShape, part_shapes};
use super::parts::{Part, PartPolicy, mean_row, spread};
use super::rejection::SurfaceMatch;
use super::shell::Shell;
use super::unclaimed::Unclaimed;
use super::{Origin, RetargetError};
use crate::cage::WindingNumber;
use crate::median::weighted_median;
use crate::mesh::{Adjacency, Submesh, SurfaceQuery, TriangleMesh};
use crate::progress::Progress;
use crate::rig::{BoneMap, Skeleton, distance_to_segment};
use crate::skinning::{Row, SkinWeights, blend, normalized, row_of};

/// Distance left, relative to the radius, up to which shapes are alike,
const ALIKE: f64 = 0.07;
/// and from which on they differ altogether.
const DIFFERENT: f64 = 0.09;
/// From here on no match is trusted.
const DOUBTED: f64 = 0.18;
/// Where along a bone to look whether it is inside of a part.
const LOOKS: [f64; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];
/// A bone is connected to its parent where it begins this near to the parent's end, in the parent's lengths.
const CONNECTED: f64 = 0.01;
/// Where the source's own bind leaves no more than this of a vertex's weights, what it leaves is no painter's work,
/// and from the second on all of it is;
const INEXACT: [f64; 2] = [0.1, 0.4];
/// everywhere, where it leaves more than this on average.
const EXPLAINED: [f64; 2] = [0.05, 0.2];
/// Edges from the border of the matched surface over which trust in matches grows.
const TRUST_GROWS: usize = 4;

/// How much the shapes of a pair differ.
#[derive(Debug, Clone, Copy)]
pub(super) struct Difference {
    /// From 0, alike, to 1.
    pub(super) share: f64,
    /// Trust in matches, 0 to 1.
    trust: f64,
}

/// How much the shapes of a pair differ.
///
/// `points` are the warped source vertices, `distances` what separates each from the target where
/// it met it.
pub(super) fn difference(
    alignment: &Alignment<'_>,
    points: &[DVec3],
    distances: &[Option<f64>],
) -> Difference {
    let bone_count = alignment.takes_part.len();
    let (mut left, mut radius) = (vec![Vec::new(); bone_count], vec![Vec::new(); bone_count]);
    for (vertex, (&point, distance)) in points.iter().zip(distances).enumerate() {
        let Some(bone) = largest_bone(alignment.weights, vertex).map(|b| b as usize) else { continue };
        if let Some(distance) = distance {
            let (head, tail) = (alignment.aligned.heads()[bone], alignment.aligned.tails()[bone]);
            left[bone].push(*distance);
            radius[bone].push(distance_to_segment(point, head, tail));
        }
    }
    let relative =
        left.into_iter().zip(radius).zip(areas_of_bones(alignment)).filter_map(|((left, radius), area)| {
            Some((median(left)? / median(radius).filter(|r| *r > 0.0)?, area))
        });
    let usual = weighted_median(relative.collect());
    Difference { share: step(ALIKE, DIFFERENT, usual), trust: 1.0 - step(DIFFERENT, DOUBTED, usual) }
}

/// Area of the source's surface by each vertex's largest weight (B).
fn areas_of_bones(alignment: &Alignment<'_>) -> Vec<f64> {
    let mesh = alignment.source.mesh;
    let mut areas = vec![0.0; alignment.takes_part.len()];
    for (t, triangle) in mesh.triangles().iter().enumerate() {
        let share = mesh.area_vector(t).length() / 6.0;
        let bones = triangle.iter().filter_map(|&v| largest_bone(alignment.weights, v as usize));
        bones.for_each(|bone| areas[bone as usize] += share);
    }
    areas
}

/// Smooth step from 0 at `from` to 1 at `to`.
fn step(from: f64, to: f64, value: f64) -> f64 {
    let t = ((value - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// What a retarget knows of two characters whose shapes differ.
pub(super) struct Differing {
    /// How much, above 0.
    pub(super) difference: Difference,
    /// Where each target vertex lies on the source: vertices and their shares.
    pub(super) matches: Vec<([u32; 3], [f64; 3])>,
    pub(super) origin: Vec<Origin>,
    pub(super) parts: Vec<Part>,
    pub(super) source: (SurfaceQuery, Shell),
    pub(super) target: (SurfaceQuery, Shell),
}

/// Matches as vertices of the source.
pub(super) fn on_vertices(matches: &[SurfaceMatch], source: &TriangleMesh) -> Vec<([u32; 3], [f64; 3])> {
    let corners = |found: &SurfaceMatch| (source.triangles()[found.triangle as usize], found.barycentric);
    matches.iter().map(corners).collect()
}

/// A character of a pair.
#[derive(Clone, Copy)]
pub(super) struct Side<'a> {
    pub(super) mesh: &'a TriangleMesh,
    pub(super) skeleton: &'a Skeleton,
    pub(super) weights: &'a SkinWeights,
}

impl Differing {
    /// Weights of the target over its own bones, from those that its matches gave it; none where most
    /// bones lie outside of the target: a garment, which no skeleton can bind, has its matches alone.
    ///
    /// # Errors
    /// [`RetargetError`] where a character cannot be bound, and for cancelled work.
    pub(super) fn hand_over(
        &self,
        source: Side<'_>,
        target: Side<'_>,
        bone_map: &BoneMap,
        unclaimed: Option<&Unclaimed<'_>>,
        progress: &Progress,
    ) -> Result<Option<SkinWeights>, RetargetError> {
        let used = source.weights.used_bones();
        let mut takes_part = vec![false; target.skeleton.bone_count()];
        for bone in (0..used.len()).filter(|&bone| used[bone]) {
            let carriers = bone_map.targets(bone_map.carrier(bone) as usize);
            carriers.iter().for_each(|&bone| takes_part[bone as usize] = true);
        }
        if let Some(unclaimed) = unclaimed {
            unclaimed.bones().for_each(|bone| takes_part[bone as usize] = true);
        }
        if !is_body(target, &takes_part) {
            return Ok(None);
        }
        let surface = |mesh, (query, shell)| Surroundings { mesh, query, shell };
        let from = surface(source.mesh, (&self.source.0, &self.source.1));
        let to = surface(target.mesh, (&self.target.0, &self.target.1));
        let bound = bind_alike(
            Bindable { surface: from, skeleton: source.skeleton, takes_part: &used },
            source.weights,
            Bindable { surface: to, skeleton: target.skeleton, takes_part: &takes_part },
            bone_map,
            progress,
        )?;
        let divided = |weights: SkinWeights| match unclaimed {
            Some(unclaimed) => unclaimed.share(&weights, &bound.target, target.mesh.vertices()),
            None => weights,
        };
        let matched = divided(target.weights.clone());
        let at_match = self.matches.iter().map(|(corners, shares)| {
            blend(corners.iter().zip(shares).map(|(&v, &share)| (&bound.source[v as usize], share)))
        });
        let at_match = SkinWeights::from_rows(at_match, source.skeleton.bone_count());
        let at_match = divided(bone_map.transfer(&at_match, target.mesh.vertices(), target.skeleton)?);
        let trust = self.trust(to);
        let bound_left = bound.unexplained;
        let row = |v: usize| {
            let (own, bound, at_match) = (row_of(&matched, v), &bound.target[v], row_of(&at_match, v));
            let off = spread(bound, [&at_match].into_iter()).min(2.0);
            let left = spread(&own, [&at_match].into_iter());
            let painted =
                step(INEXACT[0], INEXACT[1], left).max(step(EXPLAINED[0], EXPLAINED[1], bound_left));
            let trust = self.difference.trust * trust[v] * (1.0 - 0.5 * off) * painted;
            let explained = [(bound, 1.0), (&own, trust), (&at_match, -trust)];
            (own.clone(), normalized(blend(explained.into_iter())))
        };
        let rows: Vec<(Row, Row)> = (0..self.matches.len()).into_par_iter().map(row).collect();
        let (own, mut handed): (Vec<Row>, Vec<Row>) = rows.into_iter().unzip();
        self.keep_parts(target, &takes_part, &own, &mut handed);
        let share = self.difference.share;
        let mixed = own
            .iter()
            .zip(&handed)
            .map(|(own, handed)| blend([(own, 1.0 - share), (handed, share)].into_iter()));
        Ok(Some(SkinWeights::from_rows(mixed, target.skeleton.bone_count())))
    }

    /// Trust in the match of each vertex (V), 0 to 1: it grows from the border of the matched
    /// surface inward.
    fn trust(&self, target: Surroundings<'_>) -> Vec<f64> {
        let is_matched: Vec<bool> = self.origin.iter().map(|&origin| origin == Origin::Matched).collect();
        let mut trust: Vec<f64> = is_matched.iter().map(|&matched| f64::from(u8::from(matched))).collect();
        let Ok(welded) = target.shell.welded(target.mesh) else { return trust };
        let edges = Adjacency::new(welded.vertex_count(), &welded.topology());
        let stands_for = target.shell.stands_for();
        for _ in 0..TRUST_GROWS {
            let mean = |v: usize| {
                let own = stands_for[v] as usize;
                let around = edges.neighbours(own);
                let sum: f64 = around.iter().map(|&n| trust[n as usize]).sum();
                if is_matched[v] { (trust[own] + sum) / (1 + around.len()) as f64 } else { 0.0 }
            };
            trust = (0..trust.len()).map(mean).collect();
        }
        trust
    }

    /// Rigid parts stay rigid, and those that the source has too go as there. A part that holds a
    /// bone is a piece of the body, such as a finger of a jointed doll.
    fn keep_parts(&self, target: Side<'_>, takes_part: &[bool], own: &[Row], handed: &mut [Row]) {
        let (shapes, of) = part_shapes(target.mesh);
        let body = self
            .parts
            .iter()
            .find(|part| part.is_body)
            .and_then(|body| inside_of(target.mesh, &body.vertices));
        for part in self.parts.iter().filter(|part| part.policy != PartPolicy::Match) {
            let Some(&first) = part.vertices.first() else { continue };
            let shape = &shapes[of[first as usize] as usize];
            if part.like.is_some() {
                part.vertices.iter().for_each(|&v| handed[v as usize].clone_from(&own[v as usize]));
            } else if part.policy == PartPolicy::Rigid && !has_bone(shape, body.as_ref(), target, takes_part)
            {
                let mean = mean_row(&part.vertices, handed);
                part.vertices.iter().for_each(|&v| handed[v as usize].clone_from(&mean));
            }
        }
    }
}

/// Whether a target encloses at least half of the bones that take part.
fn is_body(target: Side<'_>, takes_part: &[bool]) -> bool {
    let inside = WindingNumber::new(target.mesh);
    let (heads, tails) = (target.skeleton.heads(), target.skeleton.tails());
    let (mut looks, mut held) = (0, 0);
    for bone in (0..takes_part.len()).filter(|&bone| takes_part[bone]) {
        for share in LOOKS {
            looks += 1;
            held += usize::from(inside.at(heads[bone].lerp(tails[bone], share)).abs() > 0.5);
        }
    }
    2 * held >= looks
}

/// The inside of some vertices' own triangles; none without triangles.
fn inside_of(mesh: &TriangleMesh, vertices: &[u32]) -> Option<WindingNumber> {
    let piece = Submesh::new(mesh, |v| vertices.binary_search(&(v as u32)).is_ok()).ok()?;
    Some(WindingNumber::new(&piece.mesh))
}

/// Whether a part is a piece of the body: inside of it, and not of the main body, is a joint of
/// connected bones or most of a bone.
///
/// A ring has its bone in the hole or in the body, and an eye's bone begins at no other bone's end:
/// both stay rigid.
fn has_bone(part: &PartShape, body: Option<&WindingNumber>, target: Side<'_>, takes_part: &[bool]) -> bool {
    let Some(inside) = inside_of(target.mesh, &part.vertices) else { return false };
    let holds = |winding: &WindingNumber, p: DVec3| winding.at(p).abs() > 0.5;
    let is_own = |p: DVec3| {
        p.distance(part.centre) < part.radius && holds(&inside, p) && body.is_none_or(|body| !holds(body, p))
    };
    let (heads, tails, parents) =
        (target.skeleton.heads(), target.skeleton.tails(), target.skeleton.parents());
    (0..takes_part.len()).filter(|&bone| takes_part[bone]).any(|bone| {
        let (head, tail) = (heads[bone], tails[bone]);
        let is_joint = parents[bone].map(|parent| parent as usize).is_some_and(|parent| {
            takes_part[parent]
                && head.distance(tails[parent]) < CONNECTED * tails[parent].distance(heads[parent])
        });
        let looks = LOOKS.map(|share| head.lerp(tail, share));
        (is_joint && is_own(head)) || 2 * looks.into_iter().filter(|&p| is_own(p)).count() > LOOKS.len()
    })
}
