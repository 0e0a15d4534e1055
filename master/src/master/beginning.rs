//! How the program that a cell is started with begins.

use super::Master;
use crate::drives::Drives;

/// What the operator has chosen before the first scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Beginning {
    /// Block by block.
    pub single_block: bool,
    /// At this line; 0 for the beginning.
    pub start_line: u32,
}

impl<D: Drives> Master<D> {
    /// Takes what was chosen; of a master that replaces another one, what that one has latched counts.
    pub fn begin_with(&mut self, beginning: &Beginning) {
        self.auxiliary.begin_with(beginning);
    }
}
