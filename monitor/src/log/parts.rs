//! The log of a run in parts: a recorder that replaces a dead one never writes over what is there, it begins the next part
//! (`run.mcap`, `run-2.mcap`, `run-3.mcap` …), and whoever reads the run reads them as one.

use std::fs::{self, File, OpenOptions};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use bus::sample::WindowId;

use super::error::LogError;
use super::reader::Reader;
use super::run_info::{RunEnd, RunInfo};
use super::sample::Sample;
use crate::digest;

/// Name of the log in the run directory; of its first part, where there are several.
pub const LOG_FILE: &str = "run.mcap";
/// Parts that one run may have: a recorder that dies this often is not started any more.
const PARTS_MAX: u32 = 10_000;

/// File name of a part, counted from 1.
fn part_name(part: u32) -> String {
    match part {
        0 | 1 => LOG_FILE.into(),
        part => format!("run-{part}.mcap"),
    }
}

/// The number in the name of a part; none if it is not the name of one.
fn part_number(name: &str) -> Option<u32> {
    if name == LOG_FILE {
        return Some(1);
    }
    let number = name.strip_prefix("run-")?.strip_suffix(".mcap")?;
    let part = number.parse().ok().filter(|part| *part >= 2)?;
    (part_name(part) == name).then_some(part)
}

/// Numbers of the parts in a run directory, in order.
fn parts_in(run_dir: &Path) -> Result<Vec<u32>, LogError> {
    let mut parts = Vec::new();
    for entry in fs::read_dir(run_dir).map_err(LogError::of_file(run_dir))? {
        let name = entry.map_err(LogError::of_file(run_dir))?.file_name();
        parts.extend(name.to_str().and_then(part_number));
    }
    parts.sort_unstable();
    Ok(parts)
}

/// Files of the parts in a run directory, in order.
///
/// # Errors
/// The directory cannot be read.
pub fn part_files(run_dir: &Path) -> Result<Vec<PathBuf>, LogError> {
    let parts = parts_in(run_dir)?;
    Ok(parts
        .into_iter()
        .map(|part| run_dir.join(part_name(part)))
        .collect())
}

/// Makes the file of the next part: its number, its path and the file, which nobody had before.
pub(super) fn make_next(run_dir: &Path) -> Result<(u32, PathBuf, File), LogError> {
    let mut part = parts_in(run_dir)?.last().map_or(1, |last| last + 1);
    loop {
        let path = run_dir.join(part_name(part));
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            Ok(file) => return Ok((part, path, file)),
            // Another one was quicker.
            Err(error) if error.kind() == ErrorKind::AlreadyExists && part < PARTS_MAX => part += 1,
            Err(source) => return Err(LogError::File { path, source }),
        }
    }
}

/// One part, as far as it has been read.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Part {
    /// File name.
    pub file: String,
    /// First scan whose feedback is in it; none if it holds none.
    pub first_scan: Option<u64>,
    /// Last one.
    pub last_scan: Option<u64>,
    /// Why it ends early, if it does.
    pub cut: Option<String>,
}

/// The newest of each channel that the parts before had: a recorder that joins finds some samples once more.
#[derive(Debug, Clone, Default)]
struct Newest {
    feedback: Option<u64>,
    instruments: Option<u64>,
    bus_cycle: Option<u64>,
    signals: Option<u64>,
    commands: [[Option<u64>; 2]; bus::sample::MAX_AXES],
    planner: Option<(u64, u32)>,
    roster: Option<u64>,
    window: Option<(u32, u32)>,
}

impl Newest {
    /// Puts the larger one into `newest`; whether the sample is newer than all of `before`.
    fn step<T: Ord + Copy>(before: Option<T>, newest: &mut Option<T>, at: T) -> bool {
        *newest = (*newest).max(Some(at));
        Some(at) > before
    }

