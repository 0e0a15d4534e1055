//! From the lines of a program to its end: which block comes next, what is wrong with it, what was said of it.

use serde::{Deserialize, Serialize};
use std::sync::Arc;

use path::geometry::{AxisVector, Path};

use crate::error::{PROBLEMS_MAX, Problem, ProgramError, Shown, refuse_file};
use crate::flow::{FlowWord, Keyword};
use crate::interpreter::Interpreter;
use crate::meaning::is_turning;
use crate::program::{BLOCKS_MAX, Block, Program, ProgramEnd, Setup, in_dialect, source_hash};
use crate::question::Answer;
use crate::reader::{Line, read_line};
use crate::refusal::{Done, Refusal, column};
use crate::setup::check_setup;
use crate::source::{Label, Source, Spot};
use crate::straight::Straight;
use crate::text::{Text, hash_of};
use crate::words::{Group, Words};

mod fanuc;
mod profile;
mod steps;

/// So many blocks in a row that make nothing, messages apart, are a loop that does not end.
const IDLE_BLOCKS_MAX: u64 = 2_000_000;

/// So many bytes are looked through for labels in the place of a block,
const BYTES_OF_A_BLOCK: u64 = 512;

/// and so many in the place of the first: all of most programs, in less than 1 ms.
const BYTES_AT_FIRST: u64 = 256 << 10;

/// The most names of parameters at a time.
const NAMES_MAX: usize = 20_000;

/// The most lines of one program.
const LINES_MAX: usize = u32::MAX as usize - 1;

/// Interprets a program text, for a machine that is at rest at `start` (machine coordinates). `name` is shown in errors.
///
/// All mistakes of single blocks are found in one go, at most twenty; those that depend on where the tool is (arcs,
/// travel, feed) as far as that is still known.
pub fn interpret(
    name: &str,
    text: &str,
    setup: &Setup,
    start: AxisVector,
) -> Result<Program, ProgramError> {
    check_setup(name, setup, &start)?;
    let text = Text::of(text);
    let setup = &in_dialect(&Arc::new(setup.clone()), text.dialect());
    let hash = text.hash().unwrap_or(hash_of(&[]));
    let source = Source::of_whole(text, setup.dialect);
    let mut execution = Execution::new(source.clone(), setup, start);
    execution.executed = Some(Executed::default());
    while !execution.checks_line() {}
    execution.finish(name)?;
    let Execution {
        interpreter,
        executed,
        end,
        ..
    } = execution;
    let (parameters, output) = interpreter.finish();
    if output.is_infinite {
        return Err(not_finite(name));
    }
    let path = Path {
        elements: output.piece.elements,
    };
    Ok(Program {
        name: name.to_owned(),
        source_hash: source_hash(hash, setup, &start),
        start,
        blocks: blocks_of(source, &executed.unwrap_or_default().lines),
        end,
        notes: output.notes.by_line(),
        path,
        events: output.piece.events,
        messages: output.piece.messages,
        parameters,
        straight_feeds: output.straight_feeds,
        arc_feeds: output.arc_feeds,
    })
}

fn not_finite(name: &str) -> ProgramError {
    let right = "coordinates must stay in the range of ordinary numbers";
    ProgramError::of_file(name, "makes a path that is not finite", right)
}

/// The lines that were done, with their text.
fn blocks_of(mut source: Source, executed: &[bool]) -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut at = Spot::default();
    for done in executed {
        let Ok(Some((text, behind))) = source.line(at) else {
            break;
        };
        if *done {
            blocks.push(Block {
                line: at.line as u32 + 1,
                text: text.trim().to_owned(),
            });
        }
        at = behind;
    }
    blocks
}

/// A line that cannot be read, as a refusal of a word that leads there.
/// The lines that were done at least once.
#[derive(Debug, Clone, Default)]
struct Executed {
    lines: Vec<bool>,
    count: usize,
}

impl Executed {
    /// Keeps that a line was done; false if there are too many.
    fn mark(&mut self, index: usize) -> bool {
        if self.lines.len() <= index {
            self.lines.resize(index + 1, false);
        }
        if let Some(done) = self.lines.get_mut(index)
            && !*done
        {
            *done = true;
            self.count += 1;
        }
        self.count <= BLOCKS_MAX
    }
}

