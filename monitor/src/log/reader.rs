//! Reads a log back, sample by sample, in bounded memory. What stands in the file is not trusted: every message is
//! checked against the layout of its channel before it becomes a sample.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use bus::sample::{
    AxisCommand, Feedback, Instruments, MAX_WINDOW_ROWS, PlannerStatus, Roster, WindowHeader,
    WindowRow,
};
use bytemuck::{Pod, Zeroable};
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::feed::{Batch, Ending, Feed, fill};
use super::layout::{Extent, Layout, Wire};
use super::recorder::ENCAPSULATION;
use super::run_info::{END_RECORD, RUN_RECORD};
use super::{Event, LogError, LoggedWindow, RunEnd, RunInfo, Sample};
use crate::digest::{self, ChannelHash};

/// Longest record outside a chunk that is read, in bytes: a program of 200 MB and room.
const RECORD_BYTES_MAX: usize = 256 << 20;

/// Bytes of a message before its data: channel, sequence, times of logging and publishing (MCAP, *Message*).
const MESSAGE_HEADER_BYTES: usize = 2 + 4 + 8 + 8;

/// What a channel carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Content {
    Feedback,
    Instruments,
    Command,
    Window,
    Planner,
    Roster,
    Event,
}

struct KnownChannel {
    topic: String,
    content: Option<Content>,
    /// Whether it counts in the digest.
    counts: bool,
    hash: ChannelHash,
}

struct Layouts {
    feedback: Layout,
    instruments: Layout,
    command: Layout,
    header: Layout,
    row: Layout,
    planner: Layout,
    roster: Layout,
}

/// A log being read.
pub struct Reader {
    path: PathBuf,
    source: Source,
    batch: Batch,
    info: RunInfo,
    extent: Extent,
    scan_period_us: u32,
    layouts: Layouts,
    channels: BTreeMap<u16, KnownChannel>,
    end: Option<RunEnd>,
    cut: Option<String>,
    done: bool,
}

/// Where the records come from.
enum Source {
    /// Nobody has asked for a sample yet.
    Opened(Box<LinearReader>, BufReader<File>),
    /// From the thread that reads.
    Feed(Feed),
    /// They have all been taken.
    Done,
}

/// One record that matters here.
enum Step {
    Sample(Sample),
    Skip,
    End,
}

impl Reader {
    /// Opens a log and reads what is known of the run.
    ///
    /// # Errors
    /// The file cannot be opened, is no MCAP, or was not written by this product in a version that is understood.
    pub fn open(path: &Path) -> Result<Reader, LogError> {
        let file = File::open(path).map_err(|source| LogError::File {
            path: path.into(),
            source,
        })?;
        let (mut mcap, mut file) = records_of(file);
        let not_a_log = |what: String| LogError::NotALog {
            path: path.into(),
            what,
        };
        let metadata = loop {
            let Some(event) = mcap.next_event() else {
                return Err(LogError::Unbegun { path: path.into() });
            };
            let event = event.map_err(|error| match error {
                mcap::McapError::UnexpectedEof => LogError::Unbegun { path: path.into() },
                error => not_a_log(format!("is not an MCAP log: {error}")),
            });
            match event? {
                LinearReadEvent::ReadRequest(bytes) => {
                    fill(&mut file, &mut mcap, bytes).map_err(|source| LogError::File {
                        path: path.into(),
                        source,
                    })?;
                }
                LinearReadEvent::Record { opcode, data } => {
                    match mcap::parse_record(opcode, data) {
                        Ok(Record::Metadata(record)) if record.name == RUN_RECORD => {
                            break record.metadata;
                        }
                        Ok(Record::Message { .. }) => {
                            return Err(not_a_log(format!(
                                "is an MCAP log, but without metadata {RUN_RECORD} before its first message"
                            )));
                        }
                        Ok(_) => {}
                        Err(e) => return Err(not_a_log(format!("is not an MCAP log: {e}"))),
                    }
                }
            }
        };
        let (info, extent, scan_period_us) = RunInfo::from_record(metadata).map_err(not_a_log)?;
        Ok(Reader {
            path: path.into(),
            source: Source::Opened(Box::new(mcap), file),
            batch: Batch::default(),
            layouts: Layouts {
                feedback: Layout::of::<Feedback>(&extent),
                instruments: Layout::of::<Instruments>(&extent),
                command: Layout::of::<AxisCommand>(&extent),
                header: Layout::of::<WindowHeader>(&extent),
                row: Layout::of::<WindowRow>(&extent),
                planner: Layout::of::<PlannerStatus>(&extent),
                roster: Layout::of::<Roster>(&extent),
            },
            info,
            extent,
            scan_period_us,
            channels: BTreeMap::new(),
            end: None,
            cut: None,
            done: false,
        })
    }

