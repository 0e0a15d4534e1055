//! The programs of a cell that stays up, as the launcher sees them: each one that was started has a folder of its own, and a
//! report once it is over.

use std::fs;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use bus::cell::CellPaths;
use bus::drive_codes::cause_words;
use bus::sample::{Cause, Feedback, Mode, ProgramState};
use machine::Machine;
use monitor::ended::Ended;
use serde_json::Value;

use crate::events::{Event, Events};
use crate::retention::{Retention, folders, is_of_cell};
use console::logs;
use console::signals::Signals;

/// So long the reports that are still being made may hold up the end of the cell.
const REPORT_LIMIT: Duration = Duration::from_secs(120);
const REPORT_LOOK: Duration = Duration::from_millis(20);
/// More programs are started between two looks only where the launcher was stopped meanwhile, and never more than the second.
const STARTED_MAX: [u32; 2] = [1000, 1_000_000];

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
    place: CellPaths,
    /// Runs whose report is made or on its way.
    reported: u32,
    /// Runs whose logs are whole.
    logged: u32,
    /// Runs that were reported to have started.
    started: u32,
    /// Runs that the feedback before had.
    counted: u32,
    /// Programs of lower numbers are gone.
    pruned: u32,
    /// The program that was loaded, and the scan in which this was seen.
    loaded: Option<(u32, u64)>,
    /// Program and run that were seen last.
    seen: (u32, u32),
    /// State that was reported last.
    printed: Option<(u32, u32, u32)>,
    /// A run that is over, and the scan whose samples its log must have.
    over: Option<(u32, u64)>,
    /// How those ended that have no report yet.
    ended: Vec<Ended>,
    /// One at a time.
    report: Option<Report>,
    /// What is kept of earlier runs.
    retention: Retention,
    /// Runs have reports.
    reports: bool,
    /// The cell has ended.
    hurries: bool,
}

impl Drop for Session {
    fn drop(&mut self) {
        if let Some(mut report) = self.report.take() {
            let _ = report.child.kill();
            let _ = report.child.wait();
        }
    }
}

impl Session {
    /// Of the cell in `place`, with one folder in `folder` for each program.
    pub fn new(folder: &Path, place: &CellPaths, retention: Retention, reports: bool) -> Session {
        Session {
            retention,
            reports,
            folder: folder.into(),
            place: place.clone(),
            reported: 0,
            logged: 0,
            started: 0,
            counted: 0,
            pruned: 0,
            loaded: None,
            seen: (0, 0),
            printed: None,
            over: None,
            report: None,
            ended: Vec::new(),
            hurries: false,
        }
    }

    /// Whether so many runs can have been started. A number that is wrong for once is left out.
    fn can_be(&mut self, runs: u32) -> bool {
        let is_again = std::mem::replace(&mut self.counted, runs) == runs;
        let [at_once, most] = STARTED_MAX;
        runs.saturating_sub(self.started) <= if is_again { most } else { at_once }
    }

    /// Looks at the newest feedback; the recorder has taken `recorded_scans`.
    pub fn look(
        &mut self,
        feedback: &Feedback,
        machine: &Machine,
        recorded_scans: u64,
        events: &mut Events,
    ) {
        if !self.can_be(feedback.run) {
            return;
        }
        self.say_state(feedback, events);
        if feedback.ended.run <= feedback.run && !self.knows_end_of(feedback.ended.run) {
            let ended = Ended::told(machine, feedback, feedback.ended.run);
            self.take_end(ended.filter(Ended::is_whole));
        }
        self.prune(feedback, recorded_scans);
        while self.started < feedback.run {
            self.started += 1;
            tracing::info!("run {} begins", self.started);
            events.note(feedback.scan, "run begins", format!("run {}", self.started));
        }
        let started = feedback.program == ProgramState::Running as u32;
        let done = feedback.run.saturating_sub(u32::from(started));
        if done > self.logged && self.over.is_none_or(|(run, _)| run != done) {
            self.over = Some((done, feedback.scan));
        }
        if let Some((run, scan)) = self.over
            && recorded_scans > scan
        {
            self.logged = run;
            self.over = None;
        }
        self.make_reports(feedback.scan, events);
        for (event, text) in self.retention.look() {
            events.note(feedback.scan, event, text);
        }
    }

    /// How a run ended, as the master says it.
    pub fn take_end(&mut self, ended: Option<Ended>) {
        let is_new = |ended: &Ended| !self.knows_end_of(ended.run);
        let new = ended.filter(is_new);
        self.ended.extend(new);
    }

    fn knows_end_of(&self, run: u32) -> bool {
        let newest = self.ended.last().map_or(self.reported, |newest| newest.run);
        run <= newest
    }

