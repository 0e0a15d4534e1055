//! User M-codes: programs of the machine builder, through the real processes.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use bus::sample::ProgramState;

use crate::support::{
    Bench, LiveCell, Run, is_alive, quadrant, run, run_with, text, traces_of, wait_until_gone,
};
use crate::up::{ask, down, obeyed};

const PROGRAM: &str = "G21 G90 G94\nG1 X10 F6000\nM101 P2.5 Q-1.25\nG1 X0\nM102\nO1 repeat [3]\nM101 P[#1]\n#1=[#1+1]\nG1 X5\nX0\nO1 endrepeat\nM2\n";
const SAID: &str = "M101 2.500000 -1.250000\nM102 -1.000000 -1.000000\nM101 0.000000 -1.000000\n\
    M101 1.000000 -1.000000\nM101 2.000000 -1.000000\n";

/// A machine whose M101 and M102 write what they were given into a file; M103 fails, M104 takes too long and starts another process, M105 is
/// no program.
fn machine(more: &[(&str, &str)]) -> (Bench, PathBuf) {
    let mut edits = vec![(
        "[scan]\n",
        "[program]\nuser_codes = \"codes\"\nuser_code_patience_s = 0.5\n\n[scan]\n",
    )];
    edits.extend(more);
    let bench = Bench::patient("xy", &edits);
    let folder = bench.path().join("codes");
    fs::create_dir(&folder).expect("a folder");
    let said = bench.path().join("said");
    let at = said.display();
    for (name, script, mode) in [
        ("M101", format!("echo M101 $* >> {at}"), 0o755),
        ("M102", format!("sleep 0.1; echo M102 $* >> {at}"), 0o755),
        ("M103", "echo it is jammed >&2; exit 3".into(), 0o755),
        (
            "M104",
            format!("sleep 600 & echo $! $$ > {at}; wait"),
            0o755,
        ),
        ("M105", String::new(), 0o644),
        ("M107", format!("sleep 600 & echo $! > {at}"), 0o755),
        (
            "M108",
            format!(
                "ls /proc/self/fd | wc -l > {at}; setsid -f sh -c 'echo $$ >> {at}; exec sleep 600'; sleep 0.2"
            ),
            0o755,
        ),
        ("M106", format!("echo $$ > {at}; exec sleep 600"), 0o755),
    ] {
        let file = folder.join(name);
        fs::write(&file, format!("#!/bin/sh\n{script}\n")).expect("written");
        fs::set_permissions(&file, fs::Permissions::from_mode(mode)).expect("a mode");
    }
    (bench, said)
}

fn said(file: &Path) -> String {
    fs::read_to_string(file).unwrap_or_default()
}

fn completed(run: &Run) -> serde_json::Value {
    let report = run.good_report();
    assert_eq!(text(&report, "/outcome/kind"), "completed");
    report
}

#[test]
fn they_run_at_rest_in_the_order_of_the_program_with_their_values() {
    let (bench, file) = machine(&[]);
    let program = bench.file("codes.ngc", PROGRAM);
    let first = completed(&run(bench.path(), &program));
    assert_eq!(said(&file), SAID);
    // They take no time of the machine in lockstep: the run is the same every time.
    let second = completed(&run(bench.path(), &program));
    assert_eq!(first["digest"], second["digest"]);
    let _ = fs::remove_file(&file);
    completed(&LiveCell::start(bench.path(), &program, "realtime").finish());
    assert_eq!(said(&file), SAID, "in real time");
}

#[test]
fn whoever_is_killed_none_runs_twice_and_none_is_left_out() {
    let (bench, file) = machine(&[]);
    let program = bench.file("codes.ngc", PROGRAM);
    let undisturbed = completed(&run(bench.path(), &program));
    let scans = undisturbed["scans"].as_u64().expect("a number");
    for index in 0..10 {
        let _ = fs::remove_file(&file);
        let (scan, who) = (
            scans * (index + 1) / 12,
            ["planner", "servo-X"][index as usize % 2],
        );
        let faults = bench.file(
            "faults.toml",
            &format!("[restart]\nservo = \"resume\"\n[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{who}\"\ndo = \"kill\"\n"),
        );
        let faults = faults.display().to_string();
        let run = run_with(bench.path(), &program, &["--faults", &faults]);
        completed(&run);
        assert_eq!(said(&file), SAID, "{who} killed in {scan}");
    }
}

#[test]
fn one_that_fails_or_takes_too_long_stops_the_run_with_the_reason_and_leaves_nobody() {
    let (bench, file) = machine(&[]);
    for (code, why) in [
        ("M103", "line 2: M103 ended with status 3"),
        (
            "M104",
            "line 2: M104 has not ended within 0.5 s, and was ended",
        ),
    ] {
        for pace in ["lockstep", "realtime"] {
            let program = bench.file(
                "bad.ngc",
                &format!("G21 G90 G1 X5 F3000\n{code}\nG1 X9\nM2\n"),
            );
            let run = LiveCell::start(bench.path(), &program, pace).finish();
            assert_eq!(run.status(), 1, "{}", run.stderr());
            assert!(run.stderr().contains(why), "{pace}: {}", run.stderr());
            assert_eq!(traces_of(&run.cell), [] as [String; 0]);
        }
    }
    assert!(
        said(&file).split_whitespace().count() == 2,
        "{}",
        said(&file)
    );
    for pid in said(&file).split_whitespace() {
        let pid = pid.parse().expect("a process id");
        assert!(!is_alive(pid), "{pid} still runs");
    }
}

