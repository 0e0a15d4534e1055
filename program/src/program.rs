//! What goes into the interpreter and what comes out.

use control::path::{AxisVector, MAX_AXES, Path};
use xxhash_rust::xxh3::Xxh3;

use crate::error::ProgramError;
use crate::letters::AXIS_LETTERS;

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
}

/// The machine as the interpreter needs to know it.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// The axes, in the order of the components of an [`AxisVector`]; at most [`MAX_AXES`].
    pub axes: Vec<AxisSetup>,
    /// Where the zero of the program (G54) lies in machine coordinates.
    pub work_offset: AxisVector,
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

/// What can happen between two elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EventKind {
    /// S: the spindle's speed in rev/min.
    SpindleSpeedRpm(f64),
    /// M3.
    SpindleClockwise,
    /// M4.
    SpindleCounterClockwise,
    /// M5.
    SpindleStop,
}

/// How a program ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProgramEnd {
    /// By M2 on this line.
    M2(u32),
    /// By M30 on this line.
    M30(u32),
    /// By the closing `%` on this line.
    Percent(u32),
    /// With the file, by no word of its own.
    FileEnd,
}

/// Something accepted that its author should know of.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// Line in the file, counted from 1.
    pub line: u32,
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
    /// Spindle words, in order.
    pub events: Vec<Event>,
    /// What was accepted with a remark; one per kind, for its first line.
    pub notes: Vec<Note>,
    /// How it ends.
    pub end: ProgramEnd,
    /// Straight feeds: blocks of G1, and the ways down of drilling cycles.
    pub straight_feeds: u32,
    /// Blocks that made an arc feed (G2, G3).
    pub arc_feeds: u32,
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
    /// Index of the axis of a letter.
    pub fn axis_index(&self, letter: char) -> Option<usize> {
        self.axes.iter().position(|axis| axis.letter == letter)
    }
}

/// Refuses a machine no program can run on; machine files are checked long before.
pub fn check_setup(name: &str, setup: &Setup, start: &AxisVector) -> Result<(), ProgramError> {
    let finite = |vector: &AxisVector| vector.iter().all(|component| component.is_finite());
    let refuse = |found: String, right: &str| Err(ProgramError::of_file(name, found, right));
    if setup.axes.is_empty() || setup.axes.len() > MAX_AXES {
        return refuse(
            format!("machine with {} axes", setup.axes.len()),
            "1 to 8 axes",
        );
    }
    for (index, axis) in setup.axes.iter().enumerate() {
        let taken = setup
            .axes
            .iter()
            .take(index)
            .any(|other| other.letter == axis.letter);
        if taken || !AXIS_LETTERS.contains(axis.letter) {
            return refuse(
                format!("axis letter {}", axis.letter),
                "each of X Y Z A B C U V W at most once",
            );
        }
    }
    if !finite(start) || !finite(&setup.work_offset) {
        return refuse(
            "start position or work offset that is not a number".into(),
            "finite positions",
        );
    }
    Ok(())
}

pub fn source_hash(text: &str, setup: &Setup, start: &AxisVector) -> u64 {
    let mut hash = Xxh3::new();
    hash.update(&(text.len() as u64).to_le_bytes());
    hash.update(text.as_bytes());
    for axis in &setup.axes {
        hash.update(&u32::from(axis.letter).to_le_bytes());
        hash.update(&axis.travel_min.to_bits().to_le_bytes());
        hash.update(&axis.travel_max.to_bits().to_le_bytes());
        hash.update(&[u8::from(axis.rotary)]);
    }
    for component in setup.work_offset.iter().chain(start.iter()) {
        hash.update(&component.to_bits().to_le_bytes());
    }
    hash.digest()
}
