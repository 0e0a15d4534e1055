//! The planner, pure: from the feedback of a period boundary to the next window.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::{
    Cause, Feedback, MAX_AXES, Mode, PathTag, PlannerStatus, ProgramEvent, ProgramState, Setpoint,
    WindowHeader, WindowId,
};
use bus::window::checksum;
use bytemuck::Zeroable;
use control::profile::PathState;
use control::window::{PlanError, PlannedSetpoint, WindowOutcome, WindowPlanner, WindowRequest};
use machine::Machine;
use program::ResumeError;

use crate::course::{CourseError, course};
use crate::events::Events;
use crate::return_to_path::ReturnToPath;

/// Scans from the feedback a window answers until it can be executed: seen by the servos in the next, admitted by the
/// master for the one after.
const COMMIT_SCANS: u64 = 2;

/// A window that was published, with what the next one needs to start from any of its setpoints.
#[derive(Debug, Clone)]
struct Published {
    header: WindowHeader,
    states: Vec<PathState>,
    /// It returns to where the path was left.
    returns: bool,
    /// The last intended setpoint is the end of its path: of the program, or of the return.
    ends_path: bool,
}

impl Published {
    fn none(setpoints_max: usize) -> Published {
        Published {
            header: WindowHeader::zeroed(),
            states: Vec::with_capacity(setpoints_max),
            returns: false,
            ends_path: false,
        }
    }

    fn is_none(&self) -> bool {
        self.header.id.is_none()
    }

    /// The state of the setpoint executed in `scan`.
    fn state_in(&self, scan: u64) -> Option<PathState> {
        let index = scan.saturating_sub(self.header.first_scan) as usize;
        self.states
            .get(index.min(self.states.len().saturating_sub(1)))
            .copied()
    }

    /// Whether the setpoint executed in `scan` is the end of its path.
    fn is_done_in(&self, scan: u64) -> bool {
        let setpoint = scan.saturating_sub(self.header.first_scan) + 1;
        self.ends_path && setpoint >= u64::from(self.header.intended_setpoints)
    }
}

/// The path of a program, ready to plan along.
#[derive(Debug, Clone)]
struct Course {
    windows: WindowPlanner,
    events: Events,
    program_hash: u64,
    /// Command positions it was expanded from, in increments.
    start: [i64; MAX_AXES],
    /// Path length before each element, in mm; one more for the whole.
    length_before_mm: Vec<f64>,
}

/// Where the next window starts, and on which path.
#[derive(Debug, Clone, Copy)]
struct From {
    state: PathState,
    /// On the return to where the path was left.
    returns: bool,
    /// Setpoint 0 is the state itself: the machine is there, and no window is in force.
    starts: bool,
}

impl From {
    fn program(state: PathState, starts: bool) -> From {
        From {
            state,
            returns: false,
            starts,
        }
    }
}

/// Why a program cannot be planned.
#[derive(Debug, thiserror::Error)]
enum StartError {
    #[error(transparent)]
    Program(#[from] ResumeError),
    #[error(transparent)]
    Course(#[from] CourseError),
}

/// What the planner answers at a period boundary.
#[derive(Debug)]
pub struct Decision<'a> {
    /// Always published, also with nothing new.
    pub status: PlannerStatus,
    /// The next window.
    pub window: Option<(WindowHeader, &'a [Setpoint])>,
}

/// What a planner remembers beside what it has published.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Inner {
    /// Its window in force and the one that it waits for, and whether each of them returns to the path.
    pub windows: [(WindowId, bool); 2],
    /// Command positions that the program is expanded from.
    pub expanded_from: Option<[i64; MAX_AXES]>,
    /// Command positions that a return to the path was planned from.
    pub returns_from: Option<[i64; MAX_AXES]>,
    /// Why it cannot go on.
    pub cause: Cause,
}

/// The planner.
#[derive(Debug, Clone)]
pub struct Planner {
    machine: Machine,
    program_name: String,
    program_text: Option<String>,
    /// Its number, as in the feedback.
    load: u32,
    incarnation: u32,
    period_scans: u64,
    course: Option<Course>,
    return_to_path: Option<ReturnToPath>,
    in_force: Published,
    pending: Published,
    sequence: u32,
    cause: Cause,
    setpoints: Vec<PlannedSetpoint>,
    wire: Vec<Setpoint>,
}

impl Planner {
    /// A planner of one program; the path is expanded when the machine is first seen enabled, from where it then stands.
    pub fn new(
        machine: &Machine,
        program_name: &str,
        program_text: String,
        incarnation: u32,
    ) -> Planner {
        Planner {
            program_name: program_name.into(),
            program_text: Some(program_text),
            ..Planner::idle(machine, incarnation)
        }
    }

