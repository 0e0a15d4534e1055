//! The path of a program, read ahead of the tool: blocks in, events and elements out, mapped as far as is known.
//!
//! What is made of a program does not depend on when it is read: reading only has to be far enough ahead. What lies behind the tool is let go, so the
//! length of a program takes no memory.

use std::iter::Peekable;
use std::sync::Arc;

use bus::sample::{Feedback, PATH_AXES};
use machine::Machine;
use path::geometry::{Element, Feed};
use path::profile::PathState;
use path::window::{Lead, PlanError, PlannedSetpoint, WindowOutcome, WindowPlanner, WindowRequest};

use crate::kept_parameters::Left;
use program::{Message, Note, Piece, Progress, Question, Reading, ResumeError, Setup};

use crate::course::{
    AHEAD_ELEMENTS, AT_ONCE_ELEMENTS, BLOCKS_AT_A_TIME, BLOCKS_IN_MOTION, Reach, motion_limits,
    window_planner_ahead,
};
use crate::error::{AheadError, CourseError};
use crate::events::Events;
use crate::in_step::{self, InStep};
use crate::place::{PLACE_ELEMENTS, Place};
use crate::program_text::ProgramText;

/// Blocks read in one period while the axes stand.
const BLOCKS_AT_REST: usize = 16_384;

/// A program as far as it is read.
#[derive(Debug, Clone)]
pub(crate) struct Course {
    pub windows: WindowPlanner,
    pub events: Events,
    pub program_hash: u64,
    /// Command positions it was expanded from, in increments.
    pub start: [i64; PATH_AXES],
    in_step: InStep,
    reading: Reading,
    piece: Piece,
    reach: Reach,
    /// Where the tool is at the start of the program.
    tool: path::geometry::AxisVector,
    /// All of it is read.
    is_read: bool,
    /// It is read up to here, and what comes next is refused for this reason.
    refused: Option<Arc<AheadError>>,
    /// The elements before which a place is due.
    next_place: u32,
    /// Places to be kept for planners after this one.
    pub places: Vec<Place>,
    /// What the program asks where its path ends for now.
    asked: Option<Asked>,
}

/// A question that has no answer yet.
#[derive(Debug, Clone)]
struct Asked {
    /// Number of its event.
    number: u32,
    /// It is a probe's: its way is the last element, and is read again with the answer.
    probes: bool,
    /// The program as it was read before that element.
    before: Box<Course>,
}

impl Course {
    /// Nothing read yet of a program that starts from these command positions, or goes on from a place; `setup` is the machine's, with the
    /// answers that it has given.
    pub fn new(
        machine: &Machine,
        text: &ProgramText,
        start: [i64; PATH_AXES],
        place: Option<&Place>,
        setup: Setup,
    ) -> Result<Course, AheadError> {
        let tool = program::tool_at(machine, &start).map_err(ResumeError::from)?;
        let setup = Arc::new(setup);
        let mut reading = text.read(&setup, tool).map_err(ResumeError::from)?;
        let program_hash = reading.source_hash();
        let place = place.filter(|place| place.program_hash == program_hash);
        let place = place.filter(|place| reading.resume(&place.reading).is_ok());
        let (first, start_mm) = place.map_or((0, 0.0), |place| (place.element, place.start_mm));
        let events = match place {
            Some(place) => Events::after(machine, &place.events),
            None => Events::new(machine),
        };
        let limits = motion_limits(machine).map_err(CourseError::from)?;
        Ok(Course {
            windows: window_planner_ahead(machine, first, start_mm)?,
            events,
            program_hash,
            start,
            in_step: InStep::default(),
            reading,
            piece: Piece::default(),
            reach: Reach::of(machine, &limits),
            tool,
            is_read: false,
            refused: None,
            next_place: first + PLACE_ELEMENTS,
            places: Vec::new(),
            asked: None,
        })
    }

    /// Reads on, if not enough is known ahead of the tool at this element; `in_motion`, less at a time.
    pub fn read_on(&mut self, element: u32, in_motion: bool) {
        let wanted = element.saturating_add(AHEAD_ELEMENTS);
        let lacking = wanted.saturating_sub(self.windows.path().end());
        let mut blocks = match in_motion {
            true if lacking > AT_ONCE_ELEMENTS => 4 * BLOCKS_IN_MOTION,
            true => BLOCKS_IN_MOTION,
            false => BLOCKS_AT_REST,
        };
        let mut grown = false;
        while blocks > 0 && !self.is_read && self.windows.path().end() < wanted {
            blocks = blocks.saturating_sub(BLOCKS_AT_A_TIME);
            self.windows
                .forget_behind(element.min(self.windows.path().end()));
            if let Err(error) = self.read_piece() {
                self.refused = Some(Arc::new(error));
                self.end();
            }
            self.windows.map_on();
            grown = true;
        }
        if !grown {
            self.windows
                .forget_behind(element.min(self.windows.path().end()));
        }
    }

