//! What the machine is in and why: the mode, the cause of a stop, the hold, and whether the run ends. Nothing else changes them.

use bus::sample::{Cause, EndedRun, Feedback, HoldReason, Mode, Order, RunOutcome};
use machine::Machine;

use super::RunEnd;
use crate::saved::Latches;

/// Longest wait for the in-position window at the programmed end, in s.
const IN_POSITION_PATIENCE_S: f64 = 5.0;

/// Why a cell ends, in [`Latches::ends`]: it was ordered to, or that is for the loss of a process.
const ORDERED: u32 = 1;
const FOR_LOSS: u32 = 2;

/// Why the machine has stopped, or an order was given up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Reason {
    cause: Cause,
    /// Axis of the cause; the largest number for none.
    axis: u32,
    /// First scan whose feedback shows it.
    scan: u64,
}

impl Reason {
    const NONE: Reason = Reason {
        cause: Cause::None,
        axis: u32::MAX,
        scan: 0,
    };
}

/// The mode, its reason, the hold, and the end of the run.
#[derive(Debug, Clone)]
pub(super) struct Modes {
    mode: Mode,
    reason: Reason,
    hold: HoldReason,
    override_percent: u32,
    override_max_percent: u32,
    /// Mode that a motion by hand began in and goes back to.
    jog_from: Mode,
    run_end: RunEnd,
    /// A machine without drives, or one that has tripped, was ordered to stop: the run may end.
    may_end: bool,
    /// The cell was ordered to end, or its launcher is gone: nothing brings it back.
    ordered_to_end: bool,
    /// It was because a process is lost.
    ends_for_loss: bool,
    /// The feedback of this scan is the last.
    last: bool,
    /// Scans at rest at the end of a program or run, and the number after which that is left.
    settled_scans: u32,
    settle_scans: u32,
    /// Scans on the way into the in-position windows, and the longest wait.
    waited_scans: u32,
    in_position_patience_scans: u32,
    /// Scans that the command has been at rest and the axes have stood, in a row.
    rest_scans: u32,
    /// Number of them that make the machine be at rest: the feed-forward has run out by then.
    rest_scans_min: u32,
}

impl Modes {
    /// Drives off, nothing held.
    pub fn new(machine: &Machine, run_end: RunEnd) -> Modes {
        Modes {
            mode: Mode::Disabled,
            reason: Reason::NONE,
            hold: HoldReason::None,
            override_percent: 100,
            override_max_percent: machine.path.feed_override_max_percent,
            jog_from: Mode::Enabled,
            run_end,
            may_end: false,
            ordered_to_end: false,
            ends_for_loss: false,
            last: false,
            settled_scans: 0,
            settle_scans: machine.scan.settle_scans,
            waited_scans: 0,
            in_position_patience_scans: (IN_POSITION_PATIENCE_S / machine.scan_period_s()) as u32,
            rest_scans: 0,
            rest_scans_min: machine.intended_setpoints(),
        }
    }

    /// Goes on where a master before this one left, which is the cause: drives off.
    pub fn resume(&mut self, latches: &Latches, scan: u64) {
        self.override_percent = latches.override_percent.min(self.override_max_percent);
        self.hold = HoldReason::from_wire(latches.hold).unwrap_or(HoldReason::Order);
        self.may_end = latches.may_end == 1;
        if latches.ends != 0 {
            self.order_end(latches.ends == FOR_LOSS);
            self.may_end = true;
        }
        self.mode = Mode::Disabled;
        self.reason.cause = Cause::MasterLost;
        self.reason.scan = scan;
    }

    /// What must outlive this master.
    pub fn latch(&self, latches: &mut Latches) {
        let stops = matches!(self.mode, Mode::Stopping | Mode::Stopped);
        latches.override_percent = self.override_percent;
        latches.hold = self.hold as u32;
        latches.may_end = u32::from(self.may_end || self.ends() && stops);
        latches.ends = match (self.ordered_to_end, self.ends_for_loss) {
            (false, _) => 0,
            (true, false) => ORDERED,
            (true, true) => FOR_LOSS,
        };
    }

