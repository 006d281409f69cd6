//! Contact between two limbs that are not neighbours (eq. 12-14): over the plane between them both are
//! height fields, and what passed into the other goes back to where they part.

use std::collections::HashMap;

use glam::{Affine3A, Mat3A, Vec3};

use super::contact::THICKNESS;
use super::fold_field::{FieldScale, FoldField, Place, smoothstep};
use super::limb_parts::{Bounds, LimbPart, turn_of};
use super::limb_plane::{Facet, LimbPlane, limb_plane};

/// What a limb's vertex keeps from the rest pose, in its contact with another limb.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RestTouch {
    pub vertex: u32,
    /// How far it takes part, from 0 where the limbs meet in rest to 1 away from there.
    pub share: f32,
    /// How far it is sunk into the other limb, in rest lengths.
    pub overlap: f32,
}

/// What two limbs keep from the rest pose: those vertices that are near the other limb there, ascending.
pub(super) type PairTouch = [Vec<RestTouch>; 2];

/// The shift of a vertex that parts two limbs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LimbPush {
    pub vertex: u32,
    /// Of the pair's two limbs, the vertex' own.
    pub side: usize,
    pub offset: Vec3,
    /// How far it is sunk, in rest lengths.
    pub overlap: f32,
}

/// A vertex, its place and direction, and its overlap in rest.
type NearVertex = (u32, Facet, f32);

/// Buffers of a pair.
#[derive(Debug, Clone, Default)]
pub(super) struct PairScratch {
    /// Places in the limbs' samples.
    listed: [Vec<u32>; 2],
    samples: [Vec<Facet>; 2],
    near: [Vec<NearVertex>; 2],
    /// Places over the plane, those of the near vertices first.
    places: Vec<Place>,
    /// For each vertex of a limb, which of its near ones it is.
    near_of: [Vec<u32>; 2],
    field: FoldField,
    /// The result.
    pub pushes: Vec<LimbPush>,
}

/// How near limbs feel each other: in radii of the thinner one, and in distances between samples.
const REACH: [f32; 2] = [0.5, 1.5];
/// How deep, in radii of the thinner one, limbs may be in each other: so deep they are parted in full, and so
/// deep not at all, because skin alone cannot part limbs that pass right through each other. So far apart that the
/// push fades no faster than twice as the limbs move, and done before the normals that tell their direction turn.
const DEEP: [f32; 2] = [0.6, 1.45];
/// Gap at which limbs feel each other's height fields, and slack of these, in radii of the thinner one.
const MARGIN: f32 = 0.15;
const SLACK: f32 = 0.1;
/// Way along the surface from the other limb in rest, in radii of the thinner one, from which on a vertex takes
/// part in full.
pub(super) const SEAM: f32 = 0.75;
/// Radii of the thinner limb, in distances between vertices, from which on limbs have a shape, and have all of it.
const RESOLVED: [f32; 2] = [0.3, 0.6];
/// Largest step of the height fields, in radii of the thinner limb, and most cuts of a triangle's sides for it.
const STEP: f32 = 0.4;
const MOST_CUTS: f32 = 4.0;
/// Radii of the thinner limb, in distances between a limb's own vertices, from which on that limb can be dented,
/// and can be in full.
const DENTED: [f32; 2] = [0.6, 1.2];
/// Smaller pushes than this, in distances between vertices, are left out.
const LEAST_PUSH: f32 = 1e-4;

/// Where two limbs meet.
#[derive(Debug, Clone, Copy)]
pub(super) struct Meeting {
    plane: LimbPlane,
    /// What of the limbs' samples is near the other limb.
    near: [Bounds; 2],
}

