//! Which run directories go: `[log]` of the machine file says it, and of a cell that stays up a bound where that says nothing. Only those
//! are looked at that this machine's own commands have made below `runs/`, and the cell's own. The oldest go first, those with a black box
//! last, none that is marked and none of a run that is under way.

use std::ffi::OsString;
use std::fs::{self, File, Metadata};
use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use bus::cell::CellPaths;
use bus::files::open_to_read;
use bus::locks;
use machine::{LogKeeping, Machine, replace_file};
use monitor::log::LOG_FILE;
use monitor::{BLACK_BOX_PREFIX, MARK_FILE};
use serde_json::json;

use crate::disk_room::Room;

/// Where run directories are that nobody has named.
pub const RUNS: &str = "runs";
/// What happened in a run, a line each. The launcher holds a lock on it as long as its run goes on.
pub const EVENTS_FILE: &str = "events.jsonl";
/// File in the folder of a cell that stays up: `bytes` of its run directories, `bytes_max` and the `alarm` of them, as JSON.
pub const USAGE_FILE: &str = "runs-kept";
/// The run directories of a cell whose machine file says nothing take no more than this,
const BYTES_MAX: u64 = 20_000_000_000;
/// and no more than this share of their file system.
const SHARE: u64 = 10;
/// Time between two looks at the room on the disk.
const LOOK_PERIOD: Duration = Duration::from_secs(1);

/// What is kept of a machine's runs.
#[derive(Debug, Default)]
pub struct Retention {
    machine: String,
    keep: LogKeeping,
    /// The machine file asks for it: all runs count, not only runs of cells.
    asked: bool,
    /// Where the next runs are written.
    folder: PathBuf,
    /// The most that they may take.
    bytes_max: u64,
    /// What they take.
    bytes: u64,
    /// What may go, in this order.
    kept: Vec<Kept>,
    /// The run that was over last: it stays until another one is.
    last: Option<Kept>,
    /// There may be another one to go.
    due: bool,
    looked: Option<Instant>,
    /// The disk is nearly full; there is nothing that may go.
    alarms: (bool, bool),
    alarm: Option<String>,
    /// What is not among the events yet.
    said: Vec<(&'static str, String)>,
    /// The cell that shows what is used.
    shown_by: Option<CellPaths>,
}

/// A run directory whose run is over, or the folder of a cell that has none left.
#[derive(Debug)]
struct Kept {
    folder: PathBuf,
    bytes: u64,
    ended: SystemTime,
    /// A machine has tripped or a process has died: there is a black box.
    troubled: bool,
}

impl Retention {
    /// Of a single run: of a machine whose file asks for it.
    pub fn of_run(machine: &Machine) -> Option<Retention> {
        let keep = machine.log;
        let asked = keep.keep_mb.is_some() || keep.keep_days.is_some();
        asked.then(|| Retention::new(machine, None, u64::MAX))
    }

    /// Of a cell that stays up. Where a folder was named for its runs, of those alone.
    pub fn of_cell(machine: &Machine, out: Option<&Path>) -> Retention {
        let room = Room::of(out.unwrap_or(Path::new(RUNS)));
        let share = room.map_or(u64::MAX, |room| room.whole / SHARE);
        Retention::new(machine, out, BYTES_MAX.min(share))
    }

    fn new(machine: &Machine, out: Option<&Path>, otherwise: u64) -> Retention {
        let keep = machine.log;
        let mut retention = Retention {
            machine: machine.name.clone(),
            keep,
            asked: keep.keep_mb.is_some() || keep.keep_days.is_some(),
            folder: out.unwrap_or(Path::new(RUNS)).into(),
            bytes_max: keep
                .keep_mb
                .map_or(otherwise, |mb| u64::from(mb) * 1_000_000),
            ..Retention::default()
        };
        if out.is_none() {
            retention.kept = retention.runs();
            retention.kept.sort_by_key(Kept::rank);
        }
        retention.bytes = retention.kept.iter().map(|run| run.bytes).sum();
        retention
    }

    /// The bound in force, for people.
    pub fn words(&self) -> String {
        let most = size(self.bytes_max);
        format!("Run directories: at most {most}, the oldest go first; [log] keep_mb")
    }