    /// How a run ended is noted among the events and in its folder. Of two that end between two looks the recorder alone has seen the
    /// first one.
    fn note_end(&mut self, run: u32, folder: Option<&Path>, events: &mut Events) {
        let seen = self.ended.extract_if(.., |ended| ended.run <= run);
        let seen = seen.filter(|ended| ended.run == run).last();
        if let (Some(ended), Some(folder)) = (&seen, folder)
            && let Err(error) = ended.note(folder)
        {
            tracing::warn!("{}: {error}", folder.display());
        }
        if let Some(ended) = seen.or_else(|| Ended::read(folder?)) {
            let text = match ended.text.as_str() {
                "" => format!("run {run}"),
                why => format!("run {run}: {why}"),
            };
            events.write(&Event {
                outcome: Some(ended.outcome.word()),
                ..Event::of_cell(ended.scan, "run ended", Some(text))
            });
        }
    }

    /// The cell has ended out of order: no report is made.
    pub fn give_up(&mut self, last: &Feedback, events: &mut Events) {
        self.end_all(last);
        while self.reported < self.logged {
            self.reported += 1;
            let folder = self.folder_of(self.reported);
            self.note_end(self.reported, folder.as_deref(), events);
        }
    }

    /// Whether another program has been loaded or started since this was asked last.
    pub fn is_another(&mut self, feedback: &Feedback) -> bool {
        let now = (feedback.load, feedback.run);
        std::mem::replace(&mut self.seen, now) != now
    }

    /// The cell has ended: the reports that are missing are made, unless somebody is in a hurry.
    pub fn finish(&mut self, last: &Feedback, signals: &Signals, events: &mut Events) {
        self.end_all(last);
        self.reap(last.scan, events);
        self.hurry();
        let (started, before) = (Instant::now(), signals.count());
        loop {
            self.make_reports(last.scan, events);
            let Some(report) = &self.report else { return };
            let hurry = signals.count() > before;
            if hurry || started.elapsed() > REPORT_LIMIT {
                let folder = report.folder.display();
                tracing::warn!("not waited for: `quadrant report {folder}` makes it");
                return;
            }
            std::thread::sleep(REPORT_LOOK);
        }
    }

    /// All runs are over, and their logs whole.
    fn end_all(&mut self, last: &Feedback) {
        if self.can_be(last.run) {
            self.logged = last.run;
        }
    }

    fn say_state(&mut self, feedback: &Feedback, events: &mut Events) {
        let state = (feedback.mode, feedback.cause, feedback.program);
        if self.printed == Some(state) {
            return;
        }
        // Trips are reported with all they mean elsewhere.
        if let Some(mode) = Mode::from_wire(feedback.mode).filter(|mode| *mode != Mode::Tripped) {
            let program = ProgramState::from_wire(feedback.program);
            let program = program.map_or("of another version", ProgramState::word);
            let cause = match Cause::from_wire(feedback.cause) {
                Some(Cause::None) => String::new(),
                _ => format!(": {}", cause_words(feedback)),
            };
            let text = format!("{}{cause}, program {program}", mode.word());
            tracing::info!("by scan {}: {text}", feedback.scan);
            events.note(feedback.scan, "state", text);
        }
        self.printed = Some(state);
    }

    /// Programs that have been replaced are not needed any more, once the recorder too has come to where they were.
    fn prune(&mut self, feedback: &Feedback, recorded_scans: u64) {
        let read = feedback.program >= ProgramState::Loaded as u32;
        if read && self.loaded.is_none_or(|(load, _)| load != feedback.load) {
            self.loaded = Some((feedback.load, feedback.scan));
        }
        let Some((load, scan)) = self.loaded else {
            return;
        };
        if load <= self.pruned || recorded_scans <= scan {
            return;
        }
        self.pruned = load;
        let programs = fs::read_dir(self.place.programs()).into_iter().flatten();
        for entry in programs.flatten() {
            let name = entry.file_name();
            let number = name.to_str().and_then(|name| name.parse().ok());
            if number.is_some_and(|number: u32| number < load) {
                let _ = fs::remove_dir_all(entry.path());
            }
        }
    }

    /// Folder of a run, once the recorder has made it.
    fn folder_of(&self, run: u32) -> Option<PathBuf> {
        let is_it = |folder: &PathBuf| monitor::run_number(folder) == Some(run);
        folders(&self.folder).find(|folder| is_it(folder) && is_of_cell(folder))
    }

    /// Has the reports of all runs whose logs are whole made, one after the other, by processes beside the cell.
    fn make_reports(&mut self, scan: u64, events: &mut Events) {
        self.reap(scan, events);
        while self.report.is_none() && self.reported < self.logged {
            self.reported += 1;
            let (run, folder) = (self.reported, self.folder_of(self.reported));
            self.note_end(run, folder.as_deref(), events);
            match folder {
                Some(folder) if self.reports => self.make_report(run, folder),
                Some(folder) => self.retention.over(folder),
                None if self.reports => {
                    let text = format!("run {run} has left no log: there is no report of it");
                    tracing::warn!("{text}");
                    events.note(scan, "run over", text);
                }
                None => {}
            }
        }
    }

