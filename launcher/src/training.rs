//! What earlier runs have trained, as an input of this one.

use std::path::{Path, PathBuf};

use anyhow::bail;
use machine::Machine;
use machine::learned::{Learned, learned_file};
use machine::learned_path::{LearnedPath, learned_path_file, path_settings_hash, trial_path_file};
use machine::settings_file::read_text;

use crate::check::Checked;
use crate::options::RunOptions;
use crate::run_dir::program_name;

/// The text of what earlier runs have trained (`learned.toml` beside the machine file), unless it is not to be used; settings that it
/// does not fit any more are reported. A run that learns from the program `trial` tries what passes of it have taught last.
///
/// # Errors
/// The file is there, and not usable.
pub fn trained(
    machine_path: &Path,
    machine: &Machine,
    without: bool,
    trial: Option<&str>,
) -> anyhow::Result<Option<String>> {
    if without {
        return Ok(None);
    }
    let Some(trained) = Learned::beside(machine_path, machine)? else {
        return Ok(None);
    };
    let path = learned_file(machine_path);
    for axis in trained.outdated(machine) {
        tracing::warn!(
            "{}: axis {axis} has other settings now: what it had learned is not used",
            path.display()
        );
    }
    Ok(Some(match trial {
        Some(program) => trained.on_trial(program).text(),
        // As it is written, comments of whoever looked into it included.
        None => read_text(&path)?,
    }))
}

/// The file of what earlier runs of this program have learned along its path, unless it is not to be used: the best correction, or in
/// a run that learns the one on trial. One that does not fit the program or the settings any more is reported and not used.
///
/// # Errors
/// A file is there, and not usable; or this program cannot be learned along its path.
pub fn along_path(
    machine_path: &Path,
    checked: &Checked,
    options: &RunOptions,
) -> anyhow::Result<Option<PathBuf>> {
    // A pass of --learn shows what the model lacks, not what this program still needs.
    if options.start.no_learned || options.learn {
        return Ok(None);
    }
    let machine = &checked.machine;
    let name = program_name(&options.program)?;
    let Some(program) = &checked.program else {
        if options.learn_path {
            bail!("{name}: is too long to be learned along its path");
        }
        return Ok(None);
    };
    let settings = || -> anyhow::Result<String> {
        let learned = Learned::beside(machine_path, machine)?;
        Ok(path_settings_hash(machine, learned.as_ref()))
    };
    let mut files = vec![learned_path_file(machine_path, name)];
    if options.learn_path {
        files.insert(0, trial_path_file(machine_path, name));
    }
    for file in files {
        let Some(path) = LearnedPath::load(&file, machine)? else {
            continue;
        };
        match path.unfit(program.source_hash, &settings()?) {
            None => return Ok(Some(file)),
            Some(why) => tracing::warn!(
                "{}: {why}: what was learned along the path is not used",
                file.display()
            ),
        }
    }
    Ok(None)
}
