//! What must hold in every scan, whatever dies, hangs or lies (docs/developers/invariants.md). Pure: fed with what was published.
//!
//! One judge in two layers. [`Feedbacks`] needs nothing but the feedbacks, some of which may be unseen: the soak has it of real
//! processes. [`Judge`] adds what a cell in one process shows beside them:
//!
//! | name | in words | tolerance |
//! |---|---|---|
//! | setpoints | rows that are executed keep every axis's limits, on whole increments | none |
//! | tags | a row that is executed lies where the tag of its scan says | 1 increment, or of the setpoints |
//! | windows | what is in force was sent, begins at the command positions, and has the setpoint that the feedback names | none |
//! | executed | the command positions are what was executed | none |
//! | missed scans | scans are missed only where a fault says why, or where an axis has no servo | none |
//! | lost servo | an axis without any servo trips the machine once it rests | none |
//! | deviation | a trip leaves the path by no more than the axes travel until they stand | 0.02 s of lag, 0.05 mm |
//! | table | a program that is done leaves the table at its end | in-position window and backlash |

use std::sync::Arc;

use audit::SetpointAudit;
use bus::sample::{
    AxisFeedback, Cause, Feedback, Instruments, Job, MAX_AXES, Mode, PATH_AXES, Roster,
};
use machine::{Machine, WithinPeriod};
use path::geometry::{AxisVector, Element};
use path::limits::MotionLimits;
use path::path_part::PathPart;
use planner::CourseError;
use plant_sim::plant_file::PlantFile;
use program::Program;

use crate::cell::{Published, Window};
pub use feedbacks::Feedbacks;
use feedbacks::{braking_s, fastest_mm_s};

mod feedbacks;

