//! The last word on contact: surface vertices that are still in the other side of their joint are
//! projected (eq. 14) and relaxed (eq. 15).

use std::borrow::Cow;

use glam::{Affine3A, Vec3};
use rayon::prelude::*;

use super::contact::{ContactScratch, Firmness, JointContact, Push};
use super::fold_plane::FoldPlane;
use super::island::Island;
use super::self_collision::{mean_value_coordinates, relax};
use crate::mesh::TriangleMesh;

/// Rounds of projection; the first is followed by relaxation.
const ROUNDS: usize = 3;

/// One-rings of an island's contact candidates, with mean value coordinates from the rest pose.
#[derive(Debug, Clone, Default)]
pub(super) struct SurfaceContacts {
    /// For each joint contact.
    rings: Vec<Rings>,
}

/// The rings of a joint's candidates, one after the other; empty for those that have none.
#[derive(Debug, Clone, Default)]
struct Rings {
    ends: Vec<u32>,
    neighbours: Vec<(u32, f32)>,
}

impl Rings {
    fn push(&mut self, ring: impl IntoIterator<Item = (u32, f32)>) {
        self.neighbours.extend(ring);
        self.ends.push(self.neighbours.len() as u32);
    }

    fn of(&self, candidate: u32) -> &[(u32, f32)] {
        let start = candidate.checked_sub(1).map_or(0, |before| self.ends[before as usize]);
        &self.neighbours[start as usize..self.ends[candidate as usize] as usize]
    }
}

impl SurfaceContacts {
    pub(super) fn new(mesh: &TriangleMesh, island: &Island) -> Self {
        let normals = mesh.vertex_normals();
        let mut next_around = vec![Vec::new(); mesh.vertex_count()];
        let mut wanted = vec![false; mesh.vertex_count()];
        for contact in &island.contacts {
            for vertex in &contact.vertices {
                wanted[vertex.element as usize] = true;
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
            phi.iter().all(|phi| (-0.5..=1.5).contains(phi)).then(|| ring.into_iter().zip(phi))
        };
        let rings_of = |contact: &JointContact| {
            let mut rings = Rings::default();
            contact.vertices.iter().for_each(|v| rings.push(ring_of(v.element).into_iter().flatten()));
            rings
        };
        Self { rings: island.contacts.iter().map(rings_of).collect() }
    }
}

/// An island in a pose, whose joints' sides are to be separated.
pub(super) struct PosedIsland<'a> {
    pub contacts: Cow<'a, [JointContact]>,
    pub surface: &'a SurfaceContacts,
    pub frame: &'a Affine3A,
    /// Transforms (B) relative to the frame.
    pub local: &'a [Affine3A],
}

/// Separates the sides of every bent joint of all islands; `positions` are the whole surface.
pub(super) fn separate(islands: &[PosedIsland<'_>], positions: &mut [Vec3], buffers: &mut SeparationBuffers) {
    let joints: Vec<Joint<'_>> = islands.iter().flat_map(joints_of).collect();
    let SeparationBuffers { searches, pushed, touched } = buffers;
    touched.clear();
    searches.resize_with(joints.len(), JointSearch::default);
    pushed.resize(positions.len(), false);
    for round in 0..ROUNDS {
        // What all joints would push as the surface is now.
        searches.par_iter_mut().zip(&joints).with_max_len(1).for_each(|(search, joint)| {
            if round == 0 {
                search.begin(joint, positions);
            }
            search.find(joint, positions, round);
        });
        // One joint after the other, so that what several of them press upon ends between all: what one
        // before it has pushed, a joint looks at again.
        for (joint, search) in joints.iter().zip(searches.iter_mut()) {
            search.look_again(joint, positions, pushed);
            let JointSearch { near, found, .. } = search;
            if found.pushes.is_empty() {
                near.clear();
                continue;
            }
            if round == 0 {
                touched.extend(found.pushable.iter().map(|&candidate| joint.vertex(candidate) as u32));
            }
            for push in &found.pushes {
                let vertex = joint.vertex(near[push.listed as usize]);
                positions[vertex] += joint.frame.transform_vector3(push.offset);
                pushed[vertex] = true;
            }
            if round > 0 {
                continue;
            }
            for push in &found.pushes {
                let candidate = near[push.listed as usize];
                let ring = joint.rings.of(candidate);
                if !ring.is_empty() {
                    let vertex = joint.vertex(candidate);
                    let neighbours = ring.iter().map(|&(n, phi)| (phi, positions[n as usize]));
                    // Relaxation sets in with the push, so that nothing jumps at first touch.
                    let share = (push.offset.length() / joint.contact.spacing).min(1.0);
                    positions[vertex] = positions[vertex].lerp(relax(positions[vertex], neighbours), share);
                }
            }
        }
        for (joint, search) in joints.iter().zip(searches.iter()) {
            for push in &search.found.pushes {
                pushed[joint.vertex(search.near[push.listed as usize])] = false;
            }
        }
    }
}

/// A joint in a pose.
struct Joint<'a> {
    contact: &'a JointContact,
    rings: &'a Rings,
    local: &'a [Affine3A],
    frame: &'a Affine3A,
    inverse: Affine3A,
}

fn joints_of<'a>(island: &'a PosedIsland<'_>) -> impl Iterator<Item = Joint<'a>> {
    let PosedIsland { contacts, surface, frame, local } = island;
    let inverse = frame.inverse();
    let joints = contacts.iter().zip(&surface.rings);
    joints.map(move |(contact, rings)| Joint { contact, rings, local, frame, inverse })
}

impl Joint<'_> {
    fn vertex(&self, candidate: u32) -> usize {
        self.contact.vertices[candidate as usize].element as usize
    }
}

