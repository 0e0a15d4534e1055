//! The programs of a cell that stays up, as the launcher sees them: each one that was started has a folder of its own, and a
//! report once it is over.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use bus::cell::CellPlace;
use bus::sample::{Cause, Feedback, Mode, ProgramState};
use rustix::process::{Pid, setpriority_process};
use serde_json::Value;

use crate::events::{Event, Events};

/// Niceness of the processes that make reports: they share the PC with a machine that moves.
const REPORT_NICENESS: i32 = 19;
/// So long the reports that are still being made may hold up the end of the cell.
const REPORT_LIMIT: Duration = Duration::from_secs(120);
const REPORT_LOOK: Duration = Duration::from_millis(20);

/// A report on its way.
#[derive(Debug)]
struct Report {
    run: u32,
    folder: PathBuf,
    child: Child,
}

/// What happens to the programs of a cell.
#[derive(Debug)]
pub struct Session {
    folder: PathBuf,
    place: CellPlace,
    /// Runs whose report is made or on its way.
    reported: u32,
    /// The run that was said to have begun.
    begun: u32,
    /// Programs of lower numbers are gone.
    pruned: u32,
    /// State that was said last.
    said: Option<(u32, u32, u32)>,
    /// A run that is over, and the scan whose samples its log must have.
    over: Option<(u32, u64)>,
    reports: Vec<Report>,
}

impl Session {
    /// Of the cell in `place`, with one folder in `folder` for each program.
    pub fn new(folder: &Path, place: &CellPlace) -> Session {
        Session {
            folder: folder.into(),
            place: place.clone(),
            reported: 0,
            begun: 0,
            pruned: 0,
            said: None,
            over: None,
            reports: Vec::new(),
        }
    }

    /// Looks at the newest feedback; the recorder has taken `recorded_scans`.
    pub fn look(&mut self, feedback: &Feedback, recorded_scans: u64, events: &mut Events) {
        self.say_state(feedback, events);
        self.prune(feedback);
        let begun = feedback.program == ProgramState::Begun as u32;
        if begun && feedback.run != self.begun && self.folder_of(feedback.run).is_some() {
            self.begun = feedback.run;
            let folder = self.folder_of(feedback.run).unwrap_or_default();
            tracing::info!("run {} begins: {}", feedback.run, folder.display());
            let text = Some(folder.display().to_string());
            events.write(&Event::of_cell(feedback.scan, "run begins", text));
        }
        let done = feedback.run - u32::from(begun);
        if done > self.reported && self.over.is_none_or(|(run, _)| run != done) {
            self.over = Some((done, feedback.scan));
        }
        if let Some((run, scan)) = self.over
            && recorded_scans > scan
        {
            self.report_until(run);
        }
        self.reap(feedback.scan, events);
    }

    /// The cell has ended: the last report too is made.
    pub fn finish(&mut self, last: &Feedback, events: &mut Events) {
        self.report_until(last.run);
        let started = Instant::now();
        while !self.reports.is_empty() && started.elapsed() < REPORT_LIMIT {
            self.reap(last.scan, events);
            std::thread::sleep(REPORT_LOOK);
        }
        for mut report in self.reports.drain(..) {
            tracing::warn!("{}: its report takes too long", report.folder.display());
            let _ = report.child.kill();
            let _ = report.child.wait();
        }
    }

    fn say_state(&mut self, feedback: &Feedback, events: &mut Events) {
        let state = (feedback.mode, feedback.cause, feedback.program);
        if self.said == Some(state) {
            return;
        }
        // Trips are said with all they mean elsewhere.
        if let Some(mode) = Mode::from_wire(feedback.mode).filter(|mode| *mode != Mode::Tripped) {
            let program = ProgramState::from_wire(feedback.program);
            let program = program.map_or("of another version", ProgramState::word);
            let cause = match Cause::from_wire(feedback.cause) {
                Some(Cause::None) => String::new(),
                cause => format!(": {}", cause.map_or("an unknown cause", Cause::words)),
            };
            let text = format!("{}{cause}, program {program}", mode.word());
            tracing::info!("scan {}: {text}", feedback.scan);
            events.write(&Event::of_cell(feedback.scan, "state", Some(text)));
        }
        self.said = Some(state);
    }

    /// Programs that have been replaced are not needed any more.
    fn prune(&mut self, feedback: &Feedback) {
        let read = feedback.program >= ProgramState::Loaded as u32;
        if read && feedback.load > self.pruned {
            self.pruned = feedback.load;
            for entry in fs::read_dir(self.place.programs())
                .into_iter()
                .flatten()
                .flatten()
            {
                let number = entry
                    .file_name()
                    .to_str()
                    .and_then(|name| name.parse().ok());
                if number.is_some_and(|number: u32| number < feedback.load) {
                    let _ = fs::remove_dir_all(entry.path());
                }
            }
        }
    }

    /// Folder of a run, once the recorder has made it.
    fn folder_of(&self, run: u32) -> Option<PathBuf> {
        let start = format!("{run:03}-");
        let entries = fs::read_dir(&self.folder).ok()?.flatten();
        let mut folders = entries.map(|entry| entry.path());
        folders.find(|path| {
            let name = path.file_name().and_then(|name| name.to_str());
            path.is_dir() && name.is_some_and(|name| name.starts_with(&start))
        })
    }

    /// Has the reports of all runs up to this one made, by processes beside the cell.
    fn report_until(&mut self, run: u32) {
        self.over = None;
        while self.reported < run {
            self.reported += 1;
            let Some(folder) = self.folder_of(self.reported) else {
                tracing::warn!("run {} has left no log", self.reported);
                continue;
            };
            let child = Command::new("/proc/self/exe")
                .arg("report")
                .arg(&folder)
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .spawn();
            match child {
                Ok(child) => {
                    let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
                    let _ = setpriority_process(pid, REPORT_NICENESS);
                    self.reports.push(Report {
                        run: self.reported,
                        folder,
                        child,
                    });
                }
                Err(error) => tracing::warn!("no report of {}: {error}", folder.display()),
            }
        }
    }

    fn reap(&mut self, scan: u64, events: &mut Events) {
        self.reports.retain_mut(|report| {
            let Ok(Some(status)) = report.child.try_wait() else {
                return true;
            };
            let outcome = if status.success() {
                outcome_of(&report.folder)
            } else {
                format!("no report could be made ({status})")
            };
            let text = format!("{}: {outcome}", report.folder.display());
            tracing::info!("run {}: {text}", report.run);
            events.write(&Event::of_cell(scan, "run over", Some(text)));
            false
        });
    }
}

/// How a run ended and how well it went, from its report.
fn outcome_of(folder: &Path) -> String {
    let text = fs::read_to_string(folder.join("report.json")).unwrap_or_default();
    let report: Value = serde_json::from_str(&text).unwrap_or_default();
    let word = |pointer: &str| report.pointer(pointer).and_then(Value::as_str);
    let kind = word("/outcome/kind").unwrap_or("of unknown outcome");
    let why = word("/outcome/reason").map_or(String::new(), |why| format!(" ({why})"));
    let contour = report
        .pointer("/contour_error_um/peak")
        .and_then(Value::as_f64);
    let contour = contour.map_or(String::new(), |um| {
        format!(", contour error {um:.1} µm at most")
    });
    format!("{kind}{why}{contour}")
}
