//! What must hold in every scan, whatever dies, hangs or lies (docs/developers/invariants.md). Pure: fed with what was published.
//!
//! - Rows that are executed keep every axis's speed and acceleration, judged on whole increments without tolerance, and lie
//!   within one increment of the place that their tag names.
//! - The command position is what was executed; with open loops it follows the encoder, and nothing moves by itself.
//! - In hold at rest nothing moves, whoever comes back.
//! - An axis without any servo trips the machine in the same scan; the axes come to rest together, no later than their
//!   quick stops take, and no further from the path than they travel until then.
//! - Scans are missed only where a fault says why, or where an axis has no servo.

use std::sync::Arc;

use audit::SetpointAudit;
use bus::sample::{AxisFeedback, Cause, Feedback, Instruments, Job, MAX_AXES, Mode, Roster};
use machine::{Machine, PositionFeedback, WithinPeriod};
use path::geometry::{AxisVector, Element};
use path::limits::MotionLimits;
use path::path_part::PathPart;
use plant_sim::plant_file::PlantFile;

use crate::cell::{Published, Window};

/// Windows that are remembered by their names.
const WINDOWS_KNOWN: usize = 16;
/// In hold at rest a window that was on its way may still come into force for so many periods.
const HOLD_PERIODS: u32 = 3;
/// A drive's own overshoot: share of the rapid speed, and mm/s.
const OVERSHOOT: (f64, f64) = (0.05, 5.0);
/// Braking may take longer than the quick stop of the speeds: torque, screw, the controller's last scan, in s.
const BRAKING_SLACK_S: f64 = 0.06;
/// Speed below which an axis stands, in mm/s.
const STANDS_MM_S: f64 = 0.5;
/// A silent servo's drive holds its last command for so many scans before the master commands it.
const BLIND_SCANS: u32 = 3;
/// Beyond the way until the stop: lag of the axes behind their commands, in s of way.
const LAG_S: f64 = 0.02;
/// And what the screw springs back, in mm.
const SPRING_MM: f64 = 0.05;
/// An axis without drive relaxes by no more, in µm.
const RELAXES_UM: f64 = 20.0;
/// Elements around the one under way in which the nearest place of the path is looked for.
const AROUND: u32 = 2;

/// A program's path on a machine, expanded once.
#[derive(Debug)]
pub struct Course {
    /// The path, from where the simulated machine is at the start.
    pub path: PathPart,
    /// The limits of the axes.
    pub limits: MotionLimits,
    /// Where the command positions are to end, in increments.
    pub end: [i64; MAX_AXES],
}

impl Course {
    /// Expands a program.
    ///
    /// # Errors
    /// Program, machine or plant are not usable: why.
    pub fn of(
        machine: &Machine,
        plant: &PlantFile,
        name: &str,
        text: &str,
    ) -> Result<Course, Box<dyn std::error::Error + Send + Sync>> {
        let program = program::resume_from(machine, &plant.start(machine)?, name, text)?;
        let start = program.start;
        let (windows, _) = planner::course(machine, program)?;
        let limits = windows.limits().clone();
        let path = windows.path().clone();
        let end = path.last().map_or(start, Element::end);
        let end = limits.increments(&limits.setpoints().kinematics.axes(&end));
        Ok(Course { path, limits, end })
    }
}

/// Something that must not be.
#[derive(Debug, Clone, PartialEq)]
pub struct Violation {
    /// The scan.
    pub scan: u64,
    /// What, with unit.
    pub what: String,
}

/// A stop on the path that no end of the program asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stop {
    /// First scan that braked.
    pub from: u64,
    /// First scan of the window that went on.
    pub until: Option<u64>,
    /// The next window came before it braked, but so late that the controllers had seen the braking ahead of them.
    pub foreseen: bool,
}

