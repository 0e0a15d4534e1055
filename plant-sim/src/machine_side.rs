//! The machine side, pure: it latches what the machine does, admits windows, hands commands to the drives and says in
//! the feedback what everybody obeys. Reads no clock and no port: [`run`](mod@crate::run) brings the answers.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::machine::{Axis, DriveMode, Machine, PositionFeedback, Restart};
use bus::sample::{
    AxisCommand, AxisFeedback, Cause, Driver, Feedback, Instruments, Job, MAX_AXES, MAX_SUBSAMPLES,
    Mode, PlannerStatus, Roster, WindowHeader, WindowId, WindowRow,
};
use bus::service::ROLES;
use bytemuck::Zeroable;

use crate::axis::{AxisSimulation, InstrumentSample};
use crate::digest::MotionDigest;
use crate::drive::DriveCommand;
use crate::window_book::{Dropped, WindowBook};

mod loaded;
mod orders;
mod recovery;
mod switch;

use loaded::Loaded;
use switch::{Switch, Taken};

/// Speed below which a braked axis counts as standing, in mm/s.
const STANDSTILL_MM_S: f64 = 0.5;
/// Longest wait for the in-position window at the programmed end, in s.
const IN_POSITION_PATIENCE_S: f64 = 5.0;
/// A command beyond the axis's speed limit by this factor is no command: kicks and the position loop stay well below.
const SPEED_SANITY: f64 = 2.0;

/// A position command further outside the travel than this is no command.
const POSITION_SANITY_MM: f64 = 10.0;

/// When a run ends without being told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunEnd {
    /// Never by itself: a cell that stays up, in which programs are loaded and started.
    WhenTold,
    /// When its one program is done, or the machine has stopped or tripped, and stands.
    AfterProgram,
}

/// What was answered in one scan.
#[derive(Debug, Clone, Copy)]
pub struct Answers {
    /// The command of each axis (outer) and role (inner).
    pub commands: [[Option<AxisCommand>; ROLES.len()]; MAX_AXES],
    /// The planner's word, at a period boundary.
    pub planner: Option<PlannerStatus>,
}

impl Answers {
    /// Nothing answered yet.
    pub const NONE: Answers = Answers {
        commands: [[None; ROLES.len()]; MAX_AXES],
        planner: None,
    };
}

/// One axis as the machine side sees it.
#[derive(Debug)]
struct AxisUnit {
    settings: Axis,
    simulation: AxisSimulation,
    /// The command in force.
    command: AxisCommand,
    /// Where the axis is commanded to be, in increments.
    register: i64,
    missed: u32,
    missed_in_a_row: u32,
    cause: Cause,
    taken_incarnation: u32,
    /// Which of its servos is active.
    switch: Switch,
    /// Its servo answered the last scan, with nothing to complain of.
    followed: bool,
    /// Which of its controllers drives it.
    driver: Driver,
    /// Where a jog is to bring the register.
    jog_target: i64,
    /// Register less feedback position when the drives were switched off: the steady deviation of the open loop.
    deviation: i64,
}

impl AxisUnit {
    fn increments(&self, mm: f64) -> i64 {
        libm::round(mm / self.settings.increment_mm()) as i64
    }

    fn motor_position(&self) -> i64 {
        self.increments(self.simulation.motor_position_mm())
    }

    fn scale_position(&self) -> i64 {
        self.simulation
            .scale_position_mm()
            .map_or_else(|| self.motor_position(), |mm| self.increments(mm))
    }

    fn feedback_position(&self) -> i64 {
        match self.settings.feedback {
            PositionFeedback::Motor => self.motor_position(),
            PositionFeedback::Scale => self.scale_position(),
        }
    }

    /// What the drive is told for this scan.
    fn drive_command(&self, mode: Mode) -> DriveCommand {
        match mode {
            Mode::Disabled => DriveCommand::Disabled,
            Mode::Tripped => self.brake(),
            Mode::Enabled
            | Mode::Stopping
            | Mode::Stopped
            | Mode::Finished
            | Mode::Jogging
            | Mode::Ready => {
                if self.cause != Cause::None {
                    return self.brake();
                }
                match self.settings.drive_mode {
                    DriveMode::Velocity => DriveCommand::Velocity {
                        velocity_mm_s: self.command.velocity_mm_s,
                        torque_offset_nm: self.command.torque_nm,
                    },
                    DriveMode::Torque
                        if self.command.scan == 0 && self.command.incarnation == 0 =>
                    {
                        self.brake()
                    }
                    DriveMode::Torque => DriveCommand::Torque {
                        torque_nm: self.command.torque_nm,
                    },
                }
            }
        }
    }

