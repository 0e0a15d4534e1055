//! The master, pure: it latches what the machine does, admits windows, hands commands to the drives and says in
//! the feedback what everybody obeys. Reads no clock and no port: [`cycle`](mod@crate::cycle) brings the answers.

use bus::sample::{
    AxisFeedback, BusCycle, Cause, Driver, Feedback, Instruments, Job, MAX_AXES, Mode, Roster,
    STANDBY_ALARM_S, Setpoint, WindowHeader, WindowId,
};
use bytemuck::Zeroable;
use machine::{Machine, Restart, WithinPeriod};

use crate::answers::Answers;
use crate::digest::MotionDigest;
use crate::drives::{DriveCommand, Drives};
use crate::window_arbiter::{Dropped, WindowArbiter};

mod auxiliary;
mod axis_unit;
mod beginning;
mod coupling;
mod decide;
mod emergency_stop;
mod gantry;
mod hand;
mod homing;
mod inner;
mod jog;
mod loaded;
mod orders;
mod program;
mod questions;
mod recovery;
mod redundancy;
mod silence;
mod single_block;
mod start_at_line;
mod substitute;
mod switch;
mod switching_on;
mod wheel;

use auxiliary::Auxiliary;
use axis_unit::AxisUnit;
pub use beginning::Beginning;
use decide::Plan;
use gantry::Gantry;
use hand::ByOrder;
use homing::Homing;
pub use inner::{Inner, InnerAxis};
use jog::Numbered;
use program::Loaded;
pub use program::RunEnd;
use questions::program_positions;
use silence::NextScan;
use switching_on::SwitchingOn;

/// Speed below which a braked axis counts as standing, in mm/s.
pub const STANDSTILL_MM_S: f64 = 0.5;
/// Longest wait for the in-position window at the programmed end, in s.
const IN_POSITION_PATIENCE_S: f64 = 5.0;
/// The master of a cell, over its drives.
#[derive(Debug, Clone)]
pub struct Master<D> {
    axes: Vec<AxisUnit>,
    /// Axes with two motors.
    gantries: Vec<Gantry>,
    drives: D,
    /// The commands of one scan, by axis.
    drive_commands: Vec<DriveCommand>,
    /// Drives that are being switched on.
    switching_on: Option<SwitchingOn>,
    scan: u64,
    incarnation: u32,
    period_scans: u64,
    /// Between two setpoints nobody interpolates: the command positions are those of the window.
    exact: bool,
    watchdog_scans: u32,
    settle_scans: u32,
    in_position_patience_scans: u32,
    run_end: RunEnd,
    mode: Mode,
    program: Loaded,
    auxiliary: Auxiliary,
    cause: Cause,
    cause_axis: u32,
    cause_scan: u64,
    windows: WindowArbiter,
    hold: bool,
    override_percent: u32,
    override_max_percent: u32,
    settled_scans: u32,
    waited_scans: u32,
    /// Scans the command has been at rest and the axes have stood, in a row.
    rest_scans: u32,
    /// So many of them make the machine be at rest: the feed-forward has run out by then.
    rest_scans_min: u32,
    /// Mode that a motion by hand began in and goes back to.
    jog_from: Mode,
    jog_mm_s: f64,
    /// Increments that were taken.
    numbered: Numbered,
    /// What the order that was judged last did by hand.
    by_order: ByOrder,
    /// Scans that axes stay in the hand.
    hand_on_scans: u64,
    /// Axes that are being homed.
    homing: Option<Homing>,
    scan_period_s: f64,
    /// Somebody has asked a machine without drives, or one that has tripped, to stop: the run may end.
    may_end: bool,
    /// Somebody has reported the cell to end, or its launcher is gone: nothing brings it back.
    ordered_to_end: bool,
    /// What follows when a process is lost.
    restart: Restart,
    /// Scans without a standby that are an alarm.
    standby_alarm_scans: u32,
    /// Scans since the planner answered last.
    planner_silent_scans: u64,
    /// Command positions the program was started from.
    program_start: [i64; MAX_AXES],
    last: bool,
    overrun_scans: u32,
    subsamples: u32,
    digest: MotionDigest,
}

