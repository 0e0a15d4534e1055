//! Fanuc's language: jumps, calls of subprograms and macros, corners between two blocks.

use super::Execution;
use crate::fanuc::{self, Modes};
use crate::flow::FlowWord;
use crate::interpreter::{CornerAhead, MacroCall};
use crate::program::ProgramEnd;
use crate::reader::{Corner, Jump, Line, Word};
use crate::refusal::{Done, Refusal, refuse};
use crate::words::Group;

/// The most repetitions of a call.
const REPEATS_MAX: f64 = 1e6;
/// The last four digits of P are the program, those before them the count (B-64304EN, 13.3 "Subprogram").
const PACKED: u32 = 10_000;

/// What a block does beside its motion.
enum Call {
    /// M98, G65.
    Once(MacroCall, usize),
    /// M97: the block of this number, so often.
    Local(u32, u64, usize),
    /// G66.
    Modal(MacroCall),
    /// G67.
    EndModal,
    /// M99, with the block that the caller goes on with.
    Return(Option<Jump>),
}

impl Execution {
    /// Does the assignments of a line.
    pub(super) fn assign_variables(&mut self, line: &mut Line) -> Result<(), Refusal> {
        let remark = std::mem::take(&mut line.remark);
        for (target, value) in line.assignments.drain(..) {
            match target {
                crate::expression::Target::Numbered(number) => {
                    self.interpreter.assign_variable(number, value, &remark)?;
                }
                named @ crate::expression::Target::Named(_) => {
                    let value = if value.is_nan() { 0.0 } else { value };
                    self.interpreter.assign(named, value);
                }
            }
        }
        Ok(())
    }

    /// A program's number: the first is that of the program, each other begins another one.
    pub(super) fn begins_program(&mut self, flow: &FlowWord) -> Result<(), Refusal> {
        if !self.interpreter.is_fanuc() || !std::mem::replace(&mut self.begun, true) {
            return Ok(());
        }
        if let Some(frame) = self.interpreter.frames.called.last() {
            let found = format!("{} begins inside {}", flow.shown(), frame.shown());
            return refuse(flow.offset, found, "a subprogram ends with M99");
        }
        self.interpreter.ended = Some(ProgramEnd::FileEnd);
        Ok(())
    }

    /// A block of words, or a jump.
    pub(super) fn fanuc_block(&mut self, index: usize, line: &mut Line) -> Done {
        let known = self.interpreter.state_known;
        if line.writes {
            let note = "POPEN, PCLOS, DPRNT, BPRNT and SETVN do nothing: no device is written to";
            self.interpreter.note(index as u32 + 1, note);
        }
        if let Some(jump) = line.jump {
            if let Some(word) = line.words.iter().find(|word| word.letter != 'N') {
                return word.refuse("GOTO stands alone in its block, behind N or a condition");
            }
            return match known {
                true => self.go_to(jump, self.here.line).map_err(Vec::from),
                false => Ok(()),
            };
        }
        let call = self.take_call(line)?;
        if matches!(call, Some(Call::EndModal)) {
            self.interpreter.fanuc.modal = None;
        }
        let moves = match line.words.iter().all(|word| word.letter == 'N') {
            true => false,
            false => self.translated(index, line)?,
        };
        if !known || self.interpreter.ended.is_some() {
            return Ok(());
        }
        let result = match call {
            Some(Call::Once(call, offset)) => self.call_program(call, offset),
            Some(Call::Local(number, repeats, offset)) => self.call_block(number, repeats, offset),
            Some(Call::Modal(call)) => {
                self.interpreter.fanuc.modal = Some(call);
                Ok(())
            }
            Some(Call::Return(to)) => self.return_to(index, to),
            None | Some(Call::EndModal) => self.call_modal(moves),
        };
        self.interpreter.tell_plain_blocks();
        result.map_err(Vec::from)
    }