    /// What everybody obeys.
    pub fn tell(&self, feedback: &mut Feedback) {
        feedback.mode = self.mode as u32;
        feedback.cause = self.reason.cause as u32;
        feedback.cause_axis = self.reason.axis;
        feedback.cause_scan = self.reason.scan;
        feedback.override_percent = self.override_percent;
        feedback.hold = u32::from(self.is_held());
        feedback.hold_reason = self.hold as u32;
        feedback.last = u32::from(self.last);
        feedback.rested = u32::from(self.has_rested());
    }

    pub fn mode(&self) -> Mode {
        self.mode
    }

    pub fn cause(&self) -> Cause {
        self.reason.cause
    }

    pub fn is_held(&self) -> bool {
        self.hold != HoldReason::None
    }

    /// Whether a program's path may go on.
    pub fn runs(&self) -> bool {
        self.mode == Mode::Enabled && !self.is_held()
    }

    pub fn override_percent(&self) -> u32 {
        self.override_percent
    }

    /// The feed override, in percent; false beyond what the machine allows.
    pub fn set_override(&mut self, percent: f64) -> bool {
        let fits = (0.0..=f64::from(self.override_max_percent)).contains(&percent);
        if fits {
            self.override_percent = percent as u32;
        }
        fits
    }

    /// The feed override by a knob, in percent: as much of it as the machine allows.
    pub fn turn_override(&mut self, percent: f64) {
        let most = f64::from(self.override_max_percent);
        self.override_percent = percent.clamp(0.0, most) as u32;
    }

    pub fn enter(&mut self, mode: Mode) {
        self.mode = mode;
    }

    /// Feed hold; one that is in force keeps its reason.
    pub fn hold(&mut self, reason: HoldReason) {
        if !self.is_held() {
            self.hold = reason;
        }
    }

    pub fn release(&mut self) {
        self.hold = HoldReason::None;
    }

    /// Shows why something is not done, from the feedback of the next scan on.
    pub fn blame(&mut self, cause: Cause, axis: u32, scan: u64) {
        self.reason = Reason {
            cause,
            axis,
            scan: scan + 1,
        };
    }

    /// The causes among these, and where they were, are shown no more.
    pub fn forget(&mut self, causes: &[Cause]) {
        if causes.contains(&self.reason.cause) {
            self.clear_cause();
        }
    }

    pub fn clear_cause(&mut self) {
        self.reason = Reason::NONE;
    }

    /// Trips for this cause; false where it has already.
    pub fn trip(&mut self, cause: Cause, axis: u32, scan: u64) -> bool {
        if self.mode == Mode::Tripped {
            return false;
        }
        // A machine that was ordered to stop and trips on the way to rest need not wait for anybody.
        let stops = matches!(self.mode, Mode::Stopping | Mode::Stopped);
        self.may_end = self.ordered_to_end || self.ends() && stops;
        self.mode = Mode::Tripped;
        self.blame(cause, axis, scan);
        self.settled_scans = 0;
        true
    }

    /// A servo's loss, which another servo may replace, is the cause of the trip.
    pub fn lost_a_servo(&self) -> bool {
        self.mode == Mode::Tripped
            && matches!(self.reason.cause, Cause::ServoLost | Cause::Watchdog)
    }

    /// Whether the cell ends once the machine is done.
    pub fn ends(&self) -> bool {
        self.run_end == RunEnd::AfterProgram
    }

    /// The mode with drives on and no program started.
    pub fn idle(&self) -> Mode {
        if self.ends() {
            Mode::Stopped
        } else {
            Mode::Ready
        }
    }

    /// Drives are on from the first scan.
    pub fn start(&mut self) {
        self.mode = match self.run_end {
            RunEnd::AfterProgram => Mode::Enabled,
            RunEnd::WhenOrdered => Mode::Ready,
        };
    }

    /// A program begins: the wait for its end begins with it.
    pub fn enable(&mut self) {
        self.mode = Mode::Enabled;
        self.waited_scans = 0;
    }

    /// Drives are on again for the program that was started, in hold or not.
    pub fn go_on(&mut self, hold: bool) {
        self.mode = Mode::Enabled;
        match hold {
            true => self.hold(HoldReason::Order),
            false => self.release(),
        }
    }

