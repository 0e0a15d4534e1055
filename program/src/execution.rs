//! From the lines of a program to its end: which block comes next, what is wrong with it, what was said of it.

use control::path::AxisVector;

use crate::error::{PROBLEMS_MAX, Problem, ProgramError, Shown};
use crate::flow::Keyword;
use crate::interpreter::{Interpreter, Output, is_turning};
use crate::program::{Block, Program, ProgramEnd, Setup, check_setup, source_hash};
use crate::reader::{Line, column, read_line};
use crate::source::Source;
use crate::words::{Group, Refusal, Words};

mod profile;
mod steps;

/// The most blocks of one program; their geometry fits the memory of a small PC (about 1 GB).
pub const BLOCKS_MAX: usize = 2_000_000;

/// So many blocks in a row that make nothing are a loop that does not end.
const IDLE_BLOCKS_MAX: u64 = 2_000_000;

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
    let source = Source::new(text);
    let mut execution = Execution::new(&source, setup, start);
    execution.run();
    let Execution {
        mut interpreter,
        problems,
        more,
        executed,
        end,
        ..
    } = execution;
    if !problems.is_empty() {
        return Err(ProgramError {
            name: name.to_owned(),
            problems,
            more,
        });
    }
    let blocks = blocks_of(&source, &executed);
    let Some(last) = blocks.last() else {
        return Err(ProgramError::of_file(
            name,
            "has no blocks",
            "a program has at least one, such as M2",
        ));
    };
    if end == ProgramEnd::FileEnd {
        interpreter.note(
            last.line,
            "the file ends without M2, M30 or %: taken as the end of the program",
        );
    }
    let tools = interpreter.tools_used();
    let (parameters, output) = interpreter.finish();
    let Output {
        path,
        events,
        messages,
        straight_feeds,
        arc_feeds,
        ..
    } = output;
    let notes = output.notes.by_line();
    if !path.is_finite() {
        let right = "coordinates must stay in the range of ordinary numbers";
        return Err(ProgramError::of_file(
            name,
            "makes a path that is not finite",
            right,
        ));
    }
    Ok(Program {
        name: name.to_owned(),
        source_hash: source_hash(text, setup, &start, tools),
        start,
        blocks,
        end,
        notes,
        path,
        events,
        messages,
        parameters,
        straight_feeds,
        arc_feeds,
    })
}

/// The lines that were done, with their text.
fn blocks_of(source: &Source<'_>, executed: &[bool]) -> Vec<Block> {
    let done = (1u32..).zip(executed).filter(|&(_, done)| *done);
    let text = |line: u32| source.line(line as usize - 1).unwrap_or_default().trim();
    done.map(|(line, _)| Block {
        line,
        text: text(line).to_owned(),
    })
    .collect()
}

/// What is known of a program while it is executed.
struct Execution<'a> {
    source: &'a Source<'a>,
    interpreter: Interpreter<'a>,
    /// The line that comes next, counted from 0.
    next: usize,
    /// The line before was an `if` or `elseif` that did not hold.
    not_yet: bool,
    /// Lines that were done at least once.
    executed: Vec<bool>,
    executed_count: usize,
    /// Blocks since one made something, and how much there was then.
    idle: (u64, usize),
    problems: Vec<Problem>,
    /// There were more problems than are kept.
    more: bool,
    end: ProgramEnd,
    opened_by_percent: bool,
    line: Line,
    words: Words,
}

impl<'a> Execution<'a> {
    fn new(source: &'a Source<'a>, setup: &'a Setup, start: AxisVector) -> Self {
        Self {
            source,
            interpreter: Interpreter::new(setup, start),
            next: 0,
            not_yet: false,
            executed: vec![],
            executed_count: 0,
            idle: (0, 0),
            problems: Vec::new(),
            more: false,
            end: ProgramEnd::FileEnd,
            opened_by_percent: false,
            line: Line::default(),
            words: Words::default(),
        }
    }

