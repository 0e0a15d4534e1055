//! Reading the program file.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::string::FromUtf8Error;

use bus::files::open_to_read;

use crate::error::{ProgramError, refuse_file};
use crate::refusal::{Refusal, column};
use crate::text::{Text, TextHash};

/// The largest program file: 64 MiB, some two million blocks, days of machining.
pub const FILE_BYTES_MAX: u64 = 64 << 20;

/// Opens a program file; what is no regular file is refused.
pub fn open_file(file: &Path) -> Result<File, ProgramError> {
    let name = &file.display().to_string();
    let unreadable = |error: std::io::Error| unreadable(name, &error);
    let metadata = std::fs::metadata(file).map_err(unreadable)?;
    if metadata.is_dir() {
        return refuse_file(name, "is a directory", "name the program file in it");
    }
    if !metadata.is_file() {
        return refuse_file(name, "is not a regular file", "name a program file");
    }
    open_to_read(file).map_err(unreadable)
}

/// A file that the operating system does not let us read.
pub fn unreadable(name: &str, error: &std::io::Error) -> ProgramError {
    let right = bus::limits::hint(error).unwrap_or("a program is a file that can be read");
    ProgramError::of_file(name, format!("cannot be read ({error})"), right)
}

/// The text of a program file; what is no regular file, too large or not text is refused, a large file before it is read.
pub fn read_text(file: &Path) -> Result<String, ProgramError> {
    let name = &file.display().to_string();
    let unreadable = |error: std::io::Error| unreadable(name, &error);
    let opened = open_file(file)?;
    let too_large = |bytes: u64| {
        let found = format!("has {:.1} MiB", bytes as f64 / f64::from(1 << 20));
        ProgramError::of_file(
            name,
            found,
            format!("a program file has at most {} MiB", FILE_BYTES_MAX >> 20),
        )
    };
    let length = opened.metadata().map_err(unreadable)?.len();
    if length > FILE_BYTES_MAX {
        return Err(too_large(length));
    }
    let mut bytes = Vec::new();
    opened
        .take(FILE_BYTES_MAX + 1)
        .read_to_end(&mut bytes)
        .map_err(unreadable)?;
    if bytes.len() as u64 > FILE_BYTES_MAX {
        return Err(too_large(bytes.len() as u64));
    }
    if let Some(offset) = bytes.iter().position(|&byte| byte == 0) {
        let found = format!("is a binary file (byte {offset} is zero)");
        return refuse_file(name, found, "a program is plain text, UTF-8");
    }
    let text = String::from_utf8(bytes).map_err(|error| not_text(name, error))?;
    // Editors on Windows put a byte order mark before UTF-8 text.
    Ok(match text.strip_prefix('\u{feff}') {
        Some(rest) => rest.to_owned(),
        None => text,
    })
}

/// The file beside a program file that tells length and hash of its text.
fn hash_file(file: &Path) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(".hash");
    name.into()
}

/// Writes length and hash of a program's text beside it, into `FILE.hash`: whoever reads the file from there on need not read all of
/// it first.
///
/// # Errors
/// A file that cannot be read, or a folder that cannot be written.
pub fn write_text_hash(file: &Path) -> Result<(), ProgramError> {
    let name = &file.display().to_string();
    let TextHash { bytes, xxh3 } = open_text(file)?
        .hash()
        .map_err(|error| ProgramError::of_text(name, error))?;
    let text = format!("{bytes} bytes, xxh3 {xxh3:016x}\n");
    std::fs::write(hash_file(file), text).map_err(|error| {
        let found = format!("its hash cannot be written beside it ({error})");
        ProgramError::of_file(name, found, "a folder that can be written")
    })
}

/// The text of a program file, read as it is needed.
pub fn open_text(file: &Path) -> Result<Text, ProgramError> {
    let opened = Text::of_file(open_file(file)?);
    opened.map_err(|error| unreadable(&file.display().to_string(), &error))
}

