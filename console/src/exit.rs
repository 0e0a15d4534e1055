//! Exit statuses, the same for every command.

use std::process::ExitCode;

use crate::output::{self, Stream};
use crate::{logs, signals};

/// Exit status of [`Failure::Interrupted`].
pub const INTERRUPTED: u8 = 130;

/// Why a command did not end with 0. Each kind has its status; the error inside is for people.
#[derive(Debug)]
pub enum Failure {
    /// 1: the machine stopped for a reason that is printed.
    Stopped(anyhow::Error),
    /// 2: bad usage or bad input; nothing was started.
    Input(anyhow::Error),
    /// 3: the environment does not allow it.
    Environment(anyhow::Error),
    /// 130: interrupted, after an orderly stop.
    Interrupted,
}

/// What a command comes to.
pub type Outcome = Result<(), Failure>;

impl Failure {
    /// The machine stopped, for this reason.
    pub fn stopped(why: impl Into<String>) -> Failure {
        Failure::Stopped(anyhow::anyhow!(why.into()))
    }

    /// Bad input, in these words.
    pub fn input(why: impl Into<String>) -> Failure {
        Failure::Input(anyhow::anyhow!(why.into()))
    }

    /// The environment does not allow it, in these words.
    pub fn environment(why: impl Into<String>) -> Failure {
        Failure::Environment(anyhow::anyhow!(why.into()))
    }
}

/// Names the kind of failure an error is.
pub trait Kind<T> {
    /// Bad input.
    fn input(self) -> Result<T, Failure>;
    /// The environment does not allow it.
    fn environment(self) -> Result<T, Failure>;
}

impl<T, E: Into<anyhow::Error>> Kind<T> for Result<T, E> {
    fn input(self) -> Result<T, Failure> {
        self.map_err(|e| Failure::Input(e.into()))
    }

    fn environment(self) -> Result<T, Failure> {
        self.map_err(|e| Failure::Environment(e.into()))
    }
}

/// An error and its causes, each reported once: some errors name their cause themselves.
pub fn words(error: &anyhow::Error) -> String {
    let mut words = String::new();
    for cause in error.chain() {
        let text = cause.to_string();
        if words.is_empty() {
            words = text;
        } else if !words.contains(&text) {
            words = format!("{words}: {text}");
        }
    }
    words
}

/// The same with the limit that it comes from, if it does.
fn words_and_hint(error: &anyhow::Error) -> String {
    let mut causes = error.chain();
    let hint = causes.find_map(|cause| bus::limits::hint(cause.downcast_ref()?));
    let words = words(error);
    hint.map_or(words.clone(), |hint| format!("{words}: {hint}"))
}

/// Reads the command of a program, carries it out where the filter of log lines is one, and gives the status. Where the stack is too
/// small for that, it is refused.
pub fn main<C>(read: impl FnOnce() -> C, obey: impl FnOnce(C) -> Outcome) -> ExitCode {
    if let Err(words) = bus::limits::check_stack() {
        return code(Err(Failure::environment(words)));
    }
    read_and_obey(read, obey)
}

/// Kept apart: what it needs of the stack is taken when it is called.
#[inline(never)]
fn read_and_obey<C>(read: impl FnOnce() -> C, obey: impl FnOnce(C) -> Outcome) -> ExitCode {
    signals::survive_file_size_limit();
    let command = read();
    code(logs::check_filter().input().and_then(|()| obey(command)))
}

/// Prints what went wrong, if anything, and gives the status.
pub fn code(outcome: Outcome) -> ExitCode {
    // What is printed last may fail too.
    output::flush();
    let outcome = match (outcome, output::failure()) {
        (Ok(()), Some(error)) => Err(Failure::Environment(anyhow::anyhow!(
            "standard output: {error}: the command was done, and what it had to say is not all there"
        ))),
        (outcome, _) => outcome,
    };
    let (status, error) = match outcome {
        Ok(()) => (0, None),
        Err(Failure::Interrupted) => (INTERRUPTED, None),
        Err(Failure::Stopped(error)) => (1, Some(error)),
        Err(Failure::Input(error)) => (2, Some(error)),
        Err(Failure::Environment(error)) => (3, Some(error)),
    };
    if let Some(error) = error {
        let line = format!("quadrant: {}\n", words_and_hint(&error));
        output::print(Stream::Err, output::plain_lines(&line).as_bytes());
    }
    output::flush();
    ExitCode::from(status)
}
