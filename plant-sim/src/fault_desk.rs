//! The machine side's part of a fault script: it sees when a fault is due, has the launcher act, and in lockstep waits
//! until it has, so that everybody sees the same on every run (docs/faults.md, "Fault scripts").

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::fault_file::{Action, FaultScript, TriggerState};
use bus::page::FaultStep;
use bus::sample::{Feedback, Job, Participant};
use bus::tamper;

/// One thing that the launcher is to do.
#[derive(Debug, Clone, Copy)]
struct Due {
    scan: u64,
    index: usize,
    step: FaultStep,
}

/// A script on its way.
#[derive(Debug)]
pub struct FaultDesk {
    script: FaultScript,
    triggers: TriggerState,
    /// What is still to be done, in no order; room for all of it from the start.
    agenda: Vec<Due>,
    /// Scan in which each fault fired.
    fired: Vec<Option<u64>>,
}

impl FaultDesk {
    /// For a script whose blocks are resolved. What `fired` says has fired under another machine side, before `first_scan`,
    /// is gone on with.
    pub fn new(
        script: FaultScript,
        fired: impl Fn(usize) -> Option<u64>,
        first_scan: u64,
    ) -> FaultDesk {
        let fired: Vec<Option<u64>> = (0..script.faults.len()).map(fired).collect();
        let mut agenda = Vec::with_capacity(3 * script.faults.len());
        for (index, fired) in fired.iter().enumerate() {
            if let Some(fired) = *fired {
                plan(&script, &mut agenda, index, fired);
            }
        }
        // What killed the machine side before this one, and what came before it in the same scan, is done. Who was to be
        // continued after the feedback of that scan still waits for it.
        let killer = script
            .faults
            .iter()
            .zip(&fired)
            .rposition(|(fault, fired)| fault.job == Job::Machine && *fired == Some(first_scan));
        agenda.retain(|due| {
            let before = due.step != FaultStep::Continue && due.scan == first_scan;
            let done = before && killer.is_some_and(|k| due.index <= k);
            due.scan >= first_scan && !done
        });
        FaultDesk {
            triggers: TriggerState::new(&script),
            script,
            agenda,
            fired,
        }
    }

    /// The script.
    pub fn script(&self) -> &FaultScript {
        &self.script
    }

    /// Scan in which a fault fired.
    pub fn fired(&self, index: usize) -> Option<u64> {
        self.fired.get(index).copied().flatten()
    }

    /// Notes which faults fire in the scan of this feedback, before it is said, and hands them to `tell`.
    pub fn look(&mut self, feedback: &Feedback, mut tell: impl FnMut(usize)) {
        let (script, agenda) = (&self.script, &mut self.agenda);
        let fired = std::cell::RefCell::new(&mut self.fired);
        self.triggers.due(
            feedback,
            |index| fired.borrow().get(index).is_some_and(Option::is_some),
            |index| {
                if let Some(place) = fired.borrow_mut().get_mut(index) {
                    *place = Some(feedback.scan);
                }
                plan(script, agenda, index, feedback.scan);
                tell(index);
            },
        );
    }

    /// Takes the next thing to be done in `scan`, before its feedback is said or, once it is, after it: a process that
    /// goes on is to find the newest feedback.
    pub fn next(&mut self, scan: u64, said: bool) -> Option<(usize, FaultStep)> {
        let place = self
            .agenda
            .iter()
            .position(|due| due.scan <= scan && (due.step == FaultStep::Continue) == said)?;
        let due = self.agenda.remove(place);
        Some((due.index, due.step))
    }

    /// Whether an answer that counts will not come from this participant in this scan, as the script wants it.
    pub fn excuses(&self, place: &Participant, scan: u64) -> bool {
        let fired = |index: usize| self.fired(index);
        Job::from_wire(place.job).is_some_and(|job| {
            tamper::excuses(&self.script, fired, job, place.axis, place.role, scan)
        })
    }
}

/// Writes down what is to be done about a fault that has fired.
fn plan(script: &FaultScript, agenda: &mut Vec<Due>, index: usize, fired: u64) {
    let Some(fault) = script.faults.get(index) else {
        return;
    };
    let mut later = |step: FaultStep, after: u64| {
        agenda.push(Due {
            scan: fired.saturating_add(after),
            index,
            step,
        });
    };
    match fault.action {
        Action::Kill {
            restart_after_scans,
        } => {
            later(FaultStep::Kill, 0);
            later(FaultStep::Restart, restart_after_scans);
        }
        Action::Stop { scans } => {
            later(FaultStep::Stop, 0);
            later(FaultStep::Readmit, scans);
            later(FaultStep::Continue, scans);
        }
        Action::Drop { .. } | Action::Delay { .. } | Action::Corrupt { .. } => {}
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use super::*;
    use bus::fault_file::{Fault, RestartOverrides, Trigger};

    fn fault(scan: u64, job: Job, action: Action) -> Fault {
        Fault {
            at: Trigger::Scan(scan),
            job,
            axis: 0,
            role: 0,
            action,
            line: 1,
        }
    }

    #[test]
    fn a_process_due_to_go_on_in_the_scan_the_machine_side_dies_in_is_continued_by_the_next_one() {
        let kill = Action::Kill {
            restart_after_scans: 20,
        };
        let script = FaultScript {
            name: "faults.toml".into(),
            restart: RestartOverrides::default(),
            faults: vec![
                fault(100, Job::Servo, Action::Stop { scans: 30 }),
                fault(130, Job::Machine, kill),
            ],
        };
        let fired = |index| [100, 130].get(index).copied();
        let mut desk = FaultDesk::new(script, fired, 130);
        // The launcher says in the roster that it takes part, before the kill; it must not be waited for in vain.
        assert_eq!(desk.next(130, false), None);
        assert_eq!(desk.next(130, true), Some((0, FaultStep::Continue)));
    }
}
