//! `bind_weights`.

use dermis::rig::{self, BindMethod, BindSettings};
use pyo3::prelude::*;

use crate::arrays::chosen_bones;
use crate::errors::{bind_error, value_error};
use crate::mesh::PyTriangleMesh;
use crate::progress::{PyProgress, shared};
use crate::rig::PySkeleton;
use crate::weights::PySkinWeights;

/// Weights for a mesh that has none, from its skeleton alone.
#[pyfunction]
#[pyo3(signature = (mesh, skeleton, *, method="volumetric", max_influences=None, bones=None, progress=None))]
pub(crate) fn bind_weights(
    py: Python<'_>,
    mesh: &PyTriangleMesh,
    skeleton: &PySkeleton,
    method: &str,
    max_influences: Option<usize>,
    bones: Option<&Bound<'_, PyAny>>,
    progress: Option<&PyProgress>,
) -> PyResult<PySkinWeights> {
    let method = match method {
        "volumetric" => BindMethod::Volumetric,
        "paper" => BindMethod::Paper,
        other => {
            return Err(value_error(format!("method must be \"volumetric\" or \"paper\", got \"{other}\"")));
        }
    };
    if max_influences == Some(0) {
        return Err(value_error("max_influences must be at least 1, or None for any number"));
    }
    let bones = bones.map(|bones| chosen_bones(bones, skeleton.0.bone_count())).transpose()?;
    let settings = BindSettings { method, max_influences, bones };
    let progress = shared(progress);
    py.detach(|| rig::bind_weights(&mesh.0, &skeleton.0, &settings, &progress))
        .map(PySkinWeights)
        .map_err(bind_error)
}
