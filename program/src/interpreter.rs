//! The modal interpreter: blocks of words become path elements.

use std::collections::BTreeMap;

use control::path::{
    AxisVector, Element, Feed, MAX_AXES, Path, RotaryAxes, Shape, displacement_length_mm,
};

use crate::arc::{ArcBlock, Circle};
use crate::cycles::{Cycle, CycleBlock, PECKS_MAX, Series, Step};
use crate::error::{PROBLEMS_MAX, Problem, ProgramError};
use crate::letters::AXIS_LETTERS;
use crate::program::{
    Block, Event, EventKind, Note, Program, ProgramEnd, Setup, check_setup, source_hash,
};
use crate::reader::{Line, column, read_line};
use crate::words::{Group, Refusal, Words};

mod arcs;
mod drilling;
mod travel;

/// The most blocks of one program; their geometry fits the memory of a small PC (about 1 GB).
pub const BLOCKS_MAX: usize = 2_000_000;

const MM_PER_INCH: f64 = 25.4;

/// How far the radii of an arc's ends may differ, programmed in mm (NIST §3.5.3).
const ARC_TOLERANCE_MM: f64 = 0.002;

/// The same, programmed in inches: 0.0002 inch.
const ARC_TOLERANCE_INCH_MM: f64 = 0.0002 * MM_PER_INCH;

/// What a position may exceed the travel by and count as rounding: 1 nm.
const TRAVEL_ROUNDING: f64 = 1e-6;

/// The most elements of one path; an arc block makes up to two, a drilling block as many as it has moves.
const ELEMENTS_MAX: usize = 2 * BLOCKS_MAX;

/// The most holes of one drilling block.
const REPEATS_MAX: f64 = 10_000.0;

/// The most turns of one arc.
const TURNS_MAX: f64 = 10_000.0;

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
    let mut reading = Reading::new(setup, start);
    reading.read(text);
    let Reading {
        mut interpreter,
        problems,
        more,
        blocks,
        end,
        ..
    } = reading;
    if !problems.is_empty() {
        return Err(ProgramError {
            name: name.to_owned(),
            problems,
            more,
        });
    }
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
    if !interpreter.path.is_finite() {
        let right = "coordinates must stay in the range of ordinary numbers";
        return Err(ProgramError::of_file(
            name,
            "makes a path that is not finite",
            right,
        ));
    }
    Ok(Program {
        name: name.to_owned(),
        source_hash: source_hash(text, setup, &start),
        start,
        blocks,
        end,
        notes: interpreter.notes_by_line(),
        path: interpreter.path,
        events: interpreter.events,
        straight_feeds: interpreter.straight_feeds,
        arc_feeds: interpreter.arc_feeds,
    })
}

/// What is known of a program while its lines are read.
struct Reading<'a> {
    interpreter: Interpreter<'a>,
    problems: Vec<Problem>,
    /// There were more problems than are kept.
    more: bool,
    blocks: Vec<Block>,
    end: ProgramEnd,
    opened_by_percent: bool,
}

impl<'a> Reading<'a> {
    fn new(setup: &'a Setup, start: AxisVector) -> Self {
        Self {
            interpreter: Interpreter::new(setup, start),
            problems: Vec::new(),
            more: false,
            blocks: Vec::new(),
            end: ProgramEnd::FileEnd,
            opened_by_percent: false,
        }
    }

