//! Self-collision around one joint: which vertices passed into the other side, and how far they
//! have to go back to the projection plane.

use glam::{Affine3A, Vec3};

use super::self_collision::ProjectionPlane;

/// Bones closer than this to one line have no inner side: nothing can fold there. As |a + b| of
/// the unit directions of both bones; 0.1 is a bend of 6°.
const STRAIGHT: f32 = 0.1;
/// From here on, 23°, contact counts in full.
const BENT: f32 = 0.4;

/// A surface vertex that may touch the other side of a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ContactVertex {
    /// Index in the island's list of surface points.
    pub point: u32,
    /// True on the side of the bone below the joint.
    pub below: bool,
    /// Where the seam between both sides meets this direction around the joint in rest, along the
    /// plane's normal.
    pub seam: f32,
    /// How far the vertex is on the wrong side of the seam in rest.
    pub rest_violation: f32,
    /// How far it overlaps with the other side in rest.
    pub rest_overlap: f32,
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
/// Joints that are turned by less than this cannot bring anything into contact.
const UNMOVED: f32 = 1e-4;

/// Where a candidate is over the projection plane.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    /// Along the inner direction of the bend, from the joint.
    inwards: f32,
    /// Across the bend.
    across: f32,
    /// Height over the plane, towards the other side.
    beyond: f32,
}

/// Buffers of the contact search.
#[derive(Debug, Clone, Default)]
pub(super) struct ContactScratch {
    /// Places of the listed candidates, and whether they are below the joint.
    places: Vec<(Place, bool)>,
    sides: [Vec<Place>; 2],
    /// The result.
    pub pushes: Vec<Push>,
}

/// The projection plane of a joint in a pose, with the direction of the fold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FoldPlane {
    pub plane: ProjectionPlane,
    pub inwards: Vec3,
    /// 0 for straight joints, 1 from a moderate bend on, so that contact sets in gently.
    pub strength: f32,
    /// Cosine of half the angle by which the joint is bent.
    pub half_cosine: f32,
    /// How far the joint bends rather than twists, from 0 to 1, and 0 for straight joints: sin² of half
    /// the bend over sin² of half the turn, times the strength.
    pub bend_share: f32,
}

impl JointContact {
    /// The plane through the joint, perpendicular to the plane of its two bones, half way between
    /// them; `None` where they are in line or have not turned since rest.
    pub(super) fn fold_plane(&self, transforms: &[Affine3A]) -> Option<FoldPlane> {
        let (below, above) = (&transforms[self.bone as usize], &transforms[self.parent as usize]);
        if below.abs_diff_eq(*above, UNMOVED) { None } else { self.plane_between(below, above) }
    }

    fn plane_between(&self, below: &Affine3A, above: &Affine3A) -> Option<FoldPlane> {
        let joint = below.transform_point3(self.joint).midpoint(above.transform_point3(self.joint));
        let up = (above.transform_point3(self.up) - joint).try_normalize()?;
        let down = (below.transform_point3(self.down) - joint).try_normalize()?;
        let normal = (down - up).try_normalize()?;
        let inwards = up + down;
        let length = inwards.length();
        let strength = ((length - STRAIGHT) / (BENT - STRAIGHT)).min(1.0);
        (length > STRAIGHT).then(|| FoldPlane {
            plane: ProjectionPlane { point: joint, normal },
            inwards: inwards / length,
            strength,
            half_cosine: (down - up).length() * 0.5,
            bend_share: strength * self.bend_share(below, above),
        })
    }

    /// Share of the turn since rest that is not about the bone itself.
    fn bend_share(&self, below: &Affine3A, above: &Affine3A) -> f32 {
        let (_, turn, _) = (above.inverse() * *below).to_scale_rotation_translation();
        let down = (self.down - self.joint).normalize_or_zero();
        let bend = down.distance_squared(turn * down) * 0.25;
        let whole = turn.xyz().length_squared();
        if whole > f32::MIN_POSITIVE { (bend / whole).min(1.0) } else { 0.0 }
    }

