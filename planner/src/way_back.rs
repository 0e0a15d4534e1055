//! The way back to where the path was left: a straight line at a reduced feed, then a moment to settle.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::machine::{AxisKind, Machine};
use bus::sample::MAX_AXES;
use control::path::{ALL_LINEAR, AxisVector, Element, Feed, Path, Shape};
use control::profile::PathState;
use control::window::WindowPlanner;

use crate::course::{CourseError, point_of, window_planner};

/// The machine stands so long at the place, in s, before the program goes on: ten time constants of a position loop of
/// 50/s, so that what the return left is gone before the path is measured again.
const SETTLE_S: f64 = 0.2;

/// A planned return.
#[derive(Debug)]
pub(crate) struct WayBack {
    /// Command registers it starts from, in increments.
    pub from: [i64; MAX_AXES],
    /// State of the program it leads to.
    pub to: PathState,
    /// Plans along it.
    pub windows: WindowPlanner,
}

impl WayBack {
    /// From the registers to the place of `to`, which is `point`. Both ends are within the travel, so is the line.
    pub fn new(
        machine: &Machine,
        from: [i64; MAX_AXES],
        to: PathState,
        point: AxisVector,
    ) -> Result<WayBack, CourseError> {
        let mut rotary = ALL_LINEAR;
        for (is_rotary, axis) in rotary.iter_mut().zip(&machine.axes) {
            *is_rotary = axis.kind == AxisKind::Rotary;
        }
        let start = point_of(machine, &from);
        let line = Shape::Line {
            from: start,
            to: point,
        };
        let feed = Feed::PathMmS(machine.manual.return_mm_s);
        let path = Path {
            elements: vec![
                Element::new(0, line, feed, &rotary),
                Element::dwell(0, point, SETTLE_S),
            ],
        };
        Ok(WayBack {
            from,
            to,
            windows: window_planner(machine, path, start)?,
        })
    }
}
