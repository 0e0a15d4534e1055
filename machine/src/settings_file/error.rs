//! Why a settings file cannot be used.

use bus::numbers::short_numbers;

/// A settings file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SettingsFileError {
    /// It cannot be read at all.
    #[error("{path}: {what}")]
    Unreadable {
        /// The file.
        path: String,
        /// Why.
        what: String,
    },
    /// It breaks rules: one line each, with file, line, value, unit and rule.
    #[error("{}", short_numbers(.0.join("\n")))]
    Broken(Vec<String>),
}
