//! Start at a line: what stands before it is read and not travelled. The master is asked for the levels that it leaves, one after
//! another, and then to begin at the place; the planned return to the path is the way there (docs/developers/architecture.md, "Events").

use bus::sample::{Cause, EventCode, Feedback, Mode, ProgramEvent};

use super::{Planner, command_positions, tool_element};
use crate::line_search::{LineError, LineSearch};

/// The line that the program is to be started at, as long as the master does not know where that is.
pub(super) fn seeks_line(feedback: &Feedback) -> Option<u32> {
    let line = feedback.auxiliary.start_line;
    (line != 0 && feedback.interrupted_at.is_off_path()).then_some(line)
}

impl Planner {
    /// Reads on to the line that the program is to be started at, from where the axes are.
    pub(super) fn seek_line(&mut self, feedback: &Feedback) {
        let Some(line) = seeks_line(feedback) else {
            self.search = None;
            return;
        };
        if self.course.is_some() {
            // It is read from its beginning once the place is known: its events are counted there.
            self.read_anew();
        }
        let is_enabled = Mode::from_wire(feedback.mode) == Some(Mode::Enabled);
        if !is_enabled || self.cause != Cause::None {
            return;
        }
        if let Err(error) = self.seek(line, feedback) {
            tracing::error!("{error}");
            self.cause = Cause::Planner;
        }
    }

    fn seek(&mut self, line: u32, feedback: &Feedback) -> Result<(), LineError> {
        let start = command_positions(feedback);
        let Some(program) = &self.program else {
            return Ok(());
        };
        let search = match self.search.take().filter(|of| of.is_for(line, &start)) {
            Some(search) => search,
            None => LineSearch::new(&self.machine, program, start, line)?,
        };
        self.search.insert(search).step().map(|_| ())
    }

    /// What the master is asked for before the program begins at its line: the levels one after another, then the place.
    pub(super) fn event_to_start(&self, feedback: &Feedback) -> Option<ProgramEvent> {
        let place = self.search.as_ref()?.found()?;
        if self.cause != Cause::None || feedback.hold == 1 || feedback.at_rest == 0 {
            return None;
        }
        let done = feedback.auxiliary.events_done;
        let level = place.levels.get(done as usize).copied();
        Some(level.unwrap_or(ProgramEvent {
            value: f64::from(place.events),
            number: done.saturating_add(1),
            code: EventCode::StartAt as u32,
            line: feedback.auxiliary.start_line,
            element: place.element,
            ..ProgramEvent::default()
        }))
    }

    /// Hash of the program in which a line is sought.
    pub(super) fn sought_hash(&self) -> u64 {
        self.search.as_ref().map_or(0, LineSearch::program_hash)
    }

    /// Nothing before this element is needed any more.
    pub(crate) fn needed_from(&self, feedback: &Feedback) -> u32 {
        let search = self.search.as_ref();
        search.map_or_else(|| tool_element(feedback), LineSearch::looked_at)
    }
}
