//! How a run of a cell ended: the master says it, and its folder, report, events and the list of runs say the same, also where no
//! recorder lived to see it.

use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};

use bus::sample::{Mode, ProgramState};
use serde_json::Value;

use crate::support::{Bench, number, quadrant, send, text};
use crate::up::{down, is, obeyed, up, up_on};

fn json_in(file: &Path) -> Value {
    let read = fs::read_to_string(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    serde_json::from_str(&read).expect("JSON")
}

/// How the run in this folder of a cell ended, as everything says that speaks of it: its outcome and its last scan.
pub(crate) fn agreed(cell: &Path, name: &str) -> (String, u64) {
    let folder = cell.join(name);
    let ended = json_in(&folder.join("ended.json"));
    let outcome = ended["outcome"].as_str().expect("an outcome");
    let scan = ended["scan"].as_u64().expect("a scan");
    let report = json_in(&folder.join("report.json"));
    assert_eq!(text(&report, "/outcome/kind"), outcome, "{name}");
    let parts = report["parts"].as_array().expect("parts");
    let reached = parts.iter().filter_map(|part| part["last_scan"].as_u64());
    let missing = report["missing_scans"].as_array().expect("missing scans");
    let lacks = missing
        .last()
        .map_or(0, |gap| gap["last"].as_u64().unwrap());
    assert_eq!(reached.max().unwrap_or(0).max(lacks), scan, "{name}");
    let events = fs::read_to_string(cell.join("events.jsonl")).expect("events");
    let events = events
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"));
    let said = events.filter(|event: &Value| event["event"] == "run ended");
    let of_run = |event: &Value| {
        let said = event["text"].as_str().expect("a text").to_owned();
        let said = said
            .trim_start_matches("run ")
            .split(':')
            .next()
            .map(str::parse);
        said == Some(Ok(ended["run"].as_u64().expect("a run")))
    };
    let said: Vec<Value> = said.filter(of_run).collect();
    assert_eq!(said.len(), 1, "{name}: {said:?}");
    assert_eq!(
        (said[0]["outcome"].as_str(), &said[0]["scan"]),
        (Some(outcome), &ended["scan"])
    );
    let listed = quadrant().arg("runs").arg(cell).arg("--json").output();
    let listed: Value = serde_json::from_slice(&listed.expect("runs").stdout).expect("JSON");
    let mut listed = listed["runs"].as_array().expect("a list").iter();
    let it = |run: &&Value| run["run"].as_str().is_some_and(|run| run.ends_with(name));
    assert_eq!(listed.find(it).expect("the run")["outcome"], outcome);
    (outcome.to_owned(), scan)
}

#[test]
fn a_run_whose_recorder_died_ended_as_the_master_says_and_lacks_what_it_lacks() {
    let edit = ("[scan]\n", "[restart]\nrestarts_max = 1\n\n[scan]\n");
    for pace in ["lockstep", "realtime"] {
        let (_bench, mut cell, short, _) = up_on(Bench::patient("xy", &[edit]), pace);
        obeyed(&cell, &["enable"]);
        obeyed(&cell, &["load", &short]);
        obeyed(&cell, &["hold"]);
        obeyed(&cell, &["start"]);
        // The second one is the last.
        for log in ["run.mcap", "run-2.mcap"] {
            let log = cell.out.join("001-short").join(log);
            // What is not on the disk is lost, but something is there.
            let bytes = || fs::metadata(&log).map_or(0, |file| file.len());
            cell.wait_for(|_| bytes() > 0);
            let begun = bytes();
            cell.wait_for(|_| bytes() > begun);
            send(cell.pid_of("quadrant recorder"), libc::SIGKILL);
        }
        obeyed(&cell, &["resume"]);
        cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Done));
        let run = down(cell);
        let (outcome, scan) = agreed(&run.out, "001-short");
        assert_eq!(outcome, "completed", "{pace}");
        let report = json_in(&run.out.join("001-short/report.json"));
        let last = report["parts"][0]["last_scan"].as_u64();
        assert!(last < Some(scan), "{pace}: nothing is missing: {last:?}");
        assert!(number(&report, "/samples_lost") > 0.0);
    }
}

