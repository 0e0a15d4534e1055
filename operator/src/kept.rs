//! `offsets`, `tool` and `zero`: what programs of a machine begin with, shown and changed between two runs.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use bus::cell::CellPaths;
use bus::observer::Observer;
use bus::sample::{Feedback, Mode, ProgramState};
use machine::settings_file::SettingsFileError;
use machine::{AxisKind, KeptFiles, Machine, machine_file};

use super::client::Client;
use super::eyes::Eyes;
use console::exit::{Failure, Kind};
use console::output::say;

/// A machine, with what its next program begins with.
pub(super) struct Subject {
    pub machine: Machine,
    pub files: KeptFiles,
    /// Its cell, where it was found by that.
    pub client: Option<Client>,
}

impl Subject {
    /// The machine that was named, or that of a running cell.
    pub fn of(machine: Option<&Path>, cell: Option<&str>) -> Result<Subject, Failure> {
        if let Some(path) = machine {
            let path = machine_file(path);
            let machine = Machine::load(&path).input()?;
            return Ok(Subject {
                files: machine.kept_files.clone(),
                machine,
                client: None,
            });
        }
        let client = Client::to_order(cell)?;
        let files = KeptFiles::of_cell(&client.cell.place).environment()?;
        let mut machine = client.machine.clone();
        let kept = files.read(&machine).input()?;
        machine.take_kept(kept).input()?;
        Ok(Subject {
            machine,
            files,
            client: Some(client),
        })
    }

    /// Name of its cell or machine, to begin a line with.
    pub fn name(&self) -> &str {
        let cell = self.client.as_ref().map(|client| client.cell.place.name());
        cell.unwrap_or(&self.machine.name)
    }

    /// Says what holds from the next start on, by this file.
    pub fn say_changed(&self, what: &str, file: &Path) {
        let (name, file) = (self.name(), file.display());
        say(&format!("{name}: {what}, from the next start on ({file})"));
    }

    /// Refuses a change while a cell that uses this file has a program started: what a run begins with stays.
    pub fn must_be_between_runs(&self, file: &Path) -> Result<(), Failure> {
        let named = absolute(file);
        for name in CellPaths::names() {
            let place = CellPaths::new(&name).input()?;
            let Some(cell) = Observer::of(place.clone()) else {
                continue;
            };
            let files = KeptFiles::of_cell(&place).unwrap_or_default();
            let mut uses = [&files.offsets, &files.tools].into_iter().flatten();
            if !uses.any(|used| absolute(used) == named) {
                continue;
            }
            drop(cell);
            let client = Client::find(Some(&name), "operator")?;
            let now = Eyes::open(&client)?.look()?;
            if is_started(&now) {
                return Err(Failure::Stopped(anyhow!(
                    "{name}: refused: run {} is started, and works with what it began with: change it once the run is over, or after `quadrant load`",
                    now.run
                )));
            }
        }
        Ok(())
    }

    /// Where an axis letter of a program counts in.
    pub fn unit(&self, letter: char) -> &'static str {
        let axes = &self.machine.axes;
        let axis = axes.iter().find(|axis| axis.name.starts_with(letter));
        match axis {
            Some(axis) => axis.kind.unit(),
            None if letter == 'R' => AxisKind::Rotary.unit(),
            None => AxisKind::Linear.unit(),
        }
    }
}

/// Whether a program is started and not over.
pub(super) fn is_started(now: &Feedback) -> bool {
    let ended = now.last == 1 || now.mode == Mode::Finished as u32;
    now.program == ProgramState::Running as u32 && !ended
}

fn absolute(file: &Path) -> PathBuf {
    let leads_to = std::fs::canonicalize(file).or_else(|_| std::path::absolute(file));
    leads_to.unwrap_or_else(|_| file.to_path_buf())
}

/// A file that is wrong is bad input; one that cannot be read or written is the environment's.
pub(super) fn written(done: Result<(), SettingsFileError>) -> Result<(), Failure> {
    match done {
        Err(SettingsFileError::Unreadable { .. }) => done.environment(),
        done => done.input(),
    }
}

/// A word such as `X=12.5`, in two.
pub(super) fn pair(word: &str) -> Result<(&str, &str), Failure> {
    let right = "a name and its value, such as X=12.5 or length_mm=40.5";
    let pair = word.split_once('=');
    pair.ok_or_else(|| Failure::input(format!("{word:?}: {right}")))
}

/// A number that is one.
pub(super) fn number(what: &str, text: &str) -> Result<f64, Failure> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| Failure::Input(anyhow!("{what} = {text:?}: a number such as 12.5")))
}
