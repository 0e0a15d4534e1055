//! After a fault: the machine waits until it can go on, and for the order to.

use bus::sample::{HoldReason, Mode, Roster};
use bytemuck::Zeroable;

use super::Master;
use super::axis_unit::AxisUnit;
use super::switching_on::SwitchedOn;
use crate::answers::Answers;
use crate::drives::Drives;
use crate::saved::Latches;

impl<D: Drives> Master<D> {
    /// Goes on where a master before this one left: drives off, positions as the encoders say, the place on the path
    /// known. Called before the first scan.
    pub fn resume(&mut self, latches: &Latches) {
        self.windows.restore(&latches.left);
        self.program_start = latches.program_start;
        self.modes.resume(latches, self.scan);
        self.losses.resume(latches.overrun_scans);
        self.program.resume(latches);
        self.auxiliary.resume(&latches.auxiliary);
        self.auxiliary.questions.resume(&latches.questions);
        self.axes.resume_homing(&latches.homing);
        self.geometry.begin(&mut self.axes);
        self.digest.resume(latches.digest);
        self.signals.resume(&latches.signals);
        self.switching_on.cancel();
    }

    /// What must outlive this master after the scan in progress.
    pub fn latches(&self) -> Latches {
        let mut latches = Latches {
            scan: self.scan,
            digest: self.digest.value(),
            left: self.windows.left(self.scan),
            program_start: self.program_start,
            overrun_scans: self.losses.overrun_scans(),
            auxiliary: self.auxiliary.latches(),
            questions: self.auxiliary.questions.latches(),
            homing: self.axes.homing_latches(),
            signals: self.signals.latches(),
            ..Latches::zeroed()
        };
        self.modes.latch(&mut latches);
        self.program.latch(&mut latches);
        latches
    }

    /// Whether an event of the program was done since this was asked last: it outlives this master before anybody sees it.
    pub fn take_latched(&mut self) -> bool {
        self.auxiliary.take_changed()
    }

    /// Whether this trip is one that the run waits in, for a servo to come back and an order to go on.
    pub(super) fn waits_for_servo(&self) -> bool {
        self.modes.lost_a_servo() && self.losses.wait_for_servo()
    }

    /// A master that starts with drives on waits for those that are off; nobody has held its program.
    pub(super) fn start_with_drives_on(&mut self) {
        let waits = !(self.axes.are_homed() && self.axes.are_within_travel());
        if self.axes.drives_can_follow() && !self.axes.drives_follow() {
            let (axes, gantries) = (&self.axes, &self.gantries);
            let scan_s = self.timing.scan_period_s;
            self.switching_on
                .begin_at_start(axes, gantries, scan_s, waits);
        } else {
            // Its program waits until the axes are homed and within their travel, and an order comes.
            if self.modes.ends() && waits {
                self.modes.hold(HoldReason::Start);
            }
            // A drive that cannot be driven trips in the first scan, with its cause.
            self.modes.start();
        }
    }

    /// Drives on: at once where they all follow commands already, otherwise as soon as they do. A trip ends with it; typed-in blocks that
    /// it has stopped are given up while it is known why.
    pub(super) fn switch_on(&mut self, hold: bool) {
        self.leave_typed_blocks();
        if self.axes.drives_follow() && !self.gantries.must_align(&self.axes) {
            self.end_trip(hold);
            return;
        }
        self.clear_causes();
        if self.mode() == Mode::Tripped {
            self.modes.enter(Mode::Disabled);
            self.axes.iter_mut().for_each(AxisUnit::follow_encoder);
        }
        let (axes, gantries) = (&self.axes, &self.gantries);
        let scan_s = self.timing.scan_period_s;
        self.switching_on.begin(axes, gantries, scan_s, hold);
    }

    /// One scan of drives that are being switched on. At the start of a master there is nobody who could ask again: a run ends by a
    /// drive that stays off.
    pub(super) fn await_switching_on(&mut self) {
        let (axes, gantries) = (&mut self.axes, &self.gantries);
        let scan_s = self.timing.scan_period_s;
        match self.switching_on.step(axes, gantries, scan_s) {
            SwitchedOn::NotYet => {}
            SwitchedOn::Done { hold } => self.end_trip(hold),
            SwitchedOn::Failed {
                cause,
                axis,
                at_start,
            } => {
                let axis = axis as u32;
                if at_start {
                    self.trip(cause, axis);
                } else {
                    self.modes.blame(cause, axis, self.scan);
                }
            }
        }
    }

    /// Ends a trip: drives on, where the axes are. Without a program that was started there is nothing to hold.
    fn end_trip(&mut self, hold: bool) {
        if self.program.is_running() {
            self.modes.go_on(hold);
        } else {
            self.modes.enter(self.modes.idle());
        }
        self.clear_causes();
        self.gantries.forget_torques();
        self.modes.begin_anew();
    }

    pub(super) fn clear_causes(&mut self) {
        self.modes.clear_cause();
        self.axes.clear_faults();
    }

    /// Where the machine file lets it: goes on by itself once a lost servo is back.
    pub(super) fn go_on_by_itself(&mut self) {
        let resumes =
            self.modes.lost_a_servo() && self.losses.go_on_with_servo() && !self.modes.may_end();
        let serve = || self.axes.are_served_at_rest() && self.axes.drives_can_follow();
        if resumes && serve() && self.axes.may_run() {
            self.switch_on(self.modes.is_held());
        }
    }

    /// A planner that is to wait when it is back finds the machine in hold.
    pub(super) fn hold_without_planner(&mut self, answers: &Answers, roster: &Roster) {
        let answered = answers.planner.is_some_and(|said| said.scan >= self.scan);
        let holds = self.losses.hold_for_planner(answered, roster);
        if holds && self.mode() == Mode::Enabled {
            self.modes.hold(HoldReason::PlannerLost);
        }
    }

    /// An axis that is without its standby for too long holds the machine where the machine file says so.
    pub(super) fn hold_without_standby(&mut self) {
        if self.mode() == Mode::Enabled && self.losses.hold_for_standby(&mut self.axes) {
            self.modes.hold(HoldReason::StandbyLost);
        }
    }
}
