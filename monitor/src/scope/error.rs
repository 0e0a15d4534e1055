//! What can be wrong with what is asked of a scope.

use crate::plot::PlotError;

/// What cannot be done.
#[derive(Debug, thiserror::Error)]
pub enum ScopeError {
    /// What was asked for is wrong.
    #[error("{0}")]
    Input(String),
    /// A picture cannot be written.
    #[error(transparent)]
    Picture(#[from] PlotError),
}
