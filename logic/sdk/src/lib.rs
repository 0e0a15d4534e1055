//! The logic of a machine under Quadrant, in Rust.
//!
//! A cell asks its logic once in so many periods, with what all signals show; the logic sets the signals that are its own (`from = { by =
//! "logic" }` in the machine file) and may ask the machine to hold, to stop, not to start, or to trip. It can move nothing. When it dies,
//! hangs or is late, its signals have the values that the machine file names for that, and it is started again.
//!
//! ```no_run
//! // Air before the chuck opens; no program without air.
//! fn main() -> std::process::ExitCode {
//!     quadrant_logic::run(|io: &mut quadrant_logic::Io| {
//!         let air = io.is_on("air_ok");
//!         io.set("chuck_valve", air && io.is_on("chuck_button"));
//!         if !air {
//!             io.inhibit();
//!         }
//!     })
//! }
//! ```
//!
//! What is said is JSON, a line each, on standard input and output ([`protocol`]); a program in any other language says the same.

use std::collections::BTreeMap;
use std::io::{self, BufRead, Write};
use std::process::ExitCode;

pub mod protocol;

use protocol::{Answer, Hello, PROTOCOL, Question, Ready};

/// What logic sees and says in one question.
#[derive(Debug)]
pub struct Io<'a> {
    hello: &'a Hello,
    index: &'a BTreeMap<String, usize>,
    question: Question,
    answer: Answer,
}

impl Io<'_> {
    /// Value of a signal, 0 or 1 of a switch; what this answer has set counts already.
    ///
    /// # Panics
    /// The machine has no such signal: an error of the logic, which ends it.
    pub fn value(&self, signal: &str) -> f64 {
        if let Some(set) = self.answer.set.get(signal) {
            return *set;
        }
        let index = self.index.get(signal);
        match index.and_then(|index| self.question.values.get(*index)) {
            Some(value) => *value,
            None => self.unknown(signal),
        }
    }

    /// Whether a switch is on.
    ///
    /// # Panics
    /// As [`value`](Io::value).
    pub fn is_on(&self, signal: &str) -> bool {
        self.value(signal) != 0.0
    }

    /// Sets a signal of the logic: a switch by `true` or `false`, a number by an `f64`. It stays until it is set again.
    ///
    /// # Panics
    /// It is no signal of the logic.
    pub fn set(&mut self, signal: &str, value: impl Into<Value>) {
        let index = self.index.get(signal);
        let of = index.and_then(|index| self.hello.signals.get(*index));
        if !of.is_some_and(|of| of.logic) {
            self.unknown(signal)
        }
        self.answer.set.insert(signal.to_string(), value.into().0);
    }

    /// Time of the machine since the cell's first scan, in s: what delays are counted in.
    pub fn time_s(&self) -> f64 {
        self.question.time_s
    }

    /// What the machine is and does.
    pub fn machine(&self) -> &Question {
        &self.question
    }

    /// Asks the machine to come to rest on the path, as long as this is said.
    pub fn hold(&mut self) {
        self.answer.hold = true;
    }

    /// Asks for the program to be stopped.
    pub fn stop(&mut self) {
        self.answer.stop = true;
    }

    /// Lets no program be started or resumed, as long as this is said.
    pub fn inhibit(&mut self) {
        self.answer.inhibit = true;
    }

    /// Has the machine brake at its limits and trip; no drive is switched on as long as this is said.
    pub fn trip(&mut self) {
        self.answer.trip = true;
    }

    /// Raises an alarm of the machine file, as long as this is said.
    pub fn alarm(&mut self, number: u32) {
        self.answer.alarms.push(number);
    }

    #[expect(
        clippy::panic,
        reason = "a logic that names what is not there must not go on"
    )]
    fn unknown(&self, signal: &str) -> ! {
        panic!(
            "{:?}: the machine {:?} has no such signal for its logic",
            signal, self.hello.machine
        )
    }
}

/// A value of a signal.
#[derive(Debug, Clone, Copy)]
pub struct Value(f64);

