//! Why a program cannot be planned.

use path::limits::LimitsError;
use path::pivot::OutOfReach;
use path::positioning::RatingError;
use path::window::PlanError;
use program::ResumeError;

/// Why a program cannot be planned.
#[derive(Debug, thiserror::Error)]
pub enum AheadError {
    /// The program.
    #[error(transparent)]
    Program(#[from] ResumeError),
    /// The machine cannot do it.
    #[error(transparent)]
    Course(#[from] CourseError),
}

/// Why a program cannot be planned on a machine.
#[derive(Debug, thiserror::Error)]
pub enum CourseError {
    /// The limits do not go with the increments and the scan.
    #[error(transparent)]
    Limits(#[from] LimitsError),
    /// The path does not go with the limits.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// An axis that its motor cannot move at its rating.
    #[error("axis {axis}: {source}")]
    Rating {
        /// Letter of the axis.
        axis: String,
        /// Why.
        source: RatingError,
    },
    /// The machine cannot do what happens on the way.
    #[error(transparent)]
    Event(#[from] EventError),
    /// The axes cannot bring the tool there.
    #[error(transparent)]
    OutOfReach(#[from] OutOfReach),
}

/// An event that this machine cannot do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {found}: {right}")]
pub struct EventError {
    /// Line of the program.
    pub line: u32,
    /// What was found.
    pub found: String,
    /// What would be right.
    pub right: String,
}
