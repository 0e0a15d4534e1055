//! Comments that say something.

use super::*;
use crate::expression::Cursor;

impl Interpreter<'_> {
    /// Keeps what the comments of a line say.
    pub fn say(&mut self, index: usize, comments: &[(CommentKind, String)]) {
        for (kind, text) in comments {
            let text = match kind {
                CommentKind::Message => text.clone(),
                CommentKind::Print | CommentKind::Log => self.with_values(text),
            };
            let message = Message {
                line: index as u32 + 1,
                before_element: self.output.path.elements.len(),
                log_only: *kind == CommentKind::Log,
                text,
            };
            self.output.messages.push(message);
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
                    whole += &format!("{value:.6}");
                    rest = cursor.offset;
                }
                Err(_) => {
                    whole.push('#');
                    rest += at + 1;
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
