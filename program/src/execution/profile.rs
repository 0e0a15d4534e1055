//! The profile of a lathe cycle: the lines of the subroutine that Q names, read in the order of its loops, their moves not made.

use super::Execution;
use crate::flow::{FlowWord, Keyword, label_of};
use crate::meaning::ProfileReading;
use crate::reader::{Line, Word, read_line};
use crate::refusal::{Done, Refusal, refuse};
use crate::roughing::PIECES_MAX;
use crate::source::Spot;
use crate::words::Words;

/// Lines that are read for one profile at most, those of loops each time.
const STEPS_MAX: usize = 10 * PIECES_MAX;

/// The lines of a subroutine between its first and its last.
struct Body {
    /// The first of them.
    start: Spot,
    /// The line behind them.
    end: usize,
}

impl Execution {
    /// Does G70, G71 or G72.
    pub(super) fn turning_cycle(&mut self, index: usize, words: &Words, word: Word) -> Done {
        let Some(q) = words.value('Q') else {
            let found = format!("G{} without Q", word.value);
            let right = "the subroutine that holds its profile, such as Q100 for O100 sub";
            return refuse(word.offset, found, right);
        };
        let label = label_of(q.value).unwrap_or_default();
        let body = self.body(&label).map_err(|error| error.at(q.offset))?;
        let Some(body) = body else {
            let found = format!("{q}: there is no such subroutine");
            let right = "the number of a subroutine that holds the profile: O100 sub … O100 endsub";
            return refuse(q.offset, found, right);
        };
        let mut reading = self.interpreter.state().begin_profile(words, word)?;
        let places = (self.here, self.within, self.next);
        let read = self.read_profile(&body, &mut reading);
        let at = self.here;
        (self.here, self.within, self.next) = places;
        self.not_yet = false;
        if let Err(refusals) = read {
            self.refuse(at, refusals);
            return Ok(());
        }
        self.interpreter
            .turn(index as u32 + 1, words, word, &reading)
    }

    /// The lines of a subroutine between its first and its last.
    fn body(&mut self, label: &str) -> Result<Option<Body>, Refusal> {
        let begin = self.source.subroutine(label)?;
        let Some(begin) = begin.filter(|begin| begin.keyword == Keyword::Sub) else {
            return Ok(None);
        };
        let ends = [Keyword::EndSub];
        let end = self.source.next(label, begin.at.line, &ends)?;
        Ok(end.map(|end| Body {
            start: begin.behind,
            end: end.at.line,
        }))
    }

    /// Reads the lines of a profile, in the order of its loops and conditions.
    fn read_profile(&mut self, body: &Body, reading: &mut ProfileReading) -> Done {
        let mut line = Line::default();
        let mut words = Words::default();
        let (mut lines, mut steps) = (0, 0);
        self.next = body.start;
        while (body.start.line..body.end).contains(&self.next.line) {
            (self.here, self.within) = (self.next, self.next);
            let (raw, behind) = self.raw_line(self.here)?;
            self.next = behind;
            self.profile_line(&raw, &mut line, &mut words)?;
            self.mark(self.here.line);
            let not_yet = std::mem::take(&mut self.not_yet);
            match &line.flow {
                Some(flow) => self.flow(self.here.line, flow, not_yet)?,
                None => {
                    let state = self.interpreter.state();
                    state.add_to_profile(reading, &words)?;
                    lines += 1;
                }
            }
            steps += 1;
            if lines > PIECES_MAX || steps > STEPS_MAX {
                let found = format!("a profile of more than {PIECES_MAX} lines");
                return refuse(0, found, "fewer moves, and loops that end");
            }
        }
        Ok(())
    }

    /// Reads a line of a profile: its words, while its assignments take effect.
    fn profile_line(&mut self, raw: &str, line: &mut Line, words: &mut Words) -> Done {
        read_line(raw, &self.interpreter, line)?;
        for (target, value) in line.assignments.drain(..) {
            self.interpreter.assign(target, value);
        }
        let leads_out = |flow: &&FlowWord| {
            use Keyword::{Call, EndSub, Number, Return, Sub};
            matches!(flow.keyword, Call | EndSub | Number | Return | Sub)
        };
        if let Some(flow) = line.flow.as_ref().filter(leads_out) {
            let right = "a profile holds moves, loops and conditions, and calls nothing";
            let found = format!("{} in a profile", flow.shown());
            return refuse(flow.offset, found, right);
        }
        words.sort(line, self.interpreter.state().equipment())
    }
}
