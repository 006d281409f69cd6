//! Landmark pairs: vertices that are known to correspond (section 5.2, figure 13).
//!
//! The user gives them, or they are chosen on the two skeletons by rule: head, hands and knees of
//! a biped; the end of every chain of any other creature. Each place is then looked up on each
//! surface in the same way, so that the pairs agree.

use glam::DVec3;

use super::RetargetError;
use super::chains::{Biped, Chains};
use crate::mesh::{SurfaceQuery, TriangleMesh};
use crate::rig::Skeleton;

/// A place on a skeleton.
#[derive(Debug, Clone, PartialEq)]
enum Place {
    /// The tail of a bone.
    Tip(u32),
    /// The head of a bone.
    Start(u32),
    /// On the front of the joint at the head of a bone.
    Front { joint: u32, frame: Frame },
}

/// Bones that tell where a biped's front is: up from the hips to the head, left to right between
/// the hands; `flipped` when that product points to the back.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Frame {
    hips: u32,
    head: u32,
    hands: [u32; 2],
    flipped: bool,
}

impl Frame {
    fn forward(&self, skeleton: &Skeleton) -> DVec3 {
        let tail = |bone: u32| skeleton.tails()[bone as usize];
        let up = tail(self.head) - skeleton.heads()[self.hips as usize];
        let forward = up.cross(tail(self.hands[1]) - tail(self.hands[0])).normalize_or_zero();
        if self.flipped { -forward } else { forward }
    }
}

/// Chooses landmark pairs (source vertex, target vertex) on two skeletons whose bones are numbered
/// alike.
///
/// `carries_weight` marks the bones that move skin. Pairs that share a vertex with an earlier one
/// are left out.
///
/// # Errors
/// [`RetargetError::Mesh`] for a mesh without triangles.
pub fn landmarks_from_skeletons(
    (source, source_skeleton): (&TriangleMesh, &Skeleton),
    (target, target_skeleton): (&TriangleMesh, &Skeleton),
    carries_weight: &[bool],
) -> Result<Vec<[u32; 2]>, RetargetError> {
    let places = choose_places(source_skeleton, carries_weight);
    let on_source = find_vertices(&places, source, source_skeleton)
        .map_err(|error| RetargetError::Mesh { side: "source", error })?;
    let on_target = find_vertices(&places, target, target_skeleton)
        .map_err(|error| RetargetError::Mesh { side: "target", error })?;
    let mut pairs: Vec<[u32; 2]> = Vec::new();
    for (s, t) in on_source.into_iter().zip(on_target) {
        if !pairs.iter().any(|pair| pair[0] == s || pair[1] == t) {
            pairs.push([s, t]);
        }
    }
    Ok(pairs)
}

fn choose_places(skeleton: &Skeleton, carries_weight: &[bool]) -> Vec<Place> {
    let chains = Chains::new(skeleton, carries_weight);
    let tips = || {
        let ends = chains.ends.iter().map(|end| Place::Tip(end.tip));
        ends.chain(chains.free_starts.iter().map(|&bone| Place::Start(bone))).collect()
    };
    let Some(biped) = chains.biped() else {
        return tips();
    };
    let (Some(left), Some(right)) = (chains.knee(&biped, 0), chains.knee(&biped, 1)) else {
        return tips();
    };
    let tip = |end: usize| chains.ends[end].tip;
    let frame = front_frame(skeleton, &chains, &biped, left);
    vec![
        Place::Tip(tip(biped.head)),
        Place::Tip(tip(biped.hands[0])),
        Place::Tip(tip(biped.hands[1])),
        Place::Front { joint: left, frame },
        Place::Front { joint: right, frame },
    ]
}

/// The frame of a biped, turned so that its feet point forward.
fn front_frame(skeleton: &Skeleton, chains: &Chains<'_>, biped: &Biped, knee: u32) -> Frame {
    let tip = |end: usize| chains.ends[end].tip;
    let hips = skeleton.parents()[knee as usize].unwrap_or(knee);
    let mut frame = Frame { hips, head: tip(biped.head), hands: biped.hands.map(tip), flipped: false };
    let forward = frame.forward(skeleton);
    let feet: DVec3 = biped
        .feet
        .iter()
        .map(|&foot| {
            let end = &chains.ends[foot];
            let ankle = skeleton.parents()[end.bone as usize].unwrap_or(end.bone);
            skeleton.tails()[end.tip as usize] - skeleton.heads()[ankle as usize]
        })
        .sum();
    frame.flipped = feet.dot(forward) < 0.0;
    frame
}

