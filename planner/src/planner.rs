//! The planner, pure: from the feedback of a period boundary to the next window.

use bus::messages::ProgramMessage;
use bus::sample::{
    Cause, Feedback, PATH_AXES, PathTag, PlannerStatus, ProgramState, Reference, Setpoint,
    WindowHeader, WindowId,
};
use bus::user_codes::UserCall;
use bus::window::checksum;
use bytemuck::Zeroable;
use machine::settings_file::SettingsFileError;
use machine::{KeptTexts, Machine};
use path::profile::PathState;
use path::speed_map::first_mapped;
use path::window::{Lead, PlanError, PlannedSetpoint, WindowRequest};
use program::Setup;

use crate::ahead::Course;
use crate::error::AheadError;
use crate::in_step;
use crate::kept_parameters::Left;
use crate::line_search::LineSearch;
use crate::place::{PLACE_ELEMENTS, Place};
use crate::program_text::ProgramText;
use crate::questions::{KeptAnswer, hash_of};
use crate::return_to_path::ReturnToPath;
use crate::situation::Situation;

mod blocks;
mod start_at_line;
mod status;

/// Scans from the feedback a window answers until it can be executed: seen by the servos in the next, admitted by the
/// master for the one after.
const COMMIT_SCANS: u64 = 2;

/// A window that was published, with what the next one needs to start from any of its setpoints.
#[derive(Debug, Clone)]
struct Published {
    header: WindowHeader,
    states: Vec<PathState>,
    /// What leads its setpoints, and those before it as far as they count.
    leads: Vec<Lead>,
    leads_before: Vec<Lead>,
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
            leads: Vec::with_capacity(setpoints_max),
            leads_before: Vec::with_capacity(setpoints_max),
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

    /// Fills `leads` with those of the last so many setpoints up to the one executed in `scan`, or of as many as there were since a rest.
    fn leads_until(&self, scan: u64, count: usize, leads: &mut Vec<Lead>) {
        leads.clear();
        let setpoints = scan.saturating_sub(self.header.first_scan) as usize + 1;
        let of_window = setpoints.min(self.leads.len());
        // Past its end a window is on its last setpoint.
        let held = (setpoints - of_window).min(count);
        let of_window_first = (of_window + held).saturating_sub(count);
        let own = self.leads.get(of_window_first..of_window).unwrap_or(&[]);
        let missing = count - held - own.len();
        let before_first = self.leads_before.len().saturating_sub(missing);
        leads.extend(self.leads_before.get(before_first..).unwrap_or(&[]));
        leads.extend(own);
        let last = leads.last().copied();
        leads.extend(last.iter().cycle().take(held));
    }

    /// Whether the setpoint executed in `scan` is the end of its path.
    fn is_done_in(&self, scan: u64) -> bool {
        let setpoint = scan.saturating_sub(self.header.first_scan) + 1;
        self.ends_path && setpoint >= u64::from(self.header.intended_setpoints)
    }
}

/// Where the next window starts, and on which path.
#[derive(Debug, Clone, Copy)]
struct From {
    state: PathState,
    /// On the return to where the path was left.
    returns: bool,
    /// Setpoint 0 is the state itself: the machine is there, and no window is in force.
    starts: bool,
    /// It goes on from the setpoint of this scan in the window in force.
    after: Option<u64>,
}

impl From {
    fn program(state: PathState, starts: bool) -> From {
        From {
            state,
            returns: false,
            starts,
            after: None,
        }
    }
}

/// What the planner answers at a period boundary.
#[derive(Debug)]
pub struct Decision<'a> {
    /// Always published, also with nothing new.
    pub status: PlannerStatus,
    /// The next window.
    pub window: Option<(WindowHeader, &'a [Setpoint])>,
    /// What the program says around here: to be written before the two others are published.
    pub messages: &'a [ProgramMessage],
    /// The machine, with what the program began with.
    pub machine: &'a Machine,
    /// The window is the last one: the modes to be kept before it is published.
    pub modes: Option<String>,
    /// The program is at its end: what is to be kept before the status is published.
    pub left: Option<Left>,
    /// The program rests before a user M-code: it is to have run before the status is published.
    pub user_call: Option<UserCall>,
}

