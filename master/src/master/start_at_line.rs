//! Start at a line: while its line is latched and no path has started, the planner's events set the levels of what stands before it, and
//! the last of them says where the path begins. The planned return brings the tool there; the line is forgotten once it is on the path.

use bus::sample::{EventCode, PathTag, PlannerStatus};

use super::Master;
use super::orders::whole_number;
use crate::drives::Drives;

impl<D: Drives> Master<D> {
    /// Whether the program waits to be started at a line.
    pub(super) fn seeks_line(&self) -> bool {
        self.auxiliary.seeks_line() && !self.windows.has_started()
    }

    /// The planner has found the line, and the levels before it are set: the path begins there.
    pub(super) fn heed_start(&mut self, status: &PlannerStatus) {
        let event = &status.event;
        let asks = event.code == EventCode::StartAt as u32
            && self.auxiliary.is_next(event)
            && self.auxiliary.is_of_run(status);
        let may_begin = self.modes.runs() && self.seeks_line();
        // It has read the program from where the axes have been since.
        let rests = self.scan.saturating_sub(status.scan) < u64::from(self.modes.rest_scans());
        if !asks || !may_begin || !rests {
            return;
        }
        let Ok(events) = whole_number(event.value) else {
            return;
        };
        let place = PathTag {
            distance_mm: 0.0,
            element: event.element,
            dwell_remaining_scans: 0,
        };
        self.windows.begin_at(self.scan, place, status.program_hash);
        self.start_program_here();
        self.auxiliary.begin_behind(events, self.scan);
    }

    /// On its path the program goes on like any other.
    pub(super) fn end_approach(&mut self) {
        if self.windows.is_on_path(self.scan) {
            self.auxiliary.reach_line();
        }
    }
}
