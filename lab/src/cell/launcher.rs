//! The launcher of a cell within one process: its rules about restarts are the real ones, its clock is that of the scans.

use std::time::Duration;

use bus::sample::Feedback;
use launcher::supervisor::{RestartRules, Verdict, goes_on_after_stop};
use machine::{Machine, Process};

/// A process that is started takes part so many scans later.
const STARTS_SCANS: u64 = 8;

/// Who decides about restarts, and orders a machine to stop that has lost what it needs.
#[derive(Debug)]
pub(crate) struct Launcher {
    rules: RestartRules,
    period: Duration,
    /// Places whose process is being started, and from when it takes part.
    joining: Vec<(usize, u64)>,
    /// A process is lost for good without which the run cannot go on.
    ends: bool,
    /// Incarnation of the master that was ordered to stop, and the scan of its answer.
    asked: Option<(u32, u64)>,
    /// Who was lost for good.
    lost: Vec<Process>,
}

impl Launcher {
    pub fn new(machine: &Machine) -> Launcher {
        Launcher {
            rules: RestartRules::new(machine),
            period: Duration::from_micros(machine.scan.period_us.into()),
            joining: Vec::new(),
            ends: false,
            asked: None,
            lost: Vec::new(),
        }
    }

    fn at(&self, scan: u64) -> Duration {
        self.period * u32::try_from(scan).unwrap_or(u32::MAX)
    }

    /// A process has died by itself in this scan; `covered` where another one does the same. Whether it is replaced.
    pub fn judge(&mut self, place: usize, process: Process, covered: bool, scan: u64) -> bool {
        let now = self.at(scan);
        self.joining.retain(|(joining, _)| *joining != place);
        match self.rules.judge(place, process, false, covered, now) {
            Verdict::Restarts => true,
            Verdict::GoesOn => {
                self.lost.push(process);
                false
            }
            Verdict::Ends => {
                self.lose(process);
                false
            }
        }
    }

    /// A process without which the run cannot go on is lost for good.
    pub fn lose(&mut self, process: Process) {
        self.lost.push(process);
        self.ends = true;
    }

    /// The next place whose process takes part from this scan on.
    pub fn take_joined(&mut self, scan: u64) -> Option<usize> {
        let now = self.at(scan);
        while let Some(place) = self.rules.take_due(now) {
            self.joining.push((place, scan + STARTS_SCANS));
        }
        let ready = self.joining.iter().position(|(_, from)| *from <= scan)?;
        Some(self.joining.swap_remove(ready).0)
    }

    /// The same of the master's place, which is waited for by all.
    pub fn take_master(&mut self, place: usize, scan: u64) {
        let _ = self.rules.take_due(self.at(scan));
        self.joining.retain(|(joining, _)| *joining != place);
    }

    /// Whether the master of this feedback is to be ordered to stop now; it answers at once.
    pub fn is_stop_due(&mut self, feedback: &Feedback) -> bool {
        let now = (feedback.incarnation, feedback.scan);
        let holds = self.asked.is_some_and(|(incarnation, answered)| {
            incarnation == now.0 && !goes_on_after_stop(answered, feedback)
        });
        if !self.ends || holds {
            return false;
        }
        self.asked = Some(now);
        true
    }

    /// Who was lost for good.
    pub fn lost(&self) -> &[Process] {
        &self.lost
    }
}
