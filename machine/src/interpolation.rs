//! `[interpolation]`: how positions between the points that are known come about.

use serde::Deserialize;

/// Where the position command of each scan within a distribution period comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Default)]
#[serde(rename_all = "kebab-case")]
pub enum Rows {
    /// The window's own row, exact on the path.
    #[default]
    Exact,
    /// The movement command of the period, split evenly over its scans by the servo as the 1991 source does
    /// (docs/methods/overview.md §2): on the path at the end of each period, on the chord between.
    Even,
}

/// How rows of straight lines are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StraightLines {
    /// Every axis is rounded from the exact place.
    #[default]
    Rounded,
    /// The axis of the largest travel is, the others follow it by integer division with a carried remainder.
    MasterAxis,
}

/// How rows of setpoints are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Interpolation {
    /// Those of straight lines, G0 and G1 (docs/methods/straight-lines.md).
    pub straight_lines: StraightLines,
    /// What the servos make of the rows of a distribution period.
    pub rows: Rows,
}
