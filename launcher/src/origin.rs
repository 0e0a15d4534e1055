//! Where a cell was started: an order that names none must not move the machine of somebody else.

use std::ffi::OsString;
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use bus::cell::CellPaths;

use console::exit::{Failure, Kind};

/// Notes in the folder of a cell where its machine file lies, before the cell runs.
///
/// # Errors
/// One of them is not there.
pub fn note(cell: &CellPaths, machine_file: &Path) -> std::io::Result<()> {
    let file = std::fs::canonicalize(machine_file)?;
    let folder = file.parent().unwrap_or(Path::new("/"));
    std::fs::write(cell.origin_file(), folder.as_os_str().as_encoded_bytes())
}

/// Whether the machine of a cell that was not named is one of this folder.
///
/// # Errors
/// It is not, or where its machine file lies is not known.
pub fn check(cell: &CellPaths) -> Result<(), Failure> {
    let here = here().environment()?;
    let machine = folder_of(cell);
    if machine
        .as_deref()
        .is_some_and(|machine| is_of(machine, &here))
    {
        return Ok(());
    }
    let name = cell.name();
    let machine = machine.map_or("elsewhere".into(), |at| format!("from {}", at.display()));
    Err(Failure::Input(anyhow!(
        "the only cell that runs is {name:?}, started {machine}, which is not in this folder: if it is meant, say so with --cell {name}"
    )))
}

/// Which of several cells was started from a machine in this folder, below it or above it, where only one was.
pub fn only_one_of_this_folder(cells: &[&CellPaths]) -> Option<usize> {
    let here = here().ok()?;
    let is_meant = |cell: &CellPaths| folder_of(cell).is_some_and(|machine| is_of(&machine, &here));
    let mut meant = (0..).zip(cells).filter(|(_, cell)| is_meant(cell));
    let (index, _) = meant.next()?;
    meant.next().is_none().then_some(index)
}

fn here() -> std::io::Result<PathBuf> {
    std::env::current_dir().and_then(std::fs::canonicalize)
}

/// The folder of the machine that a cell was started with, if it is noted.
fn folder_of(cell: &CellPaths) -> Option<PathBuf> {
    let noted = std::fs::read(cell.origin_file()).ok()?;
    Some(PathBuf::from(OsString::from_vec(noted)))
}

/// Whether a machine lies in or below a folder, or the folder in or below that of the machine.
fn is_of(machine: &Path, here: &Path) -> bool {
    machine.starts_with(here) || here.starts_with(machine)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::is_of;

    #[test]
    fn a_machine_belongs_to_the_folders_above_and_below_it() {
        let machine = Path::new("/shop/machines/xy");
        for here in [
            "/",
            "/shop",
            "/shop/machines/xy",
            "/shop/machines/xy/programs",
        ] {
            assert!(is_of(machine, Path::new(here)), "{here}");
        }
        for here in ["/shop/machines/xyz", "/shop/machines/x", "/home"] {
            assert!(!is_of(machine, Path::new(here)), "{here}");
        }
    }
}