    /// Where a candidate is relative to the plane and its own side.
    fn place(&self, fold: &FoldPlane, candidate: &ContactVertex, position: Vec3) -> Place {
        let offset = position - fold.plane.point;
        let beyond = offset.dot(fold.plane.normal) - candidate.seam * fold.half_cosine;
        let beyond = if candidate.below { -beyond } else { beyond };
        let across = fold.inwards.cross(fold.plane.normal);
        let inwards = offset.dot(fold.inwards);
        Place { inwards, across: offset.dot(across), beyond: beyond - candidate.rest_violation }
    }

    /// All candidates, as a list to search.
    pub(super) fn all(&self) -> Vec<u32> {
        (0..self.vertices.len() as u32).collect()
    }

    /// Lists the candidates that can come into contact as long as none moves by more than
    /// [`MARGIN`]; `positions` are those of all.
    pub(super) fn list_near(&self, fold: &FoldPlane, positions: &[Vec3], near: &mut Vec<u32>) {
        near.clear();
        let margin = MARGIN * self.spacing;
        let places = || self.vertices.iter().zip(positions).map(|(v, &p)| (self.place(fold, v, p), v.below));
        let mut highest = [f32::NEG_INFINITY; 2];
        for (place, below) in places().filter(|(place, _)| place.inwards > -margin) {
            highest[usize::from(below)] = highest[usize::from(below)].max(place.beyond);
        }
        let reaches = |(place, below): (Place, bool)| {
            let other = highest[usize::from(!below)];
            place.inwards > -margin && place.beyond + other + self.spacing + 2.0 * margin > 0.0
        };
        near.extend((0..).zip(places()).filter(|&(_, place)| reaches(place)).map(|(index, _)| index));
    }

    /// Pushes that bring every listed candidate in contact back towards the plane (eq. 13, 14);
    /// `positions` are those of the list.
    ///
    /// A candidate beyond the plane is in contact as far as the other side reaches there: over the
    /// plane, each side is a height field, the upper envelope of cones of slope 1 on its
    /// candidates, and where both heights sum to more than 0 they overlap. This varies continuously
    /// with the pose. A push never exceeds the overlap, nor the way to the plane.
    pub(super) fn pushes(
        &self,
        fold: &FoldPlane,
        list: &[u32],
        positions: &[Vec3],
        scratch: &mut ContactScratch,
    ) {
        let ContactScratch { places, sides, pushes } = scratch;
        pushes.clear();
        places.clear();
        let vertices = list.iter().map(|&candidate| &self.vertices[candidate as usize]);
        places.extend(vertices.zip(positions).map(|(v, &p)| (self.place(fold, v, p), v.below)));
        // Highest reach of each side beyond the plane, on the inner side of the bend.
        let mut highest = [f32::NEG_INFINITY; 2];
        for &(place, below) in places.iter().filter(|(place, _)| place.inwards > 0.0) {
            highest[usize::from(below)] = highest[usize::from(below)].max(place.beyond);
        }
        let room = self.spacing - highest[0].max(0.0) - highest[1].max(0.0);
        if highest[0] + highest[1] + self.spacing <= 0.0 {
            return;
        }
        sides.iter_mut().for_each(Vec::clear);
        for &(place, below) in places.iter() {
            // Lower places cannot overlap with anything.
            if place.inwards > 0.0 && place.beyond >= room - 2.0 * self.spacing {
                sides[usize::from(below)].push(place);
            }
        }
        sides.iter_mut().for_each(|side| side.sort_unstable_by(highest_first));
        for (listed, &(place, below)) in (0..).zip(places.iter()) {
            if place.inwards <= 0.0 || place.beyond <= 0.0 {
                continue;
            }
            let rest_overlap = self.vertices[list[listed as usize] as usize].rest_overlap;
            let overlap = place.beyond + self.height(&sides[usize::from(!below)], place);
            let overlap = (overlap - rest_overlap).max(0.0);
            // Sets in with slope 0. What it leaves is less than the spacing that `height` adds.
            let gentle = overlap * overlap / (overlap + self.spacing);
            let amount = place.beyond.min(gentle);
            let amount = amount * fold.strength * (place.inwards / self.spacing).min(1.0);
            if amount > 0.0 {
                let direction = if below { amount } else { -amount };
                pushes.push(Push { listed, offset: fold.plane.normal * direction });
            }
        }
    }