/// What is known of a program while it is executed.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Execution {
    #[serde(skip)]
    source: Source,
    pub interpreter: Interpreter,
    /// The line that comes next.
    next: Spot,
    /// The line that is done.
    here: Spot,
    /// The line before the next one in the text.
    within: Spot,
    /// The line before was an `if` or `elseif` that did not hold.
    not_yet: bool,
    /// The text is looked through for labels bit by bit, before the first block that may go on elsewhere.
    #[serde(skip)]
    pub looks_bit_by_bit: bool,
    /// The next block may be anywhere: the labels come first.
    #[serde(skip)]
    needs_labels: bool,
    /// Lines that were done, where they are kept.
    #[serde(skip)]
    executed: Option<Executed>,
    /// The last line in the text that was done, counted from 1; 0 before the first.
    last_line: u32,
    /// Blocks since one made something, and how much there was then.
    idle: (u64, u64),
    #[serde(skip)]
    problems: Vec<Problem>,
    /// There were more problems than are kept.
    #[serde(skip)]
    more: bool,
    /// How the program ended.
    pub end: ProgramEnd,
    /// In Fanuc's language, the number of the program was met.
    begun: bool,
    opened_by_percent: bool,
    #[serde(skip)]
    raw: String,
    #[serde(skip)]
    line: Option<Box<Line>>,
    #[serde(skip)]
    words: Option<Box<Words>>,
    #[serde(skip)]
    straight: Box<Straight>,
}

impl Execution {
    pub fn new(source: Source, setup: &Arc<Setup>, start: AxisVector) -> Self {
        Self {
            source,
            interpreter: Interpreter::new(setup, start),
            ..Self::default()
        }
    }

    /// Takes what a snapshot leaves out from a fresh one of the same program.
    pub fn complete(&mut self, fresh: &Self) -> Result<(), Refusal> {
        self.source = fresh.source.clone();
        self.interpreter.complete(&fresh.interpreter);
        self.looks_bit_by_bit = fresh.looks_bit_by_bit;
        if self.interpreter.frames.called.is_empty() {
            return Ok(());
        }
        self.needs_labels = self.looks_bit_by_bit;
        if self.needs_labels {
            return Ok(());
        }
        self.source.index().map(|_| ())
    }

    /// Does the next line, and goes on behind mistakes; true at the end of the program, or where there are enough problems.
    pub fn checks_line(&mut self) -> bool {
        let ends = self.does_line();
        self.refuse_question();
        if self.problems.len() < PROBLEMS_MAX {
            return ends;
        }
        self.more = self.problems.len() > PROBLEMS_MAX || !self.rest_is_blank();
        self.problems.truncate(PROBLEMS_MAX);
        true
    }

    /// Does the next line; true if the program ends with it.
    pub fn does_line(&mut self) -> bool {
        let at = self.next;
        if !self.needs_labels && !self.interpreter.fanuc.reads_words && self.does_straight(at) {
            return self.interpreter.ended.is_some();
        }
        if self.looks_for_labels(at) {
            return false;
        }
        match self.source.line(at) {
            Ok(Some((line, _))) if Source::begins_file(line, at) => self.end_of_file(),
            Ok(Some(_)) if at.line >= LINES_MAX => {
                let found = format!("more than {LINES_MAX} lines");
                self.refuse_line(at, found, "split the program");
            }
            Ok(Some((line, behind))) => {
                self.raw.clear();
                self.raw.push_str(line);
                self.here = at;
                self.within = at;
                self.next = behind;
                let raw = std::mem::take(&mut self.raw);
                let mut line = self.line.take().unwrap_or_default();
                let ends = self.step(at.line, &raw, &mut line);
                self.line = Some(line);
                self.raw = raw;
                return ends;
            }
            Ok(None) => self.end_of_file(),
            Err(error) => self.refuse(at, error),
        }
        true
    }

