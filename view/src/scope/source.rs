//! Where a scope takes its samples from: a running cell, or a log.

use console::exit::Failure;
use machine::Machine;
use report::scope::Scope;

use super::path::Wanted;

/// Where samples come from.
pub trait Source {
    /// The machine they are of.
    fn machine(&self) -> &Machine;

    /// Hands over some of what there is; false once nothing more will come.
    fn feed(&mut self, scope: &mut Scope, wanted: &Wanted) -> Result<bool, Failure>;

    /// What it is, for messages.
    fn name(&self) -> String;

    /// Whether it came into the middle of things.
    fn is_live(&self) -> bool;
}
