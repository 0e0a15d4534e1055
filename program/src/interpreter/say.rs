//! Comments that say something.

use super::*;
use crate::expression::Cursor;

impl Interpreter {
    /// Keeps what the comments of a line say.
    pub fn say(&mut self, index: usize, comments: &[(CommentKind, String)]) {
        for (kind, text) in comments {
            let text = match kind {
                CommentKind::Message => text.clone(),
                CommentKind::Print | CommentKind::Log => self.with_values(text),
                CommentKind::LogFile => {
                    let text = "LOGOPEN, LOGAPPEND and LOGCLOSE name no file: what (LOG, …) says stands in the run's own messages.jsonl";
                    self.note(index as u32 + 1, text);
                    continue;
                }
            };
            let log_only = *kind == CommentKind::Log;
            self.output.say(index as u32 + 1, log_only, text);
        }
    }

    /// A text with its parameters replaced by their values, to six decimals.
    fn with_values(&self, text: &str) -> String {
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
            match cursor.value(self) {
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
}

/// Length of the digits that a text begins with.
fn plain_number(text: &str) -> usize {
    text.bytes().take_while(u8::is_ascii_digit).count()
}
