//! Self-collision around one joint: which vertices passed into the other side, and how far they
//! have to go back to the projection plane.

use glam::Vec3;

use super::fold_field::{FieldScale, FoldField, Place, smoothstep};
use super::fold_plane::FoldPlane;

/// A surface vertex that may touch the other side of a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ContactVertex {
    /// For the candidates that push the cage, the index in the island's list of surface points; for
    /// those of the surface, the vertex.
    pub element: u32,
    /// True on the side of the bone below the joint.
    pub below: bool,
    /// Outward normal of the surface in rest.
    pub normal: Vec3,
    /// How far the vertex is beyond the middle of the fold in rest.
    pub rest_overlap: f32,
    /// How far it is shut in, or in a narrow gap, in rest, from 0 to 1.
    pub rest_shut_in: f32,
}

/// Contact candidates around the joint at the head of a bone.
#[derive(Debug, Clone)]
pub(super) struct JointContact {
    pub bone: u32,
    pub parent: u32,
    /// Rest positions of the joint, of a point up the parent and of a point down the bone.
    pub joint: Vec3,
    pub up: Vec3,
    pub down: Vec3,
    pub vertices: Vec<ContactVertex>,
    /// Mean distance between neighbouring candidates.
    pub spacing: f32,
    /// How much farther apart they are than the mesh's vertices.
    pub left_out: f32,
    /// Radius of the limb at the joint.
    pub radius: f32,
}

/// How one candidate has to move along the plane's normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Push {
    /// Place of the candidate in the list that was searched.
    pub listed: u32,
    pub offset: Vec3,
}

/// How far candidates may move before near ones have to be listed anew, in spacings.
const MARGIN: f32 = 3.0;
/// Cosine between a vertex' normal and the way to the other side from which on it is the back of its
/// side, which touches nothing.
const TURNED_AWAY: f32 = 0.5;
/// Gap between the sides, in radii, at which they begin to feel each other.
const FELT: f32 = 0.15;
/// Candidates along a limb's radius from which on its sides have a shape, and have all of it.
const RESOLVED: [f32; 2] = [1.5, 2.0];
/// Slack of the sides' heights, in gaps at which they begin to feel each other.
const SLACK: f32 = 0.7;
/// And in distances between the vertices that a sample leaves out.
const LEFT_OUT_SLACK: f32 = 0.4;
/// Half the gap that is left between the sides, in radii.
pub(super) const THICKNESS: f32 = 0.01;
/// Distance from the other side, in spacings, from which on a candidate in no gap that closes is not looked at
/// again before the next fill.
const FAR: f32 = 2.0;
/// Smaller pushes than this, in spacings, are left out.
const LEAST_PUSH: f32 = 1e-4;

/// How firmly candidates follow the contact each time it is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Firmness {
    /// Share of the way that closes a hollow.
    pub pull: f32,
    /// And of the way that closes the narrow gap of a deep bend.
    pub fill: f32,
    /// Overlap of which half is left, in gaps at which the sides begin to feel each other; 0 leaves none.
    pub softness: f32,
}

impl Firmness {
    /// Of the cage, which is pushed again and again while it is solved.
    pub(super) const CAGE: Self = Self { pull: 0.1, fill: 0.2, softness: 0.3 };
    /// Of the surface in the end.
    pub(super) const SURFACE: Self = Self { pull: 0.25, fill: 0.2, softness: 0.0 };
}

/// Buffers of the contact search.
#[derive(Debug, Clone, Default)]
pub(super) struct ContactScratch {
    places: Vec<Place>,
    field: FoldField,
    /// How far the sides were in contact at the last fill; `None` when they did not feel each other.
    pub level: Option<f32>,
    /// Candidates of the last fill that contact may push until the next one: the others are far from the other
    /// side, or only count for the heights of theirs.
    pub pushable: Vec<u32>,
    /// The result.
    pub pushes: Vec<Push>,
}

impl JointContact {
    /// Where a candidate is relative to the plane and its own side.
    #[inline]
    pub(super) fn place(&self, fold: &FoldPlane, candidate: &ContactVertex, position: Vec3) -> Place {
        Place { facing: self.facing(fold, candidate), ..self.place_facing(fold, candidate, position) }
    }

