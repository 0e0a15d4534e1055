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
//! at = { scan = 900 }         # the scan whose feedback is about to be said
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
//! What can be corrupted, see [`Corruption`]: `not-a-number`, `infinity`, `old-scan`, `future-scan`, `wrong-incarnation` and
//! `replay` of servo commands and of the planner's windows; `jump` and `wrong-axis` of servo commands; `checksum`,
//! `row-jump` and `cut` of windows. The planner's windows are planned once a distribution period: a fault of theirs that
//! is shorter may meet none.
//!
//! A fault fires once. Reversals are counted by the living master, from its own first scan on.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use std::cmp::Ordering;
use std::path::Path;

use serde::Deserialize;
use toml::Spanned;

use crate::script::rng::Rng;
use bus::sample::{Feedback, Job, MAX_AXES};
use machine::settings_file::{self, From, Rules, SettingsFileError, read_text};
use machine::{AfterLoss, AfterMaster, AfterMonitor, Machine, Process, Restart};

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
    /// Line of the file it stands in, for messages.
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
}

impl Action {
    /// Whether it is about what a process sends, not about the process.
    pub fn is_of_samples(self) -> bool {
        match self {
            Action::Kill { .. } | Action::Stop { .. } => false,
            Action::Drop { .. } | Action::Delay { .. } | Action::Corrupt { .. } => true,
        }
    }
}

/// How a sample is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Corruption {
    /// Speed and torque are not numbers; in a window, the first row's place on the path.
    NotANumber,
    /// The same, infinite.
    Infinity,
    /// The position is 10⁹ increments off, the speed a thousandfold.
    Jump,
    /// The scan is 3 less; of a window, its first.
    OldScan,
    /// The scan is 3 more; of a window, its first.
    FutureScan,
    /// The axis is the next one.
    WrongAxis,
    /// The incarnation is one more.
    WrongIncarnation,
    /// The sample before once more.
    Replay,
    /// One bit of the checksum is wrong.
    Checksum,
    /// A row in the middle is 10⁶ increments off on the first axis, under a right checksum.
    RowJump,
    /// Half of the rows are missing.
    Cut,
}

