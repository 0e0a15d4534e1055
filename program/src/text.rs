//! The bytes of a program, by lines: a text in memory, or a file that is read as it is needed.
use std::fs::File;
use std::io;
use std::os::unix::fs::{FileExt, MetadataExt};
use std::sync::Arc;

use machine::Dialect;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use crate::refusal::{Refusal, refuse};

/// So many bytes are read at a time.
const PIECE_BYTES: usize = 64 << 10;
/// So many places of a file are kept: a program and the subroutines that it calls in turn.
const WINDOWS_MAX: usize = 4;
/// The longest line of a file.
const LINE_BYTES_MAX: usize = 1 << 20;
/// What editors on Windows put before UTF-8 text.
const BYTE_ORDER_MARK: &[u8] = b"\xEF\xBB\xBF";

/// Stands on both sides of the name of a dialect before the first line of a copied program: the dialect travels with its text.
const DIALECT_MARK: char = '\u{1d}';
/// The most bytes before the first line that are no text of the program.
const HEAD_BYTES: usize = 16;

/// What stands before the first line of a program in a dialect.
pub fn dialect_mark(dialect: Dialect) -> String {
    format!("{DIALECT_MARK}{dialect}{DIALECT_MARK}")
}

/// The dialect that a text says it is written in, and how many of its bytes say so.
pub fn marked_dialect(text: &[u8]) -> (Option<Dialect>, usize) {
    for (dialect, _) in Dialect::ALL {
        let mark = dialect_mark(dialect);
        if text.starts_with(mark.as_bytes()) {
            return (Some(dialect), mark.len());
        }
    }
    (None, 0)
}

/// Length and hash of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TextHash {
    /// How many bytes it has.
    pub bytes: u64,
    /// Their XXH3.
    pub xxh3: u64,
}

/// Length and hash of bytes.
pub fn hash_of(bytes: &[u8]) -> TextHash {
    TextHash {
        bytes: bytes.len() as u64,
        xxh3: xxh3_64(bytes),
    }
}

/// A text, of which little or nothing is in memory.
#[derive(Debug, Clone)]
pub enum Text {
    /// All of it is in memory, with the dialect that it says it is written in.
    Whole(Arc<str>, Option<Dialect>),
    /// It is read as it is needed.
    File(Box<FileText>),
}

impl Text {
    /// A text in memory.
    pub fn of(text: &str) -> Self {
        let (dialect, bytes) = marked_dialect(text.as_bytes());
        Self::Whole(text.get(bytes..).unwrap_or_default().into(), dialect)
    }

    /// The dialect that the text says it is written in.
    pub fn dialect(&self) -> Option<Dialect> {
        match self {
            Text::Whole(_, dialect) => *dialect,
            Text::File(file) => file.dialect,
        }
    }

    /// A file that is open.
    pub fn of_file(file: File) -> io::Result<Self> {
        Ok(Self::File(Box::new(FileText::of(file)?)))
    }

    /// The bytes of the line that begins at a byte, without the line feed at its end, and where the next begins; none behind the last.
    /// A text that ends with a line feed has an empty last line.
    pub fn bytes(&mut self, byte: u64) -> Result<Option<(&[u8], u64)>, Refusal> {
        let (line, behind) = match self {
            Text::Whole(whole, _) => {
                let Some(rest) = whole.as_bytes().get(byte as usize..) else {
                    return Ok(None);
                };
                let length = memchr::memchr(b'\n', rest).unwrap_or(rest.len());
                (rest.get(..length).unwrap_or_default(), length)
            }
            Text::File(file) => {
                let Some(line) = file.bytes(byte)? else {
                    return Ok(None);
                };
                (line, line.len())
            }
        };
        Ok(Some((line, byte + behind as u64 + 1)))
    }

