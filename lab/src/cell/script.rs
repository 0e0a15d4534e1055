//! What a cell within one process is made of beside its machine and program.

use master::StateRefused;
use plant_sim::script::faults::FaultScript;
use plant_sim::script::orders::ScriptedOrder;
use plant_sim::setup::SetupError;
use servo::ServoSettingsError;

use crate::tampering::Tampering;

/// A cell that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum CellError {
    /// Machine file and plant file do not fit each other.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// An axis cannot be served.
    #[error(transparent)]
    Servo(#[from] ServoSettingsError),
    /// A master cannot go on from what the one before has saved.
    #[error(transparent)]
    Saved(#[from] StateRefused),
}

/// What a run depends on beside machine and program.
#[derive(Debug, Clone, Default)]
pub struct Script {
    /// What goes wrong; its blocks are resolved.
    pub faults: Option<FaultScript>,
    /// What the operator asks, in the order of the scans.
    pub orders: Vec<ScriptedOrder>,
    /// Kills are deaths that nobody has ordered: the launcher's rules say who is replaced and when, not the script.
    pub supervised: bool,
    /// What somebody does to samples behind their senders' backs.
    pub tampering: Option<Tampering>,
}
