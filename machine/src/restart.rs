//! `[restart]`: what follows when a process of the cell is lost (docs/reference/faults.md).

use serde::Deserialize;

use super::Machine;
use crate::settings_file::{From, Rules};
use bus::sample::Job;

/// After the loss of a process that moves the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AfterLoss {
    /// It is started anew and the program goes on by itself.
    Resume,
    /// It is started anew; the machine waits for `resume`.
    Wait,
    /// The run ends.
    End,
}

/// After the loss of the master: its drives are off, so nothing ever moves by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AfterMaster {
    /// It is started anew; the machine waits for `enable` and `resume`.
    Wait,
    /// The run ends.
    End,
}

/// After the loss of the recorder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AfterMonitor {
    /// It is started anew, with a new part of the log.
    Restart,
    /// The run goes on without.
    Leave,
}

/// What follows when a process is lost.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Restart {
    /// The planner: the tool has come to rest on the path.
    pub planner: AfterLoss,
    /// A servo without a standby: the axes have braked together and left the path. (With one, nothing stops; a new standby is
    /// started unless this says `end`.)
    pub servo: AfterLoss,
    /// The master.
    pub master: AfterMaster,
    /// The recorder.
    pub monitor: AfterMonitor,
    /// So many restarts of one process within [`Restart::within_s`] are allowed; one more ends the run.
    pub restarts_max: u32,
    /// In s.
    pub within_s: f64,
}

impl Default for Restart {
    fn default() -> Self {
        Restart {
            planner: AfterLoss::Resume,
            servo: AfterLoss::End,
            master: AfterMaster::End,
            monitor: AfterMonitor::Restart,
            restarts_max: 5,
            within_s: 60.0,
        }
    }
}

impl Restart {
    /// The same for a cell that stays up: where a run would end, the process is started anew and the machine waits.
    pub fn of_staying(mut self) -> Restart {
        for after in [&mut self.planner, &mut self.servo] {
            if *after == AfterLoss::End {
                *after = AfterLoss::Wait;
            }
        }
        self.master = AfterMaster::Wait;
        self.monitor = AfterMonitor::Restart;
        self
    }

    /// Whether a lost process of this job is replaced; of a servo, `standby` says whether its axis has two.
    pub fn replaces(&self, job: Job, standby: bool) -> bool {
        match job {
            Job::Planner => self.planner != AfterLoss::End,
            Job::Servo => self.servo != AfterLoss::End || standby,
            Job::Master => self.master == AfterMaster::Wait,
            Job::Monitor => self.monitor == AfterMonitor::Restart,
        }
    }
}

pub(super) fn judge(rules: &mut Rules, machine: &Machine) {
    let restart = &machine.restart;
    rules.range(
        &["restart", "restarts_max"],
        None,
        restart.restarts_max.into(),
        "restarts",
        From::AtLeast(1.0),
        1_000_000.0,
    );
    rules.range(
        &["restart", "within_s"],
        None,
        restart.within_s,
        "s",
        From::Above(0.0),
        86_400.0,
    );
}
