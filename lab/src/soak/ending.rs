//! How the runs of a soak end, and what must be left of them: nothing.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use bus::cell::CellPaths;
use bus::sample::Mode;
use console::exit::words;
use launcher::retention::EVENTS_FILE;
use rustix::process::{Signal, geteuid};
use serde_json::Value;

use super::Soak;
use super::cell::{self, Cell};
use super::disturb::RETURN_LIMIT;
use super::judge::Finish;
use super::tally::Tally;

/// A run that goes on so long after its last fault, nominal time of its program aside, hangs.
const END_LIMIT: Duration = Duration::from_secs(120);
/// Most faults before a run is ended from outside.
const FAULTS_MAX: u64 = 12;
/// The report of a run is made after it has ended, and takes longer the longer its log is: so much for a scan, on a PC that does
/// other things.
const REPORT_PER_SCAN: Duration = Duration::from_micros(300);
/// So many more files may the soak itself hold open than after its first run.
const OWN_FILES_MAX: usize = 4;

/// How a run ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// Its program is done.
    Completed,
    /// By the operator's order.
    Stopped,
    /// Its launcher is asked to end.
    Interrupted,
    /// Its launcher is killed, and the next one of the name waits until all is gone.
    LauncherKilled,
    /// Its launcher is killed, and the next one of the name is started at once.
    LauncherReplaced,
}

impl Ending {
    /// The word for it.
    pub fn word(self) -> &'static str {
        match self {
            Ending::Completed => "completed",
            Ending::Stopped => "stopped",
            Ending::Interrupted => "interrupted",
            Ending::LauncherKilled | Ending::LauncherReplaced => "launcher killed",
        }
    }
}

/// What a run has left to the next.
#[derive(Debug, Default)]
pub struct Left {
    /// The launcher was killed then, and nobody has cleaned up.
    killed: Option<Instant>,
    /// Files that the soak itself had open after its first run.
    own_files: Option<usize>,
}

impl Left {
    /// A run that was asked for at `since` is up.
    pub fn started(&mut self, since: Instant, tally: &mut Tally) {
        let what = match self.killed.take() {
            Some(_) => "run up after a killed launcher",
            None => "run up",
        };
        tally.returned(what, since.elapsed().as_secs_f64() * 1e3);
    }
}

