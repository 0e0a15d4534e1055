//! The run directory: made new, with copies of everything the run depends on, so that nobody's edits reach a running cell
//! and the report can be made again.

use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use chrono::{DateTime, Utc};
use machine::learned::LEARNED_FILE;
use machine::learned_path::LEARNED_PATH_FILE;
use machine::{Dialect, KeptFiles, Machine};

use crate::retention::{EVENTS_FILE, RUNS};

/// A run directory with its copies.
#[derive(Debug, Clone)]
pub struct RunDir {
    /// The folder.
    pub folder: PathBuf,
    /// Copy of the machine file.
    pub machine: PathBuf,
    /// The user's files that hold what outlives a run, no copies.
    pub kept_files: KeptFiles,
    /// Where the programs of user M-codes lie: the machine builder's folder, no copy. None if they are not switched on.
    pub user_codes: Option<PathBuf>,
    /// Copy of the plant file; none where the drives are on a fieldbus.
    pub plant: Option<PathBuf>,
    /// Copy of the program, under its own name; none in the folder of a cell that stays up.
    pub program: Option<PathBuf>,
    /// Copy of the scripted orders, if there are any.
    pub orders: Option<PathBuf>,
    /// Copy of the fault script, if there is one.
    pub faults: Option<PathBuf>,
}

/// What is copied into it.
#[derive(Debug)]
pub struct Sources<'a> {
    /// Machine file.
    pub machine: &'a Path,
    /// Plant file, where the drives are simulated.
    pub plant: &'a Path,
    /// Part program.
    pub program: Option<&'a Path>,
    /// Its language, if that is not what the machine file says.
    pub dialect: Option<Dialect>,
    /// Text of what runs before have learned, if it is to be used and there is any.
    pub learned: Option<&'a str>,
    /// What runs before have learned along the program's path, if it is to be used and there is any.
    pub learned_path: Option<&'a Path>,
    /// Scripted orders.
    pub orders: Option<&'a Path>,
    /// Fault script.
    pub faults: Option<&'a Path>,
}

/// The folder a run writes to if none is named.
pub fn default_folder(machine: &str, program: &Path) -> PathBuf {
    let stem = program
        .file_stem()
        .map_or("program".into(), |s| s.to_string_lossy());
    dated_folder(&format!("{machine}-{stem}"))
}

/// `runs/NAME-TIME`, one that is not there yet.
pub fn dated_folder(name: &str) -> PathBuf {
    let base = format!("{RUNS}/{name}-{}", stamp(Utc::now()));
    let mut folder = PathBuf::from(&base);
    let mut number = 2;
    while folder.exists() {
        folder = PathBuf::from(format!("{base}-{number}"));
        number += 1;
    }
    folder
}

/// Year to second, as `20261121-103000`.
fn stamp(time: DateTime<Utc>) -> String {
    time.format("%Y%m%d-%H%M%S").to_string()
}

/// Copies in a run directory that say how the run was set up, besides its program.
pub const SETTINGS_FILES: [&str; 6] = [
    "machine.toml",
    "plant.toml",
    LEARNED_FILE,
    LEARNED_PATH_FILE,
    "orders.toml",
    "faults.toml",
];

/// Files of a run directory that are not the program.
const RESERVED: [&str; 7] = [
    "run.mcap",
    "report.json",
    "report.txt",
    "report.html",
    EVENTS_FILE,
    "messages.jsonl",
    monitor::MARK_FILE,
];

/// The name a program keeps in the run directory.
///
/// # Errors
/// It has none, one that is not UTF-8, or one that a file of the run directory has.
pub fn program_name(program: &Path) -> anyhow::Result<&str> {
    let shown = program.display();
    let name = program
        .file_name()
        .with_context(|| format!("{shown}: is not the name of a file"))?
        .to_str()
        .with_context(|| format!("{shown}: a program's name must be UTF-8"))?;
    let is_log = name.starts_with("run-") && name.ends_with(".mcap");
    let is_black_box = name.starts_with(monitor::BLACK_BOX_PREFIX);
    // Folders of comparisons.
    let is_against = name.starts_with("against-");
    let is_reserved = SETTINGS_FILES.contains(&name) || RESERVED.contains(&name);
    if is_reserved || is_log || is_black_box || is_against || name.ends_with(".svg") {
        bail!("{shown}: a file of that name is written by the run itself: rename the program");
    }
    Ok(name)
}

