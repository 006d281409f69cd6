//! How unlike two bones are by their place in the tree and in space.

use glam::{DQuat, DVec3};

use super::by_name::Named;
use super::frame::{Placed, mirror_axis};
use super::names::Side;
use super::tree_edit::NEVER;
use crate::rig::Skeleton;

/// A bone this near to the plane of symmetry, as a share of the extent, is on neither side.
const IN_THE_MIDDLE: f64 = 0.04;

/// One skeleton, seen in the common frame.
pub(super) struct View<'a> {
    named: &'a Named<'a>,
    placed: Placed,
    /// How far down its tree a bone starts: the way from the root over the way from there on to the
    /// farthest leaf below it.
    depths: Vec<f64>,
    /// -1 and 1 for the sides, 0 for the middle or where nothing tells.
    sides: Vec<i8>,
}

impl<'a> View<'a> {
    /// `mirror` cuts the bones into sides where names do not tell.
    pub(super) fn new(named: &'a Named<'a>, placed: Placed, mirror: Option<Mirror>) -> Self {
        let depths = depths(named.skeleton);
        let sides = sides(named, &placed, mirror);
        Self { named, placed, depths, sides }
    }
}

/// A plane of symmetry: its normal, how far from the middle it stands along it, and whether the
/// normal points to the left because names say so.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mirror {
    axis: DVec3,
    at: f64,
    named: bool,
}

impl Mirror {
    /// From the sides that names tell, otherwise from the symmetry of the bones.
    pub(super) fn new(named: &Named<'_>, placed: &Placed) -> Option<Self> {
        let middle = |side: Side| {
            let bones = (0..placed.heads.len()).filter(|&b| named.labels.side(b as u32) == side);
            let points: Vec<DVec3> = bones.map(|b| placed.heads[b]).collect();
            (!points.is_empty()).then(|| points.iter().sum::<DVec3>() / points.len() as f64)
        };
        if let (Some(left), Some(right)) = (middle(Side::Left), middle(Side::Right))
            && left.distance(right) > IN_THE_MIDDLE
        {
            let axis = (left - right).normalize();
            return Some(Self { axis, at: axis.dot(0.5 * (left + right)), named: true });
        }
        mirror_axis(placed).map(|(axis, at)| Self { axis, at, named: false })
    }

    /// One normal for both skeletons, so that a side means the same; each plane stands where its
    /// own skeleton has it.
    pub(super) fn of_both(source: Option<Self>, target: Option<Self>) -> [Option<Self>; 2] {
        let leading = match (source, target) {
            (Some(source), Some(target)) if target.named && !source.named => Some(target),
            (source, target) => source.or(target),
        };
        [source, target].map(|own| {
            let leading = leading?;
            let along = own.map_or(0.0, |own| own.axis.dot(leading.axis));
            let at = own.filter(|_| along.abs() > 0.9).map_or(0.0, |own| own.at * along.signum());
            Some(Self { at, ..leading })
        })
    }
}

/// Cost of pairing bone `i` of one view with bone `j` of the other: 0 for bones alike in every
/// respect, about 1 for bones far apart, [`NEVER`] for a left and a right bone.
///
/// `anchors` are bones above both that are paired already: what lies below is compared from there,
/// with these two laid on each other, so that another pose or other proportions matter less.
pub(super) fn unlikeness(
    (source, i): (&View<'_>, usize),
    (target, j): (&View<'_>, usize),
    anchors: Option<(usize, usize)>,
) -> f64 {
    if source.sides[i] * target.sides[j] < 0 {
        return NEVER;
    }
    let (a, b) = (&source.placed, &target.placed);
    let (mut from, mut to) = ([a.heads[i], a.tails[i]], [b.heads[j], b.tails[j]]);
    let mut unit = 1.0;
    if let Some((above_i, above_j)) = anchors {
        let axes = [a.tails[above_i] - a.heads[above_i], b.tails[above_j] - b.heads[above_j]];
        let turn = match axes.map(DVec3::try_normalize) {
            [Some(own), Some(other)] => DQuat::from_rotation_arc(other, own),
            _ => DQuat::IDENTITY,
        };
        from = from.map(|p| p - a.heads[above_i]);
        to = to.map(|p| turn * (p - b.heads[above_j]));
        let lengths = from[0].distance(from[1]).max(to[0].distance(to[1]));
        unit = from[0].length().max(to[0].length()).max(lengths).max(1e-9);
    }
    // Tails say less than heads: some formats do not know them.
    let apart = from[0].distance(to[0]) / unit;
    let direction = |[head, tail]: [DVec3; 2]| (tail - head).normalize_or_zero();
    let turned = 0.5 * (1.0 - direction(from).dot(direction(to)));
    let side = if source.sides[i] == target.sides[j] { 0.0 } else { 0.1 };
    0.6 * apart.min(1.5) + 0.2 * turned + 0.6 * (source.depths[i] - target.depths[j]).abs() + side
}

impl View<'_> {
    /// Whether schemes know both names, and so know that they mean different parts.
    pub(super) fn is_known(&self, bone: usize) -> bool {
        self.named.labels.is_known(bone as u32)
    }
}

fn depths(skeleton: &Skeleton) -> Vec<f64> {
    let count = skeleton.bone_count();
    let step = |bone: usize, parent: u32| skeleton.heads()[bone].distance(skeleton.heads()[parent as usize]);
    let mut above = vec![0.0; count];
    for &bone in skeleton.depth_order() {
        let bone = bone as usize;
        if let Some(parent) = skeleton.parents()[bone] {
            above[bone] = above[parent as usize] + step(bone, parent);
        }
    }
    let mut below: Vec<f64> = (0..count).map(|bone| skeleton.length(bone)).collect();
    for &bone in skeleton.depth_order().iter().rev() {
        let bone = bone as usize;
        if let Some(parent) = skeleton.parents()[bone] {
            below[parent as usize] = below[parent as usize].max(below[bone] + step(bone, parent));
        }
    }
    above.iter().zip(&below).map(|(above, below)| above / (above + below).max(1e-300)).collect()
}

fn sides(named: &Named<'_>, placed: &Placed, mirror: Option<Mirror>) -> Vec<i8> {
    let side = |bone: usize| match (named.labels.side(bone as u32), mirror) {
        (Side::Left, _) => 1,
        (Side::Right, _) => -1,
        (Side::Middle, None) => 0,
        (Side::Middle, Some(mirror)) => {
            let off = mirror.axis.dot(0.5 * (placed.heads[bone] + placed.tails[bone])) - mirror.at;
            if off.abs() < IN_THE_MIDDLE { 0 } else { off.signum() as i8 }
        }
    };
    (0..placed.heads.len()).map(side).collect()
}