    /// A message of this log as a sample; none if it does not fit.
    pub(super) fn sample(&self, content: Content, message: &[u8]) -> Option<Sample> {
        decode(
            content,
            message.strip_prefix(&ENCAPSULATION)?,
            &self.layouts,
        )
    }

    /// What was known when the run began, files excepted.
    pub fn info(&self) -> &RunInfo {
        &self.info
    }

    /// Letters of the axes, in order.
    pub fn axes(&self) -> &[String] {
        &self.extent.axes
    }

    /// Instrument samples within a scan.
    pub fn subsamples(&self) -> usize {
        self.extent.subsamples
    }

    /// Scan period in µs.
    pub fn scan_period_us(&self) -> u32 {
        self.scan_period_us
    }

    /// What was known when the run ended; none before the end is read, or if the recorder never wrote it.
    pub fn end(&self) -> Option<&RunEnd> {
        self.end.as_ref()
    }

    /// Why the log ends early, if it does.
    pub fn cut(&self) -> Option<&str> {
        self.cut.as_deref()
    }

    /// The digest of everything read so far.
    pub fn digest(&self) -> String {
        digest::combine(
            self.channels
                .values()
                .map(|channel| (channel.topic.as_str(), &channel.hash)),
        )
    }

    /// The next sample, none at the end. A log that was cut off ends where it was cut; [`Reader::cut`] says so.
    ///
    /// # Errors
    /// A message that does not fit its channel, or a file that can no longer be read.
    pub fn next_sample(&mut self) -> Result<Option<Sample>, LogError> {
        while !self.done {
            let Some((opcode, data)) = self.batch.next() else {
                self.next_batch()?;
                continue;
            };
            let step = match record_of(opcode, data) {
                Ok(record) => take_record(
                    record,
                    &mut self.channels,
                    &self.layouts,
                    &mut self.end,
                    &self.extent,
                )
                .map_err(|what| LogError::NotALog {
                    path: self.path.clone(),
                    what,
                })?,
                Err(what) => {
                    self.cut = Some(format!("a record cannot be read: {what}"));
                    Step::End
                }
            };
            match step {
                Step::Sample(sample) => return Ok(Some(sample)),
                Step::Skip => {}
                Step::End => self.finish_reading(),
            }
        }
        if self.end.is_none() && self.cut.is_none() {
            self.cut = Some("the recorder did not end it".into());
        }
        Ok(None)
    }

    /// Gets the next records, or learns how they end.
    fn next_batch(&mut self) -> Result<(), LogError> {
        let failed = |path: &Path, source| LogError::File {
            path: path.into(),
            source,
        };
        let source = std::mem::replace(&mut self.source, Source::Done);
        let mut feed = match source {
            Source::Opened(mcap, file) => {
                Feed::start(*mcap, file).map_err(|source| failed(&self.path, source))?
            }
            Source::Feed(feed) => feed,
            Source::Done => {
                self.done = true;
                return Ok(());
            }
        };
        match feed.next(std::mem::take(&mut self.batch)) {
            Ok(batch) => {
                self.batch = batch;
                self.source = Source::Feed(feed);
            }
            Err(Ending::Whole) => self.finish_reading(),
            Err(Ending::Failed(source)) => return Err(failed(&self.path, source)),
            Err(Ending::Cut(mcap::McapError::UnexpectedEof)) => {
                self.cut = Some("the file ends in the middle of a record".into());
                self.finish_reading();
            }
            Err(Ending::Cut(error)) => {
                self.cut = Some(error.to_string());
                self.finish_reading();
            }
        }
        Ok(())
    }