    /// In the place of a block that may go on elsewhere, looks through some of the text for labels; false once that is done.
    fn looks_for_labels(&mut self, at: Spot) -> bool {
        if !self.looks_bit_by_bit || self.source.is_looked_through() {
            self.needs_labels = false;
            return false;
        }
        if !self.needs_labels {
            let may_jump = self.source.finds_jumps();
            let line = self.source.bytes(at);
            self.needs_labels = line.is_ok_and(|line| line.is_some_and(|(line, _)| may_jump(line)));
        }
        if self.needs_labels {
            // What is wrong with the labels is told with the block that goes to one.
            let bytes = if self.source.is_looked_at() {
                BYTES_OF_A_BLOCK
            } else {
                BYTES_AT_FIRST
            };
            let looked = self.source.look_on(bytes);
            self.needs_labels = looked.is_ok_and(|through| !through);
        }
        self.needs_labels
    }

    /// Does a line of straight motion; false, and nothing done, for others.
    fn does_straight(&mut self, at: Spot) -> bool {
        let behind = match self.source.bytes(at) {
            Ok(Some((line, behind))) if self.straight.read(line) => behind,
            _ => return false,
        };
        // What is refused, and the last of too many blocks, is told by the way of all blocks.
        if at.line >= LINES_MAX
            || !self.mark(at.line)
            || !self
                .interpreter
                .straight(at.line as u32 + 1, &self.straight)
        {
            return false;
        }
        self.here = at;
        self.within = at;
        self.next = behind;
        self.not_yet = false;
        self.watch();
        true
    }

    /// The answer to what the line that was done last asks.
    pub fn answer(&mut self, name: &str, answer: Answer) -> Result<(), ProgramError> {
        if let Err(refusal) = self.interpreter.answer(answer) {
            self.refuse(self.here, refusal);
        }
        self.refused(name)
    }

    /// What is wrong with the program, once it is at its end; notes how it ends.
    pub fn finish(&mut self, name: &str) -> Result<(), ProgramError> {
        self.refused(name)?;
        if self.last_line == 0 {
            let right = "a program has at least one, such as M2";
            return refuse_file(name, "has no blocks", right);
        }
        if self.end == ProgramEnd::FileEnd {
            self.interpreter.note(
                self.last_line,
                "the file ends without M2, M30 or %: taken as the end of the program",
            );
        }
        Ok(())
    }

    /// What is wrong with the program so far.
    pub fn refused(&mut self, name: &str) -> Result<(), ProgramError> {
        if self.problems.is_empty() {
            return Ok(());
        }
        Err(ProgramError {
            name: name.to_owned(),
            problems: std::mem::take(&mut self.problems),
            more: self.more,
        })
    }

    /// One line; true if the program ends with it.
    fn step(&mut self, index: usize, raw: &str, line: &mut Line) -> bool {
        let known = self.interpreter.state_known;
        self.interpreter.line = index as u32 + 1;
        (_, self.interpreter.line_of_file) = self.source.place(self.interpreter.line);
        let is_fanuc = self.interpreter.is_fanuc();
        let read = match is_fanuc {
            true => crate::fanuc::read_line(raw, &self.interpreter, line),
            false => read_line(raw, &self.interpreter, line),
        };
        if let Err(unreadable) = read {
            // Values that nobody knows make no mistakes.
            if known || !raw.contains(['#', '[']) {
                self.refuse(self.here, unreadable);
            }
            return false;
        }
        let not_yet = std::mem::take(&mut self.not_yet);
        if line.percent {
            return !self.opens() && self.close(index);
        }
        if line.is_empty()
            || (line.block_delete && self.interpreter.state().equipment().block_delete)
        {
            return false;
        }
        if line.is_block() && !self.mark(index) {
            let found = format!("more than {BLOCKS_MAX} blocks");
            self.refuse_line(self.here, found, "split the program");
            return true;
        }
        self.note_reading(line);
        if is_fanuc {
            if let Err(refusal) = self.assign_variables(line) {
                self.refuse(self.here, refusal);
                return false;
            }
        } else {
            for (target, value) in line.assignments.drain(..) {
                self.interpreter.assign(target, value);
            }
        }
        if self.interpreter.names() > NAMES_MAX {
            let found = format!("more than {NAMES_MAX} names of parameters");
            self.refuse_line(self.here, found, "fewer names, or numbered parameters");
            return true;
        }
        if known && !line.comments.is_empty() {
            let comments = line.comments.as_slice();
            self.interpreter
                .obey_comments(comments, line.flow.is_some());
        }
        let result = match &line.flow {
            _ if self.interpreter.ended.is_some() => Ok(()),
            Some(flow) if known => self.flow(index, flow, not_yet).map_err(Vec::from),
            Some(_) => Ok(()),
            None if is_fanuc => self.fanuc_block(index, line),
            None if line.words.is_empty() => Ok(()),
            None => self.block(index, line),
        };
        if let Err(refusals) = result {
            self.refuse(self.here, refusals);
        }
        self.watch();
        match self.interpreter.ended {
            Some(ended) => {
                self.end_contour(self.here);
                self.end = ended;
                true
            }
            None => false,
        }
    }