    /// Reads the lines up to the end of the program, or until there are enough problems.
    fn read(&mut self, text: &str) {
        let mut lines = (1u32..).zip(text.split('\n'));
        while let Some((number, raw)) = lines.next() {
            let raw = raw.strip_suffix('\r').unwrap_or(raw);
            let refusals = match read_line(raw) {
                Err(unreadable) => vec![Refusal::new(
                    unreadable.offset,
                    unreadable.found,
                    unreadable.right,
                )],
                Ok(line) if line.percent => {
                    if self.opens() {
                        continue;
                    }
                    self.close(number, lines.all(|(_, rest)| rest.trim().is_empty()));
                    return;
                }
                Ok(line) if line.words.is_empty() => vec![],
                Ok(_) if self.blocks.len() >= BLOCKS_MAX => {
                    let found = format!("more than {BLOCKS_MAX} blocks");
                    self.refuse_line(number, found, "split the program");
                    return;
                }
                Ok(line) => {
                    self.blocks.push(Block {
                        line: number,
                        text: raw.trim().to_owned(),
                    });
                    self.interpreter.run_block(number, &line)
                }
            };
            self.refuse(number, raw, refusals);
            if self.problems.len() >= PROBLEMS_MAX {
                self.more = self.problems.len() > PROBLEMS_MAX
                    || lines.any(|(_, rest)| !rest.trim().is_empty());
                self.problems.truncate(PROBLEMS_MAX);
                return;
            }
            if let Some(ended) = self.interpreter.ended {
                self.end = ended;
                return;
            }
        }
    }

    /// A % line before everything else opens the program.
    fn opens(&mut self) -> bool {
        let opens = self.blocks.is_empty() && !self.opened_by_percent && self.problems.is_empty();
        self.opened_by_percent |= opens;
        opens
    }

    /// Any other % line ends it.
    fn close(&mut self, number: u32, rest_is_blank: bool) {
        if self.opened_by_percent || rest_is_blank {
            self.end = ProgramEnd::Percent(number);
        } else {
            let right = "% ends only a program that also began with %";
            self.refuse_line(number, "% between blocks".into(), right);
        }
    }

    fn refuse_line(&mut self, number: u32, found: String, right: &str) {
        self.problems.push(Problem {
            place: Some((number, 1)),
            found,
            right: right.into(),
        });
    }

    /// Keeps what a block was refused for.
    fn refuse(&mut self, number: u32, raw: &str, refusals: Vec<Refusal>) {
        self.interpreter.state_known &= refusals.iter().all(|refusal| refusal.state_stays_known);
        self.problems
            .extend(refusals.into_iter().map(|refusal| Problem {
                place: Some((number, column(raw, refusal.offset))),
                found: refusal.found,
                right: refusal.right,
            }));
    }
}

/// Motion mode (modal group 1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Motion {
    /// G80, and before the first motion word.
    None,
    Rapid,
    Line,
    Arc {
        clockwise: bool,
    },
    Cycle(Cycle),
}

struct Interpreter<'a> {
    setup: &'a Setup,
    rotary: RotaryAxes,
    motion: Motion,
    /// Axis letters of the plane: first, second; with the offset letters that belong to them.
    plane: (u32, [char; 2], [char; 2]),
    inches: bool,
    incremental: bool,
    arc_absolute: bool,
    /// What drilling cycles in a row keep; none between them.
    series: Option<Series>,
    returns_to_r: bool,
    /// (in mm/s, in degrees/s)
    feed_per_s: Option<(f64, f64)>,
    position: AxisVector,
    state_known: bool,
    path: Path,
    events: Vec<Event>,
    notes: BTreeMap<&'static str, u32>,
    ended: Option<ProgramEnd>,
    straight_feeds: u32,
    arc_feeds: u32,
}

impl<'a> Interpreter<'a> {
    fn new(setup: &'a Setup, start: AxisVector) -> Self {
        let mut rotary = [false; MAX_AXES];
        for (flag, axis) in rotary.iter_mut().zip(&setup.axes) {
            *flag = axis.rotary;
        }
        Self {
            setup,
            rotary,
            motion: Motion::None,
            plane: (17, ['X', 'Y'], ['I', 'J']),
            inches: false,
            incremental: false,
            arc_absolute: false,
            series: None,
            returns_to_r: false,
            feed_per_s: None,
            position: start,
            state_known: true,
            path: Path::default(),
            events: Vec::new(),
            notes: BTreeMap::new(),
            ended: None,
            straight_feeds: 0,
            arc_feeds: 0,
        }
    }

