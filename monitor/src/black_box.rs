//! The black box: the last seconds before a trip, a stop for a fault or the death of a process, and what followed, saved without
//! being asked.
//!
//! The samples of the last seconds are in a ring, encoded as in the log. When something happens, a log of its own is started in the
//! directory, `black-box-SCAN-WHAT.mcap`, which every reader of logs can open; machine file and program are in it. The ring is
//! written to it a few scans at a time, so that nothing is held up, and what comes goes in behind it. What happens while it
//! is open makes it longer. All bounds are in [`Settings`].
//!
//! It is fed what the recorder is fed, scan by scan, whether a log is being written or not, and does nothing else: a box that cannot
//! be written costs a warning, never the recording.

mod ring;

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use bus::sample::{Cause, Feedback, Mode, Roster};
use machine::Machine;

use crate::deaths::Deaths;
use crate::log::codec::{Codec, Content};
use crate::log::layout::Extent;
use crate::log::{Event, LogError, Recorder, RunEnd, RunInfo, Sample, SampleRef};

use crate::words::StopCause;
use ring::Ring;

/// Prefix of the names of the files.
pub const BLACK_BOX_PREFIX: &str = "black-box-";
/// Scans that are taken out of the ring in one scan while a box is open, and with it the most that saving adds to a scan.
const SCANS_PER_SCAN: usize = 4;
/// Scans before and after the cause of a box that have the whole state of every servo; a servo goes on from any of them to the bit.
const WHOLE_SCANS: u64 = 100;
/// A program longer than this is not in the boxes, in bytes.
const FILE_BYTES_MAX: usize = 8 << 20;

/// What is kept and saved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Time before the first cause, in s.
    pub before_s: f64,
    /// Time after the last cause, in s.
    pub after_s: f64,
    /// The longest that causes in a row make one box, from its first cause on, in s.
    pub longest_s: f64,
    /// The most boxes in one directory,
    pub boxes_max: usize,
    /// and bytes in them: at or above that no other is begun.
    pub boxes_bytes_max: u64,
    /// The most that the ring may hold, in bytes; with more axes or shorter scans it reaches less far back.
    pub ring_bytes_max: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            before_s: 5.0,
            after_s: 2.0,
            longest_s: 30.0,
            boxes_max: 20,
            boxes_bytes_max: 150_000_000,
            ring_bytes_max: 64 << 20,
        }
    }
}

/// Where boxes go, and what is known of the run.
#[derive(Debug, Clone)]
pub struct Home {
    /// The directory.
    pub directory: PathBuf,
    /// Stands at the beginning of every box.
    pub info: RunInfo,
}

/// Content, axis, length of the sample.
const HEAD_BYTES: usize = 1 + 1 + 4;

/// Bytes that the samples of one scan take in the ring, those that come once a period shared out.
fn scan_bytes(codec: &Codec, machine: &Machine) -> usize {
    let roles = |axis: &machine::Axis| 1 + usize::from(axis.standby);
    let commands: usize = machine.axes.iter().map(roles).sum();
    let window = Codec::WINDOW_HEAD_BYTES
        + codec.header.bytes
        + machine.intended_setpoints() as usize * codec.setpoint.bytes;
    let of_period = 2 * HEAD_BYTES + window + codec.planner.bytes;
    let period_scans = machine.scan.interpolation_period_scans.max(1) as usize;
    let bus_cycle = machine
        .bus
        .as_ref()
        .map_or(0, |_| HEAD_BYTES + codec.bus_cycle.bytes);
    let signals = match machine.signals.is_empty() {
        true => 0,
        false => HEAD_BYTES + codec.signals.bytes,
    };
    (2 + commands) * HEAD_BYTES
        + bus_cycle
        + signals
        + codec.feedback.bytes
        + codec.instruments.bytes
        + commands * codec.command.bytes
        + of_period.div_ceil(period_scans)
}

/// A box being written.
struct Open {
    recorder: Recorder,
    path: PathBuf,
    /// Last scan that belongs to it.
    until: u64,
    /// Last scan that it can be made longer to.
    longest: u64,
    /// First scan that is not in it yet.
    next: u64,
}

/// The ring and the box that is being written.
pub struct BlackBox {
    settings: Settings,
    machine: Machine,
    home: Option<Home>,
    codec: Codec,
    before_scans: u64,
    after_scans: u64,
    longest_scans: u64,
    ring: Ring,
    /// What has come of the scan whose feedback has not come yet: content, axis and length of each sample, then its bytes.
    filling: Vec<u8>,
    /// Who took part before the first scan in the ring.
    roster_before: Option<Box<Roster>>,
    deaths: Deaths,
    last: Option<(u32, u32)>,
    open: Option<Open>,
    told_full: bool,
}

