//! Automatic landmarks: places of warped source and target where rays from the same point of the
//! aligned skeleton leave them, as marks of the surface deformation.

use glam::{DMat3, DVec3};

use super::bone_rays::{Fan, median, shoot};
use super::icp::Surroundings;
use super::marks::{Anchor, Constraint};
use crate::mesh::{RayHit, TriangleMesh};
use crate::rig::Skeleton;
use crate::skinning::SkinWeights;

/// Rays that give landmarks.
const FAN: Fan<'static> = Fan { stations: &[0.0, 0.25, 0.5, 0.75], directions: 6 };

/// A landmark is plausible where the logarithm of its ratio of lengths lies this near its bone's
/// median.
const PLAUSIBLE: f64 = 0.4;

/// Cosine of the largest angle between the normals at the two places.
const NORMALS: f64 = 0.5;

/// What an automatic landmark weighs.
const WEIGHT: f64 = 30.0;

/// A landmark: a place on either surface.
pub(super) struct RayMark {
    triangle: u32,
    barycentric: [f64; 3],
    position: DVec3,
    vertices: [u32; 2],
}

impl RayMark {
    /// The mark that it is for the deformation.
    pub(super) fn constraint(&self) -> Constraint {
        let anchor = Anchor::Point { triangle: self.triangle, barycentric: self.barycentric };
        Constraint { anchor, position: self.position, weight: WEIGHT, trusted: false }
    }

    /// Nearest corners: source vertex, target vertex.
    pub(super) fn vertices(&self) -> [u32; 2] {
        self.vertices
    }
}

/// Finds the landmarks. Both surfaces and the skeleton are in the target's rest pose.
pub(super) fn ray_marks(
    (source, weights): (Surroundings<'_>, &SkinWeights),
    target: Surroundings<'_>,
    aligned: &Skeleton,
    takes_part: &[bool],
) -> Vec<RayMark> {
    let unturned = vec![DMat3::IDENTITY; aligned.bone_count()];
    let pairs = shoot((source, aligned, weights), (target, aligned, &unturned), takes_part, &FAN);
    let mut of_bone: Vec<Vec<f64>> = vec![Vec::new(); aligned.bone_count()];
    for pair in &pairs {
        of_bone[pair.bone as usize].push(pair.log_ratio());
    }
    let typical: Vec<f64> = of_bone.into_iter().map(|ratios| median(ratios).unwrap_or(0.0)).collect();
    let plausible = pairs.iter().filter(|pair| {
        let ratio = (pair.log_ratio() - typical[pair.bone as usize]).abs();
        ratio < PLAUSIBLE && normal(source, &pair.source).dot(normal(target, &pair.target)) > NORMALS
    });
    plausible
        .map(|pair| {
            let shares = [(source, &pair.source), (target, &pair.target)]
                .map(|(surface, hit)| barycentric(surface.mesh, hit));
            let corner = |surface: Surroundings<'_>, hit: &RayHit, shares: [f64; 3]| {
                let largest = (0..3).rev().max_by(|&a, &b| shares[a].total_cmp(&shares[b])).unwrap_or(0);
                surface.mesh.triangles()[hit.triangle as usize][largest]
            };
            RayMark {
                triangle: pair.source.triangle,
                barycentric: shares[0],
                position: pair.target.position,
                vertices: [corner(source, &pair.source, shares[0]), corner(target, &pair.target, shares[1])],
            }
        })
        .collect()
}

fn normal(surface: Surroundings<'_>, hit: &RayHit) -> DVec3 {
    let corner = surface.mesh.triangles()[hit.triangle as usize][0] as usize;
    surface.mesh.area_vector(hit.triangle as usize).normalize_or_zero() * surface.shell.side[corner]
}

/// Barycentric coordinates of a hit, not negative, sum 1.
fn barycentric(mesh: &TriangleMesh, hit: &RayHit) -> [f64; 3] {
    let [a, b, c] = mesh.corners(hit.triangle as usize);
    let normal = mesh.area_vector(hit.triangle as usize);
    let part = |p: DVec3, q: DVec3| (p - hit.position).cross(q - hit.position).dot(normal).max(0.0);
    let parts = [part(b, c), part(c, a), part(a, b)];
    let total: f64 = parts.iter().sum();
    if total > 0.0 { parts.map(|p| p / total) } else { [1.0, 0.0, 0.0] }
}
