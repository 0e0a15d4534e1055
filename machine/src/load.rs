//! Reads a machine file.

use std::path::{Path, PathBuf};

use crate::machine::Machine;
use crate::renamed::RENAMED;
use crate::rules;
use crate::settings_file::{self, Schema, SettingsFileError, read_text};

impl Machine {
    /// Reads and checks a machine file; `path` is the file or its folder.
    ///
    /// # Errors
    /// Unreadable, too large, not UTF-8, not TOML, unknown or missing keys, or values against their rules: each with file, line,
    /// value, unit and what would be right.
    pub fn load(path: &Path) -> Result<Machine, SettingsFileError> {
        let path = machine_file(path);
        Self::parse(&path.display().to_string(), &read_text(&path)?)
    }

    /// Checks the text of a machine file; `name` is in the messages.
    ///
    /// # Errors
    /// As [`Machine::load`].
    pub fn parse(name: &str, text: &str) -> Result<Machine, SettingsFileError> {
        settings_file::load(name, text, RENAMED, rules::judge)
    }
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
