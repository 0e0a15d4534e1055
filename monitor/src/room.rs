//! Room on the disk while a log is written: where it gets scarce, less is recorded, and the run goes on.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use bus::cell::CellPaths;
use machine::LogLevel;
use rustix::fs::statvfs;

/// Name of the file in the cell's folder with what is said of it; without it there is room.
const FILE: &str = "recorder-room";
/// Free room below which no more than the axes are recorded: this share of the disk,
const SCARCE_SHARE: u64 = 50;
/// or so much, in bytes, whichever is less. With a quarter of it no samples are.
const SCARCE_BYTES: u64 = 1_000_000_000;
/// Time between two looks.
const LOOK_PERIOD: Duration = Duration::from_secs(1);

/// Why less is recorded than was asked for; none where it is not.
pub fn scarce(cell: &CellPaths) -> Option<String> {
    fs::read_to_string(cell.folder().join(FILE)).ok()
}

/// Looks at it.
#[derive(Debug)]
pub(crate) struct Room {
    folder: PathBuf,
    file: PathBuf,
    held_to: LogLevel,
    looked: Option<Instant>,
}

impl Room {
    /// Of the file system that a folder is on.
    pub fn of(folder: &Path, cell: &CellPaths) -> Room {
        Room {
            folder: folder.into(),
            file: cell.folder().join(FILE),
            held_to: LogLevel::Full,
            looked: None,
        }
    }

    /// The most that is to be recorded from now on and why, where that has changed.
    pub fn look(&mut self) -> Option<(LogLevel, String)> {
        if self.looked.is_some_and(|at| at.elapsed() < LOOK_PERIOD) {
            return None;
        }
        self.looked = Some(Instant::now());
        let (free, whole) = space(&self.folder)?;
        let scarce = scarce_bytes(whole);
        let held_to = level(free, scarce, self.held_to);
        if std::mem::replace(&mut self.held_to, held_to) == held_to {
            return None;
        }
        let free_mb = free as f64 / 1e6;
        let says = match held_to {
            LogLevel::Full => {
                format!("recorded as asked for again: {free_mb:.0} MB of the disk are free")
            }
            held_to => format!(
                "recorded no more than --log {held_to}: {free_mb:.0} MB of the disk are free"
            ),
        };
        let _ = match held_to {
            LogLevel::Full => fs::remove_file(&self.file),
            _ => fs::write(&self.file, &says),
        };
        Some((held_to, says))
    }
}

/// Bytes that are free on the file system of a folder, and all that it has; none where it says nothing.
pub fn space(folder: &Path) -> Option<(u64, u64)> {
    let found = statvfs(folder).ok().filter(|found| found.f_blocks > 0)?;
    let bytes = |blocks: u64| blocks.saturating_mul(found.f_frsize);
    Some((bytes(found.f_bavail), bytes(found.f_blocks)))
}

/// Free room that is scarce on a disk of so many bytes.
pub fn scarce_bytes(disk_bytes: u64) -> u64 {
    (disk_bytes / SCARCE_SHARE).min(SCARCE_BYTES)
}

/// What may be recorded with so much free; back only where there is half as much again, so that it does not change with each file.
fn level(free: u64, scarce: u64, before: LogLevel) -> LogLevel {
    let steps = [(scarce / 4, LogLevel::Events), (scarce, LogLevel::Axes)];
    let held = steps.into_iter().find(|(bytes, level)| {
        let back = if before <= *level { bytes / 2 } else { 0 };
        free < bytes + back
    });
    held.map_or(LogLevel::Full, |(_, level)| level)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_fall_with_the_room_and_come_back_with_half_as_much_again() {
        let mut at = LogLevel::Full;
        let mut after = |free: u64| {
            at = level(free, 1000, at);
            at
        };
        let frees = [1000, 999, 1100, 251, 249, 300, 375, 1499, 1500, 100, 2000];
        use LogLevel::{Axes, Events, Full};
        let levels = [
            Full, Axes, Axes, Axes, Events, Events, Axes, Axes, Full, Events, Full,
        ];
        assert_eq!(frees.map(&mut after), levels);
        // A small disk is not scarce as a whole.
        assert_eq!(scarce_bytes(1_000_000_000), 20_000_000);
        assert_eq!(scarce_bytes(u64::MAX), SCARCE_BYTES);
    }
}
