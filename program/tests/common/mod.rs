//! Machines that the tests of this crate share.
#![allow(dead_code, reason = "each test file uses a part of it")]

use control::path::AxisVector;
use program::{AxisSetup, Program, ProgramError, Setup, interpret};

pub fn slide(letter: char, travel_min: f64, travel_max: f64) -> AxisSetup {
    AxisSetup {
        letter,
        travel_min,
        travel_max,
        rotary: false,
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
