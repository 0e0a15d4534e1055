//! Measures how late scans begin on this PC, as the master of a machine would begin them.

use bus::realtime::Settings;
use bus::sample::Job;
use console::signals::Signals;
use machine::Machine;

use super::lateness::{Lateness, measure};

/// Scan period where no machine is named.
const PERIOD_US: u32 = 1000;

/// Measures until the time is over or Ctrl-C comes; shows how far it is.
pub fn measured(machine: Option<&Machine>, seconds: u64) -> anyhow::Result<Lateness> {
    let signals = Signals::catch()?;
    let plain = || ((Settings::DEFAULT, Vec::new()), PERIOD_US);
    let (as_master, period_us) = machine.map_or_else(plain, |machine| {
        (machine.processes.of(Job::Master), machine.scan.period_us)
    });
    let wanted = seconds * 1_000_000 / u64::from(period_us);
    let bar = launcher::progress::bar(true);
    bar.set_message(format!("how late scans begin, {seconds} s; Ctrl-C ends it"));
    let lateness = measure(&as_master, (period_us, wanted), |scans| {
        bar.set_position(scans * 1000 / wanted);
        signals.count() == 0
    });
    bar.finish_and_clear();
    Ok(lateness)
}
