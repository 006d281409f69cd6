//! Position-based skin (section 4.2): constraints on a cage, solved island by island.

mod active;
mod areas;
mod batches;
mod bind;
mod build;
mod cage_contact;
mod contact;
mod contact_setup;
mod contact_shape;
mod domains;
mod energy;
mod error;
#[cfg(test)]
mod finite_difference;
mod fit;
mod fold_field;
mod fold_grid;
mod fold_plane;
mod island;
mod lanes;
#[cfg(target_arch = "x86_64")]
mod lanes_avx2;
mod masks;
mod particles;
mod parts;
mod patch;
mod pose_scratch;
mod real;
mod self_collision;
mod settings;
mod skin;
mod smoothing;
mod solver;
mod stats;
mod stiffness;
mod stretch;
mod surface;
mod surface_contact;
mod sweeps;
mod untangle;
mod volume;

pub use areas::{JointArea, JointAreas};
pub use bind::project_bind;
pub use energy::{barycentre, project_energy, project_energy_paper, project_spring};
pub use error::PbdError;
pub use real::Real;
pub use self_collision::{ProjectionPlane, has_crossed, mean_value_coordinates, relax, signed_distance};
pub use settings::{EnergyForm, PbdSettings, Region, SkinningMethod, Start};
pub use skin::{PbdSkin, SolvedOffsets, SolvedSkin};
pub use smoothing::smooth_correction;
pub use stats::{ConstraintCounts, Milliseconds, Stats, Work};
pub use stretch::project_stretch;
pub use volume::{least_volume_divisor, project_volume, signed_volume, volume_gradients};
