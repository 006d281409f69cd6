//! `pbd_preset`: the values behind a preset's name.

use dermis::pbd::{EnergyForm, PbdSettings, Region, Start};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::value_error;

/// Settings of a preset of `PbdSkin` by name: "default", "paper" or "rumman_fratarcangeli".
///
/// What a preset leaves open (cell_size, threads) is None.
#[pyfunction]
pub(crate) fn pbd_preset<'py>(py: Python<'py>, preset: &str) -> PyResult<Bound<'py, PyDict>> {
    let settings = PbdSettings::preset(preset).ok_or_else(|| {
        value_error(format!("preset must be one of default, paper, rumman_fratarcangeli, got \"{preset}\""))
    })?;
    let values = PyDict::new(py);
    values.set_item("iterations", settings.iterations)?;
    values.set_item("volume_sweeps", settings.volume_sweeps)?;
    values.set_item(
        "start",
        match settings.start {
            Start::Auto => "auto",
            Start::Linear => "linear",
            Start::DualQuaternion => "dual_quaternion",
        },
    )?;
    values.set_item("stretch", settings.stretch)?;
    values.set_item("volume", settings.volume)?;
    values.set_item("bind", settings.bind)?;
    values.set_item("energy", settings.energy)?;
    values.set_item(
        "energy_form",
        match settings.energy_form {
            EnergyForm::Compliant => "compliant",
            EnergyForm::Paper => "paper",
        },
    )?;
    values.set_item("stiffness", settings.stiffness)?;
    values.set_item("self_collision", settings.self_collision)?;
    values.set_item("smoothing", settings.smoothing)?;
    values.set_item(
        "region",
        match settings.region {
            Region::Joints => "joints",
            Region::All => "all",
        },
    )?;
    values.set_item("cell_size", settings.cell_size)?;
    values.set_item("threads", settings.threads)?;
    Ok(values)
}
