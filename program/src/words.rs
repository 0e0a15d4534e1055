//! The words of one block, sorted by modal group; what is unknown, repeated or in conflict is refused here.

use std::ops::RangeInclusive;

use crate::codes::shown_code;
use crate::error::PROBLEMS_MAX;
use crate::letters::AXIS_LETTERS;
use crate::program::Setup;
use crate::reader::{Line, Word};
use crate::refusal::{Done, Refusal, if_none, refuse};
use crate::tools::{TOOL, is_tool};

/// Modal groups (NIST table 4; LinuxCNC manual, *G Code Modal Groups*). One code of each may be in a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum Group {
    /// G4, G10, G28, G30, G52, G53.1, G68.2, G69, G92: done once.
    Once,
    /// G53, which goes with G0 or G1.
    MachineCoordinates,
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
    SpindleMode,
    Diameter,
    Stop,
    InputOutput,
    ToolChange,
    Spindle,
    Coolant,
    Overrides,
    ModalState,
    User,
}

/// Groups of codes that say how later words are read.
pub const READ_BY: [Group; 7] = [
    Group::Plane,
    Group::Units,
    Group::Diameter,
    Group::PathControl,
    Group::Distance,
    Group::ArcDistance,
    Group::CycleReturn,
];

const GROUPS: usize = Group::User as usize + 1;

/// A to Z, then `@`, `^`, `$`.
const LETTERS: usize = 29;

/// The words of one block, each letter at most once, codes by group.
#[derive(Debug, Clone, Default)]
pub struct Words {
    codes: [Option<(u32, Word)>; GROUPS],
    values: [Word; LETTERS],
    /// Which of the values are there, by their index.
    present: u32,
}

/// The place of a letter among the values.
const fn index_of(letter: u8) -> usize {
    match letter {
        b'A'..=b'Z' => (letter - b'A') as usize,
        b'@' => 26,
        b'^' => 27,
        _ => 28,
    }
}

/// Letters as bits.
pub const fn mask_of(letters: &str) -> u32 {
    let bytes = letters.as_bytes();
    let (mut mask, mut at) = (0, 0);
    while at < bytes.len() {
        mask |= 1 << index_of(bytes[at]);
        at += 1;
    }
    mask
}

impl Words {
    /// Number of the code of a group, ten times (G91.1 is 911), and its word.
    pub fn code(&self, group: Group) -> Option<(u32, Word)> {
        self.codes.get(group as usize).copied().flatten()
    }