    /// The words of a block, translated and done; whether they name axes.
    fn translated(&mut self, index: usize, line: &mut Line) -> Result<bool, Vec<Refusal>> {
        let mut modes = self.interpreter.fanuc.modes;
        let beside = fanuc::translate(line, self.interpreter.state(), &mut modes)?;
        self.interpreter.fanuc.modes = modes;
        if let Some(corner) = line.corner {
            if self.interpreter.fanuc.modal.is_some() {
                let found = format!("{} while G66 is in force", corner.shown());
                return refuse(corner.offset, found, "G67 before it");
            }
            if modes.polar {
                let found = format!("{} in polar coordinates (G16)", corner.shown());
                return refuse(corner.offset, found, "G15 before it, and places in X and Y");
            }
            let ahead = self.next_block(corner, modes)?;
            self.interpreter.meet_corner(corner, ahead);
        }
        let mut words = self.words.take().unwrap_or_default();
        let number = index as u32 + 1;
        let result = self
            .interpreter
            .run_translated(number, line, &beside, &mut words);
        let unused = self.interpreter.corner_is_left();
        let moves = words.first_in(crate::meaning::PLACES).is_some();
        let moves = moves && words.code(Group::Once).is_none();
        self.words = Some(words);
        result?;
        match line
            .corner
            .filter(|_| unused && self.interpreter.state_known)
        {
            Some(corner) => refuse(
                corner.offset,
                format!("{} in a block that is no G1", corner.shown()),
                "a corner lies between two straight blocks, G1",
            ),
            None => Ok(moves),
        }
    }

    /// The next block that does something, for the corner before it.
    fn next_block(&mut self, corner: Corner, modes: Modes) -> Result<CornerAhead, Refusal> {
        let none = || corner.without_next();
        let mut at = self.next;
        let mut line = Line::default();
        loop {
            let (raw, behind) = self.raw_line(at)?;
            if behind == at {
                return Err(none());
            }
            at = behind;
            fanuc::read_line(&raw, &self.interpreter, &mut line).map_err(|_| none())?;
            let skipped = line.block_delete && self.interpreter.state().equipment().block_delete;
            if line.is_block() && !skipped {
                break;
            }
        }
        let straight = line.flow.is_none() && line.jump.is_none() && line.assignments.is_empty();
        let called = self.take_call(&mut line).map_err(|_| none())?;
        if !straight || called.is_some() {
            return Err(none());
        }
        Ok(CornerAhead { line, modes })
    }

    /// Goes on with a block by its number, in the program that a line belongs to.
    fn go_to(&mut self, jump: Jump, from: usize) -> Result<(), Refusal> {
        let found = self.source.numbered(jump.number, from);
        let Some(label) = found.map_err(|error| error.at(jump.offset))? else {
            let found = format!("GOTO {}: there is no N{}", jump.number, jump.number);
            let right = "a block with this number in the same program";
            return refuse(jump.offset, found, right);
        };
        self.within = label.at;
        self.next = label.at;
        Ok(())
    }

    /// Takes the words of a call out of a line.
    fn take_call(&mut self, line: &mut Line) -> Result<Option<Call>, Refusal> {
        let is =
            |word: &Word, letter: char, value: f64| word.letter == letter && word.value == value;
        let calls = |word: &Word| {
            [65.0, 66.0, 67.0].iter().any(|value| is(word, 'G', *value))
                || [97.0, 98.0, 99.0].iter().any(|value| is(word, 'M', *value))
        };
        let Some(at) = line.words.iter().position(calls) else {
            return Ok(None);
        };
        let code = line.words.remove(at);
        if let Some(other) = line.words.iter().find(|word| calls(word)) {
            return other.refuse("one call in a block");
        }
        if is(&code, 'G', 67.0) {
            return Ok(Some(Call::EndModal));
        }
        let by_macro = code.letter == 'G';
        // The words behind G65 and G66 are arguments.
        let behind: Vec<Word> = match by_macro {
            true => line.words.split_off(at),
            false => line.words.clone(),
        };
        let value = |letter: char| behind.iter().find(|word| word.letter == letter).copied();
        let (p, l) = (value('P'), value('L'));
        if !by_macro {
            line.words.retain(|word| !matches!(word.letter, 'P' | 'L'));
        }
        if is(&code, 'M', 99.0) {
            if let Some(l) = l {
                return l.refuse("M99 has no L");
            }
            let to = p
                .map(|p| whole(p, 1e8).map(|number| (number, p.offset)))
                .transpose()?;
            return Ok(Some(Call::Return(
                to.map(|(number, offset)| Jump { number, offset }),
            )));
        }
        let Some(p) = p else {
            let right = "the number of the program, such as M98 P1000 for O1000";
            return refuse(code.offset, format!("{code} without P"), right);
        };
        let mut number = whole(p, 1e9)?;
        let mut repeats = match l {
            Some(l) if l.value > REPEATS_MAX => return l.refuse("at most 1000000 times"),
            Some(l) => u64::from(whole(l, REPEATS_MAX + 1.0)?),
            None => 1,
        };
        if is(&code, 'M', 97.0) {
            return Ok(Some(Call::Local(number, repeats, p.offset)));
        }
        if !by_macro && l.is_none() && number >= PACKED {
            (repeats, number) = (u64::from(number / PACKED), number % PACKED);
        }
        let locals = match by_macro {
            true => Some(fanuc::arguments(&behind)?.to_vec()),
            false => None,
        };
        let call = MacroCall {
            label: number.to_string(),
            repeats,
            locals,
            depth: self.interpreter.frames.called.len(),
        };
        Ok(Some(if is(&code, 'G', 66.0) {
            self.interpreter.refuse_second_modal(code.offset)?;
            Call::Modal(call)
        } else {
            Call::Once(call, p.offset)
        }))
    }

