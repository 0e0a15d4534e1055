//! Linear or rotary: what an axis is counted in.

use schemars::JsonSchema;
use serde::Deserialize;

/// Linear or rotary.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AxisKind {
    /// A slide: mm.
    Linear,
    /// A rotary axis: degrees.
    Rotary,
}

impl AxisKind {
    /// Its unit of position.
    pub fn unit(self) -> &'static str {
        match self {
            AxisKind::Linear => "mm",
            AxisKind::Rotary => "deg",
        }
    }

    /// Unit of its deviations, a thousandth of the unit of its positions.
    pub fn deviation_unit(self) -> &'static str {
        match self {
            AxisKind::Linear => "µm",
            AxisKind::Rotary => "mdeg",
        }
    }
}
