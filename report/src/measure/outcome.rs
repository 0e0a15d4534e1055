//! How a run ended, how a process died and what the machine did about it: as types here, as words in the reports.

use std::fmt;

use bus::sample::Mode;
use serde::{Serialize, Serializer};

use monitor::words::StopCause;

/// How a run ended, as the samples show it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// The program is done and the machine in position.
    Completed,
    /// Stopped by the operator, at rest on the path.
    Interrupted,
    /// Stopped for a reason.
    Stopped(StopReason),
}

/// Why a run was stopped.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StopReason {
    /// Nothing is known of it.
    NoFeedback,
    /// The planner was lost and not replaced.
    PlannerLost {
        /// How.
        loss: Loss,
        /// When.
        scan: u64,
    },
    /// The machine stopped, or tripped, for the cause that its feedback names.
    Cause(StopCause),
    /// The last feedback shows a machine that has not come to an end.
    LogEnds {
        /// Its scan.
        scan: u64,
        /// The mode; none if it is not known here.
        mode: Option<Mode>,
    },
}

impl StopReason {
    /// Whether the log does not tell how a run ended whose last scan this was.
    pub fn is_unknown(&self, last_scan: u64) -> bool {
        match self {
            StopReason::NoFeedback => true,
            StopReason::LogEnds { scan, .. } => *scan < last_scan,
            StopReason::PlannerLost { .. } | StopReason::Cause(_) => false,
        }
    }
}

impl fmt::Display for StopReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StopReason::NoFeedback => f.write_str("the log holds no feedback"),
            StopReason::PlannerLost { loss, scan } => write!(
                f,
                "planner {loss} in scan {scan}; the machine came to rest on the path"
            ),
            StopReason::Cause(cause) => cause.fmt(f),
            StopReason::LogEnds { scan, mode } => write!(
                f,
                "the log ends at scan {scan} with the machine {}",
                mode_word(*mode)
            ),
        }
    }
}

pub(super) fn mode_word(mode: Option<Mode>) -> &'static str {
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
