//! Program flow: what an O-word does to the line that comes next.

use super::Execution;
use crate::flow::{ARGUMENTS_MAX, FlowWord, Keyword, label_of, shown_flow};
use crate::frames::{Frame, Loop, LoopKind, Pass};
use crate::program::ProgramEnd;
use crate::reader::Word;
use crate::refusal::{Refusal, refuse};
use crate::source::Label;
use crate::words::Words;

/// Subroutines may call each other this deep.
const DEPTH_MAX: usize = 100;
/// The most repetitions of M98.
const REPEATS_MAX: f64 = 1e6;

impl Execution {
    /// Does an O-word. `not_yet`: the line before was an `if` of which no branch was done so far.
    pub(super) fn flow(
        &mut self,
        index: usize,
        flow: &FlowWord,
        not_yet: bool,
    ) -> Result<(), Refusal> {
        let value = flow.values.first().copied().unwrap_or(0.0);
        let without = |keyword: Keyword| without(flow, keyword);
        match flow.keyword {
            Keyword::Number => self.begins_program(flow)?,
            Keyword::Sub => {
                self.is_only(flow, index)?;
                let ends = [Keyword::EndSub];
                let end = self.find(flow, index, &ends, || without(Keyword::EndSub))?;
                self.go_behind(end);
            }
            Keyword::EndSub | Keyword::Return => {
                let returned = flow.values.first().copied();
                if !self.leave(returned) {
                    let right = "it belongs into a subroutine that is called";
                    let found = format!("{} outside a call", flow.shown());
                    return refuse(flow.offset, found, right);
                }
            }
            Keyword::Call => self.call(flow)?,
            Keyword::If if value != 0.0 => {
                let ends = [Keyword::EndIf];
                self.find(flow, index, &ends, || without(Keyword::EndIf))?;
            }
            Keyword::ElseIf if value != 0.0 && not_yet => {}
            Keyword::Else if not_yet => {}
            Keyword::If => self.next_branch(index, flow, without(Keyword::EndIf))?,
            Keyword::ElseIf if not_yet => self.next_branch(index, flow, without(Keyword::EndIf))?,
            Keyword::ElseIf | Keyword::Else => {
                self.is_within_if(flow, index, without(Keyword::If))?;
                let ends = [Keyword::EndIf];
                let end = self.find(flow, index, &ends, || without(Keyword::EndIf))?;
                self.go_behind(end);
            }
            Keyword::EndIf => self.is_within_if(flow, index, without(Keyword::If))?,
            Keyword::Do => self.begin(flow, LoopKind::Do),
            Keyword::While => self.test(index, flow, value, without(Keyword::EndWhile))?,
            Keyword::Repeat => {
                let count = libm::round(value);
                let ends = [Keyword::EndRepeat];
                let end = self.find(flow, index, &ends, || without(Keyword::EndRepeat))?;
                if count < 1.0 {
                    self.go_behind(end);
                } else {
                    self.begin(flow, LoopKind::Repeat(count as u64));
                }
            }
            Keyword::EndWhile => match self.innermost(&flow.label) {
                Some(Pass {
                    kind: LoopKind::While,
                    at,
                    ..
                }) => self.next = at,
                _ => return Err(without(Keyword::While)),
            },
            Keyword::EndRepeat => self.count_down(flow, without(Keyword::Repeat))?,
            Keyword::Break | Keyword::Continue => self.leave_loop(index, flow)?,
        }
        Ok(())
    }

    /// The condition of an `if` does not hold: on to the next branch.
    fn next_branch(
        &mut self,
        index: usize,
        flow: &FlowWord,
        refusal: Refusal,
    ) -> Result<(), Refusal> {
        let branches = [Keyword::ElseIf, Keyword::Else, Keyword::EndIf];
        let branch = self.find(flow, index, &branches, || refusal)?;
        self.next = branch.at;
        self.not_yet = true;
        Ok(())
    }

    /// A branch, or the end of branches, has its `if` before it.
    fn is_within_if(
        &mut self,
        flow: &FlowWord,
        index: usize,
        refusal: Refusal,
    ) -> Result<(), Refusal> {
        let words = [Keyword::If, Keyword::EndIf];
        let before = self.source.last_before(&flow.label, index, &words);
        let before = before.map_err(|error| error.at(flow.offset))?;
        match before {
            Some(before) if before.keyword == Keyword::If => Ok(()),
            _ => Err(refusal),
        }
    }

