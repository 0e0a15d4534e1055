//! Why an ESI file cannot be used.

/// Why an ESI file cannot be used, or none of its devices.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum EsiError {
    /// It cannot be read at all.
    #[error("{file}: {what}")]
    Unreadable {
        /// The file.
        file: String,
        /// Why.
        what: String,
    },
    /// Something in it cannot be understood.
    #[error("{file}:{line}: {what}")]
    Wrong {
        /// The file.
        file: String,
        /// The line, from 1.
        line: u32,
        /// What is wrong, and what would be right.
        what: String,
    },
    /// No device in it can be taken.
    #[error("{file}: {what}")]
    NoDevice {
        /// The file.
        file: String,
        /// Why, and what to write.
        what: String,
    },
}
