//! The last word on contact: surface vertices that are still in the other side of their joint are
//! projected (eq. 14) and relaxed (eq. 15).

use glam::{Affine3A, Vec3};

use super::contact::{ContactScratch, JointContact};
use super::island::Island;
use super::self_collision::{mean_value_coordinates, relax};
use crate::mesh::TriangleMesh;

/// Rounds of projection and relaxation.
const ROUNDS: usize = 2;

/// One-rings of an island's contact candidates, with mean value coordinates from the rest pose.
#[derive(Debug, Clone, Default)]
pub(super) struct SurfaceContacts {
    /// For each joint contact, the rings of its candidates.
    rings: Vec<Vec<Vec<(u32, f32)>>>,
}

impl SurfaceContacts {
    pub(super) fn new(mesh: &TriangleMesh, island: &Island) -> Self {
        let normals = mesh.vertex_normals();
        let mut next_around = vec![Vec::new(); mesh.vertex_count()];
        let mut wanted = vec![false; mesh.vertex_count()];
        for contact in &island.contacts {
            for vertex in &contact.vertices {
                wanted[island.surface[vertex.point as usize].vertex as usize] = true;
            }
        }
        for &[a, b, c] in mesh.triangles() {
            for (v, from, to) in [(a, b, c), (b, c, a), (c, a, b)] {
                if wanted[v as usize] {
                    next_around[v as usize].push((from, to));
                }
            }
        }
        let position = |v: u32| mesh.vertices()[v as usize];
        let ring_of = |vertex: u32| {
            let centre = position(vertex);
            // Relative to the vertex, so that f32 is enough anywhere in space.
            let offset = |v: u32| (position(v) - centre).as_vec3();
            let ring = ordered_ring(&next_around[vertex as usize])?;
            let spokes: Vec<Vec3> = ring.iter().map(|&v| offset(v)).collect();
            let phi = mean_value_coordinates(Vec3::ZERO, &spokes, normals[vertex as usize].as_vec3())?;
            // A coordinate far outside of 0 to 1 comes from a ring that is folded already.
            phi.iter().all(|phi| (-0.5..=1.5).contains(phi)).then(|| ring.into_iter().zip(phi).collect())
        };
        let rings_of = |contact: &JointContact| {
            let vertices = contact.vertices.iter().map(|v| island.surface[v.point as usize].vertex);
            vertices.map(|vertex| ring_of(vertex).unwrap_or_default()).collect()
        };
        Self { rings: island.contacts.iter().map(rings_of).collect() }
    }

    /// Separates the sides of every bent joint of an island with its `contacts`. `local` are the
    /// transforms relative to the island's `frame`; `positions` the whole surface.
    pub(super) fn separate(
        &self,
        contacts: &[JointContact],
        island: &Island,
        frame: &Affine3A,
        local: &[Affine3A],
        positions: &mut [Vec3],
    ) {
        let inverse = frame.inverse();
        let mut candidates: Vec<Vec3> = Vec::new();
        let mut found = ContactScratch::default();
        for (contact, rings) in contacts.iter().zip(&self.rings) {
            let Some(fold) = contact.fold_plane(local) else { continue };
            let all = contact.all();
            let vertex_of =
                |candidate: usize| island.surface[contact.vertices[candidate].point as usize].vertex as usize;
            for round in 0..ROUNDS {
                candidates.clear();
                let own =
                    (0..contact.vertices.len()).map(|c| inverse.transform_point3(positions[vertex_of(c)]));
                candidates.extend(own);
                contact.pushes(&fold, &all, &candidates, &mut found);
                for push in &found.pushes {
                    positions[vertex_of(push.listed as usize)] += frame.transform_vector3(push.offset);
                }
                if round + 1 == ROUNDS {
                    break;
                }
                for push in &found.pushes {
                    let ring = &rings[push.listed as usize];
                    if !ring.is_empty() {
                        let vertex = vertex_of(push.listed as usize);
                        let neighbours = ring.iter().map(|&(n, phi)| (phi, positions[n as usize]));
                        // Relaxation sets in with the push, so that nothing jumps at first touch.
                        let share = (push.offset.length() / contact.spacing).min(1.0);
                        positions[vertex] =
                            positions[vertex].lerp(relax(positions[vertex], neighbours), share);
                    }
                }
            }
        }
    }
}

/// The closed ring of neighbours in order; `None` at a boundary or a non-manifold vertex.
fn ordered_ring(next: &[(u32, u32)]) -> Option<Vec<u32>> {
    let first = next.first()?.0;
    let mut ring = vec![first];
    let mut current = first;
    loop {
        let mut followers = next.iter().filter(|step| step.0 == current);
        let (_, follower) = *followers.next()?;
        if followers.next().is_some() {
            return None;
        }
        if follower == first {
            break;
        }
        if ring.len() >= next.len() {
            return None;
        }
        ring.push(follower);
        current = follower;
    }
    (ring.len() == next.len() && ring.len() >= 3).then_some(ring)
}