#[test]
fn who_gave_a_program_up_stands_in_its_report_in_the_events_and_in_what_waits_for_it() {
    let (_bench, mut cell, short, long) = up("lockstep");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    let mut waits = quadrant();
    waits.args(["start", "--wait", "--cell", &cell.cell]);
    let waits = waits.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 5.0);
    obeyed(&cell, &["hold"]);
    cell.wait_for(|f| f.hold == 1 && f.rested == 1);
    obeyed(&cell, &["reset"]);
    let said = waits
        .and_then(Child::wait_with_output)
        .expect("start --wait");
    let words = String::from_utf8_lossy(&said.stderr);
    assert_eq!(said.status.code(), Some(1), "{words}");
    assert!(
        words.contains("given up: ended by the order reset"),
        "{words}"
    );
    let status = obeyed(&cell, &["status"]);
    assert!(
        status.contains("run 1 interrupted: ended by the order reset"),
        "{status}"
    );
    let status = obeyed(&cell, &["status", "--json"]);
    let status: Value = serde_json::from_str(&status).expect("JSON");
    assert_eq!(status["program"]["last_run"]["outcome"], "interrupted");
    // Several that are over before the launcher looks again.
    for _ in 0..3 {
        obeyed(&cell, &["mdi", "G91 G1 X0.1 F6000"]);
    }
    obeyed(&cell, &["load", &short]);
    obeyed(&cell, &["start", "--wait"]);
    cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Done));
    let run = down(cell);
    let (outcome, _) = agreed(&run.out, "001-long");
    assert_eq!(outcome, "interrupted");
    let report = json_in(&run.out.join("001-long/report.json"));
    assert_eq!(text(&report, "/outcome/reason"), "ended by the order reset");
    let folders = fs::read_dir(&run.out).expect("the folder").flatten();
    let runs = folders.filter(|of| of.path().join("run.mcap").exists());
    let mut completed = 0;
    for folder in runs {
        let ended = json_in(&folder.path().join("ended.json"));
        completed += u32::from(ended["outcome"] == "completed");
    }
    assert_eq!(completed, 4);
}

#[test]
fn who_waits_for_a_program_is_told_that_a_part_of_its_log_is_missing() {
    let (_bench, mut cell, short, _) = up("realtime");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &short]);
    obeyed(&cell, &["override", "10%"]);
    let mut waits = quadrant();
    waits.args(["start", "--wait", "--cell", &cell.cell]);
    let waits = waits.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    cell.wait_for(|f| f.tag.element >= 1);
    let recorder = cell.pid_of("quadrant recorder");
    // What it has not read is lost with it.
    send(recorder, libc::SIGSTOP);
    let stopped = cell.wait_for(|_| true);
    cell.wait_for_scan(stopped.scan + 200);
    send(recorder, libc::SIGKILL);
    cell.wait_for_another("quadrant recorder", recorder);
    obeyed(&cell, &["override", "100%"]);
    let said = waits
        .and_then(Child::wait_with_output)
        .expect("start --wait");
    let words = String::from_utf8_lossy(&said.stderr);
    assert_eq!(said.status.code(), Some(3), "{words}");
    assert!(
        words.contains("run 1 is done, but is not all in its log"),
        "{words}"
    );
    let run = down(cell);
    assert_eq!(agreed(&run.out, "001-short").0, "completed");
}

/// The order to end is lost with the master that had it; the one that takes its place gets it too, and nobody has interrupted anything.
#[test]
fn a_cell_whose_master_dies_with_the_order_to_end_is_ended_by_the_next_one() {
    let (_bench, mut cell, _, long) = up("realtime");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|now| now.window.sequence > 4);
    let master = cell.pid_of("quadrant plant-sim");
    send(master, libc::SIGSTOP);
    let mut down = quadrant();
    down.args(["down", "--cell", &cell.cell]);
    let mut down = down.spawn().expect("down");
    // It asks meanwhile, or asks the next one.
    std::thread::sleep(std::time::Duration::from_millis(150));
    send(master, libc::SIGKILL);
    assert_eq!(down.wait().expect("down").code(), Some(0));
    let run = cell.finish();
    let events = std::fs::read_to_string(run.out.join("events.jsonl")).expect("events");
    assert!(!events.contains("interrupted"), "{events}");
    assert_ne!(run.status(), 130, "{}", run.stderr());
}
