//! Blocks of straight motion, of which most programs are made: axis words, F, G0 or G1, all with plain numbers. They are read without
//! the detour over words; whatever else a line holds is left to the reader of all lines.

use crate::letters::AXIS_LETTERS;
use crate::number::number;
use crate::program::Setup;
use crate::reader::Word;
use crate::words::mask_of;

/// The letters of such a block, beside G and N.
const LETTERS: u32 = mask_of(AXIS_LETTERS) | FEED;
/// F, as a bit.
pub const FEED: u32 = mask_of("F");

/// What a position may exceed the travel by and count as rounding: 1 nm.
pub const TRAVEL_ROUNDING: f64 = 1e-6;

/// What the axes of a machine are to straight motion.
#[derive(Debug, Clone, Default)]
pub struct Axes {
    /// Their letters, as bits.
    pub letters: u32,
    /// Which of them turn; none does.
    pub has_rotary: bool,
    /// Which of them turn without end; none does.
    pub has_endless: bool,
    /// Each: the index of its letter, the lowest and the highest place.
    pub each: Vec<(usize, f64, f64)>,
}

impl Axes {
    /// The axes of a machine.
    pub fn of(setup: &Setup) -> Self {
        let letter_of = |letter: char| (letter as usize).wrapping_sub('A' as usize) % 26;
        Self {
            letters: setup
                .axes
                .iter()
                .fold(0, |bits, axis| bits | 1 << letter_of(axis.letter)),
            has_rotary: setup.axes.iter().any(|axis| axis.rotary),
            has_endless: setup.axes.iter().any(|axis| axis.modulo),
            each: setup
                .axes
                .iter()
                .map(|axis| {
                    let low = axis.travel_min - TRAVEL_ROUNDING;
                    (
                        letter_of(axis.letter),
                        low,
                        axis.travel_max + TRAVEL_ROUNDING,
                    )
                })
                .collect(),
        }
    }
}

/// The words of a block of straight motion.
#[derive(Debug, Clone, Copy, Default)]
pub struct Straight {
    /// Which letters are there, as bits.
    pub present: u32,
    /// Values by letter; of use for those that are there.
    pub values: [f64; 26],
    /// G0 (true) or G1.
    pub rapid: Option<bool>,
}

impl Straight {
    fn clear(&mut self) {
        self.present = 0;
        self.rapid = None;
    }

    /// Takes a word; false if it belongs into no such block, or not there.
    fn take(&mut self, letter: u8, value: f64, is_first: bool) -> bool {
        match letter {
            b'G' => {
                let fits = (value == 0.0 || value == 1.0) && self.rapid.is_none();
                self.rapid = Some(value == 0.0);
                fits && value.is_sign_positive()
            }
            b'N' => is_first && value.is_sign_positive(),
            b'A'..=b'Z' => {
                let index = letter - b'A';
                let bit = 1 << index;
                let fits = LETTERS & bit != 0 && self.present & bit == 0;
                self.present |= bit;
                if let Some(slot) = self.values.get_mut(usize::from(index)) {
                    *slot = value;
                }
                fits
            }
            _ => false,
        }
    }

    /// Reads a line; false if it is no such block.
    pub fn read(&mut self, line: &[u8]) -> bool {
        self.clear();
        let mut at = 0;
        let mut is_first = true;
        loop {
            match line.get(at) {
                None => return !is_first,
                Some(b' ' | b'\t') => at += 1,
                Some(b'\r') => return at + 1 == line.len() && !is_first,
                Some(letter) => {
                    let letter = letter & !0x20;
                    let Some((value, behind)) = number(line, at + 1) else {
                        return false;
                    };
                    if !self.take(letter, value, is_first) {
                        return false;
                    }
                    is_first = false;
                    at = behind;
                }
            }
        }
    }

    /// The same of words that were read.
    pub fn of_words(&mut self, words: &[Word]) -> bool {
        self.clear();
        words.iter().enumerate().all(|(index, word)| {
            let letter = u8::try_from(word.letter).unwrap_or(0);
            self.take(letter, word.value, index == 0)
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 20_000, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn a_number_is_the_nearest_to_its_text(text in "[+-]?([0-9]{1,20}|[0-9]{0,9}[.][0-9]{0,17})") {
            let parsed = text.parse::<f64>().ok().map(f64::to_bits);
            if let Some((value, end)) = number(text.as_bytes(), 0) {
                prop_assert_eq!(end, text.len());
                prop_assert_eq!(Some(value.to_bits()), parsed);
            }
        }
    }

    #[test]
    fn what_is_no_straight_motion_is_left_to_others() {
        let mut block = Straight::default();
        for line in [
            "X1",
            "G1X1Y-2.5",
            "n10 g00 x.5 F100",
            "N5 Y+3. \r",
            " X1 Y2",
            "G1",
            "F5",
        ] {
            assert!(block.read(line.as_bytes()), "{line}");
        }
        assert!(block.read(b"g01 X1.25 z-3"));
        assert_eq!(block.rapid, Some(false));
        assert_eq!(block.present, mask_of("XZ"));
        assert_eq!((block.values[23], block.values[25]), (1.25, -3.0));
        for line in [
            "",
            " ",
            "\r",
            "X1 2",
            "X 1",
            "X1.2.3",
            "X",
            "X-",
            "G2 X1",
            "G0 G1 X1",
            "G0 G0 X1",
            "X1 X2",
            "X1 N5",
            "N-5 X1",
            "X1 (c)",
            "X1;",
            "/X1",
            "%",
            "X#1",
            "X[1]",
            "G-0 X1",
            "G1.0001 X1",
            "X1\rY2",
            "M3",
            "X1e5",
            "X12345678901234567890",
            "X2000000000",
            "@1 ^2",
            "ö1",
        ] {
            assert!(!block.read(line.as_bytes()), "{line}");
        }
    }
}
