//! Reads a machine file.

use std::path::{Path, PathBuf};

use toml_edit::{DocumentMut, Item, value};

use crate::machine::Machine;
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
        let folders = machine.program.subroutine_folders.iter();
        machine.subroutine_folders = folders.map(|within| folder.join(within)).collect();
        Ok(machine)
    }

    /// Checks the text of a machine file; `name` is in the messages. A tool table in a file of its own is not read.
    ///
    /// # Errors
    /// As [`Machine::load`].
    pub fn parse(name: &str, text: &str) -> Result<Machine, SettingsFileError> {
        let mut machine: Machine = settings_file::load(name, text, RENAMED, rules::judge)?;
        machine.tools = parse_tools(&format!("{name}: tools"), &machine.program.tools)?;
        Ok(machine)
    }
}

/// The text of a machine file that needs no other file: a tool table stands in it. For copies that a run or a cell keeps.
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
    let Some(program) = document
        .get_mut("program")
        .and_then(Item::as_table_like_mut)
    else {
        return Ok(text);
    };
    let Some(table) = program.remove("tool_table") else {
        return Ok(text);
    };
    let folder = path.parent().unwrap_or(Path::new(""));
    let tools = read_text(&folder.join(table.as_str().unwrap_or_default()))?;
    program.insert("tools", value(tools));
    Ok(document.to_string())
}

/// Copies the tool table that a machine file names into the folder of a copy of it, if it is named from the file's folder.
///
/// # Errors
/// A machine file that cannot be used, or a table that cannot be copied.
pub fn copy_tool_table(path: &Path, folder: &Path) -> Result<(), SettingsFileError> {
    let path = machine_file(path);
    let table = Machine::load(&path)?.program.tool_table;
    if table.is_empty() || Path::new(&table).is_absolute() {
        return Ok(());
    }
    let from = path.parent().unwrap_or(Path::new("")).join(&table);
    let to = folder.join(&table);
    let copied = to
        .parent()
        .map_or(Ok(()), std::fs::create_dir_all)
        .and_then(|()| std::fs::copy(&from, &to));
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
