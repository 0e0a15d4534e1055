//! The words of a block while they are translated, and what is handed back beside them.

use serde::{Deserialize, Serialize};

use crate::meaning::State;
use crate::reader::Word;
use crate::words::mask_of;

/// What of Fanuc's modes LinuxCNC has no words for.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Modes {
    /// G16: X is a distance from the zero, Y an angle.
    pub polar: bool,
    /// D, which stays in force for the next G41 or G42.
    pub cutter: Option<f64>,
    /// G50 S on a lathe: highest speed of the spindle in G96, in rev/min.
    pub spindle_max_rpm: Option<f64>,
}

/// What a block asks for that LinuxCNC has no words for.
#[derive(Debug, Clone, Default)]
pub struct Beside {
    /// What is accepted with a remark.
    pub notes: Vec<&'static str>,
    /// G68: centre, each coordinate in the unit of the program, angle in degrees, and whether both count from those in force.
    pub turn: Option<([Option<f64>; 2], f64, bool)>,
    /// G69.
    pub turns_back: bool,
    /// G54.1: the number of the offset, from 1.
    pub more_work: Option<u32>,
    /// G10 L20: the number of the offset of G54.1 that is set, from 1, and the words of the axes.
    pub sets_more_work: Option<(u32, Vec<Word>)>,
    /// G10 L10 and L12: the number of a variable and its value.
    pub sets: Option<(u32, f64)>,
    /// G31: the motion mode stays as it was.
    pub motion_stays: bool,
    /// The motion mode behind the block: G0 or G1 beside G28 or G30, ten times the number.
    pub motion_behind: Option<u32>,
    /// L0 or K0: the words of the cycle are kept, and no hole is drilled.
    pub only_keeps: bool,
}

/// Ten times the number of a code; none of one with more decimals.
pub fn code_of(word: &Word) -> Option<u32> {
    let tenfold = (word.value * 10.0).round();
    let exact = (word.value * 10.0 - tenfold).abs() < 1e-6 && (0.0..10_000.0).contains(&tenfold);
    exact.then_some(tenfold as u32)
}

pub fn word(letter: char, value: f64, offset: usize) -> Word {
    Word {
        letter,
        value,
        offset,
    }
}

/// The words of a block while they are translated.
pub struct Block<'a> {
    pub words: &'a mut Vec<Word>,
    /// Letters whose numbers have a decimal point, as bits.
    pub pointed: u32,
}

impl Block<'_> {
    pub fn has(&self, letter: char, of: impl Fn(u32) -> bool) -> bool {
        self.code(letter, of).is_some()
    }

    /// The first code of a letter for which this holds.
    pub fn code(&self, letter: char, of: impl Fn(u32) -> bool) -> Option<(u32, Word)> {
        let mut codes = self.words.iter().filter(|word| word.letter == letter);
        codes.find_map(|word| {
            code_of(word)
                .filter(|code| of(*code))
                .map(|code| (code, *word))
        })
    }

    pub fn value(&self, letter: char) -> Option<Word> {
        self.words
            .iter()
            .find(|word| word.letter == letter)
            .copied()
    }

    pub fn take(&mut self, letter: char) -> Option<Word> {
        let at = self.words.iter().position(|word| word.letter == letter)?;
        Some(self.words.remove(at))
    }

    /// Takes a code away.
    pub fn drop_code(&mut self, letter: char, code: u32) {
        self.words
            .retain(|word| word.letter != letter || code_of(word) != Some(code));
    }

    /// The number that is in force in the block, of two that a mode has.
    pub fn in_block(&self, yes: u32, no: u32, before: bool) -> bool {
        match self.code('G', |code| code == yes || code == no) {
            Some((code, _)) => code == yes,
            None => before,
        }
    }

    /// Whether G91 is in force in the block.
    pub fn is_incremental(&self, state: &State) -> bool {
        self.in_block(910, 900, state.in_force().incremental)
    }

    /// Whether G17 is in force in the block.
    pub fn is_in_xy(&self, state: &State) -> bool {
        match self.code('G', |code| matches!(code, 170 | 180 | 190)) {
            Some((code, _)) => code == 170,
            None => state.in_force().plane.0 == 17,
        }
    }

    pub fn is_pointed(&self, letter: char) -> bool {
        self.pointed & mask_of(letter.encode_utf8(&mut [0; 4])) != 0
    }
}
