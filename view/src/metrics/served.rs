//! What scrapes are answered from.

use std::path::PathBuf;
use std::sync::Arc;

use bus::cell::CellPaths;

use super::numbers::Numbers;

/// What is served.
#[derive(Debug)]
pub struct Served {
    /// The cell.
    pub place: CellPaths,
    /// Its numbers.
    pub numbers: Arc<Numbers>,
    /// Run directory with the log, or the folder of those of a cell that stays up.
    pub log: PathBuf,
    /// The program of the one run; none in a cell that stays up.
    pub program: Option<PathBuf>,
}
