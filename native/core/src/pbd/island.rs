//! An island: the cage tetrahedra of one joint area, or of several that touch, with all that its
//! constraints need. Islands share no free particle, so they are solved apart.

use glam::{Affine3A, DVec3, Mat3A, Vec3};
use wide::f32x4;

use super::active::Neighbours;
use super::contact::JointContact;
use super::domains::Domain;
use super::joint_blend::JointBlends;
use super::lanes::Particle;
use super::parts::is_still;
use crate::cage::TetMesh;
use crate::skinning::SkinWeights;

/// A particle's anchor on its nearest bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bind {
    pub particle: u32,
    pub bone: u32,
    /// Rest position of the anchor.
    pub anchor: Vec3,
    pub rest_length: f32,
}

/// Particles and constraints of one island, in rest space. Among the particles are some without mass that
/// no constraint and no bone knows: idle lanes name them.
#[derive(Debug, Clone)]
pub(super) struct Island {
    /// Rest positions (P).
    pub rest: Vec<Vec3>,
    /// Weights of the particles (P rows, columns are the skeleton's bones).
    pub weights: SkinWeights,
    /// Inverse masses (P): 1 free, 0 held, between them where the island ends.
    pub inverse_masses: Vec<f32>,
    /// Edges with a free end.
    pub edges: Vec<[u32; 2]>,
    /// Tetrahedra, every one with a free corner.
    pub tetrahedra: Vec<[u32; 4]>,
    pub neighbours: Neighbours,
    /// Rest volume, the same for all of them.
    pub rest_volume: f32,
    /// Constraints, by the parts of the island that they are in.
    pub domains: Vec<Domain>,
    /// Contact candidates that push the cage, joint by joint.
    pub cage_contacts: Vec<JointContact>,
    /// The surface points of these candidates, in their order.
    pub cage_points: Vec<Vec<SurfacePoint>>,
    /// What blends between the bones of those joints.
    pub blends: JointBlends,
    /// Contact candidates of the surface, joint by joint.
    pub contacts: Vec<JointContact>,
    /// Surface vertices that follow the island, `local` in the order of this list.
    pub surface: Vec<SurfacePoint>,
    /// Bones with weight on a particle and the sums of their weights, the heaviest first.
    pub bones: Vec<(u32, f64)>,
    /// Bones that have weight on a surface vertex alone.
    pub surface_bones: Vec<u32>,
    /// Largest distance in the island; the scale of its coordinates.
    pub extent: f32,
}

/// A surface vertex embedded in an island.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SurfacePoint {
    pub vertex: u32,
    pub corners: [u32; 4],
    pub barycentric: [f32; 4],
    /// Share of the island in the vertex's position; the rest is plain skinning.
    pub share: f32,
}

impl SurfacePoint {
    /// Where the point is, on particles in a pose.
    #[inline]
    pub(super) fn position(&self, particles: &[Particle]) -> Vec3 {
        let weighted = |k: usize| particles[self.corners[k] as usize] * f32x4::splat(self.barycentric[k]);
        position(weighted(0) + weighted(1) + weighted(2) + weighted(3))
    }
}

impl Island {
    /// Number of constraints of each kind: stretch, volume, bind, energy, self-collision.
    pub(super) fn constraint_counts(&self) -> [usize; 5] {
        let contacts = self.contacts.iter().map(|c| c.vertices.len()).sum();
        let binds = self.domains.iter().map(|domain| domain.binds.len()).sum();
        [self.edges.len(), self.tetrahedra.len(), binds, self.tetrahedra.len(), contacts]
    }

    /// The frame that moves with the heaviest part of the island: rotation, uniform scale,
    /// translation. `None` where that part is flattened. In this frame the island is solved, so that
    /// it neither notices where the character stands nor how large it is scaled.
    pub(super) fn frame(&self, transforms: &[Affine3A]) -> Option<Affine3A> {
        let reference = &transforms[heaviest_part(&self.bones, transforms, self.extent)? as usize];
        let m = &reference.matrix3;
        let determinant = m.determinant();
        let scale = determinant.abs().cbrt();
        let x = m.x_axis.try_normalize()?;
        let y = (m.y_axis - x * m.y_axis.dot(x)).try_normalize()?;
        let z = x.cross(y) * determinant.signum();
        let matrix3 = Mat3A::from_cols(x * scale, y * scale, z * scale);
        let frame = Affine3A { matrix3, translation: reference.translation };
        (scale > f32::MIN_POSITIVE && frame.inverse().is_finite()).then_some(frame)
    }

