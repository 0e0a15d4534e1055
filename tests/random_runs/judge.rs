//! What must hold once a run has ended: what was said agrees, and nothing is left.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use bus::sample::{EndedRun, Mode, RunOutcome};
use serde_json::Value;

use super::trial::Trial;
use crate::support::{quadrant, traces_of};

/// A line of `events.jsonl`.
struct Event {
    name: String,
    process: String,
    pid: i64,
    text: String,
    outcome: String,
    scan: u64,
}

fn events_in(out: &Path) -> Vec<Event> {
    let text = fs::read_to_string(out.join("events.jsonl")).unwrap_or_default();
    let lines = text.lines().filter_map(|line| {
        let value: Value = serde_json::from_str(line).ok()?;
        let word = |key: &str| value[key].as_str().unwrap_or_default().to_string();
        Some(Event {
            name: word("event"),
            process: word("process"),
            pid: value["pid"].as_i64().unwrap_or(-1),
            text: word("text"),
            outcome: word("outcome"),
            scan: value["scan"].as_u64().unwrap_or(0),
        })
    });
    lines.collect()
}

fn json_in(file: &Path) -> Option<Value> {
    serde_json::from_str(&fs::read_to_string(file).ok()?).ok()
}

/// Processes that name the cell.
fn processes_of(cell: &str) -> Vec<String> {
    let mut found = Vec::new();
    for entry in fs::read_dir("/proc").expect("/proc").flatten() {
        let line = fs::read(entry.path().join("cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&line).replace('\0', " ");
        if line.contains(&format!("--cell {cell} ")) {
            found.push(format!("{:?} {line}", entry.file_name()));
        }
    }
    found
}

/// Sockets whose address is the cell's.
fn sockets_of(cell: &str) -> usize {
    let sockets = fs::read_to_string("/proc/net/unix").unwrap_or_default();
    let end = format!("/{cell}");
    sockets.lines().filter(|line| line.ends_with(&end)).count()
}

impl Trial {
    fn expect(&mut self, holds: bool, text: &str) {
        if !holds {
            self.violated(text);
        }
    }

    /// Each has a status that it may have, and what a status shows was so.
    pub(super) fn judge_clients(&mut self) {
        for index in 0..self.clients.len() {
            let client = &self.clients[index];
            let (words, (out, err)) = (client.words.join(" "), client.said());
            let code = client.status.and_then(|status| status.code());
            let scans = client.scans;
            let (is_status, returned) = (client.is("status"), client.returned.is_some());
            if !returned {
                continue;
            }
            // That a cell ends while somebody looks is no fault of what this PC allows.
            self.expect(
                matches!(code, Some(0 | 1)) && !err.contains("panicked"),
                &format!("{words} ended with {code:?}: {err}"),
            );
            self.expect(
                (code == Some(0)) != out.trim().is_empty(),
                &format!("{words} ended with {code:?} and printed {out:?} {err}"),
            );
            if is_status && code == Some(0) {
                self.judge_status(&words, &out, scans);
            }
        }
    }

    fn judge_status(&mut self, words: &str, out: &str, (before, after): (u64, u64)) {
        let Ok(shown) = serde_json::from_str::<Value>(out) else {
            return self.violated(&format!("{words}: no JSON: {out}"));
        };
        let Some(scan) = shown["scan"].as_u64() else {
            return self.violated(&format!("{words}: no scan"));
        };
        let Some(eyes) = &self.eyes else { return };
        let (seen, mode) = (eyes.scan(), eyes.mode_at(scan).map(Mode::word));
        let shown = shown["mode"].as_str().map(str::to_string);
        // What is seen here may lag behind.
        self.expect(
            scan >= before && (scan <= seen || scan <= after + 1000),
            &format!("{words} shows scan {scan}, asked in {before}, answered in {after}"),
        );
        self.expect(
            mode.is_none() || mode == shown.as_deref(),
            &format!("{words} shows {shown:?} in scan {scan}, it was {mode:?}"),
        );
    }

    /// Nothing of it is left.
    fn judge_left(&mut self) {
        let cell = self.live.cell.clone();
        let (processes, files) = (processes_of(&cell), traces_of(&cell));
        self.expect(processes.is_empty(), &format!("left: {processes:?}"));
        self.expect(files.is_empty(), &format!("left: {files:?}"));
        let sockets = sockets_of(&cell);
        self.expect(sockets == 0, &format!("left: {sockets} sockets"));
    }

    /// Its members leave, the next one cleans up, and a report can be made of what it had.
    pub(super) fn judge_killed_launcher(&mut self) {
        let cell = self.live.cell.clone();
        let since = self.launcher_killed.unwrap_or_else(Instant::now);
        while !processes_of(&cell).is_empty() {
            if self.is_overdue(since) {
                let left = processes_of(&cell);
                self.violated(&format!("live on without their launcher: {left:?}"));
                return;
            }
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        self.returned("members after SIGKILL", since);
        let saw_scans = self.eyes.as_ref().is_some_and(|e| e.scan() > 10);
        self.eyes = None;
        let cleaned = quadrant().args(["clean", &cell]).output().expect("clean");
        let said = String::from_utf8_lossy(&cleaned.stderr).into_owned();
        self.expect(cleaned.status.success(), &format!("clean: {said}"));
        self.judge_left();
        if saw_scans && !self.draw.stays && !self.recorder_was_hit {
            let made = quadrant().arg("report").arg(&self.live.out).output();
            let made = made.expect("report");
            let said = String::from_utf8_lossy(&made.stderr).into_owned();
            self.expect(made.status.success(), &format!("report: {said}"));
        }
    }

    /// Exit status, report, events and feedback agree.
    pub(super) fn judge_end(&mut self) {
        let last = self.eyes.as_ref().and_then(|eyes| eyes.newest);
        let over = self.eyes.as_ref().is_some_and(|eyes| eyes.is_over());
        // An observer's files are its own.
        let told = self.eyes.take().map_or_else(Vec::new, |eyes| eyes.ended);
        self.judge_left();
        let code = self.ended.and_then(|status| status.code());
        let events = events_in(&self.live.out);
        let is_up = events.iter().any(|event| event.name == "started");
        let text = format!("the run ended with {code:?}");
        // In its first moments a process is as every other: a signal ends it.
        if self.signals > 0 && code.is_none() && events.is_empty() && last.is_none() {
            return;
        }
        self.expect(
            matches!(code, Some(0 | 1 | 3 | 130)),
            &format!("{text}: {:?}", self.ended),
        );
        self.expect(code != Some(130) || self.signals > 0, &text);
        self.expect(code != Some(0) || self.signals < 2, &text);
        if !is_up {
            // Before the cell was up: interrupted, or somebody had died.
            let by_death = code == Some(3) && !self.killed.is_empty();
            let explained = by_death || (code == Some(130) && self.signals > 0);
            self.expect(explained, &format!("{text} before it was up"));
            return;
        }
        // Twice interrupted: nothing is waited for.
        if self.signals > 1 {
            return;
        }
        self.expect(code != Some(3) || last.is_none(), &text);
        self.judge_deaths(&events);
        self.judge_endings(&events, &told);
        if self.draw.stays {
            self.judge_session(code, &events);
        } else {
            self.judge_run(code, &events, last.filter(|_| over));
        }
    }

    /// How each run ended: what the master has said stands in its folder, its report, the events and the list of runs.
    fn judge_endings(&mut self, events: &[Event], told: &[EndedRun]) {
        let out = self.live.out.clone();
        let mut folders = vec![(1, out.clone())];
        if self.draw.stays {
            let inner = fs::read_dir(&out).into_iter().flatten().flatten();
            let run = |folder: PathBuf| Some((monitor::run_number(&folder)?, folder));
            folders = inner.filter_map(|entry| run(entry.path())).collect();
        }
        let listed = quadrant().arg("runs").arg(&out).arg("--json").output();
        let listed = listed.map_or_else(|_| Vec::new(), |listed| listed.stdout);
        let listed: Value = serde_json::from_slice(&listed).unwrap_or_default();
        for (run, folder) in folders {
            let shown = folder.display().to_string();
            let Some(ended) = json_in(&folder.join("ended.json")) else {
                self.violated(&format!("{shown}: nobody says how it ended"));
                continue;
            };
            let outcome = ended["outcome"].as_str().unwrap_or("nothing");
            let scan = ended["scan"].as_u64().unwrap_or(0);
            if let Some(told) = told.iter().find(|told| told.run == run) {
                let word = RunOutcome::from_wire(told.outcome).map_or("nothing", RunOutcome::word);
                self.expect(
                    (word, told.scan) == (outcome, scan),
                    &format!("{shown} says {ended}, the master {told:?}"),
                );
            }
            if let Some(report) = json_in(&folder.join("report.json")) {
                let kind = report.pointer("/outcome/kind").and_then(Value::as_str);
                let scans = |list: &str, key: &str| {
                    let all = report[list].as_array().into_iter().flatten();
                    all.filter_map(|of| of[key].as_u64()).max().unwrap_or(0)
                };
                let reached = scans("parts", "last_scan").max(scans("missing_scans", "last"));
                self.expect(
                    kind == Some(outcome) && reached == scan,
                    &format!("{shown} says {ended}, its report {kind:?} up to scan {reached}"),
                );
            }
            let of_run = |event: &&Event| match self.draw.stays {
                true => event.name == "run ended" && event.text.starts_with(&format!("run {run}")),
                false => event.name == "ended",
            };
            // Two that end between two looks of the launcher are one to it.
            if let Some(said) = events.iter().find(of_run) {
                self.expect(
                    (said.outcome.as_str(), said.scan) == (outcome, scan),
                    &format!(
                        "{shown} says {ended}, events {} {}",
                        said.outcome, said.scan
                    ),
                );
            }
            let mut list = listed["runs"].as_array().into_iter().flatten();
            let it = |of: &&Value| of["run"].as_str().is_some_and(|of| of.ends_with(&shown));
            let known = list.find(it).map(|run| run["outcome"].clone());
            self.expect(
                known.is_none_or(|known| known == outcome),
                &format!("{shown} says {ended}, the list of runs otherwise"),
            );
        }
    }

    /// Who was killed while the run went on has died, says the launcher.
    fn judge_deaths(&mut self, events: &[Event]) {
        let name_of = |pid: i32| {
            let mut of = events.iter().filter(|e| e.pid == i64::from(pid));
            of.next_back().map(|event| event.process.clone())
        };
        let names: Vec<(String, String)> = self
            .killed
            .iter()
            .filter(|killed| killed.amid)
            .filter_map(|killed| Some((name_of(killed.pid)?, killed.line.clone())))
            .collect();
        for (name, line) in &names {
            let said = |e: &&Event| e.name == "died" && e.process == *name;
            let deaths = events.iter().filter(said).count();
            let kills = names.iter().filter(|(other, _)| other == name).count();
            self.expect(
                deaths >= kills,
                &format!("{name} was killed {kills} times and died {deaths} times: {line}"),
            );
        }
    }

    fn judge_run(
        &mut self,
        code: Option<i32>,
        events: &[Event],
        last: Option<bus::sample::Feedback>,
    ) {
        let Some(report) = json_in(&self.live.out.join("report.json")) else {
            // A recorder that was killed before its first scan has left nothing to report on.
            let excused = self.recorder_was_hit || code == Some(3);
            return self.expect(excused, "there is no report");
        };
        let kind = report.pointer("/outcome/kind").and_then(Value::as_str);
        let kind = kind.unwrap_or("nothing").to_string();
        let died = events.iter().any(|event| event.name == "died");
        let tripped = events.iter().any(|event| event.name == "trip");
        let stopped = self
            .clients
            .iter()
            .any(|c| c.is_accepted() && ["stop", "down", "disable"].iter().any(|word| c.is(word)));
        let agree = match code {
            Some(0) => kind == "completed",
            Some(130) => self.signals > 0 && kind == "interrupted",
            // Who died when all was done is a loss all the same.
            Some(1) if kind == "completed" => died,
            Some(1) => {
                let cause = died || tripped || stopped || self.signals > 0;
                cause && (kind == "stopped" || kind == "interrupted")
            }
            _ => false,
        };
        self.expect(
            agree,
            &format!(
                "the run ended with {code:?}, its report says {}",
                report["outcome"]
            ),
        );
        // A log whose recorder was not replaced ends there.
        if self.draw.monitor == "leave" && self.killed.iter().any(|k| k.is("recorder")) {
            return;
        }
        let said = events.iter().rev().find(|event| event.name == "ended");
        let said = said.map_or("nothing", |event| &event.text).to_string();
        self.expect(
            said.contains("the machine is finished") == (kind == "completed"),
            &format!("the report says {kind}, events.jsonl {said:?}"),
        );
        if let Some(last) = last {
            let finished = last.mode == Mode::Finished as u32;
            self.expect(
                finished == (kind == "completed"),
                &format!(
                    "the report says {kind}, the last feedback mode {}",
                    last.mode
                ),
            );
            if !self.recorder_was_hit {
                // Who is killed over a sample has told it to one and not to the other.
                let most = self.killed.len() as u64;
                let lost = report["samples_lost"].as_u64();
                self.expect(
                    lost.is_some_and(|lost| lost <= most),
                    &format!("samples lost: {lost:?}"),
                );
                self.judge_length(&report, last.scan);
            }
        }
    }

    /// In lockstep every scan is there, unless a master began later than its predecessor ended.
    fn judge_length(&mut self, report: &Value, last: u64) {
        let master_was_hit = self.killed.iter().any(|k| k.is("plant-sim"));
        if self.draw.pace == "lockstep" && !master_was_hit {
            let scans = report["scans"].as_u64();
            self.expect(
                scans == Some(last + 1),
                &format!("the last scan was {last}, the report has {scans:?}"),
            );
        }
    }

    fn launcher_was_stopped(&self) -> bool {
        let words = ["stop launcher", "stop all"];
        words
            .iter()
            .any(|word| self.figures.done.contains_key(*word))
    }

    fn judge_session(&mut self, code: Option<i32>, events: &[Event]) {
        let down = self.clients.iter().any(|c| c.is("down"));
        let died = events.iter().any(|event| event.name == "died");
        let agree = match code {
            // A signal to a launcher that was stopped may come when all is over.
            Some(0) => down && (self.signals == 0 || self.launcher_was_stopped()),
            Some(130) => self.signals > 0,
            Some(1) => died || self.signals > 0,
            _ => false,
        };
        self.expect(agree, &format!("the cell ended with {code:?}"));
        let count = |name: &str| events.iter().filter(|e| e.name == name).count();
        let (begun, over) = (count("run begins"), count("run over"));
        if code == Some(0) && !self.recorder_was_hit {
            self.expect(
                begun == over,
                &format!("{begun} runs have begun, {over} are over"),
            );
        }
        // One whose recorder died before it had written anything has no report.
        let is_reported =
            |event: &&Event| event.name == "run over" && !event.text.contains("has left no log");
        for event in events.iter().filter(is_reported) {
            let (folder, said) = event.text.split_once(": ").unwrap_or_default();
            let report = json_in(&Path::new(folder).join("report.json")).unwrap_or_default();
            let kind = report.pointer("/outcome/kind").and_then(Value::as_str);
            self.expect(
                kind.is_some_and(|kind| said.starts_with(kind)),
                &format!("events.jsonl says {said}, the report of {folder} {kind:?}"),
            );
        }
    }
}