impl BlackBox {
    /// For a machine, saving to `home`; without one the ring is filled and nothing is saved.
    pub fn new(settings: Settings, machine: &Machine, home: Option<Home>) -> BlackBox {
        let scans = |seconds: f64| libm::ceil(seconds / machine.scan_period_s()).max(0.0) as u64;
        let codec = Codec::of(&Extent::of(machine));
        let before_scans = scans(settings.before_s);
        let period_scans = machine.scan.interpolation_period_scans as usize;
        let scan_bytes = scan_bytes(&codec, machine);
        // One period more: a window comes all at once.
        let ring_bytes = scan_bytes * (before_scans as usize + 2 * period_scans.max(1));
        let ring_bytes = ring_bytes.min(settings.ring_bytes_max);
        let mut black_box = BlackBox {
            settings,
            machine: machine.clone(),
            home: None,
            ring: Ring::new(ring_bytes, before_scans as usize + 1),
            filling: Vec::with_capacity(64 << 10),
            codec,
            before_scans,
            after_scans: scans(settings.after_s),
            longest_scans: scans(settings.longest_s),
            roster_before: None,
            deaths: Deaths::new(machine),
            last: None,
            open: None,
            told_full: false,
        };
        black_box.move_to(home);
        black_box
    }

    /// Boxes that are started from now on go there; one that is open goes on where it is.
    pub fn move_to(&mut self, home: Option<Home>) {
        self.home = home.map(|mut home| {
            let files = &mut home.info.files;
            files.retain(|(_, data)| data.len() <= FILE_BYTES_MAX);
            home
        });
        self.told_full = false;
    }

    /// Takes one sample. A feedback ends what belongs together: the event of a box that was started or made longer, for the log of
    /// the run.
    pub fn take(&mut self, sample: SampleRef<'_>) -> Option<Event> {
        put(&mut self.filling, &self.codec, sample);
        match sample {
            SampleRef::Roster(roster) => self.deaths.roster(roster),
            SampleRef::Feedback(feedback) => return self.end_scan(feedback),
            _ => {}
        }
        None
    }

    fn end_scan(&mut self, sample: &Feedback) -> Option<Event> {
        self.deaths.scan(sample.scan);
        let (codec, roster_before) = (&self.codec, &mut self.roster_before);
        // It comes first of its scan, and seldom.
        let has_roster = self.filling.first() == Some(&(Content::Roster as u8));
        let remember = |forgotten: &[u8]| remember_roster(codec, forgotten, roster_before);
        self.ring
            .push(sample.scan, &self.filling, has_roster, remember);
        self.filling.clear();
        let event = self.judge(sample);
        self.write_some(SCANS_PER_SCAN);
        let is_over = |open: &Open| open.next > open.until;
        if self.open.as_ref().is_some_and(is_over) {
            self.end_box();
        }
        event
    }

    /// The stream ends: an open box is ended with what there is.
    pub fn finish(&mut self) {
        self.end_box();
    }

    /// What the ring holds: scans and bytes.
    #[cfg(test)]
    pub fn held(&self) -> (usize, usize) {
        self.ring.held()
    }

    /// Whether something has happened that a box is for.
    fn judge(&mut self, feedback: &Feedback) -> Option<Event> {
        let now = (feedback.mode, feedback.cause);
        let before = self.last.replace(now).unwrap_or(now);
        let tripped = now.0 == Mode::Tripped as u32 && before.0 != now.0;
        let stopped = now.1 != Cause::None as u32 && before.1 != now.1;
        let mut event = None;
        while let Some(death) = self.deaths.next_new() {
            let (scan, what) = (death.scan, format!("death-{}", death.name));
            event = self.cause(feedback.scan, scan, &what, death.how).or(event);
        }
        if tripped || stopped {
            let what = if tripped { "trip" } else { "stop" };
            let cause = StopCause::of(&self.machine, feedback).short();
            let (scan, words) = (feedback.scan, format!("{what}: {cause}"));
            event = self.cause(scan, scan, what, words).or(event);
        }
        event
    }

    /// Begins a box, or makes the open one longer.
    fn cause(&mut self, now: u64, scan: u64, what: &str, words: String) -> Option<Event> {
        let until = now.saturating_add(self.after_scans);
        let event = |file: &Path, did: &str| Event {
            scan,
            process: "monitor".into(),
            text: format!("{words}: {did} {}", file_name(file)),
        };
        if let Some(open) = &mut self.open
            && now <= open.longest
        {
            open.until = open.until.max(until.min(open.longest));
            let event = event(&open.path, "also in black box");
            let noted = open.recorder.record(SampleRef::Event(&event));
            self.warn(noted);
            return Some(event);
        }
        self.end_box();
        let home = self.home.as_ref()?;
        let (boxes, bytes) = boxes_in(&home.directory);
        if boxes >= self.settings.boxes_max || bytes >= self.settings.boxes_bytes_max {
            if !std::mem::replace(&mut self.told_full, true) {
                tracing::warn!(
                    "{}: holds {} black boxes of {} MB: no more are written, of {words} and what follows",
                    home.directory.display(),
                    boxes,
                    bytes / 1_000_000
                );
            }
            return None;
        }
        let mut info = home.info.clone();
        let settings = &mut info.settings;
        settings.insert("black_box".into(), format!("{words}, scan {scan}"));
        let (path, mut recorder) = match begin(&home.directory, scan, what, &self.machine, &info) {
            Ok(started) => started,
            Err(error) => {
                tracing::warn!("black box of {words}, scan {scan}, is not saved: {error}");
                return None;
            }
        };
        tracing::info!("{words}, scan {scan}: black box {}", file_name(&path));
        let event = event(&path, "black box");
        let mut noted = recorder.record(SampleRef::Event(&event));
        if let Some(roster) = &self.roster_before {
            noted = noted.and_then(|()| recorder.record(SampleRef::Roster(roster)));
        }
        self.open = Some(Open {
            recorder,
            path,
            until,
            longest: now.saturating_add(self.longest_scans.max(self.after_scans)),
            next: now.saturating_sub(self.before_scans),
        });
        self.warn(noted);
        Some(event)
    }

