//! What is beside the processes of a cell where the command that starts them has it: a cell does without.

use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;
use std::process::Stdio;

use anyhow::{Context, bail};
use console::{child, logs};

/// The desk: a command with `report`, `web` and `monitor` as subcommands.
#[derive(Debug, Clone, Copy)]
pub struct Desk {
    /// Says what this PC lacks for real time.
    pub say_what_realtime_lacks: fn(),
}

/// Refuses what only a desk can do, where there is none.
///
/// # Errors
/// One of these options is given, and there is no desk.
pub fn check(desk: Option<Desk>, options: &[(&str, bool)]) -> anyhow::Result<()> {
    match options.iter().find(|(_, given)| *given) {
        Some((name, _)) if desk.is_none() => {
            bail!("{name}: is of `quadrant`: this command runs cells alone")
        }
        _ => Ok(()),
    }
}

/// Has the report of a run directory made by a process of its own; its text.
///
/// # Errors
/// The report cannot be made, and why.
pub fn report(run_dir: &Path) -> anyhow::Result<String> {
    // A file takes all of it, however long, while its errors are read.
    let mut text: File = tempfile::tempfile()?;
    let mut child = child::command("report")
        .arg(run_dir)
        .stdout(text.try_clone()?)
        .stderr(Stdio::piped())
        .spawn()?;
    let lines = child.stderr.take().context("its errors")?;
    let lines = logs::forward("report".into(), lines)?;
    let status = child.wait()?;
    let last_words = lines.join().ok().flatten();
    if !status.success() {
        bail!(last_words.unwrap_or_else(|| format!("its process ended with {status}")));
    }
    let mut printed = String::new();
    text.rewind()?;
    text.read_to_string(&mut printed)?;
    Ok(printed.trim_end_matches('\n').to_owned())
}