    fn note(&mut self, line: u32, text: &'static str) {
        self.notes.entry(text).or_insert(line);
    }

    /// The notes in the order of their lines.
    fn notes_by_line(&self) -> Vec<Note> {
        let mut notes: Vec<Note> = self
            .notes
            .iter()
            .map(|(&text, &line)| Note {
                line,
                text: text.to_owned(),
            })
            .collect();
        notes.sort_by_key(|note| note.line);
        notes
    }

    /// Program units to mm.
    fn unit_mm(&self) -> f64 {
        if self.inches { MM_PER_INCH } else { 1.0 }
    }

    /// Does one block in the order of NIST §3.8; its refusals, none if it is done.
    fn run_block(&mut self, line: u32, block: &Line) -> Vec<Refusal> {
        if block.block_delete {
            self.note(line, "block delete (/) is not switched on: such blocks run");
        }
        let words = match Words::sort(block, self.setup) {
            Ok(words) => words,
            Err(refusals) => return refusals,
        };
        if !self.state_known {
            // A block before was refused: what this one would do is not known, only where the program ends.
            self.end_by(line, &words);
            return vec![];
        }
        match self.execute(line, &words) {
            Ok(()) => vec![],
            Err(refusals) => refusals,
        }
    }

    fn execute(&mut self, line: u32, words: &Words) -> Result<(), Vec<Refusal>> {
        let one = |refusal| vec![refusal];
        self.set_units_and_feed(words).map_err(one)?;
        self.spindle(line, words);
        let dwell_s = self.dwell_seconds(words).map_err(one)?;
        if let Some((number, _)) = words.code(Group::Plane) {
            self.plane = match number {
                180 => (18, ['Z', 'X'], ['K', 'I']),
                190 => (19, ['Y', 'Z'], ['J', 'K']),
                _ => (17, ['X', 'Y'], ['I', 'J']),
            };
        }
        if let Some((number, _)) = words.code(Group::Distance) {
            self.incremental = number == 910;
        }
        if let Some((number, _)) = words.code(Group::ArcDistance) {
            self.arc_absolute = number == 901;
        }
        if let Some((640, _)) = words.code(Group::PathControl) {
            self.note(
                line,
                "G64 follows the exact path, as G61 does; its tolerance is not used",
            );
        }
        let motion_word = words.code(Group::Motion);
        if let Some((number, _)) = motion_word {
            self.motion = match number {
                0 => Motion::Rapid,
                10 => Motion::Line,
                20 => Motion::Arc { clockwise: true },
                30 => Motion::Arc { clockwise: false },
                other => Cycle::of_code(other).map_or(Motion::None, Motion::Cycle),
            };
        }
        if let Some((number, _)) = words.code(Group::CycleReturn) {
            self.returns_to_r = number == 990;
        }
        if !matches!(self.motion, Motion::Cycle(_)) {
            self.series = None;
        }
        if let Some(seconds) = dwell_s.filter(|&seconds| seconds > 0.0) {
            self.path
                .elements
                .push(Element::dwell(line, self.position, seconds));
        }
        self.check_words_used(words).map_err(one)?;
        self.travel(line, words)?;
        self.end_by(line, words);
        Ok(())
    }

    /// Ends the program if the block says so.
    fn end_by(&mut self, line: u32, words: &Words) {
        if let Some((number, _)) = words.code(Group::Stop) {
            self.ended = Some(if number == 20 {
                ProgramEnd::M2(line)
            } else {
                ProgramEnd::M30(line)
            });
        }
    }

    fn set_units_and_feed(&mut self, words: &Words) -> Result<(), Refusal> {
        let feed = words.value('F');
        if let Some((number, _)) = words.code(Group::Units) {
            let inches = number == 200;
            if let Some(feed) = feed.filter(|_| inches != self.inches) {
                let right = "in which unit? put the change of unit into a block before it";
                return Err(Refusal::new(
                    feed.offset,
                    "F in the block that changes the unit",
                    right,
                ));
            }
            self.inches = inches;
        }
        if let Some(feed) = feed {
            // F0 takes the feed away: the next feed motion needs another.
            self.feed_per_s =
                (feed.value > 0.0).then(|| (feed.value * self.unit_mm() / 60.0, feed.value / 60.0));
        }
        Ok(())
    }

