//! How a place of the path becomes a setpoint of whole increments: the one border between the two.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic
)]

use crate::limits::MotionLimits;
use crate::line::StraightLine;
use crate::path::{Element, MAX_AXES};

impl MotionLimits {
    /// The setpoint of the place `distance_mm` along an element, in increments; 0 for unused axes. A pure function of both: any
    /// planner makes the same setpoint there.
    pub fn setpoint(&self, element: &Element, distance_mm: f64) -> [i64; MAX_AXES] {
        let setpoints = self.setpoints();
        let axes = setpoints.kinematics.axes(&element.point(distance_mm));
        let rounded = self.increments(&axes);
        if !setpoints.follow_master(element) {
            return rounded;
        }
        let line = self.line(element);
        line.at_master(rounded.get(line.master()).copied().unwrap_or(0))
    }

    /// The line between the rounded ends of a straight element.
    pub(crate) fn line(&self, element: &Element) -> StraightLine {
        StraightLine::new(
            self.increments(&element.start()),
            self.increments(&element.end()),
        )
    }
}
