//! `events.jsonl`: what happened to the process group, a line each, written as it happens.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use anyhow::Context;
use serde::Serialize;

/// One line.
#[derive(Debug, Serialize)]
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
}

impl<'a> Event<'a> {
    /// An event of the whole cell.
    pub fn of_cell(scan: u64, event: &'a str, text: Option<String>) -> Event<'a> {
        Event {
            scan,
            event,
            process: None,
            pid: None,
            text,
        }
    }
}

/// The file.
#[derive(Debug)]
pub struct Events {
    file: File,
}

impl Events {
    /// Makes it in a run directory.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn create(run_dir: &Path) -> anyhow::Result<Events> {
        let path = run_dir.join("events.jsonl");
        let file = File::create(&path)
            .with_context(|| format!("{}: cannot be written", path.display()))?;
        Ok(Events { file })
    }

    /// Writes one; a full disk costs the line and a warning, not the run.
    pub fn write(&mut self, event: &Event<'_>) {
        let line = serde_json::to_string(event).unwrap_or_default() + "\n";
        if let Err(error) = self.file.write_all(line.as_bytes()) {
            tracing::warn!(%error, "events.jsonl cannot be written");
        }
    }
}