    fn brake(&self) -> DriveCommand {
        let asked = self.command.stop_deceleration_mm_s2;
        let most = self.settings.quick_stop_mm_s2;
        DriveCommand::Brake {
            deceleration_mm_s2: if asked > 0.0 && asked <= most {
                asked
            } else {
                most
            },
        }
    }

    /// Whether a command is one that the drive may see; the named cause otherwise.
    fn judge(&self, command: &AxisCommand) -> Cause {
        let speed_most = self.settings.rapid_mm_s * SPEED_SANITY;
        let finite = command.velocity_mm_s.is_finite()
            && command.torque_nm.is_finite()
            && command.stop_deceleration_mm_s2.is_finite();
        let position_mm = command.position as f64 * self.settings.increment_mm();
        let reachable = position_mm >= self.settings.travel_min_mm - POSITION_SANITY_MM
            && position_mm <= self.settings.travel_max_mm + POSITION_SANITY_MM;
        let torque_fits = command.torque_nm.abs() <= self.settings.motor.peak_torque_nm;
        if !finite || !reachable || !torque_fits {
            return Cause::BadValue;
        }
        if command.velocity_mm_s.abs() > speed_most {
            return Cause::SpeedLimit;
        }
        Cause::from_wire(command.cause).unwrap_or(Cause::BadValue)
    }
}

/// The machine side.
#[derive(Debug)]
pub struct MachineSide {
    axes: Vec<AxisUnit>,
    scan: u64,
    incarnation: u32,
    period_scans: u64,
    watchdog_scans: u32,
    settle_scans: u32,
    in_position_patience_scans: u32,
    run_end: RunEnd,
    mode: Mode,
    program: Loaded,
    cause: Cause,
    cause_axis: u32,
    cause_scan: u64,
    windows: WindowBook,
    hold: bool,
    override_percent: u32,
    settled_scans: u32,
    waited_scans: u32,
    /// Scans the command has been at rest and the axes have stood, in a row.
    rest_scans: u32,
    /// So many of them make the machine be at rest: the feed-forward has run out by then.
    rest_scans_min: u32,
    /// Mode that a jog began in and goes back to, and the scans it may still take.
    jog_from: Mode,
    jog_patience_scans: u64,
    jog_mm_s: f64,
    scan_period_s: f64,
    /// Somebody has asked a machine without drives, or one that has tripped, to stop: the run may end.
    may_end: bool,
    /// Somebody has told the cell to end, or its launcher is gone: nothing brings it back.
    told_to_end: bool,
    /// What follows when a process is lost.
    restart: Restart,
    /// Command registers the program was begun from.
    program_start: [i64; MAX_AXES],
    last: bool,
    overrun_scans: u32,
    samples: [[InstrumentSample; MAX_SUBSAMPLES]; MAX_AXES],
    subsamples: u32,
    digest: MotionDigest,
}

impl MachineSide {
    /// A machine side whose axes stand where the simulations are; drives on from the first scan if `enabled`.
    pub fn new(
        machine: &Machine,
        simulations: Vec<AxisSimulation>,
        incarnation: u32,
        first_scan: u64,
        enabled: bool,
        run_end: RunEnd,
    ) -> MachineSide {
        let axes = machine
            .axes
            .iter()
            .zip(simulations)
            .map(|(settings, simulation)| {
                let mut unit = AxisUnit {
                    settings: settings.clone(),
                    simulation,
                    command: AxisCommand::zeroed(),
                    register: 0,
                    missed: 0,
                    missed_in_a_row: 0,
                    cause: Cause::None,
                    taken_incarnation: 0,
                    switch: Switch::default(),
                    followed: false,
                    driver: Driver::Program,
                    jog_target: 0,
                    deviation: 0,
                };
                unit.register = unit.feedback_position();
                unit
            })
            .collect();
        MachineSide {
            axes,
            scan: first_scan,
            incarnation,
            period_scans: u64::from(machine.scan.distribution_period_scans),
            watchdog_scans: machine.scan.watchdog_scans,
            settle_scans: machine.scan.settle_scans,
            in_position_patience_scans: (IN_POSITION_PATIENCE_S / machine.scan_period_s()) as u32,
            run_end,
            mode: if enabled {
                match run_end {
                    RunEnd::AfterProgram => Mode::Enabled,
                    RunEnd::WhenTold => Mode::Ready,
                }
            } else {
                Mode::Disabled
            },
            program: Loaded::new(run_end),
            cause: Cause::None,
            cause_axis: u32::MAX,
            cause_scan: 0,
            windows: WindowBook::new(),
            hold: false,
            override_percent: 100,
            settled_scans: 0,
            waited_scans: 0,
            rest_scans: 0,
            rest_scans_min: machine.intended_rows(),
            jog_from: Mode::Enabled,
            jog_patience_scans: 0,
            jog_mm_s: machine.manual.jog_mm_s,
            scan_period_s: machine.scan_period_s(),
            may_end: false,
            told_to_end: false,
            restart: match run_end {
                RunEnd::AfterProgram => machine.restart,
                RunEnd::WhenTold => machine.restart.of_staying(),
            },
            program_start: [0; MAX_AXES],
            last: false,
            overrun_scans: 0,
            samples: [[InstrumentSample::zeroed(); MAX_SUBSAMPLES]; MAX_AXES],
            subsamples: machine.subsamples(),
            digest: MotionDigest::new(),
        }
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
        for (out, axis) in feedback.axes.iter_mut().zip(&self.axes) {
            *out = AxisFeedback {
                motor_position: axis.motor_position(),
                scale_position: axis.scale_position(),
                command_register: axis.register,
                jog_target: axis.jog_target,
                command_scan: axis.command.scan,
                velocity_mm_s: axis.simulation.velocity_mm_s(),
                velocity_command_mm_s: axis.command.velocity_mm_s,
                torque_nm: axis.simulation.torque_nm(),
                winding_k: axis.simulation.winding_rise_k(),
                missed_scans: axis.missed,
                missed_in_a_row: axis.missed_in_a_row,
                taken_incarnation: axis.taken_incarnation,
                taken_role: axis.command.role,
                cause: axis.cause as u32,
                torque_limited: u32::from(axis.simulation.torque_limited()),
                driver: axis.driver as u32,
                reserved: 0,
            };
        }
        feedback
    }

