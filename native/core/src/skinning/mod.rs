//! Skinning: sparse weights and the blends that apply them (eq. 1).

mod weights;

pub use weights::{SkinWeights, WeightsError};
