//! The `plant-sim` process: a master over simulated drives.

use std::path::{Path, PathBuf};

use machine::Machine;
use machine::settings_file::SettingsFileError;
use master::MasterError;

use crate::plant_file::PlantFile;
use crate::script::faults::{self, FaultScript};
use crate::script::orders;
use crate::script::ports::ScriptedPorts;
use crate::setup::SetupError;

/// How a `plant-sim` process is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// How its master is.
    pub master: master::Options,
    /// The plant file.
    pub plant: PathBuf,
    /// A file of orders to obey, each at its scan.
    pub orders: Option<PathBuf>,
    /// A fault script.
    pub faults: Option<PathBuf>,
    /// Where the blocks it names begin on the path: line and element.
    pub fault_blocks: Vec<(u32, u32)>,
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
    let mut machine = Machine::load(&options.master.slot.machine)?;
    let plant = PlantFile::load(&options.plant)?;
    let faults = load_faults(
        options.faults.as_deref(),
        &options.fault_blocks,
        &mut machine,
    )?;
    let orders = match &options.orders {
        Some(path) => orders::load(path, &machine)?,
        None => Vec::new(),
    };
    let drives = plant.drives(&machine)?;
    master::run(
        &options.master,
        "plant-sim",
        &machine,
        drives,
        |ports, first_scan| ScriptedPorts::new(ports, faults, orders, first_scan),
    )?;
    Ok(())
}

/// The fault script of a file, if there is one, with its blocks (line and first element) resolved and its restart policy in force.
///
/// # Errors
/// It is not usable.
pub fn load_faults(
    path: Option<&Path>,
    fault_blocks: &[(u32, u32)],
    machine: &mut Machine,
) -> Result<Option<FaultScript>, SettingsFileError> {
    let Some(path) = path else {
        return Ok(None);
    };
    let mut script = faults::load(path, machine)?;
    script.resolve_blocks(|line| {
        let mut blocks = fault_blocks.iter();
        blocks.find(|(l, _)| *l == line).map(|(_, e)| *e)
    })?;
    script.restart.apply(&mut machine.restart);
    Ok(Some(script))
}