    fn finish_reading(&mut self) {
        self.done = true;
        self.source = Source::Done;
    }
}

fn records_of(file: File) -> (LinearReader, BufReader<File>) {
    let file = BufReader::with_capacity(1 << 18, file);
    (LinearReader::new_with_options(careful()), file)
}

/// What is read is checked before anything of it is used, and asks for no more memory than a log needs.
pub(super) fn careful() -> LinearReaderOptions {
    LinearReaderOptions::default()
        .with_record_length_limit(RECORD_BYTES_MAX)
        .with_prevalidate_chunk_crcs(true)
}

/// Reads one part of a log, decompresses and checks it, and does nothing else: the floor of everything that reads it. Bytes of
/// the file and of the records in it.
///
/// # Errors
/// The file cannot be read, or is damaged.
pub fn read_only(path: &Path) -> Result<(u64, u64), LogError> {
    let failed = |source| LogError::File {
        path: path.into(),
        source,
    };
    let file = File::open(path).map_err(failed)?;
    let file_bytes = file.metadata().map_err(failed)?.len();
    let (mut mcap, mut file) = records_of(file);
    let mut record_bytes = 0;
    while let Some(event) = mcap.next_event() {
        match event {
            Ok(LinearReadEvent::ReadRequest(bytes)) => {
                fill(&mut file, &mut mcap, bytes).map_err(failed)?;
            }
            Ok(LinearReadEvent::Record { data, .. }) => record_bytes += data.len() as u64,
            Err(error) => {
                return Err(LogError::NotALog {
                    path: path.into(),
                    what: error.to_string(),
                });
            }
        }
    }
    Ok((file_bytes, record_bytes))
}

/// A record; of a message only what is needed of it, because that is what a log consists of.
fn record_of(opcode: u8, data: &[u8]) -> Result<Parsed<'_>, String> {
    if opcode != op::MESSAGE {
        let record = mcap::parse_record(opcode, data).map_err(|error| error.to_string())?;
        return Ok(Parsed::Other(record));
    }
    let message = data.split_at_checked(MESSAGE_HEADER_BYTES);
    let (header, data) = message.ok_or("a message without its header")?;
    let channel = header.first_chunk::<2>().map(|id| u16::from_le_bytes(*id));
    Ok(Parsed::Message {
        channel: channel.unwrap_or(0),
        data,
    })
}

/// A record as it is needed here.
enum Parsed<'a> {
    Message { channel: u16, data: &'a [u8] },
    Other(Record<'a>),
}

impl Iterator for Reader {
    type Item = Result<Sample, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_sample().transpose()
    }
}

fn take_record(
    record: Parsed<'_>,
    channels: &mut BTreeMap<u16, KnownChannel>,
    layouts: &Layouts,
    end: &mut Option<RunEnd>,
    extent: &Extent,
) -> Result<Step, String> {
    match record {
        Parsed::Other(Record::Channel(channel)) => {
            channels.entry(channel.id).or_insert_with(|| KnownChannel {
                content: content_of(&channel.topic),
                counts: digest::counts(&channel.topic),
                topic: channel.topic,
                hash: ChannelHash::default(),
            });
        }
        Parsed::Other(Record::Metadata(metadata)) if metadata.name == END_RECORD => {
            *end = Some(RunEnd::from_record(&metadata.metadata));
        }
        Parsed::Other(Record::DataEnd(_)) => return Ok(Step::End),
        Parsed::Message { channel: id, data } => {
            let Some(channel) = channels.get_mut(&id) else {
                return Err(format!("message on channel {id} that was never announced"));
            };
            let Some(content) = channel.content else {
                return Ok(Step::Skip);
            };
            if channel.counts {
                channel.hash.update(data);
            }
            let body = data
                .strip_prefix(&ENCAPSULATION)
                .ok_or_else(|| format!("message on {} is not little-endian CDR", channel.topic))?;
            let sample = decode(content, body, layouts).ok_or_else(|| {
                format!(
                    "message of {} bytes on {} does not fit a machine with {} axes",
                    data.len(),
                    channel.topic,
                    extent.axes.len()
                )
            })?;
            return Ok(Step::Sample(sample));
        }
        Parsed::Other(_) => {}
    }
    Ok(Step::Skip)
}

