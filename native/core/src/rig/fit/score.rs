//! How well a skeleton fits: bones inside, limbs found, lengths plausible, the trunk like the
//! template's, no limb of the body without bones.

use glam::DVec3;

use super::distance_field::DistanceField;
use super::geodesic::Ways;

/// Points of a bone to look at.
const LOOKS: u32 = 8;
/// Mean penalty of an embedding at which its share of the score is a half.
const HALF_COST: f64 = 1.0;
/// Standard deviation of the logarithm of the bones' stretches at which their share is a half.
const HALF_UNEVEN: f64 = 0.6;
/// What the correlation of the trunks lacks to 1, and the turn between them, at which their shares are a half.
const HALF_UNLIKE: f64 = 0.15;
const HALF_TURN: f64 = 55.0 * std::f64::consts::PI / 180.0;
/// Ears, horns and snouts reach this share of the longest way through a body away from the bones.
const FREE_TIP: f64 = 0.25;
/// How much farther a tip reaches where its share of the score is a half.
const HALF_BARE: f64 = 0.15;

/// Share of points of segments that are inside, weighted by their lengths.
pub(super) fn share_inside(segments: &[(DVec3, DVec3)], field: &DistanceField) -> f64 {
    let (mut inside, mut total) = (0.0, 0.0);
    for &(head, tail) in segments {
        let length = head.distance(tail);
        for look in 0..=LOOKS {
            let point = head.lerp(tail, f64::from(look) / f64::from(LOOKS));
            total += length;
            inside += if field.voxel_at(point).is_some() { length } else { 0.0 };
        }
    }
    if total > 0.0 { inside / total } else { 0.0 }
}

/// Share of the score for an embedding's mean penalty.
pub(super) fn of_cost(cost: f64) -> f64 {
    1.0 / (1.0 + (cost / HALF_COST).powi(2))
}

/// Share of the score for bones that were stretched differently: pairs of lengths before and after.
pub(super) fn of_lengths(lengths: &[(f64, f64)]) -> f64 {
    let total: f64 = lengths.iter().map(|l| l.0).sum();
    if total.is_nan() || total <= 0.0 {
        return 0.0;
    }
    let stretch = |&(before, after): &(f64, f64)| (after.max(1e-3 * before) / before).ln();
    let kept = || lengths.iter().filter(|l| l.0 > 0.0);
    let mean = kept().map(|l| l.0 * stretch(l)).sum::<f64>() / total;
    let spread = (kept().map(|l| l.0 * (stretch(l) - mean).powi(2)).sum::<f64>() / total).sqrt();
    1.0 / (1.0 + (spread / HALF_UNEVEN).powi(2))
}

/// Share of the score for a trunk: pairs of places in the template and in the body. Limbs take any pose,
/// but the trunk of one creature is like that of another of its kind. It may be turned about the axis
/// `across` the body, as that of a cat that stretches is, less and less likely the farther.
pub(super) fn of_trunk(places: &[(DVec3, DVec3)], across: Option<DVec3>) -> f64 {
    let count = places.len().max(1) as f64;
    let (before, after) = places.iter().fold((DVec3::ZERO, DVec3::ZERO), |sum, p| (sum.0 + p.0, sum.1 + p.1));
    let middle = (before / count, after / count);
    let (mut squares, mut along, mut cosine, mut sine) = ((0.0, 0.0), 0.0, 0.0, 0.0);
    for &(before, after) in places {
        let (a, b) = (before - middle.0, after - middle.1);
        squares = (squares.0 + a.length_squared(), squares.1 + b.length_squared());
        let axis = across.unwrap_or_default();
        along += a.dot(axis) * b.dot(axis);
        cosine += a.dot(b) - a.dot(axis) * b.dot(axis);
        sine += axis.dot(a.cross(b));
    }
    let size = (squares.0 * squares.1).sqrt();
    if size <= 0.0 {
        return 1.0;
    }
    let correlation = (along + cosine.hypot(sine)) / size;
    let unlike = (1.0 - correlation).max(0.0) / HALF_UNLIKE;
    let turn = sine.atan2(cosine).abs() / HALF_TURN;
    1.0 / (1.0 + unlike.powi(2)) / (1.0 + turn.powi(4))
}

