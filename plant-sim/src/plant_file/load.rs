//! Reads a plant file.

use std::path::Path;

use machine::settings_file::{self, Schema, SettingsFileError, read_text};

use crate::plant_file::keys::PlantFile;
use crate::plant_file::{rules, simple};

impl PlantFile {
    /// Reads and checks a plant file; `path` is the file or its folder.
    ///
    /// # Errors
    /// Unreadable, too large, not UTF-8, not TOML, unknown or missing key, or a value against its rule: each with file,
    /// line, value, unit and what would be right.
    pub fn load(path: &Path) -> Result<PlantFile, SettingsFileError> {
        let file = if path.is_dir() {
            path.join("plant.toml")
        } else {
            path.to_path_buf()
        };
        Self::parse(&file.display().to_string(), &read_text(&file)?)
    }

    /// Checks the text of a plant file; `name` is in the messages.
    ///
    /// # Errors
    /// As [`PlantFile::load`].
    pub fn parse(name: &str, text: &str) -> Result<PlantFile, SettingsFileError> {
        settings_file::load_with(name, text, &[], simple::complete, rules::judge)
    }
}

/// What a plant file may hold.
pub fn schema() -> Schema {
    Schema::of::<PlantFile>()
}
