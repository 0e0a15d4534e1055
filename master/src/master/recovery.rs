//! After a fault: the machine waits until it can go on, and for whoever may tell it to.

use bus::sample::{Cause, Job, Mode, Roster};
use machine::AfterLoss;

use crate::drives::{DriveState, Drives};

use super::axis_unit::AxisUnit;
use super::homing::HOLD_SCANS;
use super::switching_on::SwitchingOn;
use super::{Master, RunEnd};
use crate::answers::Answers;
use crate::saved::Latches;

/// Longest wait for drives that are being switched on, in s.
const SWITCH_ON_PATIENCE_S: f64 = 5.0;
/// A bridge whose motors have neither moved nor pulled for so long is relaxed, in s.
const RELAX_S: f64 = 0.3;

impl<D: Drives> Master<D> {
    /// Goes on where a master before this one left: drives off, positions as the encoders say, the place on the path
    /// known. Called before the first scan.
    pub fn resume(&mut self, latches: &Latches) {
        self.windows.restore(&latches.left);
        self.program_start = latches.program_start;
        self.override_percent = latches.override_percent.min(self.override_max_percent);
        self.hold = latches.hold == 1;
        self.overrun_scans = latches.overrun_scans;
        self.may_end = latches.may_end == 1;
        if latches.ends == 1 {
            self.run_end = RunEnd::AfterProgram;
            self.ordered_to_end = true;
            self.may_end = true;
        }
        self.program.resume(latches);
        self.auxiliary.resume(&latches.auxiliary);
        self.auxiliary.questions.resume(&latches.questions);
        self.resume_homing(&latches.homing);
        self.digest.resume(latches.digest);
        self.mode = Mode::Disabled;
        self.switching_on = None;
        self.cause = Cause::MasterLost;
        self.cause_scan = self.scan;
    }

