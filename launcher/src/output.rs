//! Standard output for people and pipes: a reader that closes its end is no error.

use std::io::Write;

/// Writes one text and a line end to standard output.
pub fn say(text: &str) {
    let mut out = std::io::stdout().lock();
    let _ = writeln!(out, "{text}").and_then(|()| out.flush());
}
