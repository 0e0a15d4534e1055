//! Runs of a bench: each through real processes in a cell of its own, in a folder that is gone afterwards.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, ExitStatus};

use anyhow::{Context, anyhow};
use monitor::log::part_files;
use serde_json::Value;
use tempfile::TempDir;

use console::child;
use console::exit::{Failure, Kind};
use console::signals::Signals;

/// A folder for the files of a bench, removed when dropped.
///
/// # Errors
/// It cannot be made.
pub fn scratch() -> anyhow::Result<TempDir> {
    let folder = tempfile::Builder::new().prefix("quadrant-bench-").tempdir();
    folder.context("a temporary folder")
}

/// Makes runs until it is interrupted.
#[derive(Debug)]
pub struct Runs<'a> {
    /// Where run directories go.
    pub scratch: &'a TempDir,
    /// What ends it.
    pub signals: &'a Signals,
}

impl Runs<'_> {
    /// Runs a program in lockstep; the report. Runs at the same time need different lanes.
    ///
    /// # Errors
    /// It was interrupted, or the run did not end well.
    pub fn report(&self, machine: &Path, program: &Path, lane: usize) -> Result<Value, Failure> {
        self.run(machine, program, lane, &[])
    }

    /// Lets a machine learn from a program.
    ///
    /// # Errors
    /// As [`Runs::report`].
    pub fn learn(&self, machine: &Path, program: &Path) -> Result<(), Failure> {
        self.run(machine, program, 0, &["--learn"]).map(|_| ())
    }

    /// Runs a program in lockstep and keeps what it wrote as long as the scratch folder is there; the run directory.
    ///
    /// # Errors
    /// As [`Runs::report`].
    pub fn kept(&self, machine: &Path, program: &Path) -> Result<PathBuf, Failure> {
        self.start(machine, program, 0, &[])?;
        Ok(self.out(0))
    }

    /// Runs a program in lockstep under the eyes of `watch`, which waits for its end and hands on an interruption; what was seen, and the
    /// bytes of its log.
    ///
    /// # Errors
    /// As [`Runs::report`], and errors of `watch`.
    pub fn watched<T>(
        &self,
        machine: &Path,
        program: &Path,
        watch: impl FnOnce(&mut Child, &Signals) -> anyhow::Result<T>,
    ) -> Result<(T, u64), Failure> {
        let mut seen = None;
        let ended = self.start_with(machine, program, 0, &[], |child, signals| {
            seen = Some(watch(child, signals));
            child.wait()
        });
        let parts = part_files(&self.out(0)).unwrap_or_default();
        let bytes = parts.iter().filter_map(|part| fs::metadata(part).ok());
        let bytes = bytes.map(|part| part.len()).sum();
        let _ = fs::remove_dir_all(self.out(0));
        ended?;
        let seen = seen.context("nobody watched").and_then(|seen| seen);
        Ok((seen.environment()?, bytes))
    }

    fn out(&self, lane: usize) -> PathBuf {
        self.scratch.path().join(format!("run-{lane}"))
    }

    fn run(
        &self,
        machine: &Path,
        program: &Path,
        lane: usize,
        options: &[&str],
    ) -> Result<Value, Failure> {
        let ended = self.start(machine, program, lane, options);
        let out = self.out(lane);
        let report = fs::read_to_string(out.join("report.json"));
        let _ = fs::remove_dir_all(&out);
        ended?;
        let report = report.context("reading its report").environment()?;
        serde_json::from_str(&report).environment()
    }

    /// Runs it to a good end.
    fn start(
        &self,
        machine: &Path,
        program: &Path,
        lane: usize,
        options: &[&str],
    ) -> Result<(), Failure> {
        self.start_with(machine, program, lane, options, child::wait)
    }

    /// The same, where `wait` waits for the end.
    fn start_with(
        &self,
        machine: &Path,
        program: &Path,
        lane: usize,
        options: &[&str],
        wait: impl FnOnce(&mut Child, &Signals) -> io::Result<ExitStatus>,
    ) -> Result<(), Failure> {
        if self.signals.count() > 0 {
            return Err(Failure::Interrupted);
        }
        let out = self.out(lane);
        let cell = format!("bench-{}-{lane}", std::process::id());
        let mut child = child::command("run")
            .arg(machine)
            .arg(program)
            .args(["--pace", "lockstep", "--cell", &cell, "--out"])
            .arg(&out)
            .args(options)
            .spawn()
            .context("starting a run")
            .environment()?;
        let status = wait(&mut child, self.signals).environment()?;
        if self.signals.count() > 0 {
            return Err(Failure::Interrupted);
        }
        if !status.success() {
            let what = anyhow!("a run ended with {status}");
            return Err(match status.code() {
                Some(1) => Failure::Stopped(what),
                _ => Failure::Environment(what),
            });
        }
        Ok(())
    }
}
