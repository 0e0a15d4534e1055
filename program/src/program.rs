//! What goes into the interpreter and what comes out.

use std::sync::Arc;

use bus::sample::AskedInput;
use machine::{Beginning, Dialect, KeptParameters, Tool};
use path::geometry::{AxisVector, Element, Path};
use path::tool_centre::ToolCentre;
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

use crate::parameters::Parameters;
use crate::question::Answer;
use crate::surface::SurfaceSpeed;
use crate::text::TextHash;

/// The most blocks of one program that is interpreted as a whole; their geometry fits the memory of a small PC (about 1 GB).
pub const BLOCKS_MAX: usize = 2_000_000;

/// One axis as the interpreter needs to know it.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisSetup {
    /// Its letter in programs, one of X Y Z A B C U V W.
    pub letter: char,
    /// Lowest position allowed, machine coordinates, in mm or degrees.
    pub travel_min: f64,
    /// Highest position allowed, machine coordinates, in mm or degrees.
    pub travel_max: f64,
    /// Whether it turns (degrees) instead of sliding (mm).
    pub rotary: bool,
    /// Whether it turns without end: an absolute word is a place within a turn, and it gets there on the shorter way.
    pub modulo: bool,
}

/// The machine as the interpreter needs to know it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Setup {
    /// The axes, in the order of the components of an [`AxisVector`]; at most [`PATH_AXES`](path::geometry::PATH_AXES).
    pub axes: Vec<AxisSetup>,
    /// Where the zero of the program (G54) lies in machine coordinates.
    pub work_offset: AxisVector,
    /// Parameters that programs before this one have kept; the work offset of G54 among them goes before [`Setup::work_offset`].
    pub parameters: KeptParameters,
    /// The tool in the spindle, the offset that is applied and the modes in force.
    pub beginning: Beginning,
    /// The tools that there are; without any, every tool can be called, and none has a length.
    pub tools: Vec<Tool>,
    /// Whether blocks with `/` before them are left out (block delete).
    pub block_delete: bool,
    /// The language of the program, unless its text says that itself.
    pub dialect: Dialect,
    /// In Fanuc's language, a word without a decimal point counts least input increments: X10 is 0.010 mm.
    pub standard_decimal_point: bool,
    /// What a machine would answer is assumed, for comparing and showing programs: a probe trips at the end of its motion, an input
    /// is 0.
    pub answers_assumed: bool,
    /// There is a probe: G38.2 to G38.5 are read.
    pub probe: bool,
    /// User M-codes, M100 to M199, are switched on.
    pub user_codes: bool,
    /// Those that the machine itself does.
    pub machine_codes: Vec<u32>,
    /// How rotary axes turn tool and work, for G43.4; none where the machine does not say.
    pub tool_centre: Option<Arc<ToolCentre>>,
    /// How far the path may leave the programmed one in G64 without P, in mm; above 0 programs begin in G64, else in G61.
    pub tolerance_mm: f64,
    /// Highest speed of the spindle, in rev/min: what is fed per turn in G96 goes no faster.
    pub spindle_max_rpm: Option<f64>,
    /// What the machine has answered so far to what the program asks, in order.
    pub answers: Vec<Answer>,
    /// What it will answer is assumed, with a note: for checking and showing a program that has not run yet.
    pub rehearsed: bool,
}

/// The text of one block, for showing it while it runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Block {
    /// Line in the file, counted from 1.
    pub line: u32,
    /// The line without surrounding spaces.
    pub text: String,
}

/// Something that happens between two elements.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Line in the file, counted from 1.
    pub line: u32,
    /// It happens before the element of this index; the number of elements means at the end.
    pub before_element: usize,
    /// What happens.
    pub kind: EventKind,
}