/// Length and hash of a file's text: as they stand beside it, if they were written behind its last change and have its length; else all
/// of it is read.
pub fn text_hash(file: &Path, text: &Text) -> Result<TextHash, ProgramError> {
    if let Some(hash) = written_hash(file).filter(|hash| hash.bytes == text.length()) {
        return Ok(hash);
    }
    let name = file.display().to_string();
    text.hash()
        .map_err(|error| ProgramError::of_text(&name, error))
}

fn written_hash(file: &Path) -> Option<TextHash> {
    let beside = hash_file(file);
    let changed = |path: &Path| std::fs::metadata(path).ok()?.modified().ok();
    if changed(&beside)? < changed(file)? {
        return None;
    }
    let text = std::fs::read_to_string(beside).ok()?;
    let (bytes, xxh3) = text.trim().split_once(" bytes, xxh3 ")?;
    Some(TextHash {
        bytes: bytes.parse().ok()?,
        xxh3: u64::from_str_radix(xxh3, 16).ok()?,
    })
}

/// Where bytes are no text.
fn not_text(name: &str, error: FromUtf8Error) -> ProgramError {
    let valid_bytes = error.utf8_error().valid_up_to();
    let bytes = error.into_bytes();
    let (valid, rest) = bytes.split_at(valid_bytes);
    let valid = String::from_utf8_lossy(valid);
    let line = u32::try_from(valid.matches('\n').count()).unwrap_or(u32::MAX - 1) + 1;
    let last = valid.rsplit('\n').next().unwrap_or_default();
    let byte = rest.first().copied().unwrap_or_default();
    let found = format!("byte 0x{byte:02X} is not UTF-8 text");
    let refusal = Refusal::new(0, found, "save the program as plain text, UTF-8");
    ProgramError::at(name, Some((line, column(last, last.len()))), refusal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::program::AxisSetup;
    use crate::{Program, Setup, load};
    use path::geometry::AxisVector;

    fn load_bytes(bytes: &[u8]) -> Result<Program, ProgramError> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("part.ngc");
        std::fs::write(&file, bytes).unwrap();
        load_at(&file)
    }

    fn load_at(file: &Path) -> Result<Program, ProgramError> {
        let axis = |letter| AxisSetup {
            letter,
            travel_min: -100.0,
            travel_max: 100.0,
            rotary: false,
            modulo: false,
        };
        let setup = Setup {
            axes: vec![axis('X'), axis('Y')],
            ..Setup::default()
        };
        load(file, &setup, AxisVector::zeros())
    }

    fn refused(result: Result<Program, ProgramError>, part: &str) {
        let text = result.unwrap_err().to_string();
        assert!(text.contains(part), "{text}");
    }

    #[test]
    fn a_file_with_byte_order_mark_and_windows_line_ends_is_read() {
        let program = load_bytes(b"\xEF\xBB\xBFG0 X1\r\nG1 X5 F600\r\nM2\r\n").unwrap();
        assert_eq!(program.path.elements.len(), 2);
    }

    #[test]
    fn files_that_are_no_programs_are_refused_with_the_reason() {
        refused(load_bytes(b""), "no blocks");
        refused(load_bytes(b"(only a comment)\n\n"), "no blocks");
        refused(
            load_bytes(b"\x7fELF\x02\x01\x01\0\0"),
            "binary file (byte 7 is zero)",
        );
        refused(
            load_bytes(b"G0 X1\n(gr\xFC\xDF)\n"),
            "part.ngc:2:4: byte 0xFC is not UTF-8",
        );
        refused(
            load_at(Path::new("/nowhere/part.ngc")),
            "/nowhere/part.ngc: cannot be read",
        );
        refused(load_at(&std::env::temp_dir()), "is a directory");
        refused(load_at(Path::new("/dev/zero")), "not a regular file");
    }

    #[test]
    fn a_file_of_200_mb_is_refused_before_it_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("huge.ngc");
        File::create(&file).unwrap().set_len(200_000_000).unwrap();
        refused(
            load_at(&file),
            "has 190.7 MiB: a program file has at most 64 MiB",
        );
    }
}
