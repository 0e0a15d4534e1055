//! The records of a log file, one after the other. What is in the file may be anything: it is checked before anything of it is used,
//! and asks for no more memory than a log needs.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::ops::ControlFlow;
use std::path::Path;

use bus::files::open_to_read;
use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::error::LogError;

/// Bytes of a file that are read ahead.
const BUFFER_BYTES: usize = 1 << 18;
/// Most that is read from the file at once, in bytes.
const READ_BYTES: usize = 1 << 20;
/// Longest record outside a chunk that is read, in bytes: a program of 200 MB and room.
const RECORD_BYTES_MAX: usize = 256 << 20;

/// Why there are no more records before their end.
#[derive(Debug)]
pub enum Broken {
    /// They end early, or something is no record.
    Cut(McapError),
    /// The file can no longer be read.
    Failed(io::Error),
}

impl Broken {
    /// The same as an error of the whole file.
    pub(super) fn of_file(self, path: &Path) -> LogError {
        let path = path.into();
        match self {
            Broken::Failed(source) => LogError::File { path, source },
            Broken::Cut(McapError::UnexpectedEof) => LogError::Empty { path },
            Broken::Cut(error) => LogError::NotALog {
                path,
                what: format!("is not an MCAP log: {error}"),
            },
        }
    }
}

/// The records of a file, or of a chunk.
pub struct Records<R> {
    mcap: LinearReader,
    file: R,
}

fn careful() -> LinearReaderOptions {
    LinearReaderOptions::default()
        .with_record_length_limit(RECORD_BYTES_MAX)
        .with_prevalidate_chunk_crcs(true)
}

impl Records<BufReader<File>> {
    /// Those of a file, of its chunks too.
    pub(super) fn open(path: &Path) -> Result<Self, LogError> {
        Self::with(path, careful())
    }

    /// The same; chunks are not opened.
    pub(super) fn outside_chunks(path: &Path) -> Result<Self, LogError> {
        Self::with(path, careful().with_emit_chunks(true))
    }

    fn with(path: &Path, options: LinearReaderOptions) -> Result<Self, LogError> {
        let file = open_to_read(path).map_err(LogError::of_file(path))?;
        Ok(Records {
            mcap: LinearReader::new_with_options(options),
            file: BufReader::with_capacity(BUFFER_BYTES, file),
        })
    }
}

impl<R: Read> Records<R> {
    /// Those of one chunk, which `file` ends with.
    pub fn of_chunk(file: R) -> Self {
        let options = careful()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true);
        Records {
            mcap: LinearReader::new_with_options(options),
            file,
        }
    }

    /// Hands kind and content of each record to `take`, until that breaks off; what it broke off with, none at the end.
    ///
    /// # Errors
    /// There are no more before the end.
    pub fn each<T>(
        &mut self,
        mut take: impl FnMut(u8, &[u8]) -> ControlFlow<T>,
    ) -> Result<Option<T>, Broken> {
        while let Some(event) = self.mcap.next_event() {
            match event.map_err(Broken::Cut)? {
                LinearReadEvent::ReadRequest(bytes) => {
                    // A wrong length in a damaged file must not become one large allocation.
                    let space = self.mcap.insert(bytes.clamp(1, READ_BYTES));
                    let read = self.file.read(space).map_err(Broken::Failed)?;
                    self.mcap.notify_read(read);
                }
                LinearReadEvent::Record { opcode, data } => {
                    if let ControlFlow::Break(found) = take(opcode, data) {
                        return Ok(Some(found));
                    }
                }
            }
        }
        Ok(None)
    }
}

/// Log time and creation time, before the name of an attachment.
const TIMES_BYTES: usize = 16;
/// The length of the data, behind the media type.
const LENGTH_BYTES: usize = 8;
/// The checksum, behind the data.
const CHECKSUM_BYTES: usize = 4;

/// Parses a record as [`mcap::parse_record`] does.
///
/// `mcap` 0.26 slices an attachment that ends before its data begins without asking for its length, and panics.
///
/// # Errors
/// Whatever is wrong with it.
pub fn parse_record(opcode: u8, body: &[u8]) -> Result<Record<'_>, McapError> {
    if opcode == op::ATTACHMENT && !holds_its_header(body) {
        return Err(McapError::BadAttachmentLength {
            header: (TIMES_BYTES + LENGTH_BYTES + CHECKSUM_BYTES) as u64,
            available: body.len() as u64,
        });
    }
    mcap::parse_record(opcode, body)
}

/// Whether an attachment is long enough for its times, its two texts, the length of its data and its checksum.
fn holds_its_header(body: &[u8]) -> bool {
    let behind_text = |at: usize| {
        let bytes = body.get(at..at.checked_add(4)?)?;
        let length = u32::from_le_bytes(bytes.try_into().ok()?);
        at.checked_add(4)?.checked_add(length as usize)
    };
    behind_text(TIMES_BYTES)
        .and_then(behind_text)
        .and_then(|at| at.checked_add(LENGTH_BYTES + CHECKSUM_BYTES))
        .is_some_and(|end| end <= body.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_attachment_cut_anywhere_is_refused_or_read() {
        let mut body = vec![0; TIMES_BYTES];
        for text in ["part.ngc", "text/plain"] {
            body.extend((text.len() as u32).to_le_bytes());
            body.extend(text.as_bytes());
        }
        body.extend(3u64.to_le_bytes());
        body.extend(b"G0\n");
        body.extend([0; CHECKSUM_BYTES]);
        for length in 0..body.len() {
            assert!(
                parse_record(op::ATTACHMENT, &body[..length]).is_err(),
                "{length}"
            );
        }
        assert!(!holds_its_header(&[0xff; 64]));
    }
}
