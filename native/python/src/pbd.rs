//! `PbdSkin`.

use std::sync::{Mutex, PoisonError};

use dermis::pbd::{self, PbdError, PbdSettings, Stats};
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::cage::{PyTetMesh, cage_error};
use crate::choices::{ENERGY_FORMS, METHODS, REGIONS, STARTS, choose};
use crate::errors::{DermisError, value_error};
use crate::mesh::PyTriangleMesh;
use crate::poses::{numbers, positions, positions_array};
use crate::presets::preset_settings;
use crate::rig::PySkeleton;
use crate::skinning::{Pose, pose};
use crate::weights::PySkinWeights;

/// A character's skin with joints that keep their volume (section 4.2).
///
/// Built once; `solve` is then a pure function from poses to vertices: the same arguments give the
/// same bits, whatever was solved before and on any number of threads. Every setting that is None
/// comes from `preset`: "default", "paper" (Algorithm 1 as printed) or "rumman_fratarcangeli".
/// Constraint strengths (`stretch`, `volume`, `bind`, `energy`) go from 0 (off) to 1.
/// `stiffness_shares` (V,), 0 to 1, lets the stiffness vary over the surface. `rest` (B,4,4) are the
/// bones' rest matrices for `skinning="dual_quaternion"`, as in `dual_quaternion_skinning`.
#[pyclass(frozen, name = "PbdSkin", module = "dermis_native")]
pub(crate) struct PyPbdSkin {
    skin: pbd::PbdSkin,
    last: Mutex<Stats>,
}

