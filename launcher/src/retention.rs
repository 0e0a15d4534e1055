//! `[log]` of the machine file: which run directories of earlier runs go. Only those that this machine's own commands have made below
//! `runs/` are looked at, the oldest go first, and none of a run that is under way.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use machine::{LogKeeping, Machine};
use rustix::fs::{FlockOperation, flock};

/// Where run directories are that nobody has named.
pub const RUNS: &str = "runs";
/// The launcher holds a lock on it as long as its run goes on.
const EVENTS: &str = "events.jsonl";

/// What is kept of a machine's runs.
#[derive(Debug, Clone)]
pub struct Retention {
    machine: String,
    keep: LogKeeping,
    runs: PathBuf,
}

/// A run directory that may go.
#[derive(Debug)]
struct Kept {
    folder: PathBuf,
    bytes: u64,
    ended: SystemTime,
}

impl Retention {
    /// Of a machine whose file asks for it.
    pub fn of(machine: &Machine) -> Option<Retention> {
        let keep = machine.log;
        let asked = keep.keep_mb.is_some() || keep.keep_days.is_some();
        asked.then(|| Retention {
            machine: machine.name.clone(),
            keep,
            runs: RUNS.into(),
        })
    }

    /// Removes what is not to be kept, and says so.
    pub fn apply(&self) {
        let mut kept = self.runs();
        kept.sort_by_key(|run| run.ended);
        let mut bytes: u64 = kept.iter().map(|run| run.bytes).sum();
        let now = SystemTime::now();
        for run in kept {
            let Some(why) = self.reason(&run, bytes, now) else {
                continue;
            };
            match fs::remove_dir_all(&run.folder) {
                Ok(()) => {
                    bytes -= run.bytes;
                    let mb = run.bytes as f64 / 1e6;
                    tracing::info!("removed {} ({mb:.1} MB): {why}", run.folder.display());
                }
                Err(error) => {
                    tracing::warn!("{}: cannot be removed: {error}", run.folder.display())
                }
            }
        }
    }

    /// Why a run goes, where so many bytes are kept with it.
    fn reason(&self, run: &Kept, bytes: u64, now: SystemTime) -> Option<String> {
        let age = now.duration_since(run.ended).unwrap_or_default();
        let too_old = |days: &f64| age > Duration::from_secs_f64(days * 86_400.0);
        if let Some(days) = self.keep.keep_days.filter(too_old) {
            return Some(format!("older than [log] keep_days = {days}"));
        }
        let too_much = |mb: &u32| bytes > u64::from(*mb) * 1_000_000;
        let mb = self.keep.keep_mb.filter(too_much)?;
        Some(format!("the logs take more than [log] keep_mb = {mb}"))
    }

    /// All that may go.
    fn runs(&self) -> Vec<Kept> {
        let mut kept = Vec::new();
        for folder in folders(&self.runs).filter(|folder| self.has_made(folder)) {
            let open = is_open(&folder);
            let mut of_cell: Vec<PathBuf> = folders(&folder)
                .filter(|run| monitor::run_number(run).is_some())
                .collect();
            if of_cell.is_empty() {
                kept.extend((!open).then(|| Kept::of(folder)));
                continue;
            }
            of_cell.sort_by_key(|run| monitor::run_number(run));
            if open {
                // Of a cell that is up: the last run may be under way, and of each the report has been made before it goes.
                of_cell.pop();
                of_cell.retain(|run| run.join("report.json").exists());
            }
            kept.extend(of_cell.into_iter().map(Kept::of));
        }
        kept
    }

    /// Whether a folder is a run directory, or that of a cell, that was made for this machine without a name being given.
    fn has_made(&self, folder: &Path) -> bool {
        let name = folder.file_name().and_then(|name| name.to_str());
        name.is_some_and(is_dated)
            && Machine::load(folder).is_ok_and(|machine| machine.name == self.machine)
    }
}

impl Kept {
    fn of(folder: PathBuf) -> Kept {
        let files = fs::read_dir(&folder).into_iter().flatten().flatten();
        let files = files.filter_map(|entry| entry.metadata().ok());
        let (mut bytes, mut ended) = (0, SystemTime::UNIX_EPOCH);
        for file in files.filter(|file| file.is_file()) {
            bytes += file.len();
            ended = ended.max(file.modified().unwrap_or(ended));
        }
        Kept {
            folder,
            bytes,
            ended,
        }
    }
}

fn folders(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    // A link leads to what somebody else has made.
    let own = entries.filter(|entry| entry.file_type().is_ok_and(|of| of.is_dir()));
    own.map(|entry| entry.path())
}

/// Whether a name ends as those that are made where none is given: `-20261121-103000`, or one of several of that second.
fn is_dated(name: &str) -> bool {
    let digits = |text: &str, count: usize| {
        text.len() == count && text.bytes().all(|byte| byte.is_ascii_digit())
    };
    let mut parts = name.rsplit('-');
    let (last, before, third) = (parts.next(), parts.next(), parts.next());
    let stamped = |date: Option<&str>, time: Option<&str>| {
        date.is_some_and(|date| digits(date, 8)) && time.is_some_and(|time| digits(time, 6))
    };
    stamped(before, last)
        || (stamped(third, before) && last.is_some_and(|of| of.parse::<u32>().is_ok()))
}

/// Whether a launcher holds the events of a run directory.
fn is_open(folder: &Path) -> bool {
    let Ok(file) = File::open(folder.join(EVENTS)) else {
        return false;
    };
    flock(&file, FlockOperation::NonBlockingLockShared).is_err()
}

/// Notes that the run of this file goes on, for as long as the file is open.
pub fn hold(events: &File) {
    // A file system without locks: then the newest run is the one that could go, last of all.
    let _ = flock(events, FlockOperation::NonBlockingLockExclusive);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_are_made_by_date_are_known_and_others_are_not() {
        for name in ["xy-part-20261121-103000", "xy-up-20261121-103000-2"] {
            assert!(is_dated(name), "{name}");
        }
        for name in [
            "part",
            "2026",
            "xy-part",
            "xy-20261121",
            "xy-2026112-103000",
            "103000",
        ] {
            assert!(!is_dated(name), "{name}");
        }
    }
}
