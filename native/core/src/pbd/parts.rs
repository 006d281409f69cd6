//! Which bones move as one in a pose: between them nothing is deformed.

use glam::{Affine3A, Mat3A, Vec3A};

/// Relative motion below this is the rounding of f32 matrices.
const STILL: f32 = 2e-6;
/// Relative motion below which two bones carry what is between them without a strain that could be seen.
const ALIKE: f32 = 2e-5;
/// Strain of a bone's own matrix from which on it does not carry rigidly.
const RIGID: f32 = 1e-4;

/// The part that has not moved relative to the island's frame.
pub(super) const STILL_PART: u32 = 0;
/// What more than one part carries, or one that is scaled.
pub(super) const MIXED: u32 = u32::MAX;

/// Bones by the part that they move with.
#[derive(Debug, Clone, Default)]
pub(super) struct Parts {
    /// Part of each bone (B): [`STILL_PART`], a number of its own for each other part that moves rigidly,
    /// or [`MIXED`].
    of_bone: Vec<u32>,
    /// Inverse transforms of the parts after the first.
    inverses: Vec<Affine3A>,
}

impl Parts {
    /// Finds the parts of the given bones; `transforms` (B) are relative to the island's frame.
    pub(super) fn find(&mut self, bones: impl Iterator<Item = usize>, transforms: &[Affine3A], extent: f32) {
        self.inverses.clear();
        self.of_bone.clear();
        self.of_bone.resize(transforms.len(), STILL_PART);
        for bone in bones {
            self.of_bone[bone] = self.part_of(&transforms[bone], extent);
        }
    }

    /// True where each bone is in the same part.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        self.of_bone == other.of_bone
    }

    fn part_of(&mut self, transform: &Affine3A, extent: f32) -> u32 {
        if is_still(transform, extent) {
            return STILL_PART;
        }
        if !is_rigid(transform) {
            return MIXED;
        }
        let alike = |inverse: &Affine3A| is_within(ALIKE, &(*inverse * *transform), extent);
        let known = self.inverses.iter().position(alike);
        let place = known.unwrap_or_else(|| {
            self.inverses.push(transform.inverse());
            self.inverses.len() - 1
        });
        place as u32 + 1
    }

    /// The part that all of the bones move with, [`MIXED`] where there is none.
    #[inline]
    pub(super) fn of(&self, bones: &[u32]) -> u32 {
        let Some((&first, others)) = bones.split_first() else { return STILL_PART };
        let part = self.of_bone[first as usize];
        if others.iter().all(|&bone| self.of_bone[bone as usize] == part) { part } else { MIXED }
    }
}

/// True for a transform that differs from the identity by rounding alone.
pub(super) fn is_still(transform: &Affine3A, extent: f32) -> bool {
    is_within(STILL, transform, extent)
}

fn is_within(tolerance: f32, transform: &Affine3A, extent: f32) -> bool {
    transform.matrix3.abs_diff_eq(Mat3A::IDENTITY, tolerance)
        && transform.translation.abs_diff_eq(Vec3A::ZERO, tolerance * extent)
}

/// True for rotations and translations.
fn is_rigid(transform: &Affine3A) -> bool {
    let matrix = transform.matrix3;
    matrix.determinant() > 0.0 && (matrix.transpose() * matrix).abs_diff_eq(Mat3A::IDENTITY, RIGID)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn bones_that_move_as_one_are_one_part() {
        let turned = Affine3A::from_rotation_z(0.7) * Affine3A::from_translation(Vec3::X);
        let farther = turned * Affine3A::from_rotation_x(0.1);
        let still = Affine3A::from_rotation_y(1e-7);
        let scaled = Affine3A::from_scale(Vec3::splat(1.1));
        let mirrored = Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
        let rounded = Affine3A::from_rotation_z(1e-6) * turned;
        let pose = [Affine3A::IDENTITY, turned, farther, still, scaled, mirrored, rounded, farther];
        let mut parts = Parts::default();
        parts.find(0..7, &pose, 1.0);
        let of = |bones: &[u32]| parts.of(bones);
        assert_eq!((of(&[]), of(&[0]), of(&[0, 3])), (STILL_PART, STILL_PART, STILL_PART));
        assert_eq!((of(&[1]), of(&[1, 6]), of(&[2])), (1, 1, 2));
        assert_eq!((of(&[1, 2]), of(&[0, 1]), of(&[4]), of(&[5])), (MIXED, MIXED, MIXED, MIXED));
        assert_eq!(of(&[7]), STILL_PART, "not asked for");
        parts.find(0..1, &pose, 1.0);
        assert_eq!(parts.of(&[1]), STILL_PART, "nothing is left of another pose");
    }
}
