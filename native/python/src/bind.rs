//! `bind_weights`.

use dermis::rig::{self, BindMethod, BindSettings, ProtectedWeights};
use pyo3::prelude::*;

use crate::arrays::chosen;
use crate::choices::{BIND_PARTS, choose_parts};
use crate::errors::{bind_error, value_error};
use crate::mesh::PyTriangleMesh;
use crate::progress::{PyProgress, shared};
use crate::rig::PySkeleton;
use crate::weights::PySkinWeights;

/// Weights for a mesh that has none, from its skeleton alone.
#[pyfunction]
#[pyo3(signature = (
    mesh, skeleton, *, method="volumetric", parts=None, max_influences=None, bones=None, protected=None,
    weights=None, progress=None
))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
pub(crate) fn bind_weights(
    py: Python<'_>,
    mesh: &PyTriangleMesh,
    skeleton: &PySkeleton,
    method: &str,
    parts: Option<&Bound<'_, PyAny>>,
    max_influences: Option<usize>,
    bones: Option<&Bound<'_, PyAny>>,
    protected: Option<&Bound<'_, PyAny>>,
    weights: Option<&PySkinWeights>,
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
    let bones = bones.map(|bones| chosen(bones, "bones", "bones", skeleton.0.bone_count())).transpose()?;
    let parts = parts.map(|parts| choose_parts(parts, &BIND_PARTS)).transpose()?.unwrap_or_default();
    let protected = match (protected, weights) {
        (None, None) => None,
        (Some(vertices), Some(weights)) => {
            let vertices = chosen(vertices, "protected", "vertices", mesh.0.vertex_count())?;
            Some(ProtectedWeights { vertices, weights: weights.0.clone() })
        }
        _ => {
            return Err(value_error("protected vertices and their weights are given together or not at all"));
        }
    };
    let settings = BindSettings { method, max_influences, bones, parts, protected };
    let progress = shared(progress);
    py.detach(|| rig::bind_weights(&mesh.0, &skeleton.0, &settings, &progress))
        .map(PySkinWeights)
        .map_err(bind_error)
}