/// What a run has shown.
#[derive(Debug, Clone, Default)]
pub struct Shown {
    /// Largest distance of the table from the path while it was on it, in mm, and its scan.
    pub contour_mm: (f64, u64),
    /// Largest distance from the path in a trip, in mm.
    pub deviation_mm: f64,
    /// Stops on the path.
    pub stops: Vec<Stop>,
    /// Trips.
    pub trips: u32,
    /// Scans in which some axis had no command in time.
    pub missed: u32,
    /// The last digest.
    pub digest: (u64, u64),
    /// The last scan.
    pub scans: u64,
    /// The mode it ended in.
    pub mode: Option<Mode>,
    /// Why.
    pub cause: Option<Cause>,
}

/// Whether the servo whose command an axis took last is no more.
pub fn is_driver_dead(roster: &Roster, index: usize, axis: &AxisFeedback) -> bool {
    let in_place = roster.living(Job::Servo, index, axis.taken_role);
    in_place.is_none_or(|servo| servo.incarnation != axis.taken_incarnation)
}

/// A trip under way.
#[derive(Debug, Clone, Copy)]
struct Trip {
    since: u64,
    /// By then all axes must stand, in scans from `since`.
    stands_within: u64,
    /// So far they may be from the path, in mm.
    deviation_max_mm: f64,
    stood: bool,
}

/// Judges one run.
pub struct Judge<'a> {
    machine: &'a Machine,
    course: &'a Course,
    audit: SetpointAudit,
    known: Vec<Arc<Window>>,
    in_force: Option<Arc<Window>>,
    /// The setpoint that was executed in the scan before.
    executed: Option<[i64; MAX_AXES]>,
    /// Axes whose servo has died, and that have no other one: whoever comes is no driver before its first command is taken.
    unserved: [bool; MAX_AXES],
    before: Option<(Feedback, Instruments, bool)>,
    held_scans: u32,
    trip: Option<Trip>,
    /// Encoders when the drives went off.
    off_at: Option<[i64; MAX_AXES]>,
    shown: Shown,
    violations: Vec<Violation>,
}

impl std::fmt::Debug for Judge<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Judge")
            .field("shown", &self.shown)
            .field("violations", &self.violations)
            .finish_non_exhaustive()
    }
}