/// What can happen between two elements. Numbers of outputs count from 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum EventKind {
    /// S: the spindle's speed in rev/min.
    SpindleSpeedRpm(f64),
    /// G96, and S in it: the speed follows the radius.
    SurfaceSpeed(SurfaceSpeed),
    /// M3.
    SpindleClockwise,
    /// M4.
    SpindleCounterClockwise,
    /// M5.
    SpindleStop,
    /// M19: the spindle turns to this angle, in degrees, and holds it.
    SpindleOrient(f64),
    /// G33, G33.1, G76: the motion behind it follows the spindle, so many mm along the path for each turn.
    SpindleFollowed(f64),
    /// The motion behind it does not.
    SpindleReleased,
    /// G33.1, G74, G84: a tap, with so many mm along the path for each turn. Into the hole and out of it, a spindle with encoder keeps
    /// step with the axis.
    SpindleCoupled(f64),
    /// The tap is out of the hole.
    SpindleUncoupled,
    /// M7 on, M9 off.
    Mist(bool),
    /// M8 on, M9 off.
    Flood(bool),
    /// T: the next tool, by its number.
    ToolPrepare(u32),
    /// M6: this tool comes into the spindle.
    ToolChange(u32),
    /// M61: this tool is in the spindle already.
    ToolIs(u32),
    /// G43, G49: the offset that is applied is that of this tool; 0 where it is none's.
    ToolOffsetOf(u32),
    /// Behind it: the offset along an axis, in mm or degrees.
    ToolOffset {
        /// Index of the axis.
        axis: u32,
        /// The offset.
        value: f64,
    },
    /// M0: waits for the operator.
    ProgramStop,
    /// M1: the same, if he asked for it.
    OptionalStop,
    /// M60: a pallet is changed, then he is waited for.
    PalletStop,
    /// G38.2 to G38.5: the motion behind it ends where contact is made, or lost.
    Probe {
        /// Lost (G38.4, G38.5).
        away: bool,
        /// The program stops where that does not happen (G38.2, G38.4).
        must: bool,
    },
    /// Behind such a motion.
    ProbeEnd,
    /// M66: an input is read, after a wait.
    AwaitInput {
        /// Which, and what is waited for.
        #[serde(with = "crate::snapshot::asked_input")]
        asked: AskedInput,
        /// Longest wait, in s.
        timeout_s: f64,
    },
    /// M100 to M199: the program of the machine builder for this code runs, with these two values.
    UserCode {
        /// 100 to 199.
        code: u32,
        /// P; −1 without it.
        p: f64,
        /// Q; −1 without it.
        q: f64,
    },
    /// M48, M49, M50: whether the override of the feed counts.
    OverridesEnabled(bool),
    /// M62 to M65.
    DigitalOutput {
        /// Which.
        index: u32,
        /// Its level.
        on: bool,
        /// With the motion that follows (M62, M63) rather than at once.
        synchronised: bool,
    },
    /// M67, M68.
    AnalogOutput {
        /// Which.
        index: u32,
        /// Its value.
        value: f64,
        /// With the motion that follows (M67) rather than at once.
        synchronised: bool,
    },
}

impl EventKind {
    /// The spindle turns: 1 clockwise, −1 counter-clockwise, 0 not at all.
    pub(crate) fn of_spindle(direction: i32) -> Self {
        match direction {
            0 => EventKind::SpindleStop,
            1 => EventKind::SpindleClockwise,
            _ => EventKind::SpindleCounterClockwise,
        }
    }
}

/// A comment that says something.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Line in the file, counted from 1.
    pub line: u32,
    /// It is said before the element of this index.
    pub before_element: usize,
    /// And before the event of this index among those that are in its piece (of a whole program: among all).
    pub before_event: u64,
    /// For the log only (LOG), rather than for the operator (MSG, DEBUG, PRINT).
    pub log_only: bool,
    /// The text, parameters replaced by their values.
    pub text: String,
}

/// What some blocks made. Elements are counted from the first of the program.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Piece {
    /// Path, in order.
    pub elements: Vec<Element>,
    /// What happens along it, in order.
    pub events: Vec<Event>,
    /// Comments that say something, in order.
    pub messages: Vec<Message>,
}

/// How a program ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum ProgramEnd {
    /// By M2 on this line.
    M2(u32),
    /// By M30 on this line.
    M30(u32),
    /// By M99 outside a subroutine, on this line.
    M99(u32),
    /// By the closing `%` on this line.
    Percent(u32),
    /// Given up by (ABORT, …) on this line, whose text is the last message.
    Abort(u32),
    /// With the file, by no word of its own.
    #[default]
    FileEnd,
}

impl ProgramEnd {
    /// Its line; 0 of none.
    pub fn line(&self) -> u32 {
        match *self {
            Self::M2(line)
            | Self::M30(line)
            | Self::M99(line)
            | Self::Percent(line)
            | Self::Abort(line) => line,
            Self::FileEnd => 0,
        }
    }
}

/// Something accepted that its author should know of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Note {
    /// The first line that it concerns, counted from 1.
    pub line: u32,
    /// How often it was met.
    pub count: u32,
    /// What was done with it.
    pub text: String,
}

