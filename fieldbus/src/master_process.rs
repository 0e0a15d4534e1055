//! The `master` process: a cell's master over drives on a fieldbus.

use std::time::Duration;

use anyhow::Context;
use bus::cell::CellPaths;
use bus::drive_page::DrivePage;
use machine::Machine;
use master::bus_ports::BusPorts;
use master::{MasterError, MasterPorts};

use crate::drives::{Cia402Drives, PageWire};
use crate::setups;

/// So long a segment may take to start up.
const START_LIMIT: Duration = Duration::from_secs(25);

/// Runs a master over the drives of this machine until its run ends or the cell does; `decorate` as in [`master::run()`].
///
/// # Errors
/// A drive file cannot be used, or as [`master::run()`].
pub fn run<P: MasterPorts<Error = MasterError>>(
    options: &master::Options,
    machine: &Machine,
    decorate: impl FnOnce(BusPorts, u64) -> P,
) -> anyhow::Result<()> {
    let setups = setups::load(machine, &options.slot.machine)?
        .context("the machine file has no [bus]: its drives are simulated")?;
    let place = CellPaths::new(&options.slot.cell)?;
    let page = DrivePage::open(&place)?;
    let period = Duration::from_micros(machine.scan.period_us.into());
    let wire = PageWire::new(page, options.slot.pace, period, options.answer_limit);
    wire.await_start(START_LIMIT);
    let drives = Cia402Drives::new(machine, &setups, wire)
        .context("a drive file lacks controlword, statusword or position")?;
    master::run(options, "master", machine, drives, decorate)?;
    DrivePage::open(&place)?.set_left();
    Ok(())
}
