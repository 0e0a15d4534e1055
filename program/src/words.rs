//! The words of one block, sorted by modal group; what is unknown, repeated or in conflict is refused here.

use crate::error::PROBLEMS_MAX;
use crate::letters::AXIS_LETTERS;
use crate::program::Setup;
use crate::reader::{Line, Word};

const SUPPORTED_G: &str = "supported are G0 G1 G2 G3 G4 G17 G18 G19 G20 G21 G40 G49 G54 G61 G64 G80 G81 G82 G83 G90 G90.1 G91 G91.1 G94 G98 G99";
const SUPPORTED_M: &str = "supported are M2 M3 M4 M5 M30";

/// One reason to refuse a block.
pub struct Refusal {
    pub offset: usize,
    pub found: String,
    pub right: String,
    /// Position and modes behind the block are known all the same: later blocks can be judged by them.
    pub state_stays_known: bool,
}

impl Refusal {
    pub fn new(offset: usize, found: impl Into<String>, right: impl Into<String>) -> Self {
        Self {
            offset,
            found: found.into(),
            right: right.into(),
            state_stays_known: false,
        }
    }
}

/// Modal groups (NIST table 4); group 0 is not modal. G40, G49, G54, G94 are the only members of their groups here and
/// G61/G64 behave alike, so these keep no state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    Dwell,
    Motion,
    Plane,
    Distance,
    ArcDistance,
    FeedMode,
    Units,
    CutterCompensation,
    ToolLength,
    WorkOffset,
    PathControl,
    CycleReturn,
    Stop,
    Spindle,
}

/// The words of one block, each letter at most once, codes by group.
#[derive(Default)]
pub struct Words {
    pub codes: Vec<(Group, u32, Word)>,
    pub values: Vec<Word>,
}

impl Words {
    /// Number of the code of a group, ten times (G91.1 is 911), and its word.
    pub fn code(&self, group: Group) -> Option<(u32, Word)> {
        self.codes
            .iter()
            .find(|code| code.0 == group)
            .map(|&(_, number, word)| (number, word))
    }

    pub fn value(&self, letter: char) -> Option<Word> {
        self.values
            .iter()
            .find(|word| word.letter == letter)
            .copied()
    }

    /// The first word of any of these letters.
    pub fn first_of(&self, letters: &str) -> Option<Word> {
        self.values
            .iter()
            .find(|word| letters.contains(word.letter))
            .copied()
    }
}

impl Words {
    /// Puts the words into groups; refuses what is unknown, repeated or in conflict.
    pub fn sort(block: &Line, setup: &Setup) -> Result<Words, Vec<Refusal>> {
        let mut words = Words::default();
        let mut refusals = Vec::new();
        for (index, &word) in block.words.iter().enumerate() {
            match words.sort_word(index, word, setup) {
                Ok(()) => {}
                Err(refusal) => refusals.push(refusal),
            }
            if refusals.len() > PROBLEMS_MAX {
                break;
            }
        }
        if refusals.is_empty() {
            Ok(words)
        } else {
            Err(refusals)
        }
    }

    /// Puts a G or M word into its modal group.
    fn sort_code(&mut self, word: Word) -> Result<(), Refusal> {
        let Word { letter, value, .. } = word;
        let refuse = |found: String, right: &str| Err(Refusal::new(word.offset, found, right));
        let group = code_number(value).and_then(|number| Some((group_of(letter, number)?, number)));
        let Some((group, number)) = group else {
            let right = if letter == 'G' {
                SUPPORTED_G
            } else {
                SUPPORTED_M
            };
            return refuse(format!("{letter}{value}"), right);
        };
        if let Some((other, _)) = self.code(group) {
            let found = format!(
                "{letter}{} and {letter}{value} in one block",
                shown_code(other)
            );
            let right = "these exclude each other: one of them, once, in a block";
            return refuse(found, right);
        }
        self.codes.push((group, number, word));
        Ok(())
    }

    fn sort_word(&mut self, index: usize, word: Word, setup: &Setup) -> Result<(), Refusal> {
        let Word {
            letter,
            value,
            offset,
            ..
        } = word;
        let refuse = |found: String, right: &str| Err(Refusal::new(offset, found, right));
        match letter {
            'G' | 'M' => return self.sort_code(word),
            'N' => return check_line_number(index, word),
            'F' if value < 0.0 => return refuse(format!("F{value}"), "a feed is 0 (none) or more"),
            'S' if value < 0.0 => {
                return refuse(format!("S{value}"), "a spindle speed is 0 or more");
            }
            'F' | 'S' | 'I' | 'J' | 'K' | 'L' | 'R' | 'P' | 'Q' => {}
            axis if AXIS_LETTERS.contains(axis) => {
                if setup.axis_index(axis).is_none() {
                    let has: Vec<String> = setup
                        .axes
                        .iter()
                        .map(|axis| axis.letter.to_string())
                        .collect();
                    return refuse(
                        format!("{axis}{value}"),
                        &format!("this machine has the axes {}", has.join(" ")),
                    );
                }
            }
            'T' => {
                return refuse(
                    format!("T{value}"),
                    "tool changes are not supported; one tool per program",
                );
            }
            _ => {
                let right = "supported are G M N F S P Q I J K L R and the letters of the axes";
                return refuse(format!("{letter}{value}"), right);
            }
        }
        if self.value(letter).is_some() {
            return refuse(
                format!("{letter} twice in one block"),
                "each of these letters once in a block",
            );
        }
        self.values.push(word);
        Ok(())
    }
}

/// N may be there, in its place; nothing uses it.
fn check_line_number(index: usize, word: Word) -> Result<(), Refusal> {
    let value = word.value;
    if index != 0 {
        let right = "a line number is the first word of its block";
        return Err(Refusal::new(word.offset, "N after other words", right));
    }
    if value < 0.0 || value.fract() != 0.0 {
        let right = "a line number is a whole number from 0";
        return Err(Refusal::new(word.offset, format!("N{value}"), right));
    }
    Ok(())
}

/// Ten times a code's number, if it has no more than one decimal.
fn code_number(value: f64) -> Option<u32> {
    let tenfold = (value * 10.0).round();
    let exact = (value * 10.0 - tenfold).abs() < 1e-6 && (0.0..10_000.0).contains(&tenfold);
    exact.then_some(tenfold as u32)
}

fn shown_code(number: u32) -> String {
    if number.is_multiple_of(10) {
        (number / 10).to_string()
    } else {
        format!("{}.{}", number / 10, number % 10)
    }
}

/// Modal group of a supported code, given ten times its number.
fn group_of(letter: char, number: u32) -> Option<Group> {
    Some(match (letter, number) {
        ('G', 40) => Group::Dwell,
        ('G', 0 | 10 | 20 | 30 | 800 | 810 | 820 | 830) => Group::Motion,
        ('G', 170 | 180 | 190) => Group::Plane,
        ('G', 900 | 910) => Group::Distance,
        ('G', 901 | 911) => Group::ArcDistance,
        ('G', 940) => Group::FeedMode,
        ('G', 200 | 210) => Group::Units,
        ('G', 400) => Group::CutterCompensation,
        ('G', 490) => Group::ToolLength,
        ('G', 540) => Group::WorkOffset,
        ('G', 610 | 640) => Group::PathControl,
        ('G', 980 | 990) => Group::CycleReturn,
        ('M', 20 | 300) => Group::Stop,
        ('M', 30 | 40 | 50) => Group::Spindle,
        _ => return None,
    })
}
