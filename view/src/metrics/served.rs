//! What scrapes are answered from.

use std::sync::{Arc, OnceLock};

use bus::cell::CellPaths;
use launcher::children::Child;

use super::numbers::Numbers;

/// What is served.
#[derive(Debug, Clone)]
pub struct Served {
    /// The cell.
    pub place: CellPaths,
    /// Its numbers.
    pub numbers: Arc<Numbers>,
    /// Its recorder, once one was seen: where it writes, and which program the one run has.
    pub recorder: Arc<OnceLock<Child>>,
}
