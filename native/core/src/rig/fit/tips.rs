//! Tips of a body: hands, feet, head, tail. They are where the distance from the body's middle is
//! larger than all around, and they last: the limb below is longer than a bump.
//!
//! The voxels are visited from the farthest to the nearest; every local maximum opens a part of its
//! own, and where two parts meet the shorter one ends. How far it reaches over the meeting is its
//! length (persistence, Edelsbrunner et al. 2002).

use super::geodesic::Ways;
use crate::rig::bind::Plane;

/// Tips reach at least this share of the body's geodesic diameter over where they begin.
const SHORTEST: f64 = 0.025;
/// Tips of the outline nearer than this to an ordinary tip, as a share of the diameter, are on its limb.
const SAME_LIMB: f64 = 0.15;
/// The most tips to look at.
const MOST: usize = 20;

/// A tip of the body.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tip {
    pub(super) voxel: u32,
    /// How far it reaches over the place where it leaves another part.
    pub(super) length: f64,
    /// Distance of every voxel (N) from it through the body.
    pub(super) distances: Vec<f64>,
    /// A tip of the body's outline in its mirror plane, such as a snout between two ears: only for
    /// limbs in the middle.
    pub(super) is_middle: bool,
}

/// The body's tips, the longest first, its middle, and its geodesic diameter.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tips {
    pub(super) tips: Vec<Tip>,
    pub(super) middle: u32,
    pub(super) diameter: f64,
}

impl Tips {
    /// Finds the tips, and those of the outline in a mirror plane; `None` for a body without voxels.
    pub(super) fn new(ways: &Ways, plane: Option<&Plane>) -> Option<Self> {
        let field = ways.field;
        let count = field.voxels.len() as u32;
        let deepest = (0..count)
            .max_by(|&a, &b| field.depth[a as usize].total_cmp(&field.depth[b as usize]).then(b.cmp(&a)))?;
        let farthest = |distances: &[f64]| {
            (0..count)
                .filter(|&id| distances[id as usize].is_finite())
                .max_by(|&a, &b| distances[a as usize].total_cmp(&distances[b as usize]).then(b.cmp(&a)))
        };
        let first = farthest(&ways.distances(&[(deepest, 0.0)], None))?;
        let from_first = ways.distances(&[(first, 0.0)], None);
        let second = farthest(&from_first)?;
        let diameter = from_first[second as usize];
        let path = ways.path(second, &from_first);
        let half = path.iter().copied().find(|&id| from_first[id as usize] <= 0.5 * diameter)?;
        // From the path, which cuts corners, to the deepest voxel around.
        let around = ways.distances(&[(half, 0.0)], None);
        let middle = (0..count)
            .filter(|&id| around[id as usize] <= 0.08 * diameter)
            .max_by(|&a, &b| field.depth[a as usize].total_cmp(&field.depth[b as usize]).then(b.cmp(&a)))?;
        let from_middle = ways.distances(&[(middle, 0.0)], None);
        let longest = |mut tips: Vec<(u32, f64)>| {
            tips.retain(|tip| tip.1 >= SHORTEST * diameter);
            tips.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
            tips.truncate(MOST);
            tips
        };
        let tip = |(voxel, length): (u32, f64), is_middle| Tip {
            voxel,
            length,
            distances: ways.distances(&[(voxel, 0.0)], None),
            is_middle,
        };
        let found = longest(lasting_maxima(ways, &from_middle));
        let mut tips: Vec<Tip> = found.into_iter().map(|found| tip(found, false)).collect();
        if let Some(plane) = plane {
            let in_plane: Vec<f64> = (0..count)
                .map(|id| match plane.height(field.position(id)).abs() <= field.cell {
                    true => from_middle[id as usize],
                    false => f64::INFINITY,
                })
                .collect();
            for (voxel, length) in longest(lasting_maxima(ways, &in_plane)) {
                let is_new = |tip: &Tip| {
                    let apart = tip.distances[voxel as usize];
                    let is_farther = from_middle[tip.voxel as usize] >= from_middle[voxel as usize];
                    let in_plane = plane.height(field.position(tip.voxel)).abs() <= 2.0 * field.cell;
                    // A chin or a nose below a crown that is in the plane itself ends no limb of its own.
                    apart > SHORTEST * diameter
                        && !(!tip.is_middle && in_plane && is_farther && apart < SAME_LIMB * diameter)
                };
                if tips.iter().all(is_new) {
                    tips.push(tip((voxel, length), true));
                }
            }
        }
        Some(Self { tips, middle, diameter })
    }
}

