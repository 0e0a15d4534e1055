//! `[spindle]` and `[tool_change]`: what a machine has beside its axes (docs/howto/spindle.md).

use schemars::JsonSchema;
use serde::Deserialize;

/// The spindle.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spindle {
    /// Lowest speed that it turns at; a program with an S below it, but for S0, is refused.
    #[schemars(extend("unit" = "rev/min", "minimum" = 0, "maximum" = 1_000_000, "default" = 0.0))]
    pub speed_min_rpm: f64,
    /// Highest speed, at least the lowest; a program with an S above it is refused.
    #[schemars(extend("unit" = "rev/min", "exclusiveMinimum" = 0, "maximum" = 1_000_000))]
    pub speed_max_rpm: f64,
    /// Within so much of its commanded speed it counts as being at its speed: the first feed after M3, M4 or S waits for it.
    #[schemars(extend("unit" = "%", "exclusiveMinimum" = 0, "maximum" = 50, "default" = 5.0))]
    pub at_speed_percent: f64,
    /// Longest wait for its speed, its angle or its standstill; after it the machine trips.
    #[schemars(extend("unit" = "s", "exclusiveMinimum" = 0, "maximum" = 600, "default" = 15.0))]
    pub patience_s: f64,
}

/// Who changes tools.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ToolChanger {
    /// The operator: M6 stops the program, and `resume` says that the tool is in.
    Operator,
    /// A changer, which shows which tool is in the spindle.
    Changer,
}

/// Tool changes.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ToolChange {
    /// Who puts the tool into the spindle.
    #[schemars(extend("default" = "operator"))]
    pub by: ToolChanger,
    /// Longest wait for a changer; after it the machine trips.
    #[schemars(extend("unit" = "s", "exclusiveMinimum" = 0, "maximum" = 3600, "default" = 60.0))]
    pub patience_s: f64,
}