    /// A planner without a program: [`Planner::load`] brings one.
    pub fn idle(machine: &Machine, incarnation: u32) -> Planner {
        let setpoints_max = bus::sample::MAX_WINDOW_SETPOINTS + 1;
        Planner {
            machine: machine.clone(),
            program_name: String::new(),
            program_text: None,
            load: 0,
            incarnation,
            period_scans: u64::from(machine.scan.interpolation_period_scans),
            course: None,
            return_to_path: None,
            in_force: Published::none(setpoints_max),
            pending: Published::none(setpoints_max),
            sequence: 0,
            cause: Cause::None,
            setpoints: Vec::with_capacity(setpoints_max),
            wire: Vec::with_capacity(setpoints_max),
        }
    }

    /// What it remembers beside what it has published: for a model that asks whether two planners will do the same from now on.
    pub fn inner(&self) -> Inner {
        let window = |window: &Published| (window.header.id, window.returns);
        Inner {
            windows: [window(&self.in_force), window(&self.pending)],
            expanded_from: self.course.as_ref().map(|course| course.start),
            returns_from: self.return_to_path.as_ref().map(|way| way.from),
            cause: self.cause,
        }
    }

    /// Number of the program it has, as in the feedback.
    pub fn loaded(&self) -> u32 {
        self.load
    }

    /// Takes the program (name and text) that the feedback names, in place of the one before. One that could not be read, or
    /// that is new to the cell and cannot be planned from where the axes are, is refused in the status.
    pub fn load(&mut self, program: Option<(String, String)>, feedback: &Feedback) {
        self.load = feedback.load;
        self.cause = Cause::None;
        self.course = None;
        self.return_to_path = None;
        self.in_force.header = WindowHeader::zeroed();
        self.pending.header = WindowHeader::zeroed();
        let Some((name, text)) = program else {
            self.program_text = None;
            self.cause = Cause::Planner;
            return;
        };
        self.program_name = name;
        self.program_text = Some(text);
        if feedback.program == ProgramState::Loading as u32 {
            self.expanded_from(command_positions(feedback));
        }
    }

    /// Answers the feedback of a period boundary (or of a later scan, if it woke late).
    pub fn scan(&mut self, feedback: &Feedback) -> Decision<'_> {
        let header = self.next_window(feedback);
        if let Some(header) = header {
            self.pending.header = header;
            self.pending.states.clear();
            self.pending
                .states
                .extend(self.setpoints.iter().map(|setpoint| setpoint.state));
        }
        Decision {
            status: self.status(feedback),
            window: header.map(|header| (header, self.wire.as_slice())),
        }
    }