/// What a planner remembers beside what it has published.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Inner {
    /// Its window in force and the one that it waits for, and whether each of them returns to the path.
    pub windows: [(WindowId, bool); 2],
    /// Command positions that the program is expanded from.
    pub expanded_from: Option<[i64; PATH_AXES]>,
    /// Command positions that a return to the path was planned from.
    pub returns_from: Option<[i64; PATH_AXES]>,
    /// Why it cannot go on.
    pub cause: Cause,
}

/// Why a planner cannot go on.
#[derive(Debug, Clone)]
struct Trouble {
    why: String,
    /// It was handed out to be written.
    told: bool,
}

/// The planner.
#[derive(Debug, Clone)]
pub struct Planner {
    /// The machine, with what its program began with.
    pub machine: Machine,
    program: Option<ProgramText>,
    /// Its number, as in the feedback.
    pub load: u32,
    incarnation: u32,
    period_scans: u64,
    course: Option<Course>,
    /// A place that a planner before this one has kept.
    place: Option<Place>,
    /// What the machine has answered in this run, and which run it is.
    answers: Vec<KeptAnswer>,
    run: Option<(u32, u32)>,
    return_to_path: Option<ReturnToPath>,
    /// The search for the line that the program is to be started at.
    search: Option<LineSearch>,
    in_force: Published,
    pending: Published,
    sequence: u32,
    /// Why it cannot go on.
    trouble: Option<Trouble>,
    /// Whether the program ran in the feedback before.
    ran: bool,
    setpoints: Vec<PlannedSetpoint>,
    leads: Vec<Lead>,
    wire: Vec<Setpoint>,
    messages: Vec<ProgramMessage>,
}

impl Planner {
    /// A planner of one program; its path is read when the machine is first seen enabled, from where it then stands.
    pub fn of(machine: &Machine, program: ProgramText, incarnation: u32) -> Planner {
        Planner {
            program: Some(program),
            ..Planner::idle(machine, incarnation)
        }
    }

    /// A planner without a program: [`Planner::load`] brings one.
    pub fn idle(machine: &Machine, incarnation: u32) -> Planner {
        let setpoints_max = bus::sample::MAX_WINDOW_SETPOINTS + 1;
        Planner {
            machine: machine.clone(),
            program: None,
            load: 0,
            incarnation,
            period_scans: u64::from(machine.scan.interpolation_period_scans),
            course: None,
            place: None,
            answers: Vec::new(),
            run: None,
            return_to_path: None,
            search: None,
            in_force: Published::none(setpoints_max),
            pending: Published::none(setpoints_max),
            sequence: 0,
            trouble: None,
            ran: false,
            setpoints: Vec::with_capacity(setpoints_max),
            leads: Vec::with_capacity(setpoints_max),
            wire: Vec::with_capacity(setpoints_max),
            messages: Vec::new(),
        }
    }

    /// What it remembers beside what it has published: for a model that asks whether two planners will do the same from now on.
    pub fn inner(&self) -> Inner {
        let window = |window: &Published| (window.header.id, window.returns);
        Inner {
            windows: [window(&self.in_force), window(&self.pending)],
            expanded_from: self.course.as_ref().map(|course| course.start),
            returns_from: self.return_to_path.as_ref().map(|way| way.from),
            cause: self.cause(),
        }
    }

    /// Takes the program that the feedback names, in place of the one before. One that could not be read, or
    /// that is new to the cell and cannot be planned from where the axes are, is refused in the status.
    pub fn load(&mut self, program: Result<ProgramText, String>, feedback: &Feedback) {
        self.load = feedback.load;
        self.trouble = None;
        self.ran = false;
        self.read_anew();
        let refused = program.as_ref().err().cloned();
        self.program = program.ok();
        if let Some(why) = refused {
            self.give_up(why);
        } else if feedback.program == ProgramState::Loading as u32 {
            self.expanded_from(self.presumed_start(feedback), feedback);
        }
    }

    /// It cannot go on, for this reason, which is told once. The first of several counts.
    pub fn give_up(&mut self, why: impl ToString) {
        if self.trouble.is_none() {
            let why = why.to_string();
            tracing::error!("{why}");
            self.trouble = Some(Trouble { why, told: false });
        }
    }

