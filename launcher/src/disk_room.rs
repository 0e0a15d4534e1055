//! Room on the disk for logs.

use std::path::Path;

use anyhow::bail;
use machine::{LogLevel, Machine};
use monitor::room::{scarce_bytes, space};

/// Without so much there is no room for the copies and the events of a run.
const LEAST_BYTES: u64 = 1_000_000;
/// With more than this nobody reckons how long a program takes: hours of log.
const PLENTY_BYTES: u64 = 20_000_000_000;
/// A scan takes so much of a log, where all axes move,
const SCAN_BYTES: f64 = 80.0;
/// and so much for each axis;
const AXIS_BYTES: f64 = 135.0;
/// the factor by which the state of every servo makes that more.
const FULL_TIMES: f64 = 3.5;

/// Room of a file system, in bytes.
#[derive(Debug)]
pub struct Room {
    /// What is free.
    pub free: u64,
    /// All of it.
    pub whole: u64,
}

impl Room {
    /// Of the file system that a folder is on, or is to be made on; none where that says nothing.
    pub fn of(folder: &Path) -> Option<Room> {
        let there = folder.ancestors().find(|of| of.exists());
        let there = there.filter(|of| !of.as_os_str().is_empty());
        let there = there.unwrap_or(Path::new("."));
        let (free, whole) = space(there)?;
        Some(Room { free, whole })
    }

    /// Whether little is free, somewhat before the recorder writes less. Where it was scarce it is until still more is free: it does not
    /// change with each file.
    pub fn is_scarce(&self, was: bool) -> bool {
        let least = scarce_bytes(self.whole);
        self.free < if was { 2 * least } else { least + least / 2 }
    }

    /// What is free, for people.
    pub fn words(&self) -> String {
        format!("{:.1} MB of the disk are free", self.free as f64 / 1e6)
    }
}

/// Bytes that the log of so many seconds takes, about.
fn log_bytes(machine: &Machine, level: LogLevel, seconds: f64) -> f64 {
    let of_scan = SCAN_BYTES + AXIS_BYTES * machine.axes.len() as f64;
    let is_full = level == LogLevel::Full;
    let times = if is_full { FULL_TIMES } else { 1.0 };
    of_scan * times * seconds / machine.scan_period_s()
}

/// Looks for room where a run directory is to be made; says so where the log of so many seconds will not find it.
///
/// # Errors
/// There is next to none.
pub fn check(
    folder: &Path,
    machine: &Machine,
    level: LogLevel,
    seconds: impl FnOnce() -> Option<f64>,
) -> anyhow::Result<()> {
    // What says nothing of its room is no reason.
    let Some(Room { free, .. }) = Room::of(folder) else {
        return Ok(());
    };
    let (shown, free_mb) = (folder.display(), free as f64 / 1e6);
    if free < LEAST_BYTES {
        let least_mb = LEAST_BYTES as f64 / 1e6;
        bail!(
            "{shown}: the disk has no room for a run: {free_mb:.1} MB are free, at least {least_mb:.1} MB are needed; `[log] keep_mb` removes old runs"
        );
    }
    if free > PLENTY_BYTES {
        return Ok(());
    }
    let needed = seconds().map_or(0.0, |seconds| log_bytes(machine, level, seconds));
    if needed > free as f64 {
        tracing::warn!(
            "{shown}: the log of this program takes about {:.0} MB, and {free_mb:.1} MB are free: it will not be whole (--log events records none)",
            needed / 1e6
        );
    }
    Ok(())
}
