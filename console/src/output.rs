//! What the commands print. A reader that closes its end is no error. The launcher of a cell prints through a queue, so that
//! a terminal that takes no more (Ctrl-S, a hung ssh link) never keeps it from its processes.

use std::io::{self, Write};
use std::sync::OnceLock;
use std::time::Duration;

mod queue;

use queue::Queue;
pub use queue::Stream;

/// So long the end of a process waits for a terminal that takes nothing.
const FLUSH_LIMIT: Duration = Duration::from_secs(1);

/// Of a process that supervises a cell.
static QUEUE: OnceLock<&'static Queue> = OnceLock::new();
/// The first reason why something could not be written to standard output.
static FAILED: OnceLock<io::Error> = OnceLock::new();

/// From now on nothing that is printed is waited for: what a terminal or pipe does not take in time is dropped and counted.
pub fn never_wait() {
    if QUEUE.get().is_none() {
        let to = [rustix::stdio::stdout(), rustix::stdio::stderr()];
        if let Ok(queue) = Queue::start(to) {
            let _ = QUEUE.set(queue);
        }
    }
}

/// A text behind a beginning, wrapped at spaces into lines of so many columns; those after the first begin with `next`.
pub fn wrapped(columns: usize, first: &str, next: &str, text: &str) -> Vec<String> {
    let options = textwrap::Options::new(columns)
        .initial_indent(first)
        .subsequent_indent(next)
        .word_splitter(textwrap::WordSplitter::NoHyphenation)
        .break_words(false);
    let lines = textwrap::wrap(text, options).into_iter();
    lines.map(std::borrow::Cow::into_owned).collect()
}

/// Words with a separator between them.
pub fn joined<T: ToString>(words: impl IntoIterator<Item = T>, separator: &str) -> String {
    let words = words.into_iter().map(|word| word.to_string());
    words.collect::<Vec<_>>().join(separator)
}

/// A text without what a terminal would obey: files may have any name.
pub fn plain(text: &str) -> String {
    text.replace(char::is_control, " ")
}

/// The same of lines.
pub fn plain_lines(text: &str) -> String {
    let is_obeyed = |c: char| c.is_control() && c != '\n' && c != '\t';
    text.replace(is_obeyed, " ")
}

/// Writes one text and a line end to standard output.
pub fn say(text: &str) {
    print(Stream::Out, (plain_lines(text) + "\n").as_bytes());
}

/// Notes that standard output did not take something. Whoever reads a pipe may close it, and a terminal may go: neither is a failure.
pub fn note_failure(error: io::Error) {
    let reader_left = error.kind() == io::ErrorKind::BrokenPipe;
    let terminal_left = error.raw_os_error() == Some(rustix::io::Errno::IO.raw_os_error());
    if !reader_left && !terminal_left {
        let _ = FAILED.set(error);
    }
}

/// Why something is missing on standard output, if it is.
pub fn failure() -> Option<&'static io::Error> {
    FAILED.get()
}

/// Writes these bytes, which are whole lines.
pub fn print(stream: Stream, bytes: &[u8]) {
    if let Some(queue) = QUEUE.get() {
        return queue.print(stream, bytes);
    }
    match stream {
        Stream::Out => {
            let mut out = io::stdout().lock();
            if let Err(error) = out.write_all(bytes).and_then(|()| out.flush()) {
                note_failure(error);
            }
        }
        Stream::Err => {
            let _ = io::stderr().write_all(bytes);
        }
    }
}

/// Draws on standard error, unless lines wait there: the next picture shows more.
pub fn draw(bytes: &[u8]) {
    match QUEUE.get() {
        Some(queue) => queue.draw(bytes),
        None => print(Stream::Err, bytes),
    }
}

/// Keeps everything back: the terminal shows something else.
pub fn hold_back() {
    if let Some(queue) = QUEUE.get() {
        queue.hold_back(true);
    }
}

/// Writes what was kept back, and all else as it comes.
pub fn release() {
    if let Some(queue) = QUEUE.get() {
        queue.hold_back(false);
    }
}

/// Waits until all is written, as long as the terminal takes something: the process is about to end.
pub fn flush() {
    if let Some(queue) = QUEUE.get() {
        queue.hold_back(false);
        queue.flush(FLUSH_LIMIT);
    }
}
