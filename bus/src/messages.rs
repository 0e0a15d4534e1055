//! What a program says (MSG, DEBUG, PRINT, LOG), on its way from the planner to whoever shows it: numbered texts in a file of the cell's
//! folder, which holds the last ones of them.
//!
//! The planner writes a text before it publishes the window that may pass its place. The feedback tells the number of the last one that
//! the path has come to; so each reader shows a text once, whoever was killed meanwhile. A text that was overwritten, or not written
//! whole, is counted.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use bytemuck::{Pod, Zeroable};
use xxhash_rust::xxh3::xxh3_64;

use crate::files::{open_own, open_to_read};
use crate::sample::{Cause, Feedback, Mode, ProgramState};

/// Texts that the file holds.
pub const MESSAGES_KEPT: u32 = 2048;
/// Number of the text that says why the planner cannot go on. It has a place of its own behind the others.
pub const TROUBLE: u32 = 0;
/// Bytes of a text; what is longer is cut.
pub const TEXT_BYTES: usize = 472;

/// A text of the program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProgramMessage {
    /// Counted from 1 in the order of the run, or [`TROUBLE`].
    pub number: u32,
    /// Line of the program; 0 for none.
    pub line: u32,
    /// For the log alone (LOG), rather than for the operator too.
    pub log_only: bool,
    /// The text, parameters replaced by their values.
    pub text: Box<str>,
}

impl ProgramMessage {
    /// Why the planner cannot go on.
    pub fn trouble(why: &str) -> ProgramMessage {
        ProgramMessage {
            number: TROUBLE,
            line: 0,
            log_only: false,
            text: why.into(),
        }
    }
}

impl std::fmt::Display for ProgramMessage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.line {
            0 => f.write_str(&self.text),
            line => write!(f, "line {line}: {}", self.text),
        }
    }
}

/// As it lies in the file.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Slot {
    /// Of all that follows.
    checksum: u64,
    load: u32,
    run: u32,
    number: u32,
    line: u32,
    log_only: u32,
    length: u32,
    reserved: u64,
    text: [u8; TEXT_BYTES],
}

const SLOT_BYTES: usize = size_of::<Slot>();
const _: () = assert!(SLOT_BYTES == 512);

impl Slot {
    fn sum(&self) -> u64 {
        let bytes = bytemuck::bytes_of(self);
        xxh3_64(bytes.get(size_of::<u64>()..).unwrap_or_default())
    }

    fn of(load: u32, run: u32, message: &ProgramMessage) -> Slot {
        let text = shortened(&message.text);
        let mut slot = Slot {
            checksum: 0,
            load,
            run,
            number: message.number,
            line: message.line,
            log_only: u32::from(message.log_only),
            length: text.len() as u32,
            reserved: 0,
            text: [0; TEXT_BYTES],
        };
        for (byte, of_text) in slot.text.iter_mut().zip(text.bytes()) {
            *byte = of_text;
        }
        slot.checksum = slot.sum();
        slot
    }

    fn message(&self, run: u32, number: u32) -> Option<ProgramMessage> {
        let is_it = self.run == run && self.number == number;
        if !is_it || self.checksum != self.sum() {
            return None;
        }
        let text = self.text.get(..self.length as usize)?;
        Some(ProgramMessage {
            number,
            line: self.line,
            log_only: self.log_only != 0,
            text: std::str::from_utf8(text).ok()?.into(),
        })
    }
}

/// What fits of a text, with a sign where it was cut.
fn shortened(text: &str) -> String {
    const CUT: &str = "…";
    if text.len() <= TEXT_BYTES {
        return text.to_owned();
    }
    let mut end = TEXT_BYTES - CUT.len();
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    text.get(..end).unwrap_or_default().to_owned() + CUT
}

/// Runs whose texts the file holds side by side: a reader that lags behind finds the texts of the run before.
const RUNS_KEPT: u32 = 2;

/// Where a text is in the file, in bytes.
fn place_of(run: u32, number: u32) -> u64 {
    let place = match number {
        TROUBLE => MESSAGES_KEPT,
        number => number % MESSAGES_KEPT,
    };
    let of_run = u64::from(run % RUNS_KEPT) * u64::from(MESSAGES_KEPT + 1);
    (of_run + u64::from(place)) * SLOT_BYTES as u64
}

/// Writes texts, in the planner.
#[derive(Debug)]
pub struct MessageWriter {
    path: PathBuf,
    file: Option<File>,
}

impl MessageWriter {
    /// Into this file, which is made with the first text.
    pub fn new(path: PathBuf) -> MessageWriter {
        MessageWriter { path, file: None }
    }

