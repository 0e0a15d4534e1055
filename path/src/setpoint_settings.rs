//! How setpoints are made of a path.
use crate::geometry::{Element, Shape};
use crate::kinematics::Kinematics;
use crate::rounding::RoundingSettings;

/// How setpoints of straight elements are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StraightLines {
    /// Every axis is rounded from the exact place by itself: at most half an increment off.
    #[default]
    Rounded,
    /// The axis of the largest travel is rounded, the others follow it by division with a carried remainder
    /// ([`StraightLine`](crate::line::StraightLine)): less than an increment behind the line between the rounded ends.
    MasterAxis,
}

/// How setpoints are made.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SetpointSettings {
    /// Of lines.
    pub straight_lines: StraightLines,
    /// How the axes carry the tool.
    pub kinematics: Kinematics,
    /// How the path is rounded where the program allows it. Axes that do not move in straight lines travel it exactly.
    pub rounding: RoundingSettings,
    /// Frequency of the machine that motion is not to excite, in Hz.
    pub vibration_hz: Option<f64>,
}

impl SetpointSettings {
    /// Whether the setpoints of an element follow a master axis.
    pub fn follow_master(&self, element: &Element) -> bool {
        self.straight_lines == StraightLines::MasterAxis
            && matches!(element.shape, Shape::Line { .. })
            && element.rounding.is_none()
    }

    /// Furthest that a setpoint can be from the exact place of its tag, in increments.
    ///
    /// Rounded: a half. With a master axis, at worst: a half by rounding the ends of the line, one because the master is
    /// rounded against them (a half each, times a slope of at most 1), and one by which slaves lag.
    pub fn off_place_increments(&self) -> f64 {
        match self.straight_lines {
            StraightLines::Rounded => 0.5,
            StraightLines::MasterAxis => 2.5,
        }
    }
}