    fn next_window(&mut self, feedback: &Feedback) -> Option<WindowHeader> {
        self.settle_pending(feedback);
        if !self.may_plan(feedback) {
            return None;
        }
        let first_scan = feedback
            .scan
            .saturating_add(COMMIT_SCANS)
            .checked_next_multiple_of(self.period_scans)?;
        let from = if feedback.window.is_none() {
            self.start(feedback)?
        } else if feedback.window == self.in_force.header.id {
            self.go_on(feedback, first_scan)?
        } else {
            self.take_over(feedback)?
        };
        let request = WindowRequest {
            intended_setpoints: self.machine.intended_setpoints(),
            feed_override: f64::from(override_percent(feedback)) / 100.0,
            hold: feedback.hold == 1 || feedback.auxiliary.blocked == 1,
            repeats_start: from.starts,
            ..WindowRequest::default()
        };
        let course = self.course.as_mut()?;
        let program_hash = course.program_hash;
        let planned = if from.returns {
            let windows = &mut self.return_to_path.as_mut()?.windows;
            windows.plan(&from.state, &request, &mut self.setpoints)
        } else {
            course.plan(&from, request, feedback, &mut self.setpoints)
        };
        let outcome = match planned {
            Ok(outcome) => outcome,
            Err(error) => {
                tracing::error!(%error, "no window can be planned");
                self.cause = Cause::Planner;
                return None;
            }
        };
        self.wire.clear();
        let setpoints = self.setpoints.iter().map(wire_setpoint);
        self.wire.extend(setpoints.map(|setpoint| Setpoint {
            tag: if from.returns {
                PathTag::OFF_PATH
            } else {
                setpoint.tag
            },
            ..setpoint
        }));
        self.pending.returns = from.returns;
        self.pending.ends_path = outcome.ends_program;
        self.sequence += 1;
        let mut header = WindowHeader {
            id: WindowId {
                checksum: 0,
                sequence: self.sequence,
                incarnation: self.incarnation,
            },
            predecessor: feedback.window,
            first_scan,
            visible_from: feedback.scan.saturating_add(1),
            program_hash,
            epoch: feedback.epoch,
            intended_setpoints: outcome.intended_setpoints,
            setpoint_count: outcome.setpoint_count,
            ends_program: u32::from(outcome.ends_program && !from.returns),
        };
        header.id.checksum = checksum(&header, &self.wire);
        Some(header)
    }

    /// Whether a window is due: the machine is enabled and blocked by nothing, and no window waits to be taken.
    fn may_plan(&self, feedback: &Feedback) -> bool {
        Mode::from_wire(feedback.mode) == Some(Mode::Enabled)
            && self.cause == Cause::None
            && self.program_text.is_some()
            && self.pending.is_none()
            && !is_blocked(feedback)
    }

    /// Learns from the feedback what became of the window that was published last.
    fn settle_pending(&mut self, feedback: &Feedback) {
        let pending = self.pending.header;
        if pending.id.is_none() {
            return;
        }
        let overdue = feedback.scan >= pending.first_scan;
        if feedback.window == pending.id {
            std::mem::swap(&mut self.in_force, &mut self.pending);
            self.pending.header = WindowHeader::zeroed();
        } else if feedback.voided == pending.id || overdue {
            self.pending.header = WindowHeader::zeroed();
        }
    }

    /// The state before the first setpoint, once the program is expanded.
    ///
    /// A program that was never started starts where the machine is. One that was goes on where its path was left,
    /// whoever planned it.
    fn start(&mut self, feedback: &Feedback) -> Option<From> {
        if feedback.interrupted_at.is_off_path() {
            self.expanded_from(command_positions(feedback))?;
            let start = self.course.as_ref()?.windows.start_state();
            return Some(From::program(start, true));
        }
        self.expanded_from(feedback.program_start)?;
        self.return_to_path(feedback)
    }

    /// The window in force is that of a planner before this one: it brings the machine to rest on the path, and from there
    /// the program goes on.
    fn take_over(&mut self, feedback: &Feedback) -> Option<From> {
        self.expanded_from(feedback.program_start)?;
        if feedback.at_rest == 0 || !feedback.armed.is_none() {
            return None;
        }
        if feedback.hold == 1 || override_percent(feedback) == 0 {
            return None;
        }
        let from = self.return_to_path(feedback)?;
        // The window in force goes on standing there; what follows it starts with the first step from it. Also at the
        // path's end: that window may have come to rest there only by braking, and does not end the program.
        Some(From {
            starts: false,
            ..from
        })
    }

