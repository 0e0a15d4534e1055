//! `[restart]`: what follows when a process of the cell is lost (docs/reference/faults.md).

use bus::sample::Job;
use schemars::JsonSchema;
use serde::Deserialize;

/// After the loss of a process that moves the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AfterLoss {
    /// It is started again and the program goes on by itself.
    Resume,
    /// It is started again; the machine waits for `resume`.
    Wait,
    /// The run ends.
    End,
}

/// After the loss of an axis's standby.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AfterStandby {
    /// The program goes on; an alarm says so after a second.
    GoOn,
    /// The machine comes to rest on the path, in hold, once for each loss; `resume` goes on.
    Hold,
}

/// After the loss of the master: its drives are off, so nothing ever moves by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AfterMaster {
    /// It is started again; the machine waits for `enable` and `resume`.
    Wait,
    /// The run ends.
    End,
}

/// After the loss of the recorder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AfterMonitor {
    /// It is started again, with a new part of the log.
    Restart,
    /// The run goes on without.
    Leave,
}

/// What follows when a process is lost.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
pub struct Restart {
    /// The planner: the tool has come to rest on the path.
    #[schemars(extend("default" = "resume"))]
    pub planner: AfterLoss,
    /// A servo without a standby: the master has brought the axes to rest on the path. (With one, nothing stops, and a new
    /// standby is started.)
    #[schemars(extend("default" = "end"))]
    pub servo: AfterLoss,
    /// A standby: nothing stops, but the next loss would.
    #[schemars(extend("default" = "go-on"))]
    pub standby: AfterStandby,
    /// The master.
    #[schemars(extend("default" = "end"))]
    pub master: AfterMaster,
    /// The recorder.
    #[schemars(extend("default" = "restart"))]
    pub monitor: AfterMonitor,
    /// So many restarts of one process within `within_s` are allowed; one more ends the run.
    #[schemars(extend("unit" = "restarts", "minimum" = 1, "maximum" = 1_000_000, "default" = 5))]
    pub restarts_max: u32,
    /// Time in which restarts are counted.
    #[schemars(extend("unit" = "s", "exclusiveMinimum" = 0, "maximum" = 86_400, "default" = 60.0))]
    pub within_s: f64,
}

impl Restart {
    /// The same for a cell that stays up: where a run would end, the process is started again and the machine waits.
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
            // Its drives have stopped by themselves, or its standby goes on.
            Job::Fieldbus | Job::Logic => true,
        }
    }
}