impl Corruption {
    /// All of them.
    pub const ALL: [Corruption; 11] = [
        Corruption::NotANumber,
        Corruption::Infinity,
        Corruption::Jump,
        Corruption::OldScan,
        Corruption::FutureScan,
        Corruption::WrongAxis,
        Corruption::WrongIncarnation,
        Corruption::Replay,
        Corruption::Checksum,
        Corruption::RowJump,
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
            Corruption::WrongAxis => "wrong-axis",
            Corruption::WrongIncarnation => "wrong-incarnation",
            Corruption::Replay => "replay",
            Corruption::Checksum => "checksum",
            Corruption::RowJump => "row-jump",
            Corruption::Cut => "cut",
        }
    }

    /// Whether what this job sends can be wrong in this way.
    pub fn befalls(self, job: Job) -> bool {
        match self {
            Corruption::Jump | Corruption::WrongAxis => job == Job::Servo,
            Corruption::Checksum | Corruption::RowJump | Corruption::Cut => job == Job::Planner,
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

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    seed: u64,
    #[serde(default)]
    restart: RestartOverrides,
    #[serde(default)]
    fault: Vec<Entry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    at: Spanned<At>,
    process: Spanned<String>,
    #[serde(rename = "do")]
    action: Spanned<String>,
    restart_after_scans: Option<Spanned<u64>>,
    scans: Option<Spanned<u64>>,
    late_scans: Option<Spanned<u64>>,
    what: Option<Spanned<String>>,
    repeat: Option<Spanned<Repeat>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct At {
    scan: Option<u64>,
    block: Option<u32>,
    element: Option<u32>,
    reversal: Option<u32>,
    axis: Option<String>,
    random: Option<[u64; 2]>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct Repeat {
    times: u64,
    every_scans: u64,
}

/// Reads and checks a fault script for a machine.
///
/// # Errors
/// Unreadable, not TOML, unknown key, process, axis or word, a key too many or missing, a value out of its range, or more
/// than [`FAULTS_MAX`] faults: with file, line and what would be right.
pub fn load(path: &Path, machine: &Machine) -> Result<FaultScript, SettingsFileError> {
    parse(&path.display().to_string(), &read_text(path)?, machine)
}

/// Checks the text of such a file; `name` stands in the messages.
///
/// # Errors
/// As [`load`].
pub fn parse(name: &str, text: &str, machine: &Machine) -> Result<FaultScript, SettingsFileError> {
    let file: File = settings_file::parse(name, text)?;
    judge_restart(Rules::of(name, text), &file.restart)?;
    let mut broken = Vec::new();
    let mut faults: Vec<Fault> = Vec::new();
    for (index, entry) in file.fault.iter().enumerate() {
        let made = Reading {
            name,
            text,
            machine,
            number: index + 1,
            seed: file.seed,
        }
        .entry(entry, FAULTS_MAX - faults.len());
        match made {
            Ok(more) => faults.extend(more),
            Err(what) => broken.push(what),
        }
    }
    if broken.is_empty() {
        Ok(FaultScript {
            name: name.into(),
            restart: file.restart,
            faults,
        })
    } else {
        Err(SettingsFileError::Broken(broken))
    }
}

fn judge_restart(
    mut rules: Rules<'_>,
    restart: &RestartOverrides,
) -> Result<(), SettingsFileError> {
    if let Some(most) = restart.restarts_max {
        rules.between(
            &["restart", "restarts_max"],
            None,
            most.into(),
            "restarts",
            1.0,
            1e6,
        );
    }
    if let Some(within) = restart.within_s {
        rules.range(
            &["restart", "within_s"],
            None,
            within,
            "s",
            From::Above(0.0),
            86_400.0,
        );
    }
    rules.judge()
}

/// One `[[fault]]` being read.
struct Reading<'a> {
    name: &'a str,
    text: &'a str,
    machine: &'a Machine,
    /// From 1.
    number: usize,
    seed: u64,
}

impl Reading<'_> {
    fn line<T>(&self, place: &Spanned<T>) -> usize {
        let before = self.text.get(..place.span().start).unwrap_or("");
        before.matches('\n').count() + 1
    }

    /// What is wrong with the value at `place`.
    fn wrong<T>(&self, place: &Spanned<T>, what: &str) -> String {
        let (name, line, number) = (self.name, self.line(place), self.number);
        format!("{name}:{line}: fault {number} {what}")
    }

    fn entry(&self, entry: &Entry, room: usize) -> Result<Vec<Fault>, String> {
        let name = entry.process.get_ref();
        let process = Process::parse(name, self.machine)
            .map_err(|what| self.wrong(&entry.process, &format!("process = {name:?}: {what}")))?;
        let fault = Fault {
            at: self.trigger(&entry.at)?,
            process,
            action: self.action(entry, process.job)?,
            line: self.line(&entry.process) as u32,
        };
        let scans = match &entry.repeat {
            None => vec![fault.at],
            Some(repeat) => self.repeated(repeat, fault.at, entry)?,
        };
        if scans.len() > room {
            let what = format!(
                "makes more than {FAULTS_MAX} in all, repetitions counted: must be at most that many"
            );
            return Err(self.wrong(&entry.process, &what));
        }
        Ok(scans.into_iter().map(|at| Fault { at, ..fault }).collect())
    }

    fn trigger(&self, place: &Spanned<At>) -> Result<Trigger, String> {
        let at = place.get_ref();
        let within = |key: &str, value: u64, low: u64, high: u64| {
            if (low..=high).contains(&value) {
                Ok(value)
            } else {
                let what = format!("at.{key} = {value}: must be at least {low} and at most {high}");
                Err(self.wrong(place, &what))
            }
        };
        if at.axis.is_some() != at.reversal.is_some() {
            let what = "at: reversal and axis go together, as in { reversal = 2, axis = \"X\" }";
            return Err(self.wrong(place, what));
        }
        // No element has the number that stands for none.
        let element_max = u64::from(u32::MAX) - 1;
        Ok(
            match (at.scan, at.block, at.element, at.reversal, at.random) {
                (Some(scan), None, None, None, None) => {
                    Trigger::Scan(within("scan", scan, 0, FAULT_SCAN_MAX)?)
                }
                (None, Some(line), None, None, None) => {
                    within("block", line.into(), 1, u32::MAX.into())?;
                    Trigger::Block(line)
                }
                (None, None, Some(element), None, None) => {
                    within("element", element.into(), 0, element_max)?;
                    Trigger::Element(element)
                }
                (None, None, None, Some(count), None) => {
                    within("reversal", count.into(), 1, u32::MAX.into())?;
                    let letter = at.axis.as_deref().unwrap_or_default();
                    let axis = self
                        .machine
                        .axis_index(letter)
                        .map_err(|what| self.wrong(place, &format!("at: {what}")))?;
                    Trigger::Reversal {
                        axis: axis as usize,
                        count,
                    }
                }
                (None, None, None, None, Some([first, last])) => {
                    within("random", last, 0, FAULT_SCAN_MAX)?;
                    if first > last {
                        let what = format!(
                            "at.random = [{first}, {last}]: the first scan must be at most the last"
                        );
                        return Err(self.wrong(place, &what));
                    }
                    let index = self.number as u64 - 1;
                    Trigger::Scan(random_scan(self.seed, index, first, last))
                }
                _ => {
                    let what =
                        "at: must have exactly one of scan, block, element, reversal, random";
                    return Err(self.wrong(place, what));
                }
            },
        )
    }

    fn action(&self, entry: &Entry, job: Job) -> Result<Action, String> {
        let word = entry.action.get_ref().as_str();
        // Whether the action has the key: it must, it may, or it must not.
        let (restart_after_scans, scans, late_scans, what) = match word {
            "kill" => (May, MustNot, MustNot, MustNot),
            "stop" => (MustNot, Must, MustNot, MustNot),
            "drop" => (MustNot, May, MustNot, MustNot),
            "delay" => (MustNot, May, Must, MustNot),
            "corrupt" => (MustNot, May, MustNot, Must),
            other => {
                let what =
                    format!("do = {other:?}: must be one of kill, stop, drop, delay, corrupt");
                return Err(self.wrong(&entry.action, &what));
            }
        };
        let restart_after_scans = self.number_of(
            entry,
            "restart_after_scans",
            &entry.restart_after_scans,
            restart_after_scans,
            FAULT_SCANS_MAX,
        )?;
        let scans = self.number_of(entry, "scans", &entry.scans, scans, FAULT_SCANS_MAX)?;
        let late_scans = self.number_of(
            entry,
            "late_scans",
            &entry.late_scans,
            late_scans,
            LATE_SCANS_MAX,
        )?;
        self.has_it("what", entry, &entry.what, what)?;
        if !matches!(word, "kill" | "stop") && !matches!(job, Job::Servo | Job::Planner) {
            let process = entry.process.get_ref();
            let what = format!(
                "do = {word:?}: {process} can only be killed or stopped; samples of the planner and of servos can be dropped, delayed or corrupted"
            );
            return Err(self.wrong(&entry.action, &what));
        }
        if word == "stop" && job == Job::Master {
            let what = "do = \"stop\": nobody counts scans while plant-sim is stopped, so nobody would say when it goes on: kill it";
            return Err(self.wrong(&entry.action, what));
        }
        let scans = scans.unwrap_or(1);
        Ok(match word {
            "kill" => Action::Kill {
                restart_after_scans: restart_after_scans.unwrap_or(RESTART_AFTER_SCANS),
            },
            "stop" => Action::Stop { scans },
            "drop" => Action::Drop { scans },
            "delay" => Action::Delay {
                scans,
                late_scans: late_scans.unwrap_or(1),
            },
            _ => Action::Corrupt {
                scans,
                what: self.corruption(entry, job)?,
            },
        })
    }

    fn corruption(&self, entry: &Entry, job: Job) -> Result<Corruption, String> {
        let word = entry.what.as_ref().map_or("", |what| what.get_ref());
        let known = Corruption::ALL.into_iter().filter(|c| c.befalls(job));
        known.clone().find(|c| c.word() == word).ok_or_else(|| {
            let known: Vec<&str> = known.map(Corruption::word).collect();
            let what = format!(
                "what = {word:?}: of {} it must be one of {}",
                entry.process.get_ref(),
                known.join(", ")
            );
            match &entry.what {
                Some(place) => self.wrong(place, &what),
                None => self.wrong(&entry.action, &what),
            }
        })
    }

    fn has_it<T>(
        &self,
        key: &str,
        entry: &Entry,
        value: &Option<Spanned<T>>,
        may: Key,
    ) -> Result<(), String> {
        let word = entry.action.get_ref();
        match (value, may) {
            (None, Must) => Err(self.wrong(&entry.action, &format!("{word} needs {key}"))),
            (Some(place), MustNot) => Err(self.wrong(place, &format!("{word} has no {key}"))),
            _ => Ok(()),
        }
    }

    fn number_of(
        &self,
        entry: &Entry,
        key: &str,
        value: &Option<Spanned<u64>>,
        may: Key,
        most: u64,
    ) -> Result<Option<u64>, String> {
        self.has_it(key, entry, value, may)?;
        let Some(place) = value else { return Ok(None) };
        let number = *place.get_ref();
        if (1..=most).contains(&number) {
            Ok(Some(number))
        } else {
            let what = format!("{key} = {number} scans: must be at least 1 and at most {most}");
            Err(self.wrong(place, &what))
        }
    }

    fn repeated(
        &self,
        place: &Spanned<Repeat>,
        first: Trigger,
        entry: &Entry,
    ) -> Result<Vec<Trigger>, String> {
        let Repeat { times, every_scans } = *place.get_ref();
        let (Trigger::Scan(first), true) = (first, entry.at.get_ref().scan.is_some()) else {
            return Err(self.wrong(place, "repeat: goes with at = { scan = … } only"));
        };
        for (key, value, most) in [
            ("times", times, FAULTS_MAX as u64),
            ("every_scans", every_scans, FAULT_SCANS_MAX),
        ] {
            if !(1..=most).contains(&value) {
                let what = format!("repeat.{key} = {value}: must be at least 1 and at most {most}");
                return Err(self.wrong(place, &what));
            }
        }
        Ok((0..times)
            .map(|n| Trigger::Scan(first + n * every_scans))
            .collect())
    }
}

#[derive(Debug, Clone, Copy)]
enum Key {
    Must,
    May,
    MustNot,
}
use Key::{May, Must, MustNot};

/// The scan of `first..=last` that the seed gives the fault of this index.
fn random_scan(seed: u64, index: u64, first: u64, last: u64) -> u64 {
    Rng::after(seed, index).within(first, last)
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
        if broken.is_empty() {
            Ok(())
        } else {
            Err(SettingsFileError::Broken(broken))
        }
    }
}

