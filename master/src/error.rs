//! Why a master ends before its run does.

use bus::member::MemberError;

use crate::drives::StateRefused;

/// Why a master ended before its run did.
#[derive(Debug, thiserror::Error)]
pub enum MasterError {
    /// It could not take part.
    #[error(transparent)]
    Member(#[from] MemberError),
    /// The state that a master before this one left is damaged.
    #[error(transparent)]
    Saved(#[from] StateRefused),
    /// Someone who lives does not answer.
    #[error(
        "{who} has not answered scan {scan} for {waited_s} s although it lives: this PC is too busy, or it hangs"
    )]
    NoAnswer {
        /// The silent ones.
        who: String,
        /// The scan.
        scan: u64,
        /// How long it was waited, in s.
        waited_s: u64,
    },
}
