//! Start at a line: while its line is latched and no path has begun, the planner's events set the levels of what stands before it, and
//! the last of them says where the path begins. The planned return brings the tool there; the line is forgotten once it is on the path.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::{EventCode, Mode, PathTag, PlannerStatus, Refused};

use super::Master;
use super::orders::Refusal;
use crate::drives::Drives;

/// The line that an order to start names; 0 for the beginning.
pub(super) fn line_of(value: f64) -> Result<u32, Refusal> {
    let is_line = value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value);
    if is_line {
        Ok(value as u32)
    } else {
        Err(Refused::BadValue.into())
    }
}

impl<D: Drives> Master<D> {
    /// Whether the program waits to be begun at a line.
    pub(super) fn seeks_line(&self) -> bool {
        self.auxiliary.latches.start_line != 0 && !self.windows.has_started()
    }

    /// The planner has found the line, and the levels before it are set: the path begins there.
    pub(super) fn heed_start(&mut self, status: &PlannerStatus) {
        let event = &status.event;
        let asks = event.code == EventCode::StartAt as u32
            && self.auxiliary.is_next(event)
            && self.auxiliary.is_of_run(status);
        let may_begin = self.mode == Mode::Enabled && !self.hold && self.seeks_line();
        // It has read the program from where the axes have been since.
        let rests = self.scan.saturating_sub(status.scan) < u64::from(self.rest_scans);
        let events = line_of(event.value);
        let (true, true, true, Ok(events)) = (asks, may_begin, rests, events) else {
            return;
        };
        let place = PathTag {
            distance_mm: 0.0,
            element: event.element,
            dwell_remaining_scans: 0,
        };
        self.windows.begin_at(self.scan, place, status.program_hash);
        for (start, axis) in self.program_start.iter_mut().zip(&self.axes) {
            *start = axis.command_position;
        }
        self.auxiliary.begin_behind(events, self.scan);
    }

    /// On its path the program goes on like any other.
    pub(super) fn end_approach(&mut self) {
        let tag = self.windows.tag_in(self.scan);
        let on_path = tag.is_some_and(|tag| !tag.is_off_path());
        if on_path && self.auxiliary.latches.start_line != 0 {
            self.auxiliary.latches.start_line = 0;
            self.auxiliary.latched();
        }
    }
}
