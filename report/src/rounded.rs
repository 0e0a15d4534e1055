//! Numbers as reports have them.

use serde::Serialize;

/// Highest and lowest.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MaxMin {
    /// Highest.
    pub max: f64,
    /// Lowest.
    pub min: f64,
}

/// Rounded to 1/1000 of its unit; −0 becomes 0.
pub(super) fn r3(value: f64) -> f64 {
    libm::round(value * 1e3) / 1e3 + 0.0
}

pub(super) fn max_min((max, min): (f64, f64)) -> MaxMin {
    MaxMin {
        max: r3(max),
        min: r3(min),
    }
}