/// What the triggers of a script have seen so far: fed with every feedback before it is said.
#[derive(Debug, Clone)]
pub struct TriggerState {
    triggers: Vec<Trigger>,
    axes: [AxisTurns; MAX_AXES],
}

/// Reversals of one axis's command.
#[derive(Debug, Clone, Copy, Default)]
struct AxisTurns {
    register: Option<i64>,
    /// Of the last motion; none before the first.
    direction: Option<Ordering>,
    reversals: u32,
}

impl AxisTurns {
    fn take(&mut self, register: i64) {
        let Some(before) = self.register.replace(register) else {
            return;
        };
        let direction = register.cmp(&before);
        if direction == Ordering::Equal {
            return;
        }
        let last = self.direction.replace(direction);
        if last.is_some_and(|last| last != direction) {
            self.reversals = self.reversals.saturating_add(1);
        }
    }
}

impl TriggerState {
    /// For the triggers of this script, its blocks resolved.
    pub fn new(script: &FaultScript) -> TriggerState {
        TriggerState {
            triggers: script.faults.iter().map(|fault| fault.at).collect(),
            axes: [AxisTurns::default(); MAX_AXES],
        }
    }

    /// Hands `fire` the index of each fault that is due in the scan of this feedback and has not `fired`, in the order of
    /// the script. Each feedback once: reversals are counted from one to the next.
    pub fn due(
        &mut self,
        feedback: &Feedback,
        fired: impl Fn(usize) -> bool,
        mut fire: impl FnMut(usize),
    ) {
        for (turns, axis) in self.axes.iter_mut().zip(feedback.axes()) {
            turns.take(axis.command_register);
        }
        for (index, trigger) in self.triggers.iter().enumerate() {
            if self.holds(*trigger, feedback) && !fired(index) {
                fire(index);
            }
        }
    }