/// Buffers of [`separate`].
#[derive(Debug, Clone, Default)]
pub(super) struct SeparationBuffers {
    searches: Vec<JointSearch>,
    /// Vertices (V) that this round has pushed; false everywhere between rounds.
    pushed: Vec<bool>,
    /// Vertices near the other side of a joint whose sides are in contact; of several joints more than once.
    pub touched: Vec<u32>,
}

/// The search for what one joint has to push.
#[derive(Debug, Clone, Default)]
struct JointSearch {
    fold: Option<FoldPlane>,
    near: Vec<u32>,
    candidates: Vec<Vec3>,
    found: ContactScratch,
    /// What is looked at again: places in `near`, candidates, and the pushes that stay.
    again: (Vec<u32>, Vec<u32>, Vec<Push>),
}

impl JointSearch {
    /// Lists the candidates that can come into contact in a pose.
    fn begin(&mut self, joint: &Joint<'_>, positions: &[Vec3]) {
        let Joint { contact, local, inverse, .. } = joint;
        self.fold = contact.fold_plane(local);
        self.near.clear();
        if let Some(fold) = &self.fold {
            self.candidates.clear();
            let vertices = contact.vertices.iter().map(|vertex| positions[vertex.element as usize]);
            self.candidates.extend(vertices.map(|position| inverse.transform_point3(position)));
            contact.list_near(fold, &self.candidates, &mut self.near);
        }
    }

    /// Finds the pushes of those that are listed; after the first round, of those that can be pushed.
    fn find(&mut self, joint: &Joint<'_>, positions: &[Vec3], round: usize) {
        let Self { fold, near, candidates, found, .. } = self;
        found.pushes.clear();
        if let (Some(fold), false) = (fold, near.is_empty()) {
            let refill = round == 0;
            if round == 1 {
                near.clone_from(&found.pushable);
            }
            if refill {
                // Those that are listed, in their order, of all.
                (0..)
                    .zip(&*near)
                    .for_each(|(place, &candidate)| candidates[place] = candidates[candidate as usize]);
                candidates.truncate(near.len());
            } else {
                candidates.clear();
                let position = |&candidate: &u32| positions[joint.vertex(candidate)];
                candidates.extend(near.iter().map(position).map(|p| joint.inverse.transform_point3(p)));
            }
            joint.contact.pushes(fold, near, candidates, refill, Firmness::SURFACE, found);
        }
    }

    /// Finds the pushes of those anew that another joint has `pushed`.
    fn look_again(&mut self, joint: &Joint<'_>, positions: &[Vec3], pushed: &[bool]) {
        let Self { fold: Some(fold), near, candidates, found, again: (places, list, kept) } = self else {
            return;
        };
        let is_pushed = |candidate: u32| pushed[joint.vertex(candidate)];
        places.clear();
        places.extend((0..).zip(&*near).filter(|&(_, &candidate)| is_pushed(candidate)).map(|(i, _)| i));
        if places.is_empty() {
            return;
        }
        list.clear();
        list.extend(places.iter().map(|&place| near[place as usize]));
        candidates.clear();
        let position = |&candidate: &u32| positions[joint.vertex(candidate)];
        candidates.extend(list.iter().map(position).map(|p| joint.inverse.transform_point3(p)));
        kept.clear();
        kept.extend(found.pushes.iter().filter(|push| !is_pushed(near[push.listed as usize])));
        joint.contact.pushes(fold, list, candidates, false, Firmness::SURFACE, found);
        let in_near = |push: &Push| Push { listed: places[push.listed as usize], ..*push };
        kept.extend(found.pushes.iter().map(in_near));
        kept.sort_unstable_by_key(|push| push.listed);
        std::mem::swap(kept, &mut found.pushes);
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

#[cfg(test)]
mod tests {
    use super::super::contact::ContactVertex;
    use super::super::contact::tests::{bent, contact};
    use super::*;

    #[test]
    fn what_was_pushed_is_looked_at_again_and_nothing_else() {
        let (contact, rest) = contact();
        let pose = bent(1.8);
        let side = |below: bool| pose[usize::from(below)];
        let of = |(vertex, p): (&ContactVertex, &Vec3)| side(vertex.below).transform_point3(*p);
        let mut positions: Vec<Vec3> = contact.vertices.iter().zip(&rest).map(of).collect();
        let frame = Affine3A::IDENTITY;
        let rings = Rings::default();
        let joint = Joint { contact: &contact, rings: &rings, local: &pose, frame: &frame, inverse: frame };
        let mut search = JointSearch::default();
        search.begin(&joint, &positions);
        search.find(&joint, &positions, 0);
        let first = search.found.pushes.clone();
        assert!(first.len() > 2);
        let mut pushed = vec![false; positions.len()];
        search.look_again(&joint, &positions, &pushed);
        assert_eq!(search.found.pushes, first, "none was pushed");
        let most = |a: &&Push, b: &&Push| a.offset.length().total_cmp(&b.offset.length());
        let deepest = *first.iter().max_by(most).unwrap();
        let one = joint.vertex(search.near[deepest.listed as usize]);
        positions[one] += deepest.offset;
        pushed[one] = true;
        search.look_again(&joint, &positions, &pushed);
        let again = &search.found.pushes;
        let left = again.iter().find(|push| push.listed == deepest.listed);
        assert!(left.is_none_or(|left| left.offset.length() < 0.1 * deepest.offset.length()));
        let others = |pushes: &[Push]| -> Vec<Push> {
            pushes.iter().filter(|push| push.listed != deepest.listed).copied().collect()
        };
        assert_eq!(others(again), others(&first));
        assert!(again.windows(2).all(|pair| pair[0].listed < pair[1].listed));
    }
}
