//! Reads a log back, sample by sample, in bounded memory. What is in the file is not trusted: every message is
//! checked against the layout of its channel before it becomes a sample.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use machine::LogLevel;
use mcap::records::{Record, op};

use super::codec::{Codec, Content, ENCAPSULATION};
use super::columns::Columns;
use super::error::LogError;
use super::feed::{Batch, Feed};
use super::group::{Group, Next};
use super::layout::Extent;
use super::records::{Broken, Records, parse_record};
use super::run_info::{END_RECORD, RUN_RECORD, RunEnd, RunInfo};
use super::sample::Sample;
use crate::digest::{self, ChannelHash};

/// Bytes of a message before its data: channel, sequence, times of logging and publishing (MCAP, *Message*).
const MESSAGE_HEADER_BYTES: usize = 2 + 4 + 8 + 8;

struct KnownChannel {
    topic: String,
    content: Option<Content>,
    /// Its place among the channels of the same content.
    place: usize,
    /// How its samples are written; none where each has a message.
    columns: Option<Columns>,
    /// Whether it counts in the digest.
    counts: bool,
    hash: ChannelHash,
}

/// A log being read.
pub struct Reader {
    path: PathBuf,
    source: Source,
    batch: Batch,
    info: RunInfo,
    extent: Extent,
    scan_period_us: u32,
    codec: Codec,
    channels: BTreeMap<u16, KnownChannel>,
    group: Group,
    end: Option<RunEnd>,
    cut: Option<String>,
    done: bool,
}

/// Where the records come from.
enum Source {
    /// Nobody has asked for a sample yet.
    Opened(Box<Records<BufReader<File>>>),
    /// From the thread that reads.
    Feed(Feed),
    /// They have all been taken.
    Done,
}