    fn holds(&self, trigger: Trigger, feedback: &Feedback) -> bool {
        match trigger {
            Trigger::Scan(scan) => feedback.scan >= scan,
            Trigger::Block(_) => false,
            Trigger::Element(element) => {
                let on_path = !feedback.window.is_none() && !feedback.tag.is_off_path();
                on_path && feedback.tag.element >= element
            }
            Trigger::Reversal { axis, count } => self
                .axes
                .get(axis)
                .is_some_and(|turns| turns.reversals >= count),
        }
    }
}

#[cfg(test)]
#[allow(clippy::expect_used)]
mod tests {
    use super::*;
    use bus::sample::{PathTag, WindowId};
    use bytemuck::Zeroable;

    fn read(text: &str) -> Result<FaultScript, String> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        let mut machine = Machine::load(&folder).expect("the machine");
        machine.axes.first_mut().expect("an axis").standby = true;
        parse("faults.toml", text, &machine).map_err(|e| e.to_string())
    }

    fn feedback(scan: u64, registers: [i64; 2]) -> Feedback {
        let mut feedback = Feedback::zeroed();
        feedback.scan = scan;
        feedback.axis_count = 2;
        for (axis, register) in feedback.axes.iter_mut().zip(registers) {
            axis.command_register = register;
        }
        feedback
    }

    /// Index and scan of what fires, fed with these feedbacks.
    fn fires(script: &FaultScript, feedbacks: &[Feedback]) -> Vec<(usize, u64)> {
        let mut state = TriggerState::new(script);
        let mut fired = Vec::new();
        for feedback in feedbacks {
            let before = fired.clone();
            let has_fired = |index| before.iter().any(|(i, _)| *i == index);
            state.due(feedback, has_fired, |index| {
                fired.push((index, feedback.scan));
            });
        }
        fired
    }

    fn faults(text: &str) -> Vec<(Trigger, Process, Action)> {
        let script = read(text).expect("a script");
        let parts = |f: &Fault| (f.at, f.process, f.action);
        script.faults.iter().map(parts).collect()
    }

    /// The file of the module's documentation.
    fn documented() -> String {
        let lines = include_str!("faults.rs").lines();
        let inside = lines
            .skip_while(|line| !line.contains("```toml"))
            .skip(1)
            .take_while(|line| !line.contains("```"));
        let lines: Vec<&str> = inside
            .map(|line| line.trim_start_matches("//!").trim_start())
            .collect();
        lines.join("\n")
    }

    #[test]
    fn the_file_in_the_documentation_says_what_it_says_there() {
        let text = documented();
        let script = read(&text).expect("the documented script");
        let restart = RestartOverrides {
            planner: Some(AfterLoss::Resume),
            servo: Some(AfterLoss::Wait),
            master: Some(AfterMaster::Wait),
            monitor: Some(AfterMonitor::Restart),
            restarts_max: Some(400),
            within_s: Some(60.0),
        };
        assert_eq!(script.restart, restart);
        let found = faults(&text);
        assert_eq!(found.len(), 204);
        let kill = Action::Kill {
            restart_after_scans: 30,
        };
        for (n, fault) in (0..200).zip(&found) {
            let at = Trigger::Scan(900 + 37 * n);
            assert_eq!(fault, &(at, Job::Planner.into(), kill));
        }
        let others = [
            (
                Trigger::Block(12),
                Process::servo(0, 0),
                Action::Stop { scans: 40 },
            ),
            (
                Trigger::Element(3),
                Job::Planner.into(),
                Action::Drop { scans: 16 },
            ),
            (
                Trigger::Reversal { axis: 0, count: 2 },
                Process::servo(0, 0),
                Action::Delay {
                    scans: 1,
                    late_scans: 2,
                },
            ),
        ];
        assert_eq!(found.get(200..203), Some(others.as_slice()));
        let last = found.last().expect("the last");
        assert!(matches!(last.0, Trigger::Scan(500..=4000)), "{last:?}");
        let wrong = Action::Corrupt {
            scans: 1,
            what: Corruption::NotANumber,
        };
        assert_eq!((last.1, last.2), (Process::servo(1, 0), wrong));
    }

    #[test]
    fn roles_and_processes_are_found_by_their_names_and_a_kill_has_its_default() {
        for (name, process) in [
            ("planner", Job::Planner.into()),
            ("servo-Y", Process::servo(1, 0)),
            ("servo-Y/a", Process::servo(1, 0)),
            ("servo-X/b", Process::servo(0, 1)),
            ("servo-X-b", Process::servo(0, 1)),
            ("plant-sim", Job::Master.into()),
            ("monitor", Job::Monitor.into()),
        ] {
            let text =
                format!("[[fault]]\nat = {{ scan = 1 }}\nprocess = \"{name}\"\ndo = \"kill\"\n");
            let kill = Action::Kill {
                restart_after_scans: RESTART_AFTER_SCANS,
            };
            assert_eq!(faults(&text), [(Trigger::Scan(1), process, kill)], "{name}");
        }
        assert_eq!(read("").map(|script| script.faults.len()), Ok(0));
    }

    #[test]
    #[expect(clippy::too_many_lines, reason = "a table of refusals")]
    fn what_is_no_fault_is_refused_with_line_and_what_would_be_right() {
        let kill = "process = \"planner\"\ndo = \"kill\"";
        let scan = "at = { scan = 1 }";
        let servo = "at = { scan = 1 }\nprocess = \"servo-X\"";
        let planner = "at = { scan = 1 }\nprocess = \"planner\"";
        for (text, word) in [
            // When.
            (
                format!("at = {{}}\n{kill}"),
                "faults.toml:3: fault 1 at: must have exactly one of scan, block",
            ),
            (
                format!("at = {{ scan = 1, block = 2 }}\n{kill}"),
                "exactly one",
            ),
            (format!("at = {{ scan = -1 }}\n{kill}"), "faults.toml:3"),
            (
                format!("at = {{ scan = 1000000001 }}\n{kill}"),
                "at most 1000000000",
            ),
            (
                format!("at = {{ block = 0 }}\n{kill}"),
                "at.block = 0: must be at least 1",
            ),
            (
                format!("at = {{ element = 4294967295 }}\n{kill}"),
                "at most 4294967294",
            ),
            (
                format!("at = {{ reversal = 1 }}\n{kill}"),
                "reversal and axis go together",
            ),
            (
                format!("at = {{ scan = 1, axis = \"X\" }}\n{kill}"),
                "reversal and axis go together",
            ),
            (
                format!("at = {{ reversal = 0, axis = \"X\" }}\n{kill}"),
                "at least 1",
            ),
            (
                format!("at = {{ reversal = 1, axis = \"Q\" }}\n{kill}"),
                "it has X Y",
            ),
            (
                format!("at = {{ random = [9, 8] }}\n{kill}"),
                "at.random = [9, 8]",
            ),
            (format!("at = {{ when = 3 }}\n{kill}"), "unknown field"),
            // Who.
            (
                format!("{scan}\nprocess = \"plotter\"\ndo = \"kill\""),
                "faults.toml:4: fault 1 process = \"plotter\": must be planner, plant-sim",
            ),
            (
                format!("{scan}\nprocess = \"servo-Q\"\ndo = \"kill\""),
                "it has X Y",
            ),
            (
                format!("{scan}\nprocess = \"servo-X/c\"\ndo = \"kill\""),
                "must be a or b",
            ),
            (
                format!("{scan}\nprocess = \"servo-X/a/a\"\ndo = \"kill\""),
                "must be a or b",
            ),
            // What.
            (
                format!("{servo}\ndo = \"halt\""),
                "faults.toml:5: fault 1 do = \"halt\": must be one of kill, stop, drop, delay, corrupt",
            ),
            (format!("{servo}\ndo = \"stop\""), "stop needs scans"),
            (
                format!("{servo}\ndo = \"kill\"\nscans = 3"),
                "faults.toml:6: fault 1 kill has no scans",
            ),
            (
                format!("{servo}\ndo = \"drop\"\nrestart_after_scans = 3"),
                "drop has no restart_after_scans",
            ),
            (
                format!("{servo}\ndo = \"kill\"\nrestart_after_scans = 0"),
                "must be at least 1 and at most 1000000",
            ),
            (
                format!("{servo}\ndo = \"drop\"\nscans = 0"),
                "scans = 0 scans: must be at least 1",
            ),
            (format!("{servo}\ndo = \"delay\""), "delay needs late_scans"),
            (
                format!("{servo}\ndo = \"delay\"\nlate_scans = 9"),
                "at most 8",
            ),
            (
                format!("{servo}\ndo = \"drop\"\nlate_scans = 2"),
                "drop has no late_scans",
            ),
            (format!("{servo}\ndo = \"corrupt\""), "corrupt needs what"),
            (
                format!("{servo}\ndo = \"drop\"\nwhat = \"jump\""),
                "drop has no what",
            ),
            (
                format!("{servo}\ndo = \"corrupt\"\nwhat = \"cut\""),
                "of servo-X it must be one of not-a-number, infinity, jump",
            ),
            (
                format!("{planner}\ndo = \"corrupt\"\nwhat = \"wrong-axis\""),
                "of planner it must be one of",
            ),
            (
                format!("{scan}\nprocess = \"monitor\"\ndo = \"drop\""),
                "monitor can only be killed or stopped",
            ),
            (
                format!("{scan}\nprocess = \"plant-sim\"\ndo = \"corrupt\"\nwhat = \"jump\""),
                "plant-sim can only be",
            ),
            (
                format!("{scan}\nprocess = \"servo-Y/b\"\ndo = \"kill\""),
                "axis Y has no standby",
            ),
            (
                format!("{scan}\nprocess = \"plant-sim\"\ndo = \"stop\"\nscans = 3"),
                "nobody would say when it goes on",
            ),
            (
                format!("{servo}\ndo = \"kill\"\nloud = true"),
                "unknown field",
            ),
            // How often.
            (
                format!("at = {{ block = 2 }}\n{kill}\nrepeat = {{ times = 2, every_scans = 5 }}"),
                "repeat: goes with",
            ),
            (
                format!(
                    "at = {{ random = [1, 2] }}\n{kill}\nrepeat = {{ times = 2, every_scans = 5 }}"
                ),
                "repeat: goes with",
            ),
            (
                format!("{scan}\n{kill}\nrepeat = {{ times = 0, every_scans = 5 }}"),
                "repeat.times = 0",
            ),
            (
                format!("{scan}\n{kill}\nrepeat = {{ times = 1025, every_scans = 5 }}"),
                "at most 1024",
            ),
            (
                format!("{scan}\n{kill}\nrepeat = {{ times = 2, every_scans = 0 }}"),
                "repeat.every_scans = 0",
            ),
        ] {
            let error = read(&format!("seed = 1\n[[fault]]\n{text}\n")).expect_err(&text);
            assert!(error.contains(word), "{text}: {error}");
        }
        for (text, word) in [
            ("planner = \"restart\"", "faults.toml:2"),
            ("monitor = \"end\"", "unknown variant"),
            ("master = \"resume\"", "unknown variant"),
            ("restarts_max = 0", "faults.toml:2: restart.restarts_max"),
            ("within_s = 0.0", "must be above 0"),
            ("within_s = nan", "must be above 0"),
            ("after = 3", "unknown field"),
        ] {
            let error = read(&format!("[restart]\n{text}\n")).expect_err(text);
            assert!(error.contains(word), "{text}: {error}");
        }
    }

    #[test]
    fn every_broken_fault_is_named_in_its_own_line() {
        let good = "[[fault]]\nat = { scan = 1 }\nprocess = \"planner\"\ndo = \"kill\"\n";
        let bad = good.replace("planner", "nobody");
        let error = read(&format!("{good}{bad}{good}{bad}")).expect_err("two are broken");
        let lines: Vec<&str> = error.lines().collect();
        assert_eq!(lines.len(), 2, "{error}");
        for (line, start) in lines
            .iter()
            .zip(["faults.toml:7: fault 2 ", "faults.toml:15: fault 4 "])
        {
            assert!(line.starts_with(start), "{line}");
        }
    }

    #[test]
    fn repetitions_count_towards_the_most_faults_of_a_script() {
        let some = |times: u64| {
            format!(
                "[[fault]]\nat = {{ scan = 1 }}\nprocess = \"planner\"\ndo = \"kill\"\nrepeat = {{ times = {times}, every_scans = 1 }}\n"
            )
        };
        let full = read(&(some(1000) + &some(24))).expect("as many as there can be");
        assert_eq!(full.faults.len(), FAULTS_MAX);
        let error = read(&(some(1000) + &some(25))).expect_err("one too many");
        assert!(error.contains("faults.toml:8"), "{error}");
        assert!(error.contains("1024"), "{error}");
    }

    #[test]
    fn a_random_scan_is_the_same_for_a_seed_and_lies_in_its_range() {
        let script = |seed: u64| {
            let fault =
                "[[fault]]\nat = { random = [500, 520] }\nprocess = \"planner\"\ndo = \"kill\"\n";
            let text = format!("seed = {seed}\n{}", fault.repeat(300));
            faults(&text).iter().map(|f| f.0).collect::<Vec<_>>()
        };
        let found = script(7);
        assert_eq!(found, script(7));
        assert_ne!(found, script(8));
        for scan in 500..=520 {
            assert!(found.contains(&Trigger::Scan(scan)), "{scan} never comes");
        }
        let inside = |t: &Trigger| matches!(t, Trigger::Scan(500..=520));
        assert!(found.iter().all(inside));
        // Part of what a script means: another generator would move its faults.
        assert_eq!(random_scan(0, 0, 0, u64::MAX), 0xE220_A839_7B1D_CDAF);
        assert_eq!(random_scan(0, 1, 0, u64::MAX), 0x6E78_9E6A_A1B9_65F4);
        assert_eq!(random_scan(3, 0, 9, 9), 9);
    }

    #[test]
    fn a_block_becomes_the_first_element_at_or_after_its_line() {
        let text = "[[fault]]\nat = { block = 12 }\nprocess = \"planner\"\ndo = \"kill\"\n";
        let mut script = read(text).expect("a script");
        let on_path = |element| {
            let mut feedback = feedback(5, [0, 0]);
            feedback.window.sequence = 1;
            feedback.tag.element = element;
            feedback
        };
        assert_eq!(fires(&script, &[on_path(9)]), [], "not resolved yet");
        let lines = [3, 11, 14, 15];
        let element_from = |line| {
            let found = lines.iter().position(|l| *l >= line)?;
            Some(found as u32)
        };
        let error = script.clone().resolve_blocks(|_| None).expect_err("none");
        let words = "faults.toml:3: at.block = 12: the program has no motion";
        assert!(error.to_string().starts_with(words), "{error}");
        script.resolve_blocks(element_from).expect("element 2");
        assert_eq!(
            script.faults.first().map(|f| f.at),
            Some(Trigger::Element(2))
        );
        assert_eq!(fires(&script, &[on_path(1), on_path(3)]), [(0, 5)]);
    }

    #[test]
    fn a_fault_fires_once_at_its_scan_or_at_the_first_after_it() {
        let text = "[[fault]]\nat = { scan = 3 }\nprocess = \"planner\"\ndo = \"kill\"\n\
                    [[fault]]\nat = { scan = 2 }\nprocess = \"monitor\"\ndo = \"kill\"\n";
        let script = read(text).expect("a script");
        let in_turn: Vec<Feedback> = (0..6).map(|scan| feedback(scan, [0, 0])).collect();
        assert_eq!(fires(&script, &in_turn), [(1, 2), (0, 3)]);
        // A master that was started anew begins later, and what fired in its forerunner stays fired.
        let mut state = TriggerState::new(&script);
        let mut late = Vec::new();
        state.due(&feedback(40, [0, 0]), |index| index == 0, |i| late.push(i));
        assert_eq!(late, [1]);
    }

    #[test]
    fn an_element_is_under_way_only_where_a_window_of_the_path_is_executed() {
        let text = "[[fault]]\nat = { element = 0 }\nprocess = \"planner\"\ndo = \"kill\"\n";
        let script = read(text).expect("a script");
        let idle = feedback(1, [0, 0]);
        let mut returning = feedback(2, [0, 0]);
        returning.window = WindowId {
            checksum: 1,
            sequence: 1,
            incarnation: 1,
        };
        returning.tag = PathTag::OFF_PATH;
        let mut on_path = returning;
        on_path.scan = 3;
        on_path.tag.element = 0;
        assert_eq!(fires(&script, &[idle, returning, on_path]), [(0, 3)]);
    }

    #[test]
    fn a_reversal_is_counted_for_its_axis_where_the_motion_turns_and_standing_is_none() {
        let fault = |count: u32, axis: &str| {
            format!(
                "[[fault]]\nat = {{ reversal = {count}, axis = \"{axis}\" }}\nprocess = \"planner\"\ndo = \"kill\"\n"
            )
        };
        let text = [fault(1, "X"), fault(2, "X"), fault(1, "Y")].concat();
        let script = read(&text).expect("a script");
        let x = [0, 0, 5, 9, 9, 10, 10, 8, 7, 7, 6, 6, 8];
        let motion: Vec<Feedback> = x
            .iter()
            .zip(0..)
            .map(|(x, scan)| feedback(scan, [*x, scan as i64]))
            .collect();
        assert_eq!(fires(&script, &motion), [(0, 7), (1, 12)]);
        // The first motion is none, also not a negative one.
        let down: Vec<Feedback> = (0..9)
            .map(|scan| feedback(scan, [-(scan as i64), 0]))
            .collect();
        assert_eq!(fires(&script, &down), []);
        let far = [i64::MIN, i64::MAX, i64::MIN].map(|x| feedback(0, [x, 0]));
        assert_eq!(fires(&script, &far), [(0, 0)]);
    }
}