/// Two limbs in a pose.
pub(super) struct LimbPair<'a> {
    pub parts: [&'a LimbPart; 2],
    pub transforms: [&'a Affine3A; 2],
    /// What rest says about them.
    pub touch: &'a PairTouch,
}

/// No word of rest.
pub(super) const UNTOUCHED: PairTouch = [Vec::new(), Vec::new()];

impl LimbPair<'_> {
    /// Radius of the thinner limb.
    fn radius(&self) -> f32 {
        self.parts[0].radius.min(self.parts[1].radius)
    }

    /// So far around a limb the other one matters.
    pub(super) fn reach(parts: [&LimbPart; 2]) -> f32 {
        let samples = parts[0].sample_spacing.max(parts[1].sample_spacing);
        REACH[0] * parts[0].radius.min(parts[1].radius) + REACH[1] * samples
    }

    /// How the limbs meet; `None` where nothing of them is near. `bounds` hold the limbs' `positions`.
    pub(super) fn meet(
        &self,
        bounds: [&Bounds; 2],
        positions: &[Vec3],
        scratch: &mut PairScratch,
    ) -> Option<Meeting> {
        let turns = self.turns()?;
        let scale = turns[0].1;
        let reach = scale * Self::reach(self.parts);
        let mut near = bounds.map(|bounds| *bounds);
        let place = |side: usize, sample: u32| {
            let part = self.parts[side];
            positions[part.vertices[part.sample[sample as usize] as usize] as usize]
        };
        // What is left on one side says what of the other side can be near.
        for (round, side) in [0, 1, 0, 1].into_iter().enumerate() {
            let around = near[1 - side].grown(reach);
            let listed = &mut scratch.listed[side];
            if round < 2 {
                listed.clear();
                listed.extend(0..self.parts[side].sample.len() as u32);
            }
            listed.retain(|&sample| around.holds(place(side, sample)));
            near[side] = Bounds::of(listed.iter().map(|&sample| place(side, sample)));
            if listed.is_empty() {
                return None;
            }
        }
        for side in 0..2 {
            let part = self.parts[side];
            let taking_part = scratch.listed[side].iter().filter_map(|&sample| {
                let place = part.sample[sample as usize] as usize;
                let (share, _) = self.rest_of(side, part.vertices[place]);
                (share > 0.0).then(|| self.facet(side, place, share, &turns, positions))
            });
            scratch.samples[side].clear();
            scratch.samples[side].extend(taking_part);
        }
        let [first, second] = &scratch.samples;
        let mut plane = limb_plane(first, second, reach, DEEP[1] * scale * self.radius())?;
        let thin = self.radius() / self.parts[0].spacing.max(self.parts[1].spacing);
        plane.strength *= smoothstep((thin - RESOLVED[0]) / (RESOLVED[1] - RESOLVED[0]));
        (plane.strength > 0.0).then_some(Meeting { plane, near })
    }

    /// Pushes that part the limbs at a plane, left in `scratch`. The first ones take from how deep the limbs are
    /// in each other how far the plane counts, and leave it in its strength.
    pub(super) fn part(
        &self,
        meeting: &mut Meeting,
        is_first: bool,
        positions: &[Vec3],
        scratch: &mut PairScratch,
    ) {
        scratch.pushes.clear();
        let Some(turns) = self.turns() else { return };
        let Meeting { plane, near } = meeting;
        let scale = turns[0].1;
        let reach = scale * Self::reach(self.parts).max(self.radius());
        for side in 0..2 {
            let around = near[1 - side].grown(reach);
            let part = self.parts[side];
            let (near, near_of) = (&mut scratch.near[side], &mut scratch.near_of[side]);
            near.clear();
            near_of.clear();
            for (place, &vertex) in part.vertices.iter().enumerate() {
                let is_near = around.holds(positions[vertex as usize]);
                near_of.push(if is_near { near.len() as u32 } else { u32::MAX });
                if is_near {
                    let (share, overlap) = self.rest_of(side, vertex);
                    near.push((vertex, self.facet(side, place, share, &turns, positions), overlap));
                }
            }
        }
        let PairScratch { near, near_of, places, field, pushes, .. } = scratch;
        let radius = scale * self.radius();
        self.place(plane, near, radius, places);
        // Apart along the normal, they are not in each other.
        let highest = [false, true].map(|below| {
            let side = places.iter().filter(|place| place.below == below);
            side.map(|place| place.height).fold(f32::NEG_INFINITY, f32::max)
        });
        if highest[0] + highest[1] <= 0.0 {
            return;
        }
        let spacing = scale * self.parts[0].spacing.max(self.parts[1].spacing);
        let step = spacing.min(STEP * radius);
        for side in 0..2 {
            let coarse = scale * self.parts[side].spacing / step;
            let least = -highest[1 - side] - (1.0 + MARGIN) * radius;
            let first = if side == 0 { 0 } else { near[0].len() };
            self.fill_triangles(side, coarse, least, first, &near_of[side], places);
        }
        let field_scale = FieldScale { step, margin: MARGIN * radius, slack: SLACK * radius, radius };
        let deepest = field.fill_open(places, &field_scale, self.share()) / radius;
        if deepest <= 0.0 {
            return;
        }
        if is_first {
            let [full, none] = DEEP;
            plane.strength *= smoothstep((none - deepest) / (none - full));
        }
        let listed = near.iter().enumerate().flat_map(|(side, near)| near.iter().map(move |n| (side, n)));
        for ((side, (vertex, _, rest_overlap)), place) in listed.zip(places.iter()) {
            let beyond = place.beyond - field.middle(place) + THICKNESS * radius;
            if beyond <= 0.0 {
                continue;
            }
            let overlap = field.sunk(&Place { beyond: place.height, ..*place }, beyond);
            let amount = (overlap - scale * rest_overlap) * plane.strength * place.facing;
            if amount > LEAST_PUSH * spacing {
                let back = if side == 0 { -amount } else { amount };
                let overlap = overlap / scale;
                pushes.push(LimbPush { vertex: *vertex, side, offset: plane.normal * back, overlap });
            }
        }
    }

    /// How much of an overlap the first limb goes back by: the thicker one more, as far as it has vertices enough
    /// for a dent of the thinner one's size.
    fn share(&self) -> f32 {
        let give = self.parts.map(|part| {
            let fine = self.radius() / part.spacing;
            part.radius * smoothstep((fine - DENTED[0]) / (DENTED[1] - DENTED[0]))
        });
        if give[0] + give[1] > 0.0 { give[0] / (give[0] + give[1]) } else { 0.5 }
    }

    /// Adds places inside of a limb's triangles that are larger than a step of the field by so many times, where
    /// they are higher than `least` and face the other limb; the limb's near vertices begin at `first`.
    fn fill_triangles(
        &self,
        side: usize,
        coarse: f32,
        least: f32,
        first: usize,
        near_of: &[u32],
        places: &mut Vec<Place>,
    ) {
        let cuts = coarse.ceil().min(MOST_CUTS) as usize;
        if cuts < 2 {
            return;
        }
        for triangle in &self.parts[side].triangles {
            let corners = triangle.map(|place| near_of[place as usize]);
            if corners.contains(&u32::MAX) {
                continue;
            }
            let corners = corners.map(|near| places[first + near as usize]);
            if corners.iter().all(|place| place.height <= least || place.facing <= 0.0) {
                continue;
            }
            let [a, b, c] = corners;
            for (i, j) in (0..=cuts).flat_map(|i| (0..=cuts - i).map(move |j| (i, j))) {
                let k = cuts - i - j;
                if i.max(j).max(k) == cuts {
                    continue;
                }
                let [u, v, w] = [i, j, k].map(|n| n as f32 / cuts as f32);
                let mix = |of: fn(&Place) -> f32| u * of(&a) + v * of(&b) + w * of(&c);
                places.push(Place {
                    inwards: mix(|p| p.inwards),
                    across: mix(|p| p.across),
                    beyond: mix(|p| p.beyond),
                    height: mix(|p| p.height),
                    facing: mix(|p| p.facing),
                    below: side == 1,
                });
            }
        }
    }

    fn turns(&self) -> Option<[(Mat3A, f32); 2]> {
        Some([turn_of(self.transforms[0])?, turn_of(self.transforms[1])?])
    }

    fn facet(
        &self,
        side: usize,
        place: usize,
        share: f32,
        turns: &[(Mat3A, f32); 2],
        positions: &[Vec3],
    ) -> Facet {
        let part = self.parts[side];
        let normal = (turns[side].0 * part.normals[place]).normalize_or_zero();
        Facet { position: positions[part.vertices[place] as usize], normal, share }
    }

    /// Where vertices are over the plane.
    fn place(&self, plane: &LimbPlane, near: &[Vec<NearVertex>; 2], radius: f32, places: &mut Vec<Place>) {
        let along = self.along(plane);
        let across = along.cross(plane.normal);
        places.clear();
        for (side, near) in near.iter().enumerate() {
            let towards = if side == 0 { plane.normal } else { -plane.normal };
            places.extend(near.iter().map(|(_, facet, _)| {
                let offset = facet.position - plane.point;
                let facing = smoothstep(1.0 + 2.0 * facet.normal.dot(towards));
                let beyond = offset.dot(towards);
                Place {
                    inwards: offset.dot(along),
                    across: offset.dot(across),
                    beyond,
                    height: beyond - (1.0 - facing) * 2.0 * radius,
                    facing: facing * facet.share,
                    below: side == 1,
                }
            }));
        }
    }

    /// The first bone's axis in the plane, along which the height fields' grid lies.
    fn along(&self, plane: &LimbPlane) -> Vec3 {
        let axis = self.transforms[0].transform_vector3(self.parts[0].axis).normalize_or_zero();
        let along = axis - plane.normal * axis.dot(plane.normal);
        along.try_normalize().unwrap_or_else(|| plane.normal.any_orthonormal_vector())
    }

    /// How far a vertex takes part, and its overlap in rest.
    fn rest_of(&self, side: usize, vertex: u32) -> (f32, f32) {
        let touch = &self.touch[side];
        match touch.binary_search_by_key(&vertex, |touch| touch.vertex) {
            Ok(place) => (touch[place].share, touch[place].overlap),
            Err(_) => (1.0, 0.0),
        }
    }
}