/// Windows that are remembered by their names.
const WINDOWS_KNOWN: usize = 16;
/// A silent servo's drive holds its last command for so many scans before the master commands it.
const BLIND_SCANS: u32 = 3;
/// Beyond the way until the stop: lag of the axes behind their commands, in s of way.
const LAG_S: f64 = 0.02;
/// And what the screw springs back, in mm.
const SPRING_MM: f64 = 0.05;
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
    pub end: [i64; PATH_AXES],
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
        Ok(Course::of_program(machine, program)?)
    }

    /// Of a program that is read.
    ///
    /// # Errors
    /// It cannot be travelled on this machine: why.
    pub fn of_program(machine: &Machine, program: Program) -> Result<Course, CourseError> {
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

/// The first ones of a run.
#[derive(Debug, Default)]
pub struct Violations(pub Vec<Violation>);

impl Violations {
    /// More are not kept: a run that goes wrong goes wrong in every scan that follows.
    const KEPT: usize = 40;

    /// Notes one.
    pub fn say(&mut self, scan: u64, what: String) {
        if self.0.len() < Self::KEPT {
            self.0.push(Violation { scan, what });
        }
    }
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

/// Judges one run.
pub struct Judge<'a> {
    machine: &'a Machine,
    course: &'a Course,
    audit: SetpointAudit,
    known: Vec<Arc<Window>>,
    in_force: Option<Arc<Window>>,
    /// The setpoint that was executed in the scan before.
    executed: Option<[i64; PATH_AXES]>,
    /// Axes whose servo has died, and that have no other one: whoever comes is no driver before its first command is taken.
    unserved: [bool; MAX_AXES],
    feedbacks: Feedbacks,
    before: Option<(Feedback, Instruments, bool)>,
    /// In a trip, so far the table may be from the path, in mm.
    deviation_max_mm: Option<f64>,
    shown: Shown,
    violations: Violations,
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
            audit: SetpointAudit::at_rest(course.limits.clone(), [0; PATH_AXES]),
            known: Vec::new(),
            in_force: None,
            executed: None,
            unserved: [false; MAX_AXES],
            feedbacks: Feedbacks::new(machine),
            before: None,
            deviation_max_mm: None,
            shown: Shown::default(),
            violations: Violations::default(),
        }
    }

    fn say(&mut self, scan: u64, what: String) {
        self.violations.say(scan, what);
    }

    /// Takes the next scan. `explained` says whether a fault is why an axis had no command in a scan.
    pub fn take(&mut self, published: &Published<'_>, explained: impl Fn(u64, usize) -> bool) {
        let feedback = published.feedback;
        for window in published.windows {
            self.known.push(Arc::clone(window));
        }
        let surplus = self.known.len().saturating_sub(WINDOWS_KNOWN);
        self.known.drain(..surplus);
        self.feedbacks
            .take(self.course, feedback, &mut self.violations);
        let before = self.before.take();
        if let Some((before, _, unserved)) = &before {
            self.command_positions(before, feedback);
            self.missed(before, feedback, explained);
            self.losses(before, feedback, *unserved);
        }
        self.serve(published);
        self.setpoints(before.as_ref().map(|(f, _, _)| f), feedback);
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
        let command_positions = feedback.path_positions();
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
            let off = first.is_some_and(|first| first.position != command_positions);
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
        let axes = executed.iter().take(feedback.path_axes as usize);
        for (index, (axis, was)) in feedback.axes().iter().zip(axes).enumerate() {
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

    fn tool(&self, instruments: &Instruments) -> AxisVector {
        let last = instruments.last().unwrap_or(0);
        let table = instruments.places_mm(last, |axis| &axis.table_mm);
        let table = self.machine.to_program_axes(table);
        self.course
            .limits
            .setpoints()
            .kinematics
            .tool(&table.into())
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
            self.deviation_max_mm = None;
            return;
        }
        let Some((before, _, _)) = before else {
            return;
        };
        if before.mode != Mode::Tripped as u32 {
            self.shown.trips += 1;
            self.deviation_max_mm = Some(self.deviation_max_mm(before, feedback, &tool));
        }
        if let Some(most) = self.deviation_max_mm
            && !feedback.interrupted_at.is_off_path()
        {
            let off_mm = self.distance_mm(&tool, feedback.interrupted_at.element, u32::MAX);
            self.shown.deviation_mm = self.shown.deviation_mm.max(off_mm);
            if off_mm > most {
                let words = format!("{off_mm} mm from the path after a trip: at most {most} mm");
                self.say(scan, words);
            }
        }
    }

    /// What a trip may cost: the way at the speeds of the trip until the slowest quick stop is over, the way of an axis whose
    /// servo was silent until the master commanded it, and the lag.
    fn deviation_max_mm(&self, before: &Feedback, feedback: &Feedback, tool: &AxisVector) -> f64 {
        let longest_s = braking_s(self.machine, feedback);
        let speeds = feedback.axes().iter().map(fastest_mm_s);
        let speed = libm::sqrt(speeds.map(|speed| speed * speed).sum());
        let silent = before.axes().iter().map(|axis| axis.missed_in_a_row);
        let silent_scans = silent.max().map_or(0, |scans| scans.min(BLIND_SCANS) + 1);
        // On its way back, it was off the path already.
        let already_mm = if feedback.interrupted_at.is_off_path() {
            0.0
        } else {
            self.distance_mm(tool, feedback.interrupted_at.element, u32::MAX)
        };
        let blind_s = f64::from(silent_scans) * self.machine.scan_period_s() + LAG_S;
        already_mm + speed * (blind_s + longest_s / 2.0) + SPRING_MM
    }

    /// The run has ended: what it has shown, and what must not be.
    pub fn end(mut self) -> (Shown, Vec<Violation>) {
        self.feedbacks.end(self.course, &mut self.violations);
        let last = self.before.take();
        let finished = |f: &Feedback| f.mode == Mode::Finished as u32;
        if let Some((feedback, instruments, _)) = last.filter(|(f, _, _)| finished(f)) {
            let last = instruments.last().unwrap_or(0);
            let tables_mm = instruments.places_mm(last, |axis| &axis.table_mm);
            for (index, settings) in self.machine.program_axes().iter().enumerate() {
                let end_mm = self.course.end[index] as f64 * settings.increment_mm();
                let off_um = (tables_mm[index] - end_mm) * 1e3;
                let most = settings.in_position_um + settings.reversal.backlash_um;
                if off_um.abs() > most {
                    self.say(
                        feedback.scan,
                        format!("axis {index}: table {off_um} µm off the end: at most {most} µm"),
                    );
                }
            }
        }
        (self.shown, self.violations.0)
    }
}
