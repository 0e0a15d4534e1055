//! `[axis.prediction]`: the feedback position a little ahead of its sample (docs/methods/overview.md §5).

use serde::Deserialize;

/// Smallest m: five scans ahead. Further ahead a straight line through two samples says nothing.
pub const PREDICTION_M_MIN: f64 = 0.2;
/// Largest m: a hundredth of a scan ahead.
pub const PREDICTION_M_MAX: f64 = 100.0;

/// First-difference prediction of the feedback position; off where the table is absent.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prediction {
    /// Divisor of the first difference: 1/m is the delay that is made up for, in scans.
    pub m: f64,
}