    /// Expands the program from these command positions, if it is not yet.
    ///
    /// Expanding takes as long as the program is, so the scan that does it has nothing new to say; a window that came to
    /// nothing is planned again.
    fn expanded_from(&mut self, start: [i64; MAX_AXES]) -> Option<()> {
        if self.course.as_ref().is_some_and(|c| c.start == start) {
            return Some(());
        }
        match self.expand(start) {
            Ok(course) => self.course = Some(course),
            Err(error) => {
                tracing::error!("{error}");
                self.cause = Cause::Planner;
            }
        }
        None
    }

    /// The axes were moved by hand or pushed: the return to where the path was left, once somebody has resumed. An
    /// axis outside its travel is not moved by any plan.
    fn return_to_path(&mut self, feedback: &Feedback) -> Option<From> {
        if feedback.hold == 1 {
            return None;
        }
        let course = self.course.as_ref()?;
        let interrupted_at = feedback.interrupted_at;
        let windows = &course.windows;
        let resumed = PathState::resume(
            windows.path(),
            interrupted_at.element,
            interrupted_at.distance_mm,
            interrupted_at.dwell_remaining_scans,
        );
        if feedback.program_hash != course.program_hash {
            tracing::error!(
                "{}: changed since the program was started; it cannot go on in the middle of another one",
                self.program_name
            );
            self.cause = Cause::Planner;
            return None;
        }
        let place =
            resumed.and_then(|state| Some((state, windows.setpoint(&state)?.position_increments)));
        let Some((state, position)) = place else {
            tracing::error!("the place where the path was left is not on the path of this program");
            self.cause = Cause::Planner;
            return None;
        };
        let here = command_positions(feedback);
        if here == position {
            return Some(From::program(state, true));
        }
        let plans = |way: &ReturnToPath| way.from == here && way.to == state;
        if !self.return_to_path.as_ref().is_some_and(plans) {
            match ReturnToPath::new(&self.machine, here, state, windows.path()) {
                Ok(return_to_path) => self.return_to_path = Some(return_to_path),
                Err(error) => {
                    tracing::error!("{error}");
                    self.cause = Cause::Planner;
                    return None;
                }
            }
        }
        let state = self.return_to_path.as_ref()?.windows.start_state();
        Some(From {
            state,
            returns: true,
            starts: true,
        })
    }

    fn expand(&self, command_positions: [i64; MAX_AXES]) -> Result<Course, StartError> {
        let text = self.program_text.as_deref().unwrap_or_default();
        let program =
            program::resume_from(&self.machine, &command_positions, &self.program_name, text)?;
        let program_hash = program.source_hash;
        let (windows, events) = course(&self.machine, program)?;
        let mut length_mm = 0.0;
        let mut length_before_mm = vec![0.0];
        for element in &windows.path().elements {
            length_mm += element.length_mm;
            length_before_mm.push(length_mm);
        }
        Ok(Course {
            windows,
            events,
            program_hash,
            start: command_positions,
            length_before_mm,
        })
    }

    /// The state before `first_scan` in the window in force; none where nothing is left to plan.
    fn go_on(&self, feedback: &Feedback, first_scan: u64) -> Option<From> {
        let before = first_scan - 1;
        let returns = self.in_force.returns;
        let done = self.in_force.is_done_in(before);
        let state = match (done, returns) {
            (true, false) => return None,
            // Back on the path: the program goes on from the very place.
            (true, true) => self.return_to_path.as_ref()?.to,
            (false, _) => self.in_force.state_in(before)?,
        };
        let held = feedback.hold == 1 || override_percent(feedback) == 0;
        if held && state.is_at_rest() {
            return None;
        }
        let course = self.course.as_ref()?;
        if !returns && course.is_held_back(&state, feedback) {
            return None;
        }
        Some(From {
            state,
            returns: returns && !done,
            starts: false,
        })
    }

