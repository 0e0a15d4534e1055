//! What outlives a run, in files of the user: parameters that programs keep, work offsets, the tool table.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use bus::cell::CellPaths;
use bus::files::open_own;
use bus::kept_parameters::{KeptFile, kept_file, name_kept_file, text_of_run};
use bus::locks::holders;
use bus::sample::Auxiliaries;

use crate::beginning::{Beginning, SPINDLE_FILE, parse_spindle_file, spindle_file_text};
use crate::kept_files::KeptFiles;
use crate::machine::Machine;
use crate::offsets_file::{offsets_text, parse_offsets};
use crate::parameter_file::{KeptParameters, is_always_kept, parameter_text, parse_parameters};
use crate::settings_file::{SettingsFileError, read_text};
use crate::tool_table::{Tool, parse_tools};
use crate::tools_file::{parse_tools_file, tool_table_text, tools_file_text};
use crate::whole_file::replace_file;

/// Name of the file of work offsets beside a machine file that names no other.
pub const OFFSETS_FILE: &str = "offsets.toml";
/// Name of the tool table beside a machine file that names no other.
pub const TOOLS_FILE: &str = "tools.toml";

/// The text in place of parameters where there are none yet.
const NO_PARAMETERS: &str = "; none yet\n";
/// A writer that has not let go by then is held up.
const LOCK_LIMIT: Duration = Duration::from_secs(2);
const LOCK_LOOK: Duration = Duration::from_millis(2);

/// What they hold, as texts, parameters and tools in the form of LinuxCNC.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct KeptTexts {
    /// Parameters; empty where nothing is kept.
    pub parameters: String,
    /// Tools; none where those of the machine file are in force.
    pub tools: Option<String>,
    /// [`Beginning`]: tool, offset and modes.
    pub begins_with: String,
}

impl From<io::Error> for SettingsFileError {
    fn from(error: io::Error) -> Self {
        SettingsFileError::Unreadable {
            path: "what a run begins with".into(),
            what: error.to_string(),
        }
    }
}

/// The text of a file; none if it is not there.
fn text_if_there(file: Option<&PathBuf>) -> Result<Option<(String, String)>, SettingsFileError> {
    let there = file.filter(|file| file.exists());
    let read = |file: &PathBuf| Ok((file.display().to_string(), read_text(file)?));
    there.map(read).transpose()
}

impl KeptFiles {
    /// Those of the machine file that is here.
    pub(crate) fn of(machine: &Machine, machine_file: &Path) -> KeptFiles {
        let folder = machine_file.parent().unwrap_or(Path::new(""));
        let named =
            |name: &str, default: &str| folder.join(if name.is_empty() { default } else { name });
        let program = &machine.program;
        let is_toml = Path::new(&program.tool_table)
            .extension()
            .is_some_and(|extension| extension == "toml");
        let parameters = (!program.parameter_file.is_empty()).then_some(&program.parameter_file);
        KeptFiles {
            parameters: parameters.map(|name| folder.join(name)),
            offsets: program
                .parameters
                .is_empty()
                .then(|| named(&program.offsets, OFFSETS_FILE)),
            tools: (is_toml || program.tool_table.is_empty())
                .then(|| named(&program.tool_table, TOOLS_FILE)),
            spindle: (program.begins_with.is_empty() && program.parameters.is_empty())
                .then(|| folder.join(SPINDLE_FILE)),
        }
    }

    /// Those of a running cell.
    ///
    /// # Errors
    /// The cell's folder cannot be read.
    pub fn of_cell(paths: &CellPaths) -> io::Result<KeptFiles> {
        Ok(KeptFiles {
            parameters: kept_file(paths, KeptFile::Parameters)?,
            offsets: kept_file(paths, KeptFile::Offsets)?,
            tools: kept_file(paths, KeptFile::Tools)?,
            spindle: kept_file(paths, KeptFile::Spindle)?,
        })
    }

    /// Says to a cell which they are: for the launcher, before anybody else is there.
    ///
    /// # Errors
    /// The cell's folder cannot be written.
    pub fn name_in(&self, paths: &CellPaths) -> io::Result<()> {
        let files = [&self.parameters, &self.offsets, &self.tools, &self.spindle];
        for (which, file) in KeptFile::ALL.into_iter().zip(files) {
            if let Some(file) = file {
                name_kept_file(paths, which, &std::path::absolute(file)?)?;
            }
        }
        Ok(())
    }