impl Soak<'_> {
    /// How the next run is to end, and after how many faults.
    pub(super) fn draw_ending(&mut self) -> (Ending, u64) {
        if self.options.only.is_some() {
            return (Ending::Completed, u64::MAX);
        }
        let ending = match self.rng.below(10) {
            0..3 => return (Ending::Completed, u64::MAX),
            3..5 => Ending::Stopped,
            5..6 => Ending::Interrupted,
            6..8 => Ending::LauncherKilled,
            _ => Ending::LauncherReplaced,
        };
        (ending, 1 + self.rng.below(FAULTS_MAX))
    }

    /// Ends a run, waits until it has and judges what it says of itself.
    pub(super) fn end(
        &mut self,
        cell: &mut Cell,
        drawn: Ending,
        seconds: f64,
        out: &Path,
    ) -> Ending {
        let goes_on = cell.look() && cell.mode() != Some(Mode::Finished);
        let ending = match drawn {
            _ if self.signals.count() > 0 => Ending::Interrupted,
            drawn if goes_on => drawn,
            _ => Ending::Completed,
        };
        let (cause, what) = self.order_end(cell, ending);
        let limit = match ending {
            Ending::Completed => END_LIMIT + Duration::from_secs_f64(seconds * 2.0),
            _ => RETURN_LIMIT,
        };
        let in_time = self.await_end(cell, ending, cause + limit);
        if !in_time && has_ended(out) {
            let report = REPORT_PER_SCAN.saturating_mul(cell.scan().min(1_000_000) as u32);
            self.await_end(cell, ending, cause + limit + report);
        }
        let is_killed = matches!(ending, Ending::LauncherKilled | Ending::LauncherReplaced);
        if cell.status.is_none() {
            let mode = cell.mode().map_or("without a mode", Mode::word);
            let words = format!("{}: the run does not end: {mode}", ending.word());
            self.violated(format!("{words}, scan {}", cell.scan()));
        } else if !is_killed {
            let ms = cause.elapsed().as_secs_f64() * 1e3;
            if ending != Ending::Completed {
                self.tally.returned(what, ms);
            }
            self.judge_end(cell, ending, out);
        }
        self.take_figures(cell);
        if is_killed {
            self.left.killed = Some(cause);
        }
        ending
    }

    /// Does what a run is to end of.
    fn order_end(&mut self, cell: &mut Cell, ending: Ending) -> (Instant, &'static str) {
        let cause = Instant::now();
        if ending != Ending::Completed {
            cell.judge.may_stop();
        }
        match ending {
            Ending::Completed => (cause, "run after its program"),
            Ending::Stopped => {
                if let Some(child) = cell.client(&["stop"]) {
                    let status = self.await_return(cell, "stop", child, cause);
                    let refused = status.is_some_and(|status| !status.success());
                    if refused && cell.mode() != Some(Mode::Finished) {
                        self.violated(format!("stop is refused, scan {}", cell.scan()));
                    }
                }
                (cause, "run after stop")
            }
            Ending::Interrupted => {
                cell.signal_launcher(Signal::TERM);
                (cause, "run after SIGTERM")
            }
            Ending::LauncherKilled | Ending::LauncherReplaced => {
                cell.signal_launcher(Signal::KILL);
                self.kills += 1;
                self.faults += 1;
                (cause, "launcher after SIGKILL")
            }
        }
    }

    /// Whether it ends by then.
    fn await_end(&mut self, cell: &mut Cell, ending: Ending, until: Instant) -> bool {
        let mut interrupted = ending != Ending::Completed;
        while cell.look() && Instant::now() < until {
            if !interrupted {
                cell.operate();
            }
            if self.signals.count() > 0 && !interrupted {
                cell.judge.may_stop();
                cell.signal_launcher(Signal::TERM);
                interrupted = true;
            }
            cell.look_until(Instant::now() + Duration::from_millis(2));
        }
        cell.status.is_some()
    }

    /// Exit status, report, events and feedback agree.
    fn judge_end(&mut self, cell: &mut Cell, ending: Ending, out: &Path) {
        let code = cell.status.and_then(|status| status.code());
        let mut finish = None;
        let events = fs::read_to_string(out.join(EVENTS_FILE)).unwrap_or_default();
        let no_log = is_recorder_given_up(&events);
        if ending == Ending::Completed && self.signals.count() == 0 {
            let how = cell.judge.finish();
            finish = Some(how);
            let right = match how {
                // A recorder that found room again took the end.
                Finish::Done if no_log => code == Some(3) || code == Some(0) && takes_the_end(out),
                Finish::Done => code == Some(0),
                Finish::Starved => code == Some(1) || no_log && code == Some(3),
                Finish::Broken => true,
            };
            if how == Finish::Starved {
                self.starved += 1;
            }
            if !right {
                self.violated(format!("{how:?}: the run ended with {:?}", cell.status));
            }
        }
        let kind = self.judge_report(out);
        let Some(kind) = kind else { return };
        let agree = match code {
            Some(0) => kind == "completed",
            Some(130) => kind == "interrupted",
            Some(1) => kind == "stopped" || kind == "interrupted" && finish.is_none(),
            // The machine came to its end, and its log did not: the disk is full.
            Some(3) => no_log,
            _ => false,
        };
        if !agree {
            let words = format!("{}: the run ended with {code:?}", ending.word());
            self.violated(format!("{words}, its report says {kind}"));
        }
        let mut last = events.lines().filter(|line| line.contains("\"ended\""));
        let last = last.next_back().unwrap_or("nothing").to_string();
        let is_finished = last.contains("the machine is finished");
        if is_finished != (kind == "completed") || last == "nothing" {
            self.violated(format!(
                "{}: the report says {kind}, events.jsonl {last}",
                ending.word()
            ));
        }
    }

    /// What the log says: limits, samples, how it ended.
    fn judge_report(&mut self, out: &Path) -> Option<String> {
        let report = fs::read_to_string(out.join("report.json"))
            .map_err(anyhow::Error::from)
            .and_then(|text| Ok(serde_json::from_str::<Value>(&text)?));
        let report = match report {
            Ok(report) => report,
            Err(error) => {
                self.violated(format!("no report: {}", words(&error)));
                return None;
            }
        };
        for limit in ["velocity", "acceleration", "travel"] {
            let pointer = format!("/limits/{limit}_exceeded");
            match report.pointer(&pointer).and_then(Value::as_u64) {
                Some(0) => {}
                count => self.violated(format!("{limit} limit exceeded in the log: {count:?}")),
            }
        }
        let kind = report.pointer("/outcome/kind").and_then(Value::as_str);
        if kind.is_none() {
            self.violated("the report says nothing of the outcome".into());
        }
        kind.map(str::to_string)
    }

    fn take_figures(&mut self, cell: &mut Cell) {
        for of in std::mem::take(&mut cell.judge.violations).0 {
            self.violated(format!("scan {}: {}", of.scan, of.what));
        }
        let seen = &cell.judge.feedbacks;
        self.judged += seen.judged;
        self.unseen += seen.unseen;
        self.off_path_max = self.off_path_max.max(seen.off_path_increments_max);
        self.status_age_max = self.status_age_max.max(cell.status_age_scans_max);
        self.status_looks += cell.status_looks;
        self.orders.0 += cell.orders.0;
        self.orders.1 += cell.orders.1;
    }

    /// Of a run that has ended no file, process, name or open file is left; after a launcher that was killed, once its members have
    /// left and the next launcher of the name has cleaned up.
    pub(super) fn judge_left(&mut self, ending: Ending, clients_killed: bool) {
        let Ok(place) = CellPaths::new(&self.cell_name) else {
            return;
        };
        // The next run finds everything as it is.
        if ending == Ending::LauncherReplaced && !self.is_over() {
            return;
        }
        if let Some(killed) = self.left.killed.take() {
            self.await_members(killed);
            if let Err(error) = place.own(Duration::ZERO) {
                self.violated(format!("nobody can clean up: {error}"));
            }
        }
        let processes = cell::processes_of(&self.cell_name);
        if !processes.is_empty() {
            self.violated(format!("processes that outlive their run: {processes:?}"));
        }
        let mut files = cell::files_of(&place);
        if !files.is_empty() && clients_killed {
            // Of clients that were killed while the cell ended: whoever takes its name next removes them.
            self.left_by_clients += files.len() as u64;
            drop(place.own(Duration::ZERO));
            files = cell::files_of(&place);
        }
        if !files.is_empty() {
            self.violated(format!("files of the cell after its run: {files:?}"));
        }
        let names = names_held(&self.cell_name);
        if names > 0 {
            self.violated(format!("{names} sockets of the cell after its run"));
        }
        let own = cell::held(std::process::id() as i32)
            .unwrap_or_default()
            .files;
        let first = *self.left.own_files.get_or_insert(own);
        if own > first + OWN_FILES_MAX {
            self.violated(format!(
                "{own} files of the soak are open, {first} at first"
            ));
        }
    }

    /// Waits until the members of a launcher that was killed have left.
    fn await_members(&mut self, killed: Instant) {
        loop {
            let left = cell::processes_of(&self.cell_name);
            if left.is_empty() {
                let ms = killed.elapsed().as_secs_f64() * 1e3;
                self.tally.returned("members after a killed launcher", ms);
                return;
            }
            if killed.elapsed() > RETURN_LIMIT {
                self.violated(format!("{left:?} live on without their launcher"));
                return;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

/// Whether the launcher has noted that the run has ended.
fn has_ended(out: &Path) -> bool {
    let events = fs::read_to_string(out.join(EVENTS_FILE)).unwrap_or_default();
    events.contains("\"event\":\"ended\"")
}

/// Whether the last part of the log goes to the end of the run.
fn takes_the_end(out: &Path) -> bool {
    let report = fs::read_to_string(out.join("report.json")).unwrap_or_default();
    let report: Value = serde_json::from_str(&report).unwrap_or_default();
    let parts = report["parts"].as_array();
    let last = parts.and_then(|parts| parts.last()?["last_scan"].as_u64());
    last.is_some_and(|last| Some(last + 1) == report["scans"].as_u64())
}

/// Whether the recorder has left by itself with the status of an environment that does not allow it, and no other came after it.
fn is_recorder_given_up(events: &str) -> bool {
    let of_recorder = events
        .lines()
        .rev()
        .filter(|line| line.contains("\"monitor\""));
    let mut of_recorder = of_recorder.take(1);
    of_recorder.any(|line| line.contains("ended with status 3"))
}

/// Sockets whose address is the name of a cell of this user's.
fn names_held(cell: &str) -> usize {
    let sockets = fs::read_to_string("/proc/net/unix").unwrap_or_default();
    let (begin, end) = (
        format!("@quadrant/{}/", geteuid().as_raw()),
        format!("/{cell}"),
    );
    let addresses = sockets
        .lines()
        .filter_map(|line| line.split_whitespace().nth(7));
    addresses
        .filter(|address| address.starts_with(&begin) && address.ends_with(&end))
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_recorder_that_gave_up_last_leaves_a_run_without_its_log() {
        let died = r#"{"scan":9,"event":"died","process":"monitor","text":"ended with status 3"}"#;
        let killed = r#"{"scan":9,"event":"died","process":"monitor","text":"killed by signal 9"}"#;
        let back = r#"{"scan":9,"event":"restarted","process":"monitor","pid":3}"#;
        let ended = r#"{"scan":9,"event":"ended","text":"the machine is finished in scan 9"}"#;
        for (lines, given_up) in [
            ([died, ended].as_slice(), true),
            (&[died, back, ended], false),
            (&[killed, ended], false),
            (&[back, died, ended], true),
        ] {
            assert_eq!(
                is_recorder_given_up(&lines.join("\n")),
                given_up,
                "{lines:?}"
            );
        }
    }
}