fn find_vertices(
    places: &[Place],
    mesh: &TriangleMesh,
    skeleton: &Skeleton,
) -> Result<Vec<u32>, crate::mesh::MeshError> {
    let surface = SurfaceQuery::new(mesh)?;
    let vertex_near = |point: DVec3| {
        surface
            .closest_point(point)
            .map_or(0, |closest| nearest_corner(mesh, closest.triangle, closest.position))
    };
    Ok(places
        .iter()
        .map(|place| match place {
            Place::Tip(bone) => vertex_near(skeleton.tails()[*bone as usize]),
            Place::Start(bone) => vertex_near(skeleton.heads()[*bone as usize]),
            Place::Front { joint, frame } => {
                let joint = skeleton.heads()[*joint as usize];
                match surface.cast_ray(joint, frame.forward(skeleton)) {
                    Some(hit) => nearest_corner(mesh, hit.triangle, hit.position),
                    None => vertex_near(joint),
                }
            }
        })
        .collect())
}

/// Corner of a triangle that is nearest to a point on it.
fn nearest_corner(mesh: &TriangleMesh, triangle: u32, point: DVec3) -> u32 {
    let corners = mesh.triangles()[triangle as usize];
    let distance = |v: &u32| mesh.vertices()[*v as usize].distance_squared(point);
    corners.into_iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(corners[0])
}

/// Checks the user's pairs: vertices exist, no pair is repeated (repeats are dropped).
///
/// # Errors
/// [`RetargetError::LandmarkOutOfRange`] naming the pair.
pub fn check_landmarks(
    landmarks: &[[i64; 2]],
    source_count: usize,
    target_count: usize,
) -> Result<Vec<[u32; 2]>, RetargetError> {
    let mut pairs: Vec<[u32; 2]> = Vec::with_capacity(landmarks.len());
    for (landmark, pair) in landmarks.iter().enumerate() {
        for (side, vertex, count) in [("source", pair[0], source_count), ("target", pair[1], target_count)] {
            if !usize::try_from(vertex).is_ok_and(|v| v < count) {
                return Err(RetargetError::LandmarkOutOfRange { landmark, side, vertex, count });
            }
        }
        let pair = pair.map(|v| v as u32);
        if !pairs.contains(&pair) {
            pairs.push(pair);
        }
    }
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::retarget::chains::tests::person;

    /// A box around every bone of the person, as one surface in pieces.
    fn boxes(skeleton: &Skeleton) -> TriangleMesh {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for bone in 0..skeleton.bone_count() {
            let (low, high) = (skeleton.heads()[bone], skeleton.tails()[bone]);
            let (low, high) = (low.min(high) - DVec3::splat(0.03), low.max(high) + DVec3::splat(0.03));
            let first = vertices.len() as u32;
            for corner in 0..8u32 {
                let pick = |bit: u32, a: f64, b: f64| if corner >> bit & 1 == 1 { b } else { a };
                vertices.push(DVec3::new(
                    pick(0, low.x, high.x),
                    pick(1, low.y, high.y),
                    pick(2, low.z, high.z),
                ));
            }
            for quad in [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]] {
                let [a, b, c, d] = quad.map(|v: u32| v + first);
                triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
        TriangleMesh::new(vertices, triangles).unwrap()
    }

    #[test]
    fn a_biped_gets_head_hands_and_the_front_of_its_knees() {
        let (skeleton, weighted) = person(|i| i);
        let mesh = boxes(&skeleton);
        let side = (&mesh, &skeleton);
        let pairs = landmarks_from_skeletons(side, side, &weighted).unwrap();
        assert_eq!(pairs.len(), 5);
        assert!(pairs.iter().all(|[s, t]| s == t));
        let at: Vec<DVec3> = pairs.iter().map(|[s, _]| mesh.vertices()[*s as usize]).collect();
        assert!(at[0].z > 1.8 && at[1].x.abs() > 0.85 && at[2].x.abs() > 0.85);
        // The feet point along -y, so that is the front.
        assert!(at[3].y < 0.0 && at[4].y < 0.0 && at[3].x * at[4].x < 0.0, "{at:?}");
    }

    #[test]
    fn renumbered_bones_give_the_same_places() {
        let (source, weighted) = person(|i| i);
        let (other, _) = person(|i| 25 - i);
        let partners: Vec<Option<u32>> = (0..26).map(|i| Some(25 - i)).collect();
        let target = other.renumbered(&source, &partners);
        let (source_mesh, target_mesh) = (boxes(&source), boxes(&other));
        let pairs =
            landmarks_from_skeletons((&source_mesh, &source), (&target_mesh, &target), &weighted).unwrap();
        assert_eq!(pairs.len(), 5);
        for [s, t] in pairs {
            assert_eq!(source_mesh.vertices()[s as usize], target_mesh.vertices()[t as usize]);
        }
    }

    #[test]
    fn names_the_landmark_out_of_range() {
        let error = check_landmarks(&[[0, 0], [0, 9]], 3, 3).unwrap_err();
        assert!(matches!(
            error,
            RetargetError::LandmarkOutOfRange { landmark: 1, side: "target", vertex: 9, .. }
        ));
        assert_eq!(check_landmarks(&[[1, 2], [1, 2]], 3, 3).unwrap(), [[1, 2]]);
    }
}
