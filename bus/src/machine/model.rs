//! What an axis has to move: the controller's own model of its mechanics.

use serde::Deserialize;

use super::Axis;
use crate::settings_file::{At, From, Rules};

/// Mass and friction of one axis as felt at the table. Optional in the machine file; methods that reckon with torque need it.
///
/// Rotary axes use the same keys with a thousand degrees in place of the metre.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisModel {
    /// Total moved mass: motor and screw (inertia · (2π/lead)²) and table, in kg.
    pub mass_kg: f64,
    /// Coulomb friction of motor and table together, in N.
    pub coulomb_n: f64,
    /// Viscous friction of motor and table together, in N·s/m.
    #[serde(default)]
    pub viscous_n_s_per_m: f64,
}

impl Axis {
    /// Force at the table that the motor's continuous torque makes: T·2π/lead, in N.
    pub fn rated_force_n(&self) -> f64 {
        self.motor.rated_torque_nm * std::f64::consts::TAU / (self.lead_mm * 1e-3)
    }
}

/// Checks the table of one axis, if it has one.
pub(super) fn judge(rules: &mut Rules, axis: &Axis, at: At) {
    let Some(model) = &axis.model else { return };
    for (key, value, unit, from, high) in [
        ("mass_kg", model.mass_kg, "kg", From::Above(0.0), 1e6),
        ("coulomb_n", model.coulomb_n, "N", From::AtLeast(0.0), 1e6),
        (
            "viscous_n_s_per_m",
            model.viscous_n_s_per_m,
            "N·s/m",
            From::AtLeast(0.0),
            1e7,
        ),
    ] {
        rules.range(&["model", key], at, value, unit, from, high);
    }
    let rated_n = axis.rated_force_n();
    if model.coulomb_n >= rated_n {
        rules.say(
            &["model", "coulomb_n"],
            at,
            &format!(
                "= {} N: must be below {rated_n:.0} N, the force of rated_torque_nm = {} N·m on a lead of {} mm",
                model.coulomb_n, axis.motor.rated_torque_nm, axis.lead_mm
            ),
        );
    }
}
