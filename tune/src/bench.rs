//! Runs test motions: real processes, lockstep, in a cell and a folder of their own that vanish with them.

use std::fs::{self, File, Metadata, Permissions};
use std::io;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use bus::files::open_own;
use machine::{Machine, machine_file};
use tempfile::TempDir;
use toml_edit::DocumentMut;

use super::dead_time;
use super::recording::{self, Recording};
use console::child;
use console::exit::{Failure, Kind};
use console::signals::Signals;

/// How the names of its folders begin.
const PREFIX: &str = "quadrant-tune-";
const LOCK: &str = "lock";

/// A temporary folder. Nobody else reads what is measured in it, nor what is tried.
struct Folder {
    folder: TempDir,
    /// As long as it is held, the folder is somebody's.
    _lock: File,
}

impl Folder {
    /// Makes one in this folder, and removes those that others of this user were killed over.
    fn make(within: &Path) -> io::Result<Folder> {
        let made = loop {
            let mut builder = tempfile::Builder::new();
            let builder = builder.permissions(Permissions::from_mode(0o700));
            let folder = builder.prefix(PREFIX).tempdir_in(within)?;
            let lock = open_own(&folder.path().join(LOCK)).and_then(|lock| {
                lock.lock()?;
                Ok(lock)
            });
            // Another one that removes what is left may have come before the lock.
            if folder.path().exists() {
                break Folder {
                    folder,
                    _lock: lock?,
                };
            }
        };
        let user = made.folder.path().metadata()?.uid();
        for entry in fs::read_dir(within)?.flatten() {
            let is_named = entry.file_name().to_string_lossy().starts_with(PREFIX);
            let is_own = |found: Metadata| found.is_dir() && found.uid() == user;
            if is_named
                && entry.metadata().is_ok_and(is_own)
                && let Ok(lock) = open_own(&entry.path().join(LOCK))
                && lock.try_lock().is_ok()
            {
                let _ = fs::remove_dir_all(entry.path());
            }
        }
        Ok(made)
    }
}

/// Where test motions run.
pub struct Bench {
    folder: Folder,
    signals: Signals,
    cell: String,
    runs: u32,
    /// Drive files in it, and the dead time that they have, in scans.
    drive_files: Vec<PathBuf>,
    dead_time_scans: u32,
}

impl Bench {
    /// Sets it up beside the plant that stands beside this machine file, if its drives are simulated; the plant is copied unread.
    ///
    /// # Errors
    /// The files cannot be copied.
    pub fn new(machine: &Path, signals: Signals) -> Result<Bench, Failure> {
        let folder = Folder::make(&std::env::temp_dir());
        let folder = folder.context("a temporary folder").environment()?;
        let known = Machine::load(machine).input()?;
        let files = dead_time::drive_files(&known).into_iter();
        let bench = Bench {
            drive_files: files.map(|file| folder.folder.path().join(file)).collect(),
            dead_time_scans: known.scan.dead_time_scans,
            folder,
            signals,
            cell: format!("tune-{}", std::process::id()),
            runs: 0,
        };
        if known.bus.is_none() {
            let plant = machine_file(machine).with_file_name("plant.toml");
            fs::copy(&plant, bench.folder().join("plant.toml"))
                .with_context(|| plant.display().to_string())
                .input()?;
        }
        machine::copy_named_files(machine, bench.folder()).input()?;
        Ok(bench)
    }

    fn folder(&self) -> &Path {
        self.folder.folder.path()
    }

    /// Runs a program on the machine of this text; what its axes did.
    ///
    /// # Errors
    /// The machine stopped, the environment does not allow it, or somebody interrupted.
    pub fn record(
        &mut self,
        machine: &DocumentMut,
        program: &str,
    ) -> Result<Vec<Recording>, Failure> {
        self.with_log(machine, program, recording::read)
    }

    /// Runs a program on the machine of this text; what somebody reads in its log.
    ///
    /// # Errors
    /// As [`Bench::record`].
    pub fn with_log<T>(
        &mut self,
        machine: &DocumentMut,
        program: &str,
        read: impl FnOnce(&Path, &Machine) -> anyhow::Result<T>,
    ) -> Result<T, Failure> {
        let out = self.run(machine, program)?;
        let known = Machine::load(self.folder()).input()?;
        let read = read(&out.join(monitor::log::LOG_FILE), &known);
        let _ = fs::remove_dir_all(&out);
        read.environment()
    }

    /// Gives the drive files the dead time of the machine file, where that has another one than in the run before.
    fn follow_dead_time(&mut self) -> Result<(), Failure> {
        let machine = Machine::load(self.folder()).input()?;
        let scans = machine.scan.dead_time_scans;
        if scans != self.dead_time_scans {
            for file in &self.drive_files {
                dead_time::write_drive_file(file, scans)?;
            }
            self.dead_time_scans = scans;
        }
        Ok(())
    }

    fn run(&mut self, machine: &DocumentMut, program: &str) -> Result<PathBuf, Failure> {
        self.runs += 1;
        let folder = self.folder();
        let write = |name: &str, text: &str| fs::write(folder.join(name), text);
        write("machine.toml", &machine.to_string()).environment()?;
        write("motion.ngc", program).environment()?;
        self.follow_dead_time()?;
        let folder = self.folder();
        let out = folder.join(format!("run-{}", self.runs));
        let printed = folder.join("printed.txt");
        let mut child = child::command("run")
            .arg(folder)
            .arg(folder.join("motion.ngc"))
            .args(["--pace", "lockstep", "--cell", &self.cell, "--out"])
            .arg(&out)
            .stderr(fs::File::create(&printed).environment()?)
            .spawn()
            .context("starting a run")
            .environment()?;
        let status = child::wait(&mut child, &self.signals).environment()?;
        if self.signals.count() > 0 {
            return Err(Failure::Interrupted);
        }
        if status.success() {
            return Ok(out);
        }
        let printed = fs::read_to_string(&printed).unwrap_or_default();
        let last = printed
            .lines()
            .rev()
            .find_map(|line| line.strip_prefix("quadrant: "))
            .unwrap_or("no reason was given");
        let words = last.replace(&format!("{}/", folder.display()), "");
        let error = anyhow!("the test motions ended early: {words}");
        Err(match status.code() {
            Some(1) => Failure::Stopped(error),
            Some(2) => Failure::Input(error),
            _ => Failure::Environment(error),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_else_looks_into_the_folder_and_none_is_left_behind_the_next() {
        let within = tempfile::tempdir().expect("a folder");
        let make = || Folder::make(within.path()).expect("a folder");
        let count = || fs::read_dir(within.path()).expect("the folder").count();
        let first = make();
        let mode = first.folder.path().metadata().expect("it is there").mode();
        assert_eq!(mode & 0o777, 0o700);
        let second = make();
        assert_eq!(count(), 2, "it is somebody's");
        // A killed process lets go of the lock alone.
        std::mem::forget(second.folder);
        drop(second._lock);
        fs::write(within.path().join("quadrant-tune-notes"), "").expect("a file of others");
        drop(make());
        assert!(first.folder.path().exists());
        assert_eq!(count(), 2);
    }
}
