//! `[interpolation]`: how positions between the points that are known come about.

use schemars::JsonSchema;
use serde::Deserialize;

/// How setpoints are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct Interpolation {
    /// How the setpoints of straight lines, G0 and G1, are made ([method](../methods/straight-lines.md)).
    #[schemars(extend("default" = "rounded"))]
    pub straight_lines: StraightLines,
    /// Where the position command of each scan within an interpolation period comes from.
    #[schemars(extend("default" = "exact"))]
    pub within_period: WithinPeriod,
}

/// How setpoints of straight lines are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StraightLines {
    /// Every axis is rounded from the exact place.
    Rounded,
    /// The axis with the largest travel is rounded from the exact place, the others follow it by integer division with a carried remainder.
    MasterAxis,
}

/// Where the position command of each scan within an interpolation period comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WithinPeriod {
    /// The window's own setpoint, exact on the path.
    Exact,
    /// Linear interpolation: the movement command of the period, split evenly over its scans by the servo as the 1991 source does; on
    /// the path at the end of each period, on the chord between.
    Linear,
}