    /// Height of a side, the highest places first, over a point of the plane.
    fn height(&self, side: &[Place], at: Place) -> f32 {
        let mut highest = f32::NEG_INFINITY;
        for place in side {
            if place.beyond <= highest {
                break;
            }
            let distance = ((place.inwards - at.inwards).powi(2) + (place.across - at.across).powi(2)).sqrt();
            highest = highest.max(place.beyond - distance);
        }
        // Between samples the cones are too low by as much as half their distance.
        highest + self.spacing
    }

    /// Overlap of each candidate with the other side in rest.
    pub(super) fn rest_overlaps(&self, positions: &[Vec3]) -> Vec<f32> {
        let Some(fold) = self.plane_between(&Affine3A::IDENTITY, &Affine3A::IDENTITY) else {
            return vec![0.0; positions.len()];
        };
        let places: Vec<Place> =
            self.vertices.iter().zip(positions).map(|(v, &p)| self.place(&fold, v, p)).collect();
        let side = |below: bool| -> Vec<Place> {
            let members =
                self.vertices.iter().zip(&places).filter(|(v, p)| v.below == below && p.inwards > 0.0);
            let mut side: Vec<Place> = members.map(|(_, place)| *place).collect();
            side.sort_unstable_by(highest_first);
            side
        };
        let sides = [side(false), side(true)];
        let overlap = |(v, place): (&ContactVertex, &Place)| {
            (place.beyond + self.height(&sides[usize::from(!v.below)], *place)).max(0.0)
        };
        self.vertices.iter().zip(&places).map(overlap).collect()
    }
}