    /// The same as text, without its line end.
    pub fn line(&mut self, byte: u64) -> Result<Option<(&str, u64)>, Refusal> {
        if let Text::Whole(whole, _) = self {
            let Some(rest) = whole.get(byte as usize..) else {
                return Ok(None);
            };
            let length = memchr::memchr(b'\n', rest.as_bytes()).unwrap_or(rest.len());
            let line = rest.get(..length).unwrap_or_default();
            let line = line.trim_end_matches('\r');
            return Ok(Some((line, byte + length as u64 + 1)));
        }
        match self.bytes(byte)? {
            Some((line, behind)) => Ok(Some((text_of(line)?, behind))),
            None => Ok(None),
        }
    }

    /// Length and hash, all of it read.
    pub fn hash(&self) -> Result<TextHash, Refusal> {
        match self {
            Text::Whole(whole, _) => Ok(hash_of(whole.as_bytes())),
            Text::File(file) => file.hash(),
        }
    }

    /// How many bytes it has.
    pub fn length(&self) -> u64 {
        match self {
            Text::Whole(whole, _) => whole.len() as u64,
            Text::File(file) => file.length,
        }
    }
}

/// A line without its line end, as text.
pub fn text_of(line: &[u8]) -> Result<&str, Refusal> {
    let mut line = line;
    while let Some(before) = line.strip_suffix(b"\r") {
        line = before;
    }
    let text = std::str::from_utf8(line).map_err(|error| {
        let offset = error.valid_up_to();
        let byte = line.get(offset).copied().unwrap_or_default();
        let found = format!("byte 0x{byte:02X} is not UTF-8 text");
        Refusal::new(offset, found, "save the program as plain text, UTF-8")
    })?;
    match memchr::memchr(0, line) {
        Some(offset) => {
            let right = "a program is plain text, UTF-8";
            refuse(offset, "a byte that is zero: a binary file", right)
        }
        None => Ok(text),
    }
}

/// A file that nobody changes while it is read.
#[derive(Debug, Clone)]
pub struct FileText {
    file: Arc<File>,
    /// Its first bytes that are no text.
    skipped: u64,
    /// The dialect that it says it is written in.
    dialect: Option<Dialect>,
    /// Bytes of its text.
    length: u64,
    /// When it was changed, by the clock of its file system: seconds and nanoseconds.
    changed: (i64, i64),
    /// What is in memory of it, the last used first.
    windows: Vec<Window>,
}

/// A part of a file.
#[derive(Debug, Clone)]
struct Window {
    begin: u64,
    bytes: Vec<u8>,
}

impl Window {
    fn end(&self) -> u64 {
        self.begin + self.bytes.len() as u64
    }

    /// The bytes from a byte on that it holds; none if it is elsewhere.
    fn from(&self, byte: u64) -> Option<&[u8]> {
        let at = byte.checked_sub(self.begin)?;
        self.bytes.get(usize::try_from(at).ok()?..)
    }
}

impl FileText {
    fn of(file: File) -> io::Result<Self> {
        let metadata = file.metadata()?;
        let mut first = [0; HEAD_BYTES];
        let read = file.read_at(&mut first, 0)?;
        let first = first.get(..read).unwrap_or_default();
        let (dialect, marked) = marked_dialect(first);
        let skipped = match first.starts_with(BYTE_ORDER_MARK) {
            true => BYTE_ORDER_MARK.len() as u64,
            false => marked as u64,
        };
        Ok(Self {
            file: Arc::new(file),
            skipped,
            dialect,
            length: metadata.len() - skipped,
            changed: (metadata.mtime(), metadata.mtime_nsec()),
            windows: vec![],
        })
    }

    /// The bytes of the line that begins at a byte.
    fn bytes(&mut self, byte: u64) -> Result<Option<&[u8]>, Refusal> {
        if byte > self.length {
            return Ok(None);
        }
        let length = match self.length_in_window(byte) {
            Some(length) => length,
            None => self.fill(byte)?,
        };
        let first = self.windows.first();
        let rest = first.and_then(|window| window.from(byte));
        Ok(rest.and_then(|rest| rest.get(..length)))
    }

