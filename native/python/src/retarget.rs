//! `retarget_weights` and its result.

use dermis::retarget::{self, Character, Method, Origin, Retargeted, Settings};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::arrays::{integers, matrix};
use crate::bone_map::PyBoneMap;
use crate::choices::{PARTS, choose_parts, name_of};
use crate::errors::{retarget_error, value_error};
use crate::mesh::PyTriangleMesh;
use crate::progress::{PyProgress, shared};
use crate::rig::PySkeleton;
use crate::weights::PySkinWeights;

/// What `retarget_weights` found.
#[pyclass(frozen, name = "RetargetResult", module = "dermis_native")]
pub(crate) struct PyRetargetResult(Retargeted);

#[pymethods]
impl PyRetargetResult {
    /// Weights of the target, columns in the order of the target's bones.
    #[getter]
    fn weights(&self) -> PySkinWeights {
        PySkinWeights(self.0.weights.clone())
    }

    /// Source vertex matched to each target vertex (Vt,).
    #[getter]
    fn correspondence<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_vec(py, self.0.correspondence.iter().map(|&v| i64::from(v)).collect())
    }

    /// True where a vertex was matched by the surface, False where it was filled in (Vt,).
    #[getter]
    fn matched<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        PyArray1::from_vec(py, self.0.matched.clone())
    }

    /// Where each vertex has its weights from (Vt,): 0 match, 1 inpainting, 2 its loose part, 3 the
    /// closest point of the source, far from any match that passed its tests.
    #[getter]
    fn status<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        let code = |origin: &Origin| match origin {
            Origin::Matched => 0,
            Origin::Inpainted => 1,
            Origin::Part => 2,
            Origin::Nearest => 3,
        };
        PyArray1::from_vec(py, self.0.origin.iter().map(code).collect())
    }

    /// Loose part of each vertex (Vt,), numbered by their smallest vertex; empty by method "paper".
    #[getter]
    fn part<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let mut part = vec![0; if self.0.parts.is_empty() { 0 } else { self.0.matched.len() }];
        for (index, each) in (0..).zip(&self.0.parts) {
            each.vertices.iter().for_each(|&v| part[v as usize] = index);
        }
        PyArray1::from_vec(py, part)
    }

    /// What became of each part: "rigid", "surface" or "match".
    #[getter]
    fn part_policies(&self) -> Vec<&'static str> {
        self.0.parts.iter().filter_map(|part| name_of(&part.policy, &PARTS)).collect()
    }

    /// The part that is the body, None by method "paper".
    #[getter]
    fn body(&self) -> Option<usize> {
        self.0.parts.iter().position(|part| part.is_body)
    }

    /// Landmark pairs used (k,2): source vertex, target vertex.
    #[getter]
    fn landmarks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let pairs = &self.0.landmarks;
        matrix(py, pairs.as_flattened().iter().map(|&v| i64::from(v)).collect(), pairs.len(), 2)
    }
}

/// Give `target` the weights of `source` (Algorithm 2).
#[pyfunction]
#[pyo3(signature = (
    source, source_weights, target, *, source_skeleton=None, target_skeleton=None, bone_map=None,
    landmarks=None, method="auto", parts=None, max_influences=None, eigenpairs=100, progress=None
))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
pub(crate) fn retarget_weights(
    py: Python<'_>,
    source: &PyTriangleMesh,
    source_weights: &PySkinWeights,
    target: &PyTriangleMesh,
    source_skeleton: Option<&PySkeleton>,
    target_skeleton: Option<&PySkeleton>,
    bone_map: Option<&PyBoneMap>,
    landmarks: Option<&Bound<'_, PyAny>>,
    method: &str,
    parts: Option<&Bound<'_, PyAny>>,
    max_influences: Option<usize>,
    eigenpairs: usize,
    progress: Option<&PyProgress>,
) -> PyResult<PyRetargetResult> {
    let method = match method {
        "auto" => Method::Auto,
        "paper" => Method::Paper,
        other => return Err(value_error(format!("method must be \"auto\" or \"paper\", got \"{other}\""))),
    };
    if max_influences == Some(0) {
        return Err(value_error("max_influences must be at least 1, or None for any number"));
    }
    let landmarks = landmarks.map(landmark_pairs).transpose()?;
    let parts = parts.map(|parts| choose_parts(parts, &PARTS)).transpose()?.unwrap_or_default();
    let settings = Settings { method, max_influences, eigenpairs, parts };
    let progress = shared(progress);
    py.detach(|| {
        retarget::retarget_weights(
            Character { mesh: &source.0, skeleton: source_skeleton.map(|s| &s.0) },
            &source_weights.0,
            Character { mesh: &target.0, skeleton: target_skeleton.map(|s| &s.0) },
            bone_map.map(|map| &map.0),
            landmarks.as_deref(),
            &settings,
            &progress,
        )
    })
    .map(PyRetargetResult)
    .map_err(retarget_error)
}

fn landmark_pairs(landmarks: &Bound<'_, PyAny>) -> PyResult<Vec<[i64; 2]>> {
    let array = integers(landmarks, "landmarks", &[None, Some(2)])?;
    Ok(array.as_slice()?.as_chunks::<2>().0.to_vec())
}