    /// Every code, in the order of the groups.
    pub fn codes(&self) -> impl Iterator<Item = (u32, Word)> + '_ {
        self.codes.iter().copied().flatten()
    }

    pub fn value(&self, letter: char) -> Option<Word> {
        let index = index_of(letter as u8);
        if self.present & (1 << index) == 0 {
            return None;
        }
        self.values.get(index).copied()
    }

    /// Where a word stands, or in its place the one that needs it.
    pub fn place(&self, letter: char, otherwise: usize) -> usize {
        self.value(letter).map_or(otherwise, |word| word.offset)
    }

    /// The value of a word that counts something, such as "holes are a whole number"; none without the word.
    pub fn whole(
        &self,
        letter: char,
        what: &str,
        range: RangeInclusive<f64>,
    ) -> Result<Option<u32>, Refusal> {
        match self.value(letter) {
            Some(word) if range.contains(&word.value) && word.value.fract() == 0.0 => {
                Ok(Some(word.value as u32))
            }
            Some(word) => word.refuse(format!("{what} from {} to {}", range.start(), range.end())),
            None => Ok(None),
        }
    }

    /// The first word of any of these letters.
    pub fn first_of(&self, letters: &str) -> Option<Word> {
        self.first_in(mask_of(letters))
    }

    /// The first word of letters given as bits.
    pub fn first_in(&self, mask: u32) -> Option<Word> {
        let mut present = self.present & mask;
        let mut first: Option<Word> = None;
        while present != 0 {
            let word = self
                .values
                .get(present.trailing_zeros() as usize)
                .copied()?;
            if first.is_none_or(|first| word.offset < first.offset) {
                first = Some(word);
            }
            present &= present - 1;
        }
        first
    }

    /// Takes a value away: somebody has made use of it.
    pub fn remove(&mut self, letters: &str) {
        self.present &= !mask_of(letters);
    }

    /// Puts a value in, in place of the one that is there.
    pub fn insert(&mut self, word: Word) {
        let index = index_of(word.letter as u8);
        if let Some(slot) = self.values.get_mut(index) {
            *slot = word;
            self.present |= 1 << index;
        }
    }

    fn clear(&mut self) {
        self.codes = [None; GROUPS];
        self.present = 0;
    }

    /// Puts the words into groups; refuses what is unknown, repeated or in conflict.
    pub fn sort(&mut self, block: &Line, setup: &Setup) -> Done {
        self.clear();
        let mut refusals = Vec::new();
        for (index, &word) in block.words.iter().enumerate() {
            refusals.extend(self.sort_word(index, word, setup).err());
            if refusals.len() > PROBLEMS_MAX {
                break;
            }
        }
        if let Some(word) = self.negative_d() {
            let refused: Result<(), Refusal> =
                word.refuse("a tool, a diameter or a speed: 0 or more");
            refusals.extend(refused.err());
        }
        let stray = self.stray_axis(setup);
        refusals.extend(stray.and_then(|word| no_axis(word, setup).err()));
        if_none(refusals)
    }

    /// A D below 0, but for that of G41.1 and G42.1: a cutter on the other side.
    fn negative_d(&self) -> Option<Word> {
        let by_diameter = matches!(self.code(Group::CutterCompensation), Some((411 | 421, _)));
        self.value('D').filter(|d| d.value < 0.0 && !by_diameter)
    }

    /// U or W on a machine without such an axis, but for G71 and G72, where they shift the profile.
    fn stray_axis(&self, setup: &Setup) -> Option<Word> {
        let in_profile = matches!(self.code(Group::Motion), Some((710..=722, _)));
        let mut words = ['U', 'W']
            .into_iter()
            .filter_map(|letter| self.value(letter));
        words.find(|word| !in_profile && setup.axis_index(word.letter).is_none())
    }

    /// Puts a G or M word into its modal group.
    fn sort_code(&mut self, word: Word) -> Result<(), Refusal> {
        let letter = word.letter;
        let number = code_number(word.value);
        let group = number.and_then(|number| group_of(letter, number));
        let (Some(group), Some(number)) = (group, number) else {
            let right = number
                .and_then(|number| why_not(letter, number))
                .unwrap_or("no such code is known: see the table of words in the manual");
            return word.refuse(right);
        };
        if let Some((other, of_other)) = self.code(group) {
            // G80 beside another motion: that motion ends the cycles by itself (NIST §3.5.16).
            if group == Group::Motion && (number == 800 || other == 800) {
                if other == 800 {
                    self.set_code(group, number, word);
                }
                return Ok(());
            }
            let other = shown_code(other);
            let found = format!("{}{other} and {word} in one block", of_other.letter);
            let right = "these exclude each other: one of them, once, in a block";
            return refuse(word.offset, found, right);
        }
        self.set_code(group, number, word);
        Ok(())
    }

    fn set_code(&mut self, group: Group, number: u32, word: Word) {
        if let Some(slot) = self.codes.get_mut(group as usize) {
            *slot = Some((number, word));
        }
    }

    fn sort_word(&mut self, index: usize, word: Word, setup: &Setup) -> Result<(), Refusal> {
        let Word {
            letter,
            value,
            offset,
        } = word;
        match letter {
            'G' | 'M' => return self.sort_code(word),
            'N' => return check_line_number(index, word),
            'F' if value < 0.0 => return word.refuse("a feed is 0 (none) or more"),
            'S' if value < 0.0 => return word.refuse("a spindle speed is 0 or more"),
            'T' | 'H' if !is_tool(value) => return word.refuse(TOOL),
            axis if AXIS_LETTERS.contains(axis)
                && !"UW".contains(axis)
                && setup.axis_index(axis).is_none() =>
            {
                return no_axis(word, setup);
            }
            'O' => {
                let right = "an O-word stands alone in its block";
                return refuse(offset, "O behind other words", right);
            }
            _ => {}
        }
        if self.value(letter).is_some() {
            let found = format!("{letter} twice in one block");
            return refuse(offset, found, "each of these letters once in a block");
        }
        self.insert(word);
        Ok(())
    }
}

fn no_axis(word: Word, setup: &Setup) -> Result<(), Refusal> {
    let letters = setup.axes.iter().map(|axis| axis.letter.to_string());
    let has: Vec<String> = letters.collect();
    word.refuse(format!("this machine has the axes {}", has.join(" ")))
}

/// N may be there, in its place; nothing uses it.
fn check_line_number(index: usize, word: Word) -> Result<(), Refusal> {
    if index != 0 {
        let right = "a line number is the first word of its block";
        return refuse(word.offset, "N after other words", right);
    }
    if word.value < 0.0 {
        return word.refuse("a line number is 0 or more");
    }
    Ok(())
}