impl<D: Drives> Master<D> {
    /// A master over these drives, whose axes are where the drives show them; drives on from the first scan if `enabled`.
    pub fn new(
        machine: &Machine,
        drives: D,
        incarnation: u32,
        first_scan: u64,
        enabled: bool,
        run_end: RunEnd,
    ) -> Master<D> {
        let axes: Vec<AxisUnit> = machine
            .axes
            .iter()
            .take(drives.count())
            .enumerate()
            .map(|(index, settings)| AxisUnit::new(machine, settings, drives.feedback(index)))
            .collect();
        let mut master = Master {
            drive_commands: vec![DriveCommand::Disabled; axes.len()],
            switching_on: None,
            axes,
            gantries: machine.gantries().map(Gantry::new).collect(),
            drives,
            scan: first_scan,
            incarnation,
            period_scans: u64::from(machine.scan.interpolation_period_scans),
            exact: machine.interpolation.within_period == WithinPeriod::Exact,
            watchdog_scans: machine.scan.watchdog_scans,
            settle_scans: machine.scan.settle_scans,
            in_position_patience_scans: (IN_POSITION_PATIENCE_S / machine.scan_period_s()) as u32,
            run_end,
            mode: Mode::Disabled,
            program: Loaded::new(run_end),
            auxiliary: Auxiliary::new(machine),
            cause: Cause::None,
            cause_axis: u32::MAX,
            cause_scan: 0,
            windows: WindowArbiter::new(),
            hold: false,
            override_percent: 100,
            override_max_percent: machine.path.feed_override_max_percent,
            settled_scans: 0,
            waited_scans: 0,
            rest_scans: 0,
            rest_scans_min: machine.intended_setpoints(),
            jog_from: Mode::Enabled,
            jog_mm_s: machine.manual.jog_mm_s,
            numbered: Numbered::default(),
            by_order: ByOrder::default(),
            hand_on_scans: 0,
            homing: None,
            scan_period_s: machine.scan_period_s(),
            may_end: false,
            ordered_to_end: false,
            restart: match run_end {
                RunEnd::AfterProgram => machine.restart,
                RunEnd::WhenOrdered => machine.restart.of_staying(),
            },
            standby_alarm_scans: (STANDBY_ALARM_S / machine.scan_period_s()) as u32,
            planner_silent_scans: 0,
            program_start: [0; MAX_AXES],
            last: false,
            overrun_scans: 0,
            subsamples: machine.subsamples(),
            digest: MotionDigest::new(),
        };
        master.align_gantries();
        master.couple_gantries();
        if enabled {
            master.start_with_drives_on();
        }
        master
    }

    /// The scan in progress.
    pub fn scan(&self) -> u64 {
        self.scan
    }

    /// Whether the planner is asked in this scan.
    pub fn is_period_boundary(&self) -> bool {
        self.scan.is_multiple_of(self.period_scans)
    }

    /// Whether the feedback of this scan is the last.
    pub fn is_last(&self) -> bool {
        self.last
    }

    /// What everybody obeys in this scan.
    pub fn feedback(&self) -> Feedback {
        let mut feedback = Feedback::zeroed();
        feedback.scan = self.scan;
        feedback.visible_from = self.scan;
        self.windows.tell(self.scan, &mut feedback);
        feedback.program_start = self.program_start;
        feedback.incarnation = self.incarnation;
        feedback.mode = self.mode as u32;
        feedback.cause = self.cause as u32;
        feedback.cause_axis = self.cause_axis;
        feedback.cause_scan = self.cause_scan;
        feedback.override_percent = self.override_percent;
        feedback.hold = u32::from(self.hold);
        feedback.last = u32::from(self.last);
        feedback.overrun_scans = self.overrun_scans;
        feedback.axis_count = self.axes.len() as u32;
        feedback.load = self.program.load;
        feedback.program = self.program.state as u32;
        feedback.run = self.program.run;
        feedback.rested = u32::from(self.rest_scans >= self.rest_scans_min);
        feedback.auxiliary = self.auxiliary.tell();
        feedback.messages = self.auxiliary.latches.messages;
        feedback.answer = self.auxiliary.questions.latches.answer;
        feedback.inputs = self.auxiliary.questions.tell();
        feedback.inputs.panel = self.auxiliary.latches.panel();
        for (out, axis) in feedback.axes.iter_mut().zip(&self.axes) {
            *out = AxisFeedback {
                motor_position: axis.motor_position(),
                scale_position: axis.scale_position(),
                command_position: axis.command_position,
                hand: axis.hand_course(),
                command_scan: axis.command.scan,
                velocity_mm_s: axis.drive.velocity_mm_s,
                velocity_command_mm_s: axis.command.velocity_mm_s,
                torque_nm: axis.drive.torque_nm,
                winding_k: axis.drive.winding_rise_k,
                missed_scans: axis.missed,
                missed_in_a_row: axis.missed_in_a_row,
                taken_incarnation: axis.taken_incarnation,
                taken_role: axis.command.role,
                cause: axis.cause as u32,
                torque_limited: u32::from(axis.drive.torque_limited),
                driver: axis.driver as u32,
                drive_code: axis.fault_code,
                redundancy: axis.standby.state as u32,
                unsynchronised_scans: axis.standby.unsynchronised_scans,
                differences: axis.standby.differences,
                reference: axis.reference as u32,
            };
        }
        feedback
    }

