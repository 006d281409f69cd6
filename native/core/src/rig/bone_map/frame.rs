//! A common frame for two skeletons: how to turn, scale and move the one so that its bones can be
//! compared with those of the other.

use glam::{DMat3, DVec3};
use nalgebra::{Matrix3, SymmetricEigen};

use crate::median::weighted_median;
use crate::rig::Skeleton;

/// Heads and tails in a common frame: centred, and of extent 1.
pub(super) struct Placed {
    pub(super) heads: Vec<DVec3>,
    pub(super) tails: Vec<DVec3>,
}

impl Placed {
    /// Turns a skeleton about its middle and scales it to extent 1.
    pub(super) fn new(skeleton: &Skeleton, rotation: DMat3) -> Self {
        let (middle, extent) = middle_and_extent(skeleton);
        let place = |p: &DVec3| rotation * ((*p - middle) / extent);
        Self {
            heads: skeleton.heads().iter().map(place).collect(),
            tails: skeleton.tails().iter().map(place).collect(),
        }
    }
}

/// Middle of each coordinate over the length of all bones, and the middle distance to that point: a
/// face full of short bones and a helper far away hardly matter.
fn middle_and_extent(skeleton: &Skeleton) -> (DVec3, f64) {
    let lengths: Vec<f64> = (0..skeleton.bone_count()).map(|bone| skeleton.length(bone)).collect();
    // Bones without length still are somewhere.
    let least = 1e-3 * lengths.iter().sum::<f64>() / lengths.len().max(1) as f64;
    let weights: Vec<f64> = lengths.iter().map(|length| length.max(least).max(1e-300)).collect();
    let points: Vec<DVec3> =
        skeleton.heads().iter().zip(skeleton.tails()).map(|(head, tail)| 0.5 * (*head + *tail)).collect();
    let axis =
        |axis: usize| weighted_median(points.iter().map(|p| p[axis]).zip(weights.iter().copied()).collect());
    let middle = DVec3::new(axis(0), axis(1), axis(2));
    let away = points.iter().map(|p| p.distance(middle)).zip(weights.iter().copied()).collect();
    let extent = 2.0 * weighted_median(away);
    (middle, if extent > 0.0 { extent } else { 1.0 })
}

/// Rotations that may take the target's axes to the source's: none, the other ways to name three
/// axes, and the four ways to lay principal axes on each other. No mirror images.
pub(super) fn candidate_rotations(source: &Skeleton, target: &Skeleton) -> Vec<DMat3> {
    let mut rotations = vec![DMat3::IDENTITY];
    for (x, y) in (0..3).flat_map(|x| (0..3).map(move |y| (x, y))).filter(|(x, y)| x != y) {
        for signs in 0..4 {
            let axis =
                |axis: usize, bit: u32| DVec3::AXES[axis] * if signs & (1 << bit) == 0 { 1.0 } else { -1.0 };
            let (first, second) = (axis(x, 0), axis(y, 1));
            let rotation = DMat3::from_cols(first, second, first.cross(second));
            if rotation != DMat3::IDENTITY {
                rotations.push(rotation);
            }
        }
    }
    let (from, to) = (principal_axes(source), principal_axes(target));
    for signs in [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] {
        let turned = DMat3::from_cols(
            from.x_axis * signs[0],
            from.y_axis * signs[1],
            (from.x_axis * signs[0]).cross(from.y_axis * signs[1]),
        );
        rotations.push(turned * to.transpose());
    }
    rotations
}

/// Right-handed principal axes of the heads, the longest first.
fn principal_axes(skeleton: &Skeleton) -> DMat3 {
    let (middle, extent) = middle_and_extent(skeleton);
    let mut spread = Matrix3::zeros();
    for head in skeleton.heads() {
        let p = nalgebra::Vector3::from(((*head - middle) / extent).clamp_length_max(2.0).to_array());
        spread += p * p.transpose();
    }
    let eigen = SymmetricEigen::new(spread);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let axis = |i: usize| DVec3::from_slice(eigen.eigenvectors.column(order[i]).as_slice());
    DMat3::from_cols(axis(0), axis(1), axis(0).cross(axis(1)))
}

/// Rotation that lays directions of the target on those of the source best (Kabsch 1976), without
/// mirroring; `None` when they do not tell it.
pub(super) fn best_rotation(pairs: &[(DVec3, DVec3)]) -> Option<DMat3> {
    let mut product = Matrix3::zeros();
    for (source, target) in pairs {
        product += nalgebra::Vector3::from(source.to_array())
            * nalgebra::Vector3::from(target.to_array()).transpose();
    }
    let svd = product.svd(true, true);
    let (u, v) = (svd.u?, svd.v_t?);
    let singular = svd.singular_values;
    if singular[1] <= 1e-6 * singular[0] {
        return None;
    }
    let mut flip = Matrix3::identity();
    flip[(2, 2)] = (u * v).determinant().signum();
    let rotation = u * flip * v;
    Some(DMat3::from_cols_slice(rotation.as_slice()))
}

/// Across-the-body axis: the one of three along which the skeleton mirrors best, and where its
/// mirror stands; `None` for a skeleton that is not symmetric.
pub(super) fn mirror_axis(placed: &Placed) -> Option<(DVec3, f64)> {
    const SYMMETRIC: f64 = 0.05;
    let heads = &placed.heads;
    let mut best: Option<(f64, DVec3, f64)> = None;
    for axis in DVec3::AXES {
        let at = weighted_median(heads.iter().map(|p| (p.dot(axis), 1.0)).collect());
        let off = |p: &DVec3| {
            let mirrored = *p + axis * (2.0 * (at - p.dot(axis)));
            heads.iter().map(|q| q.distance(mirrored)).fold(f64::INFINITY, f64::min)
        };
        let across = heads.iter().map(|p| (p.dot(axis) - at).abs()).fold(0.0, f64::max);
        let error = heads.iter().map(off).sum::<f64>() / heads.len().max(1) as f64;
        if across > 2.0 * SYMMETRIC && error < SYMMETRIC && best.is_none_or(|found| error < found.0) {
            best = Some((error, axis, at));
        }
    }
    best.map(|(_, axis, at)| (axis, at))
}