    /// No other subroutine of the file has the label of the one that begins in this line.
    fn is_only(&mut self, flow: &FlowWord, index: usize) -> Result<(), Refusal> {
        let sub = [Keyword::Sub];
        let other = self.source.next(&flow.label, index, &sub);
        let other = other.map_err(|error| error.at(flow.offset))?;
        let Some(other) = other else { return Ok(()) };
        let (_, line) = self.source.place(other.at.line as u32 + 1);
        let found = format!("{} is there twice: again in line {line}", flow.shown());
        let right = "each subroutine of a file has a label of its own";
        refuse(flow.offset, found, right)
    }

    fn begin(&mut self, flow: &FlowWord, kind: LoopKind) {
        let loops = &mut self.interpreter.frames.here().loops;
        // A loop of Fanuc's language that a GOTO has left begins again.
        loops.retain(|of| of.label != flow.label || !of.label.starts_with("DO"));
        loops.push(Loop {
            label: flow.label.clone(),
            pass: Pass {
                at: self.here,
                behind: self.next,
                kind,
            },
        });
    }

    /// Goes on behind a line.
    fn go_behind(&mut self, label: Label) {
        self.within = label.at;
        self.next = label.behind;
    }

    /// Goes on behind the line that a loop begins with.
    fn go_into(&mut self, of: Pass) {
        self.within = of.at;
        self.next = of.behind;
    }

    /// The loop of this label, those inside it left.
    fn innermost(&mut self, label: &str) -> Option<Pass> {
        let loops = &mut self.interpreter.frames.here().loops;
        let at = loops.iter().rposition(|of| of.label == label)?;
        loops.truncate(at + 1);
        loops.last().map(|of| of.pass)
    }

    /// `while`: of a loop that begins with it, or that ends with it.
    fn test(
        &mut self,
        index: usize,
        flow: &FlowWord,
        value: f64,
        refusal: Refusal,
    ) -> Result<(), Refusal> {
        let holds = value != 0.0;
        let ends = [Keyword::EndWhile];
        match self.innermost(&flow.label) {
            Some(of) if of.kind == LoopKind::Do => {
                if holds {
                    self.go_into(of);
                } else {
                    self.interpreter.frames.here().loops.pop();
                }
            }
            Some(of) if of.kind == LoopKind::While && of.at.line == index => {
                if !holds {
                    self.interpreter.frames.here().loops.pop();
                    let end = self.find(flow, index, &ends, || refusal)?;
                    self.go_behind(end);
                }
            }
            _ => {
                let end = self.find(flow, index, &ends, || refusal)?;
                if holds {
                    self.begin(flow, LoopKind::While);
                } else {
                    self.go_behind(end);
                }
            }
        }
        Ok(())
    }

    fn count_down(&mut self, flow: &FlowWord, refusal: Refusal) -> Result<(), Refusal> {
        let Some(of) = self.innermost(&flow.label) else {
            return Err(refusal);
        };
        let LoopKind::Repeat(left) = of.kind else {
            return Err(refusal);
        };
        let loops = &mut self.interpreter.frames.here().loops;
        if left > 1 {
            if let Some(of) = loops.last_mut() {
                of.pass.kind = LoopKind::Repeat(left - 1);
            }
            self.go_into(of);
        } else {
            loops.pop();
        }
        Ok(())
    }

    /// `break` and `continue`.
    fn leave_loop(&mut self, index: usize, flow: &FlowWord) -> Result<(), Refusal> {
        let Some(of) = self.innermost(&flow.label) else {
            let found = format!("{} outside the loop", flow.shown());
            let right = "it has the label of the loop that it is in";
            return refuse(flow.offset, found, right);
        };
        let end = match of.kind {
            LoopKind::While => Keyword::EndWhile,
            LoopKind::Do => Keyword::While,
            LoopKind::Repeat(_) => Keyword::EndRepeat,
        };
        let end = self.find(flow, index, &[end], || without(flow, end))?;
        if flow.keyword == Keyword::Break {
            self.interpreter.frames.here().loops.pop();
            self.go_behind(end);
        } else {
            self.next = if of.kind == LoopKind::While {
                of.at
            } else {
                end.at
            };
        }
        Ok(())
    }

