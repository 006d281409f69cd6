//! What is carried along: fingers, toes, ears, face, controls. Each follows the bone that it hangs on
//! as one stiff piece, turned and scaled with it, and is drawn inside where it sticks out a little.

use glam::{DQuat, DVec3};

use super::distance_field::DistanceField;
use super::joints::Joints;
use super::reduced_skeleton::ReducedSkeleton;
use super::template::Similarity;
use crate::rig::Skeleton;

/// A bone's direction is taken over at least this share of the template's diameter.
const BASELINE: f64 = 0.04;
/// A bone's scale differs from the body's by at most this factor.
const MOST_STRETCH: f64 = 1.3;
/// Joints outside by at most this share of the template's diameter are drawn inside.
const DRAW: f64 = 0.025;

/// Joints nearer than this share of the template's diameter are in one place, whatever bones they
/// belong to: a rig's controls stand where the bones are that they move.
const COINCIDENT: f64 = 1e-4;

/// A turn and a scale about a point that goes to another.
#[derive(Debug, Clone, Copy)]
struct Motion {
    turn: DQuat,
    scale: f64,
    from: DVec3,
    to: DVec3,
}

impl Motion {
    fn apply(&self, point: DVec3) -> DVec3 {
        self.to + self.turn * (point - self.from) * self.scale
    }
}

/// Everything that carrying needs.
pub(super) struct Carrier<'a> {
    pub(super) template: &'a Skeleton,
    pub(super) joints: &'a Joints,
    pub(super) reduced: &'a ReducedSkeleton,
    pub(super) field: &'a DistanceField,
    pub(super) scale: f64,
    /// Where bones go that hang on nothing.
    pub(super) whole: Similarity,
}

impl Carrier<'_> {
    /// Places of all joints (J) from those that were found or are fixed.
    pub(super) fn run(&self, known: &[Option<DVec3>]) -> Vec<DVec3> {
        let points = &self.joints.points;
        let known = self.with_coincident(known);
        let mut places = known.clone();
        let mut motions: Vec<Option<Motion>> = vec![None; self.template.bone_count()];
        let whole =
            Motion { turn: DQuat::IDENTITY, scale: self.whole.scale, from: DVec3::ZERO, to: self.whole.step };
        let draw = DRAW * self.reduced.diameter * self.scale;
        for &bone in self.template.depth_order() {
            let bone = bone as usize;
            let (head, tail) = (self.joints.heads[bone], self.joints.tails[bone]);
            let parent = self.template.parents()[bone].and_then(|p| motions[p as usize]);
            let carried = parent.unwrap_or(whole);
            for joint in [head, tail] {
                if places[joint].is_none() {
                    let place = carried.apply(points[joint]);
                    places[joint] = Some(match self.reduced.body_bones[bone] && parent.is_some() {
                        true => self.drawn_inside(place, draw),
                        false => place,
                    });
                }
            }
            motions[bone] = self.motion(bone, &known, &carried).or(parent);
        }
        places.iter().zip(points).map(|(place, &point)| place.unwrap_or_else(|| whole.apply(point))).collect()
    }

    /// Known places (J), those of joints that coincide with a known one included.
    fn with_coincident(&self, known: &[Option<DVec3>]) -> Vec<Option<DVec3>> {
        let points = &self.joints.points;
        let near = COINCIDENT * self.reduced.diameter;
        let place = |joint: usize| {
            known[joint].or_else(|| {
                let mut others = (0..known.len()).filter(|&other| known[other].is_some());
                others
                    .find(|&other| points[other].distance(points[joint]) <= near)
                    .and_then(|other| known[other])
            })
        };
        (0..known.len()).map(place).collect()
    }

    /// Motion of a bone whose ends were found: its head's, turned the least from its parent's turn.
    fn motion(&self, bone: usize, known: &[Option<DVec3>], parent: &Motion) -> Option<Motion> {
        let points = &self.joints.points;
        let (head, tail) = (self.joints.heads[bone], self.joints.tails[bone]);
        let (to, _) = (known[head]?, known[tail]?);
        let end = self.far_end(head, tail, known);
        let (before, after) = (points[end] - points[head], known[end]? - to);
        let turn = match ((parent.turn * before).try_normalize(), after.try_normalize()) {
            (Some(from), Some(to)) => (DQuat::from_rotation_arc(from, to) * parent.turn).normalize(),
            _ => parent.turn,
        };
        let stretch = after.length() / before.length().max(f64::MIN_POSITIVE);
        let scale = stretch.clamp(self.scale / MOST_STRETCH, self.scale * MOST_STRETCH);
        Some(Motion { turn, scale, from: points[head], to })
    }

    /// The joint on from a bone's tail that is far enough from its head to show a direction.
    fn far_end(&self, head: usize, tail: usize, known: &[Option<DVec3>]) -> usize {
        let points = &self.joints.points;
        let (mut before, mut end) = (head, tail);
        while points[end].distance(points[head]) < BASELINE * self.reduced.diameter {
            let mut onwards = self.reduced.links[end].iter().filter(|&&j| j != before && known[j].is_some());
            let (Some(&next), None) = (onwards.next(), onwards.next()) else { break };
            (before, end) = (end, next);
        }
        end
    }

    fn drawn_inside(&self, place: DVec3, most: f64) -> DVec3 {
        let inside = self.field.pulled_inside(place, 0.0);
        if inside.distance(place) <= most { inside } else { place }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::fit::reduced_skeleton::without_ground_roots;
    use crate::rig::fit::test_bodies::{bone, field, skeleton, tubes};

    #[test]
    fn a_thumb_turns_with_its_hand_and_the_root_stays_below() {
        let template = skeleton();
        let joints = Joints::new(&template);
        let body = without_ground_roots(&template, &vec![true; template.bone_count()]);
        let reduced = ReducedSkeleton::new(&template, &joints, body, None).unwrap();
        let field = field(&tubes(&[(DVec3::Z * 50.0, DVec3::Z * 51.0, 0.1)]));
        // Everything turned by a right angle about y, and doubled.
        let turned = |p: DVec3| DVec3::new(p.z, p.y, -p.x) * 2.0;
        let known: Vec<Option<DVec3>> =
            (0..joints.points.len()).map(|j| reduced.holds(j).then(|| turned(joints.points[j]))).collect();
        let whole = Similarity { scale: 2.0, step: DVec3::ZERO };
        let carrier = Carrier {
            template: &template,
            joints: &joints,
            reduced: &reduced,
            field: &field,
            scale: 2.0,
            whole,
        };
        let places = carrier.run(&known);
        let thumb = joints.tails[bone(&template, "thumb_l")];
        assert!(!reduced.holds(thumb));
        assert!(places[thumb].distance(turned(joints.points[thumb])) < 1e-9, "{}", places[thumb]);
        assert_eq!(places[joints.heads[bone(&template, "root")]], DVec3::ZERO);
    }
}