    /// Hands the commands in force to the drives and takes what they show at the end of this scan; the instruments'
    /// readings of it.
    pub fn exchange(&mut self) -> Instruments {
        let mut out = Instruments::zeroed();
        out.scan = self.scan;
        out.visible_from = self.scan + 1;
        out.subsamples = self.subsamples;
        out.axis_count = self.axes.len() as u32;
        let (window, setpoint) = self.windows.in_force(self.scan);
        self.digest.begin(self.scan, window, setpoint);
        let switching_on = self.switching_on.is_some();
        for (command, axis) in self.drive_commands.iter_mut().zip(&self.axes) {
            *command = axis.drive_command(self.mode, switching_on);
        }
        for (index, command) in self.drive_commands.iter_mut().enumerate() {
            let homes = self.homing.is_some_and(|homing| homing.by_drive(index));
            if homes && matches!(command, DriveCommand::Brake { .. }) && self.mode == Mode::Jogging
            {
                *command = DriveCommand::Home;
            }
        }
        let together = self.auxiliary.brakes_together();
        if let Some((axis, most_mm_s2)) = together {
            self.brake_evenly(axis, most_mm_s2);
        }
        self.command_let_go();
        self.drives.command_levels(&self.auxiliary.levels());
        self.drives.exchange(&self.drive_commands);
        self.auxiliary.take(self.drives.auxiliary());
        let from = program_positions(&self.axes);
        let taken = self.subsamples as usize;
        let setpoints = out.table_mm.iter_mut().zip(&mut out.motor_mm);
        let axes = self.axes.iter_mut().zip(&self.drive_commands).enumerate();
        for ((index, (axis, command)), (table, motor)) in axes.zip(setpoints) {
            axis.take_drive(self.drives.feedback(index));
            let samples = self.drives.instruments(index);
            let samples = samples.get(..taken).unwrap_or(samples);
            for ((sample, table), motor) in samples.iter().zip(table).zip(motor) {
                *table = sample.table_mm;
                *motor = sample.motor_mm;
            }
            self.digest.axis(
                command,
                axis.feedback_position(),
                samples.last().map_or(0.0, |s| s.table_mm),
            );
        }
        let to = program_positions(&self.axes);
        let inputs = self.drives.inputs();
        self.auxiliary.questions.take(inputs, &from, &to);
        (out.motion_digest_high, out.motion_digest_low) = self.digest.end();
        out
    }

    /// Brakes of an axis that is in step with the spindle, of both motors of a gantry, are no harder than this.
    fn brake_evenly(&mut self, axis: usize, most_mm_s2: f64) {
        for motor in self.motors_of(axis) {
            if let Some(DriveCommand::Brake { deceleration_mm_s2 }) =
                self.drive_commands.get_mut(motor)
            {
                *deceleration_mm_s2 = deceleration_mm_s2.min(most_mm_s2);
            }
        }
    }

    /// What the fieldbus did in the exchange of this scan; none where drives are simulated.
    pub fn bus_cycle(&self) -> Option<BusCycle> {
        let cycle = self.drives.bus_cycle()?;
        Some(BusCycle {
            scan: self.scan,
            visible_from: self.scan + 1,
            ..cycle
        })
    }

    /// A window became visible in this scan.
    pub fn offer(&mut self, header: &WindowHeader, setpoints: &[Setpoint], roster: &Roster) {
        let planner = roster
            .living(Job::Planner, 0, 0)
            .map_or(0, |p| p.incarnation);
        self.windows.offer(header, setpoints, planner);
    }