impl<'a> Judge<'a> {
    /// For a run of this program.
    pub fn new(machine: &'a Machine, course: &'a Course) -> Judge<'a> {
        Judge {
            machine,
            course,
            audit: SetpointAudit::at_rest(course.limits.clone(), [0; MAX_AXES]),
            known: Vec::new(),
            in_force: None,
            executed: None,
            unserved: [false; MAX_AXES],
            before: None,
            held_scans: 0,
            trip: None,
            off_at: None,
            shown: Shown::default(),
            violations: Vec::new(),
        }
    }

    fn say(&mut self, scan: u64, what: String) {
        // One is enough to tell; a run that goes wrong goes wrong in every scan that follows.
        if self.violations.len() < 8 {
            self.violations.push(Violation { scan, what });
        }
    }

    /// Takes the next scan. `explained` says whether a fault is why an axis had no command in a scan.
    pub fn take(&mut self, published: &Published<'_>, explained: impl Fn(u64, usize) -> bool) {
        let feedback = published.feedback;
        for window in published.windows {
            self.known.push(Arc::clone(window));
        }
        let surplus = self.known.len().saturating_sub(WINDOWS_KNOWN);
        self.known.drain(..surplus);
        let before = self.before.take();
        if let Some((before, _, unserved)) = &before {
            self.command_positions(before, feedback);
            self.missed(before, feedback, explained);
            self.losses(before, feedback, *unserved);
        }
        self.serve(published);
        self.setpoints(before.as_ref().map(|(f, _, _)| f), feedback);
        self.open_loops(before.as_ref().map(|(f, _, _)| f), feedback);
        self.speeds(feedback);
        self.hold(before.as_ref().map(|(f, _, _)| f), feedback);
        self.tables(before.as_ref(), feedback, published.instruments);
        self.shown.scans = feedback.scan;
        self.shown.mode = Mode::from_wire(feedback.mode);
        self.shown.cause = Cause::from_wire(feedback.cause);
        self.shown.digest = (
            published.instruments.motion_digest_high,
            published.instruments.motion_digest_low,
        );
        let unserved = self.unserved(published.roster);
        self.before = Some((*feedback, *published.instruments, unserved));
    }

    /// Whether some axis has no servo that lives.
    fn unserved(&self, roster: &Roster) -> bool {
        (0..self.machine.axes.len())
            .any(|axis| (0..2).all(|role| roster.living(Job::Servo, axis, role).is_none()))
    }

    /// Setpoints: known, within the limits, on the path, beginning where the command positions are.
    fn setpoints(&mut self, before: Option<&Feedback>, feedback: &Feedback) {
        let scan = feedback.scan;
        self.executed = None;
        let command_positions = feedback.axes.map(|axis| axis.command_position);
        if feedback.window.is_none() {
            self.in_force = None;
            self.audit = SetpointAudit::at_rest(self.course.limits.clone(), command_positions);
            return;
        }
        let took_over = self
            .in_force
            .as_ref()
            .is_none_or(|window| window.header.id != feedback.window);
        if took_over {
            let is_it = |w: &&Arc<Window>| w.header.id == feedback.window;
            let found = self.known.iter().rev().find(is_it).map(Arc::clone);
            let starts = self.in_force.is_none();
            self.foreseen(scan);
            self.in_force = found;
            let first = self.in_force.as_ref().and_then(|w| w.setpoints.first());
            let axes = self.machine.axes.len();
            let off = first.is_some_and(|s| s.position[..axes] != command_positions[..axes]);
            if starts && off {
                self.say(scan, "a window begins off the command positions".into());
            }
            if let Some(stop) = self.shown.stops.iter_mut().rev().find(|s| !s.foreseen) {
                stop.until = stop.until.or(Some(scan));
            }
        }
        let Some(window) = self.in_force.clone() else {
            self.say(scan, "a window is in force that nobody sent".into());
            return;
        };
        let Some(setpoint) = window.setpoints.get(feedback.setpoint as usize) else {
            self.say(
                scan,
                format!("setpoint {} is not in its window", feedback.setpoint),
            );
            return;
        };
        let brakes = feedback.setpoint == window.header.intended_setpoints
            && feedback.setpoint < window.header.setpoint_count
            && before
                .is_some_and(|b| b.setpoint < feedback.setpoint || b.window != feedback.window);
        if brakes && window.header.ends_program == 0 && !setpoint.tag.is_off_path() {
            self.shown.stops.push(Stop {
                from: scan,
                until: None,
                foreseen: false,
            });
        }
        if let Err(fault) = self.audit.setpoint(&setpoint.position) {
            self.say(scan, fault.to_string());
        }
        if setpoint.tag != feedback.tag {
            self.say(
                scan,
                "the feedback's tag is not that of the setpoint".into(),
            );
        }
        let tag = setpoint.tag;
        let path = &self.course.path;
        let placed = match tag.is_off_path() {
            true => Ok(()),
            false => self.audit.place(path, tag.element, tag.distance_mm),
        };
        if let Err(fault) = placed {
            self.say(scan, fault.to_string());
        }
        self.executed = Some(setpoint.position);
    }

    /// The window in force is replaced in `scan`: whether it was late enough for its braking to be foreseen.
    fn foreseen(&mut self, scan: u64) {
        let Some(window) = &self.in_force else { return };
        let header = &window.header;
        let setpoints = scan.saturating_sub(header.first_scan);
        let late = setpoints > u64::from(self.machine.scan.interpolation_period_scans);
        let off_path = window
            .setpoints
            .first()
            .is_none_or(|setpoint| setpoint.tag.is_off_path());
        if late
            && setpoints <= header.intended_setpoints.into()
            && header.ends_program == 0
            && !off_path
        {
            self.shown.stops.push(Stop {
                from: header.first_scan + u64::from(header.intended_setpoints),
                until: Some(scan),
                foreseen: true,
            });
        }
    }

    /// The servos were told something else, under a right checksum: in the next scan their commands say that. How far they can go
    /// is the affair of the master's guards.
    pub fn forget_executed(&mut self) {
        self.executed = None;
    }

    /// What was executed is what the command positions say.
    fn command_positions(&mut self, before: &Feedback, feedback: &Feedback) {
        let closed = |f: &Feedback| {
            matches!(
                Mode::from_wire(f.mode),
                Some(Mode::Enabled | Mode::Stopping | Mode::Stopped | Mode::Finished)
            )
        };
        let Some(executed) = self.executed else {
            return;
        };
        if !closed(before)
            || !closed(feedback)
            || self.machine.interpolation.within_period != WithinPeriod::Exact
        {
            return;
        }
        for (index, (axis, was)) in feedback.axes().iter().zip(&executed).enumerate() {
            if axis.missed_in_a_row == 0 && axis.command_position != *was {
                let off = axis.command_position - was;
                self.say(
                    feedback.scan,
                    format!(
                        "axis {index}: command position {off} increments off what was executed"
                    ),
                );
            }
        }
    }

    /// Notes which axes nobody serves.
    fn serve(&mut self, published: &Published<'_>) {
        let axes = self.unserved.iter_mut().zip(published.feedback.axes());
        for (index, (unserved, axis)) in axes.enumerate() {
            let other = 1 - axis.taken_role.min(1);
            let other = published.roster.living(Job::Servo, index, other);
            *unserved = other.is_none() && is_driver_dead(published.roster, index, axis);
        }
    }

    fn missed(
        &mut self,
        before: &Feedback,
        feedback: &Feedback,
        explained: impl Fn(u64, usize) -> bool,
    ) {
        for (index, (was, is)) in before.axes().iter().zip(feedback.axes()).enumerate() {
            if is.missed_scans > was.missed_scans {
                self.shown.missed += 1;
                if !self.unserved[index] && !explained(before.scan, index) {
                    self.say(
                        before.scan,
                        format!("axis {index}: a missed scan that no fault explains"),
                    );
                }
            }
        }
    }

    /// Without a servo, a driven axis comes to rest along the window in force, and trips the machine there.
    fn losses(&mut self, before: &Feedback, feedback: &Feedback, unserved: bool) {
        let mode = Mode::from_wire(before.mode);
        let same_side = before.incarnation == feedback.incarnation;
        let driven = !matches!(mode, Some(Mode::Disabled | Mode::Tripped));
        let rests = before.at_rest == 1;
        if unserved && driven && rests && same_side && feedback.mode != Mode::Tripped as u32 {
            self.say(
                feedback.scan,
                "an axis has no servo, and the machine has not tripped at rest".into(),
            );
        }
    }

    fn position(&self, feedback: &Feedback, index: usize) -> i64 {
        let scale = self
            .machine
            .axes
            .get(index)
            .is_some_and(|a| a.feedback == PositionFeedback::Scale);
        feedback.axes.get(index).map_or(0, |axis| {
            if scale {
                axis.scale_position
            } else {
                axis.motor_position
            }
        })
    }

    /// With open loops the command positions follow the encoders; without drives nothing moves.
    fn open_loops(&mut self, before: Option<&Feedback>, feedback: &Feedback) {
        let scan = feedback.scan;
        let mode = Mode::from_wire(feedback.mode);
        let was = before.map(|b| b.mode);
        let settled = was == Some(feedback.mode);
        let axes = self.machine.axes.len();
        match mode {
            Some(Mode::Tripped) if settled => {
                for index in 0..axes {
                    let off =
                        feedback.axes[index].command_position - self.position(feedback, index);
                    if off != 0 {
                        self.say(
                            scan,
                            format!(
                                "axis {index}: command position {off} increments off its encoder in a trip"
                            ),
                        );
                    }
                }
            }
            Some(Mode::Disabled) => {
                let position: [i64; MAX_AXES] =
                    std::array::from_fn(|index| self.position(feedback, index));
                let same_side = before.is_none_or(|b| b.incarnation == feedback.incarnation);
                let at = *self.off_at.get_or_insert(position);
                for index in 0..axes {
                    let axis = &self.machine.axes[index];
                    let moved_um = (position[index] - at[index]) as f64 * axis.increment_mm() * 1e3;
                    if moved_um.abs() > RELAXES_UM {
                        self.say(
                            scan,
                            format!("axis {index}: moved {moved_um} µm with the drives off"),
                        );
                    }
                    let Some(before) = before.filter(|_| settled && same_side) else {
                        continue;
                    };
                    let command_position =
                        feedback.axes[index].command_position - before.axes[index].command_position;
                    if command_position != position[index] - self.position(before, index) {
                        self.say(
                            scan,
                            format!(
                                "axis {index}: its command position does not follow the encoder"
                            ),
                        );
                    }
                }
                return;
            }
            _ => {}
        }
        self.off_at = None;
    }

    fn speeds(&mut self, feedback: &Feedback) {
        for index in 0..self.machine.axes.len() {
            let (axis, settings) = (&feedback.axes[index], &self.machine.axes[index]);
            let (velocity, command) = (axis.velocity_mm_s, axis.velocity_command_mm_s);
            let most = settings.rapid_mm_s * (1.0 + OVERSHOOT.0) + OVERSHOOT.1;
            if velocity.is_nan() || velocity.abs() > most || !command.is_finite() {
                self.say(
                    feedback.scan,
                    format!("axis {index}: {velocity} mm/s, commanded {command}: at most {most}"),
                );
            }
        }
    }

    /// In hold at rest nothing moves.
    fn hold(&mut self, before: Option<&Feedback>, feedback: &Feedback) {
        let held =
            feedback.hold == 1 && feedback.at_rest == 1 && feedback.mode == Mode::Enabled as u32;
        let periods = self.machine.scan.interpolation_period_scans * HOLD_PERIODS;
        if let Some(before) = before
            && self.held_scans > periods
            && feedback.hold == 1
            && feedback.mode == Mode::Enabled as u32
        {
            let moved = feedback
                .axes()
                .iter()
                .zip(before.axes())
                .any(|(is, was)| is.command_position != was.command_position);
            if moved {
                self.say(feedback.scan, "the command moves in hold".into());
            }
        }
        self.held_scans = if held { self.held_scans + 1 } else { 0 };
    }

    fn tool(&self, instruments: &Instruments) -> AxisVector {
        let last = (instruments.subsamples as usize).saturating_sub(1);
        let mut table = AxisVector::zeros();
        for (value, samples) in table.iter_mut().zip(&instruments.table_mm) {
            *value = samples.get(last).copied().unwrap_or(0.0);
        }
        self.machine.to_program_axes(table.as_mut_slice());
        self.course.limits.setpoints().kinematics.tool(&table)
    }

    fn distance_mm(&self, tool: &AxisVector, element: u32, around: u32) -> f64 {
        let around = element.saturating_sub(around)..=element.saturating_add(around);
        around
            .map_while(|element| self.course.path.get(element))
            .map(|element| element.closest_distance(tool).1)
            .fold(f64::INFINITY, f64::min)
    }

    /// How far the table is from the path.
    fn tables(
        &mut self,
        before: Option<&(Feedback, Instruments, bool)>,
        feedback: &Feedback,
        instruments: &Instruments,
    ) {
        let scan = feedback.scan;
        let tool = self.tool(instruments);
        if !feedback.window.is_none() && !feedback.tag.is_off_path() {
            let off_mm = self.distance_mm(&tool, feedback.tag.element, AROUND);
            if off_mm > self.shown.contour_mm.0 {
                self.shown.contour_mm = (off_mm, scan);
            }
        }
        if feedback.mode != Mode::Tripped as u32 {
            self.trip = None;
            return;
        }
        let Some((before, _, _)) = before else {
            return;
        };
        if before.mode != Mode::Tripped as u32 {
            self.shown.trips += 1;
            self.trip = Some(self.trip_of(before, feedback, &tool));
        }
        let Some(trip) = self.trip else {
            return;
        };
        let age = scan - trip.since;
        let stands = feedback
            .axes()
            .iter()
            .all(|axis| axis.velocity_mm_s.abs() < STANDS_MM_S);
        if age > trip.stands_within && !stands && !trip.stood {
            self.say(
                scan,
                format!(
                    "an axis still moves {age} scans after the trip: at most {}",
                    trip.stands_within
                ),
            );
        }
        if let Some(trip) = &mut self.trip {
            trip.stood |= stands;
        }
        if !feedback.interrupted_at.is_off_path() {
            let off_mm = self.distance_mm(&tool, feedback.interrupted_at.element, u32::MAX);
            self.shown.deviation_mm = self.shown.deviation_mm.max(off_mm);
            if off_mm > trip.deviation_max_mm {
                self.say(
                    scan,
                    format!(
                        "{off_mm} mm from the path after a trip: at most {} mm",
                        trip.deviation_max_mm
                    ),
                );
            }
        }
    }

    /// What a trip may cost: the way at the speeds of the trip until the slowest quick stop is over, the way of an axis whose
    /// servo was silent until the master commanded it, and the lag.
    fn trip_of(&self, before: &Feedback, feedback: &Feedback, tool: &AxisVector) -> Trip {
        let scan_s = self.machine.scan_period_s();
        let (mut longest_s, mut speed_squared) = (0.0f64, 0.0);
        let mut silent_scans = 0;
        for (axis, settings) in feedback.axes().iter().zip(&self.machine.axes) {
            let speed = axis
                .velocity_mm_s
                .abs()
                .max(axis.velocity_command_mm_s.abs());
            longest_s = longest_s.max(speed / settings.quick_stop_mm_s2);
            speed_squared += speed * speed;
        }
        for axis in before.axes() {
            silent_scans = silent_scans.max(axis.missed_in_a_row.min(BLIND_SCANS) + 1);
        }
        let speed = libm::sqrt(speed_squared);
        // On its way back, it was off the path already.
        let already_mm = if feedback.interrupted_at.is_off_path() {
            0.0
        } else {
            self.distance_mm(tool, feedback.interrupted_at.element, u32::MAX)
        };
        let blind_s = f64::from(silent_scans) * scan_s + LAG_S;
        Trip {
            since: feedback.scan,
            stands_within: libm::ceil((longest_s + BRAKING_SLACK_S) / scan_s) as u64,
            deviation_max_mm: already_mm + speed * (blind_s + longest_s / 2.0) + SPRING_MM,
            stood: false,
        }
    }

    /// The run has ended: what it has shown, and what must not be.
    pub fn end(mut self) -> (Shown, Vec<Violation>) {
        let last = self.before.take();
        let finished = |f: &Feedback| f.mode == Mode::Finished as u32;
        if let Some((feedback, instruments, _)) = last.filter(|(f, _, _)| finished(f)) {
            let sample = (instruments.subsamples as usize).saturating_sub(1);
            for index in 0..self.machine.axes.len() {
                let settings = &self.machine.axes[index];
                let end = self.course.end[index];
                let off = feedback.axes[index].command_position - end;
                if off != 0 {
                    self.say(
                        feedback.scan,
                        format!("axis {index}: ends {off} increments off the programmed end"),
                    );
                }
                let end_mm = end as f64 * settings.increment_mm();
                let off_um = (instruments.table_mm[index][sample] - end_mm) * 1e3;
                let most = settings.in_position_um + settings.reversal.backlash_um;
                if off_um.abs() > most {
                    self.say(
                        feedback.scan,
                        format!("axis {index}: table {off_um} µm off the end: at most {most} µm"),
                    );
                }
            }
        }
        (self.shown, self.violations)
    }
}
