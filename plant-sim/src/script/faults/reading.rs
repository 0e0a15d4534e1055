//! Reads a fault script and says what is wrong with it, with line and what would be right.

use std::path::Path;

use machine::settings_file::{self, From, Rules, SettingsFileError, read_text};
use machine::{Machine, Process};
use serde::Deserialize;
use toml::Spanned;

use super::*;
use crate::script::rng::Rng;

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
    restart_after_scans: Given<u64>,
    scans: Given<u64>,
    late_scans: Given<u64>,
    what: Given<String>,
    field: Given<String>,
    sealed: Given<bool>,
    repeat: Given<Repeat>,
}

/// What a fault may have, and where it stands.
type Given<T> = Option<Spanned<T>>;

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

/// Checks the text of such a file; `name` is in the messages.
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
    none_broken(broken)?;
    Ok(FaultScript {
        name: name.into(),
        restart: file.restart,
        faults,
    })
}

fn judge_restart(
    mut rules: Rules<'_>,
    restart: &RestartOverrides,
) -> Result<(), SettingsFileError> {
    if let Some(most) = restart.restarts_max {
        let path = ["restart", "restarts_max"];
        rules.between(&path, None, most.into(), "restarts", 1.0, 1e6);
    }
    if let Some(within) = restart.within_s {
        let (path, low) = (["restart", "within_s"], From::Above(0.0));
        rules.range(&path, None, within, "s", low, 86_400.0);
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
            let what = "in all, repetitions counted: must be at most that many";
            let what = format!("makes more than {FAULTS_MAX} {what}");
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
                    let axis = self.machine.axis_index(letter);
                    let axis = axis.map_err(|what| self.wrong(place, &format!("at: {what}")))?;
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
        let number = |key, value, may, most| self.number_of(entry, key, value, may, most);
        let (after, most) = (&entry.restart_after_scans, FAULT_SCANS_MAX);
        let restart_after_scans = number("restart_after_scans", after, restart_after_scans, most)?;
        let scans = number("scans", &entry.scans, scans, most)?;
        let late_scans = number("late_scans", &entry.late_scans, late_scans, LATE_SCANS_MAX)?;
        self.has_it("what", entry, &entry.what, what)?;
        let field = if word == "corrupt" { May } else { MustNot };
        self.has_it("field", entry, &entry.field, field)?;
        let sealed = if entry.field.is_some() { May } else { MustNot };
        self.has_it("sealed", entry, &entry.sealed, sealed)?;
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
            _ if entry.field.is_some() => self.spoil(entry, job, scans)?,
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

    /// One number of a sample, and how it is wrong.
    fn spoil(&self, entry: &Entry, job: Job, scans: u64) -> Result<Action, String> {
        let name = entry.field.as_ref().map_or("", |field| field.get_ref());
        let word = entry.what.as_ref().map_or("", |what| what.get_ref());
        let sealed = entry.sealed.as_ref().is_none_or(|sealed| *sealed.get_ref());
        let found = Field::parse(job, name, sealed).and_then(|field| Some((field, field.leaf()?)));
        let Some((field, leaf)) = found else {
            let samples = Sent::ALL.into_iter().filter(|sent| sent.job() == job);
            let samples: Vec<&str> = samples.map(Sent::word).collect();
            let (process, samples) = (entry.process.get_ref(), samples.join(", "));
            let such = match job {
                Job::Servo => "command.held.sequence",
                _ => "window.first_scan",
            };
            let what = format!(
                "field = {name:?}: {process} sends {samples}; must be a number of it, as in {such:?}"
            );
            return Err(self.wrong(&entry.action, &what));
        };
        let how = Spoil::parse(word, leaf).ok_or_else(|| {
            let bits = 8 * leaf.bytes - 1;
            let what = format!(
                "what = {word:?}: of {name} it must be one of all-bits, bit-0 to bit-{bits}, most, zero, one-more, one-less, or of a number with a point not-a-number"
            );
            self.wrong(&entry.action, &what)
        })?;
        Ok(Action::Spoil { scans, field, how })
    }

    fn has_it<T>(
        &self,
        key: &str,
        entry: &Entry,
        value: &Given<T>,
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
        value: &Given<u64>,
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
pub(super) fn random_scan(seed: u64, index: u64, first: u64, last: u64) -> u64 {
    Rng::after(seed, index).within(first, last)
}
