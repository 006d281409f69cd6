//! Surfaces with a closed form, for tests.

use std::collections::HashMap;

use glam::{DAffine3, DVec3};

use super::TriangleMesh;

/// Unit sphere: an icosahedron whose triangles were cut in four `level` times.
pub(crate) fn icosphere(level: usize) -> TriangleMesh {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    let mut vertices: Vec<DVec3> = Vec::new();
    for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
        vertices.extend([DVec3::new(0.0, a, b), DVec3::new(a, b, 0.0), DVec3::new(b, 0.0, a)]);
    }
    let side = vertices[0].distance(vertices[3]);
    let near = |a: usize, b: usize| (vertices[a].distance(vertices[b]) - side).abs() < 1e-9;
    let mut triangles: Vec<[u32; 3]> = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in (b + 1..12).filter(|&c| near(a, b) && near(b, c) && near(a, c)) {
                let (p, q, r) = (vertices[a], vertices[b], vertices[c]);
                let out = (q - p).cross(r - p).dot(p) > 0.0;
                triangles.push(if out { [a, b, c] } else { [a, c, b] }.map(|v| v as u32));
            }
        }
    }
    for _ in 0..level {
        let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
        let mut finer = Vec::with_capacity(4 * triangles.len());
        for &[a, b, c] in &triangles {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(p, q)| {
                *middles.entry([p.min(q), p.max(q)]).or_insert_with(|| {
                    vertices.push((vertices[p as usize] + vertices[q as usize]) / 2.0);
                    vertices.len() as u32 - 1
                })
            });
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    TriangleMesh::new(vertices.into_iter().map(DVec3::normalize).collect(), triangles).unwrap()
}

/// Flat grid of (n + 1)² vertices over the unit square, in the plane z = 0.
pub(crate) fn grid(n: u32) -> TriangleMesh {
    let step = 1.0 / f64::from(n);
    let place = |i: u32| DVec3::new(f64::from(i % (n + 1)), f64::from(i / (n + 1)), 0.0) * step;
    let corner = |x: u32, y: u32| y * (n + 1) + x;
    let square = |i: u32| {
        let (x, y) = (i % n, i / n);
        let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
        [[a, b, c], [a, c, d]]
    };
    let vertices = (0..(n + 1) * (n + 1)).map(place).collect();
    TriangleMesh::new(vertices, (0..n * n).flat_map(square).collect()).unwrap()
}

/// Open tube around the z axis, `around` × (`along` + 1) vertices.
pub(crate) fn tube(radius: f64, height: f64, around: u32, along: u32) -> TriangleMesh {
    let place = |i: u32| {
        let (k, level) = (i % around, i / around);
        // Every second ring is turned by half a step, so that no two triangles are coplanar.
        let angle = std::f64::consts::TAU * (f64::from(k) + 0.5 * f64::from(level % 2)) / f64::from(around);
        let z = height * f64::from(level) / f64::from(along);
        DVec3::new(radius * angle.cos(), radius * angle.sin(), z)
    };
    let mut triangles = Vec::new();
    for level in 0..along {
        for k in 0..around {
            let next = (k + 1) % around;
            let (low, high) = (level * around, (level + 1) * around);
            if level % 2 == 0 {
                triangles.extend([[low + k, low + next, high + k], [low + next, high + next, high + k]]);
            } else {
                triangles.extend([[low + k, high + next, high + k], [low + k, low + next, high + next]]);
            }
        }
    }
    TriangleMesh::new((0..around * (along + 1)).map(place).collect(), triangles).unwrap()
}

/// Both surfaces in one mesh, vertices of the first one first.
pub(crate) fn joined(first: &TriangleMesh, second: &TriangleMesh) -> TriangleMesh {
    let base = first.vertex_count() as u32;
    let vertices = first.vertices().iter().chain(second.vertices()).copied().collect();
    let moved = second.triangles().iter().map(|t| t.map(|v| v + base));
    TriangleMesh::new(vertices, first.triangles().iter().copied().chain(moved).collect()).unwrap()
}

pub(crate) fn mapped(mesh: &TriangleMesh, map: impl Fn(DVec3) -> DVec3) -> TriangleMesh {
    let vertices = mesh.vertices().iter().map(|&p| map(p)).collect();
    TriangleMesh::new(vertices, mesh.triangles().to_vec()).unwrap()
}

pub(crate) fn scaled(mesh: &TriangleMesh, factor: f64) -> TriangleMesh {
    mapped(mesh, |p| p * factor)
}

/// A rotation about a skew axis, a translation and a uniform scale.
pub(crate) fn similarity(scale: f64) -> DAffine3 {
    let axis = DVec3::new(0.3, -0.5, 0.8).normalize();
    DAffine3::from_scale_rotation_translation(
        DVec3::splat(scale),
        glam::DQuat::from_axis_angle(axis, 1.1),
        DVec3::new(3.0, -2.0, 5.0) * scale,
    )
}

/// The mesh with its vertices in another order, and the new number of every vertex.
pub(crate) fn permuted(mesh: &TriangleMesh) -> (TriangleMesh, Vec<u32>) {
    let count = mesh.vertex_count();
    let stride = (count / 3..).find(|&s| gcd(s, count) == 1).unwrap();
    let new: Vec<u32> = (0..count).map(|v| ((v * stride + 1) % count) as u32).collect();
    let mut vertices = vec![DVec3::ZERO; count];
    for (v, &n) in new.iter().enumerate() {
        vertices[n as usize] = mesh.vertices()[v];
    }
    let triangles =
        mesh.triangles().iter().rev().map(|&[a, b, c]| [b, c, a].map(|v| new[v as usize])).collect();
    (TriangleMesh::new(vertices, triangles).unwrap(), new)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}
