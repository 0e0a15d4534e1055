//! The files that are in a log: what it takes to understand it without the folder it was written in.

use std::ops::ControlFlow;
use std::path::Path;

use mcap::McapError;
use mcap::records::Record;

use super::error::LogError;
use super::records::{Broken, Records, parse_record};

/// Names and contents of the files in a log: its machine file and its program at least. They stand before everything else.
///
/// # Errors
/// The file cannot be opened or is no MCAP.
pub fn attached_files(path: &Path) -> Result<Vec<(String, Vec<u8>)>, LogError> {
    let mut files = Vec::new();
    // What is looked for stands before the first chunk.
    let ended = Records::outside_chunks(path)?.each(|opcode, data| {
        match parse_record(opcode, data) {
            Ok(Record::Attachment { header, data, .. }) => {
                files.push((header.name, data.into_owned()));
            }
            Ok(Record::Header(_) | Record::Metadata(_)) => {}
            Ok(_) => return ControlFlow::Break(Ok(())),
            Err(error) => return ControlFlow::Break(Err(Broken::Cut(error))),
        }
        ControlFlow::Continue(())
    });
    match ended.and_then(|ended| ended.unwrap_or(Ok(()))) {
        // A log that was cut there still has the files before.
        Err(Broken::Cut(McapError::UnexpectedEof)) if !files.is_empty() => Ok(files),
        Err(broken) => Err(broken.of_file(path)),
        Ok(()) => Ok(files),
    }
}
