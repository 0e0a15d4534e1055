//! Writes the log; the file itself is written by a thread of its own ([`super::behind`]). What it costs per scan is measured
//! by an ignored test in `log/tests.rs`.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use bus::sample::{
    AxisCommand, BusCycle, Feedback, Instruments, PlannerStatus, Roster, Setpoint, WindowHeader,
};
use machine::Machine;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{Attachment, Compression, WriteOptions, Writer};

use super::behind::{Behind, Written, write_behind};
use super::codec::{Codec, ENCAPSULATION};
use super::derived::{AxisRow, Rows};
use super::error::LogError;
use super::layout::{Extent, Layout, definitions_of, join_definitions};
use super::parts;
use super::run_info::{RunEnd, RunInfo};
use super::sample::SampleRef;
use crate::digest::{self, ChannelHash};

/// Uncompressed size of a chunk, in bytes.
const CHUNK_BYTES: u64 = 2 << 20;
/// The same of a log that is written beside another one.
const SMALL_CHUNK_BYTES: u64 = 256 << 10;
/// Longest time that samples stay in memory, by the clock and by the machine's.
const FLUSH_PERIOD: Duration = Duration::from_millis(500);
/// Scans between two looks at the clock.
const SCANS_PER_CLOCK_LOOK: u32 = 16;

const FEEDBACK: usize = 0;
const INSTRUMENTS: usize = 1;
const PLANNER: usize = 2;
const ROSTER: usize = 3;
const WINDOW: usize = 4;
const EVENT: usize = 5;
const AXES: usize = 6;

struct Channel {
    id: u16,
    sequence: u32,
    topic: String,
    counts: bool,
    layout: Layout,
    hash: ChannelHash,
}

type Sink = NoSeek<BufWriter<Behind>>;

/// The log being written.
pub struct Recorder {
    path: PathBuf,
    writer: Writer<Sink>,
    extent: Extent,
    period_ns: u64,
    /// Message being put together, encapsulation header first.
    message: Vec<u8>,
    /// The fixed ones first ([`FEEDBACK`] …), then one per axis for people, then one per axis and role of servos.
    channels: Vec<Channel>,
    codec: Codec,
    /// Channel of each axis' servos: role a, role b (made when first heard).
    commands: Vec<[Option<usize>; 2]>,
    /// Channel of the fieldbus, of a machine that has one.
    bus_cycle: Option<usize>,
    rows: Rows,
    whole_rows: Vec<(usize, u64, AxisRow)>,
    flushed: Instant,
    scans_until_clock_look: u32,
    /// Dropped last, after the writer has written its end.
    written: Written,
}

impl Recorder {
    /// Begins the log of a run, or its next part if an earlier recorder left one: nothing is written over.
    ///
    /// # Errors
    /// The file cannot be created or written.
    pub fn create_part(
        run_dir: &Path,
        machine: &Machine,
        info: &RunInfo,
    ) -> Result<Recorder, LogError> {
        let (part, path, file) = parts::make_next(run_dir)?;
        let mut info = Cow::Borrowed(info);
        if part > 1 {
            let settings = &mut info.to_mut().settings;
            settings.insert("part".into(), part.to_string());
        }
        Self::begin(&path, file, machine, &info, CHUNK_BYTES)
    }

    /// Begins a log at `path`, replacing what is there.
    ///
    /// # Errors
    /// The file cannot be created or written.
    #[cfg(test)]
    pub fn create(path: &Path, machine: &Machine, info: &RunInfo) -> Result<Recorder, LogError> {
        let file = File::create(path).map_err(LogError::of_file(path))?;
        Self::begin(path, file, machine, info, CHUNK_BYTES)
    }

    /// Begins a small log at `path`, where nothing may be yet.
    ///
    /// # Errors
    /// The file cannot be created or written, or something is there.
    pub fn create_new(
        path: &Path,
        machine: &Machine,
        info: &RunInfo,
    ) -> Result<Recorder, LogError> {
        let file = File::create_new(path).map_err(LogError::of_file(path))?;
        Self::begin(path, file, machine, info, SMALL_CHUNK_BYTES)
    }

    fn begin(
        path: &Path,
        file: File,
        machine: &Machine,
        info: &RunInfo,
        chunk_bytes: u64,
    ) -> Result<Recorder, LogError> {
        let begun = Self::write_beginning(path, file, machine, info, chunk_bytes);
        begun.map_err(LogError::of_writer(path))
    }

