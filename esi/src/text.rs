//! The text of an ESI file.

use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

/// Longest file that is read, in bytes; a vendor's largest have a third of it.
const BYTES_MAX: u64 = 128 << 20;

/// Reads a file's bytes.
///
/// # Errors
/// It is no file, too long, or cannot be read, in words.
pub fn read(path: &Path) -> Result<Vec<u8>, String> {
    let cannot_be_read = |error: std::io::Error| format!("cannot be read: {error}");
    // Looked at before it is opened: opening a pipe would wait for its writer.
    if !std::fs::metadata(path).map_err(cannot_be_read)?.is_file() {
        return Err("is not a file".into());
    }
    let file = std::fs::File::open(path).map_err(cannot_be_read)?;
    let mut bytes = Vec::new();
    file.take(BYTES_MAX + 1)
        .read_to_end(&mut bytes)
        .map_err(cannot_be_read)?;
    if bytes.len() as u64 > BYTES_MAX {
        return Err(format!("is longer than {BYTES_MAX} bytes: no ESI file is"));
    }
    Ok(bytes)
}

/// UTF-16 where its mark is there, else UTF-8; of any other code the letters beyond ASCII, which are in names alone, get a sign of
/// replacement.
pub fn decode(bytes: &[u8]) -> Cow<'_, str> {
    match bytes {
        [0xFF, 0xFE, rest @ ..] => wide(rest, u16::from_le_bytes).into(),
        [0xFE, 0xFF, rest @ ..] => wide(rest, u16::from_be_bytes).into(),
        [0xEF, 0xBB, 0xBF, rest @ ..] => String::from_utf8_lossy(rest),
        _ => String::from_utf8_lossy(bytes),
    }
}

fn wide(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> String {
    let units = bytes
        .chunks_exact(2)
        .filter_map(|pair| Some(unit(pair.try_into().ok()?)));
    let letters = char::decode_utf16(units);
    letters
        .map(|letter| letter.unwrap_or(char::REPLACEMENT_CHARACTER))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn utf_16_and_8_bit_codes_are_read() {
        assert_eq!(decode(b"\xFF\xFE<\0a\0/\0>\0"), "<a/>");
        assert_eq!(decode(b"\xFE\xFF\0<\0a\0/\0>"), "<a/>");
        assert_eq!(decode(b"\xEF\xBB\xBF<a/>"), "<a/>");
        assert_eq!(decode(b"<a b='\xFC'/>"), "<a b='\u{FFFD}'/>");
    }
}
