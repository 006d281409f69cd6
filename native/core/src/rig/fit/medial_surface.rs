//! Samples of the medial surface (Baran & Popović 2007, section 3.1): voxels on a ridge of the
//! distance field, where the nearest surface changes from one side of a limb to another.

use glam::IVec3;

use super::distance_field::DistanceField;
use super::voxel_grid::neighbours;

/// On a ridge the distance falls to both sides by at least this share of the step.
const FALL: f64 = 0.3;

/// The voxels on ridges, the deepest first.
pub(super) fn medial_surface(field: &DistanceField) -> Vec<u32> {
    // One of each pair of opposite directions.
    let steps: Vec<IVec3> = neighbours().filter(|step| (step.z, step.y, step.x) > (0, 0, 0)).collect();
    let depth = |place: IVec3| field.id(place).map_or(-0.5 * field.cell, |id| field.depth[id as usize]);
    let is_ridge = |id: u32| {
        let (place, here) = (field.voxels[id as usize], field.depth[id as usize]);
        steps.iter().any(|&step| {
            let fall = FALL * field.cell * step.as_dvec3().length();
            depth(place + step) <= here - fall && depth(place - step) <= here - fall
        })
    };
    let mut ridge: Vec<u32> = (0..field.voxels.len() as u32).filter(|&id| is_ridge(id)).collect();
    ridge.sort_by(|&a, &b| field.depth[b as usize].total_cmp(&field.depth[a as usize]).then(a.cmp(&b)));
    ridge
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::fit::test_bodies::{field, tubes};
    use glam::DVec3;

    #[test]
    fn the_medial_surface_of_a_tube_is_its_axis() {
        let field = field(&tubes(&[(DVec3::ZERO, DVec3::X * 2.0, 0.3)]));
        let medial = medial_surface(&field);
        assert!(medial.len() > 20);
        for &id in &medial {
            let point = field.position(id);
            let off = point.distance(DVec3::X * point.x);
            // Corners of the tube have short ridges of their own towards the middle.
            assert!(off < 0.3 && field.depth[id as usize] > 0.0, "{point}");
        }
        let on_axis = medial.iter().filter(|&&id| field.position(id).reject_from(DVec3::X).length() < 0.05);
        assert!(on_axis.count() as f64 > 60.0);
        assert!(medial.windows(2).all(|p| field.depth[p[0] as usize] >= field.depth[p[1] as usize]));
    }
}