    fn write_beginning(
        path: &Path,
        file: File,
        machine: &Machine,
        info: &RunInfo,
        chunk_bytes: u64,
    ) -> Result<Recorder, mcap::McapError> {
        let (file, written) = write_behind(file)?;
        // Without seeking a chunk reaches the file whole: a killed recorder leaves a cut end, never a wrong length.
        let mut writer = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(chunk_bytes))
            .profile("ros2")
            .library(format!("quadrant {}", env!("CARGO_PKG_VERSION")))
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::with_capacity(1 << 16, file)))?;
        let extent = Extent::of(machine);
        writer.write_metadata(&info.to_record(&extent, machine.scan.period_us))?;
        for (name, data) in &info.files {
            writer.attach(&Attachment {
                log_time: 0,
                create_time: 0,
                name: name.clone(),
                media_type: "text/plain".into(),
                data: Cow::Borrowed(data),
            })?;
        }
        let axis_count = extent.axes.len();
        let mut plan = vec![
            ("/feedback".to_string(), Layout::of::<Feedback>(&extent)),
            ("/instruments".into(), Layout::of::<Instruments>(&extent)),
            ("/planner".into(), Layout::of::<PlannerStatus>(&extent)),
            ("/roster".into(), Layout::of::<Roster>(&extent)),
            ("/window".into(), window_layout(&extent)),
            ("/event".into(), event_layout()),
        ];
        for axis in &extent.axes {
            plan.push((format!("/axis/{axis}"), Layout::of::<AxisRow>(&extent)));
        }
        for axis in &extent.axes {
            let layout = Layout::of::<AxisCommand>(&extent);
            plan.push((format!("/command/{axis}"), layout));
        }
        let bus_cycle = machine.bus.is_some().then_some(plan.len());
        if bus_cycle.is_some() {
            plan.push(("/bus_cycle".into(), Layout::of::<BusCycle>(&extent)));
        }
        let mut channels = Vec::new();
        for (topic, layout) in plan {
            channels.push(channel(&mut writer, &topic, layout)?);
        }
        let commands = (0..axis_count)
            .map(|axis| [Some(AXES + axis_count + axis), None])
            .collect();
        // Whoever comes after a recorder that was ready finds at least its beginning.
        writer.flush()?;
        written.wait()?;
        Ok(Recorder {
            path: path.into(),
            writer,
            period_ns: u64::from(machine.scan.period_us) * 1000,
            message: ENCAPSULATION.to_vec(),
            channels,
            codec: Codec::of(&extent),
            commands,
            bus_cycle,
            rows: Rows::new(machine),
            whole_rows: Vec::new(),
            flushed: Instant::now(),
            scans_until_clock_look: 0,
            extent,
            written,
        })
    }

    /// Records one sample; with a feedback looks at the clock once in a while and flushes.
    ///
    /// # Errors
    /// The file cannot be written, or a command is of an axis or role that this machine does not have.
    pub fn record(&mut self, sample: SampleRef<'_>) -> Result<(), LogError> {
        let which = match sample {
            SampleRef::Feedback(_) => FEEDBACK,
            SampleRef::Instruments(_) => INSTRUMENTS,
            SampleRef::BusCycle(_) => self.bus_cycle.ok_or_else(|| {
                LogError::BadSample("a cycle of a fieldbus: this machine has none".into())
            })?,
            SampleRef::Command(axis, command) => {
                self.command_channel(axis, command.role as usize)?
            }
            SampleRef::Window(..) => WINDOW,
            SampleRef::Planner(_) => PLANNER,
            SampleRef::Roster(_) => ROSTER,
            SampleRef::Event(_) => EVENT,
        };
        self.message.truncate(ENCAPSULATION.len());
        self.codec.encode(sample, &mut self.message);
        self.send(which, self.time_ns(sample.scan()))?;
        let whole = &mut self.whole_rows;
        match sample {
            SampleRef::Feedback(feedback) => {
                self.rows.feedback(feedback, whole);
                self.put_setpoints()?;
                self.flush_in_time(feedback.scan)
            }
            SampleRef::Instruments(instruments) => {
                self.rows.instruments(instruments, whole);
                self.put_setpoints()
            }
            SampleRef::Command(axis, command) => {
                self.rows.command(axis, command, whole);
                self.put_setpoints()
            }
            _ => Ok(()),
        }
    }

    fn flush_in_time(&mut self, scan: u64) -> Result<(), LogError> {
        let flush_scans = FLUSH_PERIOD.as_nanos() as u64 / self.period_ns.max(1);
        if scan.is_multiple_of(flush_scans.max(1)) {
            self.hand_over()?;
        }
        if self.scans_until_clock_look == 0 {
            self.scans_until_clock_look = SCANS_PER_CLOCK_LOOK;
            self.flush_if_due()?;
        }
        self.scans_until_clock_look -= 1;
        Ok(())
    }

    /// Channel of the commands of an axis and a role; that of role b is made when it is first heard.
    fn command_channel(&mut self, axis: usize, role: usize) -> Result<usize, LogError> {
        let (Some(roles), Some(letter)) = (self.commands.get_mut(axis), self.extent.axes.get(axis))
        else {
            return Err(LogError::BadSample(format!(
                "command for axis {axis}: this machine has {} axes",
                self.extent.axes.len()
            )));
        };
        let Some(known) = roles.get_mut(role) else {
            return Err(LogError::BadSample(format!(
                "command of axis {letter} with role {role}: must be 0 or 1"
            )));
        };
        if let Some(which) = *known {
            return Ok(which);
        }
        let layout = Layout::of::<AxisCommand>(&self.extent);
        let made = channel(&mut self.writer, &format!("/command/{letter}/b"), layout);
        self.channels
            .push(made.map_err(LogError::of_writer(&self.path))?);
        Ok(*known.insert(self.channels.len() - 1))
    }

    /// Flushes if the last time is long ago; also when nothing comes, so that the end of a stalled run is on disk.
    ///
    /// # Errors
    /// As [`Recorder::record`].
    pub fn flush_if_due(&mut self) -> Result<(), LogError> {
        if self.flushed.elapsed() >= FLUSH_PERIOD {
            self.hand_over()?;
        }
        Ok(())
    }

    /// Puts everything recorded so far into the file, so that it survives this process.
    ///
    /// # Errors
    /// As [`Recorder::record`].
    pub fn flush(&mut self) -> Result<(), LogError> {
        self.hand_over()?;
        self.wait()
    }

    fn wait(&self) -> Result<(), LogError> {
        let written = self.written.wait();
        written.map_err(LogError::of_file(&self.path))
    }

    /// Hands everything recorded so far over to be written.
    fn hand_over(&mut self) -> Result<(), LogError> {
        self.flushed = Instant::now();
        let flushed = self.writer.flush();
        flushed.map_err(LogError::of_writer(&self.path))
    }

    /// The digest of everything recorded so far, in hexadecimal.
    pub fn digest(&self) -> String {
        digest::combine(
            self.channels
                .iter()
                .map(|channel| (channel.topic.as_str(), &channel.hash)),
        )
    }

    /// Ends the log and returns the digest of everything recorded.
    ///
    /// # Errors
    /// As [`Recorder::record`].
    pub fn finish(mut self, end: &RunEnd) -> Result<String, LogError> {
        self.rows.rest(&mut self.whole_rows);
        self.put_setpoints()?;
        let digest = self.digest();
        let ended = self
            .writer
            .write_metadata(&end.to_record(&digest))
            .and_then(|()| self.writer.finish());
        ended.map_err(LogError::of_writer(&self.path))?;
        self.wait()?;
        Ok(digest)
    }

    fn time_ns(&self, scan: u64) -> u64 {
        scan.saturating_mul(self.period_ns)
    }

    /// Writes the message that has been put together.
    fn send(&mut self, which: usize, time_ns: u64) -> Result<(), LogError> {
        let Some(channel) = self.channels.get_mut(which) else {
            return Ok(());
        };
        if channel.counts {
            channel.hash.update(&self.message);
        }
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.sequence,
            log_time: time_ns,
            publish_time: time_ns,
        };
        channel.sequence = channel.sequence.wrapping_add(1);
        let sent = self.writer.write_to_known_channel(&header, &self.message);
        sent.map_err(LogError::of_writer(&self.path))
    }

    fn put_setpoints(&mut self) -> Result<(), LogError> {
        while let Some((axis, scan, row)) = self.whole_rows.pop() {
            self.message.truncate(ENCAPSULATION.len());
            if let Some(channel) = self.channels.get(AXES + axis) {
                let row = bytemuck::bytes_of(&row);
                channel.layout.encode(row, &mut self.message);
            }
            self.send(AXES + axis, self.time_ns(scan))?;
        }
        Ok(())
    }
}