    /// Writes the texts of a run, each at its place.
    ///
    /// # Errors
    /// There is no room: whoever reads counts them as dropped.
    pub fn write(&mut self, load: u32, run: u32, messages: &[ProgramMessage]) -> io::Result<()> {
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(open_own(&self.path)?),
        };
        for message in messages {
            let slot = Slot::of(load, run, message);
            file.write_all_at(bytemuck::bytes_of(&slot), place_of(run, message.number))?;
        }
        Ok(())
    }
}

/// Texts that the path has come to since a reader looked last.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Heard {
    /// In order.
    pub messages: Vec<ProgramMessage>,
    /// Those that were overwritten before anybody read them, or never found room.
    pub dropped: u32,
}

impl Heard {
    /// Whether there is nothing to tell.
    pub fn is_empty(&self) -> bool {
        self.messages.is_empty() && self.dropped == 0
    }
}

/// Reads texts as the path comes to them: each once.
#[derive(Debug)]
pub struct MessageReader {
    path: PathBuf,
    /// No two programs of a cell have one run.
    of_run: u32,
    shown: u32,
    /// The program is done, and all that it had to say was told.
    is_over: bool,
    /// Scan of the trouble that was told last.
    trouble_scan: u64,
}

impl MessageReader {
    /// Of this file.
    pub fn new(path: PathBuf) -> MessageReader {
        MessageReader {
            path,
            of_run: 0,
            shown: 0,
            is_over: false,
            trouble_scan: 0,
        }
    }

    /// Takes trouble up to this scan as told.
    pub fn skip_trouble(&mut self, scan: u64) {
        self.trouble_scan = self.trouble_scan.max(scan);
    }

    /// Whether this feedback is of another run than the one before.
    pub fn is_other_run(&self, feedback: &Feedback) -> bool {
        self.of_run != feedback.run
    }

    /// Takes those up to this number as shown.
    pub fn skip_to(&mut self, feedback: &Feedback, number: u32) {
        self.of_run = feedback.run;
        self.shown = number;
        self.is_over = false;
    }

    /// Number of the last one that was heard, or is lost.
    pub fn shown(&self) -> u32 {
        self.shown
    }

    /// What the program has said since the feedback before, and why it cannot go on. With a program that is done, all that it had to say
    /// was said.
    pub fn hear(&mut self, feedback: &Feedback) -> Heard {
        let mut heard = self.hear_program(feedback);
        if feedback.cause == Cause::Planner as u32 && feedback.cause_scan > self.trouble_scan {
            self.trouble_scan = feedback.cause_scan;
            heard.messages.extend(why(&self.path, feedback));
        }
        heard
    }

    fn hear_program(&mut self, feedback: &Feedback) -> Heard {
        if self.is_other_run(feedback) {
            self.skip_to(feedback, 0);
        }
        if feedback.auxiliary.start_line != 0 {
            // Messages of blocks before the line that a program is started at are not published.
            self.skip_to(feedback, feedback.messages);
            return Heard::default();
        }
        let done =
            feedback.program == ProgramState::Done as u32 || feedback.mode == Mode::Finished as u32;
        let mut heard = Heard::default();
        if self.shown >= feedback.messages && (!done || self.is_over) {
            return heard;
        }
        self.is_over = done;
        let Ok(file) = open_to_read(&self.path) else {
            heard.dropped = feedback.messages.saturating_sub(self.shown);
            self.shown = self.shown.max(feedback.messages);
            return heard;
        };
        let oldest = feedback.messages.saturating_sub(MESSAGES_KEPT);
        if self.shown < oldest {
            heard.dropped = oldest - self.shown;
            self.shown = oldest;
        }
        while self.shown < feedback.messages || done {
            let Some(number) = self.shown.checked_add(1) else {
                break;
            };
            match read(&file, self.of_run, number) {
                Some(message) => heard.messages.push(message),
                None if number <= feedback.messages => heard.dropped += 1,
                None => break,
            }
            self.shown = number;
        }
        heard
    }
}

/// Why the program cannot go on, where it or its planner has said so: what an abort has said last, and the trouble of the planner.
pub fn why(path: &Path, feedback: &Feedback) -> Option<ProgramMessage> {
    let number = match Cause::from_wire(feedback.cause)? {
        Cause::Abort => feedback.messages,
        Cause::Planner => TROUBLE,
        _ => return None,
    };
    read(&open_to_read(path).ok()?, feedback.run, number)
}

fn read(file: &File, run: u32, number: u32) -> Option<ProgramMessage> {
    let mut slot = Slot::zeroed();
    let bytes = bytemuck::bytes_of_mut(&mut slot);
    file.read_exact_at(bytes, place_of(run, number)).ok()?;
    slot.message(run, number)
}

#[cfg(test)]
mod tests;
