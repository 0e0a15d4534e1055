//! Programs with bytes changed: reading them ends soon, without a panic, and as the whole says.
//!
//! `CASES=1000000 cargo test --release -p program mutations -- --nocapture` does more of them.

use std::time::{Duration, Instant};

use crate::common::{at, everything};
use crate::generate;
use program::{Piece, Progress, Reading, interpret};

/// So many lines are read of a program that does not end.
const LINES_MAX: usize = 20_000;
/// A text that is read in this time is read soon, on a PC that has much else to do.
const SOON: Duration = Duration::from_secs(30);

/// Random numbers (xorshift).
struct Draw(u64);

impl Draw {
    fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % bound.max(1)
    }
}

/// Bytes that mean something, and some that do not.
const BYTES: &[u8] =
    b"GMXYZABCIJKRPQLFSTHDENOou0123456789.+-*/#<>[]()=;%@^$ \t\r\n\0\x1c\xFF\xC3\xA4";

/// Bytes that often leave a program a program.
const DIGITS: &[u8] = b"0123456789. ";

fn mutated(text: &str, draw: &mut Draw) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..1 + draw.below(3) {
        let at = draw.below(bytes.len());
        let of = if draw.below(2) == 0 { DIGITS } else { BYTES };
        let byte = of[draw.below(of.len())];
        match draw.below(5) {
            _ if bytes.is_empty() => bytes.push(byte),
            0 => bytes[at] = byte,
            1 => bytes.insert(at, byte),
            2 => {
                bytes.remove(at);
            }
            3 => {
                let end = (at + draw.below(40)).min(bytes.len());
                let part = bytes[at..end].to_vec();
                let to = draw.below(bytes.len());
                bytes.splice(to..to, part);
            }
            _ => bytes[at] = draw.below(256) as u8,
        }
    }
    bytes
}

#[test]
fn texts_with_bytes_changed_are_read_soon_and_as_the_whole_says() {
    let cases: u64 = std::env::var("CASES").map_or(4_000, |cases| cases.parse().unwrap());
    let from: u64 = std::env::var("FROM").map_or(1, |from| from.parse().unwrap());
    let setup = everything();
    let mut longest = Duration::ZERO;
    let (mut ended, mut refused, mut endless) = (0u64, 0u64, 0u64);
    let mut text = String::new();
    for case in from..from + cases {
        let mut draw = Draw(case.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
        if case % 8 == 1 || text.is_empty() {
            let kinds = generate::Kinds {
                splines: true,
                spindle_motion: true,
                polar: true,
                mutations: false,
            };
            text = generate::program(case, kinds);
        }
        let bytes = match draw.below(10) {
            0 => (0..draw.below(200))
                .map(|_| BYTES[draw.below(BYTES.len())])
                .collect(),
            1 => (0..draw.below(200))
                .map(|_| draw.below(256) as u8)
                .collect(),
            _ => mutated(&text, &mut draw),
        };
        let program = String::from_utf8_lossy(&bytes);
        let begun = Instant::now();
        let mut reading = Reading::of_text("part", &program, &setup, at(&[])).unwrap();
        let mut piece = Piece::default();
        let progress = reading.read(LINES_MAX, &mut piece);
        let whole = match progress {
            Ok(Progress::More) => None,
            _ => Some(interpret("part", &program, &setup, at(&[]))),
        };
        longest = longest.max(begun.elapsed());
        assert!(begun.elapsed() < SOON, "case {case}: {:?}", begun.elapsed());
        match (progress, whole) {
            (Ok(Progress::Ended(end)), Some(Ok(whole))) => {
                assert_eq!(whole.end, end, "case {case}");
                assert_eq!(whole.path.elements, piece.elements, "case {case}");
                assert_eq!(whole.events, piece.events, "case {case}");
                ended += 1;
            }
            (Err(error), Some(Err(whole))) => {
                assert_eq!(
                    error.problems.first(),
                    whole.problems.first(),
                    "case {case}"
                );
                refused += 1;
            }
            (Ok(Progress::More), _) => endless += 1,
            (reading, whole) => panic!("case {case}: {reading:?}, {:?}", whole.map(Result::err)),
        }
    }
    println!(
        "{cases} cases: {ended} ended, {refused} refused, {endless} with more than {LINES_MAX} lines; longest {longest:?}"
    );
}
