//! Terminal files: what the controller must know of a device that has inputs and outputs, and no motor.
//!
//! [`load()`] reads and judges one; the crate `esi` makes them of vendors' ESI files.

mod channel;
mod keys;
mod rules;

use std::path::Path;

use machine::settings_file::{self, Rules, Schema, SettingsFileError, read_text};

pub use channel::ChannelCode;
pub use keys::{Channel, ChannelDirection, ChannelKind, TerminalData, TerminalFile};

/// Reads a terminal file and judges it by itself, and by what is to be judged `besides`.
///
/// # Errors
/// As [`crate::drive_file::load`].
pub fn load(
    path: &Path,
    besides: impl FnOnce(&mut Rules<'_>, &TerminalFile),
) -> Result<TerminalFile, SettingsFileError> {
    parse(&path.display().to_string(), &read_text(path)?, besides)
}

/// The same of the text of a terminal file; `name` is in the messages.
///
/// # Errors
/// As [`load`].
pub fn parse(
    name: &str,
    text: &str,
    besides: impl FnOnce(&mut Rules<'_>, &TerminalFile),
) -> Result<TerminalFile, SettingsFileError> {
    settings_file::load(name, text, &[], |all, terminal: &TerminalFile| {
        rules::judge(all, terminal);
        besides(all, terminal);
    })
}

/// What a terminal file may hold.
pub fn schema() -> Schema {
    Schema::of::<TerminalFile>()
}
