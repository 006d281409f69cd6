//! `bind_weights`.

use dermis::rig::bind_weights_paper;
use pyo3::prelude::*;

use crate::errors::value_error;
use crate::mesh::PyTriangleMesh;
use crate::rig::PySkeleton;
use crate::weights::PySkinWeights;

/// Weights made from the skeleton alone (eq. 2, section 4.1).
#[pyfunction]
#[pyo3(signature = (mesh, skeleton, *, method="paper", max_influences=None))]
pub(crate) fn bind_weights(
    py: Python<'_>,
    mesh: &PyTriangleMesh,
    skeleton: &PySkeleton,
    method: &str,
    max_influences: Option<usize>,
) -> PyResult<PySkinWeights> {
    if method != "paper" {
        return Err(value_error(format!("method must be \"paper\", got \"{method}\"")));
    }
    if max_influences == Some(0) {
        return Err(value_error("max_influences must be at least 1, or None for any number"));
    }
    let bone_count = skeleton.0.bone_count();
    if bone_count == 0 {
        return Err(value_error("the skeleton has no bones"));
    }
    Ok(PySkinWeights(py.detach(|| {
        let weights = bind_weights_paper(mesh.0.vertices(), &skeleton.0, &vec![true; bone_count]);
        match max_influences {
            Some(count) => weights.limited(count),
            None => weights,
        }
    })))
}