    /// From now on this cell shows what is used.
    pub fn show(&mut self, cell: &CellPaths) {
        self.shown_by = Some(cell.clone());
        self.write_usage();
    }

    /// Removes all that is not to be kept, and says so.
    pub fn apply(&mut self) {
        while self.remove_one() {}
    }

    /// A run of the cell is over.
    pub fn over(&mut self, folder: PathBuf) {
        let over = Kept::of(folder);
        self.bytes += over.bytes;
        if let Some(before) = self.last.replace(over) {
            let at = self.kept.partition_point(|run| run.rank() <= before.rank());
            self.kept.insert(at, before);
        }
        self.due = true;
        self.write_usage();
    }

    /// Lets one go at a time, so that nobody waits for the launcher. What has been said: event and text.
    pub fn look(&mut self) -> std::vec::Drain<'_, (&'static str, String)> {
        if self.looked.is_none_or(|at| at.elapsed() > LOOK_PERIOD) {
            self.looked = Some(Instant::now());
            self.due = true;
        }
        self.due = self.due && self.remove_one();
        self.said.drain(..)
    }

    /// Removes the first that is to go; whether there was one.
    fn remove_one(&mut self) -> bool {
        let now = SystemTime::now();
        let scarce = Room::of(&self.folder).filter(|room| room.is_scarce(self.alarms.0));
        let goes = |run: &Kept| {
            let why = self.reason(run, now, scarce.as_ref())?;
            (!run.is_marked()).then_some(why)
        };
        let mut goes = self.kept.iter().map(goes).enumerate();
        let found = goes.find_map(|(at, why)| Some((at, why?)));
        self.alarm(scarce, found.is_none());
        let Some((at, why)) = found else {
            return false;
        };
        let run = self.kept.remove(at);
        self.bytes -= run.bytes;
        let shown = run.folder.display();
        match fs::remove_dir_all(&run.folder) {
            // Somebody else was quicker.
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(error) => tracing::warn!("{shown}: cannot be removed: {error}"),
            Ok(()) => {
                let text = format!("{shown} ({}): {why}", size(run.bytes));
                tracing::info!("removed {text}");
                self.said.push(("removed", text));
            }
        }
        self.write_usage();
        true
    }

    /// Why a run goes, where there is so little room.
    fn reason(&self, run: &Kept, now: SystemTime, scarce: Option<&Room>) -> Option<String> {
        let age = now.duration_since(run.ended).unwrap_or_default();
        let too_old = |days: &f64| age > Duration::from_secs_f64(days * 86_400.0);
        if let Some(days) = self.keep.keep_days.filter(too_old) {
            return Some(format!("older than [log] keep_days = {days}"));
        }
        if self.is_over_bound() {
            let bound = match self.keep.keep_mb {
                Some(mb) => format!("[log] keep_mb = {mb}"),
                None => size(self.bytes_max),
            };
            return Some(format!("the run directories take more than {bound}"));
        }
        scarce.map(Room::words)
    }

    fn is_over_bound(&self) -> bool {
        self.bytes > self.bytes_max
    }

    /// Says once that the disk is nearly full, and that nothing may go.
    fn alarm(&mut self, scarce: Option<Room>, none_goes: bool) {
        let stuck = none_goes && (scarce.is_some() || !self.kept.is_empty());
        let now = match scarce.is_some() || self.is_over_bound() {
            true => (scarce.is_some(), self.alarms.1 || stuck),
            false => (false, false),
        };
        if std::mem::replace(&mut self.alarms, now) == now {
            return;
        }
        let taken = || format!("the run directories take {}", size(self.bytes));
        let why = scarce.map_or_else(taken, |room| room.words());
        let helpless = match now.1 {
            true => ", and none may go: marked, under way, or the last one",
            false => "",
        };
        let text = format!("{}: {why}{helpless}", self.folder.display());
        self.alarm = (now != (false, false)).then_some(text);
        if let Some(text) = &self.alarm {
            tracing::warn!("{text}");
            self.said.push(("disk", text.clone()));
        }
        self.write_usage();
    }

