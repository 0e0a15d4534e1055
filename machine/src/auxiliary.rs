//! `[spindle]` and `[tool_change]`: what a machine has beside its axes (docs/howto/spindle.md).

use schemars::JsonSchema;
use serde::Deserialize;

/// Of [`Spindle::ramp_rpm_s`], what rapid changes of speed in step ask for; the rest makes up for loads.
pub const SPINDLE_RAMP_SHARE: f64 = 0.75;

/// The spindle.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize, JsonSchema)]
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
    /// Counts of its encoder in one turn, with an index; 0 without an encoder. Threads (G33, G76) and rigid tapping (G33.1, G84, G74)
    /// need one ([threads and taps](../howto/spindle.md#threads-and-taps)).
    #[schemars(extend("unit" = "counts", "minimum" = 0, "maximum" = 1_000_000_000, "default" = 0))]
    pub encoder_counts_per_turn: u32,
    /// How fast it surely speeds up and brakes. While it taps, it is asked for three quarters of it.
    #[schemars(extend("unit" = "rev/min/s", "minimum" = 1, "maximum" = 1_000_000, "default" = 1000.0))]
    pub ramp_rpm_s: f64,
    /// While it taps: speed at which it makes up for a turn that it lags behind the axis, per turn.
    #[schemars(extend("unit" = "1/s", "exclusiveMinimum" = 0, "maximum" = 1000, "default" = 50.0))]
    pub follow_gain_per_s: f64,
    /// While it taps: lag behind the axis, or lead, at which the machine trips.
    #[schemars(extend("unit" = "°", "exclusiveMinimum" = 0, "maximum" = 360, "default" = 45.0))]
    pub follow_limit_deg: f64,
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
pub struct ToolChange {
    /// Who puts the tool into the spindle.
    #[schemars(extend("default" = "operator"))]
    pub by: ToolChanger,
    /// Longest wait for a changer; after it the machine trips.
    #[schemars(extend("unit" = "s", "exclusiveMinimum" = 0, "maximum" = 3600, "default" = 60.0))]
    pub patience_s: f64,
}
