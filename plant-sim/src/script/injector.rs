//! The master's part of a fault script: it sees when a fault is due, has the launcher act, and in lockstep waits
//! until it has, so that everybody sees the same on every run (docs/reference/fault-scripts.md).

use super::faults::{Action, FaultScript, TriggerState};
use super::reach;
use bus::sample::{Feedback, Job, Participant};
use bus::signal_page::FaultStep;
use machine::Process;

/// One thing that the launcher is to do.
#[derive(Debug, Clone, Copy)]
struct Due {
    scan: u64,
    index: usize,
    step: FaultStep,
}

/// A script on its way.
#[derive(Debug)]
pub struct FaultInjector {
    script: FaultScript,
    triggers: TriggerState,
    /// What is still to be done, in no order; room for all of it from the start.
    agenda: Vec<Due>,
    /// Scan in which each fault fired.
    fired: Vec<Option<u64>>,
}

impl FaultInjector {
    /// For a script whose blocks are resolved. What `fired` says has fired under another master, before `first_scan`,
    /// is gone on with.
    pub fn new(
        script: FaultScript,
        fired: impl Fn(usize) -> Option<u64>,
        first_scan: u64,
    ) -> FaultInjector {
        let fired: Vec<Option<u64>> = (0..script.faults.len()).map(fired).collect();
        let mut agenda = Vec::with_capacity(3 * script.faults.len());
        for (index, fired) in fired.iter().enumerate() {
            if let Some(fired) = *fired {
                plan(&script, &mut agenda, index, fired);
            }
        }
        // What killed the master before this one, and what came before it in the same scan, is done. Who was to be
        // continued after the feedback of that scan still waits for it.
        let killer = script
            .faults
            .iter()
            .zip(&fired)
            .rposition(|(fault, fired)| {
                fault.process.job == Job::Master && *fired == Some(first_scan)
            });
        agenda.retain(|due| {
            let before = due.step != FaultStep::Continue && due.scan == first_scan;
            let done = before && killer.is_some_and(|k| due.index <= k);
            due.scan >= first_scan && !done
        });
        FaultInjector {
            triggers: TriggerState::new(&script),
            script,
            agenda,
            fired,
        }
    }

    /// Scan in which a fault fired.
    pub fn fired(&self, index: usize) -> Option<u64> {
        self.fired.get(index).copied().flatten()
    }

    /// Notes which faults fire in the scan of this feedback, before it is published, and hands them to `tell`.
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

    /// Takes the next thing to be done in `scan`, before its feedback is published or, once it is, after it: a process that
    /// goes on is to find the newest feedback.
    pub fn next(&mut self, scan: u64, published: bool) -> Option<(usize, FaultStep)> {
        let place = self
            .agenda
            .iter()
            .position(|due| due.scan <= scan && (due.step == FaultStep::Continue) == published)?;
        let due = self.agenda.remove(place);
        Some((due.index, due.step))
    }