    /// Length of the line that begins at a byte, if the first window holds all of it.
    fn length_in_window(&self, byte: u64) -> Option<usize> {
        let window = self.windows.first()?;
        let rest = window.from(byte)?;
        let ends = window.end() == self.length;
        memchr::memchr(b'\n', rest).or(ends.then_some(rest.len()))
    }

    /// Brings the line that begins at a byte into the first window; its length.
    fn fill(&mut self, byte: u64) -> Result<usize, Refusal> {
        let holds = |window: &Window| window.from(byte).is_some();
        let found = self.windows.iter().position(holds);
        match found {
            Some(at) => self
                .windows
                .get_mut(..=at)
                .unwrap_or_default()
                .rotate_right(1),
            None => {
                let full = self.windows.len() == WINDOWS_MAX;
                let old = self.windows.pop_if(|_| full);
                let room = || Vec::with_capacity(2 * PIECE_BYTES);
                let mut bytes = old.map_or_else(room, |window| window.bytes);
                bytes.clear();
                self.windows.insert(0, Window { begin: byte, bytes });
            }
        }
        loop {
            if let Some(length) = self.length_in_window(byte) {
                return Ok(length);
            }
            self.read_on(byte)?;
        }
    }

    /// Reads the next bytes into the first window, and forgets those before `byte`.
    fn read_on(&mut self, byte: u64) -> Result<(), Refusal> {
        self.check_unchanged()?;
        let Some(window) = self.windows.first_mut() else {
            return Ok(());
        };
        let passed = (byte - window.begin) as usize;
        window.bytes.drain(..passed.min(window.bytes.len()));
        window.begin = byte;
        let held = window.bytes.len();
        if held > LINE_BYTES_MAX {
            let found = format!("a line of more than {LINE_BYTES_MAX} bytes");
            return refuse(0, found, "a program is text by lines");
        }
        window.bytes.resize(held + PIECE_BYTES, 0);
        let at = self.skipped + byte + held as u64;
        let to = window.bytes.get_mut(held..).unwrap_or_default();
        let read = self.file.read_at(to, at);
        let count = *read.as_ref().unwrap_or(&0);
        window.bytes.truncate(held + count);
        read.map_err(unread)?;
        if count == 0 {
            return Err(self.shorter(byte + held as u64));
        }
        Ok(())
    }

    fn shorter(&self, end: u64) -> Refusal {
        let found = format!("the file ends after {end} bytes; it had {}", self.length);
        Refusal::new(0, found, "a file that is left as it is while it is read")
    }

    fn check_unchanged(&self) -> Result<(), Refusal> {
        let now = self.file.metadata();
        let now = now.map_err(unread)?;
        if now.len() < self.skipped + self.length {
            return Err(self.shorter(now.len()));
        }
        if now.len() != self.skipped + self.length
            || (now.mtime(), now.mtime_nsec()) != self.changed
        {
            let right = "a file that is left as it is while it is read";
            let found = "the file was changed while it was read";
            return refuse(0, found, right);
        }
        Ok(())
    }

    fn hash(&self) -> Result<TextHash, Refusal> {
        let mut hash = Xxh3::new();
        let mut piece = vec![0; 4 * PIECE_BYTES];
        let mut done = 0;
        while done < self.length {
            let read = self.file.read_at(&mut piece, self.skipped + done);
            let count = read.map_err(unread)?;
            let left = usize::try_from(self.length - done).unwrap_or(usize::MAX);
            let bytes = piece.get(..count.min(left)).unwrap_or_default();
            if bytes.is_empty() {
                return Err(self.shorter(done));
            }
            hash.update(bytes);
            done += bytes.len() as u64;
        }
        self.check_unchanged()?;
        Ok(TextHash {
            bytes: self.length,
            xxh3: hash.digest(),
        })
    }
}

fn unread(error: io::Error) -> Refusal {
    let found = format!("the file cannot be read on ({error})");
    Refusal::new(0, found, "a file that stays where it is while it runs")
}

#[cfg(test)]
mod tests;