fn highest_first(a: &Place, b: &Place) -> std::cmp::Ordering {
    b.beyond.total_cmp(&a.beyond)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two rows of candidates along a limb on x, on its inner side (+y) at radius 0.3.
    fn contact() -> (JointContact, Vec<Vec3>) {
        let rest: Vec<Vec3> = (-8..=8).map(|i| Vec3::new(i as f32 * 0.1, 0.3, 0.0)).collect();
        let vertices = rest.iter().zip(0..).map(|(p, point)| ContactVertex {
            point,
            below: p.x > 0.0,
            seam: 0.0,
            rest_violation: 0.0,
            rest_overlap: 0.0,
        });
        let contact = JointContact {
            bone: 1,
            parent: 0,
            joint: Vec3::ZERO,
            up: -Vec3::X,
            down: Vec3::X,
            spacing: 0.1,
            vertices: vertices.collect(),
        };
        (contact, rest)
    }

    fn bent(angle: f32) -> [Affine3A; 2] {
        [Affine3A::IDENTITY, Affine3A::from_rotation_z(angle)]
    }

    fn rigid(contact: &JointContact, rest: &[Vec3], pose: &[Affine3A; 2]) -> Vec<Vec3> {
        let of = |(v, p): (&ContactVertex, &Vec3)| pose[usize::from(v.below)].transform_point3(*p);
        contact.vertices.iter().zip(rest).map(of).collect()
    }

    #[test]
    fn the_fold_plane_halves_the_bend() {
        let (contact, _) = contact();
        let fold = contact.fold_plane(&bent(1.0)).unwrap();
        let half = Vec3::new(0.5f32.cos(), 0.5f32.sin(), 0.0);
        assert!(fold.plane.normal.distance(half) < 1e-6);
        assert!(fold.inwards.distance(Vec3::new(-half.y, half.x, 0.0)) < 1e-6);
        assert!((fold.half_cosine - 0.5f32.cos()).abs() < 1e-6);
        assert!((fold.bend_share - 1.0).abs() < 1e-5);
        assert!(contact.fold_plane(&bent(0.0)).is_none(), "straight");
        assert!(contact.fold_plane(&[Affine3A::from_rotation_z(1.0); 2]).is_none(), "turned as a whole");
    }

    #[test]
    fn a_twist_of_a_bent_joint_is_no_bend() {
        let (mut contact, _) = contact();
        contact.up = Vec3::new(-1.0, 1.0, 0.0);
        let twisted = contact.fold_plane(&[Affine3A::IDENTITY, Affine3A::from_rotation_x(1.0)]).unwrap();
        assert!(twisted.bend_share < 1e-5);
        let both = Affine3A::from_rotation_z(0.5) * Affine3A::from_rotation_x(0.5);
        let both = contact.fold_plane(&[Affine3A::IDENTITY, both]).unwrap();
        assert!((0.4..0.6).contains(&both.bend_share), "{}", both.bend_share);
    }

    #[test]
    fn sides_that_pass_into_each_other_are_pushed_apart_and_no_farther_than_the_plane() {
        let (contact, rest) = contact();
        let pose = bent(1.8);
        let fold = contact.fold_plane(&pose).unwrap();
        let positions = rigid(&contact, &rest, &pose);
        let mut scratch = ContactScratch::default();
        contact.pushes(&fold, &contact.all(), &positions, &mut scratch);
        assert!(scratch.pushes.len() > 3);
        for push in &scratch.pushes {
            let vertex = &contact.vertices[push.listed as usize];
            let beyond = |p: Vec3| {
                let height = (p - fold.plane.point).dot(fold.plane.normal);
                if vertex.below { -height } else { height }
            };
            let before = positions[push.listed as usize];
            assert!(beyond(before) > 0.0);
            let after = beyond(before + push.offset);
            assert!((-1e-6..beyond(before)).contains(&after), "{after}");
        }
        contact.pushes(&fold, &contact.all(), &rigid(&contact, &rest, &bent(-1.8)), &mut scratch);
        assert!(scratch.pushes.is_empty(), "bent the other way");
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
            let (mut some, mut all) = (ContactScratch::default(), ContactScratch::default());
            contact.pushes(&fold, &near, &listed, &mut some);
            contact.pushes(&fold, &contact.all(), &sunk, &mut all);
            let some: Vec<(u32, Vec3)> =
                some.pushes.iter().map(|push| (near[push.listed as usize], push.offset)).collect();
            let all: Vec<(u32, Vec3)> = all.pushes.iter().map(|push| (push.listed, push.offset)).collect();
            assert_eq!(some, all);
        }
        let pose = bent(0.3);
        let fold = contact.fold_plane(&pose).unwrap();
        contact.list_near(&fold, &rigid(&contact, &rest, &bent(-2.0)), &mut near);
        assert!(near.len() < contact.vertices.len(), "{near:?}");
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
        let mut scratch = ContactScratch::default();
        contact.pushes(&fold, &contact.all(), &positions, &mut scratch);
        assert!(scratch.pushes.is_empty());
    }

    #[test]
    fn what_overlaps_in_rest_is_left_alone() {
        let (mut contact, rest) = contact();
        let folded = bent(1.8);
        let positions = rigid(&contact, &rest, &folded);
        // The folded state as rest: the same bones, not turned, over the same points.
        contact.up = folded[0].transform_point3(contact.up);
        contact.down = folded[1].transform_point3(contact.down);
        let overlaps = contact.rest_overlaps(&positions);
        assert!(overlaps.iter().any(|overlap| *overlap > 0.1));
        for (vertex, overlap) in contact.vertices.iter_mut().zip(overlaps) {
            vertex.rest_overlap = overlap;
        }
        let nearly = [Affine3A::IDENTITY, Affine3A::from_rotation_z(1e-3)];
        let fold = contact.fold_plane(&nearly).unwrap();
        let mut scratch = ContactScratch::default();
        contact.pushes(&fold, &contact.all(), &positions, &mut scratch);
        assert!(scratch.pushes.iter().all(|push| push.offset.length() < 1e-2), "{:?}", scratch.pushes);
    }
}
