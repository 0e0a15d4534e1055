//! The master, pure: it latches what the machine does, admits windows, hands commands to the drives and says in
//! the feedback what everybody obeys. Reads no clock and no port: [`cycle`](mod@crate::cycle) brings the answers.

use std::mem::offset_of;

use bus::sample::{
    BusCycle, Cause, Feedback, Instruments, Job, Mode, Order, PATH_AXES, Roster, Setpoint,
    WindowHeader, WindowId,
};
use bytemuck::Zeroable;
use machine::{Machine, WithinPeriod};

use crate::answers::Answers;
use crate::digest::MotionDigest;
use crate::drives::{DriveCommand, Drives};
use crate::window_arbiter::{Dropped, WindowArbiter};

mod alarms;
mod auxiliary;
mod axes;
mod axis_unit;
mod beginning;
mod coupling;
mod drive_place;
mod emergency_stop;
mod gantry;
mod geometry;
mod hand;
mod handwheel;
mod homing;
mod inner;
mod jog;
mod loaded;
mod logic;
mod losses;
mod machine_codes;
mod manual;
mod modes;
mod orders;
mod program;
mod questions;
mod recovery;
mod sane;
mod servos;
mod signals;
mod silence;
mod single_block;
mod start_at_line;
mod switching_on;
mod travel;
mod wheel;

use auxiliary::Auxiliary;
use axes::Axes;
use axis_unit::AxisUnit;
pub use beginning::Beginning;
use gantry::Gantries;
use geometry::Geometry;
pub use inner::{Inner, InnerAxis};
use losses::Losses;
use manual::Manual;
use modes::Modes;
use program::Loaded;
pub use program::RunEnd;
use questions::{latched_position, program_position};
use signals::NamedSignals;
use silence::NextScan;
use switching_on::SwitchingOn;

/// Speed below which a braked axis counts as standing, in mm/s.
pub const STANDSTILL_MM_S: f64 = 0.5;
/// The master of a cell, over its drives.
#[derive(Debug, Clone)]
pub struct Master<D> {
    scan: u64,
    timing: Timing,
    axes: Axes,
    /// Axes with two motors.
    gantries: Gantries,
    /// What drives show wrongly of true places.
    geometry: Geometry,
    windows: WindowArbiter,
    modes: Modes,
    switching_on: SwitchingOn,
    losses: Losses,
    manual: Manual,
    program: Loaded,
    /// Command positions that the program was started from.
    program_start: [i64; PATH_AXES],
    auxiliary: Auxiliary,
    signals: NamedSignals,
    drives: D,
    /// Commands of one scan, by axis.
    drive_commands: Vec<DriveCommand>,
    digest: MotionDigest,
    /// What was told last, once something was.
    told: Option<Box<Feedback>>,
    /// What the instruments saw last.
    seen: Box<Instruments>,
}

