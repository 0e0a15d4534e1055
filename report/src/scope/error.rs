//! What can be wrong with what is asked of a scope.

/// What cannot be done.
#[derive(Debug, thiserror::Error)]
pub enum ScopeError {
    /// What was asked for is wrong.
    #[error("{0}")]
    Input(String),
}
