//! Numbers as reports have them.

use serde::{Serialize, Serializer};

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

/// A length in mm as a number of µm, rounded.
pub(super) fn um(mm: f64) -> f64 {
    r3(mm * 1e3)
}

/// Writes a number, or none, rounded.
pub(crate) fn write_r3<S: Serializer>(
    number: &(impl Copy + Into<Option<f64>>),
    to: S,
) -> Result<S::Ok, S::Error> {
    let number: Option<f64> = (*number).into();
    number.map(r3).serialize(to)
}

/// Writes a length in mm, or none, as µm, rounded.
pub(crate) fn write_um<S: Serializer>(
    mm: &(impl Copy + Into<Option<f64>>),
    to: S,
) -> Result<S::Ok, S::Error> {
    let mm: Option<f64> = (*mm).into();
    mm.map(um).serialize(to)
}

pub(super) fn max_min((max, min): (f64, f64)) -> MaxMin {
    MaxMin {
        max: r3(max),
        min: r3(min),
    }
}
