//! The profile of a lathe cycle: the lines of the subroutine that Q names, read but not executed.

use super::Execution;
use crate::flow::{Keyword, label_of};
use crate::reader::{Line, Word, read_line};
use crate::roughing::PIECES_MAX;
use crate::words::{Refusal, Words};

impl Execution<'_> {
    /// Does G70, G71 or G72.
    pub(super) fn turning_cycle(
        &mut self,
        index: usize,
        words: &Words,
        word: Word,
    ) -> Result<(), Vec<Refusal>> {
        let one = |refusal| vec![refusal];
        let Some(q) = words.value('Q') else {
            let found = format!("G{} without Q", word.value);
            let right = "the subroutine that holds its profile, such as Q100 for O100 sub";
            return Err(one(Refusal::new(word.offset, found, right)));
        };
        let label = label_of(q.value).unwrap_or_default();
        let body = self
            .source
            .subroutine(&label)
            .filter(|&(_, keyword)| keyword == Keyword::Sub)
            .and_then(|(begin, _)| {
                let (end, _) = self.source.next(&label, begin, &[Keyword::EndSub])?;
                Some(begin + 1..end)
            });
        let Some(body) = body else {
            let found = format!("Q{}: there is no such subroutine", q.value);
            let right = "the number of a subroutine that holds the profile: O100 sub … O100 endsub";
            return Err(one(Refusal::new(q.offset, found, right)));
        };
        if body.len() > PIECES_MAX {
            let found = format!("a profile of {} lines", body.len());
            return Err(one(Refusal::new(
                q.offset,
                found,
                format!("at most {PIECES_MAX}"),
            )));
        }
        let mut reading = self.interpreter.begin_profile(words, word).map_err(one)?;
        let mut line = Line::default();
        let mut of_line = Words::default();
        for at in body {
            let raw = self.source.line(at).unwrap_or_default();
            let result = self
                .profile_line(raw, &mut line, &mut of_line)
                .and_then(|()| {
                    self.interpreter
                        .add_to_profile(&mut reading, &of_line)
                        .map_err(one)
                });
            if let Err(refusals) = result {
                self.refuse(at, raw, refusals);
                return Ok(());
            }
            self.mark(at);
        }
        self.interpreter
            .turn(index as u32 + 1, words, word, &reading)
    }

    /// Reads a line of a profile: its words, while its assignments take effect.
    fn profile_line(
        &mut self,
        raw: &str,
        line: &mut Line,
        words: &mut Words,
    ) -> Result<(), Vec<Refusal>> {
        read_line(raw, &self.interpreter, line).map_err(|unreadable| {
            vec![Refusal::new(
                unreadable.offset,
                unreadable.found,
                unreadable.right,
            )]
        })?;
        for (target, value) in line.assignments.drain(..) {
            self.interpreter.assign(target, value);
        }
        if let Some(flow) = &line.flow {
            let right = "a profile is a list of moves, without loops, conditions and calls";
            let found = format!("{} in a profile", flow.shown());
            return Err(vec![Refusal::new(flow.offset, found, right)]);
        }
        words.sort(line, self.interpreter.setup)
    }
}
