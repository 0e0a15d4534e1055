//! Comments that say something.

use super::Interpreter;
use crate::expression::Cursor;
use crate::parameters::base;
use crate::program::ProgramEnd;
use crate::reader::CommentKind;

const LOG_FILE: &str = "LOGOPEN, LOGAPPEND and LOGCLOSE name no file: what (LOG, …) says stands in the run's own messages.jsonl";
const PROBE_FILE: &str = "PROBEOPEN names no file: what the probe finds up to PROBECLOSE stands in the run's own messages.jsonl";
const ABORTS: &str = "(ABORT, …) gives the program up here: what stands behind it is not read";
const NO_ABORT: &str = "a comment that does nothing, as in LinuxCNC: (ABORT, …) gives the program up, with its comma at once behind the word";
const BESIDE_O_WORD: &str = "a comment on the line of an O-word says and does nothing, as in LinuxCNC: put it on a line of its own";

impl Interpreter {
    /// Does what the comments of a line ask for, up to an ABORT.
    pub fn obey_comments(&mut self, comments: &[(CommentKind, String)], beside_o_word: bool) {
        for (kind, text) in comments {
            if beside_o_word {
                self.note(self.line, BESIDE_O_WORD);
            } else if self.ended.is_none() {
                self.obey_comment(*kind, text);
            }
        }
    }

    fn obey_comment(&mut self, kind: CommentKind, text: &str) {
        let line = self.line;
        match kind {
            CommentKind::Message => self.route.output.say(line, false, text.to_owned()),
            CommentKind::Debug if self.state.parameters().get(base::DEBUG_SHOWN) <= 0.0 => {}
            CommentKind::Debug | CommentKind::Print | CommentKind::Log => {
                let text = self.with_values(text);
                self.route.output.say(line, kind == CommentKind::Log, text);
            }
            CommentKind::LogFile => self.note(line, LOG_FILE),
            CommentKind::ProbeOpen | CommentKind::ProbeClose => {
                self.questions.log_probes(kind == CommentKind::ProbeOpen);
                self.note(line, PROBE_FILE);
            }
            CommentKind::Abort => {
                self.note(line, ABORTS);
                let text = self.with_values(text);
                self.route.output.say(line, false, text);
                self.ended = Some(ProgramEnd::Abort(line));
            }
            CommentKind::NoAbort => self.note(line, NO_ABORT),
            // The reader refuses it.
            CommentKind::Python => {}
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
