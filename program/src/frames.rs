//! What a subroutine has of its own: where it was called, its loops, its names.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

use crate::flow::{Keyword, shown_flow};
use crate::source::Spot;
use crate::state::SavedModes;

/// What a loop does at its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum LoopKind {
    /// `while` … `endwhile`.
    While,
    /// `do` … `while`.
    Do,
    /// `repeat` … `endrepeat`, with the passes left.
    Repeat(u64),
}

/// A loop that is being done.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Loop {
    pub label: String,
    pub pass: Pass,
}

/// Where a loop begins and what it does at its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pass {
    /// The line that it begins with.
    pub at: Spot,
    /// The next one.
    pub behind: Spot,
    pub kind: LoopKind,
}

/// A subroutine that was called; the first is the program itself.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Frame {
    /// Its label; empty for the program.
    pub label: String,
    /// The line to return to.
    pub return_to: Spot,
    /// The line of the call.
    pub called_from: Spot,
    /// Loops that are being done, the innermost last.
    pub loops: Vec<Loop>,
    /// Names that only it knows.
    pub named: BTreeMap<String, f64>,
    /// #1 and those behind it of the caller, restored at the end if the call had arguments of its own.
    pub kept: Vec<Option<f64>>,
    /// The line that it begins with and the next one. Its next pass goes on with its variables (Haas Mill Operator's Manual, "Macros":
    /// arguments are set on the first repetition only).
    pub begin: (Spot, Spot),
    /// Called by an O-word, whose arguments are #1 to #30.
    pub arguments: bool,
    /// Passes of M98 with L, this one included.
    pub repeats: u64,
    /// What M70 or M73 saved, and whether it is restored at the end by itself.
    pub saved: Option<(SavedModes, bool)>,
}

impl Frame {
    /// As a person writes it.
    pub fn shown(&self) -> String {
        shown_flow(&self.label, Keyword::Sub)
    }
}

/// The program and the subroutines that are called, the innermost last.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Frames {
    program: Frame,
    /// The subroutines in force.
    pub called: Vec<Frame>,
}

impl Frames {
    /// The one in force.
    pub fn here(&mut self) -> &mut Frame {
        self.called.last_mut().unwrap_or(&mut self.program)
    }

    /// The one in force, to look at.
    pub fn current(&self) -> &Frame {
        self.called.last().unwrap_or(&self.program)
    }
}
