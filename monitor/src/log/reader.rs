//! Reads a log back, sample by sample, in bounded memory. What stands in the file is not trusted: every message is
//! checked against the layout of its channel before it becomes a sample.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use bus::sample::{
    AxisCommand, Feedback, Instruments, MAX_WINDOW_ROWS, PlannerStatus, Roster, WindowHeader,
    WindowRow,
};
use bytemuck::{Pod, Zeroable};
use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::layout::{Extent, Layout, Wire};
use super::recorder::ENCAPSULATION;
use super::run_info::{END_RECORD, RUN_RECORD};
use super::{Event, LogError, LoggedWindow, RunEnd, RunInfo, Sample};
use crate::digest::{self, ChannelHash};

/// Longest record outside a chunk that is read, in bytes: a program of 200 MB and room.
const RECORD_BYTES_MAX: usize = 256 << 20;

/// What a channel carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Content {
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
    file: BufReader<File>,
    mcap: LinearReader,
    info: RunInfo,
    extent: Extent,
    scan_period_us: u32,
    layouts: Layouts,
    channels: BTreeMap<u16, KnownChannel>,
    end: Option<RunEnd>,
    cut: Option<String>,
    done: bool,
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
        let options = LinearReaderOptions::default()
            .with_record_length_limit(RECORD_BYTES_MAX)
            .with_prevalidate_chunk_crcs(true);
        let mut file = BufReader::with_capacity(1 << 18, file);
        let mut mcap = LinearReader::new_with_options(options);
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
            file,
            mcap,
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
            let event = match self.mcap.next_event() {
                Some(event) => event,
                None => {
                    self.done = true;
                    break;
                }
            };
            let step = match event {
                Ok(LinearReadEvent::ReadRequest(bytes)) => {
                    fill(&mut self.file, &mut self.mcap, bytes).map_err(|source| {
                        LogError::File {
                            path: self.path.clone(),
                            source,
                        }
                    })?;
                    continue;
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    match mcap::parse_record(opcode, data) {
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
                        Err(e) => {
                            self.cut = Some(format!("a record cannot be read: {e}"));
                            Step::End
                        }
                    }
                }
                Err(mcap::McapError::UnexpectedEof) => {
                    self.cut = Some("the file ends in the middle of a record".into());
                    Step::End
                }
                Err(e) => {
                    self.cut = Some(e.to_string());
                    Step::End
                }
            };
            match step {
                Step::Sample(sample) => return Ok(Some(sample)),
                Step::Skip => {}
                Step::End => self.done = true,
            }
        }
        if self.end.is_none() && self.cut.is_none() {
            self.cut = Some("the recorder did not end it".into());
        }
        Ok(None)
    }
}

impl Iterator for Reader {
    type Item = Result<Sample, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_sample().transpose()
    }
}

fn fill(file: &mut impl Read, mcap: &mut LinearReader, bytes: usize) -> std::io::Result<()> {
    // A wrong length in a damaged file must not become one large allocation.
    let read = file.read(mcap.insert(bytes.clamp(1, 1 << 20)))?;
    mcap.notify_read(read);
    Ok(())
}

fn take_record(
    record: Record<'_>,
    channels: &mut BTreeMap<u16, KnownChannel>,
    layouts: &Layouts,
    end: &mut Option<RunEnd>,
    extent: &Extent,
) -> Result<Step, String> {
    match record {
        Record::Channel(channel) => {
            channels.entry(channel.id).or_insert_with(|| KnownChannel {
                content: content_of(&channel.topic),
                topic: channel.topic,
                hash: ChannelHash::default(),
            });
        }
        Record::Metadata(metadata) if metadata.name == END_RECORD => {
            *end = Some(RunEnd::from_record(&metadata.metadata));
        }
        Record::DataEnd(_) => return Ok(Step::End),
        Record::Message { header, data } => {
            let Some(channel) = channels.get_mut(&header.channel_id) else {
                return Err(format!(
                    "message on channel {} that was never announced",
                    header.channel_id
                ));
            };
            let Some(content) = channel.content else {
                return Ok(Step::Skip);
            };
            if digest::counts(&channel.topic) {
                channel.hash.update(&data);
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
        _ => {}
    }
    Ok(Step::Skip)
}

fn content_of(topic: &str) -> Option<Content> {
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
