//! Which samples a fault meets: a fault that fired in scan f and lasts n scans meets what is made from the feedbacks of scans
//! f to f + n − 1.

use bus::sample::Job;
use bus::service::SCAN_MAX;
use machine::Process;

use super::faults::{Action, Corruption, FaultScript, Field, Sent, Spoil};

/// Whether this fault, having fired in `fired`, meets what is sent in `scan`.
pub fn meets(action: &Action, fired: u64, scan: u64) -> bool {
    let scans = match *action {
        Action::Kill { .. } | Action::Stop { .. } => 0,
        Action::Drop { scans }
        | Action::Delay { scans, .. }
        | Action::Corrupt { scans, .. }
        | Action::Spoil { scans, .. } => scans,
    };
    scan.checked_sub(fired).is_some_and(|age| age < scans)
}

/// Whether lockstep must not wait for this sender's answer to `scan`, because none that counts will come: it is dropped or
/// late, or of another scan, axis or incarnation. That the sender is done with the scan it still says
/// ([`SignalPage::set_answered`](bus::signal_page::SignalPage::set_answered)), and lockstep waits for that: otherwise the sender could miss
/// the next feedback. Of the planner, whose status comes also with a fault, only where that status itself is spoilt.
pub fn excuses(
    script: &FaultScript,
    fired: impl Fn(usize) -> Option<u64>,
    process: Process,
    scan: u64,
) -> bool {
    matches!(process.job, Job::Servo | Job::Planner)
        && script.faults.iter().enumerate().any(|(index, fault)| {
            fault.process == process
                && does_not_count(&fault.action, process.job, scan)
                && fired(index).is_some_and(|fired| meets(&fault.action, fired, scan))
        })
}

fn does_not_count(action: &Action, job: Job, scan: u64) -> bool {
    match action {
        Action::Spoil { field, how, .. } => is_unheard(*field, *how, scan),
        _ if job != Job::Servo => false,
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

/// Whether an answer to `scan` with this number spoilt is none that lockstep hears.
fn is_unheard(field: Field, how: Spoil, scan: u64) -> bool {
    let Some(leaf) = field.leaf() else {
        return false;
    };
    match (field.sent, leaf.name.as_str()) {
        (Sent::Window | Sent::Setpoint, _) => false,
        (_, "scan") => {
            let spoilt = how.of(scan, leaf);
            spoilt < scan || spoilt > SCAN_MAX
        }
        (_, "visible_from") => how.of(scan.saturating_add(1), leaf) > scan.saturating_add(1),
        // Whatever it is, it is not what it was, or it was that already.
        (_, "incarnation") => true,
        _ => false,
    }
}
