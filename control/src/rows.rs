//! How a place of the path becomes a row of whole increments: the one border between the two.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::panic
)]

use crate::kinematics::Kinematics;
use crate::limits::MotionLimits;
use crate::line::StraightLine;
use crate::path::{Element, MAX_AXES, Shape};

/// How rows of straight elements are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StraightLines {
    /// Every axis is rounded from the exact place by itself: at most half an increment off.
    #[default]
    Rounded,
    /// The axis of the largest travel is rounded, the others follow it by division with a carried remainder
    /// ([`StraightLine`]): less than an increment behind the line between the rounded ends.
    MasterAxis,
}

/// How rows are made.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RowSettings {
    /// Of lines.
    pub straight_lines: StraightLines,
    /// How the axes carry the tool.
    pub kinematics: Kinematics,
}

impl RowSettings {
    /// Whether the rows of an element follow a master axis.
    pub(crate) fn follow_master(&self, element: &Element) -> bool {
        self.straight_lines == StraightLines::MasterAxis
            && matches!(element.shape, Shape::Line { .. })
    }

    /// Furthest that a row can be from the exact place of its tag, in increments.
    ///
    /// Rounded: a half. With a master axis, at worst: a half by rounding the ends of the line, one because the master is
    /// rounded against them (a half each, times a slope of at most 1), and one by which slaves lag.
    pub(crate) fn off_place_increments(&self) -> f64 {
        match self.straight_lines {
            StraightLines::Rounded => 0.5,
            StraightLines::MasterAxis => 2.5,
        }
    }
}

impl MotionLimits {
    /// The row of the place `distance_mm` along an element, in increments; 0 for unused axes. A pure function of both: any
    /// planner makes the same row there.
    pub fn row(&self, element: &Element, distance_mm: f64) -> [i64; MAX_AXES] {
        let rows = self.rows();
        let axes = rows.kinematics.axes(&element.point(distance_mm));
        let rounded = self.increments(&axes);
        if !rows.follow_master(element) {
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
