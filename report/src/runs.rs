//! `quadrant runs`: which run directories there are, and what can be done with them.

mod export;
mod found;
#[cfg(feature = "parquet")]
mod parquet;
mod table;

pub use found::newest;

use std::path::{Path, PathBuf};
use std::{fs, io};

use anyhow::{Context, bail};
use bus::cell::if_there;
use monitor::MARK_FILE;
use monitor::log::LOG_FILE;

use crate::options::{RunsCommand, RunsOptions};
use console::exit::{Kind, Outcome};
use console::logs;
use console::output::{plain, say};
use launcher::retention::folders;

/// `quadrant runs`.
pub fn runs(options: &RunsOptions) -> Outcome {
    logs::init_launcher();
    let mark = |run: &Path| run.join(MARK_FILE);
    match &options.what {
        None => {
            let runs = found::find(options.folder.as_deref()).input()?;
            say(&table::table(&runs, options.json));
            Ok(())
        }
        Some(RunsCommand::Mark { run, reason }) => each(run, "marked", |run| {
            machine::replace_file(&mark(run), reason)
        }),
        Some(RunsCommand::Unmark { run }) => each(run, "not marked", |run| {
            if_there(fs::remove_file(mark(run))).map(drop)
        }),
        Some(RunsCommand::Remove { run, marked }) => {
            for run in run {
                may_go(run, *marked).input()?;
            }
            each(run, "removed", |run| fs::remove_dir_all(run))
        }
        Some(RunsCommand::Export(options)) => export::export(options),
    }
}

/// A path, as it may stand on a terminal.
fn shown(path: &Path) -> String {
    plain(&path.to_string_lossy())
}

/// Changes all of these runs, or none if one is no run.
fn each(runs: &[PathBuf], word: &str, change: impl Fn(&Path) -> io::Result<()>) -> Outcome {
    runs.iter().try_for_each(|run| must_be_run(run)).input()?;
    for run in runs {
        change(run)
            .with_context(|| format!("{}: cannot be {word}", shown(run)))
            .environment()?;
        say(&format!("{}: {word}", shown(run)));
    }
    Ok(())
}

/// The folder of a cell that stays up holds runs, and is none.
pub(super) fn must_be_no_cell(folder: &Path) -> anyhow::Result<()> {
    let mut runs: Vec<PathBuf> = folders(folder).collect();
    runs.retain(|run| monitor::run_number(run).is_some());
    runs.sort();
    match runs.as_slice() {
        [first, .., last] | [first @ last] if !folder.join(LOG_FILE).exists() => {
            let [folder, first, last] = [folder, first, last].map(shown);
            bail!("{folder}: is the folder of a cell; its runs are {first} to {last}")
        }
        _ => Ok(()),
    }
}

fn must_be_run(run: &Path) -> anyhow::Result<()> {
    must_be_no_cell(run)?;
    if !found::is_run(run) {
        bail!(
            "{}: is not a run directory, which has a machine.toml and an events.jsonl or a log: `quadrant runs` shows those that there are",
            shown(run)
        );
    }
    Ok(())
}

/// Whether a run may be removed.
fn may_go(run: &Path, marked: bool) -> anyhow::Result<()> {
    must_be_run(run)?;
    let shown = shown(run);
    // Without a slash at its end, which would lead to what a link names.
    let itself: PathBuf = run.components().collect();
    if itself.is_symlink() || !found::is_made(run) {
        bail!("{shown}: is a link or a copy: only directories that a run has made are removed");
    }
    if found::is_busy(run) {
        bail!("{shown}: the run is under way, or its report: it can go once both are done");
    }
    if run.join(MARK_FILE).exists() && !marked {
        bail!("{shown}: is marked: `quadrant runs unmark`, or --marked to remove it all the same");
    }
    let names = folders(run).filter_map(|folder| Some(folder.file_name()?.to_owned()));
    let mut names = names.map(|name| plain(&name.to_string_lossy()));
    if let Some(name) = names.find(|name| !name.starts_with("against-")) {
        bail!("{shown}: holds the folder {name}, which is of no run: move it away first");
    }
    Ok(())
}
