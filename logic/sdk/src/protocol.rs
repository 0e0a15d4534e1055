//! What a cell and its logic say to each other: JSON objects, a line each (docs/howto/logic.md).
//!
//! The cell says [`Hello`] once, and the logic [`Ready`]; then the cell asks a [`Question`], and the logic says an [`Answer`] to it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Version of all this.
pub const PROTOCOL: u32 = 1;

/// The longest line that either says, in bytes.
pub const LINE_BYTES_MAX: usize = 1 << 16;

/// The first line that the logic reads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// [`PROTOCOL`].
    pub quadrant_logic: u32,
    /// Name of the machine.
    pub machine: String,
    /// Name of the cell.
    pub cell: String,
    /// How often the logic of this cell has been started: 1 the first time, more after it was lost.
    pub starts: u32,
    /// Time of the machine between two questions, in s.
    pub period_s: f64,
    /// The signals, in the order of [`Question::values`].
    pub signals: Vec<SignalOfMachine>,
    /// Numbers of the alarms that it may raise.
    pub alarms: Vec<u32>,
}

/// A signal of the machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SignalOfMachine {
    /// Its name.
    pub name: String,
    /// `bool`, `int` or `float`.
    pub kind: String,
    /// Unit of a number.
    pub unit: String,
    /// The logic sets it.
    pub logic: bool,
}

/// The first line that the logic says, once it can answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ready {
    /// True.
    pub ready: bool,
}

/// A question: what the machine is and shows in a scan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Question {
    /// The scan.
    pub scan: u64,
    /// Time of the machine since the cell's first scan, in s.
    pub time_s: f64,
    /// What the machine does, as `quadrant status` says it: `disabled`, `ready`, `enabled`, `tripped` ….
    pub mode: String,
    /// Feed hold is latched.
    pub hold: bool,
    /// State of the program: `none`, `loading`, `loaded`, `running`, `done`.
    pub program: String,
    /// Number of the run.
    pub run: u32,
    /// Tool in the spindle.
    pub tool: u32,
    /// What the signals show.
    pub values: Vec<f64>,
}

/// The answer to a question.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Answer {
    /// The scan that was asked about.
    pub scan: u64,
    /// Signals that are set, by name; one that is left out stays as it was set last.
    #[serde(default)]
    pub set: BTreeMap<String, f64>,
    /// The machine is to come to rest on the path.
    #[serde(default)]
    pub hold: bool,
    /// The program is to be stopped.
    #[serde(default)]
    pub stop: bool,
    /// No program may be started or resumed.
    #[serde(default)]
    pub inhibit: bool,
    /// The machine is to brake at its limits and trip.
    #[serde(default)]
    pub trip: bool,
    /// Numbers of the alarms that are raised.
    #[serde(default)]
    pub alarms: Vec<u32>,
}