/// Local maxima of a function on the voxels where it is finite, and how far each reaches over its
/// meeting with a larger one.
fn lasting_maxima(ways: &Ways, values: &[f64]) -> Vec<(u32, f64)> {
    let mut order: Vec<u32> =
        (0..values.len() as u32).filter(|&id| values[id as usize].is_finite()).collect();
    order.sort_by(|&a, &b| values[b as usize].total_cmp(&values[a as usize]).then(a.cmp(&b)));
    let mut parents: Vec<u32> = vec![u32::MAX; values.len()];
    let mut lasting = Vec::new();
    for &id in &order {
        parents[id as usize] = id;
        let mut roots: Vec<u32> = Vec::new();
        for next in ways.neighbours(id) {
            if parents[next as usize] != u32::MAX {
                let root = root_of(&mut parents, next);
                if root != id && !roots.contains(&root) {
                    roots.push(root);
                }
            }
        }
        // The part with the highest maximum goes on; roots are the maxima of their parts.
        roots.sort_by(|&a, &b| values[b as usize].total_cmp(&values[a as usize]).then(a.cmp(&b)));
        if let Some((&highest, ended)) = roots.split_first() {
            parents[id as usize] = highest;
            for &part in ended {
                parents[part as usize] = highest;
                lasting.push((part, values[part as usize] - values[id as usize]));
            }
        }
    }
    if let Some(&highest) = order.first() {
        lasting.push((highest, values[highest as usize]));
    }
    lasting
}

fn root_of(parents: &mut [u32], mut id: u32) -> u32 {
    while parents[id as usize] != id {
        parents[id as usize] = parents[parents[id as usize] as usize];
        id = parents[id as usize];
    }
    id
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::fit::test_bodies::{field, figure};
    use glam::DVec3;

    #[test]
    fn a_figure_has_hands_feet_and_a_head() {
        let field = field(&figure(0.6));
        let tips = Tips::new(&Ways::new(&field), None).unwrap();
        let near = |x: f64, y: f64, z: f64| {
            let at = DVec3::new(x, y, z);
            tips.tips[..5].iter().any(|tip| field.position(tip.voxel).distance(at) < 0.1)
        };
        let (x, z) = (0.14 + 0.66 * 0.6f64.cos(), 1.36 - 0.66 * 0.6f64.sin());
        assert!(near(x, 0.0, z) && near(-x, 0.0, z), "hands");
        assert!(near(0.11, -0.2, 0.04) && near(-0.11, -0.2, 0.04), "feet");
        assert!(near(0.0, 0.0, 1.7), "head");
        assert!(tips.tips[5..].iter().all(|tip| tip.length < 0.2), "{}", tips.tips.len());
    }

    #[test]
    fn the_outline_in_the_plane_has_tips_of_its_own() {
        let field = field(&figure(0.6));
        let plane = Plane { normal: DVec3::X, offset: 0.0 };
        let tips = Tips::new(&Ways::new(&field), Some(&plane)).unwrap();
        let crotch = tips.tips.iter().filter(|tip| tip.is_middle).map(|tip| field.position(tip.voxel));
        assert!(crotch.into_iter().any(|p| p.distance(DVec3::new(0.0, 0.0, 0.81)) < 0.1));
    }
}
