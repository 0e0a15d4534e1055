//! What a program asks the machine while it runs: where the probe trips, what an input shows. What comes behind is not known before
//! the answer is.

use bus::sample::{AskedInput, InputWait};
use path::geometry::{AxisVector, Element};

/// What a program asks.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "there is one at a time")]
pub enum Question {
    /// G38.2 to G38.5: where the probe trips on the way along this element. The element itself is read with the answer: it ends where
    /// the axes have come to rest.
    Probe {
        /// Line in the file, counted from 1.
        line: u32,
        /// The way as the program has it.
        element: Element,
        /// Where contact is lost (G38.4, G38.5) rather than made.
        away: bool,
        /// The program stops where that does not happen (G38.2, G38.4).
        must: bool,
    },
    /// M66: what an input shows.
    Input {
        /// Line in the file, counted from 1.
        line: u32,
        /// Which, and what is waited for.
        asked: AskedInput,
    },
}

/// What the machine answers. Places are those of the tool, in machine coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Answer {
    /// The probe has tripped.
    Tripped {
        /// Where.
        at: AxisVector,
        /// Where the axes have come to rest behind it: the program goes on from there.
        rests: AxisVector,
    },
    /// It has not, to the end of its way.
    Missed {
        /// Where the axes rest.
        rests: AxisVector,
    },
    /// The value of the input; −1 where the wait for it lasted too long.
    Input(f64),
}

impl Question {
    /// What is assumed where nobody answers: a probe trips at the end of its way, an input is as it is waited for, or 0.
    pub(crate) fn assumed(&self) -> Answer {
        match self {
            Question::Probe { element, .. } => Answer::Tripped {
                at: element.end(),
                rests: element.end(),
            },
            Question::Input { asked, .. } => {
                let on = matches!(asked.wait, InputWait::Rise | InputWait::High);
                Answer::Input(f64::from(u8::from(on)))
            }
        }
    }

    /// The line that asks.
    pub fn line(&self) -> u32 {
        match self {
            Question::Probe { line, .. } | Question::Input { line, .. } => *line,
        }
    }
}
