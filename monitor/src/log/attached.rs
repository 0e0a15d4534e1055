//! The files that are in a log: what it takes to understand it without the folder it was written in.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader};

use super::error::LogError;
use super::feed::{careful, fill};

/// Names and contents of the files in a log: its machine file and its program at least. They stand before everything else.
///
/// # Errors
/// The file cannot be opened or is no MCAP.
pub fn attached_files(path: &Path) -> Result<Vec<(String, Vec<u8>)>, LogError> {
    let failed = |source| LogError::File {
        path: path.into(),
        source,
    };
    let not_a_log = |error: mcap::McapError| match error {
        mcap::McapError::UnexpectedEof => LogError::Empty { path: path.into() },
        error => LogError::NotALog {
            path: path.into(),
            what: format!("is not an MCAP log: {error}"),
        },
    };
    let mut file = BufReader::with_capacity(1 << 18, File::open(path).map_err(failed)?);
    // Chunks are not opened: what is looked for stands before the first.
    let mut mcap = LinearReader::new_with_options(careful().with_emit_chunks(true));
    let mut files = Vec::new();
    while let Some(event) = mcap.next_event() {
        match event {
            Ok(LinearReadEvent::ReadRequest(bytes)) => {
                fill(&mut file, &mut mcap, bytes).map_err(failed)?;
            }
            Ok(LinearReadEvent::Record { opcode, data }) => {
                match crate::log::record::parse_record(opcode, data).map_err(not_a_log)? {
                    Record::Attachment { header, data, .. } => {
                        files.push((header.name, data.into_owned()));
                    }
                    Record::Header(_) | Record::Metadata(_) => {}
                    _ => break,
                }
            }
            // A log that was cut there still has the files before.
            Err(mcap::McapError::UnexpectedEof) if !files.is_empty() => break,
            Err(error) => return Err(not_a_log(error)),
        }
    }
    Ok(files)
}