    /// Executes up to the end of the program, or until there are enough problems.
    fn run(&mut self) {
        let mut within = 0;
        loop {
            let index = self.next;
            if self.source.is_beyond(index, within) || self.source.line(index).is_none() {
                self.end_of_file(within);
                return;
            }
            within = index;
            let raw = self.source.line(index).unwrap_or_default();
            self.next = index + 1;
            let mut line = std::mem::take(&mut self.line);
            let ends = self.step(index, raw, &mut line);
            self.line = line;
            if self.problems.len() >= PROBLEMS_MAX {
                self.more = self.problems.len() > PROBLEMS_MAX || !self.rest_is_blank();
                self.problems.truncate(PROBLEMS_MAX);
                return;
            }
            if ends {
                return;
            }
            if self.next != index + 1 {
                within = self.next.saturating_sub(1);
            }
        }
    }

    /// One line; true if the program ends with it.
    fn step(&mut self, index: usize, raw: &str, line: &mut Line) -> bool {
        let known = self.interpreter.state_known;
        if let Err(unreadable) = read_line(raw, &self.interpreter, line) {
            // Values that nobody knows make no mistakes.
            if known || !raw.contains(['#', '[']) {
                let refusal = Refusal::new(unreadable.offset, unreadable.found, unreadable.right);
                self.refuse(index, raw, vec![refusal]);
            }
            return false;
        }
        let not_yet = std::mem::take(&mut self.not_yet);
        if line.percent {
            return !self.opens() && self.close(index);
        }
        if line.is_empty() || (line.block_delete && self.interpreter.setup.block_delete) {
            return false;
        }
        if known && !line.comments.is_empty() {
            self.interpreter.say(index, &line.comments);
        }
        if line.words.is_empty() && line.assignments.is_empty() && line.flow.is_none() {
            return false;
        }
        if !self.mark(index) {
            let found = format!("more than {BLOCKS_MAX} blocks");
            self.refuse(
                index,
                raw,
                vec![Refusal::new(0, found, "split the program")],
            );
            return true;
        }
        let number = index as u32 + 1;
        if line.block_delete {
            let text = "block delete (/) is not switched on: such blocks run ([program] block_delete in the machine file)";
            self.interpreter.note(number, text);
        }
        if line.blanks_in_number {
            let text = "blanks inside a number mean nothing: X1 2 is X12";
            self.interpreter.note(number, text);
        }
        for (target, value) in line.assignments.drain(..) {
            self.interpreter.assign(target, value);
        }
        let result = match &line.flow {
            Some(flow) if known => self
                .flow(index, flow, not_yet)
                .map_err(|refusal| vec![refusal]),
            Some(_) => Ok(()),
            None if line.words.is_empty() => Ok(()),
            None => self.block(index, line),
        };
        if let Err(refusals) = result {
            self.refuse(index, raw, refusals);
        }
        self.watch(index, raw);
        match self.interpreter.ended {
            Some(ended) => {
                self.end_contour(index);
                self.end = ended;
                true
            }
            None => false,
        }
    }

    /// A block of words.
    fn block(&mut self, index: usize, line: &Line) -> Result<(), Vec<Refusal>> {
        let mut words = std::mem::take(&mut self.words);
        let result = self
            .interpreter
            .run_block(index as u32 + 1, line, &mut words);
        let called = match (&result, words.code(Group::Stop)) {
            (Ok(()), Some((980 | 990, word))) if self.interpreter.state_known => {
                self.call_by_number(index, &words, word)
            }
            _ => Ok(()),
        };
        let turned = match (&result, words.code(Group::Motion)) {
            (Ok(()), Some((number, word)))
                if is_turning(number) && self.interpreter.state_known =>
            {
                self.turning_cycle(index, &words, word)
            }
            _ => Ok(()),
        };
        self.words = words;
        result
            .and(turned)
            .and(called.map_err(|refusal| vec![refusal]))
    }

    /// Keeps that a line was done; false if there are too many.
    fn mark(&mut self, index: usize) -> bool {
        if self.executed.len() <= index {
            self.executed.resize(index + 1, false);
        }
        if let Some(done) = self.executed.get_mut(index)
            && !*done
        {
            *done = true;
            self.executed_count += 1;
        }
        self.executed_count <= BLOCKS_MAX
    }

