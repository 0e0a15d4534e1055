//! Fault scripts: which process is killed, stopped or made to lie, and when, so that a run with faults repeats to the bit.
//!
//! ```toml
//! seed = 7                    # of random times; 0 if absent
//!
//! [restart]                   # in place of the machine file's own for this run, key by key
//! planner = "resume"          # resume | wait | end
//! servo = "wait"              # resume | wait | end
//! master = "wait"       # wait | end
//! monitor = "restart"         # restart | leave
//! restarts_max = 400
//! within_s = 60.0
//!
//! [[fault]]
//! at = { scan = 900 }         # the scan whose feedback is about to be published
//! process = "planner"         # planner | servo-X (its role a) | servo-X/b | plant-sim | monitor
//! do = "kill"                 # kill | stop | drop | delay | corrupt
//! restart_after_scans = 30    # kill: its replacement takes part so many scans later; 20 if absent
//! repeat = { times = 200, every_scans = 37 }   # with a scan only: so many faults
//!
//! [[fault]]
//! at = { block = 12 }         # when the first element at or after this line of the program is under way
//! process = "servo-X"
//! do = "stop"
//! scans = 40                  # until it is continued
//!
//! [[fault]]
//! at = { element = 3 }        # when this element of the path is under way (or a later one)
//! process = "planner"
//! do = "drop"
//! scans = 16                  # so many scans long, from the one it fires in; 1 if absent
//!
//! [[fault]]
//! at = { reversal = 2, axis = "X" }   # at the second reversal of the axis's command
//! process = "servo-X"
//! do = "delay"
//! late_scans = 2              # 1 to 8
//!
//! [[fault]]
//! at = { random = [500, 4000] }   # one scan of these, by the seed
//! process = "servo-Y"
//! do = "corrupt"
//! what = "not-a-number"
//! ```
//!
//! With `field = "command.held.sequence"`, `corrupt` spoils one number of a sample: see [`Field`] and [`Spoil`]. Without, what can be
//! corrupted, see [`Corruption`]: `not-a-number`, `infinity`, `old-scan`, `future-scan`, `wrong-incarnation` and
//! `replay` of servo commands and of the planner's windows; `jump` and `wrong-axis` of servo commands; `checksum`,
//! `setpoint-jump` and `cut` of windows. The planner's windows are planned once an interpolation period: a fault of theirs that
//! is shorter may meet none.
//!
//! A fault fires once. Reversals are counted by the living master, from its own first scan on.

mod field;
mod reading;
#[cfg(test)]
mod tests;
mod trigger_state;

use bus::sample::{Feedback, Job, MAX_AXES};
use machine::settings_file::SettingsFileError;
use machine::{AfterLoss, AfterMaster, AfterMonitor, Process, Restart};
use serde::Deserialize;

pub use field::{Field, Sent, Spoil};
pub use reading::{load, parse};
pub use trigger_state::TriggerState;

/// The most faults of one script, each repetition counted.
pub use bus::signal_page::FAULTS_MAX;
/// Scans from a kill to its replacement's first, unless the script says otherwise.
pub const RESTART_AFTER_SCANS: u64 = 20;
/// The most scans a sample can be delayed by.
pub const LATE_SCANS_MAX: u64 = 8;
/// The last scan a fault can wait for: some weeks.
pub const FAULT_SCAN_MAX: u64 = 1_000_000_000;
/// The longest that one fault can last, in scans.
pub const FAULT_SCANS_MAX: u64 = 1_000_000;

/// What is to go wrong in a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FaultScript {
    /// Name of the file, for messages.
    pub name: String,
    /// What follows on a loss, where it differs from the machine file.
    pub restart: RestartOverrides,
    /// The faults in the order of the file, repetitions in a row; a fault's index names it between the processes.
    pub faults: Vec<Fault>,
}

/// One fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fault {
    /// When.
    pub at: Trigger,
    /// Whose.
    pub process: Process,
    /// What.
    pub action: Action,
    /// Line of the file it is in, for messages.
    pub line: u32,
}

/// When a fault fires.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trigger {
    /// In this scan.
    Scan(u64),
    /// In the first element at or after this line of the program: becomes [`Trigger::Element`] once the program is known
    /// ([`FaultScript::resolve_blocks`]), and fires never before.
    Block(u32),
    /// In the first scan that executes this element of the path, or one beyond.
    Element(u32),
    /// In the scan in which the command of an axis is seen to have reversed.
    Reversal {
        /// Index of the axis.
        axis: usize,
        /// Which of its reversals, from 1.
        count: u32,
    },
}

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// The process is killed.
    Kill {
        /// Scans until its replacement takes part.
        restart_after_scans: u64,
    },
    /// The process is stopped (it lives and does nothing).
    Stop {
        /// Scans until it is continued.
        scans: u64,
    },
    /// Its samples are not sent.
    Drop {
        /// For so many scans.
        scans: u64,
    },
    /// Its samples are sent late.
    Delay {
        /// For so many scans.
        scans: u64,
        /// By so many.
        late_scans: u64,
    },
    /// Its samples are wrong.
    Corrupt {
        /// For so many scans.
        scans: u64,
        /// How.
        what: Corruption,
    },
    /// One number of its samples is wrong.
    Spoil {
        /// For so many scans.
        scans: u64,
        /// Which.
        field: Field,
        /// How.
        how: Spoil,
    },
}

