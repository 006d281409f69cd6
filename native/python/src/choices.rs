//! Names of the choices that the module offers.

use dermis::mesh::PartChoice;
use dermis::pbd::{EnergyForm, Region, SkinningMethod, Start};
use dermis::retarget::parts::PartPolicy;
use dermis::rig::BindPartPolicy;
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

/// What may become of a loose part in a retargeting,
pub(crate) const PARTS: [(&str, PartPolicy); 4] = [
    ("auto", PartPolicy::Auto),
    ("rigid", PartPolicy::Rigid),
    ("surface", PartPolicy::Follow),
    ("match", PartPolicy::Match),
];
/// and in a bind.
pub(crate) const BIND_PARTS: [(&str, BindPartPolicy); 4] = [
    ("auto", BindPartPolicy::Auto),
    ("rigid", BindPartPolicy::Rigid),
    ("surface", BindPartPolicy::Follow),
    ("own", BindPartPolicy::Own),
];

/// One treatment for all loose parts, or a sequence with one for each component.
pub(crate) fn choose_parts<P: Copy>(
    argument: &Bound<'_, PyAny>,
    choices: &[(&str, P)],
) -> PyResult<PartChoice<P>> {
    let find = |name: &str, given: &str| match choices.iter().find(|(known, _)| *known == given) {
        Some(&(_, policy)) => Ok(policy),
        None => Err(choice_error(name, given, choices.iter().map(|choice| choice.0))),
    };
    if let Ok(given) = argument.extract::<String>() {
        return Ok(PartChoice::All(find("parts", &given)?));
    }
    let given: Vec<String> = argument
        .extract()
        .map_err(|_| value_error("parts must be a name or a sequence of names, one for each component"))?;
    let each = given.iter().enumerate().map(|(at, given)| find(&format!("parts[{at}]"), given));
    Ok(PartChoice::Each(each.collect::<PyResult<_>>()?))
}

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
