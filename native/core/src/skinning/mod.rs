//! Skinning: linear blend (eq. 1) and dual quaternions, as Blender's Armature modifier does them.
//!
//! Transforms are `pose · rest⁻¹` in the space of the vertices. Vertices come back to the last bit
//! where every transform is the identity: both methods move a vertex by what its bones move it.

mod blend;
mod dual_quaternion;
mod error;
mod linear;
mod rest_space;
mod row;
mod stretched_space;
mod weights;

pub use blend::{Skinning, check_transforms};
pub use dual_quaternion::{DualQuaternion, DualQuaternionBlend, dual_quaternion_skinning};
pub use error::SkinningError;
pub use linear::{blended_matrix, linear_blend_skinning};
pub use rest_space::{RestSpaceOffsets, to_rest_space};
pub use row::{Row, blend, normalized, row_of};
pub use stretched_space::StretchedSpace;
pub use weights::{SkinWeights, WeightsError};
