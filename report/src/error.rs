//! Why a report cannot be made.

use std::path::PathBuf;

use machine::settings_file::SettingsFileError;
use program::ResumeError;

use crate::plot::PlotError;
use monitor::log::LogError;

/// A report that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The log.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The copy of the machine file in the run directory.
    #[error(transparent)]
    Machine(#[from] SettingsFileError),
    /// The copy of the program in the run directory.
    #[error(transparent)]
    Program(#[from] ResumeError),
    /// Log and machine file are not of one run.
    #[error("{path}: {what}")]
    Mismatch {
        /// The run directory.
        path: PathBuf,
        /// What differs.
        what: String,
    },
    /// A file cannot be read.
    #[error("{path}: cannot be read: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file of the report cannot be written.
    #[error("{path}: cannot be written: {source}")]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// Two runs that cannot be compared.
    #[error("{what}")]
    Compare {
        /// Which, and what differs.
        what: String,
    },
    /// A plot cannot be drawn.
    #[error(transparent)]
    Plot(#[from] PlotError),
}