    /// Ends the scan: takes the answers, judges faults, decides about windows, and steps to the next.
    pub fn close_scan(&mut self, answers: &Answers, roster: &Roster) {
        self.axes.iter_mut().for_each(AxisUnit::step_by_hand);
        self.take_commands(answers, roster);
        self.heed_planner(answers, roster);
        self.hold_without_planner(answers, roster);
        self.hold_without_standby();
        self.lose_references_together();
        self.judge_skew();
        self.judge_torques();
        self.judge_axes();
        self.end_approach();
        self.step_auxiliary();
        self.decide_window();
        self.follow_up();
        self.follow_with_spindle();
        self.step_homing();
        self.heed_touch();
        self.forget_wheels();
        self.step_hands();
        self.leave_hands();
        self.advance_mode();
        self.couple_gantries();
        self.let_gantries_go();
        self.scan += 1;
    }

    /// A planner that cannot go on is no reason to leave the path: the window in force ends at rest on it.
    fn heed_planner(&mut self, answers: &Answers, roster: &Roster) {
        let planner = roster.living(Job::Planner, 0, 0);
        let Some((status, planner)) = answers.planner.as_ref().zip(planner) else {
            return;
        };
        let of_program = status.load == self.program.load;
        // A planner knows no other reason to stop than its own.
        let knows = status.cause == 0 || status.cause == Cause::Planner as u32;
        let genuine =
            knows && status.incarnation == planner.incarnation && status.scan <= self.scan;
        if !genuine || !of_program {
            return;
        }
        self.program.read(status.cause == 0, self.mode);
        self.auxiliary.questions.taken(status.answered);
        self.heed_events(status);
        if status.cause != 0 && self.cause == Cause::None {
            self.cause = Cause::Planner;
            self.cause_scan = self.scan + 1;
            self.stop();
        }
    }

    /// Takes the commands of this scan.
    fn take_commands(&mut self, answers: &Answers, roster: &Roster) {
        let driven = self.mode != Mode::Disabled;
        let closed = driven && self.mode != Mode::Tripped;
        let (in_force, _) = self.windows.in_force(self.scan);
        let next = NextScan::after(self.scan, self.scan_period_s, &self.windows);
        for (index, (axis, commands)) in self.axes.iter_mut().zip(&answers.commands).enumerate() {
            let exact = self.exact || axis.driver == Driver::Manual;
            let position = next.planned(axis, index).filter(|_| exact && closed);
            let plan = Plan { in_force, position };
            let taken = axis.decide_command(self.scan, index, commands, roster, plan, closed);
            axis.heed_hand(&taken);
            axis.judge_standby(index, roster);
            let mut fault = axis.take(&taken, self.watchdog_scans);
            if closed {
                fault = match axis.bridge_silence(&taken, fault, &next, index) {
                    Cause::None => next.broken_guard(axis, index),
                    cause => cause,
                };
            }
            if driven && axis.cause == Cause::None {
                axis.cause = match axis.drive_cause() {
                    Cause::None => fault,
                    cause => cause,
                };
            }
        }
    }

    /// One axis's fault stops all: they brake together, each as its servo published beforehand.
    fn judge_axes(&mut self) {
        let fault = self
            .axes
            .iter()
            .enumerate()
            .find(|(_, axis)| axis.cause != Cause::None)
            .map(|(index, axis)| (axis.cause, index as u32));
        if let Some((cause, index)) = fault {
            self.trip(cause, index);
        }
    }

    fn trip(&mut self, cause: Cause, axis: u32) {
        if self.mode == Mode::Tripped {
            return;
        }
        // A machine that was ordered to stop and trips on the way to rest need not wait for anybody.
        let stops = matches!(self.mode, Mode::Stopping | Mode::Stopped);
        self.may_end = self.ordered_to_end || self.ends() && stops;
        self.mode = Mode::Tripped;
        self.cause = cause;
        self.cause_axis = axis;
        self.cause_scan = self.scan + 1;
        self.settled_scans = 0;
        self.brake_silent_axes();
        self.windows.drop_all(self.scan, Dropped::Tripped);
        self.axes.iter_mut().for_each(AxisUnit::leave_hand);
        // References that went with the cause outlive this master.
        self.auxiliary.latched();
        self.give_up_homing();
    }

    fn decide_window(&mut self) {
        let axes = &self.axes;
        // What a servo held that says nothing any more went with it.
        let holds = |axis: &AxisUnit, id| !axis.silent && axis.command.pending == id;
        let held_by_all = |id: WindowId| axes.iter().all(|axis| holds(axis, id));
        let started = self.windows.has_started();
        // After the trip of a probe, no window goes further along the path than the one in force does.
        let brakes = self.auxiliary.questions.brakes();
        let commanded = self.axes.iter().map(|axis| axis.command_position);
        let allowed = self.mode == Mode::Enabled
            && self.is_homed()
            && self.is_within_travel()
            && self.windows.pending_begins_at(commanded)
            && (!brakes || self.windows.pending_rests_no_later());
        self.windows.decide(self.scan + 1, allowed, held_by_all);
        if !started && self.windows.has_started() {
            self.start_program_here();
        }
    }

