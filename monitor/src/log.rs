//! The log of a run, `run.mcap`: the samples of its level, self-describing. MCAP: <https://mcap.dev/spec>.
//!
//! The samples are plain old data without padding and every field is at a multiple of its size, so their
//! little-endian bytes already are CDR (XCDR1, OMG DDS-XTypes 1.3 §7.4.1), cut to the axes and subsamples in use
//! (`layout`). What comes scan by scan is written in columns, some hundred scans a message (`columns`), and put back into its
//! order when it is read (`group`); what comes seldom is a message each (`codec`). Schemas are made from the same tables of fields.
//!
//! A recorder that replaces a dead one begins a further part, `run-2.mcap` … ([`RunLog`] reads them as one).
//!
//! Times in the log are scan × scan period from the start of the run: no wall clock is in any message.

mod attached;
mod channels;
pub(crate) mod codec;
mod columns;
mod derived;
mod error;
mod feed;
mod group;
pub(crate) mod layout;
mod packer;
mod parts;
#[cfg(test)]
mod parts_tests;
mod reader;
mod recorder;
pub mod records;
mod run_info;
mod sample;
#[cfg(test)]
mod tests;

pub use attached::attached_files;
pub use codec::{Content, ENCAPSULATION};
pub use derived::{AxisRow, RING_SCANS, Rows};
pub use error::LogError;
pub use layout::{Extent, Layout};
pub use parts::{LOG_FILE, Part, RunLog, part_files};
pub use reader::{Reader, read_only};
pub use recorder::Recorder;
pub(crate) use run_info::BEGINS_AT;
pub use run_info::{Event, RunEnd, RunInfo};
pub use sample::{LoggedWindow, Sample, SampleRef};
