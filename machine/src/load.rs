//! Reads a machine file.

use std::path::{Path, PathBuf};

use toml_edit::{DocumentMut, Item, TableLike, value};

use crate::machine::Machine;
use crate::parameter_file::{KeptParameters, parameter_text, parse_parameters};
use crate::renamed::RENAMED;
use crate::rules;
use crate::settings_file::{self, Schema, SettingsFileError, read_text};
use crate::tool_table::parse_tools;

impl Machine {
    /// Reads and checks a machine file; `path` is the file or its folder.
    ///
    /// # Errors
    /// Unreadable, too large, not UTF-8, not TOML, unknown or missing keys, or values against their rules: each with file, line,
    /// value, unit and what would be right.
    pub fn load(path: &Path) -> Result<Machine, SettingsFileError> {
        let path = machine_file(path);
        let mut machine = Self::parse(&path.display().to_string(), &read_text(&path)?)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        if !machine.program.tool_table.is_empty() {
            let table = folder.join(&machine.program.tool_table);
            machine.tools = parse_tools(&table.display().to_string(), &read_text(&table)?)?;
        }
        if let Some(file) = machine.parameter_file(&path) {
            machine.parameters = read_parameters(&file)?;
        }
        let folders = machine.program.subroutine_folders.iter();
        machine.subroutine_folders = folders.map(|within| folder.join(within)).collect();
        Ok(machine)
    }

    /// Where the parameters lie that programs of the machine keep whose machine file this is; none if they keep none.
    pub fn parameter_file(&self, machine_file: &Path) -> Option<PathBuf> {
        let name = &self.program.parameter_file;
        let folder = machine_file.parent().unwrap_or(Path::new(""));
        (!name.is_empty()).then(|| folder.join(name))
    }

    /// Where the programs of user M-codes lie that are named in this machine file; none if they are not switched on.
    pub fn user_code_folder(&self, machine_file: &Path) -> Option<PathBuf> {
        let name = &self.program.user_codes;
        let folder = machine_file.parent().unwrap_or(Path::new(""));
        (!name.is_empty()).then(|| folder.join(name))
    }

    /// Copies the drive files of its axes from the folder of its file into another.
    ///
    /// # Errors
    /// A file that cannot be copied.
    pub fn copy_drive_files(&self, from: &Path, to: &Path) -> Result<(), SettingsFileError> {
        for drive in self.axes.iter().filter_map(|axis| axis.drive.as_ref()) {
            copy_file(&from.join(&drive.file), &to.join(&drive.file))?;
        }
        Ok(())
    }

    /// Checks the text of a machine file; `name` is in the messages. A tool table or parameters in a
    /// file of their own are not read.
    ///
    /// # Errors
    /// As [`Machine::load`].
    pub fn parse(name: &str, text: &str) -> Result<Machine, SettingsFileError> {
        let mut machine: Machine = settings_file::load(name, text, RENAMED, rules::judge)?;
        machine.tools = parse_tools(&format!("{name}: tools"), &machine.program.tools)?;
        machine.parameters =
            parse_parameters(&format!("{name}: parameters"), &machine.program.parameters)?;
        Ok(machine)
    }
}

/// The parameters in a file; none if it is not there yet.
fn read_parameters(file: &Path) -> Result<KeptParameters, SettingsFileError> {
    if !file.exists() {
        return Ok(KeptParameters::new());
    }
    parse_parameters(&file.display().to_string(), &read_text(file)?)
}

/// The text in place of a file of parameters that holds none.
const NO_PARAMETERS: &str = "; none yet\n";

/// The text of a machine file that needs no other file, whose parameters are these.
///
/// # Errors
/// It is no TOML.
pub fn with_parameters(
    text: &str,
    parameters: &KeptParameters,
) -> Result<String, toml_edit::TomlError> {
    let mut document: DocumentMut = text.parse()?;
    if let Some(program) = program_of(&mut document) {
        set_parameters(program, parameters);
    }
    Ok(document.to_string())
}