impl From<bool> for Value {
    fn from(on: bool) -> Value {
        Value(f64::from(u8::from(on)))
    }
}

impl From<f64> for Value {
    fn from(value: f64) -> Value {
        Value(value)
    }
}

impl From<u32> for Value {
    fn from(value: u32) -> Value {
        Value(f64::from(value))
    }
}

/// Logic of a machine: one update for each question. Any function of [`Io`] is one.
pub trait Logic {
    /// The cell was entered; `hello` says what it has, and how often its logic was started.
    fn begin(&mut self, hello: &Hello) {
        let _ = hello;
    }

    /// Answers one question.
    fn update(&mut self, io: &mut Io<'_>);
}

impl<F: FnMut(&mut Io<'_>)> Logic for F {
    fn update(&mut self, io: &mut Io<'_>) {
        self(io);
    }
}

/// Answers the cell until it ends.
pub fn run(logic: impl Logic) -> ExitCode {
    match speak(logic, io::stdin().lock(), io::stdout().lock()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("quadrant-logic: {error}");
            ExitCode::FAILURE
        }
    }
}

/// The same over any two streams.
///
/// # Errors
/// The cell says what this version does not know, or a stream breaks.
pub fn speak(mut logic: impl Logic, mut from: impl BufRead, mut to: impl Write) -> io::Result<()> {
    let mut line = String::new();
    if from.read_line(&mut line)? == 0 {
        return Ok(());
    }
    let hello: Hello = serde_json::from_str(&line)?;
    if hello.quadrant_logic != PROTOCOL {
        let what = format!(
            "the cell speaks version {}, not {PROTOCOL}",
            hello.quadrant_logic
        );
        return Err(io::Error::new(io::ErrorKind::InvalidData, what));
    }
    let names = hello.signals.iter().enumerate();
    let index = names
        .map(|(index, signal)| (signal.name.clone(), index))
        .collect();
    logic.begin(&hello);
    say(&mut to, &Ready { ready: true })?;
    loop {
        line.clear();
        if from.read_line(&mut line)? == 0 {
            return Ok(());
        }
        let question: Question = serde_json::from_str(&line)?;
        let answer = Answer {
            scan: question.scan,
            ..Answer::default()
        };
        let mut io = Io {
            hello: &hello,
            index: &index,
            question,
            answer,
        };
        logic.update(&mut io);
        say(&mut to, &io.answer)?;
    }
}

fn say(to: &mut impl Write, what: &impl serde::Serialize) -> io::Result<()> {
    let mut line = serde_json::to_vec(what)?;
    line.push(b'\n');
    to.write_all(&line)?;
    to.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logic_reads_signals_and_sets_its_own() {
        let hello = r#"{"quadrant_logic":1,"machine":"m","cell":"m","starts":1,"period_s":0.008,
            "signals":[{"name":"door","kind":"bool","unit":"","logic":false},
                       {"name":"lamp","kind":"bool","unit":"","logic":true}],"alarms":[]}"#;
        let question = r#"{"scan":8,"time_s":0.008,"mode":"ready","hold":false,"program":"none","run":0,"tool":3,"values":[0,0]}"#;
        let said = format!("{}\n{question}\n", hello.replace('\n', " "));
        let mut answers = Vec::new();
        let logic = |io: &mut Io| {
            let open = !io.is_on("door");
            io.set("lamp", open);
            assert!(io.is_on("lamp") && io.machine().tool == 3);
            io.inhibit();
        };
        speak(logic, said.as_bytes(), &mut answers).expect("an end");
        let answers = String::from_utf8(answers).expect("text");
        let mut lines = answers.lines();
        assert_eq!(lines.next(), Some(r#"{"ready":true}"#));
        let answer: Answer = serde_json::from_str(lines.next().expect("an answer")).expect("JSON");
        assert_eq!((answer.scan, answer.set.get("lamp")), (8, Some(&1.0)));
        assert!(answer.inhibit && !answer.hold && lines.next().is_none());
    }
}