    /// Calls a program by its number.
    fn call_program(&mut self, call: MacroCall, offset: usize) -> Result<(), Refusal> {
        let label = &call.label;
        let begin = self
            .source
            .subroutine(label)
            .map_err(|error| error.at(offset))?;
        let Some(begin) = begin else {
            let found = format!("P{label}: there is no program O{label}");
            let right = format!("O{label} … M99 in the program, or a file O{label}.nc beside it");
            return refuse(offset, found, right);
        };
        if call.repeats == 0 {
            return Ok(());
        }
        self.enter(label, begin, offset)?;
        let frame = self.interpreter.frames.here();
        frame.repeats = call.repeats;
        if let Some(locals) = call.locals {
            frame.arguments = true;
            self.interpreter.pass(locals.into_iter());
        }
        Ok(())
    }

    /// M97: calls the block of a number in the same program (Haas Mill Operator's Manual, "M97 Local Sub-Program Call").
    fn call_block(&mut self, number: u32, repeats: u64, offset: usize) -> Result<(), Refusal> {
        let found = self.source.numbered(number, self.here.line);
        let Some(mut label) = found.map_err(|error| error.at(offset))? else {
            let right = "a block with this number in the same program";
            return refuse(
                offset,
                format!("M97 P{number}: there is no N{number}"),
                right,
            );
        };
        if repeats == 0 {
            return Ok(());
        }
        // The block itself is done.
        label.behind = label.at;
        self.enter(&format!("N{number}"), label, offset)?;
        self.interpreter.frames.here().repeats = repeats;
        Ok(())
    }

    /// Behind a motion: the macro of G66.
    fn call_modal(&mut self, moves: bool) -> Result<(), Refusal> {
        let depth = self.interpreter.frames.called.len();
        let modal = self.interpreter.fanuc.modal.clone();
        match modal.filter(|call| moves && call.depth == depth) {
            Some(call) => self.call_program(call, 0),
            None => Ok(()),
        }
    }

    /// M99: back to the caller, behind the call or at the block that P names.
    fn return_to(&mut self, index: usize, to: Option<Jump>) -> Result<(), Refusal> {
        let from = self
            .interpreter
            .frames
            .called
            .last()
            .map(|frame| frame.called_from.line);
        if let (Some(from), Some(to)) = (from, to) {
            if let Some(frame) = self.interpreter.frames.called.last_mut() {
                frame.repeats = 1;
            }
            self.leave(None);
            return self.go_to(to, from);
        }
        if let Some(to) = to {
            return self.go_to(to, self.here.line);
        }
        if !self.leave(None) {
            let note = "M99 outside a subprogram ends the program: it does not begin again";
            self.interpreter.note(index as u32 + 1, note);
            self.interpreter.ended = Some(ProgramEnd::M99(index as u32 + 1));
        }
        Ok(())
    }
}

/// A whole number from 0 that a word gives.
fn whole(word: Word, below: f64) -> Result<u32, Refusal> {
    match (0.0..below).contains(&word.value) && word.value.fract() == 0.0 {
        true => Ok(word.value as u32),
        false => word.refuse("a whole number from 0"),
    }
}
