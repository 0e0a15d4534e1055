//! Loops of an axis, velocity feed-forward, and prediction of the feedback.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Position loop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PositionLoop {
    /// Gain Kp; with `drive_mode = "position"` that of the drive's own loop.
    #[schemars(extend("unit" = "1/s", "exclusiveMinimum" = 0, "maximum" = 1000))]
    pub gain_per_s: f64,
}

/// Velocity loop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct VelocityLoop {
    /// Proportional gain Kv, at the table.
    #[schemars(extend("unit" = "N·s/m", "exclusiveMinimum" = 0, "maximum" = 1_000_000_000))]
    pub gain_n_s_per_m: f64,
    /// Integral time Ti.
    #[schemars(extend("unit" = "ms", "minimum" = 0.1, "maximum" = 10_000))]
    pub integral_time_ms: f64,
    /// Period of the drive's loop; divides `scan.period_us`, and is the same in torque mode.
    #[schemars(extend("unit" = "µs", "minimum" = 1, "maximum" = 2000))]
    pub period_us: u32,
}

/// Velocity feed-forward (docs/methods/overview.md §2).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FeedForward {
    /// On or off.
    #[schemars(extend("default" = true))]
    pub enabled: bool,
    /// Coefficient α.
    #[schemars(extend("minimum" = 0, "maximum" = 1.5, "default" = 1.0))]
    pub coefficient: f64,
    /// How far ahead of the position command it is taken: the delay of everything behind it (transport, drive). At most what the
    /// look-ahead guarantees, (`look_ahead_periods` − ½) interpolation periods.
    #[schemars(extend("unit" = "ms", "minimum" = 0, "maximum" = 1000, "default" = 0.0))]
    pub advance_ms: f64,
}

/// Smallest m: five scans ahead. Further ahead a straight line through two samples says nothing.
pub const PREDICTION_M_MIN: f64 = 0.2;

/// First-difference prediction of the feedback position.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct Prediction {
    /// Divisor of the first difference: 1/m is the delay that is made up for, in scans: from five to a hundredth of one.
    #[schemars(extend("minimum" = PREDICTION_M_MIN, "maximum" = 100))]
    pub m: f64,
}