/// Ten times a code's number, if it has no more than one decimal.
fn code_number(value: f64) -> Option<u32> {
    let tenfold = (value * 10.0).round();
    let exact = (value * 10.0 - tenfold).abs() < 1e-6 && (0.0..10_000.0).contains(&tenfold);
    exact.then_some(tenfold as u32)
}

/// Modal group of a supported code, given ten times its number.
pub fn group_of(letter: char, number: u32) -> Option<Group> {
    Some(match (letter, number) {
        ('G', 40 | 100 | 280 | 281 | 300 | 301 | 520 | 531 | 682 | 690 | 920..=923) => Group::Once,
        ('G', 530) => Group::MachineCoordinates,
        ('G', 0 | 10 | 20 | 30 | 50..=53 | 330 | 331 | 382..=385 | 730 | 740 | 760) => {
            Group::Motion
        }
        ('G', 800..=890) if number.is_multiple_of(10) => Group::Motion,
        ('G', 700 | 710..=712 | 720..=722) => Group::Motion,
        ('G', 170 | 180 | 190) => Group::Plane,
        ('G', 900 | 910) => Group::Distance,
        ('G', 901 | 911) => Group::ArcDistance,
        ('G', 930 | 940 | 950) => Group::FeedMode,
        ('G', 200 | 210) => Group::Units,
        ('G', 400 | 410 | 411 | 420 | 421) => Group::CutterCompensation,
        ('G', 430 | 431 | 432 | 434 | 490) => Group::ToolLength,
        ('G', 540 | 550 | 560 | 570 | 580 | 590..=593) => Group::WorkOffset,
        ('G', 610 | 611 | 640) => Group::PathControl,
        ('G', 980 | 990) => Group::CycleReturn,
        ('G', 960 | 970) => Group::SpindleMode,
        ('G', 70 | 80) => Group::Diameter,
        ('M', 0 | 10 | 20 | 300 | 600 | 980 | 990) => Group::Stop,
        ('M', 620..=680) if number.is_multiple_of(10) => Group::InputOutput,
        ('M', 60 | 610) => Group::ToolChange,
        ('M', 30 | 40 | 50 | 190) => Group::Spindle,
        ('M', 70 | 80 | 90) => Group::Coolant,
        ('M', 480..=530) if number.is_multiple_of(10) => Group::Overrides,
        ('M', 700..=730) if number.is_multiple_of(10) => Group::ModalState,
        ('M', 1000..=1990) if number.is_multiple_of(10) => Group::User,
        _ => return None,
    })
}

/// The words of modes that a program can begin with; none for each other word.
pub fn mode_words(modes: &str) -> impl Iterator<Item = Option<(char, f64)>> {
    modes.split_whitespace().map(|word| {
        let letter = word.chars().next()?;
        let value: f64 = word.get(letter.len_utf8()..)?.parse().ok()?;
        let code = (value * 10.0).round() as u32;
        let known = match letter {
            'F' | 'S' | 'P' | 'Q' => true,
            'M' => matches!(code, 30 | 40 | 70 | 80),
            'G' => match group_of('G', code) {
                Some(Group::Motion) => matches!(code, 0 | 10 | 20 | 30 | 800),
                Some(Group::CutterCompensation) => code == 400,
                Some(Group::SpindleMode) => code == 970,
                Some(Group::FeedMode | Group::WorkOffset) => true,
                Some(group) => READ_BY.contains(&group),
                None => false,
            },
            _ => false,
        };
        (known && (0.0..1e9).contains(&value)).then_some((letter, value))
    })
}

/// The first word that is no mode.
pub fn unknown_mode(modes: &str) -> Option<&str> {
    let mut words = modes.split_whitespace().zip(mode_words(modes));
    words.find_map(|(word, known)| known.is_none().then_some(word))
}

/// Why a code that machinists know is refused, and what to do instead.
fn why_not(letter: char, number: u32) -> Option<&'static str> {
    Some(match (letter, number) {
        ('G', 171 | 181 | 191) => "the planes UV, WU and VW are not supported: use G17, G18 or G19",
        ('G', 150 | 160) => "polar coordinates are written with @ and ^, as in LinuxCNC",
        ('G', 500 | 510) => "scaling is not supported: write the scaled values, or use parameters",
        ('G', 680) => "rotation is set with G10 L2 P1 R30, as in LinuxCNC",
        _ => return None,
    })
}
