//! Names of the choices that `PbdSkin` offers.

use dermis::pbd::{EnergyForm, Region, SkinningMethod, Start};
use pyo3::prelude::*;

use crate::errors::value_error;

/// Presets of all settings.
pub(crate) const PRESETS: [&str; 3] = ["default", "paper", "rumman_fratarcangeli"];
/// Start states of the cage.
pub(crate) const STARTS: [(&str, Start); 3] =
    [("auto", Start::Auto), ("linear", Start::Linear), ("dual_quaternion", Start::DualQuaternion)];
/// Skinning methods of the surface.
pub(crate) const METHODS: [(&str, SkinningMethod); 2] =
    [("linear", SkinningMethod::Linear), ("dual_quaternion", SkinningMethod::DualQuaternion)];
/// Forms of the energy constraint.
pub(crate) const ENERGY_FORMS: [(&str, EnergyForm); 2] =
    [("compliant", EnergyForm::Compliant), ("paper", EnergyForm::Paper)];
/// What may move.
pub(crate) const REGIONS: [(&str, Region); 2] = [("joints", Region::Joints), ("all", Region::All)];

/// The value of a choice's name; None where none was given.
pub(crate) fn choose<T: Copy>(
    argument: &str,
    given: Option<&str>,
    choices: &[(&str, T)],
) -> PyResult<Option<T>> {
    let Some(given) = given else { return Ok(None) };
    match choices.iter().find(|(name, _)| *name == given) {
        Some(&(_, value)) => Ok(Some(value)),
        None => Err(choice_error(argument, given, choices.iter().map(|choice| choice.0))),
    }
}

/// The name of a value, None for one that is not offered.
pub(crate) fn name_of<T: PartialEq>(value: &T, choices: &[(&'static str, T)]) -> Option<&'static str> {
    choices.iter().find(|(_, choice)| choice == value).map(|(name, _)| *name)
}

/// The error about a name that is none of those offered.
pub(crate) fn choice_error<'a>(
    argument: &str,
    given: &str,
    names: impl IntoIterator<Item = &'a str>,
) -> PyErr {
    let names: Vec<&str> = names.into_iter().collect();
    value_error(format!("{argument} must be one of {}, got \"{given}\"", names.join(", ")))
}
