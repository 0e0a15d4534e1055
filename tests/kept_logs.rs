//! What is kept of runs: what a cell that stays up has room for, what the machine file says, or what `--log` says; and what is never
//! removed.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::Instant;

use serde_json::Value;

use crate::full_disk::with_disk;
use crate::size;
use crate::support::{
    Bench, LiveCell, PATIENCE, circle_program, quadrant, send, traces_of, unique_cell,
};
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

/// In the folder of a cell.
#[test]
fn a_run_with_a_black_box_goes_after_those_without_and_a_marked_one_stays() {
    let bench = Bench::of("xy", &[("[scan]\n", "[log]\nkeep_mb = 15\n\n[scan]\n")]);
    let cell = "xy-up-20200101-000000";
    for run in ["001-part", "002-part", "003-part", "004-part"] {
        old_run(&bench, &format!("{cell}/{run}"), "xy", 6);
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let folder = bench.path().join("runs").join(cell);
    let (text, others) = (
        folder.join("001-part/machine.toml"),
        bench.path().join("others"),
    );
    fs::copy(&text, folder.join("machine.toml")).expect("a machine");
    fs::write(folder.join("001-part/black-box-9-trip.mcap"), "").expect("a box");
    fs::write(folder.join("002-part/marked"), "").expect("a mark");
    fs::create_dir(folder.join("000-notes")).expect("a folder");
    fs::rename(folder.join("003-part"), &others).expect("a folder");
    std::os::unix::fs::symlink(&others, folder.join("003-part")).expect("a link");
    let done = run_there(&bench, &[]);
    assert_eq!(done.status.code(), Some(0), "{}", words(&done));
    let there = |run: &str| folder.join(run).exists();
    let all = ["000-notes", "001-part", "002-part", "003-part", "004-part"];
    assert_eq!(all.map(there), [true, true, true, true, false]);
    // Marked ones alone take more than that.
    let log = fs::File::create(folder.join("002-part/run.mcap")).expect("a log");
    log.set_len(20_000_000).expect("a size");
    let done = run_there(&bench, &[]);
    assert_eq!(all.map(there), [true, false, true, true, false]);
    assert!(words(&done).contains("none may go"), "{}", words(&done));
}

/// Runs a program that is loaded; its run directory, once its report is made.
fn run_loaded(cell: &LiveCell, program: &Path, run: usize) -> PathBuf {
    obeyed(cell, &["load", &program.display().to_string()]);
    obeyed(cell, &["start", "--wait"]);
    wait_for(cell, "run over", run);
    let name = program.file_stem().expect("a name").to_string_lossy();
    cell.out.join(format!("{run:03}-{name}"))
}

/// Waits for so many events of a kind; their texts.
fn wait_for(cell: &LiveCell, event: &str, count: usize) -> Vec<String> {
    let began = Instant::now();
    loop {
        let found = events_of(cell, event);
        if found.len() >= count {
            return found;
        }
        assert!(began.elapsed() < PATIENCE, "{event}: {found:?}");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
}

fn events_of(cell: &LiveCell, event: &str) -> Vec<String> {
    let events = fs::read_to_string(cell.out.join("events.jsonl")).expect("events");
    let lines = events
        .lines()
        .filter_map(|line| serde_json::from_str(line).ok());
    let found = lines.filter(|line: &Value| line["event"] == event);
    found
        .map(|line| line["text"].as_str().unwrap_or_default().to_string())
        .collect()
}

/// A program whose text takes so many bytes.
fn large(program: &str, bytes: usize) -> String {
    let line = format!("({})\n", "x".repeat(97));
    line.repeat(bytes / line.len()) + program
}

#[test]
fn a_cell_that_stays_up_removes_its_oldest_runs_but_none_with_a_death_or_a_mark() {
    let bench = Bench::patient("xy", &[("[scan]\n", "[log]\nkeep_mb = 40\n\n[scan]\n")]);
    let slow = circle_program(5.0, 3000.0, (0.0, 0.0), 0.0);
    let slow = bench.file("slow.ngc", &slow);
    let part = bench.file("part.ngc", &large(PROGRAM, 3_000_000));
    let mut cell = LiveCell::up(bench.path(), "realtime");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    fs::create_dir(cell.out.join("009-notes")).expect("a folder");
    obeyed(&cell, &["load", &slow.display().to_string()]);
    obeyed(&cell, &["start"]);
    wait_for(&cell, "run begins", 1);
    send(cell.pid_of("quadrant planner"), libc::SIGKILL);
    wait_for(&cell, "run over", 1);
    let marked = run_loaded(&cell, &part, 2);
    fs::write(marked.join("marked"), "").expect("a mark");
    let mut run = 2;
    while events_of(&cell, "removed").is_empty() {
        run += 1;
        assert!(run < 20, "nothing is removed");
        run_loaded(&cell, &part, run);
    }
    let removed = events_of(&cell, "removed");
    assert!(removed[0].contains("003-part"), "{removed:?}");
    assert!(removed[0].contains("keep_mb = 40"), "{removed:?}");
    for stays in ["001-slow", "002-part", "009-notes"] {
        assert!(cell.out.join(stays).exists(), "{stays}: {removed:?}");
    }
    let last = cell.out.join(format!("{run:03}-part"));
    assert!(last.join("report.json").exists(), "{removed:?}");
    let status = obeyed(&cell, &["status"]);
    assert!(status.contains("GB of 0.040"), "{status}");
    obeyed(&cell, &["down"]);
    let ended = cell.finish();
    let said = String::from_utf8_lossy(&ended.output.stdout).into_owned();
    assert!(
        said.contains("at most 40.0 MB, the oldest go first"),
        "{said}"
    );
}

/// Each run takes more than two MB: all of them together more than the disk has. Nothing is said in the machine file. The recorder is
/// killed once in a while.
#[test]
fn a_small_disk_is_not_filled_by_many_runs() {
    let runs = size::number("RUNS", 40, 2000);
    let (half, disk, most) = match runs {
        ..200 => (runs / 2, "64m", "6.7 MB"),
        _ => (runs / 2, "1g", "107.4 MB"),
    };
    let (folder, cell) = (tempfile::tempdir().expect("a folder"), unique_cell());
    let bench = Bench::patient("xy", &[]);
    let part = bench.file("part.ngc", &large(PROGRAM, 1_000_000));
    let script = format!(
        "cd $DISK
         mkdir -p runs/xy-part-20200101-000000 && cp {machine}/machine.toml runs/xy-part-20200101-000000
         head -c 7m /dev/zero > runs/xy-part-20200101-000000/run.mcap
         up() {{
             $Q up {machine} --pace lockstep --cell {cell} > {here}/up$1 2>&1 &
             UP=$!
             until $Q enable --cell {cell} 2> /dev/null; do sleep 0.1; done
             for RUN in $(seq {half}); do
                 $Q load {part} --cell {cell} && $Q start --wait --cell {cell} || echo a run failed
                 until [ $(cat runs/*-up-*/events.jsonl | grep -c 'run over') -ge $((RUN + $2)) ]; do sleep 0.05; done
                 [ $((RUN % 20)) != 10 ] || kill -9 $($Q status --cell {cell} | awk '$2 == \"recorder\" {{ print $3 }}')
             done
         }}
         up 1 0
         $Q down --cell {cell}; wait $UP; echo ended with $?
         up 2 {half}
         du -sm runs
         until $Q status --cell {cell} | grep 'none may go'; do
             cat /dev/zero >> filler 2> /dev/null; sleep 0.1
         done
         rm filler
         while $Q status --cell {cell} | grep -q 'none may go'; do sleep 0.1; done
         $Q down --cell {cell}; wait $UP; echo ended with $?
         ls -d runs/*/*; cat {here}/up*",
        machine = bench.path().display(),
        here = folder.path().display(),
        part = part.display(),
    );
    let Some(output) = with_disk(folder.path(), disk, &script) else {
        return;
    };
    let said = format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        words(&output)
    );
    assert!(!said.contains("a run failed"), "{said}");
    assert_eq!(said.matches("ended with 0").count(), 2, "{said}");
    let bound = format!("at most {most}, the oldest");
    assert_eq!(said.matches(&bound).count(), 2, "{said}");
    let killed = said.matches("monitor restarted").count() as u64;
    assert_eq!(killed, 2 * half.div_ceil(20), "{said}");
    assert!(!said.contains("No space left"), "{said}");
    assert!(
        said.contains("runs/xy-part-20200101-000000/run.mcap"),
        "no run of a cell: {said}"
    );
    let removed = said.matches(&format!("/{half:03}-part (")).count();
    assert_eq!(removed, 1, "of the session before: {said}");
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
