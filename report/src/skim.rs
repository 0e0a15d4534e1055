//! What has to be known of a log before it can be measured, without reading it all: where the program began and who took part.
//!
//! Behind each chunk stand its message indexes (MCAP, *Message Index*), which name the channels that are in it; of a chunk
//! without any of those looked for only its length is read. Nothing here is trusted or refused: whoever reads the log from end
//! to end afterwards finds out whether it says the same.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::ops::ControlFlow;
use std::path::Path;

use bus::files::open_to_read;
use bus::sample::{Answer, AnswerOutcome, Cause, Feedback, PATH_AXES, Roster};
use mcap::records::{Record, op};
use monitor::log::records::{Records, parse_record};
use monitor::log::{Content, LogError, Reader, Sample, part_files};

/// Kind and length of a record.
const RECORD_HEAD_BYTES: u64 = 1 + 8;
/// What an MCAP file begins with.
const MAGIC_BYTES: u64 = 8;

/// Where the machine stood when the program was started, as every feedback names it that executes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Start {
    /// Command positions, in increments.
    pub command_positions: [i64; PATH_AXES],
    /// The program.
    pub program_hash: u64,
}

/// Answers of a machine that are kept: of a program that asks more often, the way behind is taken as assumed.
const ANSWERS_MAX: usize = 1 << 16;

/// What the machine has answered to what the program asks, in order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Answers {
    given: Vec<(Answer, bool)>,
    /// Number of the event that last began a probing motion.
    probed: Option<u32>,
}

impl Answers {
    fn take(&mut self, feedback: &Feedback) {
        let answer = &feedback.answer;
        match AnswerOutcome::from_wire(answer.outcome) {
            // The program, or the same again, begins.
            Some(AnswerOutcome::None) => *self = Answers::default(),
            Some(AnswerOutcome::Awaited) => self.probed = Some(answer.number),
            Some(AnswerOutcome::Given) => self.add(answer),
            // Where contact was necessary, the program ends: it does not read on.
            Some(AnswerOutcome::Missed) if feedback.cause != Cause::ProbeMissed as u32 => {
                self.add(answer);
            }
            _ => {}
        }
    }

    fn add(&mut self, answer: &Answer) {
        let newest = self.given.last().map(|(answer, _)| answer.number);
        if newest < Some(answer.number) && self.given.len() < ANSWERS_MAX {
            let probes = self.probed == Some(answer.number);
            self.given.push((*answer, probes));
        }
    }

    /// Each with whether it is a probe's.
    pub fn given(&self) -> &[(Answer, bool)] {
        &self.given
    }
}

/// What has to be known before the samples can be measured.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Prescan {
    /// Where the program began; none if it was not.
    pub start: Option<Start>,
    /// Who took part, every time it was published.
    pub rosters: Vec<Roster>,
    /// What was asked and answered; it is in every feedback, so only who reads the log from end to end has it.
    pub answers: Answers,
}

impl Prescan {
    /// Takes what belongs here of a sample.
    pub fn take(&mut self, sample: &Sample) {
        if let Sample::Feedback(feedback) = sample {
            self.answers.take(feedback);
        }
        match sample {
            Sample::Roster(roster) => self.rosters.push(**roster),
            Sample::Feedback(feedback) if self.start.is_none() && !feedback.window.is_none() => {
                self.start = Some(Start {
                    command_positions: feedback.program_start,
                    program_hash: feedback.program_hash,
                });
            }
            _ => {}
        }
    }
}

/// Looks through all parts of a run's log.
///
/// # Errors
/// The directory cannot be read. A part that cannot be read any further ends where it does.
pub fn skim(run_dir: &Path) -> Result<Prescan, LogError> {
    let mut prescan = Prescan::default();
    let mut newest: Option<u64> = None;
    for path in part_files(run_dir)? {
        let Ok(reader) = Reader::open(&path) else {
            continue;
        };
        // A recorder that joins finds the last roster once more.
        let before = newest;
        let mut take = |sample: Sample| {
            if let Sample::Roster(roster) = &sample {
                newest = newest.max(Some(roster.version));
                if Some(roster.version) <= before {
                    return;
                }
            }
            prescan.take(&sample);
        };
        if let Ok(file) = open_to_read(&path) {
            // What cannot be read ends it: reading from end to end will report it.
            let _ = skim_part(BufReader::with_capacity(1 << 12, file), &reader, &mut take);
        }
    }
    // Of the few feedbacks that were looked at.
    prescan.answers = Answers::default();
    Ok(prescan)
}

