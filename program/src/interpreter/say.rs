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

/// A text with its parameters replaced by their values, to six decimals.
pub fn with_values(text: &str, values: &impl Lookup) -> String {
    let mut whole = String::new();
    let mut rest = 0;
    while let Some(at) = text.get(rest..).and_then(|text| text.find('#')) {
        whole += text.get(rest..rest + at).unwrap_or_default();
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
                whole += &format!("{:.6}", value + 0.0);
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

/// Length of the digits that a text begins with.
fn plain_number(text: &str) -> usize {
    text.bytes().take_while(u8::is_ascii_digit).count()
}
