//! Writes the log; a thread of its own packs it and writes the file ([`super::packer`]). What it costs per scan is measured
//! by an ignored test in `log/tests.rs`.

use std::borrow::Cow;
use std::fs::File;
use std::io::BufWriter;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use bus::sample::AxisCommand;
use machine::{LogLevel, Machine};
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{Attachment, Compression, WriteOptions};

use super::channels::{
    AXES, AxisChannels, Channel, EVENT, FEEDBACK, Form, INSTRUMENTS, PLANNER, ROSTER, WINDOW,
    make_channels,
};
use super::codec::{Codec, ENCAPSULATION};
use super::columns::{Columns, ROWS_MAX};
use super::derived::{AxisRow, Rows};
use super::error::LogError;
use super::layout::Extent;
use super::packer::{Packer, of_writer};
use super::parts;
use super::run_info::{LEVEL, RunEnd, RunInfo};
use super::sample::SampleRef;
use crate::digest;

/// How a log is packed: uncompressed size of a chunk in bytes, and effort of the compression (zstd). What efforts cost and save is in
/// docs/developers/measurements.md.
type Packing = (u64, u32);
const PACKING: Packing = (2 << 20, 1);
/// The same of a log of some seconds that is written beside another one.
const SMALL_PACKING: Packing = (512 << 10, 3);
/// Longest time that samples stay in memory, by the clock and by the machine's.
const FLUSH_PERIOD: Duration = Duration::from_millis(500);
/// Scans between two looks at the clock.
const SCANS_PER_CLOCK_LOOK: u32 = 16;

/// Bytes of messages that are handed over at once, so that the packer sleeps in between.
const UNPACKED_BYTES_MAX: usize = 8 << 20;

/// Scans between two whole states of a servo at a level that has not all of them.
const WHOLE_EVERY_SCANS: u64 = 1000;

