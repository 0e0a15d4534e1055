//! What is kept of runs: all of it, what the machine file says, or what `--log` says; and what is never removed.

use std::fs;
use std::path::Path;
use std::process::Output;

use crate::support::{Bench, LiveCell, circle_program, quadrant, traces_of, unique_cell};
use crate::up::{ask, obeyed};

const PROGRAM: &str = "G21 G90\nG1 X10 F6000\nM2\n";

fn words(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A run in the folder of a machine, its run directory below `runs/`.
fn run_there(bench: &Bench, more: &[&str]) -> Output {
    bench.file("part.ngc", PROGRAM);
    let cell = unique_cell();
    let output = quadrant()
        .current_dir(bench.path())
        .args([
            "run", ".", "part.ngc", "--pace", "lockstep", "--cell", &cell,
        ])
        .args(more)
        .output()
        .expect("a run");
    assert!(traces_of(&cell).is_empty(), "{:?}", traces_of(&cell));
    output
}

/// A run directory of long ago with a log of so many MB.
fn old_run(bench: &Bench, name: &str, machine: &str, mb: u64) {
    let folder = bench.path().join("runs").join(name);
    fs::create_dir_all(&folder).expect("a folder");
    let text = fs::read_to_string(bench.path().join("machine.toml")).expect("a machine");
    let text = text.replacen("name = \"xy\"", &format!("name = {machine:?}"), 1);
    fs::write(folder.join("machine.toml"), text).expect("a machine");
    let log = fs::File::create(folder.join("run.mcap")).expect("a log");
    log.set_len(mb * 1_000_000).expect("a size");
}

fn runs(bench: &Bench) -> Vec<String> {
    let entries = fs::read_dir(bench.path().join("runs"))
        .expect("runs")
        .flatten();
    let mut names: Vec<String> = entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn runs_above_what_is_kept_go_the_oldest_first_and_nothing_of_others() {
    let bench = Bench::of("xy", &[("[scan]\n", "[log]\nkeep_mb = 10\n\n[scan]\n")]);
    old_run(&bench, "xy-part-20200101-000000", "xy", 6);
    std::thread::sleep(std::time::Duration::from_millis(20));
    old_run(&bench, "xy-part-20200101-000001", "xy", 6);
    old_run(&bench, "xy-part-20200101-000002-2", "mill", 60);
    old_run(&bench, "first-article", "xy", 60);
    let done = run_there(&bench, &[]);
    assert_eq!(done.status.code(), Some(0), "{}", words(&done));
    let now = runs(&bench);
    let kept = |name: &str| now.iter().any(|of| of == name);
    assert!(!kept("xy-part-20200101-000000"), "{now:?}");
    assert!(kept("xy-part-20200101-000001"), "{now:?}");
    assert!(
        kept("xy-part-20200101-000002-2"),
        "another machine's: {now:?}"
    );
    assert!(kept("first-article"), "named by somebody: {now:?}");
    assert_eq!(now.len(), 4, "{now:?}");
    let said = words(&done);
    assert!(
        said.contains("removed runs/xy-part-20200101-000000 (6.0 MB)")
            && said.contains("keep_mb = 10"),
        "{said}"
    );
}

#[test]
fn runs_that_are_too_old_go_and_the_one_that_runs_stays() {
    let bench = Bench::of(
        "xy",
        &[("[scan]\n", "[log]\nkeep_days = 0.0000001\n\n[scan]\n")],
    );
    for _ in 0..2 {
        let done = run_there(&bench, &[]);
        assert_eq!(done.status.code(), Some(0), "{}", words(&done));
        assert_eq!(runs(&bench).len(), 1, "{}", words(&done));
    }
}

#[test]
fn without_a_word_in_the_machine_file_everything_is_kept() {
    let bench = Bench::of("xy", &[]);
    old_run(&bench, "xy-part-20200101-000000", "xy", 600);
    let done = run_there(&bench, &[]);
    assert_eq!(done.status.code(), Some(0), "{}", words(&done));
    assert_eq!(runs(&bench).len(), 2);
}

#[test]
fn a_run_records_as_much_as_it_is_told_to() {
    let has = |folder: &Path, name: &str| folder.join(name).exists();
    for (log, events, samples) in [
        ("off", false, false),
        ("events", true, false),
        ("full", true, true),
    ] {
        let bench = Bench::of("xy", &[]);
        let done = run_there(&bench, &["--log", log, "--out", "out"]);
        assert_eq!(done.status.code(), Some(0), "{log}: {}", words(&done));
        let out = bench.path().join("out");
        assert_eq!(has(&out, "events.jsonl"), events, "{log}");
        assert_eq!(has(&out, "run.mcap"), samples, "{log}");
        assert_eq!(has(&out, "report.json"), samples, "{log}");
        let said = String::from_utf8_lossy(&done.stdout).into_owned();
        assert_eq!(said.contains("Without a log"), !samples, "{said}");
    }
}

#[test]
fn a_cell_without_logs_is_ordered_as_any_other() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("part.ngc", &circle_program(5.0, 6000.0, (0.0, 0.0), 0.0));
    let cell = unique_cell();
    let socket = bench.path().join("nobody");
    let mut up = LiveCell::up_told(&cell, bench.path(), &socket, &["--log", "off"]);
    up.wait_for(|_| true);
    obeyed(&up, &["enable"]);
    obeyed(&up, &["load", &program.display().to_string()]);
    assert!(obeyed(&up, &["start", "--wait"]).contains("is done"));
    obeyed(&up, &["down"]);
    let out = up.out.clone();
    let ended = up.finish();
    assert_eq!(ended.status(), 0, "{}", ended.stderr());
    assert!(!out.join("001-part").exists() && !out.join("events.jsonl").exists());
}

#[test]
fn an_enable_that_is_taken_back_is_answered_at_once() {
    let bench = Bench::patient("xy", &[]);
    let mut cell = LiveCell::up(bench.path(), "realtime");
    cell.wait_for(|_| true);
    for _ in 0..5 {
        let mut enable = quadrant()
            .args(["enable", "--cell", &cell.cell])
            .stderr(std::process::Stdio::piped())
            .spawn()
            .expect("enable");
        while enable.try_wait().expect("enable").is_none() {
            ask(&cell, &["disable"]);
        }
        let ended = enable.wait_with_output().expect("its end");
        assert!(!words(&ended).contains("after 10 s"), "{}", words(&ended));
    }
    obeyed(&cell, &["down"]);
}