    /// What they hold now.
    ///
    /// # Errors
    /// A file that cannot be read, or is wrong: with its line, and what would be right.
    pub fn read(&self, machine: &Machine) -> Result<KeptTexts, SettingsFileError> {
        let mut parameters = KeptParameters::new();
        if let Some((name, text)) = text_if_there(self.parameters.as_ref())? {
            parameters = parse_parameters(&name, &text)?;
        }
        let offsets = text_if_there(self.offsets.as_ref())?;
        if let Some((name, text)) = &offsets {
            parameters.retain(|number, _| !is_always_kept(*number));
            parameters.extend(parse_offsets(name, text, machine)?);
        }
        let tools = text_if_there(self.tools.as_ref())?;
        let is_kept = self.parameters.is_some() || offsets.is_some() || tools.is_some();
        let table = |(name, text): (String, String)| {
            Ok::<_, SettingsFileError>(tool_table_text(&parse_tools_file(&name, &text)?))
        };
        let tools = tools.map(table).transpose()?;
        let parameters = match is_kept {
            true if parameters.is_empty() => NO_PARAMETERS.to_owned(),
            true => parameter_text(&parameters),
            false => String::new(),
        };
        let spindle = self.spindle.as_ref();
        let begins_with = match (spindle, text_if_there(spindle)?) {
            (Some(file), Some((_, text))) => parse_spindle_file(file, &text)?.text(),
            _ => String::new(),
        };
        Ok(KeptTexts {
            parameters,
            tools,
            begins_with,
        })
    }

    /// Keeps what a program leaves at its end on this machine, which has what the program began with: each file whole or not at all. What
    /// the program has not changed stays as it is there now.
    ///
    /// # Errors
    /// A file that cannot be written, or is wrong.
    pub fn keep(
        &self,
        machine: &Machine,
        parameters: &KeptParameters,
        tools: &[Tool],
    ) -> Result<(), SettingsFileError> {
        // What cannot be changed is known before anything is.
        let mut changes = Vec::new();
        if let Some(file) = self.offsets.as_ref().filter(|file| file.exists()) {
            changes.push(change_offsets(file, machine, |now| {
                for (number, value) in parameters {
                    let began = machine.parameters.get(number).copied();
                    let began = began.unwrap_or_else(|| machine.parameter_default(*number));
                    if is_always_kept(*number) && began != *value {
                        now.insert(*number, *value);
                    }
                }
            })?);
        }
        if let Some(file) = self.tools.as_ref().filter(|file| file.exists()) {
            let changed = tools.iter().filter(|tool| !machine.tools.contains(tool));
            let changed: Vec<&Tool> = changed.collect();
            if !changed.is_empty() {
                changes.push(change_tools(file, |now| {
                    for tool in changed {
                        now.retain(|other| other.number != tool.number);
                        now.push(tool.clone());
                    }
                })?);
            }
        }
        if let Some(file) = &self.parameters {
            let text = parameter_text(parameters);
            replace_file(file, &text).map_err(|error| of_file(file, &error))?;
        }
        changes.into_iter().try_for_each(Change::make)
    }
}

impl KeptTexts {
    /// What the next run of a program in this cell would begin with now.
    ///
    /// # Errors
    /// A file that cannot be read, or is wrong.
    pub fn now(
        paths: &CellPaths,
        machine: &Machine,
        shown: &Auxiliaries,
    ) -> Result<KeptTexts, SettingsFileError> {
        let kept = KeptFiles::of_cell(paths)?.read(machine)?;
        let begins_with = Beginning::now(paths, machine, shown)?.text();
        Ok(KeptTexts {
            begins_with,
            ..kept
        })
    }

    /// What a run of a program in this cell begins with: the first process that asks takes it from the files and from what the master
    /// shows, and all others get the same.
    ///
    /// # Errors
    /// A file that cannot be read, or is wrong.
    pub fn of_run(
        paths: &CellPaths,
        (load, run): (u32, u32),
        machine: &Machine,
        shown: &Auxiliaries,
    ) -> Result<KeptTexts, SettingsFileError> {
        let files = KeptFiles::of_cell(paths)?;
        let begins_with = text_of_run(&paths.beginning(load, run), || {
            Ok::<_, SettingsFileError>(Beginning::now(paths, machine, shown)?.text())
        })?;
        let now = || files.read(machine);
        let parameters = text_of_run(&paths.parameters(load, run), || {
            Ok::<_, SettingsFileError>(now()?.parameters)
        })?;
        let tools = files.tools.as_ref().map(|_| {
            text_of_run(&paths.tools(load, run), || {
                let own = || machine.program.tools.clone();
                Ok::<_, SettingsFileError>(now()?.tools.unwrap_or_else(own))
            })
        });
        Ok(KeptTexts {
            parameters,
            tools: tools.transpose()?,
            begins_with,
        })
    }
}