    /// The event that the path rests for now, on the program's path and with nothing on the way.
    fn event(&self, feedback: &Feedback) -> Option<ProgramEvent> {
        let course = self.course.as_ref()?;
        let in_force = &self.in_force;
        let rests = feedback.at_rest == 1
            && feedback.hold == 0
            && !feedback.window.is_none()
            && feedback.window == in_force.header.id
            && !in_force.returns
            && self.pending.is_none();
        if !rests || self.cause != Cause::None {
            return None;
        }
        let state = in_force.state_in(feedback.scan)?;
        let next = course.events.at_rest(feedback.auxiliary.events_done)?;
        course
            .windows
            .is_held_back(&state, next.element)
            .then_some(*next)
    }

    fn status(&self, feedback: &Feedback) -> PlannerStatus {
        let (path_length_mm, path_done_mm, program_hash) =
            self.course.as_ref().map_or((0.0, 0.0, 0), |course| {
                let lengths = &course.length_before_mm;
                // Off the path, what is done is what was done when it was left.
                let tag = if feedback.tag.is_off_path() {
                    feedback.interrupted_at
                } else {
                    feedback.tag
                };
                let before = lengths.get(tag.element as usize);
                (
                    lengths.last().copied().unwrap_or(0.0),
                    before.copied().unwrap_or(0.0) + tag.distance_mm,
                    course.program_hash,
                )
            });
        let last = if self.pending.is_none() {
            &self.in_force
        } else {
            &self.pending
        };
        PlannerStatus {
            scan: feedback.scan,
            visible_from: feedback.scan.saturating_add(1),
            program_hash,
            published: last.header.id,
            path_length_mm,
            path_done_mm,
            incarnation: self.incarnation,
            finished: last.header.ends_program,
            cause: self.cause as u32,
            windows: self.sequence,
            load: self.load,
            event: self.event(feedback).unwrap_or_default(),
            outputs_ahead: self
                .course
                .as_ref()
                .map_or_else(Default::default, |course| {
                    course.events.ahead(feedback.auxiliary.events_done)
                }),
            ..PlannerStatus::default()
        }
    }
}

impl Course {
    /// Whether motion from this state waits for an event that is not done.
    fn is_held_back(&self, state: &PathState, feedback: &Feedback) -> bool {
        let until_element = self.events.until_element(feedback.auxiliary.events_done);
        self.windows.is_held_back(state, until_element)
    }

    /// A window along the program, up to where an event is done at rest, and no further than the outputs go that the master knows.
    fn plan(
        &mut self,
        from: &From,
        mut request: WindowRequest,
        feedback: &Feedback,
        setpoints: &mut Vec<PlannedSetpoint>,
    ) -> Result<WindowOutcome, PlanError> {
        let done = feedback.auxiliary.events_done;
        request.until_element = self.events.until_element(done);
        let first_untold = self.events.first_untold(done);
        loop {
            let outcome = self.windows.plan(&from.state, &request, setpoints)?;
            let last = setpoints.last();
            if request.hold || last.is_none_or(|last| last.state.element < first_untold) {
                return Ok(outcome);
            }
            request.hold = request.intended_setpoints <= 1;
            request.intended_setpoints = (request.intended_setpoints / 2).max(1);
        }
    }
}

/// Override that counts now, in percent.
fn override_percent(feedback: &Feedback) -> u32 {
    if feedback.auxiliary.override_disabled == 1 {
        100
    } else {
        feedback.override_percent
    }
}

/// Whether the master wants no motion yet. Whoever moves comes to rest first.
fn is_blocked(feedback: &Feedback) -> bool {
    feedback.auxiliary.blocked == 1 && feedback.at_rest == 1
}

/// Where the axes are commanded to be, in increments.
fn command_positions(feedback: &Feedback) -> [i64; MAX_AXES] {
    feedback.axes.map(|axis| axis.command_position)
}

fn wire_setpoint(setpoint: &PlannedSetpoint) -> Setpoint {
    const _: () = assert!(MAX_AXES == control::path::MAX_AXES);
    Setpoint {
        position: setpoint.position_increments,
        tag: PathTag {
            distance_mm: setpoint.state.distance_mm,
            element: setpoint.state.element,
            dwell_remaining_scans: setpoint.state.dwell_remaining_scans,
        },
    }
}
