//! Bodies for tests: closed tubes around segments, which may overlap.

use glam::DVec3;

use super::distance_field::DistanceField;
use crate::mesh::TriangleMesh;
use crate::progress::Progress;
use crate::rig::Skeleton;

/// Corners of a tube and points along its ends.
const CORNERS: u32 = 12;

/// A mesh of closed tubes from `a` to `b` with rounded ends: `(a, b, radius)`.
pub(super) fn tubes(segments: &[(DVec3, DVec3, f64)]) -> TriangleMesh {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for &(a, b, radius) in segments {
        let axis = (b - a).normalize();
        let (u, v) = axis.any_orthonormal_pair();
        // Rings from one pole to the other: offset along the axis and size, in radii.
        let cap = [(-0.94, 0.34), (-0.64, 0.77), (0.0, 1.0)];
        let far = cap.iter().rev().map(|&(along, size)| (b, -along, size));
        let rings: Vec<_> = cap.iter().map(|&(along, size)| (a, along, size)).chain(far).collect();
        let first = vertices.len() as u32;
        vertices.push(a - axis * radius);
        for &(middle, along, size) in &rings {
            for corner in 0..CORNERS {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(corner) / f64::from(CORNERS)).sin_cos();
                vertices.push(middle + (axis * along + (u * cos + v * sin) * size) * radius);
            }
        }
        vertices.push(b + axis * radius);
        let last = vertices.len() as u32 - 1;
        let at = |ring: u32, corner: u32| first + 1 + ring * CORNERS + corner % CORNERS;
        for corner in 0..CORNERS {
            triangles.push([first, at(0, corner + 1), at(0, corner)]);
            triangles.push([
                last,
                at(rings.len() as u32 - 1, corner),
                at(rings.len() as u32 - 1, corner + 1),
            ]);
            for ring in 0..rings.len() as u32 - 1 {
                let [p, q] = [0, 1].map(|step| at(ring, corner + step));
                let [r, s] = [0, 1].map(|step| at(ring + 1, corner + step));
                triangles.push([p, q, s]);
                triangles.push([p, s, r]);
            }
        }
    }
    TriangleMesh::new(vertices, triangles).unwrap()
}

/// A figure of tubes, 1.7 high, its arms lowered by an angle.
pub(super) fn figure(lowered: f64) -> TriangleMesh {
    let at = DVec3::new;
    let mut parts = vec![
        (at(0.0, 0.0, 0.95), at(0.0, 0.0, 1.3), 0.14),
        (at(0.0, 0.0, 1.3), at(0.0, 0.0, 1.5), 0.05),
        (at(0.0, 0.0, 1.58), at(0.0, 0.0, 1.62), 0.1),
    ];
    for side in [1.0, -1.0] {
        let shoulder = at(0.14 * side, 0.0, 1.36);
        let hand = shoulder + at(side * lowered.cos(), 0.0, -lowered.sin()) * 0.62;
        let (hip, ankle) = (at(0.09 * side, 0.0, 0.88), at(0.11 * side, 0.0, 0.06));
        parts.push((shoulder, hand, 0.045));
        parts.push((hip, ankle, 0.07));
        parts.push((ankle, ankle + at(0.0, -0.16, -0.02), 0.04));
    }
    tubes(&parts)
}

/// A skeleton for figures in a T-pose, with a root on the ground: names, heads and tails.
pub(super) fn skeleton() -> Skeleton {
    let at = DVec3::new;
    let mut bones: Vec<(String, i64, DVec3, DVec3)> = vec![
        ("root".into(), -1, at(0.0, 0.0, 0.0), at(0.0, 0.2, 0.0)),
        ("pelvis".into(), 0, at(0.0, 0.0, 0.95), at(0.0, 0.0, 1.05)),
        ("chest".into(), 1, at(0.0, 0.0, 1.05), at(0.0, 0.0, 1.35)),
        ("neck".into(), 2, at(0.0, 0.0, 1.42), at(0.0, 0.0, 1.5)),
        ("head".into(), 3, at(0.0, 0.0, 1.5), at(0.0, 0.0, 1.7)),
    ];
    for (name, side) in [("l", 1.0), ("r", -1.0)] {
        let arm = |x: f64| at(x * side, 0.0, 1.36);
        let leg = |y: f64, z: f64| at(0.1 * side, y, z);
        let first = bones.len() as i64;
        bones.push((format!("clavicle_{name}"), 2, arm(0.02), arm(0.16)));
        bones.push((format!("upperarm_{name}"), first, arm(0.16), arm(0.42)));
        bones.push((format!("lowerarm_{name}"), first + 1, arm(0.42), arm(0.66)));
        bones.push((format!("hand_{name}"), first + 2, arm(0.66), arm(0.75)));
        bones.push((format!("thumb_{name}"), first + 3, arm(0.68), at(0.72 * side, -0.05, 1.36)));
        bones.push((format!("thigh_{name}"), 1, leg(0.0, 0.92), leg(-0.01, 0.5)));
        bones.push((format!("calf_{name}"), first + 5, leg(-0.01, 0.5), leg(0.0, 0.08)));
        bones.push((format!("foot_{name}"), first + 6, leg(0.0, 0.08), leg(-0.16, 0.03)));
    }
    Skeleton::new(
        bones.iter().map(|bone| bone.2).collect(),
        bones.iter().map(|bone| bone.3).collect(),
        &bones.iter().map(|bone| bone.1).collect::<Vec<_>>(),
        Some(bones.iter().map(|bone| bone.0.clone()).collect()),
    )
    .unwrap()
}

/// A bone by name.
pub(super) fn bone(skeleton: &Skeleton, name: &str) -> usize {
    skeleton.names().unwrap().iter().position(|n| n == name).unwrap()
}

/// The distance field of a mesh.
pub(super) fn field(mesh: &TriangleMesh) -> DistanceField {
    DistanceField::new(mesh, &Progress::new()).unwrap()
}
