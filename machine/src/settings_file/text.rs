//! The text of a settings file.

use std::io::Read;
use std::path::Path;

use bus::files::open_to_read;

use crate::settings_file::error::SettingsFileError;

/// Longest settings file that is read, in bytes.
pub const SETTINGS_FILE_BYTES_MAX: u64 = 1 << 20;

/// Reads a settings file.
///
/// # Errors
/// It is no file, too long, not to be read, or not UTF-8.
pub fn read_text(path: &Path) -> Result<String, SettingsFileError> {
    read_text_within(path, SETTINGS_FILE_BYTES_MAX)
}

/// The same of a file that may be so long.
pub(crate) fn read_text_within(path: &Path, bytes_max: u64) -> Result<String, SettingsFileError> {
    read(path, bytes_max).map_err(|what| SettingsFileError::Unreadable {
        path: path.display().to_string(),
        what,
    })
}

fn read(path: &Path, bytes_max: u64) -> Result<String, String> {
    let cannot_be_read = |e: std::io::Error| format!("cannot be read: {e}");
    if !std::fs::metadata(path).map_err(cannot_be_read)?.is_file() {
        return Err("is not a file".into());
    }
    let file = open_to_read(path).map_err(cannot_be_read)?;
    let mut bytes = Vec::new();
    file.take(bytes_max + 1)
        .read_to_end(&mut bytes)
        .map_err(cannot_be_read)?;
    if bytes.len() as u64 > bytes_max {
        return Err(format!(
            "is longer than {bytes_max} bytes: no settings file is"
        ));
    }
    String::from_utf8(bytes).map_err(|e| {
        let good = e.utf8_error().valid_up_to();
        format!("is not UTF-8 text (byte {good} is the first that is not)")
    })
}
