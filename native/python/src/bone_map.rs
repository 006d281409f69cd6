//! `BoneMap` and `map_bones`.

use dermis::rig::{self, BoneMap, BoneMapError};
use pyo3::prelude::*;

use crate::arrays::points;
use crate::errors::{RetargetError, value_error};
use crate::rig::PySkeleton;
use crate::weights::PySkinWeights;

/// For each bone of a source skeleton the bones of a target skeleton that stand for it.
#[pyclass(frozen, name = "BoneMap", module = "dermis_native")]
pub(crate) struct PyBoneMap(pub(crate) BoneMap);

#[pymethods]
impl PyBoneMap {
    #[new]
    fn new(
        source_skeleton: &PySkeleton,
        target_skeleton: &PySkeleton,
        targets: Vec<Vec<i64>>,
    ) -> PyResult<Self> {
        BoneMap::from_pairs(&source_skeleton.0, &target_skeleton.0, &targets)
            .map(Self)
            .map_err(bone_map_error)
    }

    /// Target bones of each source bone, along their chain; empty without a counterpart.
    #[getter]
    fn targets(&self) -> Vec<Vec<u32>> {
        (0..self.0.source_bone_count()).map(|bone| self.0.targets(bone).to_vec()).collect()
    }

    /// How each source bone's counterparts were found.
    #[getter]
    fn how(&self) -> Vec<&'static str> {
        (0..self.0.source_bone_count()).map(|bone| self.0.how(bone).as_str()).collect()
    }

    /// Source bone whose targets take each source bone's weight.
    #[getter]
    fn carriers(&self) -> Vec<u32> {
        (0..self.0.source_bone_count()).map(|bone| self.0.carrier(bone)).collect()
    }

    /// The source skeleton at the target's rest positions.
    fn aligned_skeleton(
        &self,
        source_skeleton: &PySkeleton,
        target_skeleton: &PySkeleton,
    ) -> PyResult<PySkeleton> {
        self.0
            .aligned_skeleton(&source_skeleton.0, &target_skeleton.0)
            .map(PySkeleton)
            .map_err(bone_map_error)
    }

    /// Weights over target bones from weights over source bones of the target's vertices.
    fn transfer(
        &self,
        py: Python<'_>,
        weights: &PySkinWeights,
        vertices: &Bound<'_, PyAny>,
        target_skeleton: &PySkeleton,
    ) -> PyResult<PySkinWeights> {
        let vertices = points(vertices, "vertices")?;
        if vertices.len() != weights.0.vertex_count() {
            return Err(value_error(format!(
                "the weights have {} vertices, but {} were given",
                weights.0.vertex_count(),
                vertices.len()
            )));
        }
        py.detach(|| self.0.transfer(&weights.0, &vertices, &target_skeleton.0))
            .map(PySkinWeights)
            .map_err(bone_map_error)
    }

    fn __len__(&self) -> usize {
        self.0.source_bone_count()
    }

    fn __repr__(&self) -> String {
        let mapped = (0..self.0.source_bone_count()).filter(|&bone| !self.0.targets(bone).is_empty()).count();
        format!("BoneMap({mapped} of {} bones)", self.0.source_bone_count())
    }
}

/// Map the bones of one skeleton to those of another: by name, by naming scheme, by structure.
#[pyfunction]
pub(crate) fn map_bones(
    py: Python<'_>,
    source_skeleton: &PySkeleton,
    target_skeleton: &PySkeleton,
) -> PyResult<PyBoneMap> {
    py.detach(|| rig::map_bones(&source_skeleton.0, &target_skeleton.0))
        .map(PyBoneMap)
        .map_err(bone_map_error)
}

pub(crate) fn bone_map_error(error: BoneMapError) -> PyErr {
    match error {
        BoneMapError::NothingInCommon { .. } => RetargetError::new_err(error.to_string()),
        BoneMapError::Count { .. }
        | BoneMapError::OutOfRange { .. }
        | BoneMapError::Repeated { .. }
        | BoneMapError::NotAChain { .. }
        | BoneMapError::OtherSkeleton { .. } => value_error(error),
    }
}