    /// Takes one sample of a part; whether the parts before did not have it.
    fn take(&mut self, before: &Newest, sample: &Sample) -> bool {
        match sample {
            Sample::Feedback(s) => Self::step(before.feedback, &mut self.feedback, s.scan),
            Sample::Instruments(s) => Self::step(before.instruments, &mut self.instruments, s.scan),
            Sample::BusCycle(s) => Self::step(before.bus_cycle, &mut self.bus_cycle, s.scan),
            Sample::Signals(s) => Self::step(before.signals, &mut self.signals, s.scan),
            Sample::Command(s) => {
                let (axis, role) = (s.axis as usize, s.role as usize);
                let earlier = before.commands.get(axis).and_then(|roles| roles.get(role));
                let place = self
                    .commands
                    .get_mut(axis)
                    .and_then(|roles| roles.get_mut(role));
                match (earlier, place) {
                    (Some(earlier), Some(place)) => Self::step(*earlier, place, s.scan),
                    _ => true,
                }
            }
            // A planner that was restarted in the same scan says something else.
            Sample::Planner(s) => {
                Self::step(before.planner, &mut self.planner, (s.scan, s.incarnation))
            }
            Sample::Roster(s) => Self::step(before.roster, &mut self.roster, s.version),
            Sample::Window(s) => {
                Self::step(before.window, &mut self.window, order_of(&s.header.id))
            }
            // Nobody says one twice.
            Sample::Event(_) => true,
        }
    }
}

/// Windows are counted again by each planner.
fn order_of(id: &WindowId) -> (u32, u32) {
    (id.incarnation, id.sequence)
}

/// All parts of a run's log, read as one: samples in the order of the parts; what an earlier part already had is left out.
///
/// What was published while no recorder lived is in no part: [`RunLog::parts`] tells from where to where each reaches.
pub struct RunLog {
    rest: std::vec::IntoIter<PathBuf>,
    /// Read to its end, or started; the last belongs to `reader`.
    parts: Vec<Part>,
    reader: Reader,
    reading: bool,
    digests: Vec<Option<String>>,
    newest: Newest,
    /// As it was when the part being read began.
    before: Newest,
    windows_lost: u64,
    queue_losses: u64,
}

impl RunLog {
    /// Opens the log of a run.
    ///
    /// A part whose recorder died before it had written anything is a part without samples, as long as another one has some.
    ///
    /// # Errors
    /// There is no part, or the first that holds anything is not a log of this product.
    pub fn open(run_dir: &Path) -> Result<RunLog, LogError> {
        let mut files = part_files(run_dir)?;
        if files.is_empty() {
            // Says which file is missing.
            files.push(run_dir.join(LOG_FILE));
        }
        let mut rest = files.into_iter();
        let mut parts = Vec::new();
        let mut failure = None;
        let reader = loop {
            let Some(path) = rest.next() else {
                return Err(failure.unwrap_or(LogError::NotALog {
                    path: run_dir.into(),
                    what: "holds no log".into(),
                }));
            };
            match Reader::open(&path) {
                Ok(reader) => {
                    parts.push(started(&path));
                    break reader;
                }
                Err(LogError::Empty { path }) => {
                    parts.push(empty(&path));
                    failure.get_or_insert(LogError::Empty { path });
                }
                Err(error) => return Err(error),
            }
        };
        Ok(RunLog {
            rest,
            parts,
            reader,
            reading: true,
            digests: Vec::new(),
            newest: Newest::default(),
            before: Newest::default(),
            windows_lost: 0,
            queue_losses: 0,
        })
    }

    /// What was known when the run began, files excepted.
    pub fn info(&self) -> &RunInfo {
        self.reader.info()
    }

    /// Letters of the axes, in order.
    pub fn axes(&self) -> &[String] {
        self.reader.axes()
    }

    /// Scan period in µs.
    pub fn scan_period_us(&self) -> u32 {
        self.reader.scan_period_us()
    }

    /// The parts read so far, in order; all of them at the end.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Windows that are in no part although later ones of the same planner do.
    pub fn windows_lost(&self) -> u64 {
        self.windows_lost
    }

