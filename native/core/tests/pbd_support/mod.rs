//! A capped cylinder with two bones, and measures of a deformed surface.

use dermis::mesh::TriangleMesh;
use dermis::rig::Skeleton;
use dermis::skinning::SkinWeights;
use glam::{Affine3A, DVec3, Quat, Vec3};

pub(crate) const RINGS: usize = 100;
pub(crate) const SIDES: usize = 40;
/// Half the length of the cylinder.
pub(crate) const HALF: f64 = 4.0;

/// A cylinder of radius 1 along x; weights pass smoothly from bone 0 to bone 1 over |x| ≤ 1.2.
pub(crate) struct Cylinder {
    pub(crate) mesh: TriangleMesh,
    pub(crate) skeleton: Skeleton,
    pub(crate) weights: SkinWeights,
}

impl Cylinder {
    pub(crate) fn new(transform: impl Fn(DVec3) -> DVec3) -> Self {
        let mut vertices = Vec::new();
        for ring in 0..RINGS {
            let x = HALF * (2.0 * ring as f64 / (RINGS - 1) as f64 - 1.0);
            vertices.extend((0..SIDES).map(|k| {
                let angle = std::f64::consts::TAU * k as f64 / SIDES as f64;
                DVec3::new(x, angle.cos(), angle.sin())
            }));
        }
        let mut triangles = Vec::new();
        let at = |ring: usize, k: usize| (ring * SIDES + k % SIDES) as u32;
        for ring in 0..RINGS - 1 {
            for k in 0..SIDES {
                let (a, b, c, d) = (at(ring, k), at(ring, k + 1), at(ring + 1, k + 1), at(ring + 1, k));
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        for (ring, x) in [(0, -HALF), (RINGS - 1, HALF)] {
            let centre = vertices.len() as u32;
            vertices.push(DVec3::X * x);
            for k in 0..SIDES {
                let (a, b) = (at(ring, k), at(ring, k + 1));
                triangles.push(if ring == 0 { [b, a, centre] } else { [a, b, centre] });
            }
        }
        // The sides above wind outwards when seen along −x.
        let triangles = triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect();
        let weights = vertices.iter().enumerate().flat_map(|(v, p)| {
            let t = ((p.x + 1.2) / 2.4).clamp(0.0, 1.0);
            let below = t * t * (3.0 - 2.0 * t);
            [(v as i64, 0, 1.0 - below), (v as i64, 1, below)]
        });
        let weights = SkinWeights::from_triplets(weights, vertices.len(), 2).unwrap();
        let heads = vec![transform(DVec3::X * -HALF), transform(DVec3::ZERO)];
        let tails = vec![transform(DVec3::ZERO), transform(DVec3::X * HALF)];
        let skeleton = Skeleton::new(heads, tails, &[-1, 0], None).unwrap();
        let vertices = vertices.into_iter().map(transform).collect();
        Self { mesh: TriangleMesh::new(vertices, triangles).unwrap(), skeleton, weights }
    }

    pub(crate) fn rest(&self) -> Vec<Vec3> {
        self.mesh.vertices().iter().map(|v| v.as_vec3()).collect()
    }
}

/// The second bone turned about x.
pub(crate) fn twist(degrees: f32) -> [Affine3A; 2] {
    [Affine3A::IDENTITY, Affine3A::from_quat(Quat::from_rotation_x(degrees.to_radians()))]
}

/// The second bone turned about z.
pub(crate) fn bend(degrees: f32) -> [Affine3A; 2] {
    [Affine3A::IDENTITY, Affine3A::from_quat(Quat::from_rotation_z(degrees.to_radians()))]
}

/// Volume of the part that was within |x| < 1.3 in rest, its ends closed by fans.
pub(crate) fn zone_volume(positions: &[Vec3]) -> f64 {
    let x_of = |ring: usize| HALF * (2.0 * ring as f64 / (RINGS - 1) as f64 - 1.0);
    let rings: Vec<usize> = (0..RINGS).filter(|&ring| x_of(ring).abs() < 1.3).collect();
    let at = |ring: usize, k: usize| positions[ring * SIDES + k % SIDES].as_dvec3();
    let cone = |a: DVec3, b: DVec3, c: DVec3| a.dot(b.cross(c)) / 6.0;
    let mut volume = 0.0;
    for pair in rings.windows(2) {
        for k in 0..SIDES {
            let (a, b, c, d) = (at(pair[0], k), at(pair[0], k + 1), at(pair[1], k + 1), at(pair[1], k));
            volume += cone(a, c, b) + cone(a, d, c);
        }
    }
    for (ring, sign) in [(rings[0], 1.0), (rings[rings.len() - 1], -1.0)] {
        let centre = (0..SIDES).map(|k| at(ring, k)).sum::<DVec3>() / SIDES as f64;
        volume += sign * (0..SIDES).map(|k| cone(at(ring, k), at(ring, k + 1), centre)).sum::<f64>();
    }
    volume.abs()
}

/// Pairs of triangles without a common vertex that pass through each other.
pub(crate) fn crossings(mesh: &TriangleMesh, positions: &[Vec3]) -> usize {
    let corners: Vec<[DVec3; 3]> =
        mesh.triangles().iter().map(|t| t.map(|v| positions[v as usize].as_dvec3())).collect();
    let boxes: Vec<(DVec3, DVec3)> =
        corners.iter().map(|[a, b, c]| (a.min(*b).min(*c), a.max(*b).max(*c))).collect();
    let mut order: Vec<usize> = (0..corners.len()).collect();
    order.sort_by(|&a, &b| boxes[a].0.x.total_cmp(&boxes[b].0.x));
    let mut count = 0;
    for (index, &a) in order.iter().enumerate() {
        for &b in order[index + 1..].iter().take_while(|&&b| boxes[b].0.x <= boxes[a].1.x) {
            let apart = boxes[a].0.cmpgt(boxes[b].1).any() || boxes[b].0.cmpgt(boxes[a].1).any();
            let (s, t) = (mesh.triangles()[a], mesh.triangles()[b]);
            if !apart && !s.iter().any(|v| t.contains(v)) {
                let (s, t) = (corners[a], corners[b]);
                let pierces = |p: [DVec3; 3], t: [DVec3; 3]| (0..3).any(|k| pierces(p[k], p[(k + 1) % 3], t));
                count += usize::from(pierces(s, t) || pierces(t, s));
            }
        }
    }
    count
}

/// True where a segment passes through a triangle by more than rounding.
fn pierces(p: DVec3, q: DVec3, [a, b, c]: [DVec3; 3]) -> bool {
    let side = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| (b - a).cross(c - a).dot(d - a);
    let (from, to) = (side(a, b, c, p), side(a, b, c, q));
    let rounding = 1e-5 * (b - a).cross(c - a).length() * (q - p).length();
    if from * to >= 0.0 || from.abs() < rounding || to.abs() < rounding {
        return false;
    }
    let around = [side(p, q, a, b), side(p, q, b, c), side(p, q, c, a)];
    around.iter().all(|s| *s > 0.0) || around.iter().all(|s| *s < 0.0)
}