impl Machine {
    /// Takes what outlives a run; whether anything is another than before.
    ///
    /// # Errors
    /// Texts that are wrong.
    pub fn take_kept(&mut self, kept: KeptTexts) -> Result<bool, SettingsFileError> {
        let parameters = parse_parameters("kept parameters", &kept.parameters)?;
        let mut is_other = parameters != self.parameters;
        is_other |= kept.parameters.is_empty() != self.program.parameters.is_empty();
        let beginning = Beginning::parse("begins_with", &kept.begins_with)?;
        is_other |= beginning != self.beginning;
        self.beginning = beginning;
        self.program.begins_with = kept.begins_with;
        self.parameters = parameters;
        self.program.parameters = kept.parameters;
        if let Some(text) = kept.tools {
            let tools = parse_tools("tools", &text)?;
            is_other |= tools != self.tools;
            self.tools = tools;
            self.program.tools = text;
        }
        Ok(is_other)
    }
}

fn of_file(file: &Path, error: &io::Error) -> SettingsFileError {
    SettingsFileError::Unreadable {
        path: file.display().to_string(),
        what: format!("cannot be written: {error}"),
    }
}

/// Writes the tool in the spindle into its file, whole or not at all.
///
/// # Errors
/// A file that cannot be written.
pub fn keep_tool(file: &Path, tool: u32) -> Result<(), SettingsFileError> {
    change(file, |_| Ok(spindle_file_text(tool)))?.make()
}

/// Changes the work offsets in a file, whole or not at all, one writer at a time.
///
/// # Errors
/// A file that is wrong, cannot be written, or would be wrong.
pub fn update_offsets(
    file: &Path,
    machine: &Machine,
    change: impl FnOnce(&mut KeptParameters),
) -> Result<(), SettingsFileError> {
    change_offsets(file, machine, change)?.make()
}

fn change_offsets(
    file: &Path,
    machine: &Machine,
    by: impl FnOnce(&mut KeptParameters),
) -> Result<Change, SettingsFileError> {
    let name = file.display().to_string();
    change(file, |text| {
        let mut now = parse_offsets(&name, text, machine)?;
        by(&mut now);
        let text = offsets_text(&now, machine);
        // What is written can be read again.
        parse_offsets(&name, &text, machine).map(|_| text)
    })
}

/// Changes the tools in a file, whole or not at all, one writer at a time.
///
/// # Errors
/// A file that is wrong, cannot be written, or would be wrong.
pub fn update_tools(
    file: &Path,
    change: impl FnOnce(&mut Vec<Tool>),
) -> Result<(), SettingsFileError> {
    change_tools(file, change)?.make()
}

fn change_tools(file: &Path, by: impl FnOnce(&mut Vec<Tool>)) -> Result<Change, SettingsFileError> {
    let name = file.display().to_string();
    change(file, |text| {
        let mut now = parse_tools_file(&name, text)?;
        by(&mut now);
        now.sort_by_key(|tool| tool.number);
        let text = tools_file_text(&now);
        parse_tools_file(&name, &text).map(|_| text)
    })
}

/// What is to stand in a file, whose lock is held until it does.
struct Change {
    _lock: File,
    file: PathBuf,
    leads_to: PathBuf,
    /// None where it is the same as before.
    text: Option<String>,
}

impl Change {
    /// Replaces the text of the file, whole or not at all.
    fn make(self) -> Result<(), SettingsFileError> {
        let text = self.text.as_deref();
        let made = text.map_or(Ok(()), |text| replace_file(&self.leads_to, text));
        made.map_err(|error| of_file(&self.file, &error))
    }
}

/// A change of a file, under a lock of its own.
fn change(
    file: &Path,
    by: impl FnOnce(&str) -> Result<String, SettingsFileError>,
) -> Result<Change, SettingsFileError> {
    let failed = |error: io::Error| of_file(file, &error);
    let leads_to = fs::canonicalize(file).unwrap_or_else(|_| file.to_path_buf());
    let name = leads_to.file_name().unwrap_or_default().to_string_lossy();
    let lock = leads_to.with_file_name(format!(".{name}.lock"));
    let lock = open_own(&lock).map_err(|error| of_file(&lock, &error))?;
    let asked = Instant::now();
    while let Err(error) = lock.try_lock() {
        match error {
            TryLockError::WouldBlock if asked.elapsed() < LOCK_LIMIT => {
                std::thread::sleep(LOCK_LOOK);
            }
            TryLockError::WouldBlock => {
                let who = Some(holders(&lock)).filter(|who| !who.is_empty());
                let who = who.unwrap_or_else(|| "another process".into());
                let what = format!("{who} is writing it and does not come to an end");
                return Err(failed(io::Error::new(io::ErrorKind::WouldBlock, what)));
            }
            TryLockError::Error(error) => return Err(failed(error)),
        }
    }
    let before = text_if_there(Some(&leads_to))?.map(|(_, text)| text);
    let text = by(before.as_deref().unwrap_or_default())?;
    Ok(Change {
        _lock: lock,
        file: file.to_path_buf(),
        text: (before.as_ref() != Some(&text)).then_some(text),
        leads_to,
    })
}