    /// Why it cannot go on, where that is new: as a text of the program.
    pub fn new_trouble(&mut self) -> Option<ProgramMessage> {
        let trouble = self.trouble.as_mut().filter(|trouble| !trouble.told)?;
        trouble.told = true;
        Some(ProgramMessage::trouble(&trouble.why))
    }

    fn cause(&self) -> Cause {
        match self.trouble {
            Some(_) => Cause::Planner,
            None => Cause::None,
        }
    }

    /// A program that was given up by an operator is read from its beginning, as if nothing had been wrong.
    fn forget_trouble_of_run(&mut self, feedback: &Feedback) {
        let runs = feedback.program == ProgramState::Running as u32;
        if std::mem::replace(&mut self.ran, runs) && !runs && self.trouble.take().is_some() {
            self.read_anew();
        }
    }

    /// Command positions to read a program from. Where an axis without a reference is, nobody knows: somewhere within its travel. Once
    /// it is homed, the program is read again from there.
    fn presumed_start(&self, feedback: &Feedback) -> [i64; PATH_AXES] {
        let mut start = Situation::of(feedback).positions;
        let shown = feedback.axes().iter().zip(self.machine.program_axes());
        for (place, (shown, axis)) in start.iter_mut().zip(shown) {
            if shown.reference != Reference::Known as u32 {
                let [low, high] = axis.travel_increments();
                *place = (*place).clamp(low, high.max(low));
            }
        }
        start
    }

    /// Whether this feedback is of another run than the answers that the planner knows.
    pub fn is_other_run(&self, feedback: &Feedback) -> bool {
        self.run != Some((feedback.load, feedback.run))
    }

    /// Takes what the machine has answered so far in the run of this feedback.
    pub fn begin_run(&mut self, answers: Vec<KeptAnswer>, feedback: &Feedback) {
        let other = self.run.replace((feedback.load, feedback.run));
        let course = self.course.as_ref();
        let has_begun = course.is_some_and(|course| course.events.has_begun());
        if answers != self.answers || other.is_some() && has_begun {
            self.answers = answers;
            self.read_anew();
        }
    }

    /// Takes what programs before and operators have kept; the program is read again with anything else.
    ///
    /// # Errors
    /// It could not be read.
    pub fn take_kept(
        &mut self,
        kept: Result<Option<KeptTexts>, SettingsFileError>,
    ) -> Result<(), String> {
        let taken = match kept {
            Ok(Some(kept)) => self.machine.take_kept(kept),
            Ok(None) => Ok(false),
            Err(error) => Err(error),
        };
        if taken.map_err(|error| error.to_string())? {
            self.read_anew();
        }
        Ok(())
    }

    fn read_anew(&mut self) {
        self.course = None;
        self.place = None;
        self.return_to_path = None;
        self.in_force.header = WindowHeader::zeroed();
        self.pending.header = WindowHeader::zeroed();
    }

    /// The answer to what the program asks now, if the feedback has it: to be kept before it is [taken](Planner::take_answer).
    pub fn new_answer(&self, feedback: &Feedback) -> Option<KeptAnswer> {
        let (number, probes) = self.course.as_ref()?.asks()?;
        KeptAnswer::of(feedback, number, probes, self.answers.len() as u32)
    }

    /// Goes on with an answer, as a planner that has come after it would: from where the axes rest.
    pub fn take_answer(&mut self, answer: KeptAnswer) {
        let of_program = answer.for_program(&self.machine);
        self.answers.push(answer);
        self.in_force.header = WindowHeader::zeroed();
        self.pending.header = WindowHeader::zeroed();
        match (of_program, &mut self.course) {
            (Ok(answer), Some(course)) => course.answer(answer),
            (Err(error), _) => self.give_up(error),
            _ => {}
        }
    }

    /// The element up to which the program has come, if a place before it that was kept would save this planner from reading it all.
    pub fn wants_place(&self, feedback: &Feedback) -> Option<u32> {
        let is_new = self.course.is_none() && self.place.is_none() && self.program.is_some();
        let left_at = Situation::of(feedback).left_at?;
        let is_far = left_at.element > PLACE_ELEMENTS;
        (is_new && is_far && self.trouble.is_none()).then_some(left_at.element)
    }