fn skim_part(
    mut file: BufReader<File>,
    reader: &Reader,
    take: &mut impl FnMut(Sample),
) -> Option<()> {
    let mut look = Look {
        reader,
        contents: BTreeMap::new(),
        started: false,
    };
    let mut at = MAGIC_BYTES;
    file.seek(SeekFrom::Start(at)).ok()?;
    // The chunk passed last, and whether its indexes name something that is looked for.
    let mut chunk: Option<(u64, u64)> = None;
    let (mut indexed, mut wanted) = (false, false);
    loop {
        let head = record_head(&mut file);
        if let Some((op::MESSAGE_INDEX, _, channel)) = head {
            indexed = true;
            wanted |= look.wants(channel);
        } else if let Some((start, length)) = chunk.take()
            // Where the file ends, indexes may be missing.
            && (wanted || !indexed || head.is_none())
        {
            file.seek(SeekFrom::Start(start)).ok()?;
            look.read_chunk(&mut file, length, take)?;
        }
        let (opcode, length, _) = head?;
        let content = at + RECORD_HEAD_BYTES;
        if opcode == op::CHUNK {
            chunk = Some((at, length));
            (indexed, wanted) = (false, false);
        }
        if opcode == op::DATA_END {
            return Some(());
        }
        at = content.checked_add(length)?;
        let here = file.stream_position().ok()?;
        // Within what is buffered nothing is read again.
        let step = i64::try_from(at).ok()? - i64::try_from(here).ok()?;
        file.seek_relative(step).ok()?;
    }
}

/// Kind and length of the next record, and the number that an index begins with: that of its channel.
fn record_head(file: &mut impl Read) -> Option<(u8, u64, u16)> {
    // No record that a log has is shorter.
    let mut head = [0; RECORD_HEAD_BYTES as usize + 2];
    file.read_exact(&mut head).ok()?;
    let (opcode, rest) = head.split_first()?;
    let (length, channel) = rest.split_first_chunk()?;
    let channel = u16::from_le_bytes(*channel.first_chunk()?);
    Some((*opcode, u64::from_le_bytes(*length), channel))
}

struct Look<'a> {
    reader: &'a Reader,
    /// What the channels that were announced carry.
    contents: BTreeMap<u16, Option<Content>>,
    /// Whether the program has started.
    started: bool,
}

impl Look<'_> {
    /// Whether a chunk with messages on this channel has to be looked into.
    fn wants(&self, channel: u16) -> bool {
        match self.contents.get(&channel) {
            // A chunk may announce a channel itself.
            None | Some(Some(Content::Roster)) => true,
            Some(Some(Content::Feedback)) => !self.started,
            Some(_) => false,
        }
    }

    /// Looks into the chunk of this length that the file now is at.
    fn read_chunk(
        &mut self,
        file: &mut impl Read,
        length: u64,
        take: &mut impl FnMut(Sample),
    ) -> Option<()> {
        let chunk = file.take(length.saturating_add(RECORD_HEAD_BYTES));
        let stopped = Records::of_chunk(chunk).each(|opcode, data| {
            let record = parse_record(opcode, data).ok();
            match record.and_then(|record| self.take_record(record, take)) {
                Some(()) => ControlFlow::Continue(()),
                None => ControlFlow::Break(()),
            }
        });
        stopped.is_ok_and(|stopped| stopped.is_none()).then_some(())
    }

    fn take_record(&mut self, record: Record<'_>, take: &mut impl FnMut(Sample)) -> Option<()> {
        match record {
            Record::Channel(channel) => {
                let content = Content::of_topic(&channel.topic);
                self.contents.insert(channel.id, content);
            }
            Record::Message { header, data } => {
                let content = self.contents.get(&header.channel_id).copied().flatten();
                let Some(content) = content.filter(|_| self.wants(header.channel_id)) else {
                    return Some(());
                };
                for sample in self.reader.samples(content, &data)? {
                    if let Sample::Feedback(feedback) = &sample {
                        self.started |= !feedback.window.is_none();
                    }
                    take(sample);
                }
            }
            _ => {}
        }
        Some(())
    }
}

#[cfg(test)]
mod tests;