#[pymethods]
impl PyPbdSkin {
    #[new]
    #[pyo3(signature = (
        mesh, skeleton, weights, *, preset="default", iterations=None, volume_sweeps=None, start=None,
        skinning="linear", stretch=None, volume=None, bind=None, energy=None, energy_form=None, stiffness=None,
        self_collision=None, smoothing=None, region=None, cell_size=None, threads=None,
        stiffness_shares=None, rest=None
    ))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        mesh: &PyTriangleMesh,
        skeleton: &PySkeleton,
        weights: &PySkinWeights,
        preset: &str,
        iterations: Option<u32>,
        volume_sweeps: Option<u32>,
        start: Option<&str>,
        skinning: &str,
        stretch: Option<f32>,
        volume: Option<f32>,
        bind: Option<f32>,
        energy: Option<f32>,
        energy_form: Option<&str>,
        stiffness: Option<f32>,
        self_collision: Option<bool>,
        smoothing: Option<f32>,
        region: Option<&str>,
        cell_size: Option<f64>,
        threads: Option<usize>,
        stiffness_shares: Option<&Bound<'_, PyAny>>,
        rest: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let of_preset = preset_settings(preset)?;
        let settings = PbdSettings {
            iterations: iterations.unwrap_or(of_preset.iterations),
            volume_sweeps: volume_sweeps.unwrap_or(of_preset.volume_sweeps),
            start: choose("start", start, &STARTS)?.unwrap_or(of_preset.start),
            skinning: choose("skinning", Some(skinning), &METHODS)?.unwrap_or(of_preset.skinning),
            stretch: stretch.unwrap_or(of_preset.stretch),
            volume: volume.unwrap_or(of_preset.volume),
            bind: bind.unwrap_or(of_preset.bind),
            energy: energy.unwrap_or(of_preset.energy),
            energy_form: choose("energy_form", energy_form, &ENERGY_FORMS)?.unwrap_or(of_preset.energy_form),
            stiffness: stiffness.unwrap_or(of_preset.stiffness),
            self_collision: self_collision.unwrap_or(of_preset.self_collision),
            smoothing: smoothing.unwrap_or(of_preset.smoothing),
            region: choose("region", region, &REGIONS)?.unwrap_or(of_preset.region),
            cell_size: cell_size.or(of_preset.cell_size),
            threads: threads.or(of_preset.threads),
            ..of_preset
        };
        let shares = stiffness_shares.map(|shares| numbers(shares, "stiffness_shares")).transpose()?;
        let rest = rest.map(|rest| crate::poses::transforms(rest, "rest")).transpose()?;
        let skin = py.detach(|| {
            let shares = shares.as_deref();
            let skin = pbd::PbdSkin::with_stiffness(&mesh.0, &skeleton.0, &weights.0, &settings, shares)?;
            match rest {
                Some(rest) => skin.with_bone_rest(rest),
                None => Ok(skin),
            }
        });
        let skin = skin.map_err(pbd_error)?;
        let last = Mutex::new(skin.build_stats());
        Ok(Self { skin, last })
    }

    /// Vertices (V,3) float32 of a pose: transforms (B,4,4) = pose · rest⁻¹. vertices (V,3) replace
    /// the rest positions, for shape keys that act before the armature.
    #[pyo3(signature = (transforms, vertices=None))]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = pose)] transforms: Pose,
        vertices: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let vertices = vertices.map(|v| positions(v, "vertices")).transpose()?;
        let solved = py.detach(|| self.skin.solve(&transforms.0, vertices.as_deref())).map_err(pbd_error)?;
        self.remember(solved.stats);
        positions_array(py, solved.vertices)
    }

    /// A pose like `solve`, as offsets (V,3) float32 that plain skinning turns into the solved skin:
    /// what a shape key has to hold under a live Armature modifier.
    ///
    /// shares (V,), 0 to 1, say how much of the skinning, and of the correction, each vertex follows.
    /// Also returns the number of vertices whose blended matrix is nearly singular; their offsets are
    /// limited.
    #[pyo3(signature = (transforms, vertices=None, shares=None))]
    fn solve_offsets<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = pose)] transforms: Pose,
        vertices: Option<&Bound<'py, PyAny>>,
        shares: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyArray2<f32>>, usize)> {
        let vertices = vertices.map(|v| positions(v, "vertices")).transpose()?;
        let shares = shares.map(|s| numbers(s, "shares")).transpose()?;
        let solve = || self.skin.solve_offsets(&transforms.0, vertices.as_deref(), shares.as_deref());
        let solved = py.detach(solve).map_err(pbd_error)?;
        self.remember(solved.stats);
        Ok((positions_array(py, solved.offsets)?, solved.limited))
    }

    /// Tetrahedra of all islands, in rest.
    #[getter]
    fn cage(&self) -> PyTetMesh {
        PyTetMesh(self.skin.cage())
    }

    /// What the skin consists of and what the last solve took.
    #[getter]
    fn stats<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let stats = *self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let constraints = PyDict::new(py);
        for (kind, count) in [
            ("stretch", stats.constraints.stretch),
            ("volume", stats.constraints.volume),
            ("bind", stats.constraints.bind),
            ("energy", stats.constraints.energy),
            ("self_collision", stats.constraints.self_collision),
        ] {
            constraints.set_item(kind, count)?;
        }
        let milliseconds = PyDict::new(py);
        for (phase, time) in [
            ("build", stats.milliseconds.build),
            ("skinning", stats.milliseconds.skinning),
            ("solve", stats.milliseconds.solve),
            ("surface", stats.milliseconds.surface),
            ("total", stats.milliseconds.total),
        ] {
            milliseconds.set_item(phase, time)?;
        }
        let result = PyDict::new(py);
        for (name, count) in [
            ("vertices", stats.vertices),
            ("moved_vertices", stats.moved_vertices),
            ("tetrahedra", stats.tetrahedra),
            ("islands", stats.islands),
            ("active_islands", stats.active_islands),
            ("inverted", stats.inverted),
        ] {
            result.set_item(name, count)?;
        }
        let work = PyDict::new(py);
        for (kind, count) in [
            ("solved_islands", stats.work.solved_islands),
            ("reused_islands", stats.work.reused_islands),
            ("projections", stats.work.projections),
            ("contact_candidates", stats.work.contact_candidates),
            ("corrected_vertices", stats.work.corrected_vertices),
        ] {
            work.set_item(kind, count)?;
        }
        result.set_item("work", work)?;
        result.set_item("constraints", constraints)?;
        result.set_item("milliseconds", milliseconds)?;
        Ok(result)
    }

    fn __repr__(&self) -> String {
        let stats = self.skin.build_stats();
        format!(
            "PbdSkin({} vertices, {} islands, {} tetrahedra)",
            stats.vertices, stats.islands, stats.tetrahedra
        )
    }
}

impl PyPbdSkin {
    fn remember(&self, stats: Stats) {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = stats;
    }
}

fn pbd_error(error: PbdError) -> PyErr {
    match error {
        PbdError::Cage(error) => cage_error(error),
        PbdError::Threads { .. } => DermisError::new_err(error.to_string()),
        PbdError::Mismatch { .. }
        | PbdError::Setting { .. }
        | PbdError::Share { .. }
        | PbdError::Skinning(_) => value_error(error),
    }
}