/// Tips of the body that are far from all bones: how far beyond what an ear or a horn may be, as shares
/// of the longest way through the body.
pub(super) fn bare_tips(
    bones: &[(DVec3, DVec3)],
    field: &DistanceField,
    tips: &[u32],
    diameter: f64,
) -> Vec<f64> {
    let on_bone = |&(head, tail): &(DVec3, DVec3)| {
        let looks = (2.0 * head.distance(tail) / field.cell).ceil().clamp(1.0, 1e4) as u32;
        (0..=looks).map(move |look| head.lerp(tail, f64::from(look) / f64::from(looks)))
    };
    let sources: Vec<(u32, f64)> =
        bones.iter().flat_map(on_bone).filter_map(|point| Some((field.voxel_at(point)?, 0.0))).collect();
    if sources.is_empty() {
        return Vec::new();
    }
    let ways = Ways::new(field).distances(&sources, None);
    let beyond = tips.iter().map(|&tip| ways[tip as usize] / diameter - FREE_TIP);
    beyond.filter(|beyond| beyond.is_finite() && *beyond > 0.0).collect()
}

/// Share of the score for bare tips: the farthest counts.
pub(super) fn of_bare_tips(beyond: &[f64]) -> f64 {
    let farthest = beyond.iter().copied().fold(0.0, f64::max);
    1.0 / (1.0 + (farthest / HALF_BARE).powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::fit::test_bodies::{field, tubes};
    use crate::rig::fit::tips::Tips;

    #[test]
    fn even_stretches_cost_nothing() {
        assert!((of_lengths(&[(1.0, 2.0), (3.0, 6.0)]) - 1.0).abs() < 1e-12);
        assert!(of_lengths(&[(1.0, 0.1), (1.0, 6.0)]) < 0.3);
        assert_eq!(of_lengths(&[]), 0.0);
        assert!(of_cost(0.0) == 1.0 && of_cost(HALF_COST) == 0.5);
    }

    #[test]
    fn a_trunk_may_be_turned_a_little_but_not_lie_down() {
        let trunk = [(0.1, 0.0), (-0.1, 0.0), (0.2, 0.6), (-0.2, 0.6)].map(|(x, z)| DVec3::new(x, 0.0, z));
        let turned = |degrees: f64| {
            let turn = glam::DQuat::from_rotation_x(degrees.to_radians());
            let pairs: Vec<_> = trunk.iter().map(|&p| (p, turn * p * 3.0 + DVec3::ONE)).collect();
            of_trunk(&pairs, Some(DVec3::X))
        };
        assert!(turned(0.0) > 0.999 && turned(30.0) > 0.9 && turned(90.0) < 0.2);
        let upside_down: Vec<_> = trunk.iter().map(|&p| (p, DVec3::new(p.x, p.y, -p.z))).collect();
        assert!(of_trunk(&upside_down, None) < 0.1 && of_trunk(&[], None) == 1.0);
    }

    #[test]
    fn a_limb_without_bones_is_seen() {
        let (along, across) = ((-DVec3::X, DVec3::X, 0.1), (DVec3::ZERO, DVec3::Y, 0.1));
        let field = field(&tubes(&[along, across]));
        let tips = Tips::new(&Ways::new(&field), None).unwrap();
        let voxels: Vec<u32> = tips.tips.iter().map(|tip| tip.voxel).collect();
        let bare = |bones: &[(DVec3, DVec3)]| bare_tips(bones, &field, &voxels, tips.diameter);
        let whole = (-DVec3::X, DVec3::X);
        assert_eq!(bare(&[whole, (DVec3::ZERO, DVec3::Y)]), []);
        let one = bare(&[whole]);
        assert!(one.len() == 1 && of_bare_tips(&one) < 0.5, "{one:?}");
        assert_eq!(of_bare_tips(&[]), 1.0);
    }
}
