//! Reads and judges a drive file.

use std::path::Path;

use machine::settings_file::{self, Rules, Schema, SettingsFileError, read_text};

use crate::drive_file::keys::DriveFile;
use crate::drive_file::rules;

/// A drive file that is good.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    /// What it says.
    pub drive: DriveFile,
    /// What the controller can do without, or what may be meant so; a line each.
    pub warnings: Vec<String>,
}

/// Reads a drive file and judges it by itself, and by what is to be judged `besides`.
///
/// # Errors
/// Unreadable, no TOML, an unknown or missing key, or a value against its rule: everything that is wrong, each with file, line, value
/// and what to do.
pub fn load(
    path: &Path,
    besides: impl FnOnce(&mut Rules<'_>, &DriveFile),
) -> Result<Judged, SettingsFileError> {
    parse(&path.display().to_string(), &read_text(path)?, besides)
}

/// The same of the text of a drive file; `name` is in the messages.
///
/// # Errors
/// As [`load`].
pub fn parse(
    name: &str,
    text: &str,
    besides: impl FnOnce(&mut Rules<'_>, &DriveFile),
) -> Result<Judged, SettingsFileError> {
    let mut warnings = Vec::new();
    let drive = settings_file::load(name, text, &[], |all, drive: &DriveFile| {
        rules::judge(all, drive);
        warnings = rules::warnings(drive);
        besides(all, drive);
    })?;
    Ok(Judged { drive, warnings })
}

/// What a drive file may hold.
pub fn schema() -> Schema {
    Schema::of::<DriveFile>()
}
