//! What the interpreter knows from block to block: its modes, and what moves beside a contour carry.

use path::geometry::{AxisVector, Feed};
use serde::{Deserialize, Serialize};

use crate::codes::g_codes;
use crate::cycles::Cycle;
use crate::program::EventKind;
use crate::snapshot;
use crate::splines::Spline;
use crate::surface::{FeedPerTurn, SurfaceSpeed};
use crate::threading::InStep;

/// Motion mode (modal group 1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Motion {
    /// G80, and before the first motion word.
    #[default]
    None,
    Rapid,
    Line,
    Arc {
        clockwise: bool,
    },
    /// G38.2 to G38.5: ten times its number.
    Probe(u32),
    Cycle(Cycle),
    Spline(Spline),
    InStep(InStep),
}

g_codes! {
    /// What F means.
    pub enum FeedMode {
        /// Blocks per minute.
        InverseTime = 930,
        /// Length per minute.
        PerMinute = 940,
        /// Length per revolution of the spindle.
        PerRevolution = 950,
    }
}

/// An F word: its value, and the length of its unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FeedWord {
    pub value: f64,
    pub unit_mm: f64,
}

/// What is known of the spindle.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Spindle {
    /// S: in rev/min, in G96 in m/min or feet/min.
    pub speed: f64,
    /// 1 clockwise, −1 counter-clockwise, 0 stopped.
    pub direction: i32,
}

impl Motion {
    /// The motion mode of a code.
    pub fn of_code(number: u32) -> Self {
        match number {
            0 => Motion::Rapid,
            10 => Motion::Line,
            20 | 30 => Motion::Arc {
                clockwise: number == 20,
            },
            382..=385 => Motion::Probe(number),
            _ => Cycle::of_code(number)
                .map(Motion::Cycle)
                .or_else(|| Spline::of_code(number).map(Motion::Spline))
                .or_else(|| InStep::of_code(number).map(Motion::InStep))
                .unwrap_or(Motion::None),
        }
    }
}

/// Modes that hold from block to block, the motion mode left out: M70 and M73 save them (LinuxCNC manual, *M70 Save Modal State*).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ModalState {
    /// Number of the plane, axis letters (first, second), and the offset letters that belong to them.
    pub plane: (u32, [char; 2], [char; 2]),
    pub inches: bool,
    pub incremental: bool,
    pub arc_absolute: bool,
    /// X words are diameters (G7).
    pub diameters: bool,
    pub feed_mode: FeedMode,
    pub feed: Option<FeedWord>,
    pub spindle: Spindle,
    /// G96.
    pub surface: Option<SurfaceSpeed>,
    /// Mist and flood.
    pub coolant: [bool; 2],
    /// M50.
    pub feed_override: bool,
    /// M51.
    pub spindle_override: bool,
    pub returns_to_r: bool,
    pub path_control: u32,
    /// P and Q of G64, in mm; none where nothing is said.
    pub path_words: [Option<f64>; 2],
}

/// G17 G21 G90 G91.1 G8 G94 G97 M5 M9 M48 G98 G61.
impl Default for ModalState {
    fn default() -> Self {
        Self {
            plane: plane_of_code(170),
            inches: false,
            incremental: false,
            arc_absolute: false,
            diameters: false,
            feed_mode: FeedMode::PerMinute,
            feed: None,
            spindle: Spindle::default(),
            surface: None,
            coolant: [false; 2],
            feed_override: true,
            spindle_override: true,
            returns_to_r: false,
            path_control: 610,
            path_words: [None; 2],
        }
    }
}

/// The plane of a code.
pub fn plane_of_code(code: u32) -> (u32, [char; 2], [char; 2]) {
    match code {
        180 => (18, ['Z', 'X'], ['K', 'I']),
        190 => (19, ['Y', 'Z'], ['J', 'K']),
        _ => (17, ['X', 'Y'], ['I', 'J']),
    }
}

/// What M70 and M73 save: the modes, and which offsets apply.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SavedModes {
    pub modes: ModalState,
    pub work_offset: f64,
    /// Length of the tool that counts (G43), all 0 after G49.
    pub tool_length: AxisVector,
    pub tool_length_of: u32,
    /// The tool's centre point is controlled (G43.4).
    pub controls_tool_centre: bool,
    /// The offset of G54.1.
    pub more_work: Option<u32>,
}

/// What a move carries.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Carried {
    pub line: u32,
    #[serde(with = "snapshot::feed")]
    pub feed: Feed,
    pub per_turn: Option<FeedPerTurn>,
}

/// What happens between moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Happening {
    Event(u32, EventKind),
    Dwell(u32, f64),
}