    /// Notes what was read with leniency.
    fn note_reading(&mut self, line: &Line) {
        let number = self.interpreter.line;
        if line.block_delete {
            let text = "block delete (/) is not switched on: such blocks run ([program] block_delete in the machine file)";
            self.interpreter.note(number, text);
        }
        if line.blanks_in_number {
            let text = "blanks inside a number mean nothing: X1 2 is X12";
            self.interpreter.note(number, text);
        }
    }

    /// A block of words.
    fn block(&mut self, index: usize, line: &Line) -> Done {
        if self.straight.of_words(&line.words)
            && self.interpreter.straight(index as u32 + 1, &self.straight)
        {
            return Ok(());
        }
        let mut words = self.words.take().unwrap_or_default();
        let result = self
            .interpreter
            .run_block(index as u32 + 1, line, &mut words);
        let result = result.and_then(|()| self.goes_elsewhere(index, &words));
        self.words = Some(words);
        result
    }

    /// What a block does that goes on in other lines: M98, M99, and G70 to G72.
    fn goes_elsewhere(&mut self, index: usize, words: &Words) -> Done {
        if !self.interpreter.state_known {
            return Ok(());
        }
        if let Some((number, word)) = words.code(Group::Motion)
            && is_turning(number)
        {
            self.turning_cycle(index, words, word)?;
        }
        if let Some((980 | 990, word)) = words.code(Group::Stop) {
            self.call_by_number(index, words, word)?;
        }
        Ok(())
    }

    /// Keeps that a line was done; false if there are too many.
    fn mark(&mut self, index: usize) -> bool {
        self.last_line = self.last_line.max(index as u32 + 1);
        let executed = self.executed.as_mut();
        executed.is_none_or(|executed| executed.mark(index))
    }

    /// Refuses a program that goes on for ever without making anything.
    fn watch(&mut self) {
        let output = &self.interpreter.route.output;
        // At a machine events and waits take their time; who reads beside it would read on for ever.
        let made = match self.interpreter.is_rehearsed() {
            true => output.moves_made(),
            false => output.made(),
        };
        if made != self.idle.1 {
            self.idle = (0, made);
            return;
        }
        self.idle.0 += 1;
        if self.idle.0 > IDLE_BLOCKS_MAX {
            let found = format!("{IDLE_BLOCKS_MAX} blocks in a row without a motion");
            let right = "a loop that ends: does its condition ever change?";
            self.refuse_line(self.here, found, right);
            self.interpreter.ended = Some(ProgramEnd::FileEnd);
        }
    }

    /// A % line before everything else opens the program.
    fn opens(&mut self) -> bool {
        let opens = self.last_line == 0 && !self.opened_by_percent && self.problems.is_empty();
        self.opened_by_percent |= opens;
        opens
    }

    /// Any other % line ends it, a subroutine file's own too.
    fn close(&mut self, index: usize) -> bool {
        if !self.source.is_main(index) {
            return false;
        }
        if self.opened_by_percent || self.rest_is_blank() {
            self.end_contour(self.here);
            self.end = ProgramEnd::Percent(index as u32 + 1);
        } else {
            let right = "% ends only a program that also began with %";
            self.refuse_line(self.here, "% between blocks", right);
        }
        true
    }

    fn rest_is_blank(&mut self) -> bool {
        let mut at = self.next;
        if !self.source.is_main(at.line) {
            return true;
        }
        while let Ok(line) = self.source.line(at) {
            match line {
                Some((line, _)) if Source::begins_file(line, at) => return true,
                Some((line, behind)) if line.trim().is_empty() => at = behind,
                Some(_) => return false,
                None => return true,
            }
        }
        false
    }

