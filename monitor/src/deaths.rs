//! Deaths of processes, as the launcher publishes them in the roster: one reading of it for the report, the black box and the scope.

use std::collections::{BTreeMap, VecDeque};

use bus::sample::{Participant, Roster};
use machine::{Machine, Process};

/// Deaths that wait to be asked for.
const DEATHS_MAX: usize = 64;

/// Scan, signal and exit status of a participant's last death; none if none died, or ended in order.
pub fn death_of(participant: &Participant) -> Option<(u64, i32, i32)> {
    let (signal, status) = (participant.death_signal, participant.death_status);
    let orderly = signal == 0 && status == 0;
    let died = participant.death_scan != u64::MAX && !orderly;
    died.then_some((participant.death_scan, signal, status))
}

/// The death of a process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Death {
    /// Its scan.
    pub scan: u64,
    /// Which process died.
    pub process: Process,
    /// Its name.
    pub name: String,
    /// What happened, in words.
    pub how: String,
}

/// Finds deaths in the roster: those in scans that have been seen, once each.
#[derive(Debug)]
pub struct Deaths {
    machine: Machine,
    first_scan: Option<u64>,
    known: BTreeMap<Process, u64>,
    new: VecDeque<Death>,
}

impl Deaths {
    /// Of the processes of a machine's cell.
    pub fn new(machine: &Machine) -> Deaths {
        Deaths {
            machine: machine.clone(),
            first_scan: None,
            known: BTreeMap::new(),
            new: VecDeque::new(),
        }
    }

    /// A scan is seen.
    pub fn scan(&mut self, scan: u64) {
        self.first_scan.get_or_insert(scan);
    }

    /// Takes who takes part.
    pub fn roster(&mut self, roster: &Roster) {
        for participant in &roster.participants {
            let death = Process::of(participant).zip(death_of(participant));
            let Some((process, (scan, signal, status))) = death else {
                continue;
            };
            let before = self.known.insert(process, scan);
            // What a first roster has of the time before is nobody's news.
            let seen = self.first_scan.is_some_and(|first| scan >= first);
            if before == Some(scan) || !seen || self.new.len() >= DEATHS_MAX {
                continue;
            }
            let name = process.name(&self.machine);
            let how = match signal {
                0 => format!("{name} ended with status {status}"),
                signal => format!("{name} killed by signal {signal}"),
            };
            self.new.push_back(Death {
                scan,
                process,
                name,
                how,
            });
        }
    }

    /// The next one that was not asked for yet.
    pub fn next_new(&mut self) -> Option<Death> {
        self.new.pop_front()
    }
}
