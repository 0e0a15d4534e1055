//! Start at a line: what stands before it is read and not travelled. The master is asked for the levels that it leaves, one after
//! another, and then to begin at the place; the planned return to the path is the way there (docs/developers/architecture.md, "Events").

use bus::sample::{EventCode, Feedback, ProgramEvent};

use super::Planner;
use crate::line_search::{LineError, LineSearch};
use crate::situation::Situation;

impl Planner {
    /// Reads on to the line that the program is to be started at, from where the axes are.
    pub(super) fn seek_line(&mut self, feedback: &Feedback) {
        let situation = Situation::of(feedback);
        let Some(line) = situation.seeks_line else {
            self.search = None;
            return;
        };
        if self.course.is_some() {
            // It is read from its beginning once the place is known: its events are counted there.
            self.read_anew();
        }
        if !situation.enabled || self.trouble.is_some() {
            return;
        }
        if let Err(error) = self.seek(line, feedback) {
            self.give_up(error);
        }
    }

    fn seek(&mut self, line: u32, feedback: &Feedback) -> Result<(), LineError> {
        let start = Situation::of(feedback).positions;
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
        let situation = Situation::of(feedback);
        if self.trouble.is_some() || situation.hold || !situation.rests {
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
        search.map_or_else(
            || Situation::of(feedback).tool_element(),
            LineSearch::looked_at,
        )
    }
}
