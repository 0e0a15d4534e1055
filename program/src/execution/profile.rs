//! The profile of a lathe cycle: the lines of the subroutine that Q names, read but not executed.

use super::Execution;
use crate::flow::{Keyword, label_of};
use crate::reader::{Line, Word, read_line};
use crate::refusal::{Done, Refusal, refuse};
use crate::roughing::PIECES_MAX;
use crate::source::Spot;
use crate::words::Words;

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
        let lines = body.end - body.start.line;
        if lines > PIECES_MAX {
            let found = format!("a profile of {lines} lines");
            return refuse(q.offset, found, format!("at most {PIECES_MAX}"));
        }
        let mut reading = self.interpreter.state().begin_profile(words, word)?;
        let mut line = Line::default();
        let mut of_line = Words::default();
        let mut next = body.start;
        while next.line < body.end {
            let at = next;
            let raw = self.raw_line(at)?;
            next = raw.1;
            let result = self
                .profile_line(&raw.0, &mut line, &mut of_line)
                .and_then(|()| {
                    Ok(self
                        .interpreter
                        .state()
                        .add_to_profile(&mut reading, &of_line)?)
                });
            if let Err(refusals) = result {
                self.refuse(at, refusals);
                return Ok(());
            }
            self.mark(at.line);
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

    /// Reads a line of a profile: its words, while its assignments take effect.
    fn profile_line(&mut self, raw: &str, line: &mut Line, words: &mut Words) -> Done {
        read_line(raw, &self.interpreter, line)?;
        for (target, value) in line.assignments.drain(..) {
            self.interpreter.assign(target, value);
        }
        if let Some(flow) = &line.flow {
            let right = "a profile is a list of moves, without loops, conditions and calls";
            let found = format!("{} in a profile", flow.shown());
            return refuse(flow.offset, found, right);
        }
        words.sort(line, self.interpreter.state().equipment())
    }
}
