//! What of an island blends between the two bones of a joint: where no such joint bends, it starts without regard
//! to joints.

use super::contact::JointContact;
use crate::skinning::SkinWeights;

/// What blends between the bones of an island's joints.
#[derive(Debug, Clone, Default)]
pub(super) struct JointBlends {
    /// For each joint the particles that are not held and follow both bones, each with the product of its two
    /// weights.
    particles: Vec<Vec<(u32, f32)>>,
    /// Tetrahedra with such a corner, and the bits of the joints.
    tetrahedra: Vec<(u32, u64)>,
    /// For each particle (P) the sum of the products of any two of its weights.
    pub all: Vec<f32>,
}

impl JointBlends {
    pub(super) fn new(
        joints: &[JointContact],
        weights: &SkinWeights,
        inverse_masses: &[f32],
        tetrahedra: &[[u32; 4]],
    ) -> Self {
        let blend = |joint: &JointContact| {
            let both = |particle: u32| {
                let weight = |bone: u32| weights.entries(particle as usize).find(|entry| entry.0 == bone);
                let product = weight(joint.bone)?.1 * weight(joint.parent)?.1;
                (inverse_masses[particle as usize] > 0.0 && product > 0.0).then_some((particle, product))
            };
            (0..inverse_masses.len() as u32).filter_map(both).collect()
        };
        let particles: Vec<Vec<(u32, f32)>> = joints.iter().map(blend).collect();
        let mut joints_of = vec![0u64; inverse_masses.len()];
        for (joint, particles) in particles.iter().enumerate() {
            particles.iter().for_each(|&(particle, _)| joints_of[particle as usize] |= bit(joint));
        }
        let of_corners = |corners: &[u32; 4]| corners.iter().fold(0, |bits, &c| bits | joints_of[c as usize]);
        let bits = (0..).zip(tetrahedra.iter().map(of_corners));
        Self {
            particles,
            tetrahedra: bits.filter(|&(_, bits)| bits > 0).collect(),
            all: (0..inverse_masses.len()).map(|particle| blending(weights.row(particle).1)).collect(),
        }
    }

    /// The particles that blend between the bones of a joint, each with the product of the two weights.
    pub(super) fn particles(&self, joint: usize) -> &[(u32, f32)] {
        &self.particles[joint]
    }

    /// The tetrahedra with corners that blend between the bones of some joints, each of them once. Of more than 64
    /// joints, some others may be among them.
    pub(super) fn tetrahedra(&self, joints: impl Iterator<Item = usize>) -> impl Iterator<Item = u32> {
        let wanted = joints.fold(0, |bits, joint| bits | bit(joint));
        let is_wanted = move |entry: &&(u32, u64)| entry.1 & wanted > 0;
        self.tetrahedra.iter().filter(is_wanted).map(|&(tetrahedron, _)| tetrahedron)
    }
}

fn bit(joint: usize) -> u64 {
    1 << (joint % 64)
}

fn blending(weights: &[f32]) -> f32 {
    let pairs = (0..weights.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    pairs.map(|(i, j)| weights[i] * weights[j]).sum()
}

#[cfg(test)]
mod tests {
    use super::super::contact::tests::contact;
    use super::*;

    #[test]
    fn a_joint_has_what_follows_both_of_its_bones() {
        let rows =
            [(0, 0, 1.0), (1, 0, 0.25), (1, 1, 0.75), (2, 0, 0.5), (2, 2, 0.5), (3, 1, 0.5), (3, 0, 0.5)];
        let weights = SkinWeights::from_triplets(rows, 5, 3).unwrap();
        let (first, _) = contact();
        let joints =
            [(1, 0), (2, 0), (2, 1)].map(|(bone, parent)| JointContact { bone, parent, ..first.clone() });
        let tetrahedra = [[0, 2, 3, 4], [0, 1, 2, 4], [0, 3, 4, 3], [1, 0, 3, 4]];
        let blends = JointBlends::new(&joints, &weights, &[1.0, 1.0, 1.0, 0.0, 1.0], &tetrahedra);
        assert_eq!(blends.particles(0), [(1, 0.1875)], "the other one is held");
        assert_eq!(blends.particles(1), [(2, 0.25)]);
        assert!(blends.particles(2).is_empty());
        let among = |joints: &[usize]| blends.tetrahedra(joints.iter().copied()).collect::<Vec<_>>();
        assert_eq!((among(&[0]), among(&[1]), among(&[2])), (vec![1, 3], vec![0, 1], vec![]));
        assert_eq!((among(&[]), among(&[0, 1, 2])), (vec![], vec![0, 1, 3]));
        assert_eq!(blends.all, [0.0, 0.1875, 0.25, 0.25, 0.0]);
    }

    #[test]
    fn blending_is_of_all_pairs() {
        assert_eq!((blending(&[]), blending(&[1.0]), blending(&[0.5, 0.25, 0.25])), (0.0, 0.0, 0.3125));
    }
}