fn channel(
    writer: &mut Writer<Sink>,
    topic: &str,
    layout: Layout,
) -> Result<Channel, mcap::McapError> {
    let schema = writer.add_schema(&layout.schema_name, "ros2msg", layout.schema.as_bytes())?;
    // Asked for by MCAP's profile ros2; empty is what a recorder writes that knows of none.
    let metadata = BTreeMap::from([("offered_qos_profiles".to_string(), String::new())]);
    let id = writer.add_channel(schema, topic, "cdr", &metadata)?;
    Ok(Channel {
        id,
        sequence: 0,
        topic: topic.into(),
        counts: digest::counts(topic),
        layout,
        hash: ChannelHash::default(),
    })
}

/// Layout of the header, schema of the whole message.
fn window_layout(extent: &Extent) -> Layout {
    let mut layout = Layout::of::<WindowHeader>(extent);
    let body = "quadrant/WindowHeader header\nuint64 tail_checksum\nquadrant/Setpoint[] rows\n";
    let mut definitions = vec![("Window".to_string(), body.to_string())];
    definitions.extend(definitions_of::<WindowHeader>(extent));
    for definition in definitions_of::<Setpoint>(extent) {
        if !definitions.contains(&definition) {
            definitions.push(definition);
        }
    }
    layout.schema_name = "quadrant/msg/Window".into();
    layout.schema = join_definitions(&definitions);
    layout
}

fn event_layout() -> Layout {
    Layout::text("Event", "uint64 scan\nstring process\nstring text\n")
}