    /// The program is expanded from where the axes are commanded to be.
    fn start_program_here(&mut self) {
        for (start, axis) in self.program_start.iter_mut().zip(&self.axes) {
            *start = axis.command_position;
        }
    }

    /// While a loop is open its command position follows the encoder (docs/methods/follow-up.md): with the drives off
    /// as far from it as it was when they were switched off; after a trip, in which the deviation means nothing, at it.
    fn follow_up(&mut self) {
        for axis in &mut self.axes {
            let deviation = match self.mode {
                Mode::Disabled => axis.deviation,
                Mode::Tripped => 0,
                _ if axis.driver == Driver::Drive => 0,
                _ => continue,
            };
            axis.command_position = axis.feedback_position().saturating_add(deviation);
        }
    }

    fn advance_mode(&mut self) {
        self.go_on_by_itself();
        self.await_switching_on();
        let next_scan = self.scan + 1;
        let at_rest = self.windows.at_rest(next_scan) && !self.is_moved_by_hand();
        self.rest_scans = if at_rest && self.stands() {
            self.rest_scans.saturating_add(1)
        } else {
            0
        };
        match self.mode {
            Mode::Enabled => {
                if at_rest && self.windows.ends_program() {
                    self.await_position();
                }
            }
            Mode::Stopping => {
                if at_rest {
                    self.mode = if self.program.is_running() {
                        Mode::Stopped
                    } else {
                        self.idle_mode()
                    };
                }
            }
            Mode::Finished | Mode::Stopped
                if !self.ends() && self.settled_scans > self.settle_scans =>
            {
                self.leave_program();
            }
            Mode::Disabled
            | Mode::Stopped
            | Mode::Tripped
            | Mode::Finished
            | Mode::Jogging
            | Mode::Ready => {}
        }
        self.step_typed_blocks();
        let standing = match self.mode {
            Mode::Finished | Mode::Stopped => true,
            Mode::Tripped => {
                let waits = self.waits_for_servo() && self.program.typed.is_none();
                self.stands() && (self.may_end || !waits)
            }
            Mode::Disabled => self.may_end,
            Mode::Enabled | Mode::Stopping | Mode::Jogging | Mode::Ready => false,
        };
        self.settled_scans = if standing {
            self.settled_scans.saturating_add(1)
        } else {
            0
        };
        if self.ends() && self.settled_scans > self.settle_scans {
            self.last = true;
        }
    }

    /// Whether the axes are, as far as anybody can see: a drive that does not answer shows no speed.
    fn stands(&self) -> bool {
        let mut axes = self.axes.iter();
        axes.all(|axis| axis.drive.state.is_lost() || axis.stands())
    }

    /// At the programmed end: finished once all axes are within their in-position windows; a trip if one never comes.
    fn await_position(&mut self) {
        let out_of_position = self.axes.iter().position(|axis| {
            let off = axis
                .feedback_position()
                .saturating_sub(axis.command_position) as f64;
            let most_mm = axis.settings.in_position_window_um() * 1e-3;
            off.abs() * axis.settings.increment_mm() > most_mm
        });
        self.waited_scans += 1;
        match out_of_position {
            None => self.mode = Mode::Finished,
            Some(axis) if self.waited_scans > self.in_position_patience_scans => {
                self.trip(Cause::NotInPosition, axis as u32);
            }
            Some(_) => {}
        }
    }

    /// Scans that were skipped because this side was late itself. After more than the watchdog allows the drives have braked by
    /// themselves, and nothing moves before somebody says so.
    pub fn skip(&mut self, scans: u32) {
        self.overrun_scans = self.overrun_scans.saturating_add(scans);
        if scans < self.watchdog_scans || self.mode == Mode::Disabled {
            return;
        }
        self.drives.stalled();
        for (index, axis) in self.axes.iter_mut().enumerate() {
            axis.take_drive(self.drives.feedback(index));
        }
        self.trip(Cause::Stalled, u32::MAX);
    }

    /// The drives, for saving their state.
    pub fn drives(&self) -> &D {
        &self.drives
    }
}
