//! A master as a process, over any drives.

use std::time::Duration;

use bus::member::{Member, MemberError, Slot};
use bus::realtime::Priority;
use machine::Machine;

use crate::bus_ports::BusPorts;
use crate::cycle::cycle;
use crate::drives::Drives;
use crate::error::MasterError;
use crate::master::{Beginning, Master, RunEnd};
use crate::ports::{Flow, MasterPorts};
use crate::saved::{Latches, SavedState};

/// How a master is started.
#[derive(Debug, Clone)]
pub struct Options {
    /// Its slot in the cell.
    pub slot: Slot,
    /// Drives on from the first scan.
    pub enabled: bool,
    /// When the run ends by itself.
    pub run_end: RunEnd,
    /// What the operator has chosen before its first scan.
    pub beginning: Beginning,
    /// In lockstep: how long a live process may take for one answer before the environment counts as broken.
    pub answer_limit: Duration,
}

/// Runs a master over these drives until its run ends or the cell does; `decorate` makes its ports of the process's own,
/// for a run that starts at this scan.
///
/// # Errors
/// [`MasterError`]. A run that ends by itself has published a feedback marked last; one that is discarded has not.
pub fn run<D: Drives, P: MasterPorts<Error = MasterError>>(
    options: &Options,
    name: &str,
    machine: &Machine,
    mut drives: D,
    decorate: impl FnOnce(BusPorts, u64) -> P,
) -> Result<(), MasterError> {
    let member = Member::enter(options.slot.clone(), name, &machine.shape())?;
    let mut ports =
        BusPorts::open(member, machine, options.answer_limit).map_err(MemberError::Cell)?;
    let member = &ports.member;
    let latches = restore(member, &mut drives)?;
    let first_scan = first_scan(
        latches.map(|latches| latches.scan),
        member.page.answered_scan(options.slot.index),
    );
    let mut master = Master::new(
        machine,
        drives,
        options.slot.incarnation,
        first_scan,
        options.enabled,
        options.run_end,
    );
    master.begin_with(&options.beginning);
    if let Some(latches) = &latches {
        master.resume(latches);
    }
    member.ready(Priority::Master);
    if !ports.wait_for_start() {
        return Ok(());
    }
    let mut ports = decorate(ports, first_scan);
    let result = loop {
        match cycle(&mut master, &mut ports) {
            Ok(Flow::GoOn) => {}
            Ok(Flow::Leave) => break Ok(()),
            Err(error) => break Err(error),
        }
    };
    ports.leave();
    result
}

/// The first scan of a master, from the scan that one before it has saved last and the one it has published last. A scan that
/// was published and not saved is not published again: who has answered it would not answer another of that number, and in lockstep
/// everybody would wait for ever.
fn first_scan(saved: Option<u64>, published: Option<u64>) -> u64 {
    saved
        .max(published)
        .map_or(0, |scan| scan.saturating_add(1))
}

/// Takes over what a master before this one left.
fn restore(member: &Member, drives: &mut impl Drives) -> Result<Option<Latches>, MasterError> {
    let mut saved = SavedState::of(drives);
    if !member.page.load_machine_state(&mut saved.bytes) {
        return Ok(None);
    }
    Ok(Some(saved.restore(drives)?))
}

#[cfg(test)]
mod tests {
    use super::first_scan;

    #[test]
    fn a_scan_that_was_published_before_the_kill_is_not_published_again() {
        assert_eq!(first_scan(None, None), 0);
        assert_eq!(first_scan(Some(7), Some(7)), 8);
        assert_eq!(first_scan(Some(7), Some(8)), 9);
        // Killed in its first scan: what stands is not saved, but the number is spent.
        assert_eq!(first_scan(None, Some(0)), 1);
    }
}