    fn spindle(&mut self, line: u32, words: &Words) {
        let speed = words
            .value('S')
            .map(|word| EventKind::SpindleSpeedRpm(word.value));
        let direction = words.code(Group::Spindle).map(|(number, _)| match number {
            30 => EventKind::SpindleClockwise,
            40 => EventKind::SpindleCounterClockwise,
            _ => EventKind::SpindleStop,
        });
        let before_element = self.path.elements.len();
        for kind in speed.into_iter().chain(direction) {
            self.events.push(Event {
                line,
                before_element,
                kind,
            });
        }
    }

    fn dwell_seconds(&self, words: &Words) -> Result<Option<f64>, Refusal> {
        let Some((_, dwell)) = words.code(Group::Dwell) else {
            return Ok(None);
        };
        match words.value('P') {
            None => Err(Refusal::new(
                dwell.offset,
                "G4 without P",
                "the time in seconds, such as G4 P0.5",
            )),
            Some(p) if p.value < 0.0 => Err(Refusal::new(
                p.offset,
                format!("P{}", p.value),
                "a time is 0 s or more",
            )),
            Some(p) => Ok(Some(p.value)),
        }
    }

    /// Refuses words that nothing in the block makes use of.
    fn check_words_used(&self, words: &Words) -> Result<(), Refusal> {
        let arc = matches!(self.motion, Motion::Arc { .. });
        let cycle = match self.motion {
            Motion::Cycle(cycle) if words.first_of(AXIS_LETTERS).is_some() => Some(cycle),
            _ => None,
        };
        if let Some(word) = words.first_of("IJK").filter(|_| !arc) {
            return Err(Refusal::new(
                word.offset,
                format!("{} without an arc", word.letter),
                "I J K belong to G2 and G3",
            ));
        }
        if let Some(word) = words.value('R').filter(|_| !arc && cycle.is_none()) {
            return Err(Refusal::new(
                word.offset,
                "R without an arc or a hole",
                "R belongs to G2 and G3 (radius) and to G81, G82 and G83 with X, Y or Z (level)",
            ));
        }
        if let Some(word) = words.value('L').filter(|_| cycle.is_none()) {
            return Err(Refusal::new(
                word.offset,
                format!("L{}", word.value),
                "L belongs to G81, G82 and G83 with X, Y or Z (holes)",
            ));
        }
        let g64 = matches!(words.code(Group::PathControl), Some((640, _)));
        let dwell = words.code(Group::Dwell).is_some();
        let arc_words = arc && words.first_of("IJKR").is_some();
        let dwells_in_hole = cycle == Some(Cycle::DrillAndDwell);
        if let Some(word) = words.value('P') {
            let users = [dwell, g64, arc_words, dwells_in_hole]
                .into_iter()
                .filter(|&uses| uses)
                .count();
            let right = match users {
                0 => "P belongs to G4 (seconds), G64 (tolerance), G2 and G3 (turns), G82 (seconds)",
                1 => "",
                _ => "only one of G4, G64, G2/G3, G82 in a block with P: which is it for?",
            };
            if users != 1 {
                return Err(Refusal::new(word.offset, format!("P{}", word.value), right));
            }
        }
        let pecks = cycle == Some(Cycle::Peck);
        if let Some(word) = words.value('Q').filter(|_| g64 == pecks) {
            let right = if g64 {
                "only one of G64 and G83 in a block with Q: which is it for?"
            } else {
                "Q belongs to G64 (tolerance) and G83 (peck)"
            };
            return Err(Refusal::new(word.offset, format!("Q{}", word.value), right));
        }
        Ok(())
    }
}