/// One record that matters here.
#[expect(
    clippy::large_enum_variant,
    reason = "one at a time, on the stack: no pointer per sample"
)]
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
        let mut records = Records::open(path)?;
        let found = records.each(|opcode, data| match parse_record(opcode, data) {
            Ok(Record::Metadata(record)) if record.name == RUN_RECORD => {
                ControlFlow::Break(Ok(record.metadata))
            }
            Ok(Record::Message { .. }) => ControlFlow::Break(Err(format!(
                "is an MCAP log, but without metadata {RUN_RECORD} before its first message"
            ))),
            Ok(_) => ControlFlow::Continue(()),
            Err(error) => ControlFlow::Break(Err(format!("is not an MCAP log: {error}"))),
        });
        let not_a_log = |what: String| LogError::NotALog {
            path: path.into(),
            what,
        };
        let metadata = match found.map_err(|broken| broken.of_file(path))? {
            Some(found) => found.map_err(not_a_log)?,
            None => return Err(LogError::Empty { path: path.into() }),
        };
        let (info, extent, scan_period_us) = RunInfo::from_record(metadata).map_err(not_a_log)?;
        Ok(Reader {
            path: path.into(),
            source: Source::Opened(Box::new(records)),
            batch: Batch::default(),
            codec: Codec::of_level(&extent, info.level()),
            group: Group::default(),
            info,
            extent,
            scan_period_us,
            channels: BTreeMap::new(),
            end: None,
            cut: None,
            done: false,
        })
    }

    /// The samples in a message of this log; none if it does not fit.
    pub fn samples(&self, content: Content, message: &[u8]) -> Option<Vec<Sample>> {
        let body = message.strip_prefix(&ENCAPSULATION)?;
        let Some(layout) = self.codec.of_scans(content) else {
            return Some(vec![self.codec.decode(content, body)?]);
        };
        let rows = Columns::of(layout.clone()).decode(body)?;
        let rows = rows.chunks_exact(layout.bytes.max(1));
        rows.map(|row| self.codec.decode(content, row)).collect()
    }

    /// What was known when the run began, files excepted.
    pub fn info(&self) -> &RunInfo {
        &self.info
    }

    /// Letters of the axes, in order.
    pub fn axes(&self) -> &[String] {
        &self.extent.axes
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

    /// The digest of everything read so far, of a log that has everything; else what its recorder has noted, if it ended it.
    pub fn digest(&self) -> Option<String> {
        if self.info.level() < LogLevel::Full {
            return self.end.as_ref()?.digest.clone();
        }
        let channels = self.channels.values();
        Some(digest::combine(
            channels.map(|channel| (channel.topic.as_str(), &channel.hash)),
        ))
    }

    /// The next sample, none at the end. A log that was cut off ends where it was cut; [`Reader::cut`] reports it.
    ///
    /// # Errors
    /// A message that does not fit its channel, or a file that can no longer be read.
    pub fn next_sample(&mut self) -> Result<Option<Sample>, LogError> {
        let not_a_log = |path: &Path, what| LogError::NotALog {
            path: path.into(),
            what,
        };
        loop {
            match self.group.next() {
                Some(Next::Window(window)) => return Ok(Some(Sample::Window(window))),
                Some(Next::Row(content, row)) => {
                    let sample = self.codec.decode(content, row);
                    return Ok(Some(sample.ok_or_else(|| {
                        not_a_log(&self.path, format!("a row of {content:?} is no sample"))
                    })?));
                }
                None if self.done => break,
                None => {}
            }
            let Some((opcode, data)) = self.batch.next() else {
                self.next_batch()?;
                continue;
            };
            let step = match record_of(opcode, data) {
                Ok(record) => take_record(
                    record,
                    &mut self.channels,
                    &self.codec,
                    &mut self.group,
                    &mut self.end,
                    &self.extent,
                )
                .map_err(|what| not_a_log(&self.path, what))?,
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
        let source = std::mem::replace(&mut self.source, Source::Done);
        let mut feed = match source {
            Source::Opened(records) => {
                Feed::start(*records).map_err(LogError::of_file(&self.path))?
            }
            Source::Feed(feed) => feed,
            Source::Done => {
                self.finish_reading();
                return Ok(());
            }
        };
        match feed.next(std::mem::take(&mut self.batch)) {
            Ok(Some(batch)) => {
                self.batch = batch;
                self.source = Source::Feed(feed);
            }
            Ok(None) => self.finish_reading(),
            Err(Broken::Failed(source)) => return Err(LogError::of_file(&self.path)(source)),
            Err(Broken::Cut(mcap::McapError::UnexpectedEof)) => {
                self.cut = Some("the file ends in the middle of a record".into());
                self.finish_reading();
            }
            Err(Broken::Cut(error)) => {
                self.cut = Some(error.to_string());
                self.finish_reading();
            }
        }
        Ok(())
    }

    fn finish_reading(&mut self) {
        self.done = true;
        self.source = Source::Done;
        self.group.end();
    }
}

/// Reads one part of a log, decompresses and checks it, and does nothing else: the floor of everything that reads it. Bytes of
/// the file and of the records in it.
///
/// # Errors
/// The file cannot be read, or is damaged.
pub fn read_only(path: &Path) -> Result<(u64, u64), LogError> {
    let mut records = Records::open(path)?;
    let mut record_bytes = 0;
    let whole = records.each(|_, data| {
        record_bytes += data.len() as u64;
        ControlFlow::<()>::Continue(())
    });
    whole.map_err(|broken| broken.of_file(path))?;
    let file = path.metadata().map_err(LogError::of_file(path))?;
    Ok((file.len(), record_bytes))
}

/// A record; of a message only what is needed of it, because that is what a log consists of.
fn record_of(opcode: u8, data: &[u8]) -> Result<Parsed<'_>, String> {
    if opcode != op::MESSAGE {
        let record = parse_record(opcode, data).map_err(|error| error.to_string())?;
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
    codec: &Codec,
    group: &mut Group,
    end: &mut Option<RunEnd>,
    extent: &Extent,
) -> Result<Step, String> {
    match record {
        Parsed::Other(Record::Channel(channel)) => {
            let content = Content::of_topic(&channel.topic);
            let layout = content.and_then(|content| codec.of_scans(content));
            channels.entry(channel.id).or_insert_with(|| KnownChannel {
                content,
                place: place_of(&channel.topic, extent),
                columns: layout.map(|layout| Columns::of(layout.clone())),
                counts: codec.is_whole && digest::counts(&channel.topic),
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
            let body = data
                .strip_prefix(&ENCAPSULATION)
                .ok_or_else(|| format!("message on {} is not little-endian CDR", channel.topic))?;
            let does_not_fit = || {
                format!(
                    "message of {} bytes on {} does not fit a machine with {} axes",
                    data.len(),
                    channel.topic,
                    extent.axes.len()
                )
            };
            if let Some(columns) = &channel.columns {
                let rows = columns.decode(body).ok_or_else(does_not_fit)?;
                if channel.counts {
                    let mut message = ENCAPSULATION.to_vec();
                    for row in rows.chunks_exact(columns.row.bytes.max(1)) {
                        if let Some(seal) = columns.row.seal(row) {
                            channel.hash.update(&seal);
                            continue;
                        }
                        message.truncate(ENCAPSULATION.len());
                        message.extend_from_slice(row);
                        channel.hash.update(&message);
                    }
                }
                group.take((content, channel.place), columns, rows);
                return Ok(Step::Skip);
            }
            if channel.counts {
                channel.hash.update(data);
            }
            match codec.decode(content, body).ok_or_else(does_not_fit)? {
                Sample::Window(window) => group.window(window),
                sample => return Ok(Step::Sample(sample)),
            }
        }
        Parsed::Other(_) => {}
    }
    Ok(Step::Skip)
}

/// Where a channel of commands stands among the others: by axis, then by role.
fn place_of(topic: &str, extent: &Extent) -> usize {
    let mut parts = topic.split('/').skip(2);
    let letter = parts.next().unwrap_or_default();
    let axis = extent.axes.iter().position(|axis| axis == letter);
    2 * axis.unwrap_or(0) + parts.count()
}
