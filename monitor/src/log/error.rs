//! What can be wrong with a log.

use std::path::PathBuf;

use super::run_info::RUN_RECORD;

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
    #[error("{path}: ends before metadata {}", RUN_RECORD)]
    Empty {
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