/// The log being written.
pub struct Recorder {
    path: PathBuf,
    packer: Packer,
    extent: Extent,
    period_ns: u64,
    /// What the file has, and what goes into it at present.
    of_file: LogLevel,
    level: LogLevel,
    /// Message being put together, encapsulation header first.
    message: Vec<u8>,
    /// The fixed ones first ([`FEEDBACK`] …), then one per axis for people, then one per axis and role of servos.
    channels: Vec<Channel>,
    codec: Codec,
    commands: Vec<AxisChannels>,
    /// Commands of standbys that said the same as the servo in force, and so are not in the log.
    commands_alike: u64,
    /// Mode and cause of the machine.
    mode: (u32, u32),
    /// Scans whose commands all go in whole.
    whole: Option<RangeInclusive<u64>>,
    motion_digest: Option<u128>,
    newest_scan: u64,
    /// What the packer has not got yet, and its bytes: messages, rows where there are columns for them.
    unpacked: Vec<(MessageHeader, Option<Arc<Columns>>, Vec<u8>)>,
    unpacked_bytes: usize,
    /// Channel of the fieldbus, of a machine that has one.
    bus_cycle: Option<usize>,
    signals: Option<usize>,
    rows: Rows,
    whole_rows: Vec<(usize, u64, AxisRow)>,
    flushed: Instant,
    scans_until_clock_look: u32,
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
        level: LogLevel,
    ) -> Result<Recorder, LogError> {
        let (part, path, file) = parts::make_next(run_dir)?;
        let mut info = Cow::Borrowed(info);
        if part > 1 {
            let settings = &mut info.to_mut().settings;
            settings.insert("part".into(), part.to_string());
        }
        Self::begin(&path, file, machine, &info, level, PACKING)
    }

    /// Begins a log at `path`, replacing what is there.
    ///
    /// # Errors
    /// The file cannot be created or written.
    #[cfg(test)]
    pub fn create(path: &Path, machine: &Machine, info: &RunInfo) -> Result<Recorder, LogError> {
        let file = File::create(path).map_err(LogError::of_file(path))?;
        Self::begin(path, file, machine, info, LogLevel::Full, PACKING)
    }

    /// Begins a small log at `path`, where nothing may be yet. Commands of these scans are whole.
    ///
    /// # Errors
    /// The file cannot be created or written, or something is there.
    pub fn create_new(
        path: &Path,
        machine: &Machine,
        info: &RunInfo,
        whole: RangeInclusive<u64>,
    ) -> Result<Recorder, LogError> {
        let file = File::create_new(path).map_err(LogError::of_file(path))?;
        let mut begun = Self::begin(path, file, machine, info, LogLevel::Control, SMALL_PACKING)?;
        begun.whole = Some(whole);
        Ok(begun)
    }

    fn begin(
        path: &Path,
        file: File,
        machine: &Machine,
        info: &RunInfo,
        level: LogLevel,
        packing: Packing,
    ) -> Result<Recorder, LogError> {
        let mut info = info.clone();
        info.settings.insert(LEVEL.into(), level.to_string());
        let begun = Self::write_beginning(path, file, machine, &info, level, packing);
        begun.map_err(of_writer).map_err(LogError::of_file(path))
    }

    fn write_beginning(
        path: &Path,
        file: File,
        machine: &Machine,
        info: &RunInfo,
        level: LogLevel,
        packing: Packing,
    ) -> Result<Recorder, mcap::McapError> {
        let (chunk_bytes, effort) = packing;
        // Without seeking a chunk reaches the file whole: a killed recorder leaves a cut end, never a wrong length.
        let mut writer = WriteOptions::new()
            .compression(Some(Compression::Zstd))
            .compression_level(effort)
            .compression_threads(0)
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
        let made = make_channels(&mut writer, machine, &extent, level)?;
        let (channels, commands, [bus_cycle, signals]) = made;
        // A successor of a recorder that was ready finds at least its beginning.
        writer.flush()?;
        Ok(Recorder {
            path: path.into(),
            packer: Packer::start(writer)?,
            period_ns: u64::from(machine.scan.period_us) * 1000,
            of_file: level,
            level,
            message: ENCAPSULATION.to_vec(),
            channels,
            codec: Codec::of(&extent),
            commands,
            commands_alike: 0,
            mode: (0, 0),
            whole: None,
            motion_digest: None,
            newest_scan: 0,
            unpacked: Vec::new(),
            unpacked_bytes: 0,
            bus_cycle,
            signals,
            rows: Rows::new(machine),
            whole_rows: Vec::new(),
            flushed: Instant::now(),
            scans_until_clock_look: 0,
            extent,
        })
    }

    /// The scan of the newest feedback.
    pub fn newest_scan(&self) -> u64 {
        self.newest_scan
    }

    /// From now on only what is in this level as well goes in.
    pub fn hold_to(&mut self, level: LogLevel) {
        self.level = level.min(self.of_file);
    }

    /// Records one sample; with a feedback looks at the clock once in a while and flushes.
    ///
    /// # Errors
    /// The file cannot be written, or a command is of an axis or role that this machine does not have.
    pub fn record(&mut self, sample: SampleRef<'_>) -> Result<(), LogError> {
        self.rows.take(sample, &mut self.whole_rows);
        let which = match sample {
            SampleRef::Feedback(feedback) => {
                self.newest_scan = feedback.scan;
                let mode = (feedback.mode, feedback.cause);
                if std::mem::replace(&mut self.mode, mode) != mode {
                    self.states_are_due();
                }
                FEEDBACK
            }
            SampleRef::Instruments(instruments) => {
                self.motion_digest = Some(instruments.motion_digest());
                INSTRUMENTS
            }
            SampleRef::BusCycle(_) => self.bus_cycle.ok_or_else(|| {
                LogError::BadSample("a cycle of a fieldbus: this machine has none".into())
            })?,
            SampleRef::Signals(_) => self
                .signals
                .ok_or_else(|| LogError::BadSample("signals: this machine has none".into()))?,
            SampleRef::Command(axis, command) => {
                let which = self.command_channel(axis, command.role as usize)?;
                self.take_command(which, axis, command)?;
                return self.put_rows();
            }
            SampleRef::Window(..) => WINDOW,
            SampleRef::Planner(_) => PLANNER,
            SampleRef::Roster(_) => {
                self.states_are_due();
                ROSTER
            }
            SampleRef::Event(_) => EVENT,
        };
        self.take(which, sample, true)?;
        self.put_rows()?;
        match sample {
            SampleRef::Feedback(feedback) => self.flush_in_time(feedback.scan),
            _ => Ok(()),
        }
    }

    fn states_are_due(&mut self) {
        for axis in &mut self.commands {
            axis.whole_is_due = true;
        }
    }

    /// A command of a standby that says the same as the servo in force: only a log of everything has it.
    ///
    /// # Errors
    /// As [`Recorder::record`].
    pub fn repeat(&mut self, axis: usize, command: &AxisCommand) -> Result<(), LogError> {
        let sample = SampleRef::Command(axis, command);
        if self.level == LogLevel::Full {
            return self.record(sample);
        }
        self.commands_alike += 1;
        let which = self.command_channel(axis, command.role as usize)?;
        self.take(which, sample, false)
    }

    /// A command, and the whole of it with the servo's state where something has happened, and now and then.
    fn take_command(
        &mut self,
        which: usize,
        axis: usize,
        command: &AxisCommand,
    ) -> Result<(), LogError> {
        let sample = SampleRef::Command(axis, command);
        let of_box = self.whole.as_ref();
        let is_of_box = of_box.is_some_and(|whole| whole.contains(&command.scan));
        if let Some(said) = self.commands.get_mut(axis)
            && command.state_words > 0
            && (is_of_box
                || std::mem::take(&mut said.whole_is_due)
                || command.scan.is_multiple_of(WHOLE_EVERY_SCANS))
        {
            let whole = said.whole;
            self.take(whole, sample, true)?;
        }
        self.take(which, sample, true)
    }

    /// Takes a sample into the digest of its channel, and where it `goes_in`, into the log.
    fn take(&mut self, which: usize, sample: SampleRef<'_>, goes_in: bool) -> Result<(), LogError> {
        let (row, time_ns) = (sample.bytes(), self.time_ns(sample.scan()));
        if which == ROSTER || which == EVENT {
            // What comes seldom stands where it belongs between the others; a window names its scan itself.
            self.write_rows()?;
        }
        let Some(channel) = self.channels.get_mut(which) else {
            return Ok(());
        };
        let seal = sample.seal();
        if row.is_none() || (channel.counts && seal.is_none()) {
            self.message.truncate(ENCAPSULATION.len());
            self.codec.encode(sample, &mut self.message);
        }
        if channel.counts {
            match seal {
                Some(seal) => channel.hash.update(&seal.to_le_bytes()),
                None => channel.hash.update(&self.message),
            }
        }
        if !goes_in || !channel.levels.contains(&self.level) {
            return Ok(());
        }
        match row {
            Some(row) => self.add_row(which, row, time_ns),
            None => self.send(which, time_ns, None, self.message.clone()),
        }
    }

    fn add_row(&mut self, which: usize, sample: &[u8], time_ns: u64) -> Result<(), LogError> {
        let waiting = self.channels.get_mut(which);
        let Some(waiting) = waiting.and_then(|channel| channel.waiting.as_mut()) else {
            return Ok(());
        };
        if waiting.rows.is_empty() {
            waiting.time_ns = time_ns;
        }
        waiting.columns.row.encode(sample, &mut waiting.rows);
        if waiting.rows.len() >= ROWS_MAX * waiting.columns.row.bytes {
            return self.write_rows();
        }
        Ok(())
    }

    /// Writes what waits, the feedback last: with it a reader has all that belongs before it.
    fn write_rows(&mut self) -> Result<(), LogError> {
        let count = self.channels.len();
        for which in (FEEDBACK + 1..count).chain([FEEDBACK]) {
            let waiting = self.channels.get_mut(which);
            let waiting = waiting.and_then(|channel| channel.waiting.as_mut());
            let Some(waiting) = waiting.filter(|waiting| !waiting.rows.is_empty()) else {
                continue;
            };
            let (columns, time_ns) = (Arc::clone(&waiting.columns), waiting.time_ns);
            let rows = waiting.rows.split_off(0);
            self.send(which, time_ns, Some(columns), rows)?;
        }
        Ok(())
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
        let (Some(said), Some(letter)) = (self.commands.get_mut(axis), self.extent.axes.get(axis))
        else {
            return Err(LogError::BadSample(format!(
                "command for axis {axis}: this machine has {} axes",
                self.extent.axes.len()
            )));
        };
        let Some(known) = said.roles.get_mut(role) else {
            return Err(LogError::BadSample(format!(
                "command of axis {letter} with role {role}: must be 0 or 1"
            )));
        };
        if let Some(which) = *known {
            return Ok(which);
        }
        let columns = Columns::of(Codec::of_level(&self.extent, self.of_file).command);
        let topic = format!("/command/{letter}/b");
        let form = Form::Columns(columns);
        let make = move |log: &mut _| form.channel(log, &topic, LogLevel::Axes);
        let made = self.packer.ask(make);
        let made = made.map_err(LogError::of_file(&self.path))?;
        self.channels.push(made);
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
        self.packer.wait().map_err(LogError::of_file(&self.path))
    }

    /// Hands everything recorded so far over to be written.
    fn hand_over(&mut self) -> Result<(), LogError> {
        self.flushed = Instant::now();
        self.write_rows()?;
        self.pack(true)
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
        self.rows.rest(u64::MAX, &mut self.whole_rows);
        self.put_rows()?;
        self.write_rows()?;
        self.pack(false)?;
        let digest = self.digest();
        let end = RunEnd {
            digest: Some(digest.clone()),
            motion_digest: self.motion_digest.map(digest::hex),
            commands_alike: self.commands_alike,
            ..end.clone()
        };
        let ended = self.packer.ask(move |log| {
            log.write_metadata(&end.to_record())?;
            log.finish()
        });
        ended.map_err(LogError::of_file(&self.path))?;
        Ok(digest)
    }

    fn time_ns(&self, scan: u64) -> u64 {
        scan.saturating_mul(self.period_ns)
    }

    /// Has a message packed, or one of rows in columns, once there is something to do for the packer.
    fn send(
        &mut self,
        which: usize,
        time_ns: u64,
        columns: Option<Arc<Columns>>,
        data: Vec<u8>,
    ) -> Result<(), LogError> {
        let Some(channel) = self.channels.get_mut(which) else {
            return Ok(());
        };
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.sequence,
            log_time: time_ns,
            publish_time: time_ns,
        };
        channel.sequence = channel.sequence.wrapping_add(1);
        self.unpacked_bytes += data.len();
        self.unpacked.push((header, columns, data));
        match self.unpacked_bytes > UNPACKED_BYTES_MAX {
            true => self.pack(false),
            false => Ok(()),
        }
    }

    /// Hands over to the packer what it has not got yet, to be put into the file now or when there is more.
    fn pack(&mut self, flush: bool) -> Result<(), LogError> {
        let bytes = std::mem::take(&mut self.unpacked_bytes);
        let unpacked = std::mem::take(&mut self.unpacked);
        let packed = self.packer.hand_over(bytes, move |log| {
            let mut message = Vec::new();
            for (header, columns, data) in unpacked {
                let Some(columns) = columns else {
                    log.write_to_known_channel(&header, &data)?;
                    continue;
                };
                message.clear();
                message.extend_from_slice(&ENCAPSULATION);
                columns.encode(&data, &mut message);
                log.write_to_known_channel(&header, &message)?;
            }
            if flush { log.flush() } else { Ok(()) }
        });
        packed.map_err(LogError::of_file(&self.path))
    }

    /// Hands on the rows for people that have become whole.
    fn put_rows(&mut self) -> Result<(), LogError> {
        while let Some((axis, scan, row)) = self.whole_rows.pop() {
            if self.level.has_samples() {
                self.add_row(AXES + axis, bytemuck::bytes_of(&row), self.time_ns(scan))?;
            }
        }
        Ok(())
    }
}

impl Drop for Recorder {
    /// A recorder that ends for a reason of its own saves what it has.
    fn drop(&mut self) {
        if self.write_rows().is_ok() && !self.unpacked.is_empty() {
            let _ = self.pack(true);
        }
    }
}
