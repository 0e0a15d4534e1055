//! Which samples a fault meets: a fault that fired in scan f and lasts n scans meets what is made from the feedbacks of scans
//! f to f + n − 1.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::Job;
use machine::Process;

use super::faults::{Action, Corruption, FaultScript};

/// Whether this fault, having fired in `fired`, meets what is sent in `scan`.
pub fn meets(action: &Action, fired: u64, scan: u64) -> bool {
    let scans = match *action {
        Action::Kill { .. } | Action::Stop { .. } => 0,
        Action::Drop { scans } | Action::Delay { scans, .. } | Action::Corrupt { scans, .. } => {
            scans
        }
    };
    scan.checked_sub(fired).is_some_and(|age| age < scans)
}

/// Whether lockstep must not wait for this sender's answer to `scan`, because none that counts will come: it is dropped or
/// late, or of another scan, axis or incarnation. That the sender is done with the scan it still says
/// ([`SignalPage::set_answered`](bus::signal_page::SignalPage::set_answered)), and lockstep waits for that: otherwise the sender could miss
/// the next feedback. Never of the planner, whose status comes also with a fault.
pub fn excuses(
    script: &FaultScript,
    fired: impl Fn(usize) -> Option<u64>,
    process: Process,
    scan: u64,
) -> bool {
    process.job == Job::Servo
        && script.faults.iter().enumerate().any(|(index, fault)| {
            fault.process == process
                && does_not_count(&fault.action)
                && fired(index).is_some_and(|fired| meets(&fault.action, fired, scan))
        })
}

fn does_not_count(action: &Action) -> bool {
    match action {
        Action::Kill { .. } | Action::Stop { .. } => false,
        Action::Drop { .. } | Action::Delay { .. } => true,
        Action::Corrupt { what, .. } => matches!(
            what,
            Corruption::OldScan
                | Corruption::NeverVisible
                | Corruption::WrongIncarnation
                | Corruption::Replay
                | Corruption::WrongAxis
        ),
    }
}
