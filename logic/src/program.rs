//! The program of the logic: a child process that is asked on its standard input and answers on its standard output, a line each.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{ChildStdin, Command, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use bus::builder_program::BuilderProgram;
use quadrant_logic::protocol::{Answer, Hello, LINE_BYTES_MAX, Question, Ready};
use serde::Serialize;

/// In the environment of the program and all that it starts.
const MARK: &str = "QUADRANT_LOGIC";
/// Time between two looks whether the cell ends.
const LOOK: Duration = Duration::from_millis(50);

/// Time between two looks for the end of a program whose streams are closed, and their number.
const END_LOOK: Duration = Duration::from_millis(2);
const END_LOOKS: u32 = 25;

/// What came of a question.
#[derive(Debug)]
pub enum Said {
    /// The answer.
    Answer(Answer),
    /// Nothing in time.
    Nothing,
    /// The cell ends.
    Leaving,
}

/// A running program. It ends with this value.
#[derive(Debug)]
pub struct Program {
    running: BuilderProgram,
    to: ChildStdin,
    lines: Receiver<Result<String, String>>,
    ready: bool,
}

impl Program {
    /// Starts it in its folder and says hello; one in Python finds its modules there.
    ///
    /// # Errors
    /// It cannot be run, or has ended at once.
    pub fn start(
        command: &[String],
        folder: &Path,
        modules: &Path,
        hello: &Hello,
    ) -> Result<Program, String> {
        let (name, arguments) = command.split_first().ok_or("its command is empty")?;
        // A path counts from the folder; a bare name is looked for as a shell does.
        let program = if name.contains('/') {
            folder.join(name).into_os_string()
        } else {
            name.into()
        };
        let mark = format!("{}-{}", std::process::id(), hello.starts);
        let mut command = Command::new(&program);
        command
            .args(arguments)
            .current_dir(folder)
            .env("PYTHONPATH", with_modules(modules))
            // Nothing is left in the cell's folder that was not put there.
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit());
        let cannot = |error| format!("{}: {error}", program.display());
        let mut running = BuilderProgram::start(&mut command, MARK, mark).map_err(cannot)?;
        let (to, from) = (running.child.stdin.take(), running.child.stdout.take());
        let (Some(to), Some(from)) = (to, from) else {
            return Err("it has no standard streams".into());
        };
        let (say, lines) = mpsc::sync_channel(1);
        let listen = move || {
            let mut from = BufReader::new(from);
            loop {
                let line = next_line(&mut from);
                let ends = line.is_err();
                if say.send(line).is_err() || ends {
                    return;
                }
            }
        };
        let listens = std::thread::Builder::new()
            .name("qd-logic-said".into())
            .spawn(listen);
        let mut program = Program {
            running,
            to,
            lines,
            ready: false,
        };
        listens.map_err(|error| format!("no thread to listen to it: {error}"))?;
        program.say(hello)?;
        Ok(program)
    }

    /// Whether it has said that it can answer.
    pub fn is_ready(&self) -> bool {
        self.ready
    }

    /// Waits until it can answer; false while it cannot.
    ///
    /// # Errors
    /// It has ended, or says something else.
    pub fn await_ready(
        &mut self,
        limit: Duration,
        ending: &dyn Fn() -> bool,
    ) -> Result<bool, String> {
        let Some(line) = self.line(limit, ending)? else {
            return Ok(false);
        };
        let ready: Result<Ready, _> = serde_json::from_str(&line);
        self.ready = ready.is_ok_and(|ready| ready.ready);
        match self.ready {
            true => Ok(true),
            false => Err(format!(
                "its first line is {:?}, not {{\"ready\": true}}",
                shortened(&line)
            )),
        }
    }

    /// Asks it.
    ///
    /// # Errors
    /// It does not listen any more.
    pub fn ask(&mut self, question: &Question) -> Result<(), String> {
        self.say(question)
    }

    /// Its answer.
    ///
    /// # Errors
    /// It has ended, or what it says is no answer.
    pub fn hear(&mut self, limit: Duration, ending: &dyn Fn() -> bool) -> Result<Said, String> {
        let Some(line) = self.line(limit, ending)? else {
            return Ok(if ending() {
                Said::Leaving
            } else {
                Said::Nothing
            });
        };
        let answer = serde_json::from_str(&line);
        answer
            .map(Said::Answer)
            .map_err(|error| format!("it says {:?}: {error}", shortened(&line)))
    }

    fn say(&mut self, what: &impl Serialize) -> Result<(), String> {
        let mut line = serde_json::to_vec(what).map_err(|error| error.to_string())?;
        line.push(b'\n');
        let said = self.to.write_all(&line).and_then(|()| self.to.flush());
        said.map_err(|error| self.end_words(&format!("it does not listen: {error}")))
    }

    /// Its next line; none within the limit, or where the cell ends.
    fn line(
        &mut self,
        limit: Duration,
        ending: &dyn Fn() -> bool,
    ) -> Result<Option<String>, String> {
        let until = Instant::now() + limit;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            match self.lines.recv_timeout(left.min(LOOK)) {
                Ok(Ok(line)) => return Ok(Some(line)),
                Ok(Err(why)) => return Err(self.end_words(&why)),
                Err(RecvTimeoutError::Disconnected) => return Err(self.end_words("it has ended")),
                Err(RecvTimeoutError::Timeout) if left <= LOOK || ending() => return Ok(None),
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    /// Status of a program that has ended, which may show a moment after the end of its streams; else why it counts as ended.
    fn end_words(&mut self, why: &str) -> String {
        for _ in 0..END_LOOKS {
            if self.running.has_ended() {
                let status = self.running.end();
                return status.map_or(why.into(), |status| format!("it ended with {status}"));
            }
            std::thread::sleep(END_LOOK);
        }
        why.into()
    }
}

/// Where Python looks for modules: these first, then those that the environment names.
fn with_modules(modules: &Path) -> OsString {
    let named = std::env::var_os("PYTHONPATH").unwrap_or_default();
    let all = std::iter::once(modules.to_path_buf()).chain(std::env::split_paths(&named));
    std::env::join_paths(all).unwrap_or_else(|_| modules.into())
}

/// A line of bounded length, without its end.
fn next_line(from: &mut impl BufRead) -> Result<String, String> {
    let mut line = Vec::new();
    let most = LINE_BYTES_MAX as u64;
    let read = from.by_ref().take(most).read_until(b'\n', &mut line);
    read.map_err(|error| error.to_string())?;
    match line.pop() {
        Some(b'\n') => String::from_utf8(line).map_err(|_| "it says what is no text".into()),
        None => Err("it has closed its output".into()),
        Some(_) if line.len() + 1 >= LINE_BYTES_MAX => Err(format!(
            "it says a line of more than {LINE_BYTES_MAX} bytes"
        )),
        Some(_) => Err("it has closed its output in the middle of a line".into()),
    }
}

/// The beginning of a line, for a message.
fn shortened(line: &str) -> String {
    line.chars().take(100).collect()
}
