//! `dermis_native`: the Python binding of the `dermis` core.
//!
//! A thin layer: arrays in, arrays out. It checks shapes and types, releases the interpreter lock
//! while the core works, and turns the core's typed errors into `ValueError` (a wrong argument) or
//! a subclass of `DermisError` (anything else). The contract is in `dermis_native.pyi`.

mod arrays;
mod bind;
mod bone_map;
mod cage;
mod choices;
mod errors;
mod fit;
mod mesh;
mod pbd;
mod poses;
mod presets;
mod progress;
mod retarget;
mod rig;
mod skinning;
mod spectral;
mod weights;

#[pyo3::pymodule]
mod dermis_native {
    #[pymodule_export]
    use super::bind::bind_weights;
    #[pymodule_export]
    use super::bone_map::{PyBoneMap, map_bones};
    #[pymodule_export]
    use super::cage::{PyTetMesh, tetrahedralize};
    #[pymodule_export]
    use super::errors::{Cancelled, DermisError, NumericalError, RetargetError};
    #[pymodule_export]
    use super::fit::{PyFittedSkeleton, fit_skeleton};
    #[pymodule_export]
    use super::mesh::PyTriangleMesh;
    #[pymodule_export]
    use super::pbd::PyPbdSkin;
    #[pymodule_export]
    use super::presets::pbd_preset;
    #[pymodule_export]
    use super::progress::PyProgress;
    #[pymodule_export]
    use super::retarget::{PyRetargetResult, retarget_weights};
    #[pymodule_export]
    use super::rig::PySkeleton;
    #[pymodule_export]
    use super::skinning::{dual_quaternion_skinning, linear_blend_skinning, rest_space_offsets};
    #[pymodule_export]
    use super::spectral::{PyBiharmonicDistance, eigenpairs, laplacian};
    #[pymodule_export]
    use super::weights::PySkinWeights;

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", dermis::VERSION)
    }
}
