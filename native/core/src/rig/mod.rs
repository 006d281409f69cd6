//! Skeletons, maps between their bones, the regions that they cut a surface into, and weights made from them (section 4.1).

mod bind;
mod bind_paper;
mod bind_weights;
mod bone_map;
mod fit;
mod regions;
mod segment;
mod skeleton;

pub use bind::BindPartPolicy;
pub use bind_paper::bind_weights_paper;
pub use bind_weights::{BindError, BindMethod, BindSettings, ProtectedWeights, bind_weights};
pub use bone_map::{BoneMap, BoneMapError, How, map_bones};
pub use fit::{FitError, FitMethod, FitSettings, FittedSkeleton, fit_skeleton};
pub use regions::{JOINT_RADIUS, Region, decompose, joint_radii};
pub use segment::{closest_on_segment, distance_to_segment};
pub use skeleton::{Skeleton, SkeletonError};
