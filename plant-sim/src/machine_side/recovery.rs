//! After a fault: the machine waits until it can go on, and for whoever may tell it to.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::machine::AfterLoss;
use bus::sample::{Cause, Job, Mode, Roster};

use super::{MachineSide, RunEnd};
use crate::saved::Latches;

impl MachineSide {
    /// Goes on where a machine side before this one left: drives off, positions as the encoders say, the place on the path
    /// known. Called before the first scan.
    pub fn resume(&mut self, latches: &Latches) {
        self.windows.restore(&latches.left);
        self.program_start = latches.program_start;
        self.override_percent = latches.override_percent.min(100);
        self.overrun_scans = latches.overrun_scans;
        self.may_end = latches.may_end == 1;
        if latches.ends == 1 {
            self.run_end = RunEnd::AfterProgram;
            self.told_to_end = true;
            self.may_end = true;
        }
        self.program.resume(latches);
        self.digest.resume(latches.digest);
        self.mode = Mode::Disabled;
        self.cause = Cause::MachineSideLost;
        self.cause_scan = self.scan;
    }

    /// What must outlive this machine side after the scan in progress.
    pub fn latches(&self) -> Latches {
        Latches {
            scan: self.scan,
            digest: self.digest.value(),
            left: self.windows.left(self.scan),
            program_start: self.program_start,
            override_percent: self.override_percent,
            overrun_scans: self.overrun_scans,
            may_end: u32::from(
                self.may_end || self.ends() && matches!(self.mode, Mode::Stopping | Mode::Stopped),
            ),
            ends: u32::from(self.told_to_end),
            load: self.program.load,
            program: self.program.state as u32,
            run: self.program.run,
            reserved: 0,
        }
    }

    /// Whether the trip was the loss of a process, which another one may replace.
    pub(super) fn lost_a_servo(&self) -> bool {
        self.mode == Mode::Tripped && matches!(self.cause, Cause::ServoLost | Cause::Watchdog)
    }

    /// Whether this trip is one that the run waits in, for a servo to come back and somebody to go on.
    pub(super) fn waits_for_servo(&self) -> bool {
        self.lost_a_servo() && self.restart.servo != AfterLoss::End
    }

    /// Whether a tripped machine could be driven again: all axes stand, within their travel, and have a servo that follows them.
    pub(super) fn is_ready_again(&self) -> bool {
        self.stands()
            && self
                .axes
                .iter()
                .all(|axis| axis.followed && axis.missed_in_a_row == 0 && axis.is_within_travel())
    }

    /// Ends a trip: drives on, where the axes stand. Without a program that was begun there is nothing to hold.
    pub(super) fn end_trip(&mut self, hold: bool) {
        if self.program.is_begun() {
            self.mode = Mode::Enabled;
            self.hold = hold;
        } else {
            self.mode = self.idle_mode();
        }
        self.cause = Cause::None;
        self.cause_axis = u32::MAX;
        self.cause_scan = 0;
        self.rest_scans = 0;
        self.waited_scans = 0;
        for axis in &mut self.axes {
            axis.cause = Cause::None;
            axis.missed_in_a_row = 0;
        }
    }

    /// Where the machine file lets it: goes on by itself once a lost servo is back.
    pub(super) fn go_on_by_itself(&mut self) {
        let resumes = self.restart.servo == AfterLoss::Resume && !self.may_end;
        if self.lost_a_servo() && resumes && self.is_ready_again() {
            self.end_trip(self.hold);
        }
    }

    /// A lost planner that is to wait when it is back finds the machine in hold.
    pub(super) fn hold_without_planner(&mut self, roster: &Roster) {
        let lost = roster
            .find(Job::Planner, 0, 0)
            .is_some_and(|planner| planner.live == 0);
        if lost && self.restart.planner == AfterLoss::Wait && self.mode == Mode::Enabled {
            self.hold = true;
        }
    }
}