    /// Drives go off as ordered; the run goes on.
    pub fn disable(&mut self) {
        self.mode = Mode::Disabled;
        self.may_end = false;
    }

    /// A loop was closed: at rest is what has been so since.
    pub fn begin_anew(&mut self) {
        self.rest_scans = 0;
        self.waited_scans = 0;
    }

    /// Axes begin to be moved by hand.
    pub fn begin_jog(&mut self) {
        self.jog_from = self.mode;
        self.mode = Mode::Jogging;
    }

    /// Nothing is moved by hand any more.
    pub fn end_jog(&mut self) {
        if self.mode == Mode::Jogging {
            self.mode = self.jog_from;
            self.rest_scans = 0;
        }
    }

    pub fn jog_from(&self) -> Mode {
        self.jog_from
    }

    /// A stop was ordered with the drives off or in a trip: a run ends, and in a cell that stays up nothing goes on by itself.
    pub fn stop_standing(&mut self) {
        self.may_end = self.ends();
        if !self.ends() {
            self.hold(HoldReason::Order);
        }
    }

    /// The run may end where it ends at all.
    pub fn let_end(&mut self) {
        self.may_end |= self.ends();
    }

    pub fn may_end(&self) -> bool {
        self.may_end
    }

    /// The run goes on.
    pub fn keep(&mut self) {
        self.may_end = false;
    }

    /// The run ends, also of a cell that stays up; nothing takes that back.
    pub fn order_end(&mut self, for_loss: bool) {
        self.run_end = RunEnd::AfterProgram;
        self.ordered_to_end = true;
        self.ends_for_loss |= for_loss;
    }

    /// How a run that ends now does, in its last scan and by this order if by one.
    pub fn end_run(&self, scan: u64, order: Option<Order>) -> EndedRun {
        let outcome = match (self.mode, self.reason.cause) {
            (Mode::Finished, _) => RunOutcome::Completed,
            (_, Cause::None) if !self.ends_for_loss => RunOutcome::Interrupted,
            _ => RunOutcome::Stopped,
        };
        EndedRun {
            scan,
            cause_scan: self.reason.scan,
            outcome: outcome as u32,
            mode: self.mode as u32,
            cause: self.reason.cause as u32,
            cause_axis: self.reason.axis,
            order: order.map_or(0, |order| order as u32),
            ..EndedRun::default()
        }
    }

    pub fn is_ordered_to_end(&self) -> bool {
        self.ordered_to_end
    }

    pub fn is_last(&self) -> bool {
        self.last
    }

    /// The trip was acknowledged: what comes to rest next settles from then on.
    pub fn acknowledge(&mut self) {
        self.settled_scans = 0;
    }

    /// One scan of standing at the end of a program or run, or not.
    pub fn settle(&mut self, stands: bool) {
        self.settled_scans = if stands {
            self.settled_scans.saturating_add(1)
        } else {
            0
        };
        self.last |= self.ends() && self.has_settled();
    }

    pub fn has_settled(&self) -> bool {
        self.settled_scans > self.settle_scans
    }

    /// One scan at rest, or not.
    pub fn rest(&mut self, at_rest: bool) {
        self.rest_scans = if at_rest {
            self.rest_scans.saturating_add(1)
        } else {
            0
        };
    }

    pub fn has_rested(&self) -> bool {
        self.rest_scans >= self.rest_scans_min
    }

    pub fn rest_scans(&self) -> u32 {
        self.rest_scans
    }

    /// One scan at the programmed end, and whether an axis is not in position yet: finished once none is, and true where one never
    /// comes.
    pub fn await_position(&mut self, out_of_position: bool) -> bool {
        self.waited_scans += 1;
        if !out_of_position {
            self.mode = Mode::Finished;
        }
        out_of_position && self.waited_scans > self.in_position_patience_scans
    }

    /// What a later scan depends on beside what is told: scans settled and waited, scans at rest, whether the run ends.
    pub fn inner(&self) -> ([u32; 2], u32, [bool; 4]) {
        (
            [self.settled_scans, self.waited_scans],
            self.rest_scans.min(self.rest_scans_min),
            [self.may_end, self.ordered_to_end, self.ends(), self.last],
        )
    }
}
