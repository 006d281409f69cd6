//! `pbd_preset`: the values behind a preset's name.

use dermis::pbd::PbdSettings;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::choices::{ENERGY_FORMS, PRESETS, REGIONS, STARTS, choice_error, name_of};

/// Settings of a preset of `PbdSkin` by name: "default", "paper" or "rumman_fratarcangeli".
///
/// What a preset leaves open (cell_size, threads) is None.
#[pyfunction]
pub(crate) fn pbd_preset<'py>(py: Python<'py>, preset: &str) -> PyResult<Bound<'py, PyDict>> {
    let settings = preset_settings(preset)?;
    let values = PyDict::new(py);
    values.set_item("iterations", settings.iterations)?;
    values.set_item("volume_sweeps", settings.volume_sweeps)?;
    values.set_item("start", name_of(&settings.start, &STARTS))?;
    values.set_item("stretch", settings.stretch)?;
    values.set_item("volume", settings.volume)?;
    values.set_item("bind", settings.bind)?;
    values.set_item("energy", settings.energy)?;
    values.set_item("energy_form", name_of(&settings.energy_form, &ENERGY_FORMS))?;
    values.set_item("stiffness", settings.stiffness)?;
    values.set_item("self_collision", settings.self_collision)?;
    values.set_item("smoothing", settings.smoothing)?;
    values.set_item("region", name_of(&settings.region, &REGIONS))?;
    values.set_item("cell_size", settings.cell_size)?;
    values.set_item("threads", settings.threads)?;
    Ok(values)
}

/// Settings of a preset; ValueError for a name that is none of them.
pub(crate) fn preset_settings(preset: &str) -> PyResult<PbdSettings> {
    PbdSettings::preset(preset).ok_or_else(|| choice_error("preset", preset, PRESETS))
}