    /// How far a candidate is turned towards the other side, from 0 to 1.
    fn facing(&self, fold: &FoldPlane, candidate: &ContactVertex) -> f32 {
        let towards = candidate.normal.dot(fold.towards[usize::from(candidate.below)]);
        smoothstep(1.0 + towards / TURNED_AWAY)
    }

    /// Where a candidate is if it is turned towards the other side.
    #[inline]
    fn place_facing(&self, fold: &FoldPlane, candidate: &ContactVertex, position: Vec3) -> Place {
        let offset = position - fold.plane.point;
        let height = offset.dot(fold.plane.normal);
        let across = fold.inwards.cross(fold.plane.normal);
        let beyond = if candidate.below { -height } else { height };
        Place {
            inwards: offset.dot(fold.inwards),
            across: offset.dot(across),
            beyond,
            // All of a limb counts for its side: what turns away comes and goes as it turns.
            height: beyond,
            facing: 1.0,
            below: candidate.below,
        }
    }

    pub(super) fn scale(&self) -> FieldScale {
        let margin = self.radius * FELT;
        let slack = SLACK * margin + LEFT_OUT_SLACK * self.left_out;
        FieldScale { step: self.spacing, margin, slack, radius: self.radius }
    }

    /// How far the sides have a shape: one of a few triangles has none that could touch another.
    fn resolved(&self) -> f32 {
        let [none, all] = RESOLVED;
        smoothstep((self.radius / self.spacing - none) / (all - none))
    }

    /// Lists the candidates that can come into contact as long as none moves by more than
    /// [`MARGIN`]; `positions` are those of all.
    pub(super) fn list_near(&self, fold: &FoldPlane, positions: &[Vec3], near: &mut Vec<u32>) {
        near.clear();
        let scale = self.scale();
        let margin = MARGIN * self.spacing;
        let places = || self.vertices.iter().zip(positions).map(|(v, &p)| self.place(fold, v, p));
        let mut highest = [f32::NEG_INFINITY; 2];
        for place in places().filter(|place| place.inwards > -margin) {
            let side = usize::from(place.below);
            highest[side] = highest[side].max(place.height);
        }
        let closest = highest[0] + highest[1] + scale.margin + 2.0 * margin;
        if closest.is_nan() || closest <= 0.0 || self.resolved() <= 0.0 {
            return;
        }
        let reaches = |place: Place| {
            let other = highest[usize::from(!place.below)];
            let room = scale.margin + scale.radius + 2.0 * margin;
            place.inwards > -margin - scale.step && place.height + other + room > 0.0
        };
        near.extend((0..).zip(places()).filter(|&(_, place)| reaches(place)).map(|(index, _)| index));
    }

