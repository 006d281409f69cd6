//! Laplacian smoothing of the correction in joint areas (eq. 16).
//!
//! The paper smooths positions, which wears off detail and moves the rest pose. Here the
//! difference between the solved and the plainly skinned surface is smoothed: where nothing was
//! corrected, nothing changes, and wrinkles of the mesh survive.

use glam::Vec3;

use crate::mesh::Adjacency;

/// One pass of eq. 16, `d_i ← (1 − k) d_i + k · mean of the one-ring`, on the given vertices; all
/// others stay. `buffer` is overwritten.
pub fn smooth_correction(
    correction: &mut [Vec3],
    vertices: &[u32],
    adjacency: &Adjacency,
    k: f32,
    buffer: &mut Vec<Vec3>,
) {
    buffer.clear();
    buffer.extend(vertices.iter().map(|&vertex| {
        let own = correction[vertex as usize];
        let ring = adjacency.neighbours(vertex as usize);
        if ring.is_empty() {
            return own;
        }
        let sum: Vec3 = ring.iter().map(|&n| correction[n as usize]).sum();
        own.lerp(sum / ring.len() as f32, k)
    }));
    for (&vertex, &smoothed) in vertices.iter().zip(buffer.iter()) {
        correction[vertex as usize] = smoothed;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriangleMesh;
    use glam::DVec3;

    #[test]
    fn follows_equation_16_and_leaves_the_others() {
        let vertices = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE];
        let mesh = TriangleMesh::new(vertices, vec![[0, 1, 2]]).unwrap();
        let adjacency = Adjacency::new(4, &mesh.topology());
        let before = [Vec3::X, Vec3::ZERO, Vec3::Z * 4.0, Vec3::ONE];
        let mut correction = before;
        let mut buffer = Vec::new();
        smooth_correction(&mut correction, &[0, 1, 3], &adjacency, 0.25, &mut buffer);
        assert_eq!(correction[0], Vec3::X * 0.75 + Vec3::Z * 2.0 * 0.25);
        assert_eq!(correction[1], (Vec3::X + Vec3::Z * 4.0) * 0.125);
        assert_eq!(correction[2..], before[2..], "not asked for; no neighbours");
        let mut nothing = [Vec3::ZERO; 4];
        smooth_correction(&mut nothing, &[0, 1, 2], &adjacency, 1.0, &mut buffer);
        assert_eq!(nothing, [Vec3::ZERO; 4]);
    }
}
