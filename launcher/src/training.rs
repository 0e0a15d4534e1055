//! What earlier runs have trained, as an input of this one.

use std::path::{Path, PathBuf};

use machine::Machine;
use machine::learned::{Learned, learned_file};

/// The file of what earlier runs have trained (`learned.toml` beside the machine file), unless it is not to be used; settings that it does
/// not fit any more are reported.
///
/// # Errors
/// The file is there, and not usable.
pub fn trained(
    machine_path: &Path,
    machine: &Machine,
    without: bool,
) -> anyhow::Result<Option<PathBuf>> {
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
    Ok(Some(path))
}