    fn make_report(&mut self, run: u32, folder: PathBuf) {
        let mut command = Command::new("/proc/self/exe");
        command.arg("report").arg(&folder);
        if !self.hurries {
            command.arg("--background");
        }
        command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        // Ctrl-C goes to the launcher alone.
        match command.process_group(0).spawn() {
            Ok(mut child) => {
                if let Some(stderr) = child.stderr.take() {
                    // Without a thread nobody reads them, and the report is made nevertheless.
                    let _ = logs::forward_all(format!("report of run {run}"), stderr);
                }
                self.report = Some(Report { run, folder, child });
            }
            Err(error) => tracing::warn!("no report of {}: {error}", folder.display()),
        }
    }

    /// From now on somebody waits for the reports, and no machine moves beside them: one that was begun in the background, where
    /// a busy PC has no time for it, is made again.
    fn hurry(&mut self) {
        self.hurries = true;
        if let Some(mut report) = self.report.take() {
            let _ = report.child.kill();
            let _ = report.child.wait();
            self.make_report(report.run, report.folder);
        }
    }

    fn reap(&mut self, scan: u64, events: &mut Events) {
        let Some(report) = &mut self.report else {
            return;
        };
        let Ok(Some(status)) = report.child.try_wait() else {
            return;
        };
        let outcome = match status.success() {
            true => outcome_of(&report.folder),
            false => format!("no report could be made ({status})"),
        };
        let text = format!("{}: {outcome}", report.folder.display());
        tracing::info!("run {}: {text}", report.run);
        events.note(scan, "run over", text);
        self.retention.over(report.folder.clone());
        self.report = None;
    }
}

/// How a run ended and how well it went, from its report.
fn outcome_of(folder: &Path) -> String {
    let text = fs::read_to_string(folder.join("report.json")).unwrap_or_default();
    let report: Value = serde_json::from_str(&text).unwrap_or_default();
    let word = |pointer: &str| report.pointer(pointer).and_then(Value::as_str);
    let kind = word("/outcome/kind").unwrap_or("of unknown outcome");
    let why = word("/outcome/reason").map_or(String::new(), |why| format!(" ({why})"));
    let contour = report.pointer("/contour_error_um/peak");
    let contour = contour.and_then(Value::as_f64).map_or(String::new(), |um| {
        format!(", contour error {um:.1} µm at most")
    });
    format!("{kind}{why}{contour}")
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;
    use crate::hints::{lost_in, waits_for};
    use crate::retention::EVENTS_FILE;
    use crate::spoilt::{self, Spoiler};
    use crate::standby_alarm::StandbyAlarm;
    use crate::supervise::stop_words;
    use crate::supervisor::goes_on_after_stop;

    fn machine() -> machine::Machine {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
        machine::Machine::load(&folder).expect("machine.toml")
    }

    fn session(folder: &Path) -> Session {
        let place = CellPaths::new("spoilt").expect("a name");
        Session::new(folder, &place, Retention::default(), false)
    }

    fn feedback(scan: u64, run: u32) -> Feedback {
        let mut feedback = Feedback::zeroed();
        (feedback.scan, feedback.visible_from) = (scan, scan);
        (feedback.run, feedback.axis_count) = (run, 2);
        feedback.mode = Mode::Ready as u32;
        feedback.program = ProgramState::Running as u32;
        feedback
    }

    #[test]
    fn a_number_of_runs_that_nobody_has_started_is_none_and_the_next_run_is_told_of() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut events = Events::create(folder.path()).expect("events");
        let mut session = session(folder.path());
        for run in [1, u32::MAX / 1000, 2, 1 << 20, 3] {
            session.look(
                &feedback(u64::from(run), run),
                &machine(),
                u64::MAX,
                &mut events,
            );
        }
        session.end_all(&feedback(9, 1 << 20));
        session.make_reports(9, &mut events);
        assert_eq!(session.reported, 2, "those that are over");
        session.end_all(&feedback(9, 3));
        session.make_reports(9, &mut events);
        assert_eq!(session.reported, 3);
        let text = fs::read_to_string(folder.path().join(EVENTS_FILE)).expect("events");
        assert_eq!(text.matches("run begins").count(), 3, "{text}");
    }

    /// All that the launcher makes of what it reads. SPOILT_SAMPLES=1000000 takes some 1 s.
    #[test]
    fn no_number_of_a_feedback_keeps_the_launcher_from_its_next_look() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut events = Events::nowhere().expect("events");
        let (machine, mut session) = (machine(), session(folder.path()));
        let (mut alarm, mut spoiler) = (StandbyAlarm::default(), Spoiler::new());
        let mut messages = bus::messages::MessageReader::new(folder.path().join("messages"));
        for number in 0..spoilt::count(20_000) {
            let wrong = spoiler.feedback(&feedback(number, 1 + (number / 1000) as u32));
            session.look(&wrong, &machine, spoiler.draw(), &mut events);
            session.is_another(&wrong);
            messages.hear(&wrong);
            alarm.look(&wrong, &machine);
            let hints = [waits_for(&wrong, &machine.restart), lost_in(&wrong)];
            let said = hints.map(|hint| hint.map(|hint| hint.words("c", true)));
            let stop = stop_words(&wrong, &machine, Some(&folder.path().join("messages")));
            let goes_on = goes_on_after_stop(spoiler.draw(), &wrong);
            std::hint::black_box((said, stop, goes_on));
        }
    }
}
