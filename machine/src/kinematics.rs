//! `[kinematics]`: how the axes carry the tool.

use schemars::JsonSchema;
use serde::Deserialize;

use crate::axis::Axis;

/// How the axes carry the tool (docs/methods/pivot-axis.md).
#[derive(Debug, Clone, PartialEq, Deserialize, JsonSchema)]
pub struct Kinematics {
    /// Which machine it is.
    #[serde(rename = "type")]
    pub kind: KinematicsKind,
    /// The linear axis that takes back what the rotation does to X.
    #[schemars(extend("default" = "X"))]
    pub slide_axis: String,
    /// The rotary axis of the arm.
    #[schemars(extend("default" = "B"))]
    pub arm_axis: String,
    /// Length L of the arm, from its axis to the tool.
    #[schemars(extend("unit" = "mm", "minimum" = 1, "maximum" = 10_000))]
    pub arm_length_mm: f64,
    /// Lowest angle of the arm, within the travel of its axis; 0 along X. At 85° the arm turns 11 times as fast for the same Y as at
    /// 0, and the slide's correction bends 1500 times as much.
    #[schemars(extend("unit" = "°", "minimum" = -85, "maximum" = 85))]
    pub arm_min_deg: f64,
    /// Highest angle of the arm, above the lowest and within the travel of its axis.
    #[schemars(extend("unit" = "°", "minimum" = -85, "maximum" = 85))]
    pub arm_max_deg: f64,
    /// What the slide under X carries.
    pub carries: Carries,
}

/// Kinds of kinematics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum KinematicsKind {
    /// A swing arm about an axis parallel to Z is in the place of Y.
    PivotY,
}

/// What the slide under X carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Carries {
    /// The arm.
    Arm,
    /// The work; X counts the motion of the slide.
    Work,
}

impl Kinematics {
    /// Index of the slide among the machine's axes.
    pub fn slide_index(&self, axes: &[Axis]) -> Option<usize> {
        axes.iter().position(|axis| axis.name == self.slide_axis)
    }

    /// Index of the arm's axis among the machine's axes.
    pub fn arm_index(&self, axes: &[Axis]) -> Option<usize> {
        axes.iter().position(|axis| axis.name == self.arm_axis)
    }
}