    /// Some blocks more. What stands before a mistake is taken.
    fn read_piece(&mut self) -> Result<(), AheadError> {
        let read = self.reading.read(BLOCKS_AT_A_TIME, &mut self.piece);
        let taken = self.take_piece();
        let progress = read.map_err(ResumeError::from);
        taken?;
        match progress? {
            Progress::More => self.note_place(),
            Progress::Asks => self.ask()?,
            Progress::Ended(end) => {
                let elements = self.windows.path().end();
                self.events.end_program(elements, end);
                self.end();
            }
        }
        Ok(())
    }

    fn take_piece(&mut self) -> Result<(), CourseError> {
        let mut piece = std::mem::take(&mut self.piece);
        let messages = std::mem::take(&mut piece.messages);
        let mut messages = messages.iter().peekable();
        let mut events = piece.events.drain(..).zip(0u64..).peekable();
        for mut element in piece.elements.drain(..) {
            let number = self.windows.path().end();
            let here = |before_element: usize| before_element <= number as usize;
            while let Some((event, index)) = events.next_if(|next| here(next.0.before_element)) {
                self.say_before(&mut messages, |message| message.before_event <= index);
                self.events.read(&event)?;
            }
            self.say_before(&mut messages, |message| here(message.before_element));
            self.events.meet(number, &mut element)?;
            self.reach.check(&element)?;
            self.windows.push(element)?;
        }
        for (event, index) in events {
            self.say_before(&mut messages, |message| message.before_event <= index);
            self.events.read(&event)?;
        }
        self.say_before(&mut messages, |_| true);
        self.piece = piece;
        Ok(())
    }

