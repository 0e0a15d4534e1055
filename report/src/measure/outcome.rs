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

fn mode_word(mode: Option<Mode>) -> &'static str {
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

/// What the machine did about the loss of a process.
#[derive(Debug, Clone, PartialEq)]
pub enum Reaction {
    /// Nothing: motion does not depend on the process.
    None,
    /// Nothing was necessary, although motion depends on the process.
    NotNeeded(NotNeeded),
    /// The planner's successor found the machine at rest on the path.
    BrakedOnPath,
    /// The standby of the servo's axis took over.
    TookOver,
    /// The master commanded the axis along the window to its end, at rest on the path; tripped for this cause, if it is another
    /// one than the loss of the servo.
    RestedOnPath(Option<StopCause>),
    /// All axes braked together off the path; for this cause, if it is another one than the loss of the servo.
    QuickStopped(Option<StopCause>),
    /// The master was lost: each drive braked by itself.
    DrivesBraked {
        /// Mode in which its successor came up; none if it is not known here.
        mode: Option<Mode>,
        /// Whether the axes were where they can have come to; none where the log does not show it.
        positions: Option<Positions>,
    },
    /// The master was lost and not replaced.
    CellEnded,
}

/// Why nothing was necessary.
#[derive(Debug, Clone, PartialEq)]
pub enum NotNeeded {
    /// Its successor was there in time, or nothing more was asked of it.
    Undisturbed,
    /// The drives were off.
    DrivesOff,
    /// The machine was at rest.
    AtRest,
    /// All setpoints to the end of the program had been published.
    PlannedToEnd,
    /// It was the standby of this axis that was lost.
    StandbyOf(String),
}

/// Where the axes were after all drives had braked by themselves.
#[derive(Debug, Clone, PartialEq)]
pub enum Positions {
    /// Where they can have come to.
    Kept,
    /// An axis was farther away.
    Lost {
        /// Its letter.
        axis: String,
        /// Unit of its positions.
        unit: &'static str,
        /// How far it was from where it had been, in mm (degrees).
        moved_mm: f64,
        /// How far it can have come, in mm (degrees).
        most_mm: f64,
    },
}

impl fmt::Display for Reaction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Reaction::None => f.write_str("none"),
            Reaction::NotNeeded(why) => match why {
                NotNeeded::Undisturbed => f.write_str("none: motion went on undisturbed"),
                NotNeeded::DrivesOff => f.write_str("none: the drives were off"),
                NotNeeded::AtRest => f.write_str("none: the machine was at rest"),
                NotNeeded::PlannedToEnd => {
                    f.write_str("none: the program had been planned to its end")
                }
                NotNeeded::StandbyOf(axis) => write!(
                    f,
                    "none: axis {axis} has no standby until another one is there"
                ),
            },
            Reaction::BrakedOnPath => f.write_str("braked to rest on the path"),
            Reaction::TookOver => f.write_str("standby took over"),
            Reaction::RestedOnPath(None) => f.write_str("master brought it to rest on the path"),
            Reaction::RestedOnPath(Some(cause)) => {
                write!(f, "master brought it to rest on the path ({cause})")
            }
            Reaction::QuickStopped(None) => f.write_str("all axes quick-stopped together"),
            Reaction::QuickStopped(Some(cause)) => {
                write!(f, "all axes quick-stopped together ({cause})")
            }
            Reaction::DrivesBraked { mode, positions } => {
                write!(f, "drives braked, {}", mode_word(*mode))?;
                match positions {
                    None => Ok(()),
                    Some(Positions::Kept) => f.write_str("; positions kept"),
                    Some(Positions::Lost {
                        axis,
                        unit,
                        moved_mm,
                        most_mm,
                    }) => write!(
                        f,
                        "; axis {axis} came back {moved_mm:.3} {unit} from where it was: at most {most_mm:.3} {unit} would be right"
                    ),
                }
            }
            Reaction::CellEnded => f.write_str("the cell ended"),
        }
    }
}

impl Serialize for Reaction {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}
