//! `[[rotary_line]]`: the lines in space about which rotary axes turn, for G43.4 (docs/methods/five-axes.md).

use schemars::JsonSchema;
use serde::Deserialize;

/// A rotary axis as a line in space.
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct RotaryLine {
    /// The rotary axis, a letter of programs.
    pub axis: String,
    /// What it turns.
    pub carries: Carried,
    /// A point of its line, X Y Z in machine coordinates, with all axes at 0.
    #[schemars(length(min = 3, max = 3), inner(range(min = -100_000, max = 100_000)), extend("unit" = "mm"))]
    pub point_mm: Vec<f64>,
    /// Direction X Y Z of its line, of any length, with all axes at 0: at positive angles the axis turns what it carries right-handed
    /// about it. By ISO 841 a table points against its letter, such as `[-1, 0, 0]` for A: seen from the work, the tool turns positively
    /// about X then.
    #[schemars(length(min = 3, max = 3), inner(range(min = -1000, max = 1000)))]
    pub direction: Vec<f64>,
}

/// What a rotary axis turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Carried {
    /// The work: a table.
    Work,
    /// The tool: a head.
    Tool,
}
