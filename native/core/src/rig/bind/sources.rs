//! The segments from which distances start: the bones themselves, and links from a bone to the
//! joints of its children that it does not reach.
//!
//! A hand bone often ends in the wrist's side of the palm, a chest bone below the collar bones. What
//! such a bone carries reaches to its children's joints, so it owns the way there. A link grows from
//! nothing, where the gap is half as long as the bone, to the whole gap, where it is as long.

use glam::DVec3;

use super::body::Body;
use crate::rig::{Skeleton, closest_on_segment, distance_to_segment};

/// Gap as a share of the bone's length at which a link begins to grow, and at which it is whole.
const LINK_FROM: f64 = 0.5;
const LINK_WHOLE: f64 = 1.0;
/// A child that runs back along the gap (cosine of the angle) covers it by itself.
const RUNS_BACK: f64 = -0.5;
/// Where along a gap to look whether it is free.
const LOOKS: [f64; 3] = [0.25, 0.5, 0.75];

/// A segment that belongs to a bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Source {
    pub(super) bone: u32,
    pub(super) head: DVec3,
    pub(super) tail: DVec3,
}

/// Segments of all bones that take part, bones ascending, links after the bones.
pub(super) fn sources(body: &Body, skeleton: &Skeleton, takes_part: &[bool]) -> Vec<Source> {
    let bones: Vec<usize> = (0..takes_part.len()).filter(|&bone| takes_part[bone]).collect();
    let segment = |bone: usize| Source { bone: bone as u32, head: body.heads[bone], tail: body.tails[bone] };
    let mut sources: Vec<Source> = bones.iter().map(|&bone| segment(bone)).collect();
    let parents: Vec<Option<usize>> =
        (0..takes_part.len()).map(|bone| carrier(skeleton, takes_part, bone)).collect();
    for &child in &bones {
        let Some(parent) = parents[child] else { continue };
        let (from, to) = (segment(parent), segment(child));
        let others = bones
            .iter()
            .filter(|&&b| b != parent && b != child && parents[b] != Some(parent))
            .map(|&b| segment(b));
        sources.extend(link(&from, &to, others, &|point| body.embed(point).is_some()));
    }
    sources
}

/// Nearest ancestor that takes part.
fn carrier(skeleton: &Skeleton, takes_part: &[bool], bone: usize) -> Option<usize> {
    let mut ancestor = skeleton.parents()[bone];
    while let Some(candidate) = ancestor.map(|a| a as usize) {
        if takes_part[candidate] {
            return Some(candidate);
        }
        ancestor = skeleton.parents()[candidate];
    }
    None
}

/// The link from `parent` towards the head of `child`, if there is a gap that is free and inside.
fn link(
    parent: &Source,
    child: &Source,
    others: impl Iterator<Item = Source>,
    is_inside: &dyn Fn(DVec3) -> bool,
) -> Option<Source> {
    let start = closest_on_segment(child.head, parent.head, parent.tail).0;
    let gap = child.head - start;
    let reach = ((gap.length() / parent.head.distance(parent.tail).max(f64::MIN_POSITIVE)) - LINK_FROM)
        / (LINK_WHOLE - LINK_FROM);
    let along = child.tail - child.head;
    if reach.is_nan() || reach <= 0.0 || gap.dot(along) < RUNS_BACK * gap.length() * along.length() {
        return None;
    }
    let looks = LOOKS.map(|share| start + gap * share);
    let distance = |point: DVec3, s: &Source| distance_to_segment(point, s.head, s.tail);
    let own = looks.map(|point| distance(point, parent).min(distance(point, child)));
    for other in others {
        // Rounding must not decide about a bone that begins where this one ends.
        if looks.iter().zip(own).any(|(&point, own)| distance(point, &other) < 0.999 * own) {
            return None;
        }
    }
    looks.iter().all(|&point| is_inside(point)).then_some(Source {
        bone: parent.bone,
        head: start,
        tail: start + gap * reach.min(1.0),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(bone: u32, head: DVec3, tail: DVec3) -> Source {
        Source { bone, head, tail }
    }

    #[test]
    fn a_link_grows_with_the_gap() {
        let parent = source(0, DVec3::ZERO, DVec3::X);
        let to = |x: f64| {
            let child = source(1, DVec3::X * x, DVec3::X * (x + 1.0));
            link(&parent, &child, std::iter::empty(), &|_| true).map(|l| (l.bone, l.head.x, l.tail.x))
        };
        assert_eq!(to(1.0), None);
        assert_eq!(to(1.4), None);
        assert_eq!(to(1.75), Some((0, 1.0, 1.375)));
        assert_eq!(to(3.0), Some((0, 1.0, 3.0)));
    }

    #[test]
    fn a_gap_is_not_linked_through_the_air_or_another_bone_or_its_own_child() {
        let parent = source(0, DVec3::ZERO, DVec3::X);
        let child = source(1, DVec3::X * 3.0, DVec3::X * 4.0);
        assert_eq!(link(&parent, &child, std::iter::empty(), &|p| p.x < 2.0), None);
        let across = source(2, DVec3::new(2.0, -1.0, 0.1), DVec3::new(2.0, 1.0, 0.1));
        assert_eq!(link(&parent, &child, std::iter::once(across), &|_| true), None);
        let backwards = source(1, DVec3::X * 3.0, DVec3::X * 1.5);
        assert_eq!(link(&parent, &backwards, std::iter::empty(), &|_| true), None);
    }
}
