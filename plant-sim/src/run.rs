//! The `plant-sim` process: a master over simulated drives.

use std::path::PathBuf;
use std::time::Duration;

use bus::member::Slot;
use machine::Machine;
use machine::settings_file::SettingsFileError;
use master::{MasterError, RunEnd};

use crate::plant_file::PlantFile;
use crate::script::faults::{self, FaultScript};
use crate::script::orders;
use crate::script::ports::ScriptedPorts;
use crate::setup::SetupError;

/// How a `plant-sim` process is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its slot in the cell.
    pub slot: Slot,
    /// The plant file.
    pub plant: PathBuf,
    /// Drives on from the first scan.
    pub enabled: bool,
    /// When the run ends by itself.
    pub run_end: RunEnd,
    /// A file of orders to obey, each at its scan.
    pub orders: Option<PathBuf>,
    /// A fault script.
    pub faults: Option<PathBuf>,
    /// Where the blocks it names begin on the path: line and element.
    pub fault_blocks: Vec<(u32, u32)>,
    /// In lockstep: how long a live process may take for one answer before the environment counts as broken.
    pub answer_limit: Duration,
}

/// Why a `plant-sim` process ended before its run did.
#[derive(Debug, thiserror::Error)]
pub enum PlantSimError {
    /// A settings file (machine, plant, orders, faults) is not usable.
    #[error(transparent)]
    File(#[from] SettingsFileError),
    /// Plant file and machine file do not fit each other.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The master could not go on.
    #[error(transparent)]
    Master(#[from] MasterError),
}

/// Runs a master over simulated drives until its run ends or the cell does.
///
/// # Errors
/// [`PlantSimError`]. A run that ends by itself has published a feedback marked last; one that is discarded has not.
pub fn run(options: &Options) -> Result<(), PlantSimError> {
    let mut machine = Machine::load(&options.slot.machine)?;
    let plant = PlantFile::load(&options.plant)?;
    let faults = load_faults(options, &mut machine)?;
    let orders = match &options.orders {
        Some(path) => orders::load(path, &machine)?,
        None => Vec::new(),
    };
    let drives = plant.drives(&machine)?;
    let master = master::Options {
        slot: options.slot.clone(),
        enabled: options.enabled,
        run_end: options.run_end,
        answer_limit: options.answer_limit,
    };
    master::run(
        &master,
        "plant-sim",
        &machine,
        drives,
        |ports, first_scan| ScriptedPorts::new(ports, faults, orders, first_scan),
    )?;
    Ok(())
}

/// The fault script, with its blocks resolved and its restart policy in force.
fn load_faults(
    options: &Options,
    machine: &mut Machine,
) -> Result<Option<FaultScript>, SettingsFileError> {
    let Some(path) = &options.faults else {
        return Ok(None);
    };
    let mut script = faults::load(path, machine)?;
    script.resolve_blocks(|line| {
        let mut blocks = options.fault_blocks.iter();
        blocks.find(|(l, _)| *l == line).map(|(_, e)| *e)
    })?;
    script.restart.apply(&mut machine.restart);
    Ok(Some(script))
}
