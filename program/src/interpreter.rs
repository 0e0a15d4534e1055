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

/// Interprets a program text, for a machine that stands at `start` (machine coordinates). `name` stands in errors.
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
    let mut interpreter = Interpreter::new(setup, start);
    let mut problems: Vec<Problem> = Vec::new();
    let mut blocks = Vec::new();
    let mut end = ProgramEnd::FileEnd;
    let mut opened_by_percent = false;
    let mut more = false;

    let mut lines = (1u32..).zip(text.split('\n'));
    while let Some((number, raw)) = lines.next() {
        let raw = raw.strip_suffix('\r').unwrap_or(raw);
        let at = |offset: usize| Some((number, column(raw, offset)));
        let refusals = match read_line(raw) {
            Err(unreadable) => vec![Refusal::new(
                unreadable.offset,
                unreadable.found,
                unreadable.right,
            )],
            Ok(line)
                if line.percent
                    && blocks.is_empty()
                    && !opened_by_percent
                    && problems.is_empty() =>
            {
                opened_by_percent = true;
                vec![]
            }
            Ok(line) if line.percent => {
                let rest_is_blank = lines.by_ref().all(|(_, rest)| rest.trim().is_empty());
                if opened_by_percent || rest_is_blank {
                    end = ProgramEnd::Percent(number);
                } else {
                    let right = "% ends only a program that also began with %";
                    problems.push(Problem {
                        place: at(0),
                        found: "% between blocks".into(),
                        right: right.into(),
                    });
                }
                break;
            }
            Ok(line) if line.words.is_empty() => vec![],
            Ok(line) => {
                if blocks.len() >= BLOCKS_MAX {
                    let found = format!("more than {BLOCKS_MAX} blocks");
                    problems.push(Problem {
                        place: at(0),
                        found,
                        right: "split the program".into(),
                    });
                    break;
                }
                blocks.push(Block {
                    line: number,
                    text: raw.trim().to_owned(),
                });
                interpreter.run_block(number, &line)
            }
        };
        if !refusals.is_empty() {
            interpreter.state_known &= refusals.iter().all(|refusal| refusal.state_stays_known);
        }
        for refusal in refusals {
            problems.push(Problem {
                place: at(refusal.offset),
                found: refusal.found,
                right: refusal.right,
            });
        }
        if problems.len() >= PROBLEMS_MAX {
            more = problems.len() > PROBLEMS_MAX || lines.any(|(_, rest)| !rest.trim().is_empty());
            problems.truncate(PROBLEMS_MAX);
            break;
        }
        if let Some(ended) = interpreter.ended {
            end = ended;
            break;
        }
    }
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
    let mut notes: Vec<Note> = interpreter
        .notes
        .into_iter()
        .map(|(text, line)| Note {
            line,
            text: text.to_owned(),
        })
        .collect();
    notes.sort_by_key(|note| note.line);
    Ok(Program {
        name: name.to_owned(),
        source_hash: source_hash(text, setup, &start),
        path: interpreter.path,
        blocks,
        events: interpreter.events,
        notes,
        end,
        straight_feeds: interpreter.straight_feeds,
        arc_feeds: interpreter.arc_feeds,
    })
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

    /// The motion of a block, if it has one.
    fn travel(&mut self, line: u32, words: &Words) -> Result<(), Vec<Refusal>> {
        let one = |refusal| vec![refusal];
        let axis_word = words.first_of(AXIS_LETTERS);
        let offset = words
            .code(Group::Motion)
            .map(|(_, word)| word)
            .or(axis_word)
            .or(words.first_of("IJKR"));
        let Some(offset) = offset.map(|word| word.offset) else {
            return Ok(());
        };
        if let Motion::Cycle(cycle) = self.motion {
            return self.drill(line, words, cycle, offset);
        }
        let target = self.target(words);
        let (shapes, feed) = match self.motion {
            _ if axis_word.is_none() && words.first_of("IJKR").is_none() => return Ok(()),
            Motion::None | Motion::Cycle(_) => {
                let found = format!(
                    "{} without a motion mode",
                    axis_word.map_or('?', |word| word.letter)
                );
                return Err(one(Refusal::new(
                    offset,
                    found,
                    "say how to move: G0, G1, G2 or G3",
                )));
            }
            Motion::Rapid => (
                vec![Shape::Line {
                    from: self.position,
                    to: target,
                }],
                Feed::Rapid,
            ),
            Motion::Line => {
                let feed = self.feed(&target, offset).map_err(one)?;
                self.straight_feeds += 1;
                (
                    vec![Shape::Line {
                        from: self.position,
                        to: target,
                    }],
                    feed,
                )
            }
            Motion::Arc { clockwise } => {
                let feed = self.feed(&target, offset).map_err(one)?;
                self.arc_feeds += 1;
                let block = self
                    .arc_block(words, target, clockwise, offset)
                    .map_err(one)?;
                let shapes = block.shapes();
                (
                    shapes.map_err(|(found, right)| one(Refusal::new(offset, found, right)))?,
                    feed,
                )
            }
        };
        let outside = self.outside(words, &shapes, offset);
        for shape in shapes {
            let element = Element::new(line, shape, feed, &self.rotary);
            if element.length_mm > 0.0 {
                self.path.elements.push(element);
            }
        }
        self.position = target;
        if outside.is_empty() {
            Ok(())
        } else {
            Err(outside)
        }
    }

    /// The holes of a drilling block.
    fn drill(
        &mut self,
        line: u32,
        words: &Words,
        cycle: Cycle,
        offset: usize,
    ) -> Result<(), Vec<Refusal>> {
        let one = |refusal| vec![refusal];
        let block = self.cycle_block(words, cycle, offset).map_err(one)?;
        self.series = Some(block.series);
        let feed = self.feed(&self.position, offset).map_err(one)?;
        if self.path.elements.len() as f64 + block.steps_max() > ELEMENTS_MAX as f64 {
            let found = format!("holes that take the path beyond {ELEMENTS_MAX} elements");
            return Err(one(Refusal::new(offset, found, "split the program")));
        }
        let mut shapes = Vec::new();
        let mut elements = Vec::new();
        let mut here = self.position;
        for step in block.steps() {
            let (to, feed) = match step {
                Step::Dwell(seconds) => {
                    elements.push(Element::dwell(line, here, seconds));
                    continue;
                }
                Step::Rapid(to) => (to, Feed::Rapid),
                Step::Feed(to) => {
                    self.straight_feeds += 1;
                    (to, feed)
                }
            };
            let shape = Shape::Line { from: here, to };
            let element = Element::new(line, shape.clone(), feed, &self.rotary);
            if element.length_mm > 0.0 {
                elements.push(element);
            }
            shapes.push(shape);
            here = to;
        }
        let outside = self.outside(words, &shapes, offset);
        self.path.elements.extend(elements);
        self.position = here;
        if outside.is_empty() {
            Ok(())
        } else {
            Err(outside)
        }
    }

    /// Understands the words of a drilling block.
    fn cycle_block(
        &self,
        words: &Words,
        cycle: Cycle,
        offset: usize,
    ) -> Result<CycleBlock, Refusal> {
        let code = cycle.code();
        let (plane, letters, _) = self.plane;
        if plane != 17 {
            let found = format!(
                "{code} in the plane {}{} (G{plane})",
                letters[0], letters[1]
            );
            let right = "drilling cycles are supported along Z: choose the plane XY with G17";
            return Err(Refusal::new(offset, found, right));
        }
        let slide = |letter| {
            let index = self.setup.axis_index(letter)?;
            self.rotary
                .get(index)
                .is_some_and(|rotary| !rotary)
                .then_some(index)
        };
        let Some(drill_axis) = slide('Z') else {
            let right = "drilling cycles run along Z: this machine has no slide Z";
            return Err(Refusal::new(offset, code, right));
        };
        if let Some(word) = words.first_of("ABCUVW") {
            let found = format!("{}{} in {code}", word.letter, word.value);
            return Err(Refusal::new(
                word.offset,
                found,
                "a drilling cycle moves X, Y and Z",
            ));
        }
        if words.first_of("XYZ").is_none() {
            let right = "say where: X, Y or Z";
            return Err(Refusal::new(
                offset,
                format!("{code} without a hole"),
                right,
            ));
        }
        let series = self.cycle_series(words, cycle, drill_axis, offset)?;
        let repeats = match words.value('L') {
            None => 1,
            Some(l) if l.value >= 1.0 && l.value <= REPEATS_MAX && l.value.fract() == 0.0 => {
                l.value as u32
            }
            Some(l) => {
                let right = format!("holes are a whole number from 1 to {REPEATS_MAX}");
                return Err(Refusal::new(l.offset, format!("L{}", l.value), right));
            }
        };
        let mut hole = self.target(words);
        if let (Some(of_hole), Some(here)) =
            (hole.get_mut(drill_axis), self.position.get(drill_axis))
        {
            *of_hole = *here;
        }
        let pitch = if self.incremental {
            hole - self.position
        } else {
            AxisVector::zeros()
        };
        let block = CycleBlock {
            from: self.position,
            hole,
            pitch,
            repeats,
            drill_axis,
            series,
            returns_to_r: self.returns_to_r,
        };
        if cycle == Cycle::Peck && block.pecks() >= PECKS_MAX {
            let place = words.value('Q').map_or(offset, |q| q.offset);
            let found = format!(
                "Q{} with {} pecks a hole",
                series.peck_mm / self.unit_mm(),
                block.pecks() + 1.0
            );
            return Err(Refusal::new(
                place,
                found,
                format!("at most {PECKS_MAX} pecks"),
            ));
        }
        Ok(block)
    }

    /// The levels, the wait and the peck of a drilling block: its own words, else those that stay from the block before.
    fn cycle_series(
        &self,
        words: &Words,
        cycle: Cycle,
        drill_axis: usize,
        offset: usize,
    ) -> Result<Series, Refusal> {
        let code = cycle.code();
        let kept = self.series.filter(|series| series.cycle == cycle);
        let missing = |letter: char, what: &str| {
            let found = format!("{code} without {letter}");
            Refusal::new(
                offset,
                found,
                format!("{what} in the first block of a cycle"),
            )
        };
        let here_mm = self.position.get(drill_axis).copied().unwrap_or(0.0);
        let zero_mm = self
            .setup
            .work_offset
            .get(drill_axis)
            .copied()
            .unwrap_or(0.0);
        let level = |letter: char, counts_from_mm: f64| {
            words.value(letter).map(|word| {
                let from_mm = if self.incremental {
                    counts_from_mm
                } else {
                    zero_mm
                };
                from_mm + word.value * self.unit_mm()
            })
        };
        let r_mm = level('R', here_mm)
            .or(kept.map(|kept| kept.r_mm))
            .ok_or_else(|| missing('R', "the level to feed from"))?;
        let bottom_mm = level('Z', r_mm)
            .or(kept.map(|kept| kept.bottom_mm))
            .ok_or_else(|| missing('Z', "the bottom of the hole"))?;
        if r_mm < bottom_mm {
            let place = words.value('R').or(words.value('Z'));
            let (r, z) = [r_mm, bottom_mm]
                .map(|mm| (mm - zero_mm) / self.unit_mm())
                .into();
            let found = format!("{code} with R at {r:.4} below Z at {z:.4}");
            let place = place.map_or(offset, |word| word.offset);
            return Err(Refusal::new(
                place,
                found,
                "R lies above the bottom of the hole",
            ));
        }
        let dwell_s = match words.value('P') {
            _ if cycle != Cycle::DrillAndDwell => 0.0,
            Some(p) if p.value >= 0.0 => p.value,
            Some(p) => {
                let found = format!("P{}", p.value);
                return Err(Refusal::new(p.offset, found, "a time is 0 s or more"));
            }
            None => kept
                .map(|kept| kept.dwell_s)
                .ok_or_else(|| missing('P', "the seconds to wait at the bottom"))?,
        };
        let peck_mm = match words.value('Q') {
            _ if cycle != Cycle::Peck => 0.0,
            Some(q) if q.value > 0.0 => q.value * self.unit_mm(),
            Some(q) => {
                let found = format!("Q{}", q.value);
                return Err(Refusal::new(q.offset, found, "a peck is above 0"));
            }
            None => kept
                .map(|kept| kept.peck_mm)
                .ok_or_else(|| missing('Q', "the depth of one peck"))?,
        };
        Ok(Series {
            cycle,
            initial_mm: self.series.map_or(here_mm, |series| series.initial_mm),
            r_mm,
            bottom_mm,
            dwell_s,
            peck_mm,
        })
    }

    /// Where the block's axis words lead, in machine coordinates.
    fn target(&self, words: &Words) -> AxisVector {
        let mut target = self.position;
        let axes = target
            .iter_mut()
            .zip(&self.setup.axes)
            .zip(self.setup.work_offset.iter());
        for ((component, axis), work_offset) in axes {
            if let Some(word) = words.value(axis.letter) {
                let value = if axis.rotary {
                    word.value
                } else {
                    word.value * self.unit_mm()
                };
                *component = if self.incremental {
                    *component + value
                } else {
                    work_offset + value
                };
            }
        }
        target
    }

    fn feed(&self, target: &AxisVector, offset: usize) -> Result<Feed, Refusal> {
        let Some((feed_mm_s, feed_deg_s)) = self.feed_per_s else {
            let right = "give an F word (mm/min) in or before the first G1, G2 or G3";
            return Err(Refusal::new(offset, "a feed motion without a feed", right));
        };
        let travel = target - self.position;
        let slides_move = travel
            .iter()
            .zip(&self.rotary)
            .any(|(component, rotary)| !rotary && *component != 0.0);
        let rotary_only = !slides_move && displacement_length_mm(&travel, &self.rotary) > 0.0;
        Ok(Feed::PathMmS(if rotary_only {
            feed_deg_s
        } else {
            feed_mm_s
        }))
    }

    /// Understands the words of an arc.
    fn arc_block(
        &self,
        words: &Words,
        to: AxisVector,
        clockwise: bool,
        offset: usize,
    ) -> Result<ArcBlock, Refusal> {
        let (plane, letters, offset_letters) = self.plane;
        let mut axes = [0; 2];
        for (axis, letter) in axes.iter_mut().zip(letters) {
            let index = self
                .setup
                .axis_index(letter)
                .filter(|&index| !self.rotary.get(index).copied().unwrap_or(true));
            *axis = index.ok_or_else(|| {
                let found = format!(
                    "an arc in the plane {}{} (G{plane})",
                    letters[0], letters[1]
                );
                Refusal::new(
                    offset,
                    found,
                    format!("this machine has no slide {letter}; choose a plane it has"),
                )
            })?;
        }
        let radius = words.value('R');
        let given = words.first_of("IJK");
        if let Some(stray) = words
            .values
            .iter()
            .find(|word| "IJK".contains(word.letter) && !offset_letters.contains(&word.letter))
        {
            let right = format!(
                "arcs in G{plane} take {} and {}",
                offset_letters[0], offset_letters[1]
            );
            return Err(Refusal::new(
                stray.offset,
                format!("{} in an arc in G{plane}", stray.letter),
                right,
            ));
        }
        let circle = match (radius, given) {
            (Some(radius), Some(_)) => {
                let right = "name the circle by R or by its centre, not both";
                return Err(Refusal::new(
                    radius.offset,
                    "R together with I, J or K",
                    right,
                ));
            }
            (None, None) => {
                let right = format!(
                    "its centre by {} and {} or its radius by R",
                    offset_letters[0], offset_letters[1]
                );
                return Err(Refusal::new(offset, "an arc without a centre", right));
            }
            (Some(radius), None) if radius.value == 0.0 => {
                return Err(Refusal::new(radius.offset, "R0", "a radius is not 0"));
            }
            (Some(radius), None) => Circle::RadiusMm(radius.value * self.unit_mm()),
            (None, Some(_)) => {
                let mut centre = [0.0; 2];
                for ((component, axis), letter) in centre.iter_mut().zip(axes).zip(offset_letters) {
                    let word = words.value(letter);
                    if self.arc_absolute && word.is_none() {
                        let right = "in G90.1 both coordinates of the centre are needed";
                        return Err(Refusal::new(
                            offset,
                            format!("an arc without {letter}"),
                            right,
                        ));
                    }
                    let value_mm = word.map_or(0.0, |word| word.value) * self.unit_mm();
                    let origin = if self.arc_absolute {
                        &self.setup.work_offset
                    } else {
                        &self.position
                    };
                    *component = origin.get(axis).copied().unwrap_or(0.0) + value_mm;
                }
                Circle::Centre(centre)
            }
        };
        let turns = match words.value('P') {
            None => 1,
            Some(p) if p.value >= 1.0 && p.value <= TURNS_MAX && p.value.fract() == 0.0 => {
                p.value as u32
            }
            Some(p) => {
                let right = format!("turns are a whole number from 1 to {TURNS_MAX}");
                return Err(Refusal::new(p.offset, format!("P{}", p.value), right));
            }
        };
        let tolerance_mm = if self.inches {
            ARC_TOLERANCE_INCH_MM
        } else {
            ARC_TOLERANCE_MM
        };
        Ok(ArcBlock {
            from: self.position,
            to,
            plane: axes,
            circle,
            clockwise,
            turns,
            tolerance_mm,
        })
    }

    /// The axes that would leave their travel, and where.
    fn outside(&self, words: &Words, shapes: &[Shape], offset: usize) -> Vec<Refusal> {
        let mut refusals = Vec::new();
        for (index, axis) in self.setup.axes.iter().enumerate() {
            let mut worst: Option<f64> = None;
            for shape in shapes {
                // A machine that stands outside its travel may move back in: the start of a line is not judged.
                let (low, high) = match shape {
                    Shape::Line { to, .. } => (*to, *to),
                    other => other.bounds(),
                };
                for value in [low.get(index), high.get(index)]
                    .into_iter()
                    .flatten()
                    .copied()
                {
                    let inside = value >= axis.travel_min - TRAVEL_ROUNDING
                        && value <= axis.travel_max + TRAVEL_ROUNDING;
                    if !inside && worst.is_none() {
                        worst = Some(value);
                    }
                }
            }
            let Some(value) = worst else {
                continue;
            };
            let unit = if axis.rotary { "degrees" } else { "mm" };
            let work_offset = self.setup.work_offset.get(index).copied().unwrap_or(0.0);
            let mut found = format!("axis {} would reach {value:.4} {unit}", axis.letter);
            if work_offset != 0.0 {
                found += &format!(
                    " in machine coordinates ({:.4} in the program's)",
                    value - work_offset
                );
            }
            let right = format!(
                "the travel is {} to {} {unit}",
                axis.travel_min, axis.travel_max
            );
            let offset = words.value(axis.letter).map_or(offset, |word| word.offset);
            let mut refusal = Refusal::new(offset, found, right);
            refusal.state_stays_known = true;
            refusals.push(refusal);
        }
        refusals
    }
}