    /// A box that cannot be written is discarded.
    fn warn(&mut self, written: Result<(), LogError>) {
        if let Err(error) = written {
            tracing::warn!("a black box is given up: {error}");
            self.open = None;
        }
    }

    /// Writes so many scans of the ring to the open box.
    fn write_some(&mut self, most: usize) {
        let Some(open) = &mut self.open else {
            return;
        };
        let mut result = Ok(());
        for (scan, samples) in self.ring.from(open.next).take(most) {
            if scan > open.until {
                open.next = scan;
                break;
            }
            result = write_samples(&self.codec, samples, &mut open.recorder);
            open.next = scan + 1;
            if result.is_err() {
                break;
            }
        }
        self.warn(result);
    }

    /// Ends the open box with what of the ring belongs to it.
    fn end_box(&mut self) {
        self.write_some(usize::MAX);
        let Some(open) = self.open.take() else {
            return;
        };
        if let Err(error) = open.recorder.finish(&RunEnd::default()) {
            tracing::warn!("{}: is cut off: {error}", file_name(&open.path));
        }
    }
}

impl Drop for BlackBox {
    /// A recorder that ends for a reason of its own saves what it has.
    fn drop(&mut self) {
        self.end_box();
    }
}

/// The newest roster among samples that are forgotten.
fn remember_roster(codec: &Codec, bytes: &[u8], before: &mut Option<Box<Roster>>) {
    for (content, _, body) in samples(bytes) {
        if content == Content::Roster
            && let Some(Sample::Roster(roster)) = codec.decode(content, body)
        {
            *before = Some(roster);
        }
    }
}

fn file_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// Boxes that are in a directory, and their bytes; boxes of a recorder that died count too.
fn boxes_in(directory: &Path) -> (usize, u64) {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    let is_box = |name: &OsStr| name.to_string_lossy().starts_with(BLACK_BOX_PREFIX);
    let boxes = entries.filter(|entry| is_box(&entry.file_name()));
    let sizes = boxes.map(|entry| entry.metadata().map_or(0, |file| file.len()));
    sizes.fold((0, 0), |(count, all), size| (count + 1, all + size))
}

/// Makes the file of a box, which nobody had before.
fn begin(
    directory: &Path,
    scan: u64,
    what: &str,
    machine: &Machine,
    info: &RunInfo,
) -> Result<(PathBuf, Recorder), LogError> {
    let name = format!("{BLACK_BOX_PREFIX}{scan}-{what}");
    let mut path = directory.join(format!("{name}.mcap"));
    for number in 2..100 {
        if !path.exists() {
            break;
        }
        path = directory.join(format!("{name}-{number}.mcap"));
    }
    let whole = scan.saturating_sub(WHOLE_SCANS)..=scan.saturating_add(WHOLE_SCANS);
    let recorder = Recorder::create_new(&path, machine, info, whole)?;
    Ok((path, recorder))
}

/// Appends one sample.
fn put(bytes: &mut Vec<u8>, codec: &Codec, sample: SampleRef<'_>) {
    let axis = match sample {
        SampleRef::Command(axis, _) => axis as u8,
        _ => 0,
    };
    bytes.extend_from_slice(&[Content::of(&sample) as u8, axis]);
    let length_at = bytes.len();
    bytes.extend_from_slice(&[0; 4]);
    let start = bytes.len();
    codec.encode(sample, bytes);
    let length = (bytes.len() - start) as u32;
    if let Some(place) = bytes.get_mut(length_at..length_at + 4) {
        place.copy_from_slice(&length.to_le_bytes());
    }
}

/// The samples of a scan: content, axis, bytes.
fn samples(mut bytes: &[u8]) -> impl Iterator<Item = (Content, usize, &[u8])> {
    std::iter::from_fn(move || {
        let (head, rest) = bytes.split_at_checked(HEAD_BYTES)?;
        let length = u32::from_le_bytes(*head.get(2..)?.first_chunk()?) as usize;
        let (body, rest) = rest.split_at_checked(length)?;
        bytes = rest;
        let content: Content = bytemuck::checked::try_cast(*head.first()?).ok()?;
        Some((content, usize::from(*head.get(1)?), body))
    })
}

fn write_samples(codec: &Codec, bytes: &[u8], recorder: &mut Recorder) -> Result<(), LogError> {
    for (content, axis, body) in samples(bytes) {
        if let Some(sample) = codec.decode(content, body) {
            recorder.record(sample.as_ref(axis))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
