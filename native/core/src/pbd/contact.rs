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
    pub candidate: u32,
    pub offset: Vec3,
}

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
    places: Vec<Place>,
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
}

impl JointContact {
    /// The plane through the joint, perpendicular to the plane of its two bones, half way between
    /// them; `None` where they are in line.
    pub(super) fn fold_plane(&self, transforms: &[Affine3A]) -> Option<FoldPlane> {
        let (below, above) = (&transforms[self.bone as usize], &transforms[self.parent as usize]);
        if below.abs_diff_eq(*above, UNMOVED) {
            return None;
        }
        let joint = below.transform_point3(self.joint).midpoint(above.transform_point3(self.joint));
        let up = (above.transform_point3(self.up) - joint).try_normalize()?;
        let down = (below.transform_point3(self.down) - joint).try_normalize()?;
        let normal = (down - up).try_normalize()?;
        let inwards = up + down;
        let length = inwards.length();
        (length > STRAIGHT).then(|| FoldPlane {
            plane: ProjectionPlane { point: joint, normal },
            inwards: inwards / length,
            strength: ((length - STRAIGHT) / (BENT - STRAIGHT)).min(1.0),
            half_cosine: (down - up).length() * 0.5,
        })
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

    /// Pushes that bring every candidate in contact back towards the plane (eq. 13, 14).
    ///
    /// A candidate beyond the plane is in contact as far as the other side reaches there: over the
    /// plane, each side is a height field, the upper envelope of cones of slope 1 on its
    /// candidates, and where both heights sum to more than 0 they overlap. This varies continuously
    /// with the pose. A push never exceeds the overlap, nor the way to the plane.
    pub(super) fn pushes(&self, fold: &FoldPlane, positions: &[Vec3], scratch: &mut ContactScratch) {
        let ContactScratch { places, sides, pushes } = scratch;
        pushes.clear();
        places.clear();
        let placed = self.vertices.iter().zip(positions).map(|(v, &p)| self.place(fold, v, p));
        places.extend(placed);
        // Highest reach of each side beyond the plane, on the inner side of the bend.
        let mut highest = [f32::NEG_INFINITY; 2];
        for (vertex, place) in self.vertices.iter().zip(places.iter()) {
            if place.inwards > 0.0 {
                let side = &mut highest[usize::from(vertex.below)];
                *side = side.max(place.beyond);
            }
        }
        let room = self.spacing - highest[0].max(0.0) - highest[1].max(0.0);
        if highest[0] + highest[1] + self.spacing <= 0.0 {
            return;
        }
        sides.iter_mut().for_each(Vec::clear);
        for (vertex, place) in self.vertices.iter().zip(places.iter()) {
            // Lower places cannot overlap with anything.
            if place.inwards > 0.0 && place.beyond >= room - 2.0 * self.spacing {
                sides[usize::from(vertex.below)].push(*place);
            }
        }
        sides.iter_mut().for_each(|side| side.sort_unstable_by(highest_first));
        for (index, (vertex, place)) in self.vertices.iter().zip(places.iter()).enumerate() {
            if place.inwards <= 0.0 || place.beyond <= 0.0 {
                continue;
            }
            let others = &sides[usize::from(!vertex.below)];
            let overlap = place.beyond + self.height(others, *place);
            let overlap = (overlap - vertex.rest_overlap).max(0.0);
            // Sets in with slope 0. What it leaves is less than the spacing that `height` adds.
            let gentle = overlap * overlap / (overlap + self.spacing);
            let amount = place.beyond.min(gentle);
            let amount = amount * fold.strength * (place.inwards / self.spacing).min(1.0);
            if amount > 0.0 {
                let direction = if vertex.below { amount } else { -amount };
                pushes.push(Push { candidate: index as u32, offset: fold.plane.normal * direction });
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
        let still = vec![Affine3A::IDENTITY; 1 + self.bone.max(self.parent) as usize];
        let Some(fold) = self.fold_plane(&still) else {
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
