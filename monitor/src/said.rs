//! `messages.jsonl`: what the program of a run has said (MSG, DEBUG, PRINT, LOG), a line each, in the scan in which its path came to it.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

use bus::cell::CellPaths;
use bus::files::open_regular;
use bus::messages::{Heard, MessageReader, TROUBLE};
use bus::sample::Feedback;
use serde::{Deserialize, Serialize};

/// Its name in a run directory.
pub const MESSAGES_FILE: &str = "messages.jsonl";

/// A line of it.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Line {
    /// Scan in which the path came to it.
    pub scan: u64,
    /// Counted from 1 in the order of the run; 0 where the planner says why it cannot go on.
    pub number: u32,
    /// So many before this number are lost: they were said faster than they could be read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dropped: Option<u32>,
    /// Line of the program; none where messages are lost, and where the planner says it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<u32>,
    /// It is for the log alone (LOG).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub log_only: bool,
    /// What was said.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub text: String,
}

/// Writes it.
#[derive(Debug)]
pub(crate) struct SaidFile {
    reader: MessageReader,
    file: File,
    /// Of the last line that a recorder before this one has written.
    before: u32,
    failed: bool,
}

impl SaidFile {
    /// In a run directory. A recorder that replaces another goes on behind the last whole line.
    pub fn open(folder: &Path, cell: &CellPaths) -> io::Result<SaidFile> {
        let path = folder.join(MESSAGES_FILE);
        let written = fs::read(&path).unwrap_or_default();
        let whole = written.iter().rposition(|byte| *byte == b'\n');
        let whole = whole.map_or(0, |at| at + 1);
        let mut options = File::options();
        options.create(true).append(true);
        let file = open_regular(&path, &mut options)?;
        file.set_len(whole as u64)?;
        let lines = written
            .get(..whole)
            .unwrap_or_default()
            .split(|b| *b == b'\n');
        let mut reader = MessageReader::new(cell.messages());
        let lines = lines.rev();
        let mut before = 0;
        for line in lines.filter_map(|line| serde_json::from_slice::<Line>(line).ok()) {
            if line.number != TROUBLE {
                before = line.number;
                break;
            }
            reader.skip_trouble(line.scan);
        }
        Ok(SaidFile {
            reader,
            file,
            before,
            failed: false,
        })
    }

    /// Writes what the program has said by this feedback.
    pub fn take(&mut self, feedback: &Feedback) {
        if self.reader.is_other_run(feedback) {
            self.reader.skip_to(feedback, self.before);
        }
        let heard = self.reader.hear(feedback);
        if heard.is_empty() {
            return;
        }
        let lines = lines_of(feedback.scan, &heard, self.reader.shown());
        let text = lines.iter();
        let text = text.map(|line| serde_json::to_string(line).unwrap_or_default() + "\n");
        let written = self.file.write_all(text.collect::<String>().as_bytes());
        if let Err(error) = &written
            && !self.failed
        {
            tracing::warn!(%error, "{MESSAGES_FILE} cannot be written: messages of the program are lost there");
        }
        self.failed = written.is_err();
    }
}

fn lines_of(scan: u64, heard: &Heard, last: u32) -> Vec<Line> {
    let mut lines = Vec::new();
    if heard.dropped > 0 {
        let first = heard.messages.first();
        lines.push(Line {
            scan,
            number: first.map_or(last, |first| first.number - 1),
            dropped: Some(heard.dropped),
            ..Line::default()
        });
    }
    lines.extend(heard.messages.iter().map(|message| Line {
        scan,
        number: message.number,
        dropped: None,
        line: (message.line > 0).then_some(message.line),
        log_only: message.log_only,
        text: message.text.to_string(),
    }));
    lines
}

#[cfg(test)]
mod tests {
    use bus::messages::{MessageWriter, ProgramMessage};
    use bus::sample::{Cause, ProgramState};
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn a_recorder_that_was_killed_over_a_line_writes_it_whole_and_no_other_twice() {
        let folder = tempfile::tempdir().expect("a folder");
        let name = format!("said{}", std::process::id());
        let cell = CellPaths::new(&name).expect("a name");
        fs::create_dir(cell.folder()).expect("the cell's folder");
        let messages: Vec<ProgramMessage> = (1..=3)
            .map(|number| ProgramMessage {
                number,
                line: number,
                log_only: number == 3,
                text: format!("text {number}").into(),
            })
            .collect();
        let written = MessageWriter::new(cell.messages()).write(0, 1, &messages);
        let mut feedback = Feedback::zeroed();
        feedback.program = ProgramState::Running as u32;
        feedback.run = 1;
        feedback.messages = 3;
        // The planner cannot go on, which the recorder sees a scan late.
        (feedback.scan, feedback.cause, feedback.cause_scan) = (8, Cause::Planner as u32, 7);
        let trouble = [ProgramMessage::trouble("it is jammed")];
        let told = MessageWriter::new(cell.messages()).write(0, 1, &trouble);
        let mut first = SaidFile::open(folder.path(), &cell).expect("a file");
        first.take(&feedback);
        drop(first);
        let path = folder.path().join(MESSAGES_FILE);
        let whole = fs::read(&path).expect("the file");
        for length in 0..=whole.len() {
            fs::write(&path, &whole[..length]).expect("the file");
            let mut next = SaidFile::open(folder.path(), &cell).expect("a file");
            next.take(&feedback);
            assert_eq!(fs::read(&path).expect("the file"), whole, "{length}");
        }
        let _ = fs::remove_dir_all(cell.folder());
        written.and(told).expect("room");
        assert_eq!(whole.split(|byte| *byte == b'\n').count(), 5, "four lines");
    }
}