fn program_of(document: &mut DocumentMut) -> Option<&mut dyn TableLike> {
    document
        .get_mut("program")
        .and_then(Item::as_table_like_mut)
}

fn set_parameters(program: &mut dyn TableLike, parameters: &KeptParameters) {
    let text = match parameter_text(parameters) {
        none if none.is_empty() => NO_PARAMETERS.to_owned(),
        text => text,
    };
    program.insert("parameters", value(text));
}

/// The text of a machine file that needs no other file: a tool table and parameters stand in it,
/// and the folder of user M-codes is named in full. For copies that a run or a cell keeps.
///
/// # Errors
/// A file that cannot be read, or is no TOML.
pub fn snapshot(path: &Path) -> Result<String, SettingsFileError> {
    let path = machine_file(path);
    let text = read_text(&path)?;
    let unreadable = |error: toml_edit::TomlError| SettingsFileError::Unreadable {
        path: path.display().to_string(),
        what: error.to_string(),
    };
    let mut document: DocumentMut = text.parse().map_err(unreadable)?;
    let Some(program) = program_of(&mut document) else {
        return Ok(text);
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    let named = |item: Item| folder.join(item.as_str().unwrap_or_default());
    let tool_table = program.remove("tool_table").map(named);
    let parameter_file = program.remove("parameter_file").map(named);
    let user_codes = program.remove("user_codes").map(named);
    if tool_table.is_none() && parameter_file.is_none() && user_codes.is_none() {
        return Ok(text);
    }
    if let Some(folder) = user_codes {
        // They are run where they are; a copy names their folder in full.
        let folder = std::path::absolute(&folder).unwrap_or(folder);
        program.insert("user_codes", value(folder.to_string_lossy().into_owned()));
    }
    if let Some(table) = tool_table {
        program.insert("tools", value(read_text(&table)?));
    }
    if let Some(file) = parameter_file {
        set_parameters(program, &read_parameters(&file)?);
    }
    Ok(document.to_string())
}

/// Copies what a machine file names, tool table, parameters and drive files, into the folder of a copy of it, if it is named from the file's folder.
///
/// # Errors
/// A machine file that cannot be used, or a file that cannot be copied.
pub fn copy_named_files(path: &Path, folder: &Path) -> Result<(), SettingsFileError> {
    let path = machine_file(path);
    let machine = Machine::load(&path)?;
    let beside = path.parent().unwrap_or(Path::new(""));
    machine.copy_drive_files(beside, folder)?;
    let program = machine.program;
    let named = [program.tool_table, program.parameter_file];
    let here = |name: &&String| !name.is_empty() && !Path::new(name).is_absolute();
    for name in named.iter().filter(here) {
        let from = beside.join(name);
        // Parameters need not be there yet.
        if from.exists() {
            copy_file(&from, &folder.join(name))?;
        }
    }
    Ok(())
}

fn copy_file(from: &Path, to: &Path) -> Result<(), SettingsFileError> {
    let copied = to
        .parent()
        .map_or(Ok(()), std::fs::create_dir_all)
        .and_then(|()| std::fs::copy(from, to));
    copied
        .map(|_| ())
        .map_err(|error| SettingsFileError::Unreadable {
            path: from.display().to_string(),
            what: error.to_string(),
        })
}

/// The machine file that a MACHINE argument names: the file itself or `machine.toml` in a folder.
pub fn machine_file(path: &Path) -> PathBuf {
    if path.is_dir() {
        path.join("machine.toml")
    } else {
        path.to_path_buf()
    }
}

/// What a machine file may hold.
pub fn schema() -> Schema {
    Schema::of::<Machine>()
}

/// The page of the machine file in the reference.
pub fn reference() -> String {
    settings_file::reference(include_str!("machine-file.md"), &schema())
}