    /// Whether an answer that counts will not come from this participant in this scan, as the script wants it.
    pub fn excuses(&self, place: &Participant, scan: u64) -> bool {
        let fired = |index: usize| self.fired(index);
        Process::of(place).is_some_and(|process| reach::excuses(&self.script, fired, process, scan))
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
        Action::Drop { .. }
        | Action::Delay { .. }
        | Action::Corrupt { .. }
        | Action::Spoil { .. } => {}
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use super::*;
    use crate::script::faults::{Fault, RestartOverrides, Trigger};

    fn fault(scan: u64, job: Job, action: Action) -> Fault {
        Fault {
            at: Trigger::Scan(scan),
            process: job.into(),
            action,
            line: 1,
        }
    }

    fn script(faults: Vec<Fault>) -> FaultScript {
        FaultScript {
            name: "faults.toml".into(),
            restart: RestartOverrides::default(),
            faults,
        }
    }

    fn feedback(scan: u64) -> Feedback {
        Feedback {
            scan,
            ..bytemuck::Zeroable::zeroed()
        }
    }

    /// All that is done in a scan: before its feedback is published, and after.
    fn done_in(injector: &mut FaultInjector, scan: u64) -> [Vec<(usize, FaultStep)>; 2] {
        let mut reported = Vec::new();
        injector.look(&feedback(scan), |index| reported.push(index));
        for index in reported {
            assert_eq!(injector.fired(index), Some(scan));
        }
        [false, true]
            .map(|published| std::iter::from_fn(|| injector.next(scan, published)).collect())
    }

    #[test]
    fn a_kill_is_done_in_its_scan_and_the_replacement_comes_so_many_scans_later() {
        let kill = Action::Kill {
            restart_after_scans: 3,
        };
        let mut injector =
            FaultInjector::new(script(vec![fault(5, Job::Planner, kill)]), |_| None, 0);
        for scan in 0..20 {
            let expected = match scan {
                5 => vec![(0, FaultStep::Kill)],
                8 => vec![(0, FaultStep::Restart)],
                _ => vec![],
            };
            assert_eq!(
                done_in(&mut injector, scan),
                [expected, vec![]],
                "scan {scan}"
            );
            assert_eq!(injector.fired(0), (scan >= 5).then_some(5));
        }
        assert_eq!(injector.fired(1), None);
        assert_eq!(injector.script.faults.len(), 1);
    }

    #[test]
    fn who_was_stopped_is_awaited_from_a_scan_on_and_continued_once_its_feedback_is_published() {
        let stop = Action::Stop { scans: 2 };
        let mut injector =
            FaultInjector::new(script(vec![fault(4, Job::Servo, stop)]), |_| None, 0);
        assert_eq!(
            done_in(&mut injector, 4),
            [vec![(0, FaultStep::Stop)], vec![]]
        );
        assert_eq!(done_in(&mut injector, 5), [vec![], vec![]]);
        assert_eq!(
            done_in(&mut injector, 6),
            [
                vec![(0, FaultStep::Readmit)],
                vec![(0, FaultStep::Continue)]
            ]
        );
        assert_eq!(done_in(&mut injector, 7), [vec![], vec![]]);
    }

    #[test]
    fn only_the_sender_whose_samples_are_lost_is_excused_and_only_while_they_are() {
        let drop = Action::Drop { scans: 2 };
        let mut injector =
            FaultInjector::new(script(vec![fault(4, Job::Servo, drop)]), |_| None, 0);
        let servo = |axis, job: u32| Participant {
            job,
            axis,
            ..bytemuck::Zeroable::zeroed()
        };
        for scan in 0..10 {
            assert_eq!(done_in(&mut injector, scan), [vec![], vec![]]);
            let excused = |axis, job| injector.excuses(&servo(axis, job), scan);
            assert_eq!(excused(0, Job::Servo as u32), scan == 4 || scan == 5);
            assert!(!excused(1, Job::Servo as u32));
            assert!(!excused(0, 77), "no such job");
        }
    }

    #[test]
    fn a_master_that_comes_later_does_what_is_left_and_nothing_twice() {
        let kill = Action::Kill {
            restart_after_scans: 10,
        };
        let faults = vec![
            fault(100, Job::Planner, kill),
            fault(105, Job::Master, kill),
            fault(105, Job::Monitor, kill),
        ];
        let fired = |index: usize| [100, 105, 105].get(index).copied();
        let mut injector = FaultInjector::new(script(faults), fired, 105);
        assert_eq!(
            done_in(&mut injector, 105),
            [vec![(2, FaultStep::Kill)], vec![]]
        );
        assert_eq!(
            done_in(&mut injector, 110),
            [vec![(0, FaultStep::Restart)], vec![]]
        );
    }

    #[test]
    fn a_process_due_to_go_on_in_the_scan_the_master_dies_in_is_continued_by_the_next_one() {
        let kill = Action::Kill {
            restart_after_scans: 20,
        };
        let script = FaultScript {
            name: "faults.toml".into(),
            restart: RestartOverrides::default(),
            faults: vec![
                fault(100, Job::Servo, Action::Stop { scans: 30 }),
                fault(130, Job::Master, kill),
            ],
        };
        let fired = |index| [100, 130].get(index).copied();
        let mut injector = FaultInjector::new(script, fired, 130);
        // The launcher says in the roster that it takes part, before the kill; it must not be waited for in vain.
        assert_eq!(injector.next(130, false), None);
        assert_eq!(injector.next(130, true), Some((0, FaultStep::Continue)));
    }
}
