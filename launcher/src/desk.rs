//! What is beside the processes of a cell where the command that starts them has it: a cell does without.

use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;
use std::process::Stdio;

use anyhow::{Context, bail};
use console::exit::Failure;
use console::{child, logs};

use crate::observers::Observer;

/// Command with the subcommands of the desk: `report`, and one for each observer.
#[derive(Clone, Copy)]
pub struct Desk<'a> {
    /// Says what this PC lacks for real time.
    pub say_what_realtime_lacks: fn(),
    /// Opens what is to be shown of a cell, before anything starts: an address that is taken is refused in time.
    pub observers: &'a dyn Fn() -> Result<Vec<Observer>, Failure>,
}

/// What a desk wants to be shown; without one nothing.
///
/// # Errors
/// It cannot be shown as it is wanted.
pub fn observers(desk: Option<Desk<'_>>) -> Result<Vec<Observer>, Failure> {
    desk.map_or(Ok(Vec::new()), |desk| (desk.observers)())
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
