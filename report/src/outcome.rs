//! How a run ended.

use serde::{Deserialize, Serialize};

/// How a run ended, in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OutcomeKind {
    /// The program is done and the machine in position.
    Completed,
    /// Stopped for a reason.
    Stopped,
    /// Stopped by the operator.
    Interrupted,
}
