//! `events.jsonl`: what happened to the process group, a line each, written as it happens.

use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use anyhow::Context;
use rustix::fs::{FallocateFlags, fallocate};
use serde::Serialize;

use crate::retention::{self, EVENTS_FILE};

/// Room on the disk that is reserved for the events of a run: some 600.
const RESERVED_BYTES: u64 = 64 << 10;
/// Lines that may wait for room on the disk.
const WAITING_MAX_BYTES: usize = 64 << 10;

/// One line.
#[derive(Debug, Default, Serialize)]
pub struct Event<'a> {
    /// Newest scan the launcher had seen.
    pub scan: u64,
    /// What happened: started, ready, died, interrupted, ended, …
    pub event: &'a str,
    /// To which process.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub process: Option<&'a str>,
    /// Its process id.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pid: Option<u32>,
    /// More, for people.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub text: Option<String>,
    /// How a run ended: completed, interrupted or stopped. A log that was not written to the end does not show it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outcome: Option<&'static str>,
}

impl<'a> Event<'a> {
    /// An event of the whole cell.
    pub fn of_cell(scan: u64, event: &'a str, text: Option<String>) -> Event<'a> {
        Event {
            scan,
            event,
            text,
            ..Event::default()
        }
    }
}

/// The file. A line that cannot be written waits for the next one: a disk that was full for a while costs none.
#[derive(Debug)]
pub struct Events<W = File> {
    file: W,
    /// What has not been written yet; a line may have been written in part.
    waiting: Vec<u8>,
    /// Lines for which there was no room.
    lost: u64,
    failed: bool,
}

impl Events {
    /// Makes it in a run directory.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn create(run_dir: &Path) -> anyhow::Result<Events> {
        let path = run_dir.join(EVENTS_FILE);
        let file = File::create(&path)
            .with_context(|| format!("{}: cannot be written", path.display()))?;
        retention::hold(&file);
        // Where the log fills the disk, the end of the run is noted all the same. Not every file system can do it.
        let _ = fallocate(&file, FallocateFlags::KEEP_SIZE, 0, RESERVED_BYTES);
        Ok(Events::to(file))
    }

    /// Those of a run of which nothing is kept.
    ///
    /// # Errors
    /// There is no `/dev/null`.
    pub fn nowhere() -> anyhow::Result<Events> {
        Ok(Events::to(File::create("/dev/null")?))
    }
}

impl<W: Write> Events<W> {
    fn to(file: W) -> Events<W> {
        Events {
            file,
            waiting: Vec::new(),
            lost: 0,
            failed: false,
        }
    }

    /// Writes one; a full disk costs a warning, not the run.
    pub fn write(&mut self, event: &Event<'_>) {
        self.wait_in_line(event);
        let written = self.write_waiting();
        if let Err(error) = &written
            && !self.failed
        {
            tracing::warn!(%error, "events.jsonl cannot be written for now");
        }
        self.failed = written.is_err();
        if written.is_ok() && self.lost > 0 {
            let text = format!("{} events for which there was no room", self.lost);
            self.lost = 0;
            self.wait_in_line(&Event::of_cell(event.scan, "events lost", Some(text)));
            let _ = self.write_waiting();
        }
    }

    /// Writes one of the whole cell, with a text.
    pub fn note(&mut self, scan: u64, event: &str, text: impl Into<String>) {
        self.write(&Event::of_cell(scan, event, Some(text.into())));
    }

    /// Writes one of a process, with a text.
    pub fn note_of(&mut self, process: &str, scan: u64, event: &str, text: impl Into<String>) {
        self.write(&Event {
            process: Some(process),
            ..Event::of_cell(scan, event, Some(text.into()))
        });
    }

    /// Writes one of a process that was started.
    pub fn note_started(&mut self, process: &str, pid: u32, scan: u64, event: &str) {
        self.write(&Event {
            process: Some(process),
            pid: Some(pid),
            ..Event::of_cell(scan, event, None)
        });
    }

    fn wait_in_line(&mut self, event: &Event<'_>) {
        let line = serde_json::to_string(event).unwrap_or_default() + "\n";
        if self.waiting.len() + line.len() > WAITING_MAX_BYTES {
            self.lost += 1;
            return;
        }
        self.waiting.extend_from_slice(line.as_bytes());
    }

    fn write_waiting(&mut self) -> io::Result<()> {
        while !self.waiting.is_empty() {
            match self.file.write(&self.waiting) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(written) => drop(self.waiting.drain(..written)),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk with so much room.
    struct Disk {
        text: Vec<u8>,
        room: usize,
    }

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let fits = bytes.len().min(self.room.saturating_sub(self.text.len()));
            if fits == 0 {
                return Err(ErrorKind::StorageFull.into());
            }
            self.text.extend_from_slice(&bytes[..fits]);
            Ok(fits)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn events_in(events: &Events<Disk>) -> Vec<(u64, String)> {
        let text = String::from_utf8(events.file.text.clone()).expect("text");
        let lines = text.lines().map(|line| {
            let value: serde_json::Value = serde_json::from_str(line).expect("a whole line");
            let word = value["event"].as_str().expect("an event").to_string();
            (value["scan"].as_u64().expect("a scan"), word)
        });
        lines.collect()
    }

    #[test]
    fn a_disk_that_was_full_for_a_while_costs_no_line_and_breaks_none() {
        let text = Vec::new();
        let mut events = Events::to(Disk { text, room: 50 });
        for scan in 0..5 {
            events.write(&Event::of_cell(scan, "died", None));
        }
        events.file.room = usize::MAX;
        events.write(&Event::of_cell(5, "ended", None));
        let all = events_in(&events);
        assert_eq!(all.len(), 6, "{all:?}");
        assert_eq!(all[5], (5, "ended".into()));
    }

    #[test]
    fn what_waits_is_bounded_and_what_is_lost_is_said() {
        let text = Vec::new();
        let mut events = Events::to(Disk { text, room: 0 });
        for scan in 0..10_000 {
            events.write(&Event::of_cell(scan, "died", None));
        }
        assert!(events.waiting.len() <= WAITING_MAX_BYTES);
        events.file.room = usize::MAX;
        events.write(&Event::of_cell(10_000, "died", None));
        let all = events_in(&events);
        let last = all.last().map(|(_, word)| word.as_str());
        assert_eq!(last, Some("events lost"));
    }
}
