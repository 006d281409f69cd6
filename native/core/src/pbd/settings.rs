//! Settings of the skin: the constraints of section 4.2 with their strengths, and presets.

use serde::{Deserialize, Serialize};

use super::PbdError;

/// Where the cage starts before its constraints are iterated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Start {
    /// Dual quaternions where the volume constraint is on, half way to linear blending where a joint
    /// bends, which measures best; without it linear blending, so that what the other constraints do
    /// for the volume can be seen.
    #[default]
    Auto,
    /// Linear blend skinning, as in the paper. At twists near 180° it collapses to the axis.
    Linear,
    /// Dual quaternion skinning: nearest to the solution for twists and for bends.
    DualQuaternion,
}

/// What the surface does outside of joint areas, and what corrections are relative to: the
/// Armature modifier's method.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SkinningMethod {
    /// Linear blend (eq. 1).
    #[default]
    Linear,
    /// Dual quaternions: Preserve Volume.
    DualQuaternion,
}

/// Form of the energy constraint.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EnergyForm {
    /// Compliant springs with multipliers: the stiffness matters, the iteration count does not.
    #[default]
    Compliant,
    /// Eq. 9-11 to the letter: the stiffness cancels.
    Paper,
}

/// Which part of the body the solver may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Region {
    /// Where weights blend, and what can touch around a joint.
    #[default]
    Joints,
    /// Everything but the neighbourhood of the bones.
    All,
}

/// How the skin is solved. Strengths go from 0 (off) to 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PbdSettings {
    /// Iterations of all constraints (Algorithm 1, line 6).
    pub iterations: u32,
    /// Sweeps of volume and self-collision alone after the iterations.
    pub volume_sweeps: u32,
    /// Start state of the cage.
    pub start: Start,
    /// Method of the Armature modifier.
    pub skinning: SkinningMethod,
    /// Stretch constraint (eq. 6): share of the violation that each iteration repairs.
    pub stretch: f32,
    /// Lets `stretch` fall to zero over the iterations, so that volume has the last word in the cage; edges of the
    /// surface that are then drawn out farther than by plain skinning are shortened in the end.
    pub anneal_stretch: bool,
    /// Volume constraint (eq. 7): share of the violation that each iteration repairs.
    pub volume: f32,
    /// Bind constraint (section 4.2 c): share of the violation that each iteration repairs.
    pub bind: f32,
    /// Energy constraint (eq. 9): multiplies `stiffness`.
    pub energy: f32,
    /// Form of the energy constraint.
    pub energy_form: EnergyForm,
    /// Stiffness k of the energy springs, relative to the mass of a particle; above 0.
    pub stiffness: f32,
    /// Self-collision constraint (eq. 12-15).
    pub self_collision: bool,
    /// Smoothing of the correction (eq. 16): the paper's k, 0 is off.
    pub smoothing: f32,
    /// What may move.
    pub region: Region,
    /// Cell size of the cage in the mesh's unit; by default the thickness at each joint decides.
    pub cell_size: Option<f64>,
    /// Threads; by default those of the machine. The result does not depend on it.
    pub threads: Option<usize>,
}

impl Default for PbdSettings {
    fn default() -> Self {
        Self {
            iterations: 10,
            volume_sweeps: 10,
            start: Start::Auto,
            skinning: SkinningMethod::Linear,
            stretch: 0.2,
            anneal_stretch: true,
            volume: 1.0,
            bind: 0.0,
            energy: 0.0,
            energy_form: EnergyForm::Compliant,
            stiffness: 1.0,
            self_collision: true,
            smoothing: 0.0,
            region: Region::Joints,
            cell_size: None,
            threads: None,
        }
    }
}

impl PbdSettings {
    /// Algorithm 1 as printed: linear start, all five constraints at full strength, smoothing. The
    /// volume does not have the last word, and where a joint bends far the rest outvotes it: about as
    /// much volume is lost as by plain skinning. `volume_sweeps` give it back.
    #[must_use]
    pub fn paper() -> Self {
        Self {
            volume_sweeps: 0,
            start: Start::Linear,
            stretch: 1.0,
            anneal_stretch: false,
            bind: 1.0,
            energy: 1.0,
            energy_form: EnergyForm::Paper,
            smoothing: 0.5,
            ..Self::default()
        }
    }

    /// Rumman & Fratarcangeli 2015: stretch, volume and bind; no energy, no self-collision.
    #[must_use]
    pub fn rumman_fratarcangeli() -> Self {
        Self { energy: 0.0, self_collision: false, ..Self::paper() }
    }

    /// The preset of a name: `default`, `paper` or `rumman_fratarcangeli`.
    #[must_use]
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "default" => Some(Self::default()),
            "paper" => Some(Self::paper()),
            "rumman_fratarcangeli" => Some(Self::rumman_fratarcangeli()),
            _ => None,
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// [`PbdError::Setting`] naming the first setting out of range.
    pub fn check(&self) -> Result<(), PbdError> {
        let error = |name, value: f64, range| Err(PbdError::Setting { name, value, range });
        for (name, value) in [
            ("stretch", self.stretch),
            ("volume", self.volume),
            ("bind", self.bind),
            ("energy", self.energy),
            ("smoothing", self.smoothing),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return error(name, value.into(), "from 0 to 1");
            }
        }
        if !(self.stiffness > 0.0 && self.stiffness.is_finite()) {
            return error("stiffness", self.stiffness.into(), "finite and above 0");
        }
        for (name, value) in [("iterations", self.iterations), ("volume_sweeps", self.volume_sweeps)] {
            if value > MOST_ITERATIONS {
                return error(name, value.into(), "at most 10000");
            }
        }
        match (self.cell_size, self.threads) {
            (Some(size), _) if !(size > 0.0 && size.is_finite()) => {
                error("cell_size", size, "finite and above 0")
            }
            (_, Some(0)) => error("threads", 0.0, "at least 1"),
            _ => Ok(()),
        }
    }
}

/// More iterations than this are a slip of the keyboard.
const MOST_ITERATIONS: u32 = 10_000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_pass_their_own_check_and_differ() {
        let presets =
            ["default", "paper", "rumman_fratarcangeli"].map(|name| PbdSettings::preset(name).unwrap());
        for preset in &presets {
            assert_eq!(preset.check(), Ok(()));
        }
        assert_ne!(presets[0], presets[1]);
        assert!(!presets[2].self_collision && presets[2].energy == 0.0 && presets[2].bind > 0.0);
        assert_eq!(PbdSettings::preset("papers"), None);
    }

    #[test]
    fn the_setting_out_of_range_is_named() {
        let named = |settings: PbdSettings| match settings.check() {
            Err(PbdError::Setting { name, .. }) => name,
            other => panic!("{other:?}"),
        };
        let default = PbdSettings::default;
        assert_eq!(named(PbdSettings { stretch: 1.5, ..default() }), "stretch");
        assert_eq!(named(PbdSettings { volume: f32::NAN, ..default() }), "volume");
        assert_eq!(named(PbdSettings { stiffness: 0.0, ..default() }), "stiffness");
        assert_eq!(named(PbdSettings { cell_size: Some(-1.0), ..default() }), "cell_size");
        assert_eq!(named(PbdSettings { threads: Some(0), ..default() }), "threads");
        assert_eq!(named(PbdSettings { iterations: 1_000_000, ..default() }), "iterations");
    }
}
