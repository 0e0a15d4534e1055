//! What can be wrong with a log.

use std::path::{Path, PathBuf};

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

impl LogError {
    /// What the file system says of a log.
    pub(super) fn of_file(path: &Path) -> impl FnOnce(std::io::Error) -> LogError {
        let path = path.into();
        |source| LogError::File { path, source }
    }
}