    /// A place that was kept, to read on from. One behind answers is one of this run alone.
    pub fn take_place(&mut self, place: Place) {
        let of_this_run = self.answers_hash(place.answers) == Some(place.answers_hash);
        self.place = Some(place).filter(|_| of_this_run);
    }

    /// Hash of the first so many answers; none as long as there are fewer.
    fn answers_hash(&self, count: u32) -> Option<u64> {
        self.answers.get(..count as usize).map(hash_of)
    }

    /// Places that are to be kept for planners after this one.
    pub fn new_places(&mut self) -> Vec<Place> {
        let places = match (&mut self.search, &mut self.course) {
            (Some(search), _) => search.take_places(),
            (None, Some(course)) => std::mem::take(&mut course.places),
            (None, None) => Vec::new(),
        };
        let of_this_run = places.into_iter().filter_map(|place| {
            let answers_hash = self.answers_hash(place.answers)?;
            Some(Place {
                answers_hash,
                ..place
            })
        });
        of_this_run.collect()
    }

    /// Answers the feedback of a period boundary (or of a later scan, if it woke late).
    pub fn scan(&mut self, feedback: &Feedback) -> Decision<'_> {
        self.forget_trouble_of_run(feedback);
        self.seek_line(feedback);
        self.read_on(feedback);
        let header = self.next_window(feedback);
        if let Some(header) = header {
            self.pending.header = header;
            self.pending.states.clear();
            self.pending
                .states
                .extend(self.setpoints.iter().map(|setpoint| setpoint.state));
            self.pending.leads.clear();
            let leads = self.setpoints.iter().map(|setpoint| setpoint.lead);
            self.pending.leads.extend(leads);
            std::mem::swap(&mut self.pending.leads_before, &mut self.leads);
        }
        self.say(feedback);
        let status = self.status(feedback);
        let left = self.to_keep(&status);
        let ends = header.is_some_and(|header| header.ends_program == 1);
        let modes = self.course.as_ref().filter(|_| ends);
        let modes = modes.map(Course::modes_left);
        let user_call = self.user_call(&status, feedback);
        Decision {
            messages: &self.messages,
            machine: &self.machine,
            modes,
            left,
            user_call,
            status,
            window: header.map(|header| (header, self.wire.as_slice())),
        }
    }

    fn next_window(&mut self, feedback: &Feedback) -> Option<WindowHeader> {
        self.settle_pending(feedback);
        if self.course.is_none() && self.is_waited_for(feedback) {
            // Only who has read the program knows what was asked.
            self.expanded_from(feedback.program_start, feedback);
        }
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
        let from = self.waiting_behind_block(from, feedback)?;
        self.window_from(&from, feedback, first_scan)
    }

    /// What the next window is to do.
    fn request(&self, from: &From, feedback: &Feedback) -> WindowRequest {
        let situation = Situation::of(feedback);
        let rapid_override = f64::from(feedback.inputs.rapid_override_percent()) / 100.0;
        let feed_override = f64::from(situation.override_percent) / 100.0;
        WindowRequest {
            intended_setpoints: self.machine.intended_setpoints(),
            // A planned return is one of the rapids.
            feed_override: match from.returns {
                true => feed_override.min(1.0) * rapid_override,
                false => feed_override,
            },
            rapid_override,
            hold: situation.hold || situation.blocked,
            single_block: feedback.inputs.single_block() && !from.returns,
            repeats_start: from.starts,
            ..WindowRequest::default()
        }
    }

    /// The window that begins in `first_scan`.
    fn window_from(
        &mut self,
        from: &From,
        feedback: &Feedback,
        first_scan: u64,
    ) -> Option<WindowHeader> {
        let request = self.request(from, feedback);
        let course = self.course.as_mut()?;
        let program_hash = course.program_hash;
        let leads_max = course.windows.limits().smoothing_scans() as usize + 1;
        match from.after {
            Some(scan) => self.in_force.leads_until(scan, leads_max, &mut self.leads),
            None => self.leads.clear(),
        }
        if self.leads.is_empty() {
            let windows = match from.returns {
                true => &self.return_to_path.as_ref()?.windows,
                false => &course.windows,
            };
            let at_rest = windows.setpoint(&from.state);
            self.leads.extend(at_rest.map(|setpoint| setpoint.lead));
        }
        let planned = if from.returns {
            let windows = &mut self.return_to_path.as_mut()?.windows;
            windows.plan_behind(&from.state, &self.leads, &request, &mut self.setpoints)
        } else {
            let from = (&from.state, self.leads.as_slice());
            let when = (&self.machine, first_scan);
            course.plan(from, request, feedback, when, &mut self.setpoints)
        };
        let is_whole = course.is_whole();
        let outcome = match planned {
            Ok(outcome) => outcome,
            Err(PlanError::NotAtHand) if !is_whole => return None,
            Err(error) => {
                self.give_up(format!("no window can be planned: {error}"));
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
            ends_program: u32::from(outcome.ends_program && !from.returns && is_whole),
        };
        header.id.checksum = checksum(&header, &self.wire);
        Some(header)
    }

    /// Whether a window is due: the machine is enabled and blocked by nothing, and no window waits to be taken.
    fn may_plan(&self, feedback: &Feedback) -> bool {
        let situation = Situation::of(feedback);
        let may_read = situation.enabled && situation.referenced && situation.seeks_line.is_none();
        // The master wants no motion: what moves comes to rest first.
        let waits = situation.blocked && situation.rests;
        may_read && !waits && self.can_go_on() && self.pending.is_none()
    }

    /// Whether the master wants no motion before this planner has told what it knows.
    fn is_waited_for(&self, feedback: &Feedback) -> bool {
        let situation = Situation::of(feedback);
        let asked = situation.blocked && feedback.answer.number > 0;
        asked && situation.enabled && situation.left_at.is_some() && self.can_go_on()
    }

    /// Whether there is a program, and nothing that speaks against it.
    fn can_go_on(&self) -> bool {
        self.trouble.is_none() && self.program.is_some()
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
        let situation = Situation::of(feedback);
        if situation.left_at.is_none() {
            self.expanded_from(situation.positions, feedback)?;
            let start = self.course.as_ref()?.windows.start_state();
            return Some(From::program(start, true));
        }
        self.expanded_from(feedback.program_start, feedback)?;
        self.return_to_path(feedback)
    }

    /// The window in force is that of a planner before this one: it brings the machine to rest on the path, and from there
    /// the program goes on.
    fn take_over(&mut self, feedback: &Feedback) -> Option<From> {
        self.expanded_from(feedback.program_start, feedback)?;
        let situation = Situation::of(feedback);
        let stands = situation.hold || situation.override_percent == 0;
        if !situation.rests || !feedback.armed.is_none() || stands {
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

    /// Begins to read the program from these command positions, if that is not done yet.
    ///
    /// The scan that does it has nothing new to say; a window that came to nothing is planned again.
    fn expanded_from(&mut self, start: [i64; PATH_AXES], feedback: &Feedback) -> Option<()> {
        if self.course.as_ref().is_some_and(|c| c.start == start) {
            return Some(());
        }
        match self.begin(start, feedback) {
            Ok(course) => self.course = Some(course),
            Err(why) => {
                self.course = None;
                self.give_up(why);
            }
        }
        None
    }

    /// The program from these command positions, read so far that it can begin, or as far as one scan allows.
    fn begin(&self, start: [i64; PATH_AXES], feedback: &Feedback) -> Result<Course, String> {
        let program = self.program.as_ref().ok_or("there is no program")?;
        let left_at = Situation::of(feedback).left_at;
        let element = left_at.map_or(0, |tag| tag.element);
        let reaches = |place: &&Place| first_mapped(place.element) <= element;
        let place = self.place.as_ref().filter(reaches);
        let answers = self.answers.iter();
        let answers: Result<Vec<_>, _> = answers
            .map(|kept| kept.for_program(&self.machine))
            .collect();
        let course = answers.map_err(|error| AheadError::Program(error.into()));
        let course = course.and_then(|answers| {
            let setup = Setup {
                answers,
                ..Setup::of(&self.machine)
            };
            Course::new(&self.machine, program, start, place, setup)
        });
        let mut course = course.map_err(|error| error.to_string())?;
        course.read_on(element, false);
        // A mistake that is met before anything moves refuses the program; a later one stops it where it stands.
        if let (Some(refused), None) = (course.refused(), place) {
            return Err(refused.to_string());
        }
        Ok(course)
    }

    /// Reads on ahead of the tool. What was refused is told once the tool rests before it.
    fn read_on(&mut self, feedback: &Feedback) {
        let situation = Situation::of(feedback);
        let element = situation.tool_element();
        let Some(course) = &mut self.course else {
            return;
        };
        course.read_on(element, !situation.rests);
        course.events.forget(feedback.auxiliary.events_done);
        course.events.forget_passes(element);
        if let Some(refused) = course.refused()
            && self.trouble.is_none()
            && situation.rests
            && self.in_force.header.id == feedback.window
            && self.in_force.ends_path
            && !self.in_force.returns
            && self.in_force.is_done_in(feedback.scan)
        {
            let why = refused.to_string();
            self.give_up(why);
        }
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
        if !course.windows.is_mapped(interrupted_at.element) {
            return None;
        }
        let probed = Some(interrupted_at.element) == course.events.probed;
        let end_mm = windows.path().get(interrupted_at.element);
        let end_mm = end_mm.map_or(0.0, |element| element.length_mm);
        let resumed = PathState::resume(
            windows.path(),
            interrupted_at.element,
            if probed {
                // It ends where the axes have come to rest behind the trip.
                end_mm
            } else {
                interrupted_at.distance_mm
            },
            interrupted_at.dwell_remaining_scans,
        );
        if feedback.program_hash != course.program_hash {
            return self.is_another_program();
        }
        let place =
            resumed.and_then(|state| Some((state, windows.setpoint(&state)?.position_increments)));
        let Some((state, position)) = place else {
            self.give_up("the place where the path was left is not on the path of this program");
            return None;
        };
        let here = Situation::of(feedback).positions;
        if here == position {
            return Some(From::program(state, true));
        }
        // A tap in its thread goes on from where it stands; what it is off its line is made up for so slowly that the spindle follows.
        let mut state = state;
        let coupled = feedback.auxiliary.coupled != 0;
        let tap = in_step::pass_of(&course.events.passes, state.element);
        if let Some(tap) = tap.filter(|pass| pass.tap && coupled) {
            state.distance_mm = in_step::distance_on(windows, &tap, &here)?;
            if windows.setpoint(&state)?.position_increments == here {
                return Some(From::program(state, true));
            }
        }
        let plans = |way: &ReturnToPath| way.from == here && way.to == state;
        if !self.return_to_path.as_ref().is_some_and(plans) {
            match ReturnToPath::new(&self.machine, here, state, windows.path(), coupled) {
                Ok(return_to_path) => self.return_to_path = Some(return_to_path),
                Err(error) => {
                    self.give_up(error);
                    return None;
                }
            }
        }
        let state = self.return_to_path.as_ref()?.windows.start_state();
        Some(From {
            state,
            returns: true,
            starts: true,
            after: None,
        })
    }

    fn is_another_program(&mut self) -> Option<From> {
        let name = self.program.as_ref().map(ProgramText::name);
        let name = name.unwrap_or_default();
        self.give_up(format!(
            "{name}: changed since the program was started; it cannot go on in the middle of another one"
        ));
        None
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
        let held = Situation::of(feedback).held()
            || self.waits_for_rapids(&state, returns && !done, feedback);
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
            after: (!done).then_some(before),
        })
    }
}

fn wire_setpoint(setpoint: &PlannedSetpoint) -> Setpoint {
    const _: () = assert!(PATH_AXES == path::geometry::PATH_AXES);
    Setpoint {
        position: setpoint.position_increments,
        tag: PathTag {
            distance_mm: setpoint.state.distance_mm,
            element: setpoint.state.element,
            dwell_remaining_scans: setpoint.state.dwell_remaining_scans,
        },
    }
}