    /// Refuses a program that goes on for ever without making anything.
    fn watch(&mut self, index: usize, raw: &str) {
        let made = self.interpreter.made();
        if made != self.idle.1 {
            self.idle = (0, made);
            return;
        }
        self.idle.0 += 1;
        if self.idle.0 > IDLE_BLOCKS_MAX {
            let found = format!("{IDLE_BLOCKS_MAX} blocks in a row without a motion");
            let right = "a loop that ends: does its condition ever change?";
            self.refuse(index, raw, vec![Refusal::new(0, found, right)]);
            self.interpreter.ended = Some(ProgramEnd::FileEnd);
        }
    }

    /// A % line before everything else opens the program.
    fn opens(&mut self) -> bool {
        let opens = self.executed.is_empty() && !self.opened_by_percent && self.problems.is_empty();
        self.opened_by_percent |= opens;
        opens
    }

    /// Any other % line ends it, a subroutine file's own too.
    fn close(&mut self, index: usize) -> bool {
        if index >= self.source.main_end() {
            return false;
        }
        if self.opened_by_percent || self.rest_is_blank() {
            self.end_contour(index);
            self.end = ProgramEnd::Percent(index as u32 + 1);
        } else {
            let right = "% ends only a program that also began with %";
            self.refuse_line(index, "% between blocks".into(), right);
        }
        true
    }

    fn rest_is_blank(&self) -> bool {
        (self.next..self.source.main_end())
            .all(|line| self.source.line(line).unwrap_or_default().trim().is_empty())
    }

    /// The file ends without a word of its own: fine for the program, a mistake in a subroutine.
    fn end_of_file(&mut self, within: usize) {
        if self.interpreter.state_known
            && let Some(frame) = self.interpreter.frames.called()
        {
            let found = format!("the file ends inside {}", frame.shown());
            self.refuse_line(
                within,
                found,
                "a subroutine ends with endsub, return or M99",
            );
        }
        self.end_contour(within);
    }

    /// Ends a radius compensation with the program.
    fn end_contour(&mut self, index: usize) {
        if self.interpreter.state_known
            && let Err(refusals) = self.interpreter.end_contour()
        {
            self.refuse(index, self.source.line(index).unwrap_or_default(), refusals);
        }
    }

    fn refuse_line(&mut self, index: usize, found: String, right: &str) {
        let raw = self.source.line(index).unwrap_or_default();
        self.refuse(index, raw, vec![Refusal::new(0, found, right)]);
    }

    /// Keeps what a line was refused for, once for each place.
    fn refuse(&mut self, index: usize, raw: &str, refusals: Vec<Refusal>) {
        let (file, line) = self.source.place(index as u32 + 1);
        for refusal in refusals {
            self.interpreter.state_known &= refusal.state_stays_known;
            let place = Some((line, column(raw, refusal.offset)));
            let file = file.map(str::to_owned);
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
                file,
                place,
                found: refusal.found,
                right: refusal.right,
                shown: Some(Shown {
                    text: raw.to_owned(),
                    length: length.min(40) as u32,
                    trace: self.trace(),
                }),
            });
        }
    }

    /// Where the subroutines in force were called, innermost first.
    fn trace(&self) -> Vec<String> {
        let frames = self.interpreter.frames.called_frames();
        frames
            .map(|frame| {
                let (file, line) = self.source.place(frame.called_from as u32 + 1);
                let place = file.map_or(String::new(), |file| format!(" of {file}"));
                format!("{}, called in line {line}{place}", frame.shown())
            })
            .take(10)
            .collect()
    }

    /// The line that an O-word with this label leads to.
    fn find(
        &self,
        label: &str,
        from: usize,
        keywords: &[Keyword],
        refusal: impl FnOnce() -> Refusal,
    ) -> Result<(usize, Keyword), Refusal> {
        self.source.next(label, from, keywords).ok_or_else(refusal)
    }
}