    /// Pushes that bring every listed candidate in contact back towards its own side (eq. 13, 14), and
    /// those in a hollow that contact closes off, or in the narrow gap of a deep bend, towards the other
    /// side; `positions` are those of the list.
    ///
    /// Over the plane each side is a height field. Where the two overlap, both go back to the surface
    /// half way between them. All of it varies continuously with the pose.
    pub(super) fn pushes(
        &self,
        fold: &FoldPlane,
        list: &[u32],
        positions: &[Vec3],
        refill: bool,
        firmness: Firmness,
        scratch: &mut ContactScratch,
    ) {
        let ContactScratch { places, field, level, pushable, pushes } = scratch;
        pushes.clear();
        let scale = self.scale();
        if refill {
            places.clear();
            places.extend(list.iter().zip(positions).map(|(&candidate, &position)| {
                self.place(fold, &self.vertices[candidate as usize], position)
            }));
            pushable.clear();
            *level = field.fill(places, &scale, fold.deep);
            if let Some(level) = *level {
                field.close(level * firmness.pull, firmness.fill, scale.radius);
            }
        }
        let &mut Some(level) = level else { return };
        let thickness = THICKNESS * self.radius;
        let all = self.resolved() * fold.strength;
        for (listed, (&candidate, &position)) in list.iter().zip(positions).enumerate() {
            let vertex = &self.vertices[candidate as usize];
            let place = if refill { places[listed] } else { self.place_facing(fold, vertex, position) };
            if place.facing <= 0.0 || place.inwards <= if refill { -self.spacing } else { 0.0 } {
                continue;
            }
            let beyond = place.beyond - field.middle(&place) + thickness;
            let located = field.locate(&place);
            let closes = if refill || beyond <= 0.0 { field.closing(located) } else { 0.0 };
            if refill && (closes > 0.0 || beyond > -FAR * self.spacing) {
                pushable.push(candidate);
            }
            if place.inwards <= 0.0 {
                continue;
            }
            let amount = if beyond > 0.0 {
                let over = field.sunk_at(located, &place, beyond) - vertex.rest_overlap;
                if over <= 0.0 {
                    continue;
                }
                level * over * over / (over + firmness.softness * scale.margin)
            } else {
                if closes <= 0.0 {
                    continue;
                }
                let hidden = (field.envelope(place.below, located) - place.beyond) / (2.0 * scale.step);
                let seen = (1.0 - hidden).clamp(0.0, 1.0);
                closes * beyond * seen * fold.set_in * (1.0 - vertex.rest_shut_in)
            };
            let facing = if refill { place.facing } else { self.facing(fold, vertex) };
            let amount = amount * all * facing * (place.inwards / self.spacing).min(1.0);
            if amount.abs() > LEAST_PUSH * self.spacing {
                let direction = if vertex.below { amount } else { -amount };
                pushes.push(Push { listed: listed as u32, offset: fold.plane.normal * direction });
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use glam::Affine3A;

    /// Two rows of candidates along a limb on x, on its inner side (+y) at radius 0.3.
    pub(in crate::pbd) fn contact() -> (JointContact, Vec<Vec3>) {
        let rest: Vec<Vec3> = (-8..=8).map(|i| Vec3::new(i as f32 * 0.1, 0.3, 0.0)).collect();
        let vertices = rest.iter().zip(0..).map(|(p, element)| ContactVertex {
            element,
            below: p.x > 0.0,
            normal: Vec3::Y,
            rest_overlap: 0.0,
            rest_shut_in: 0.0,
        });
        let contact = JointContact {
            bone: 1,
            parent: 0,
            joint: Vec3::ZERO,
            up: -Vec3::X,
            down: Vec3::X,
            spacing: 0.1,
            left_out: 0.0,
            radius: 0.3,
            vertices: vertices.collect(),
        };
        (contact, rest)
    }

    pub(in crate::pbd) fn bent(angle: f32) -> [Affine3A; 2] {
        [Affine3A::IDENTITY, Affine3A::from_rotation_z(angle)]
    }

    fn rigid(contact: &JointContact, rest: &[Vec3], pose: &[Affine3A; 2]) -> Vec<Vec3> {
        let of = |(v, p): (&ContactVertex, &Vec3)| pose[usize::from(v.below)].transform_point3(*p);
        contact.vertices.iter().zip(rest).map(of).collect()
    }

    fn all(contact: &JointContact) -> Vec<u32> {
        (0..contact.vertices.len() as u32).collect()
    }

    fn pushes(contact: &JointContact, pose: &[Affine3A; 2], positions: &[Vec3]) -> Vec<Push> {
        let Some(fold) = contact.fold_plane(pose) else { return Vec::new() };
        let mut scratch = ContactScratch::default();
        contact.pushes(&fold, &all(contact), positions, true, Firmness::SURFACE, &mut scratch);
        scratch.pushes
    }

    fn beyond(contact: &JointContact, pose: &[Affine3A; 2], positions: &[Vec3]) -> Vec<Place> {
        let fold = contact.fold_plane(pose).unwrap();
        contact.vertices.iter().zip(positions).map(|(v, &p)| contact.place(&fold, v, p)).collect()
    }

    fn pushed(contact: &JointContact, pose: &[Affine3A; 2], positions: &[Vec3]) -> Vec<Vec3> {
        let mut positions = positions.to_vec();
        for push in pushes(contact, pose, &positions) {
            positions[push.listed as usize] += push.offset;
        }
        positions
    }

    #[test]
    fn sides_that_pass_into_each_other_are_parted() {
        let (contact, rest) = contact();
        let pose = bent(1.8);
        let before = rigid(&contact, &rest, &pose);
        assert!(beyond(&contact, &pose, &before).iter().any(|p| p.inwards > 0.1 && p.beyond > 0.05));
        let after = pushed(&contact, &pose, &before);
        let places = beyond(&contact, &pose, &after);
        for (i, a) in places.iter().enumerate().filter(|(_, place)| place.inwards > contact.spacing) {
            for b in places[..i].iter().filter(|b| b.below != a.below) {
                let apart = (a.inwards - b.inwards).abs() > contact.spacing;
                assert!(apart || a.beyond + b.beyond < 0.0, "{a:?} {b:?}");
            }
        }
        assert!(pushes(&contact, &bent(-1.8), &rigid(&contact, &rest, &bent(-1.8))).is_empty());
    }

    #[test]
    fn what_is_far_from_the_other_side_is_not_looked_at_again_and_nothing_is_missed() {
        let (contact, rest) = contact();
        let (pose, everything) = (bent(1.8), all(&contact));
        let fold = contact.fold_plane(&pose).unwrap();
        let positions = rigid(&contact, &rest, &pose);
        let mut scratch = ContactScratch::default();
        contact.pushes(&fold, &everything, &positions, true, Firmness::CAGE, &mut scratch);
        let by_candidate = |list: &[u32], pushes: &[Push]| -> Vec<(u32, Vec3)> {
            pushes.iter().map(|push| (list[push.listed as usize], push.offset)).collect()
        };
        let first = by_candidate(&everything, &scratch.pushes);
        let list = scratch.pushable.clone();
        assert!(first.len() > 2 && first.len() <= list.len() && list.len() < everything.len());
        let places = beyond(&contact, &pose, &positions);
        let left_out = everything.iter().filter(|candidate| !list.contains(candidate));
        let is_far = |&&candidate: &&u32| {
            let place = &places[candidate as usize];
            place.inwards <= -contact.spacing || place.beyond < -FAR * contact.spacing
        };
        assert!(left_out.clone().any(|&candidate| places[candidate as usize].inwards > 0.0));
        assert!(left_out.clone().all(|candidate| is_far(&candidate)));
        let listed: Vec<Vec3> = list.iter().map(|&candidate| positions[candidate as usize]).collect();
        contact.pushes(&fold, &list, &listed, false, Firmness::CAGE, &mut scratch);
        assert_eq!(by_candidate(&list, &scratch.pushes), first);
    }

    #[test]
    fn a_hollow_that_contact_shuts_in_is_closed() {
        let (contact, _) = contact();
        let rows = (-20..20).flat_map(|i| (-4..=4).map(move |j| (i, j)));
        let rest: Vec<Vec3> =
            rows.map(|(i, j)| Vec3::new(0.04 * (i as f32 + 0.5), 0.3, 0.04 * j as f32)).collect();
        let vertices = rest.iter().map(|p| ContactVertex { below: p.x > 0.0, ..contact.vertices[0] });
        let contact = JointContact { spacing: 0.04, vertices: vertices.collect(), ..contact.clone() };
        let pose = bent(1.8);
        let fold = contact.fold_plane(&pose).unwrap();
        let mut positions = pushed(&contact, &pose, &rigid(&contact, &rest, &pose));
        let in_hollow: Vec<bool> =
            beyond(&contact, &pose, &positions).iter().map(|p| (0.22..0.34).contains(&p.inwards)).collect();
        assert!(in_hollow.iter().any(|&inside| inside));
        for ((vertex, position), _) in
            contact.vertices.iter().zip(&mut positions).zip(&in_hollow).filter(|(_, inside)| **inside)
        {
            *position += fold.plane.normal * if vertex.below { 0.03 } else { -0.03 };
        }
        let open = |positions: &[Vec3]| -> f32 {
            let places = beyond(&contact, &pose, positions);
            let hollow = places.iter().zip(&in_hollow).filter(|(_, inside)| **inside);
            hollow.map(|(place, _)| -place.beyond).sum()
        };
        let before = open(&positions);
        let after = open(&pushed(&contact, &pose, &positions));
        assert!(after < 0.9 * before && after > 0.5 * before, "{before} {after}");
    }

    #[test]
    fn candidates_that_are_not_near_are_not_pushed_soon() {
        let (contact, rest) = contact();
        let mut near = vec![7];
        for angle in [0.4, 0.9, 1.4, 1.8] {
            let pose = bent(angle);
            let fold = contact.fold_plane(&pose).unwrap();
            let positions = rigid(&contact, &rest, &pose);
            contact.list_near(&fold, &positions, &mut near);
            // Both sides deeper into each other by almost the margin.
            let sunk = |(v, p): (&ContactVertex, &Vec3)| {
                let depth = 0.99 * MARGIN * contact.spacing;
                *p + fold.plane.normal * if v.below { -depth } else { depth }
            };
            let sunk: Vec<Vec3> = contact.vertices.iter().zip(&positions).map(sunk).collect();
            let listed: Vec<Vec3> = near.iter().map(|&i| sunk[i as usize]).collect();
            let (mut some, mut whole) = (ContactScratch::default(), ContactScratch::default());
            let everything = all(&contact);
            contact.pushes(&fold, &near, &listed, true, Firmness::CAGE, &mut some);
            contact.pushes(&fold, &everything, &sunk, true, Firmness::CAGE, &mut whole);
            let some: Vec<(u32, Vec3)> =
                some.pushes.iter().map(|push| (near[push.listed as usize], push.offset)).collect();
            let whole: Vec<(u32, Vec3)> =
                whole.pushes.iter().map(|push| (push.listed, push.offset)).collect();
            assert_eq!(some, whole);
        }
        let pose = bent(0.3);
        let fold = contact.fold_plane(&pose).unwrap();
        contact.list_near(&fold, &rigid(&contact, &rest, &bent(-2.0)), &mut near);
        assert!(near.len() < contact.vertices.len(), "{near:?}");
    }

    #[test]
    fn what_faces_away_from_the_other_side_touches_nothing() {
        let (mut contact, rest) = contact();
        let pose = bent(1.8);
        let positions = rigid(&contact, &rest, &pose);
        assert!(!pushes(&contact, &pose, &positions).is_empty());
        contact.vertices.iter_mut().for_each(|vertex| vertex.normal = -Vec3::Y);
        assert!(pushes(&contact, &pose, &positions).is_empty());
    }

    #[test]
    fn one_side_alone_may_pass_the_plane() {
        let (contact, rest) = contact();
        let pose = bent(1.8);
        let fold = contact.fold_plane(&pose).unwrap();
        let mut positions = rigid(&contact, &rest, &pose);
        for (vertex, position) in contact.vertices.iter().zip(&mut positions) {
            if vertex.below {
                *position += fold.plane.normal * 5.0;
            }
        }
        assert!(pushes(&contact, &pose, &positions).is_empty());
    }

    #[test]
    fn what_overlaps_in_rest_is_left_alone() {
        let (mut contact, rest) = contact();
        let folded = bent(1.8);
        let positions = rigid(&contact, &rest, &folded);
        // The folded state as rest: the same bones, not turned, over the same points.
        contact.up = folded[0].transform_point3(contact.up);
        contact.down = folded[1].transform_point3(contact.down);
        for vertex in contact.vertices.iter_mut().filter(|vertex| vertex.below) {
            vertex.normal = folded[1].transform_vector3(vertex.normal);
        }
        contact.keep_rest(&positions);
        assert!(contact.vertices.iter().any(|vertex| vertex.rest_overlap > 0.1));
        let nearly = [Affine3A::IDENTITY, Affine3A::from_rotation_z(1e-3)];
        let pushes = pushes(&contact, &nearly, &positions);
        assert!(pushes.iter().all(|push| push.offset.length() < 1e-2), "{pushes:?}");
    }
}