impl Action {
    /// Whether it is about what a process sends, not about the process.
    pub fn is_of_samples(self) -> bool {
        !matches!(self, Action::Kill { .. } | Action::Stop { .. })
    }
}

/// How a sample is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Corruption {
    /// Speed and torque are not numbers; in a window, the first setpoint's place on the path.
    NotANumber,
    /// The same, infinite.
    Infinity,
    /// The position is 10⁹ increments off, the speed a thousandfold.
    Jump,
    /// The scan is 3 less; of a window, its first.
    OldScan,
    /// The scan is 3 more; of a window, its first.
    FutureScan,
    /// It is never visible: its `visible_from` is far ahead.
    NeverVisible,
    /// The axis is the next one.
    WrongAxis,
    /// The incarnation is one more.
    WrongIncarnation,
    /// The sample before once more.
    Replay,
    /// One bit of the checksum is wrong.
    Checksum,
    /// A setpoint in the middle is 10⁶ increments off on the first axis, under a right checksum.
    SetpointJump,
    /// Half of the setpoints are missing.
    Cut,
}

impl Corruption {
    /// All of them.
    pub const ALL: [Corruption; 12] = [
        Corruption::NotANumber,
        Corruption::Infinity,
        Corruption::Jump,
        Corruption::OldScan,
        Corruption::FutureScan,
        Corruption::NeverVisible,
        Corruption::WrongAxis,
        Corruption::WrongIncarnation,
        Corruption::Replay,
        Corruption::Checksum,
        Corruption::SetpointJump,
        Corruption::Cut,
    ];

    /// The word in the file.
    pub fn word(self) -> &'static str {
        match self {
            Corruption::NotANumber => "not-a-number",
            Corruption::Infinity => "infinity",
            Corruption::Jump => "jump",
            Corruption::OldScan => "old-scan",
            Corruption::FutureScan => "future-scan",
            Corruption::NeverVisible => "never-visible",
            Corruption::WrongAxis => "wrong-axis",
            Corruption::WrongIncarnation => "wrong-incarnation",
            Corruption::Replay => "replay",
            Corruption::Checksum => "checksum",
            Corruption::SetpointJump => "setpoint-jump",
            Corruption::Cut => "cut",
        }
    }

    /// Whether what this job sends can be wrong in this way.
    pub fn befalls(self, job: Job) -> bool {
        match self {
            Corruption::Jump | Corruption::WrongAxis => job == Job::Servo,
            Corruption::Checksum | Corruption::SetpointJump | Corruption::Cut => {
                job == Job::Planner
            }
            _ => matches!(job, Job::Servo | Job::Planner),
        }
    }
}

/// The keys of `[restart]` that a script sets in place of the machine file's.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RestartOverrides {
    /// The planner.
    pub planner: Option<AfterLoss>,
    /// A servo.
    pub servo: Option<AfterLoss>,
    /// The master.
    pub master: Option<AfterMaster>,
    /// The recorder.
    pub monitor: Option<AfterMonitor>,
    /// Restarts of one process allowed within [`RestartOverrides::within_s`].
    pub restarts_max: Option<u32>,
    /// In s.
    pub within_s: Option<f64>,
}

impl RestartOverrides {
    /// Puts what is set here in place of what the machine file says.
    pub fn apply(&self, restart: &mut Restart) {
        restart.planner = self.planner.unwrap_or(restart.planner);
        restart.servo = self.servo.unwrap_or(restart.servo);
        restart.master = self.master.unwrap_or(restart.master);
        restart.monitor = self.monitor.unwrap_or(restart.monitor);
        restart.restarts_max = self.restarts_max.unwrap_or(restart.restarts_max);
        restart.within_s = self.within_s.unwrap_or(restart.within_s);
    }
}

impl FaultScript {
    /// Turns lines of the program into elements of its path: `element_from` gives the first element at or after a line.
    ///
    /// # Errors
    /// The program has none there: with file and line.
    pub fn resolve_blocks(
        &mut self,
        mut element_from: impl FnMut(u32) -> Option<u32>,
    ) -> Result<(), SettingsFileError> {
        let mut broken = Vec::new();
        for fault in &mut self.faults {
            let Trigger::Block(line) = fault.at else {
                continue;
            };
            match element_from(line) {
                Some(element) => fault.at = Trigger::Element(element),
                None => broken.push(format!(
                    "{}:{}: at.block = {line}: the program has no motion in this line or after it",
                    self.name, fault.line
                )),
            }
        }
        none_broken(broken)
    }
}

fn none_broken(broken: Vec<String>) -> Result<(), SettingsFileError> {
    match broken.is_empty() {
        true => Ok(()),
        false => Err(SettingsFileError::Broken(broken)),
    }
}