    /// What was known when the run ended, with the losses of all recorders' queues; none if the last one did not end its part.
    pub fn end(&self) -> Option<RunEnd> {
        let end = self.reader.end()?;
        Some(RunEnd {
            queue_losses: self.queue_losses,
            ..end.clone()
        })
    }

    /// Why the log of the run ends early, if it does: that of an earlier part is reported with it.
    pub fn cut(&self) -> Option<&str> {
        self.parts.last()?.cut.as_deref()
    }

    /// The digest of everything read: that of the part where there is one, over the parts' own in their order where there are
    /// several; none where a part below level `full` was not ended.
    pub fn digest(&self) -> Option<String> {
        match self.digests.as_slice() {
            [one] => one.clone(),
            several => {
                let all: Option<Vec<&str>> = several.iter().map(Option::as_deref).collect();
                all.map(digest::over_parts)
            }
        }
    }

    /// The next sample, none at the end.
    ///
    /// # Errors
    /// A message that does not fit its channel, a part that can no longer be read or is not of this run.
    pub fn next_sample(&mut self) -> Result<Option<Sample>, LogError> {
        while self.reading {
            let Some(sample) = self.reader.next_sample()? else {
                self.end_part();
                self.begin_part()?;
                continue;
            };
            let first_of_part = self.newest.window == self.before.window;
            let is_new = self.newest.take(&self.before, &sample);
            match &sample {
                Sample::Feedback(feedback) => {
                    if let Some(part) = self.parts.last_mut() {
                        part.first_scan.get_or_insert(feedback.scan);
                        part.last_scan = part.last_scan.max(Some(feedback.scan));
                    }
                }
                Sample::Window(window) if is_new && first_of_part => {
                    let (incarnation, sequence) = order_of(&window.header.id);
                    if let Some((before, last)) = self.before.window
                        && before == incarnation
                    {
                        self.windows_lost += u64::from(sequence.saturating_sub(last + 1));
                    }
                }
                _ => {}
            }
            if is_new {
                return Ok(Some(sample));
            }
        }
        Ok(None)
    }

    fn end_part(&mut self) {
        if let Some(part) = self.parts.last_mut() {
            part.cut = self.reader.cut().map(str::to_string);
        }
        self.digests.push(self.reader.digest());
        self.queue_losses += self.reader.end().map_or(0, |end| end.queue_losses);
        self.before = self.newest.clone();
    }

    fn begin_part(&mut self) -> Result<(), LogError> {
        loop {
            let Some(path) = self.rest.next() else {
                self.reading = false;
                return Ok(());
            };
            let next = match Reader::open(&path) {
                Ok(next) => next,
                Err(LogError::Empty { path }) => {
                    self.parts.push(empty(&path));
                    continue;
                }
                Err(error) => return Err(error),
            };
            self.same_run(&next, &path)?;
            self.parts.push(started(&path));
            self.reader = next;
            return Ok(());
        }
    }

    fn same_run(&self, next: &Reader, path: &Path) -> Result<(), LogError> {
        let of = |reader: &Reader| {
            let info = reader.info();
            format!(
                "cell {}, axes {}, {} µs, {}, {}",
                info.cell,
                reader.axes().join(" "),
                reader.scan_period_us(),
                info.pace,
                info.program
            )
        };
        let (here, there) = (of(&self.reader), of(next));
        if here == there {
            return Ok(());
        }
        Err(LogError::NotALog {
            path: path.into(),
            what: format!("is of {there}, the part before it of {here}: they are not of one run"),
        })
    }
}

impl Iterator for RunLog {
    type Item = Result<Sample, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_sample().transpose()
    }
}

fn started(path: &Path) -> Part {
    let name = path.file_name().unwrap_or_default();
    Part {
        file: name.to_string_lossy().into_owned(),
        ..Part::default()
    }
}

fn empty(path: &Path) -> Part {
    Part {
        cut: Some("the recorder ended before it had written anything".into()),
        ..started(path)
    }
}
