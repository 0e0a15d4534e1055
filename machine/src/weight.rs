//! `[axis.gravity]` and `[axis.brake]`: an axis that would fall without torque, and what holds it when its drive is off
//! (docs/howto/vertical-axis.md).

use schemars::JsonSchema;
use serde::Deserialize;

/// Standard acceleration of free fall, in m/s² (ISO 80000-3).
pub const FREE_FALL_M_S2: f64 = 9.806_65;

/// The force with which weight pulls the axis, towards lower positions where it is above 0: `force_n`, or `mass_kg` with what a
/// counterweight, a spring or a cylinder holds of it.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct Gravity {
    /// The force as it is felt at the table, in place of `mass_kg`; `quadrant tune` identifies it.
    #[schemars(extend("unit" = "N", "minimum" = -1_000_000, "maximum" = 1_000_000))]
    pub force_n: Option<f64>,
    /// Mass that hangs.
    #[schemars(extend("unit" = "kg", "minimum" = 0, "maximum" = 100_000))]
    pub mass_kg: Option<f64>,
    /// Force that holds against the weight of `mass_kg`.
    #[schemars(extend("unit" = "N", "minimum" = 0, "maximum" = 1_000_000, "default" = 0.0))]
    pub counterbalance_n: f64,
}

/// The holding brake of the motor. It holds an axis that stands, and stops one that moves only where its drive has no power left.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct Brake {
    /// From the command to a brake that is open: until then the drive must not move the axis.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 2000, "default" = 60.0))]
    pub opening_ms: f64,
    /// From the command, or the loss of power, to a brake that holds: so long the drive goes on holding the axis.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 2000, "default" = 30.0))]
    pub closing_ms: f64,
    /// Who opens and closes it.
    #[schemars(extend("default" = "drive"))]
    pub by: BrakeBy,
}

/// Who opens and closes a brake.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum BrakeBy {
    /// The drive, by itself, when it is switched on and off, as most drives do.
    Drive,
    /// The controller, by bit 0 of the drive's physical outputs (CiA 402 object 60FEh).
    Controller,
}

impl Gravity {
    /// The force, in N; above 0 it pulls towards lower positions.
    pub fn pull_n(&self) -> f64 {
        let hanging = self.mass_kg.unwrap_or(0.0);
        let hanging_n = hanging * FREE_FALL_M_S2 - self.counterbalance_n;
        self.force_n.unwrap_or(hanging_n)
    }
}