/// The hash of a smaller program is taken again by whoever reads it. None of these is loaded into a cell: nothing is kept beside those.
const HASHED_BYTES: u64 = program::FILE_BYTES_MAX;

/// Writes a file of this name.
fn write_into(folder: &Path, text: &[u8], name: &str) -> anyhow::Result<PathBuf> {
    let to = folder.join(name);
    fs::write(&to, text).with_context(|| format!("{}: cannot be written", to.display()))?;
    Ok(to)
}

impl RunDir {
    /// Takes it away again: nothing was started.
    pub fn discard(&self) {
        let _ = fs::remove_dir_all(&self.folder);
    }

    /// Makes it and copies the sources.
    ///
    /// # Errors
    /// The folder exists and is not empty, or cannot be written.
    pub fn make(folder: &Path, sources: &Sources<'_>) -> anyhow::Result<RunDir> {
        let shown = folder.display();
        if folder.exists() {
            let mut entries = fs::read_dir(folder)
                .with_context(|| format!("{shown}: is not a folder that can be written to"))?;
            if entries.next().is_some() {
                bail!(
                    "{shown}: is not empty: nothing is written over an earlier run; name another folder"
                );
            }
        }
        fs::create_dir_all(folder).with_context(|| format!("{shown}: cannot be made"))?;
        let write = |text: &str, name: &str| write_into(folder, text.as_bytes(), name);
        let copy = |from: &Path, name: &str| {
            let text = fs::read(from);
            let text = text.with_context(|| format!("{}: cannot be read", from.display()))?;
            write_into(folder, &text, name)
        };
        let copy_if =
            |from: Option<&Path>, name: &str| from.map(|from| copy(from, name)).transpose();
        let machine = Machine::load(sources.machine)?;
        let kept_files = machine.kept_files.clone();
        let user_codes = machine.user_code_folder(sources.machine);
        let user_codes = user_codes.map(std::path::absolute).transpose()?;
        let simulated = machine.bus.is_none();
        let beside = sources.machine.parent().unwrap_or(Path::new(""));
        machine.copy_drive_files(beside, folder)?;
        let program = sources
            .program
            .map(|program| {
                let to = folder.join(program_name(program)?);
                copy_program(program, &machine, sources.dialect, &to)?;
                Ok::<_, anyhow::Error>(to)
            })
            .transpose()?;
        if let Some(learned) = sources.learned {
            write(learned, LEARNED_FILE)?;
        }
        copy_if(sources.learned_path, LEARNED_PATH_FILE)?;
        Ok(RunDir {
            folder: folder.to_path_buf(),
            machine: write(&machine::snapshot(sources.machine)?, "machine.toml")?,
            kept_files,
            user_codes,
            plant: copy_if(simulated.then_some(sources.plant), "plant.toml")?,
            program,
            orders: copy_if(sources.orders, "orders.toml")?,
            faults: copy_if(sources.faults, "faults.toml")?,
        })
    }
}

/// Copies a program with the subroutines of other files that it calls; the copy says in which language it is written, where that is not
/// LinuxCNC's or the machine's another one. Notes the hash of a large one: nobody has to read all of it to
/// know it.
///
/// # Errors
/// It cannot be read or written.
pub fn copy_program(
    program: &Path,
    machine: &Machine,
    dialect: Option<Dialect>,
    to: &Path,
) -> anyhow::Result<()> {
    let named = || format!("{}: cannot be written", to.display());
    let mut copy = BufWriter::new(File::create(to).with_context(named)?);
    let by_machine = machine.program.dialect;
    let dialect = dialect.unwrap_or(by_machine);
    let folders = &machine.subroutine_folders;
    program::bundle_to(program, folders, dialect, by_machine, &mut copy)?;
    let copy = copy.into_inner().with_context(named)?;
    if copy.metadata().with_context(named)?.len() > HASHED_BYTES {
        program::write_text_hash(to)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unix_time_is_written_as_the_date_that_it_is() {
        let utc = |seconds| DateTime::from_timestamp(seconds, 0).map(stamp);
        assert_eq!(utc(0).as_deref(), Some("19700101-000000"));
        assert_eq!(utc(951_782_399).as_deref(), Some("20000228-235959"));
        assert_eq!(utc(951_782_400).as_deref(), Some("20000229-000000"));
        assert_eq!(utc(1_795_257_000).as_deref(), Some("20261121-103000"));
    }
}