/// What a topic carries; none if nobody here reads it.
pub(super) fn content_of(topic: &str) -> Option<Content> {
    Some(match topic {
        "/feedback" => Content::Feedback,
        "/instruments" => Content::Instruments,
        "/window" => Content::Window,
        "/planner" => Content::Planner,
        "/roster" => Content::Roster,
        "/event" => Content::Event,
        _ if topic.starts_with("/command/") => Content::Command,
        _ => return None,
    })
}

fn decode(content: Content, body: &[u8], layouts: &Layouts) -> Option<Sample> {
    Some(match content {
        Content::Feedback => Sample::Feedback(Box::new(pod(&layouts.feedback, body)?)),
        Content::Instruments => Sample::Instruments(Box::new(pod(&layouts.instruments, body)?)),
        Content::Command => Sample::Command(Box::new(pod(&layouts.command, body)?)),
        Content::Planner => Sample::Planner(pod(&layouts.planner, body)?),
        Content::Roster => Sample::Roster(Box::new(pod(&layouts.roster, body)?)),
        Content::Window => Sample::Window(window(layouts, body)?),
        Content::Event => Sample::Event(event(body)?),
    })
}

fn pod<T: Pod + Zeroable + Wire>(layout: &Layout, body: &[u8]) -> Option<T> {
    let mut sample = T::zeroed();
    layout
        .decode(body, bytemuck::bytes_of_mut(&mut sample))
        .then_some(sample)
}

fn window(layouts: &Layouts, body: &[u8]) -> Option<LoggedWindow> {
    let (header, rest) = body.split_at_checked(layouts.header.bytes)?;
    let (checksum, rest) = rest.split_first_chunk::<8>()?;
    let (count, rest) = rest.split_first_chunk::<4>()?;
    let count = u32::from_le_bytes(*count) as usize;
    if count > MAX_WINDOW_ROWS {
        return None;
    }
    let rows = if count == 0 {
        rest
    } else {
        rest.strip_prefix(&[0; 4])?
    };
    if rows.len() != count * layouts.row.bytes {
        return None;
    }
    Some(LoggedWindow {
        header: pod(&layouts.header, header)?,
        tail_checksum: u64::from_le_bytes(*checksum),
        rows: rows
            .chunks_exact(layouts.row.bytes)
            .map(|row| pod(&layouts.row, row))
            .collect::<Option<Vec<WindowRow>>>()?,
    })
}

fn event(body: &[u8]) -> Option<Event> {
    let (scan, _) = body.split_first_chunk::<8>()?;
    let (process, next) = string(body, 8)?;
    let (text, _) = string(body, next)?;
    Some(Event {
        scan: u64::from_le_bytes(*scan),
        process,
        text,
    })
}

/// The CDR string at or after `at`, and where it ends.
fn string(body: &[u8], at: usize) -> Option<(String, usize)> {
    let at = at.next_multiple_of(4);
    let length = u32::from_le_bytes(*body.get(at..)?.first_chunk::<4>()?) as usize;
    let bytes = body.get(at + 4..(at + 4).checked_add(length)?)?;
    let text = bytes.strip_suffix(&[0])?;
    Some((String::from_utf8(text.to_vec()).ok()?, at + 4 + length))
}