    /// Moves the machine through this scan under the commands in force; the instruments' readings of it.
    pub fn simulate(&mut self) -> Instruments {
        let mut out = Instruments::zeroed();
        out.scan = self.scan;
        out.visible_from = self.scan + 1;
        out.subsamples = self.subsamples;
        out.axis_count = self.axes.len() as u32;
        let (window, row) = self.windows.in_force(self.scan);
        self.digest.begin(self.scan, window, row);
        let taken = self.subsamples as usize;
        let rows = out.table_mm.iter_mut().zip(&mut out.motor_mm);
        for ((axis, samples), (table, motor)) in
            self.axes.iter_mut().zip(&mut self.samples).zip(rows)
        {
            let command = axis.drive_command(self.mode);
            let samples = samples.get_mut(..taken).unwrap_or_default();
            axis.simulation.scan(&command, samples);
            for ((sample, table), motor) in samples.iter().zip(table).zip(motor) {
                *table = sample.table_mm;
                *motor = sample.motor_mm;
            }
            self.digest.axis(
                &command,
                axis.feedback_position(),
                samples.last().map_or(0.0, |s| s.table_mm),
            );
        }
        (out.motion_digest_high, out.motion_digest_low) = self.digest.end();
        out
    }

    /// A window became visible in this scan.
    pub fn offer(&mut self, header: &WindowHeader, rows: &[WindowRow], roster: &Roster) {
        let planner = roster
            .living(Job::Planner, 0, 0)
            .map_or(0, |p| p.incarnation);
        self.windows.offer(header, rows, planner);
    }

    /// Ends the scan: takes the answers, judges faults, decides about windows, and steps to the next.
    pub fn close_scan(&mut self, answers: &Answers, roster: &Roster) {
        let jog_done = self.take_commands(answers, roster);
        self.heed_planner(answers, roster);
        self.hold_without_planner(roster);
        self.judge_axes();
        self.decide_window();
        self.follow_up();
        if jog_done {
            self.end_jog();
        }
        self.advance_mode();
        self.scan += 1;
    }

    /// A planner that cannot go on is no reason to leave the path: the window in force ends at rest on it.
    fn heed_planner(&mut self, answers: &Answers, roster: &Roster) {
        let planner = roster.living(Job::Planner, 0, 0);
        let Some((status, planner)) = answers.planner.as_ref().zip(planner) else {
            return;
        };
        let of_program = status.load == self.program.load;
        let genuine = status.incarnation == planner.incarnation && status.scan <= self.scan;
        if !genuine || !of_program {
            return;
        }
        self.program.read(status.cause == 0, self.mode);
        if status.cause != 0 && self.cause == Cause::None {
            self.cause = Cause::from_wire(status.cause).unwrap_or(Cause::BadValue);
            self.cause_scan = self.scan + 1;
            self.stop();
        }
    }

