//! How a process died and what the machine did about it: as types here, as words in the reports.

use std::fmt;

use bus::sample::Mode;
use serde::{Serialize, Serializer};

use monitor::words::StopCause;

/// A mode, where it is known here.
pub(crate) fn mode_word(mode: Option<Mode>) -> &'static str {
    mode.map_or("in an unknown mode", Mode::word)
}

/// How a process was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Loss {
    /// By a signal.
    Killed,
    /// It ended by itself, with a failure.
    Exited,
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Loss::Killed => "killed",
            Loss::Exited => "exited",
        })
    }
}

/// What came of a death.
#[derive(Debug, Clone, PartialEq)]
pub enum Reaction {
    /// Motion does not depend on it.
    None,
    /// The axes came to rest on the path.
    BrakedOnPath,
    /// Something else, in words.
    Other(String),
}

impl Reaction {
    /// No reaction was needed, for this reason.
    pub fn not_needed(why: &str) -> Reaction {
        Reaction::Other(format!("none: {why}"))
    }

    /// The machine was stopped in this way; the cause, where it is another one than the death.
    pub fn stopped(how: &str, other: Option<StopCause>) -> Reaction {
        let cause = other.map_or(String::new(), |cause| format!(" ({cause})"));
        Reaction::Other(format!("{how}{cause}"))
    }
}

impl fmt::Display for Reaction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Reaction::None => "none",
            Reaction::BrakedOnPath => "braked to rest on the path",
            Reaction::Other(words) => words,
        })
    }
}

impl Serialize for Reaction {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}