/// What two limbs keep from a rest shape: the shares that `touch` says, and overlaps in the shape's `positions`.
pub(super) fn overlaps_at_rest(
    parts: [&LimbPart; 2],
    mut touch: PairTouch,
    bounds: [&Bounds; 2],
    positions: &[Vec3],
    scratch: &mut PairScratch,
) -> PairTouch {
    touch.iter_mut().flatten().for_each(|touch| touch.overlap = 0.0);
    let identity = Affine3A::IDENTITY;
    let pair = LimbPair { parts, transforms: [&identity; 2], touch: &touch };
    let Some(mut meeting) = pair.meet(bounds, positions, scratch) else { return touch };
    pair.part(&mut meeting, true, positions, scratch);
    for push in &scratch.pushes {
        let touch = &mut touch[push.side];
        match touch.binary_search_by_key(&push.vertex, |touch| touch.vertex) {
            Ok(place) => touch[place].overlap = push.overlap,
            Err(place) => {
                touch.insert(place, RestTouch { vertex: push.vertex, share: 1.0, overlap: push.overlap });
            }
        }
    }
    touch
}

/// Shares of the vertices that are near the other limb along the surface in rest, where `distances` give the
/// way from each limb to what is around it: limbs that grow into each other do not touch there.
pub(super) fn seam_shares(parts: [&LimbPart; 2], distances: [&HashMap<u32, f32>; 2]) -> PairTouch {
    let width = SEAM * parts[0].radius.min(parts[1].radius);
    [0, 1].map(|side| {
        let near = parts[side].vertices.iter().filter_map(|&vertex| {
            let share = smoothstep(*distances[1 - side].get(&vertex)? / width);
            (share < 1.0).then_some(RestTouch { vertex, share, overlap: 0.0 })
        });
        near.collect()
    })
}
