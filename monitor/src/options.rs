//! How a recorder is started, and why one ends before its run.

use std::path::PathBuf;

use bus::member::{MemberError, Slot};
use machine::LogLevel;
use machine::settings_file::SettingsFileError;

use crate::log::LogError;

/// How a recorder is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its slot in the cell.
    pub slot: Slot,
    /// Run directory; without a program the folder in which each program that is started gets one.
    pub out: PathBuf,
    /// Part program, already copied into the run directory; none in a cell that stays up.
    pub program: Option<PathBuf>,
    /// What it records: a cell of which no samples are kept has a recorder all the same, for the black box.
    pub level: LogLevel,
}

/// Why the recorder ended before its run did.
#[derive(Debug, thiserror::Error)]
pub enum MonitorError {
    /// The cell refuses it.
    #[error(transparent)]
    Member(#[from] MemberError),
    /// The machine file is not usable.
    #[error(transparent)]
    Machine(#[from] SettingsFileError),
    /// The log cannot be written.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A file that belongs into the log cannot be read.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// Nothing lies where a loaded program should.
    #[error("no program lies in the cell under number {0}")]
    NoProgram(u32),
}