    /// Hands on the messages that come next, as long as `is_next` says so.
    fn say_before<'a>(
        &mut self,
        messages: &mut Peekable<impl Iterator<Item = &'a Message>>,
        is_next: impl Fn(&Message) -> bool,
    ) {
        while let Some(message) = messages.next_if(|message| is_next(message)) {
            self.events.say(message);
        }
    }

    /// Nothing more is known before the answer is. The way of a probe is taken as the program has it.
    fn ask(&mut self) -> Result<(), CourseError> {
        let (Some((number, probes)), Some(question)) =
            (self.events.question, self.reading.question().cloned())
        else {
            return Ok(());
        };
        let places = std::mem::take(&mut self.places);
        let before = Box::new(self.clone());
        self.places = places;
        if let Question::Probe { mut element, .. } = question {
            let at = self.windows.path().end();
            self.events.meet(at, &mut element)?;
            self.reach.check(&element)?;
            self.windows.push(element)?;
        }
        self.asked = Some(Asked {
            number,
            probes,
            before,
        });
        self.end();
        Ok(())
    }

    /// The event whose answer the program cannot be read on without: its number, and whether it is a probe's.
    pub fn asks(&self) -> Option<(u32, bool)> {
        let asked = self.asked.as_ref()?;
        Some((asked.number, asked.probes))
    }

    /// Reads on with the answer. What was planned along the way of a probe is not on the path any more.
    pub fn answer(&mut self, answer: program::Answer) {
        let Some(asked) = self.asked.take() else {
            return;
        };
        *self = *asked.before;
        if let Err(error) = self.reading.answer(answer) {
            self.refused = Some(Arc::new(ResumeError::from(error).into()));
            self.end();
        }
    }

    /// Nothing more comes. A program without motion waits at its start for no time.
    fn end(&mut self) {
        self.is_read = true;
        let elements = self.windows.path().end();
        self.events.end(elements);
        if elements == 0 {
            let pushed = self.windows.push(Element::dwell(1, self.tool, 0.0));
            if let (Err(error), None) = (pushed, &self.refused) {
                self.refused = Some(Arc::new(CourseError::from(error).into()));
            }
        }
        self.windows.finish();
    }

    /// Keeps the place between two blocks every so many elements, where no event waits for its element.
    fn note_place(&mut self) {
        let element = self.windows.path().end();
        if element < self.next_place {
            return;
        }
        let Some(events) = self.events.behind() else {
            return;
        };
        self.next_place = element.saturating_add(PLACE_ELEMENTS);
        self.places.push(Place {
            program_hash: self.program_hash,
            element,
            start_mm: self.windows.path().length_mm(),
            events,
            answers: self.reading.answers_taken() as u32,
            answers_hash: 0,
            reading: self.reading.snapshot(),
        });
    }
    /// What comes next is refused for this reason, once all before it is read.
    pub fn refused(&self) -> Option<&AheadError> {
        self.refused.as_deref()
    }

    /// The same, taken out.
    pub fn refusal(&mut self) -> Option<AheadError> {
        Arc::into_inner(self.refused.take()?)
    }

    /// What outlives the run, as the blocks that were read leave it.
    pub fn left(&self) -> Left {
        Left {
            parameters: self.reading.kept_parameters(),
            tools: self.reading.tools().to_vec(),
        }
    }

    /// The modes that the blocks which were read leave to the next run.
    pub fn modes_left(&self) -> String {
        self.reading.modes_left()
    }

    /// What was accepted with a remark so far.
    pub fn notes(&self) -> Vec<Note> {
        self.reading.notes()
    }

    /// Whether nothing more is read: it is at its end, or refused.
    pub fn is_over(&self) -> bool {
        self.is_read
    }

    /// Whether all of it is read, to its end.
    pub fn is_whole(&self) -> bool {
        self.is_read && self.refused.is_none() && self.asked.is_none()
    }

    /// Whether the motion from this state begins with a rapid.
    pub fn is_before_rapid(&self, state: &PathState) -> bool {
        let path = self.windows.path();
        let left_mm = |element: u32| match element == state.element {
            true => state.distance_mm,
            false => 0.0,
        };
        let mut ahead = (state.element..path.end()).map(|element| (path.get(element), element));
        let next = ahead.find_map(|(of, element)| {
            let is_left = |of: &&Element| of.is_dwell() || left_mm(element) < of.length_mm;
            of.filter(is_left)
        });
        next.is_some_and(|next| !next.is_dwell() && next.feed == Feed::Rapid)
    }

    /// Elements up to the end of the block of the program that this state rests at; none within a block, and at the end of the path.
    pub fn block_end(&self, state: &PathState) -> Option<u32> {
        let path = self.windows.path();
        let element = path.get(state.element)?;
        let does_something = |of: &Element| of.is_dwell() || of.length_mm > 0.0;
        let is_over = state.distance_mm >= element.length_mm && state.dwell_remaining_scans == 0;
        if !state.is_at_rest() || !is_over || !does_something(element) {
            return None;
        }
        let mut behind = (state.element.saturating_add(1)..path.end()).map(|next| path.get(next));
        let next = behind.find_map(|next| next.filter(|next| does_something(next)))?;
        (next.line != element.line).then_some(state.element.saturating_add(1))
    }

    /// Whether motion from this state waits for an event that is not done.
    pub fn is_held_back(&self, state: &PathState, feedback: &Feedback) -> bool {
        let until_element = self.events.until_element(feedback.auxiliary.events_done);
        self.windows.is_held_back(state, until_element)
    }

    /// A window along the program from a state, with the leads before it, up to where an event is done at rest, and no further than the outputs go that the master knows.
    pub fn plan(
        &mut self,
        (from, before): (&PathState, &[Lead]),
        mut request: WindowRequest,
        feedback: &Feedback,
        (machine, first_scan): (&Machine, u64),
        setpoints: &mut Vec<PlannedSetpoint>,
    ) -> Result<WindowOutcome, PlanError> {
        let done = feedback.auxiliary.events_done;
        request.until_element = self.events.until_element(done);
        let passes = &self.events.passes;
        let windows = &self.windows;
        let pass = in_step::pass_from(passes, windows.path(), from, request.until_element);
        if let Some(pass) = pass.filter(|_| !from.waits_for_start) {
            let asked = in_step::Request {
                window: &request,
                feedback,
                first_scan,
                machine,
            };
            return self.in_step.plan(windows, pass, from, &asked, setpoints);
        }
        let next = in_step::first_pass_behind(passes, from);
        request.until_element = request.until_element.min(next);
        let first_untold = self.events.first_untold(done);
        loop {
            let outcome = self
                .windows
                .plan_behind(from, before, &request, setpoints)?;
            let last = setpoints.last();
            if request.hold || last.is_none_or(|last| last.state.element < first_untold) {
                return Ok(outcome);
            }
            request.hold = request.intended_setpoints <= 1;
            request.intended_setpoints = (request.intended_setpoints / 2).max(1);
        }
    }
}

#[cfg(test)]
mod tests;
