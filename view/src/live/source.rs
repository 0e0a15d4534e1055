//! Where a model comes from: the cell itself, or a server that looks at it from beside it.

use std::time::Duration;

use super::model::Model;

/// Fills a model.
pub trait Source {
    /// What is known.
    fn model(&self) -> &Model;
    /// Takes whatever has come since the last look.
    fn look(&mut self);
    /// Whether there is nothing more to wait for before one look is shown.
    fn is_whole(&self) -> bool;
    /// Whether the run is over, or about to be.
    fn has_ended(&self) -> bool;
    /// Waits for `budget`, and measures the period of scans meanwhile if that is possible.
    fn watch_periods(&mut self, budget: Duration);
    /// Goes over to the next cell of the same name, if this one is gone and there is one.
    fn follow(&mut self);
    /// Whether orders can be given.
    fn takes_orders(&self) -> bool;
}
