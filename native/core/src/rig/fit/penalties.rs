//! The penalties of an embedding (Baran & Popović 2007, section 3.3, appendix A), on pairs of nodes of
//! the reduced skeleton. Each is about 1 where a pair is clearly wrong.

use glam::DVec3;

use crate::rig::bind::Plane;

/// Logarithm of a ratio of lengths that costs nothing: proportions of characters differ so much.
const FREE_LENGTH: f64 = 0.12;
const LENGTH: f64 = 5.0;
const MOST_LENGTH: f64 = 1.0;
const DIRECTION: f64 = 1.0;
/// A direction that points backwards costs more.
const BACKWARDS: f64 = 2.0;
const SYMMETRY: f64 = 8.0;
/// A share of a limb's length that its tip must at least reach out of the body.
const TIP_SHARE: f64 = 0.35;
const SHORT_TIP: f64 = 1.0;
/// Price of a limb that is not embedded, for every other node.
pub(super) const MISSING: f64 = 1.3;
/// Price of two mirrored limbs that end in one tip, as where paws touch.
pub(super) const SHARED_TIP: f64 = 5.0;
/// Price of a limb that is embedded without its mirror image.
pub(super) const ONE_SIDED: f64 = 2.0;

/// Length: the way between two places in the body beside the way along the template's bones.
pub(super) fn length(found: f64, expected: f64) -> f64 {
    if !(found > 0.0 && expected > 0.0) {
        return MOST_LENGTH;
    }
    let beyond = ((found / expected).ln().abs() - FREE_LENGTH).max(0.0);
    (LENGTH * beyond * beyond).min(MOST_LENGTH)
}

/// Orientation: the direction from one place to the other beside that in the template. Counts less
/// where the chain between them is bent, so that its ends are near each other.
pub(super) fn direction(found: DVec3, expected: DVec3, way: f64) -> f64 {
    let (a, b) = (found.normalize_or_zero(), expected.normalize_or_zero());
    if a == DVec3::ZERO || b == DVec3::ZERO {
        return 0.0;
    }
    let cosine = a.dot(b);
    let straight = (2.0 * expected.length() / way.max(f64::MIN_POSITIVE)).min(1.0);
    straight * (DIRECTION * (1.0 - cosine) + BACKWARDS * (-cosine).max(0.0))
}

/// Symmetry: mirrored nodes are in mirrored places; a node in the middle is its own partner.
pub(super) fn symmetry(plane: &Plane, one: DVec3, other: DVec3, size: f64) -> f64 {
    SYMMETRY * plane.mirrored(one).distance(other) / size
}

/// Extremities: a limb ends in a tip of the body that reaches out as a limb does.
pub(super) fn tip(length: f64, limb: f64) -> f64 {
    let share = length / (TIP_SHARE * limb).max(f64::MIN_POSITIVE);
    SHORT_TIP * (1.0 - share).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn right_pairs_are_free_and_wrong_ones_cost_about_one() {
        assert_eq!(length(1.1, 1.0), 0.0);
        assert!(length(2.0, 1.0) > 0.9 && length(0.0, 1.0) == MOST_LENGTH);
        assert_eq!(direction(DVec3::X, DVec3::X * 3.0, 3.0), 0.0);
        assert!(direction(-DVec3::X, DVec3::X, 1.0) > direction(DVec3::Y, DVec3::X, 1.0));
        assert!(direction(DVec3::Y, DVec3::X, 10.0) < 0.3, "a bent chain says little");
        let plane = Plane { normal: DVec3::X, offset: 1.0 };
        assert_eq!(symmetry(&plane, DVec3::ZERO, DVec3::X * 2.0, 1.0), 0.0);
        assert!(tip(1.0, 1.0) == 0.0 && tip(0.0, 1.0) == SHORT_TIP);
    }
}
