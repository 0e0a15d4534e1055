//! `[positioning]`: how single rapids are travelled.

use schemars::JsonSchema;
use serde::Deserialize;

/// High-frequency positioning (docs/methods/positioning.md).
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct Positioning {
    /// The motion of a rapid from rest to rest.
    #[schemars(extend("default" = "constant-acceleration"))]
    pub profile: RapidProfile,
}

/// The motion of a rapid from rest to rest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RapidProfile {
    /// As fast as the limits of speed and acceleration allow, in phases of constant acceleration.
    ConstantAcceleration,
    /// With the least copper heat, in the time in which no motor is above its continuous rating. Needs `[axis.model]` of every linear axis.
    MinimumHeat,
}
