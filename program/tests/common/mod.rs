//! Machines that the tests of this crate share.
#![allow(dead_code, reason = "each test file uses a part of it")]

use std::sync::Arc;

use path::geometry::AxisVector;
use program::{AxisSetup, Program, ProgramError, Setup, interpret, parse_tools};

pub fn slide(letter: char, travel_min: f64, travel_max: f64) -> AxisSetup {
    AxisSetup {
        letter,
        travel_min,
        travel_max,
        rotary: false,
        modulo: false,
    }
}

/// X, Y and Z, each with a travel of ± `travel_mm`.
pub fn mill(travel_mm: f64) -> Setup {
    let axes = ['X', 'Y', 'Z'].map(|letter| slide(letter, -travel_mm, travel_mm));
    Setup {
        axes: axes.into(),
        ..Setup::default()
    }
}

pub fn at(values: &[f64]) -> AxisVector {
    let mut vector = AxisVector::zeros();
    for (component, value) in vector.iter_mut().zip(values) {
        *component = *value;
    }
    vector
}

/// Interprets a text on a mill with ± 200 mm that is at zero.
pub fn on_mill(text: &str) -> Result<Program, ProgramError> {
    interpret("part.ngc", text, &mill(200.0), AxisVector::zeros())
}

/// The refusal of a text, as people read it.
pub fn refusal(text: &str) -> String {
    match on_mill(text) {
        Ok(_) => panic!("was not refused: {text}"),
        Err(error) => error.to_string(),
    }
}

/// Nine axes with travel enough for any program, tools, and answers to whatever a program asks.
pub fn everything() -> Arc<Setup> {
    let mut axes: Vec<_> = "XYZABCUVW"
        .chars()
        .map(|letter| slide(letter, -1e9, 1e9))
        .collect();
    for axis in &mut axes {
        axis.rotary = "ABC".contains(axis.letter);
    }
    let tools = "T1 P1 Z10 D6\nT2 P2 Z20.5 D3 X1\nT3 P3 Z5 D1 Q2 I10 J20\nT99 P99 D8 Z-3 ;last\n";
    Arc::new(Setup {
        axes,
        tools: parse_tools("tools.tbl", tools).unwrap(),
        answers_assumed: true,
        ..Setup::default()
    })
}
