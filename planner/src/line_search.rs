//! Start at a line: reads a program up to the first motion of a line, and what stands before it comes to.

use bus::sample::{EventCode, PATH_AXES, ProgramEvent};
use machine::Machine;
use program::Setup;

use crate::ahead::Course;
use crate::error::AheadError;
use crate::in_step;
use crate::levels_before::LevelsBefore;
use crate::place::Place;
use crate::program_text::ProgramText;

/// Why a program cannot be started at a line.
#[derive(Debug, thiserror::Error)]
pub enum LineError {
    /// The program up to there.
    #[error(transparent)]
    Program(#[from] AheadError),
    /// No motion begins there.
    #[error(
        "line {line}: no motion begins here: a program starts at a line that moves the tool{near}"
    )]
    NoMotion {
        /// The line.
        line: u32,
        /// The lines around it that do, in words.
        near: String,
    },
    /// What stands before it depends on an answer of the machine.
    #[error(
        "line {asked_in}: asks the machine, and nobody knows what it would answer: a program that probes or reads inputs starts before that"
    )]
    Asks {
        /// The line that asks.
        asked_in: u32,
    },
    /// The tool is in step with the spindle there.
    #[error("line {line}: lies within a thread: start before it, at the motion to its beginning")]
    InThread {
        /// The line.
        line: u32,
    },
}

/// Where a program is to be started.
#[derive(Debug, Clone, PartialEq)]
pub struct StartPlace {
    /// The first element of the line.
    pub element: u32,
    /// Events before it.
    pub events: u32,
    /// Events that set the levels which those leave, counted from 1.
    pub levels: Vec<ProgramEvent>,
}

/// Reads a program, so much in a period, until it comes to a line.
#[derive(Debug, Clone)]
pub(crate) struct LineSearch {
    line: u32,
    course: Course,
    /// Elements before this one are not of the line.
    looked_at: u32,
    levels: LevelsBefore,
    /// Events whose levels are in there.
    events: u32,
    asked_in: u32,
    /// The nearest lines that move.
    before: Option<u32>,
    behind: Option<u32>,
    found: Option<StartPlace>,
}

impl LineSearch {
    /// Nothing read yet of a program that is expanded from these command positions, in increments.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn new(
        machine: &Machine,
        text: &ProgramText,
        start: [i64; PATH_AXES],
        line: u32,
    ) -> Result<LineSearch, LineError> {
        Ok(LineSearch {
            line,
            course: Course::new(machine, text, start, None, Setup::of(machine))?,
            looked_at: 0,
            levels: LevelsBefore::default(),
            events: 0,
            asked_in: 0,
            before: None,
            behind: None,
            found: None,
        })
    }

    /// Whether it looks for this line, from these command positions.
    pub fn is_for(&self, line: u32, start: &[i64; PATH_AXES]) -> bool {
        self.line == line && self.course.start == *start
    }

    /// Where the line is, once that is known.
    pub fn found(&self) -> Option<&StartPlace> {
        self.found.as_ref()
    }

    /// Hash of the program.
    pub fn program_hash(&self) -> u64 {
        self.course.program_hash
    }

    /// Elements before this one are not of the line.
    pub fn looked_at(&self) -> u32 {
        self.looked_at
    }

    /// Places on the way, for planners after this one.
    pub fn take_places(&mut self) -> Vec<Place> {
        std::mem::take(&mut self.course.places)
    }

    /// Reads as much as one period allows; where the line is, once it is found.
    ///
    /// # Errors
    /// [`LineError`].
    pub fn step(&mut self) -> Result<Option<&StartPlace>, LineError> {
        if self.found.is_none() {
            let from = self.course.windows.path().end();
            self.course.read_on(from, false);
            let found = self.first_of_line(from);
            self.take_events(found);
            match found {
                Some(element) => self.found = Some(self.place(element)?),
                None if self.course.is_over() => return Err(self.not_found()),
                None => self.looked_at = self.course.windows.path().end(),
            }
        }
        Ok(self.found.as_ref())
    }

    /// The first element of the line that moves, from an element on.
    fn first_of_line(&mut self, from: u32) -> Option<u32> {
        let path = self.course.windows.path();
        for number in from..path.end() {
            let Some(element) = path.get(number).filter(|of| of.length_mm > 0.0) else {
                continue;
            };
            let nearest = match element.line.cmp(&self.line) {
                std::cmp::Ordering::Equal => return Some(number),
                std::cmp::Ordering::Less => &mut self.before,
                std::cmp::Ordering::Greater => &mut self.behind,
            };
            let is_nearer = |of: &u32| of.abs_diff(self.line) > element.line.abs_diff(self.line);
            if nearest.as_ref().is_none_or(is_nearer) {
                *nearest = Some(element.line);
            }
        }
        None
    }

    /// Takes the events before the element that was found, up to those of its own line; all of them as long as none was.
    fn take_events(&mut self, found: Option<u32>) {
        while let Some((event, in_motion)) = self.course.events.next() {
            let is_behind = match found {
                Some(element) if event.element == element => event.line == self.line || in_motion,
                Some(element) => event.element > element,
                None => false,
            };
            if is_behind {
                break;
            }
            let asks = [EventCode::Probe as u32, EventCode::AwaitInput as u32];
            if asks.contains(&event.code) {
                self.asked_in = event.line;
            }
            self.events = event.number;
            self.levels.take(&event);
            self.course.events.forget(event.number);
        }
        self.course.events.forget_messages();
    }

    fn place(&self, element: u32) -> Result<StartPlace, LineError> {
        let passes = &self.course.events.passes;
        let before = element.checked_sub(1);
        let within = before.is_some_and(|before| in_step::pass_of(passes, before).is_some())
            && in_step::pass_of(passes, element).is_some();
        if within || self.levels.is_in_thread {
            return Err(LineError::InThread { line: self.line });
        }
        Ok(StartPlace {
            element,
            events: self.events,
            levels: self.levels.events(),
        })
    }

    fn not_found(&mut self) -> LineError {
        if let Some(refused) = self.course.refusal() {
            return refused.into();
        }
        if self.course.asks().is_some() {
            return LineError::Asks {
                asked_in: self.asked_in,
            };
        }
        let near = match (self.before, self.behind) {
            (Some(before), Some(behind)) => format!(", as lines {before} and {behind} do"),
            (Some(line), None) | (None, Some(line)) => format!(", as line {line} does"),
            (None, None) => String::new(),
        };
        LineError::NoMotion {
            line: self.line,
            near,
        }
    }
}

/// Where a program is to be started that is expanded from these command positions, in increments.
///
/// # Errors
/// [`LineError`].
pub fn start_place(
    machine: &Machine,
    text: &ProgramText,
    start: [i64; PATH_AXES],
    line: u32,
) -> Result<StartPlace, LineError> {
    let mut search = LineSearch::new(machine, text, start, line)?;
    loop {
        search.take_places();
        if let Some(place) = search.step()? {
            return Ok(place.clone());
        }
    }
}

#[cfg(test)]
mod tests;
