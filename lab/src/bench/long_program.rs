//! Circles to and fro, for as long as one likes.

use std::fmt::Write as _;

/// Machine time of one repetition, in s: two turns each way with R25 at 3 m/min, and two dwells.
const REPETITION_S: f64 = 13.58;

/// A program of circles that takes at least so many seconds.
pub(crate) fn circles_program(seconds: u64) -> String {
    let repetitions = (seconds as f64 / REPETITION_S).ceil();
    let mut text = String::from("G21 G17 G90 G94 G91.1\nF3000\nG0 X25 Y0\n");
    for _ in 0..repetitions as u32 {
        for word in ["G3", "G2"] {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "G4 P0.5\n{word} X25 Y0 I-25\n{word} X25 Y0 I-25");
        }
    }
    text + "M2\n"
}