#[test]
fn what_one_leaves_running_ends_with_it() {
    let (bench, file) = machine(&[]);
    let program = bench.file("left.ngc", "G21 G90 G1 X5 F3000\nM107\nG1 X0\nM2\n");
    completed(&run(bench.path(), &program));
    let pid = said(&file).trim().parse().expect("a process id");
    assert!(!is_alive(pid), "{pid} still runs");
}

#[test]
fn what_has_left_its_session_ends_with_it_too_and_nothing_of_the_cell_is_open_in_it() {
    let (bench, file) = machine(&[]);
    let program = bench.file("left.ngc", "G21 G90 G1 X5 F3000\nM108\nG1 X0\nM2\n");
    completed(&run(bench.path(), &program));
    let said = said(&file);
    let mut lines = said
        .lines()
        .map(|line| line.trim().parse::<i32>().expect("a number"));
    // Its standard streams, and the folder that `ls` reads.
    assert_eq!(lines.next(), Some(4), "{said}");
    let pid = lines.next().expect("it has begun");
    assert!(!is_alive(pid), "{pid} still runs");
}

#[test]
fn one_that_runs_when_the_launcher_dies_dies_too() {
    let (bench, file) = machine(&[("patience_s = 0.5", "patience_s = 300.0")]);
    let program = bench.file("long.ngc", "G21 G90 G1 X5 F3000\nM106\nM2\n");
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    let pid = loop {
        if let Ok(pid) = said(&file).trim().parse() {
            break pid;
        }
        assert!(
            matches!(cell.child.try_wait(), Ok(None)),
            "the run has ended"
        );
        std::thread::sleep(Duration::from_millis(5));
    };
    let mut children = cell.children();
    children.push((pid, "M106".into()));
    cell.signal_launcher(libc::SIGKILL);
    wait_until_gone(&children);
    let run = cell.finish();
    let cleaned = quadrant().args(["clean", &run.cell]).status();
    assert!(cleaned.expect("clean").success());
    assert_eq!(traces_of(&run.cell), [] as [String; 0]);
}

#[test]
fn one_without_a_program_is_refused_before_anything_moves_and_so_are_all_where_they_are_not_switched_on()
 {
    let (bench, _) = machine(&[]);
    let program = bench.file("none.ngc", "G21 G90 G1 X5 F3000\nM105\nM2\n");
    for command in ["check", "run"] {
        let mut quadrant = quadrant();
        let refused = quadrant
            .arg(command)
            .arg(bench.path())
            .arg(&program)
            .output()
            .expect("quadrant");
        let words = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{words}");
        assert!(
            words.contains("none.ngc:2: M105 has no program: "),
            "{words}"
        );
    }
    let other = Bench::of("xy", &[]);
    let refused = run(other.path(), &program);
    assert_eq!(refused.status(), 2);
    assert!(
        refused.stderr().contains("[program] user_codes"),
        "{}",
        refused.stderr()
    );
}

#[test]
fn in_a_cell_that_stays_up_each_start_runs_them_again() {
    let (bench, file) = machine(&[]);
    let mut cell = LiveCell::up(bench.path(), "realtime");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    let program = bench.file("one.ngc", "G21 G90 G1 X1 F3000\nM101 P7\nG1 X0\nM2\n");
    obeyed(&cell, &["load", &program.display().to_string()]);
    for _ in 0..2 {
        obeyed(&cell, &["start", "--wait"]);
    }
    assert_eq!(said(&file), "M101 7.000000 -1.000000\n".repeat(2));
    let wrong = bench.file("wrong.ngc", "M105\nM2\n").display().to_string();
    let printed = ask(&cell, &["load", &wrong]);
    assert!(
        printed.status == 2 && printed.text.contains("M105 has no program"),
        "{}",
        printed.text
    );
    down(cell);
}

#[test]
fn why_a_program_cannot_go_on_is_said_once_and_everywhere_and_reset_begins_it_anew() {
    let (bench, _) = machine(&[]);
    let mut cell = LiveCell::up(bench.path(), "realtime");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    let program = bench.file("bad.ngc", "G21 G90 G1 X5 F3000\nM103\nG1 X9\nM2\n");
    obeyed(&cell, &["load", &program.display().to_string()]);
    let why = "planner cannot go on, line 2: M103 ended with status 3";
    for run in 1..=2_u32 {
        let started = ask(&cell, &["start", "--wait"]);
        assert_eq!(started.status, 1, "{}", started.text);
        assert!(started.text.contains(why), "{}", started.text);
        let status = ask(&cell, &["status"]).text;
        assert!(
            status.contains("line 2: M103 ended with status 3"),
            "{status}"
        );
        assert!(status.contains("`quadrant reset`"), "{status}");
        let answer = obeyed(&cell, &["reset"]);
        assert!(answer.contains("`start` begins what is loaded"), "{answer}");
        // It stays so, whatever the planner has said of the run before.
        let scan = cell.wait_for(|_| true).scan;
        let now = cell.wait_for(|feedback| feedback.scan > scan + 100);
        assert_eq!(
            (now.program, now.cause, now.run),
            (ProgramState::Loaded as u32, 0, run)
        );
    }
    let out = cell.out.clone();
    let ended = down(cell);
    for run in 1..=2 {
        let file = out.join(format!("00{run}-bad/report.json"));
        let report = fs::read_to_string(&file).expect("a report");
        let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
        assert_eq!(text(&report, "/outcome/reason"), why);
        assert_eq!(report["messages"].as_array().map(Vec::len), Some(1));
    }
    let printed = ended.stderr();
    let said = printed.matches("ERROR planner: line 2: M103 ended with status 3");
    assert_eq!(said.count(), 2, "{printed}");
}