    /// `call`.
    fn call(&mut self, flow: &FlowWord) -> Result<(), Refusal> {
        let unread = |error: Refusal| error.at(flow.offset);
        let begin = self.source.subroutine(&flow.label).map_err(unread)?;
        let Some(begin) = begin else {
            let found = format!("{}: there is no such subroutine", flow.shown());
            let right = format!(
                "{} in the program, or a file {}.ngc beside it",
                shown_flow(&flow.label, Keyword::Sub),
                flow.label
            );
            return refuse(flow.offset, found, right);
        };
        if begin.keyword == Keyword::Sub {
            let sub = FlowWord {
                keyword: Keyword::Sub,
                ..flow.clone()
            };
            self.is_only(&sub, begin.at.line)?;
        }
        self.enter(&flow.label, begin, flow.offset)?;
        self.interpreter.frames.here().arguments = true;
        let values = flow.values.iter().copied().chain(std::iter::repeat(0.0));
        self.interpreter.pass(values.map(Some).take(ARGUMENTS_MAX));
        Ok(())
    }

    pub(super) fn enter(
        &mut self,
        label: &str,
        begin: Label,
        offset: usize,
    ) -> Result<(), Refusal> {
        if self.interpreter.frames.called.len() >= DEPTH_MAX {
            let found = format!("subroutines called {DEPTH_MAX} deep");
            let right = "a subroutine that calls itself must come to an end";
            return refuse(offset, found, right);
        }
        self.interpreter.frames.called.push(Frame {
            label: label.to_owned(),
            return_to: self.next,
            called_from: self.here,
            begin: (begin.at, begin.behind),
            ..Frame::default()
        });
        self.go_behind(begin);
        Ok(())
    }

    /// Returns from a subroutine; false if none was called.
    pub(super) fn leave(&mut self, returned: Option<f64>) -> bool {
        let frame = self.interpreter.frames.called.last_mut();
        if let Some(frame) = frame.filter(|frame| frame.repeats > 1) {
            frame.repeats -= 1;
            frame.loops.clear();
            (self.within, self.next) = frame.begin;
            let line = frame.called_from.line as u32 + 1;
            let saved = frame.saved.take();
            self.interpreter.end_pass(line, saved, returned);
            return true;
        }
        let Some(frame) = self.interpreter.leave(returned) else {
            return false;
        };
        self.within = frame.called_from;
        self.next = frame.return_to;
        true
    }

    /// M98 P calls a subroutine by its number, L times; M99 returns, or ends the program where none was called.
    pub(super) fn call_by_number(
        &mut self,
        index: usize,
        words: &Words,
        word: Word,
    ) -> Result<(), Refusal> {
        if word.value == 99.0 {
            if !self.leave(None) {
                let note = "M99 outside a subroutine ends the program: it does not begin again";
                self.interpreter.note(index as u32 + 1, note);
                self.interpreter.ended = Some(ProgramEnd::M99(index as u32 + 1));
            }
            return Ok(());
        }
        let Some(p) = words.value('P') else {
            let right = "the number of the subroutine, such as M98 P1000 for O1000";
            return refuse(word.offset, "M98 without P", right);
        };
        let Some(label) = label_of(p.value) else {
            return p.refuse("a whole number from 0");
        };
        let unread = |error: Refusal| error.at(p.offset);
        let Some(begin) = self.source.subroutine(&label).map_err(unread)? else {
            let found = format!("M98 P{label}: there is no such subroutine");
            let right = format!("O{label} … M99 in the program, or a file {label}.ngc beside it");
            return refuse(p.offset, found, right);
        };
        let repeats = words.whole('L', "a whole number", 0.0..=REPEATS_MAX)?;
        if repeats != Some(0) {
            self.enter(&label, begin, p.offset)?;
            self.interpreter.frames.here().repeats = u64::from(repeats.unwrap_or(1));
        }
        Ok(())
    }
}

/// An O-word whose other half is missing.
fn without(flow: &FlowWord, keyword: Keyword) -> Refusal {
    let other = shown_flow(&flow.label, keyword);
    let found = format!("{} without {other}", flow.shown());
    let right = "both have the same label, in the same file";
    Refusal::new(flow.offset, found, right)
}