    /// What must outlive this master after the scan in progress.
    pub fn latches(&self) -> Latches {
        let (typed, typed_before) = self.program.typed_latches();
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
            ends: u32::from(self.ordered_to_end),
            load: self.program.load,
            program: self.program.state as u32,
            run: self.program.run,
            hold: u32::from(self.hold),
            typed,
            typed_before,
            auxiliary: self.auxiliary.latches,
            questions: self.auxiliary.questions.latches,
            homing: self.homing_latches(),
        }
    }

    /// Whether an event of the program was done since this was asked last: it outlives this master before anybody sees it.
    pub fn take_latched(&mut self) -> bool {
        self.auxiliary.take_changed()
    }

    /// Whether the trip was the loss of a process, which another one may replace.
    pub(super) fn lost_a_servo(&self) -> bool {
        self.mode == Mode::Tripped && matches!(self.cause, Cause::ServoLost | Cause::Watchdog)
    }

    /// Whether this trip is one that the run waits in, for a servo to come back and somebody to go on.
    pub(super) fn waits_for_servo(&self) -> bool {
        self.lost_a_servo() && self.restart.servo != AfterLoss::End
    }

    /// Whether a tripped machine could be driven again: all axes stand, and have a servo that follows them and a drive that
    /// follows commands or can be switched on.
    pub(super) fn is_ready_again(&self) -> bool {
        self.is_served_at_rest() && self.drives_can_follow()
    }

    /// Whether all axes stand and have a servo that follows them, whatever their drives show.
    pub(super) fn is_served_at_rest(&self) -> bool {
        let serves = |axis: &AxisUnit| axis.followed && axis.missed_in_a_row == 0;
        self.stands() && self.axes.iter().all(serves)
    }

    /// Whether no drive has a fault or does not answer.
    pub(super) fn drives_can_follow(&self) -> bool {
        self.axes.iter().all(|axis| {
            !matches!(
                axis.drive.state,
                DriveState::Fault { .. } | DriveState::Lost { .. }
            )
        })
    }

    pub(super) fn is_referenced(&self) -> bool {
        let mut axes = self.axes.iter();
        axes.all(|axis| axis.may_be_driven() && axis.is_homed())
    }

    /// A master that starts with drives on waits for those that are off; nobody has held its program.
    pub(super) fn start_with_drives_on(&mut self) {
        if self.drives_can_follow() && !self.drives_follow() {
            let at_start = true;
            self.switching_on = Some(SwitchingOn {
                at_start,
                ..self.switching_on_now(!(self.is_homed() && self.is_within_travel()))
            });
        } else {
            // Its program waits until the axes are homed and within their travel, and somebody says so.
            self.hold |= self.ends() && !(self.is_homed() && self.is_within_travel());
            // A drive that cannot be driven trips in the first scan, with its cause.
            self.mode = match self.run_end {
                RunEnd::AfterProgram => Mode::Enabled,
                RunEnd::WhenOrdered => Mode::Ready,
            };
        }
    }

    fn switching_on_now(&self, hold: bool) -> SwitchingOn {
        SwitchingOn {
            scans: self.scans_of(SWITCH_ON_PATIENCE_S),
            hold,
            at_start: false,
            forgiven: 0,
            awaits_lost: false,
            relaxes: self.must_align(),
            slack_scans: 0,
        }
    }

    fn scans_of(&self, time_s: f64) -> u64 {
        libm::ceil(time_s / self.scan_period_s) as u64
    }

    /// A bit for each axis whose drive has a fault.
    fn faulted(&self) -> u32 {
        let axes = self.axes.iter().enumerate();
        axes.filter(|(_, axis)| matches!(axis.drive.state, DriveState::Fault { .. }))
            .fold(0, |bits, (index, _)| bits | 1 << index)
    }

    /// Drives on: at once where they all follow commands already, otherwise as soon as they do. A trip ends with it.
    pub(super) fn switch_on(&mut self, hold: bool) {
        if self.drives_follow() && !self.must_align() {
            self.end_trip(hold);
            return;
        }
        self.clear_causes();
        if self.mode == Mode::Tripped {
            self.mode = Mode::Disabled;
            for axis in &mut self.axes {
                axis.deviation = 0;
            }
        }
        self.switching_on = Some(SwitchingOn {
            forgiven: self.faulted(),
            awaits_lost: self.axes.iter().any(|axis| axis.drive.state.is_lost()),
            ..self.switching_on_now(hold)
        });
    }

    fn drives_follow(&self) -> bool {
        let mut axes = self.axes.iter();
        axes.all(|axis| axis.drive.state == DriveState::Ready)
    }

    /// One scan of drives that are being switched on: ready when they all follow, off again when one does not in time.
    pub(super) fn await_switching_on(&mut self) {
        let faulted = self.faulted();
        let Some(on) = &mut self.switching_on else {
            return;
        };
        on.scans = on.scans.saturating_sub(1);
        on.forgiven &= faulted;
        let on = *on;
        if on.relaxes && !self.axes.iter().any(|axis| axis.drive.state.is_lost()) {
            self.await_slack();
            return;
        }
        let mut axes = self.axes.iter().enumerate();
        let failed = axes.position(|(index, axis)| match axis.drive_cause() {
            Cause::DriveOff => on.scans == 0,
            Cause::DriveFault if on.forgiven >> index & 1 == 1 => on.scans == 0,
            Cause::DriveLost if on.awaits_lost => on.scans == 0,
            cause => cause != Cause::None,
        });
        if let Some(index) = failed {
            let cause = self.axes.get(index).map(AxisUnit::drive_cause);
            self.stay_off(cause.unwrap_or(Cause::DriveOff), index);
        } else if self.drives_follow() {
            self.switching_on = None;
            self.end_trip(on.hold);
        }
    }

    /// One scan of bridges that relax while their motors are let go. Everybody has seen the new positions before a loop is closed.
    fn await_slack(&mut self) {
        let not_slack = self.not_slack();
        let relaxed = self.scans_of(RELAX_S);
        let Some(on) = &mut self.switching_on else {
            return;
        };
        on.slack_scans = match not_slack {
            None => on.slack_scans.saturating_add(1),
            Some(_) => 0,
        };
        if on.slack_scans > relaxed + HOLD_SCANS {
            on.relaxes = false;
        } else if on.slack_scans == relaxed {
            self.align_gantries();
        } else if let Some(index) = not_slack.filter(|_| on.scans == 0) {
            self.stay_off(Cause::DriveOff, index);
        }
    }

    /// Drives that were to be switched on stay off. At the start nobody has asked for it who could ask again: a run ends by it.
    fn stay_off(&mut self, cause: Cause, index: usize) {
        let on = self.switching_on.take();
        if on.is_some_and(|on| on.at_start) {
            self.trip(cause, index as u32);
        } else {
            self.cause = cause;
            self.cause_axis = index as u32;
            self.cause_scan = self.scan + 1;
        }
    }

    /// Ends a trip: drives on, where the axes are. Without a program that was started there is nothing to hold.
    pub(super) fn end_trip(&mut self, hold: bool) {
        self.leave_typed_blocks();
        if self.program.is_running() {
            self.mode = Mode::Enabled;
            self.hold = hold;
        } else {
            self.mode = self.idle_mode();
        }
        self.clear_causes();
        self.forget_torques();
        self.rest_scans = 0;
        self.waited_scans = 0;
    }

    pub(super) fn clear_causes(&mut self) {
        self.cause = Cause::None;
        self.cause_axis = u32::MAX;
        self.cause_scan = 0;
        for axis in &mut self.axes {
            axis.cause = Cause::None;
            axis.fault_code = 0;
            axis.missed_in_a_row = 0;
        }
    }

    /// Where the machine file lets it: goes on by itself once a lost servo is back.
    pub(super) fn go_on_by_itself(&mut self) {
        let resumes = self.restart.servo == AfterLoss::Resume && !self.may_end;
        let ready = self.is_ready_again() && self.is_referenced() && self.is_within_travel();
        if self.lost_a_servo() && resumes && ready {
            self.switch_on(self.hold);
        }
    }

    /// After so many scans without an answer a planner is lost; it is asked once a period.
    pub(super) fn planner_patience_scans(&self) -> u64 {
        u64::from(self.watchdog_scans) + self.period_scans
    }

    /// A planner that is to wait when it is back finds the machine in hold: one that was lost, and one that was silent for longer
    /// than the watchdog.
    pub(super) fn hold_without_planner(&mut self, answers: &Answers, roster: &Roster) {
        let answered = answers.planner.is_some_and(|said| said.scan >= self.scan);
        if answered {
            self.planner_silent_scans = 0;
        } else {
            self.planner_silent_scans = self.planner_silent_scans.saturating_add(1);
        }
        let lost = self.planner_silent_scans >= self.planner_patience_scans()
            || roster
                .find(Job::Planner, 0, 0)
                .is_some_and(|planner| planner.live == 0);
        if lost && self.restart.planner == AfterLoss::Wait && self.mode == Mode::Enabled {
            self.hold = true;
        }
    }
}