    /// The tetrahedra in rest.
    pub(super) fn cage(&self) -> TetMesh {
        let is_massless = |place: usize| {
            let mut ends = self.domains.iter().filter(|domain| !domain.has_halves());
            ends.any(|domain| domain.particles.end == place + 1)
        };
        let (mut vertices, mut index_of) = (Vec::new(), Vec::with_capacity(self.rest.len()));
        for (place, rest) in self.rest.iter().enumerate() {
            index_of.push(vertices.len() as u32);
            if !is_massless(place) {
                vertices.push(rest.as_dvec3());
            }
        }
        let tetrahedra = self.tetrahedra.iter().map(|t| t.map(|place| index_of[place as usize]));
        TetMesh::new(vertices, tetrahedra.collect())
    }

    /// Bones whose transforms the solution depends on, some more than once.
    pub(super) fn dependencies(&self) -> impl Iterator<Item = usize> + '_ {
        let joints = self.cage_contacts.iter().flat_map(|contact| [contact.bone, contact.parent]);
        let bones = self.bones.iter().map(|&(bone, _)| bone).chain(self.surface_bones.iter().copied());
        bones.chain(joints).map(|bone| bone as usize)
    }

    /// True where no bone has moved relative to the frame, up to rounding.
    pub(super) fn is_at_rest(&self, local: &[Affine3A]) -> bool {
        self.bones.iter().all(|&(bone, _)| is_still(&local[bone as usize], self.extent))
    }
}

/// A bone of the heaviest part that moves as one: when a wrist turns, that is the hand with all its
/// fingers, so that less has moved relative to it than relative to the forearm. `bones` come with
/// the sums of their weights, the heaviest first.
fn heaviest_part(bones: &[(u32, f64)], transforms: &[Affine3A], extent: f32) -> Option<u32> {
    // Bones that stand for those that move with them, inverse transforms, sums of weights.
    let mut parts: Vec<(u32, Affine3A, f64)> = Vec::new();
    for &(bone, weight) in bones {
        let transform = transforms[bone as usize];
        match parts.iter_mut().find(|(_, inverse, _)| is_still(&(*inverse * transform), extent)) {
            Some((_, _, sum)) => *sum += weight,
            None => parts.push((bone, transform.inverse(), weight)),
        }
    }
    let heavier = |a: (u32, f64), b: (u32, f64)| if b.1 > a.1 { b } else { a };
    parts.into_iter().map(|(bone, _, sum)| (bone, sum)).reduce(heavier).map(|(bone, _)| bone)
}

/// Position of a particle.
#[inline]
pub(super) fn position(particle: Particle) -> Vec3 {
    let [x, y, z, _] = particle.to_array();
    Vec3::new(x, y, z)
}

/// Distances of four points from their barycentre.
pub(super) fn spring_lengths(corners: [DVec3; 4]) -> [f32; 4] {
    let centre = corners.iter().sum::<DVec3>() * 0.25;
    corners.map(|corner| corner.distance(centre) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_moves_together_weighs_together() {
        let bones = [(2, 5.0), (0, 3.0), (3, 2.5), (1, 1.0)];
        let turned = Affine3A::from_rotation_z(0.5);
        let part = |transforms: [Affine3A; 4]| heaviest_part(&bones, &transforms, 1.0);
        let still = Affine3A::IDENTITY;
        assert_eq!(part([still; 4]), Some(2));
        assert_eq!(part([still, turned, turned, turned]), Some(2));
        assert_eq!(part([still, still, turned, still]), Some(0), "6.5 against 5");
        let flat = Affine3A::from_scale(Vec3::ZERO);
        assert_eq!(part([flat, flat, still, flat]), Some(2), "what is flat moves with nothing");
        assert_eq!(heaviest_part(&[], &[], 1.0), None);
    }
}
