//! The log of a run, `run.mcap`: every sample, self-describing, readable by Foxglove and PlotJuggler.
//!
//! The samples are plain old data without padding and every field stands at a multiple of its size, so their
//! little-endian bytes already are CDR (XCDR1, OMG DDS-XTypes 1.3 §7.4.1). A message is the four bytes of the
//! encapsulation header and the sample, cut to the axes and subsamples in use; its schema is generated from the same
//! table of fields ([`layout`]). MCAP: <https://mcap.dev/spec>.
//!
//! A recorder that replaces a dead one begins a further part, `run-2.mcap` … ([`RunLog`] reads them as one).
//!
//! Times in the log are scan × scan period from the start of the run: no wall clock stands in any message.

mod attached;
mod behind;
mod derived;
mod feed;
pub mod layout;
mod parts;
#[cfg(test)]
mod parts_tests;
mod reader;
mod recorder;
mod run_info;
mod skim;
mod tables;
#[cfg(test)]
mod tests;

use std::path::PathBuf;

pub use attached::attached_files;
pub use parts::{Part, RunLog, part_files, part_name};
pub use reader::{Reader, read_only};
pub use recorder::Recorder;
pub(crate) use recorder::tail_checksum;
pub use run_info::{BEGINS_AT, Event, RunEnd, RunInfo};
pub use skim::{Foreword, Start, skim};

use bus::sample::{
    AxisCommand, Feedback, Instruments, PlannerStatus, Roster, WindowHeader, WindowRow,
};

/// Name of the log in the run directory; of its first part, where there are several.
pub const LOG_FILE: &str = "run.mcap";

/// A log that cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file system refuses.
    #[error("{path}: {source}")]
    File {
        /// The log.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The MCAP writer refuses.
    #[error("{path}: cannot be written: {source}")]
    Write {
        /// The log.
        path: PathBuf,
        /// Why.
        source: mcap::McapError,
    },
    /// Its recorder ended before it had written anything.
    #[error("{path}: ends before metadata {}", run_info::RUN_RECORD)]
    Unbegun {
        /// The log.
        path: PathBuf,
    },
    /// It is not a log of this product.
    #[error("{path}: {what}")]
    NotALog {
        /// The log.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// A sample that has no place in a log of this machine.
    #[error("{0}")]
    BadSample(String),
}

/// What the log says of one window: header, intended rows, and a checksum of the rows that brake to rest.
#[derive(Debug, Clone, PartialEq)]
pub struct LoggedWindow {
    /// Its header.
    pub header: WindowHeader,
    /// Its intended rows.
    pub rows: Vec<WindowRow>,
    /// XXH3 over the bytes of the other rows, all axes.
    pub tail_checksum: u64,
}

/// One sample of a run, from the wire or from the log.
#[derive(Debug, Clone, PartialEq)]
pub enum Sample {
    /// What the master said.
    Feedback(Box<Feedback>),
    /// What the bench's instruments saw.
    Instruments(Box<Instruments>),
    /// What a servo asked for.
    Command(Box<AxisCommand>),
    /// What the planner published.
    Window(LoggedWindow),
    /// How the planner stood.
    Planner(PlannerStatus),
    /// Who took part.
    Roster(Box<Roster>),
    /// What happened to the process group.
    Event(Event),
}