    /// The file ends without a word of its own: fine for the program, a mistake in a subroutine.
    fn end_of_file(&mut self) {
        let within = self.within;
        if self.interpreter.state_known
            && let Some(frame) = self.interpreter.frames.called.last()
        {
            let found = format!("the file ends inside {}", frame.shown());
            let right = "a subroutine ends with endsub, return or M99";
            self.refuse_line(within, found, right);
        }
        self.end_contour(within);
    }

    /// Ends a radius compensation with the program.
    fn end_contour(&mut self, at: Spot) {
        if self.interpreter.state_known
            && let Err(refusals) = self.interpreter.end_contour()
        {
            self.refuse(at, refusals);
        }
    }

    fn refuse_line(&mut self, at: Spot, found: impl Into<String>, right: impl Into<String>) {
        self.refuse(at, Refusal::new(0, found, right));
    }

    /// Refuses what the line that was done asks the machine.
    fn refuse_question(&mut self) {
        let Some(question) = self.interpreter.asked().cloned() else {
            return;
        };
        let right = "only a run has an answer";
        self.refuse_line(self.here, "a question to the machine", right);
        if let Err(refusal) = self.interpreter.answer(question.assumed()) {
            self.refuse(self.here, refusal);
        }
    }

    /// Refuses the line that was done if it made elements that are not finite.
    pub fn check_made(&mut self) {
        if std::mem::take(&mut self.interpreter.route.output.is_infinite) {
            let right = "coordinates must stay in the range of ordinary numbers";
            self.refuse_line(self.here, "a path that is not finite", right);
        }
    }

    /// Whether nothing is wrong with the program so far.
    pub fn is_sound(&self) -> bool {
        self.problems.is_empty()
    }

    /// The text of a line, and where the next begins.
    fn raw_line(&mut self, at: Spot) -> Result<(String, Spot), Refusal> {
        match self.source.line(at) {
            Ok(Some((line, behind))) => Ok((line.to_owned(), behind)),
            Ok(None) => Ok((String::new(), at)),
            Err(error) => Err(error),
        }
    }

    /// Keeps what a line was refused for, once for each place.
    fn refuse(&mut self, at: Spot, refusals: impl Into<Vec<Refusal>>) {
        let raw = self.raw_line(at).map_or(String::new(), |(raw, _)| raw);
        let (file, line) = self.source.place(at.line as u32 + 1);
        let file = file.map(str::to_owned);
        for refusal in refusals.into() {
            self.interpreter.state_known &= refusal.state_stays_known;
            let place = Some((line, column(&raw, refusal.offset)));
            let is_told = |told: &&Problem| told.place == place && told.file == file;
            if self.problems.iter().rev().take(8).find(is_told).is_some() {
                continue;
            }
            let token = raw.get(refusal.offset..).unwrap_or_default();
            let length = token
                .chars()
                .take_while(|character| !character.is_whitespace())
                .count();
            self.problems.push(Problem {
                file: file.clone(),
                place,
                found: refusal.found,
                right: refusal.right,
                shown: Some(Shown {
                    text: raw.clone(),
                    length: length.min(40) as u32,
                    trace: self.trace(),
                }),
            });
        }
    }

    /// Where the subroutines in force were called, innermost first.
    fn trace(&self) -> Vec<String> {
        let frames = self.interpreter.frames.called.iter().rev();
        frames
            .map(|frame| {
                let (file, line) = self.source.place(frame.called_from.line as u32 + 1);
                let place = file.map_or(String::new(), |file| format!(" of {file}"));
                format!("{}, called in line {line}{place}", frame.shown())
            })
            .take(10)
            .collect()
    }

    /// The line that an O-word with this label leads to.
    fn find(
        &mut self,
        flow: &FlowWord,
        from: usize,
        keywords: &[Keyword],
        refusal: impl FnOnce() -> Refusal,
    ) -> Result<Label, Refusal> {
        let found = self.source.next(&flow.label, from, keywords);
        let found = found.map_err(|error| error.at(flow.offset))?;
        found.ok_or_else(refusal)
    }
}
