//! Reads and judges a drive file.

use std::path::Path;

use machine::settings_file::{self, Schema, SettingsFileError, read_text};

use crate::drive_file::against;
use crate::drive_file::keys::DriveFile;
use crate::drive_file::rules;
use crate::esi::Esi;

/// A drive file that is good.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    /// What it says.
    pub drive: DriveFile,
    /// What the controller can do without, or what may be meant so; a line each.
    pub warnings: Vec<String>,
}

/// Reads a drive file and judges it by itself, and against an ESI file if there is one.
///
/// # Errors
/// Unreadable, no TOML, an unknown or missing key, or a value against its rule: everything that is wrong, each with file, line, value
/// and what to do.
pub fn load(path: &Path, esi: Option<&Esi>) -> Result<Judged, SettingsFileError> {
    parse(&path.display().to_string(), &read_text(path)?, esi)
}

/// The same of the text of a drive file; `name` is in the messages.
///
/// # Errors
/// As [`load`].
pub fn parse(name: &str, text: &str, esi: Option<&Esi>) -> Result<Judged, SettingsFileError> {
    let mut warnings = Vec::new();
    let drive = settings_file::load(name, text, &[], |all, drive: &DriveFile| {
        rules::judge(all, drive);
        warnings = rules::warnings(drive);
        if let Some(esi) = esi {
            against::judge(all, drive, esi);
        }
    })?;
    Ok(Judged { drive, warnings })
}

/// What a drive file may hold.
pub fn schema() -> Schema {
    Schema::of::<DriveFile>()
}

/// The page of the drive file in the reference.
pub fn reference() -> String {
    settings_file::reference(include_str!("drive-file.md"), &schema())
}