/// A program, interpreted to its end.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    /// Its name as given.
    pub name: String,
    /// Its whole geometry, in machine coordinates.
    pub path: Path,
    /// Hash (XXH3) of everything the geometry depends on: text, axes, work offset, start. Names it in path tags.
    pub source_hash: u64,
    /// Where the tool is at its start, in the coordinates of programs.
    pub start: AxisVector,
    /// The blocks that hold words, in order.
    pub blocks: Vec<Block>,
    /// Spindle, coolant, tools, stops and outputs, in order.
    pub events: Vec<Event>,
    /// Comments that say something, in order.
    pub messages: Vec<Message>,
    /// The parameters at its end.
    pub parameters: Parameters,
    /// What was accepted with a remark; one per kind, for its first line.
    pub notes: Vec<Note>,
    /// How it ends.
    pub end: ProgramEnd,
    /// Straight feeds: blocks of G1, and the ways down of drilling cycles.
    pub straight_feeds: u32,
    /// Blocks that made an arc feed (G2, G3).
    pub arc_feeds: u32,
}

impl Note {
    /// As people read it.
    pub fn shown(&self) -> String {
        match self.count {
            1 => format!("line {}: {}", self.line, self.text),
            count => format!("line {}, {count} times: {}", self.line, self.text),
        }
    }
}

impl Program {
    /// The text of the block on a line, if that line holds one.
    pub fn block_text(&self, line: u32) -> Option<&str> {
        let index = self
            .blocks
            .binary_search_by_key(&line, |block| block.line)
            .ok()?;
        self.blocks.get(index).map(|block| block.text.as_str())
    }
}

impl Setup {
    /// Highest speed of the spindle, in rev/min; without limit where none is known.
    pub fn spindle_max_rpm(&self) -> f64 {
        self.spindle_max_rpm.unwrap_or(f64::INFINITY)
    }

    /// Index of the axis of a letter.
    pub fn axis_index(&self, letter: char) -> Option<usize> {
        self.axes.iter().position(|axis| axis.letter == letter)
    }
}

/// The setup for a text that says itself in which dialect it is written.
pub fn in_dialect(setup: &Arc<Setup>, dialect: Option<Dialect>) -> Arc<Setup> {
    match dialect.filter(|dialect| *dialect != setup.dialect) {
        None => Arc::clone(setup),
        Some(dialect) => Arc::new(Setup {
            dialect,
            ..Setup::clone(setup)
        }),
    }
}

/// Names a program on a machine: its text, by length and hash, and everything else that its geometry depends on.
pub fn source_hash(text: TextHash, setup: &Setup, start: &AxisVector) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(&text.bytes.to_le_bytes());
    hash.update(&text.xxh3.to_le_bytes());
    for axis in &setup.axes {
        hash.update(&u32::from(axis.letter).to_le_bytes());
        hash.update(&axis.travel_min.to_bits().to_le_bytes());
        hash.update(&axis.travel_max.to_bits().to_le_bytes());
        hash.update(&[u8::from(axis.rotary) | u8::from(axis.modulo) << 1]);
    }
    // Of eight axes at least: so a program keeps the name that it had before there were nine, and with it what was learned of it.
    let places = setup.axes.len().max(8);
    let components = setup.work_offset.iter().take(places);
    for component in components.chain(start.iter().take(places)) {
        hash.update(&component.to_bits().to_le_bytes());
    }
    for tool in &setup.tools {
        hash.update(&tool.number.to_le_bytes());
        hash.update(&tool.pocket.to_le_bytes());
        hash.update(&tool.orientation.to_le_bytes());
        let angles = [tool.front_angle_deg, tool.back_angle_deg];
        for value in tool.offset.iter().chain([&tool.diameter]).chain(&angles) {
            hash.update(&value.to_bits().to_le_bytes());
        }
    }
    for (number, value) in &setup.parameters {
        hash.update(&number.to_le_bytes());
        hash.update(&value.to_bits().to_le_bytes());
    }
    hash.update(setup.beginning.text().as_bytes());
    if setup.tolerance_mm > 0.0 {
        hash.update(&setup.tolerance_mm.to_bits().to_le_bytes());
    }
    if setup.block_delete {
        hash.update(b"/");
    }
    if let Some(tool_centre) = &setup.tool_centre {
        for number in tool_centre.numbers() {
            hash.update(&number.to_bits().to_le_bytes());
        }
    }
    if setup.dialect == Dialect::Fanuc {
        hash.update(b"fanuc");
        hash.update(&[u8::from(setup.standard_decimal_point)]);
    }
    hash.digest()
}
