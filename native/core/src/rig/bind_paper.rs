//! Weights from the skeleton alone (section 4.1, eq. 2): inverse fourth powers of the distances to
//! the attached bone segments, three of them in a joint area, two elsewhere.

use glam::DVec3;
use rayon::prelude::*;

use super::regions::nearest_bones;
use super::{Region, Skeleton, decompose};
use crate::skinning::SkinWeights;

const IN_JOINT_AREAS: usize = 3;
const ELSEWHERE: usize = 2;

/// Weights (V×B) of points among the bones (B) that take part. Each point is attached to its nearest
/// segments, of equally near ones to those that it leans to. A point on bones belongs to these alone, in
/// equal parts. Rows sum to 1; without bones that take part they are empty.
#[must_use]
pub fn bind_weights_paper(points: &[DVec3], skeleton: &Skeleton, takes_part: &[bool]) -> SkinWeights {
    let regions = decompose(points, skeleton, takes_part);
    let row = |(&point, region): (&DVec3, &Option<Region>)| {
        let attached = if matches!(region, Some(Region::Joint(_))) { IN_JOINT_AREAS } else { ELSEWHERE };
        let mut nearest = nearest_bones(point, skeleton, takes_part);
        nearest.truncate(attached);
        let least = nearest.first().map_or(0.0, |found| found.0);
        // Relative to the nearest, so that no power overflows whatever the unit.
        let inverse = |d: f64| if d <= least { 1.0 } else { (least / d).powi(4) };
        let total: f64 = nearest.iter().map(|&(d, _)| inverse(d)).sum();
        nearest.sort_by_key(|found| found.1);
        nearest.into_iter().map(|(d, bone)| (bone, inverse(d) / total)).collect::<Vec<_>>()
    };
    let rows: Vec<Vec<(u32, f64)>> = points.par_iter().zip(&regions).map(row).collect();
    SkinWeights::from_rows(rows, skeleton.bone_count())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arm() -> Skeleton {
        let heads = vec![DVec3::ZERO, DVec3::X, DVec3::X * 2.0, DVec3::X * 2.0];
        let tails = vec![DVec3::X, DVec3::X * 2.0, DVec3::new(3.0, 1.0, 0.0), DVec3::new(3.0, -1.0, 0.0)];
        Skeleton::new(heads, tails, &[-1, 0, 1, 1], None).unwrap()
    }

    #[test]
    fn two_bones_on_a_limb_and_three_at_a_joint() {
        let points = [DVec3::new(0.5, 0.5, 0.0), DVec3::new(1.9, 0.1, 0.2)];
        let weights = bind_weights_paper(&points, &arm(), &[true; 4]);
        assert_eq!(weights.row(0).0, [0, 1]);
        // Distances 1/2 and √2/2: fourth powers of the inverses are 16 and 4.
        assert!((weights.row(0).1[0] - 0.8).abs() < 1e-6);
        assert_eq!(weights.row(1).0, [1, 2, 3]);
        assert!((weights.total(1) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_point_on_a_bone_belongs_to_it_alone() {
        let points = [DVec3::new(0.4, 0.0, 0.0), DVec3::X, DVec3::X * 2.0];
        let weights = bind_weights_paper(&points, &arm(), &[true; 4]);
        assert_eq!(weights.row(0), (&[0][..], &[1.0][..]));
        assert_eq!(weights.row(1), (&[0, 1][..], &[0.5, 0.5][..]));
        assert_eq!(weights.row(2).0, [1, 2, 3]);
        let few = bind_weights_paper(&points, &arm(), &[false, true, false, false]);
        assert_eq!(few.row(0), (&[1][..], &[1.0][..]));
        assert_eq!(bind_weights_paper(&points, &arm(), &[false; 4]).entry_count(), 0);
    }
}