    /// Takes the commands of this scan; whether every axis that is driven by hand has come to rest.
    fn take_commands(&mut self, answers: &Answers, roster: &Roster) -> bool {
        let (mut by_hand, mut done) = (false, true);
        let driven = self.mode != Mode::Disabled;
        let closed = driven && self.mode != Mode::Tripped;
        let (in_force, _) = self.windows.in_force(self.scan);
        for (index, (axis, commands)) in self.axes.iter_mut().zip(&answers.commands).enumerate() {
            let taken = axis.decide_command(self.scan, index, commands, roster, in_force, closed);
            if axis.driver != Driver::Program {
                by_hand = true;
                done &= matches!(taken, Taken::Command(c) if c.jog_done == 1);
            }
            let mut fault = Cause::None;
            axis.followed = false;
            match taken {
                Taken::Command(command) => {
                    axis.missed_in_a_row = 0;
                    axis.command = command;
                    axis.taken_incarnation = command.incarnation;
                    axis.register = command.position;
                    axis.followed = true;
                }
                Taken::Bad(cause) => {
                    axis.missed_in_a_row = 0;
                    fault = cause;
                }
                Taken::Lost => fault = Cause::ServoLost,
                Taken::Missed => {
                    axis.missed = axis.missed.saturating_add(1);
                    axis.missed_in_a_row = axis.missed_in_a_row.saturating_add(1);
                    if axis.missed_in_a_row >= self.watchdog_scans {
                        fault = Cause::Watchdog;
                    }
                }
            }
            if driven && axis.cause == Cause::None {
                axis.cause = fault;
            }
        }
        by_hand && done
    }

    /// One axis's fault stops all: they brake together, each as its servo said beforehand.
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
        // A machine that was told to stop and trips on the way to rest need not wait for anybody.
        let stops = matches!(self.mode, Mode::Stopping | Mode::Stopped);
        self.may_end = self.told_to_end || self.ends() && stops;
        self.mode = Mode::Tripped;
        self.cause = cause;
        self.cause_axis = axis;
        self.cause_scan = self.scan + 1;
        self.settled_scans = 0;
        self.windows.drop_all(self.scan, Dropped::Tripped);
        for axis in &mut self.axes {
            axis.driver = Driver::Program;
        }
    }

    fn decide_window(&mut self) {
        let axes = &self.axes;
        let held_by_all = |id: WindowId| axes.iter().all(|axis| axis.command.pending == id);
        let begun = self.windows.has_begun();
        self.windows
            .decide(self.scan + 1, self.mode == Mode::Enabled, held_by_all);
        if !begun && self.windows.has_begun() {
            for (start, axis) in self.program_start.iter_mut().zip(&self.axes) {
                *start = axis.register;
            }
        }
    }

    /// While a loop is open its position register follows the encoder (docs/methods/follow-up.md): with the drives off
    /// as far from it as it was when they were switched off; after a trip, in which the deviation means nothing, at it.
    fn follow_up(&mut self) {
        for axis in &mut self.axes {
            let deviation = match self.mode {
                Mode::Disabled => axis.deviation,
                Mode::Tripped => 0,
                _ => continue,
            };
            axis.register = axis.feedback_position().saturating_add(deviation);
        }
    }

    fn advance_mode(&mut self) {
        self.go_on_by_itself();
        let next_scan = self.scan + 1;
        let by_hand = self.is_by_hand();
        let at_rest = self.windows.at_rest(next_scan) && !by_hand;
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
                    self.mode = if self.program.is_begun() {
                        Mode::Stopped
                    } else {
                        self.idle_mode()
                    };
                }
            }
            Mode::Finished if !self.ends() && self.settled_scans > self.settle_scans => {
                self.end_program();
            }
            Mode::Disabled
            | Mode::Stopped
            | Mode::Tripped
            | Mode::Finished
            | Mode::Jogging
            | Mode::Ready => {}
        }
        if by_hand {
            self.await_jog();
        }
        let standing = match self.mode {
            Mode::Finished | Mode::Stopped => true,
            Mode::Tripped => self.stands() && (self.may_end || !self.waits_for_servo()),
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

    /// Whether the axes stand.
    fn stands(&self) -> bool {
        self.axes
            .iter()
            .all(|axis| axis.simulation.velocity_mm_s().abs() < STANDSTILL_MM_S)
    }

    /// Whether a second controller drives an axis.
    fn is_by_hand(&self) -> bool {
        self.axes.iter().any(|axis| axis.driver != Driver::Program)
    }

    /// At the programmed end: finished once all axes are within their in-position windows; a trip if one never comes.
    fn await_position(&mut self) {
        let out_of_position = self.axes.iter().position(|axis| {
            let off = axis.feedback_position().saturating_sub(axis.register) as f64;
            let most_mm =
                (axis.settings.in_position_um + axis.settings.reversal.backlash_um) * 1e-3;
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

    /// Scans that were skipped because this side was late itself.
    pub fn skip(&mut self, scans: u32) {
        self.overrun_scans += scans;
    }

    /// The simulations, for saving their state.
    pub fn simulations(&self) -> impl Iterator<Item = &AxisSimulation> {
        self.axes.iter().map(|axis| &axis.simulation)
    }
}