/// What does not change in the life of a master.
#[derive(Debug, Clone, Copy)]
struct Timing {
    incarnation: u32,
    period_scans: u64,
    scan_period_s: f64,
    watchdog_scans: u32,
    /// Readings of the instruments in a scan.
    subsamples: u32,
    /// Between two setpoints nothing is interpolated: the command positions are those of the window.
    exact: bool,
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
        let mut axes = Axes::new(machine, &drives);
        let geometry = Geometry::new(machine);
        geometry.begin(&mut axes);
        let mut master = Master {
            scan: first_scan,
            timing: Timing {
                incarnation,
                period_scans: u64::from(machine.scan.interpolation_period_scans),
                scan_period_s: machine.scan_period_s(),
                watchdog_scans: machine.scan.watchdog_scans,
                subsamples: machine.subsamples(),
                exact: machine.interpolation.within_period == WithinPeriod::Exact,
            },
            drive_commands: vec![DriveCommand::Disabled; axes.len()],
            axes,
            gantries: Gantries::new(machine),
            geometry,
            windows: WindowArbiter::new(),
            modes: Modes::new(machine, run_end),
            switching_on: SwitchingOn::default(),
            losses: Losses::new(machine, run_end),
            manual: Manual::new(machine),
            program: Loaded::new(run_end),
            program_start: [0; PATH_AXES],
            auxiliary: Auxiliary::new(machine),
            signals: NamedSignals::new(machine),
            drives,
            digest: MotionDigest::new(),
            told: Some(Box::new(Feedback::zeroed())),
            seen: Box::new(Instruments::zeroed()),
        };
        master.gantries.align(&mut master.axes);
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
        self.scan.is_multiple_of(self.timing.period_scans)
    }

    /// Whether the feedback of this scan is the last.
    pub fn is_last(&self) -> bool {
        self.modes.is_last()
    }

    /// What everybody obeys in this scan.
    pub fn feedback(&self) -> Feedback {
        let mut feedback = Feedback::zeroed();
        self.fill(&mut feedback);
        feedback
    }

    /// The same, written over the feedback of the scan before: what is not in use stays 0.
    pub(crate) fn tell(&mut self) -> &Feedback {
        let told = self.told.take();
        let mut told = told.unwrap_or_else(|| Box::new(Feedback::zeroed()));
        let head = bytemuck::bytes_of_mut(&mut *told).get_mut(..offset_of!(Feedback, axes));
        head.unwrap_or_default().fill(0);
        self.fill(&mut told);
        self.told.insert(told)
    }

    fn fill(&self, feedback: &mut Feedback) {
        feedback.scan = self.scan;
        feedback.visible_from = self.scan;
        self.windows.tell(self.scan, feedback);
        feedback.program_start = self.program_start;
        feedback.incarnation = self.timing.incarnation;
        self.modes.tell(feedback);
        feedback.overrun_scans = self.losses.overrun_scans();
        feedback.axis_count = self.axes.len() as u32;
        feedback.path_axes = self.axes.of_path().count() as u32;
        self.program.tell(feedback);
        self.auxiliary.tell(feedback);
        if let Some(logic) = &self.signals.logic {
            logic.tell(self.auxiliary.is_coupled(), feedback);
        }
        for (out, axis) in feedback.axes.iter_mut().zip(self.axes.iter()) {
            *out = axis.tell();
        }
    }

    /// The readings of the instruments in the last exchange.
    pub fn instruments(&self) -> &Instruments {
        &self.seen
    }

    /// Hands the commands in force to the drives and takes what they show at the end of this scan; the instruments'
    /// readings of it.
    pub fn exchange(&mut self) -> &Instruments {
        let out = &mut self.seen;
        out.scan = self.scan;
        out.visible_from = self.scan + 1;
        out.subsamples = self.timing.subsamples;
        out.axis_count = self.axes.len() as u32;
        let (window, setpoint) = self.windows.in_force(self.scan);
        self.digest.begin(self.scan, window, setpoint);
        let switching_on = self.switching_on.is_under_way();
        for (command, axis) in self.drive_commands.iter_mut().zip(self.axes.iter()) {
            *command = axis.drive_command(self.modes.mode(), switching_on);
        }
        let jogs = self.mode() == Mode::Jogging;
        for (index, command) in self.drive_commands.iter_mut().enumerate() {
            let homes = self.manual.is_homed_by_drive(index);
            if homes && matches!(command, DriveCommand::Brake { .. }) && jogs {
                *command = DriveCommand::Home;
            }
        }
        let together = self.auxiliary.brakes_together();
        if let Some((axis, most_mm_s2)) = together {
            self.brake_evenly(axis, most_mm_s2);
        }
        self.gantries.command(&mut self.drive_commands);
        self.step_brakes();
        let levels = self.auxiliary.levels();
        self.drives.command_levels(&levels);
        self.drives.watch_probe(self.auxiliary.questions.watched());
        self.command_signals(&levels);
        self.drives.exchange(&self.drive_commands);
        self.signals.take(&self.drives, self.scan);
        let mut auxiliary = self.drives.auxiliary();
        self.signals.give_auxiliary(&levels, &mut auxiliary);
        self.auxiliary.take(auxiliary);
        self.auxiliary
            .machine_codes
            .take(self.signals.code_is_done());
        let from = self.axes.on_path(program_position);
        self.take_drives();
        let taken = self.timing.subsamples as usize;
        let axes = self.axes.iter().zip(&self.drive_commands).enumerate();
        for ((index, (axis, command)), seen) in axes.zip(&mut self.seen.axes) {
            let samples = self.drives.instruments(index);
            let samples = samples.get(..taken).unwrap_or(samples);
            let places = seen.table_mm.iter_mut().zip(&mut seen.motor_mm);
            for (sample, (table, motor)) in samples.iter().zip(places) {
                *table = sample.table_mm;
                *motor = sample.motor_mm;
            }
            self.digest.axis(
                command,
                axis.feedback_position(),
                samples.last().map_or(0.0, |s| s.table_mm),
            );
        }
        let to = self.axes.on_path(program_position);
        let mut inputs = self.drives.inputs();
        self.signals.give_inputs(&mut inputs);
        let questions = &mut self.auxiliary.questions;
        questions.take(inputs, &from, &to);
        if questions.watched().is_some() {
            questions.take_latched(self.axes.on_path(latched_position));
        }
        let out = &mut self.seen;
        (out.motion_digest_high, out.motion_digest_low) = self.digest.end();
        out
    }

    /// Takes what the drives show.
    fn take_drives(&mut self) {
        for (index, axis) in self.axes.iter_mut().enumerate() {
            axis.take_drive(self.drives.feedback(index));
        }
        self.geometry.correct(&mut self.axes, self.modes.mode());
    }

    /// Which brakes are open in this scan; an axis whose brake is on its way gets what its drive is to do meanwhile.
    fn step_brakes(&mut self) {
        let mut open = 0;
        let axes = self.axes.iter_mut().zip(&mut self.drive_commands);
        for (index, (axis, command)) in axes.enumerate() {
            open |= u64::from(axis.step_brake(command)) << index;
        }
        self.drives.open_brakes(open);
    }

    /// Brakes of an axis that is in step with the spindle, of both motors of a gantry, are no harder than this.
    fn brake_evenly(&mut self, axis: usize, most_mm_s2: f64) {
        for motor in self.gantries.motors_of(axis) {
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
        let scan_s = self.timing.scan_period_s;
        self.axes.iter_mut().for_each(AxisUnit::step_by_hand);
        self.heed_logic(answers, roster);
        self.heed_signals();
        self.take_commands(answers, roster);
        self.heed_planner(answers, roster);
        self.hold_without_planner(answers, roster);
        self.hold_without_standby();
        self.gantries.lose_references_together(&mut self.axes);
        self.gantries
            .judge(&mut self.axes, self.modes.mode(), scan_s);
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
        let of_program = self.program.is_meant(status.load, status.scan);
        // A planner knows no other reason to stop than its own.
        let knows = status.cause == 0 || status.cause == Cause::Planner as u32;
        let genuine =
            knows && status.incarnation == planner.incarnation && status.scan <= self.scan;
        if !genuine || !of_program {
            return;
        }
        self.program.read(status.cause == 0, self.mode());
        self.auxiliary.questions.taken(status.answered);
        self.heed_events(status);
        if status.cause != 0 {
            self.stop_for(Cause::Planner);
        }
    }

    /// Takes the commands of this scan.
    fn take_commands(&mut self, answers: &Answers, roster: &Roster) {
        let driven = self.mode() != Mode::Disabled;
        let closed = driven && self.mode() != Mode::Tripped;
        let (in_force, _) = self.windows.in_force(self.scan);
        let next = NextScan::after(self.scan, self.timing.scan_period_s, &self.windows);
        let watchdog_scans = self.timing.watchdog_scans;
        for (index, (axis, commands)) in self.axes.iter_mut().zip(&answers.commands).enumerate() {
            let exact = self.timing.exact || axis.hand.is_on();
            let position = next.planned(axis).filter(|_| exact && closed);
            let plan = (in_force, position, closed);
            let taken = axis.decide_command(self.scan, index, commands, roster, plan);
            axis.hand.heed(&taken);
            axis.servos.judge_standby(index, roster);
            let mut fault = axis.take(&taken, watchdog_scans);
            if closed {
                fault = match axis.bridge_silence(&taken, fault, &next) {
                    Cause::None => next.broken_guard(axis),
                    cause => cause,
                };
            }
            if driven {
                axis.fail(match axis.drive_cause() {
                    Cause::None => fault,
                    cause => cause,
                });
            }
        }
    }

    /// One axis's fault stops all: they brake together, each as its servo published beforehand.
    fn judge_axes(&mut self) {
        if let Some((cause, index)) = self.axes.fault() {
            self.trip(cause, index);
        }
    }

    fn trip(&mut self, cause: Cause, axis: u32) {
        if !self.modes.trip(cause, axis, self.scan) {
            return;
        }
        self.brake_silent_axes();
        self.windows.drop_all(self.scan, Dropped::Tripped);
        self.axes.iter_mut().for_each(|axis| axis.hand.leave());
        // References that went with the cause outlive this master.
        self.auxiliary.latched();
        self.give_up_homing();
    }

    fn decide_window(&mut self) {
        let axes = &self.axes;
        let held_by_all = |id: WindowId| axes.iter().all(|axis| axis.servos.hold(id));
        let started = self.windows.has_started();
        // After the trip of a probe, no window goes further along the path than the one in force does.
        let brakes = self.auxiliary.questions.brakes();
        let commanded = || self.axes.of_path().map(AxisUnit::command_position);
        let allowed = self.mode() == Mode::Enabled
            && self.axes.are_homed()
            && self.axes.are_within_travel()
            && self.windows.pending_begins_at(commanded())
            && (!brakes || self.windows.pending_rests_no_later());
        self.windows.decide(self.scan + 1, allowed, held_by_all);
        if !started && self.windows.has_started() {
            self.start_program_here();
        }
    }

    /// The program is expanded from where the axes are commanded to be.
    fn start_program_here(&mut self) {
        self.program_start = self.axes.command_positions();
    }

    /// While a loop is open its command position follows the encoder (docs/methods/follow-up.md): with the drives off
    /// as far from it as it was when they were switched off; after a trip, in which the deviation means nothing, at it.
    fn follow_up(&mut self) {
        let mode = self.mode();
        self.axes.iter_mut().for_each(|axis| axis.follow_up(mode));
    }

    fn advance_mode(&mut self) {
        self.go_on_by_itself();
        self.await_switching_on();
        let next_scan = self.scan + 1;
        let at_rest = self.windows.at_rest(next_scan) && !self.is_moved_by_hand();
        self.modes.rest(at_rest && self.axes.stand());
        match self.mode() {
            Mode::Enabled => {
                if at_rest && self.windows.ends_program() {
                    self.await_position();
                }
            }
            Mode::Stopping => {
                if at_rest {
                    self.modes.enter(if self.program.is_running() {
                        Mode::Stopped
                    } else {
                        self.modes.idle()
                    });
                }
            }
            Mode::Finished | Mode::Stopped if !self.modes.ends() && self.modes.has_settled() => {
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
        let standing = match self.mode() {
            Mode::Finished | Mode::Stopped => true,
            Mode::Tripped => {
                let waits = self.waits_for_servo() && !self.program.is_typed();
                self.axes.stand() && (self.modes.may_end() || !waits)
            }
            Mode::Disabled => self.modes.may_end(),
            Mode::Enabled | Mode::Stopping | Mode::Jogging | Mode::Ready => false,
        };
        self.modes.settle(standing);
        if self.is_last() && self.program.is_running() {
            // The feedback that is the last is of it too.
            let order = self.modes.is_ordered_to_end().then_some(Order::Down);
            let ended = self.end_of_run(next_scan, order);
            self.program.note_end(ended);
        }
    }

    /// At the programmed end: finished once all axes are within their in-position windows; a trip if one never comes.
    fn await_position(&mut self) {
        let out_of_position = self.axes.out_of_position();
        let too_long = self.modes.await_position(out_of_position.is_some());
        if let Some(axis) = out_of_position.filter(|_| too_long) {
            self.trip(Cause::NotInPosition, axis as u32);
        }
    }

    /// The mode that the machine is in.
    fn mode(&self) -> Mode {
        self.modes.mode()
    }

    /// Where no window is in force, second motors are where the first ones are.
    fn couple_gantries(&mut self) {
        if !self.windows.has_window() {
            self.gantries.couple(&mut self.axes);
        }
    }

    fn let_gantries_go(&mut self) {
        let relaxes = self.switching_on.relaxes();
        self.gantries.let_go(&self.axes, self.modes.mode(), relaxes);
    }

    /// Scans that were skipped because this side was late itself. After more than the watchdog allows the drives have braked by
    /// themselves, and nothing moves before somebody says so.
    pub fn skip(&mut self, scans: u32) {
        self.losses.overrun(scans);
        if scans < self.timing.watchdog_scans || self.mode() == Mode::Disabled {
            return;
        }
        self.drives.stalled();
        self.take_drives();
        self.trip(Cause::Stalled, u32::MAX);
    }

    /// The drives, for saving their state.
    pub fn drives(&self) -> &D {
        &self.drives
    }
}
