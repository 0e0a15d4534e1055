//! Comments that say something.

use super::CommentKind;
use crate::expression::{Cursor, Lookup};

const LOG_FILE: &str = "LOGOPEN, LOGAPPEND and LOGCLOSE name no file: what (LOG, …) says stands in the run's own messages.jsonl";
const PROBE_FILE: &str = "PROBEOPEN names no file: what the probe finds up to PROBECLOSE stands in the run's own messages.jsonl";
const ABORTS: &str = "(ABORT, …) gives the program up here: what stands behind it is not read";
const NO_ABORT: &str = "a comment that does nothing, as in LinuxCNC: (ABORT, …) gives the program up, with its comma at once behind the word";
/// What is said of a comment on the line of an O-word.
pub const BESIDE_O_WORD: &str = "a comment on the line of an O-word says and does nothing, as in LinuxCNC: put it on a line of its own";

/// What is said of a comment that does other than it seems to.
pub fn remark_of(kind: CommentKind) -> Option<&'static str> {
    Some(match kind {
        CommentKind::LogFile => LOG_FILE,
        CommentKind::ProbeOpen | CommentKind::ProbeClose => PROBE_FILE,
        CommentKind::Abort => ABORTS,
        CommentKind::NoAbort => NO_ABORT,
        _ => return None,
    })
}

/// A text with its parameters replaced by their values, to six decimals or as many as a format before them says.
pub fn with_values(text: &str, values: &impl Lookup) -> String {
    let mut whole = String::new();
    let (mut rest, mut decimals) = (0, 6);
    while let Some(at) = text.get(rest..).and_then(|text| text.find(['#', '%'])) {
        whole += text.get(rest..rest + at).unwrap_or_default();
        if let Some(behind) = text
            .get(rest + at..)
            .and_then(|text| text.strip_prefix('%'))
        {
            rest += at + 1;
            match format_of(behind) {
                Some((length, of_format)) => {
                    rest += length;
                    decimals = of_format;
                }
                None => whole.push('%'),
            }
            continue;
        }
        let mut cursor = Cursor::new(text, rest + at);
        let number_end =
            rest + at + 1 + plain_number(text.get(rest + at + 1..).unwrap_or_default());
        if number_end > rest + at + 1 {
            // A number by itself: a point or blank behind it belongs to the text.
            cursor = Cursor::new(text.get(..number_end).unwrap_or_default(), rest + at);
        }
        match cursor.value(values) {
            Ok(value) => {
                // No sign before 0.
                whole += &format!("{:.decimals$}", value + 0.0);
                rest = cursor.offset;
            }
            Err(_) => {
                // A name that has no value is shown as LinuxCNC does; a # that names nothing stays.
                let mut name = Cursor::new(text, rest + at + 1);
                rest += at + 1;
                if name.next_byte() == b'<' && name.name().is_ok() {
                    whole += "######";
                    rest = name.offset;
                } else {
                    whole.push('#');
                }
            }
        }
    }
    whole + text.get(rest..).unwrap_or_default()
}

/// The format that a text begins with, behind its %: its length, and its decimals. As LinuxCNC has them: `d`, `f` and `.2f`.
fn format_of(text: &str) -> Option<(usize, usize)> {
    match text.as_bytes() {
        [b'd', ..] => Some((1, 0)),
        [b'f', ..] => Some((1, 4)),
        [b'.', digit @ b'0'..=b'9', b'f', ..] => Some((3, usize::from(digit - b'0'))),
        _ => None,
    }
}

/// Length of the digits that a text begins with.
fn plain_number(text: &str) -> usize {
    text.bytes().take_while(u8::is_ascii_digit).count()
}