    fn write_usage(&self) {
        if let Some(cell) = &self.shown_by {
            let (bytes, bytes_max, alarm) = (self.bytes, self.bytes_max, &self.alarm);
            let usage = json!({ "bytes": bytes, "bytes_max": bytes_max, "alarm": alarm });
            // Without it nothing is shown.
            let _ = replace_file(&cell.folder().join(USAGE_FILE), &usage.to_string());
        }
    }

    /// All that may go.
    fn runs(&self) -> Vec<Kept> {
        let mut kept = Vec::new();
        for folder in folders(&self.folder) {
            let open = is_open(&folder);
            let mut of_cell: Vec<PathBuf> =
                folders(&folder).filter(|run| is_of_cell(run)).collect();
            // The folder of a cell goes last of all it had, and not with what somebody else has put into it.
            let left = folder.join(LOG_FILE).exists() || folders(&folder).next().is_none();
            let alone = of_cell.is_empty() && !open && left && (self.asked || is_of_up(&folder));
            if (of_cell.is_empty() && !alone) || !self.has_made(&folder) {
                continue;
            }
            if alone {
                kept.push(Kept::of(folder));
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
        let (mut bytes, mut ended, mut troubled) = (0, SystemTime::UNIX_EPOCH, false);
        for (name, file) in files_of(&folder) {
            troubled |= name.to_string_lossy().starts_with(BLACK_BOX_PREFIX);
            bytes += size_of(&file);
            ended = ended.max(file.modified().unwrap_or(ended));
        }
        Kept {
            folder,
            bytes,
            ended,
            troubled,
        }
    }

    /// What goes first has the lowest.
    fn rank(&self) -> (bool, SystemTime) {
        (self.troubled, self.ended)
    }

    /// Somebody has marked it: it stays, whatever the disk has left.
    fn is_marked(&self) -> bool {
        self.folder.join(MARK_FILE).symlink_metadata().is_ok()
    }
}

/// The files of a run directory, also those that comparisons have left in folders of their own.
fn files_of(folder: &Path) -> impl Iterator<Item = (OsString, Metadata)> {
    let inner = folders(folder).chain([folder.to_path_buf()]);
    let files = inner.flat_map(|folder| fs::read_dir(folder).into_iter().flatten().flatten());
    let files = files.filter_map(|entry| Some((entry.file_name(), entry.metadata().ok()?)));
    files.filter(|(_, file)| file.is_file())
}

/// What a file takes of the disk, or would without holes.
fn size_of(file: &Metadata) -> u64 {
    file.len().max(file.blocks() * 512)
}

/// What a run directory takes, in bytes.
pub fn bytes_of(folder: &Path) -> u64 {
    files_of(folder).map(|(_, file)| size_of(&file)).sum()
}

/// A number of bytes, for people.
fn size(bytes: u64) -> String {
    let mb = bytes as f64 / 1e6;
    match mb {
        1000.0.. => format!("{:.1} GB", mb / 1e3),
        _ => format!("{mb:.1} MB"),
    }
}

/// Whether a folder below the folder of a cell is a run directory, and nothing that somebody else has put there.
pub fn is_of_cell(folder: &Path) -> bool {
    let has = |name| folder.join(name).exists();
    monitor::run_number(folder).is_some() && has("machine.toml") && has(LOG_FILE)
}

/// Whether a folder without logs has the name of one that a cell has made.
fn is_of_up(folder: &Path) -> bool {
    let name = folder.file_name().unwrap_or_default().to_string_lossy();
    name.contains("-up-") && !folder.join(LOG_FILE).exists()
}

/// The folders in a folder.
pub fn folders(folder: &Path) -> impl Iterator<Item = PathBuf> + use<> {
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
pub fn is_open(folder: &Path) -> bool {
    open_to_read(&folder.join(EVENTS_FILE)).is_ok_and(|file| locks::is_held(&file))
}

/// Notes that the run of this file goes on, for as long as the file is open.
pub fn hold(events: &File) {
    // A file system without locks: then the newest run is the one that could go, last of all.
    let _ = locks::hold(events);
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
