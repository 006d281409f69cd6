//! What of an island blends between the two bones of a joint: where these bend, all else starts without regard
//! to the joint.

use super::contact::JointContact;
use crate::skinning::SkinWeights;

/// What blends between the bones of one joint.
#[derive(Debug, Clone, Default)]
pub(super) struct JointBlend {
    /// Particles that are not held and follow both bones, each with the product of its two weights.
    pub particles: Vec<(u32, f32)>,
    /// Tetrahedra with such a corner.
    pub tetrahedra: Vec<u32>,
}

/// The blends of some joints, in their order.
pub(super) fn joint_blends(
    joints: &[JointContact],
    weights: &SkinWeights,
    inverse_masses: &[f32],
    tetrahedra: &[[u32; 4]],
) -> Vec<JointBlend> {
    let mut blends_here = vec![false; inverse_masses.len()];
    let blend = |joint: &JointContact| {
        let both = |particle: u32| {
            let weight = |bone: u32| weights.entries(particle as usize).find(|entry| entry.0 == bone);
            let product = weight(joint.bone)?.1 * weight(joint.parent)?.1;
            (inverse_masses[particle as usize] > 0.0 && product > 0.0).then_some((particle, product))
        };
        let particles: Vec<(u32, f32)> = (0..inverse_masses.len() as u32).filter_map(both).collect();
        particles.iter().for_each(|&(particle, _)| blends_here[particle as usize] = true);
        let is_among = |&index: &u32| tetrahedra[index as usize].iter().any(|&c| blends_here[c as usize]);
        let among = (0..tetrahedra.len() as u32).filter(is_among).collect();
        particles.iter().for_each(|&(particle, _)| blends_here[particle as usize] = false);
        JointBlend { particles, tetrahedra: among }
    };
    joints.iter().map(blend).collect()
}

/// The sum of the products of any two weights of a row.
pub(super) fn blending(weights: &[f32]) -> f32 {
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
        let (joint, _) = contact();
        let other = JointContact { bone: 2, parent: 1, ..joint.clone() };
        let tetrahedra = [[0, 2, 3, 4], [0, 1, 2, 4], [1, 2, 3, 4]];
        let blends = joint_blends(&[joint, other], &weights, &[1.0, 1.0, 1.0, 0.0, 1.0], &tetrahedra);
        assert_eq!(blends[0].particles, [(1, 0.1875)], "the other one is held");
        assert_eq!(blends[0].tetrahedra, [1, 2]);
        assert!(blends[1].particles.is_empty() && blends[1].tetrahedra.is_empty());
    }

    #[test]
    fn blending_is_of_all_pairs() {
        assert_eq!((blending(&[]), blending(&[1.0]), blending(&[0.5, 0.25, 0.25])), (0.0, 0.0, 0.3125));
    }
}
