//! The scope and the black box, with real processes: what is seen live is what is in the log.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use serde_json::Value;

use crate::size;
use crate::support::{Bench, LiveCell, Run, circle_program, long_program, quadrant, run, run_with};

const SIGNALS: &str = "X.following_error,X.command,Y.torque,X.table,contour_error,path_distance,line,mode,X.missed_scans";

fn scope(arguments: &[&str]) -> Output {
    quadrant()
        .arg("scope")
        .args(arguments)
        .output()
        .expect("the scope")
}

fn good(arguments: &[&str]) -> String {
    let output = scope(arguments);
    let printed = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {printed}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The message of a scope that must end with this status.
fn refused(status: i32, arguments: &[&str]) -> String {
    let output = scope(arguments);
    let printed = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(
        output.status.code(),
        Some(status),
        "{arguments:?}: {printed}"
    );
    printed
}

fn path(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// Scan in the row of time 0, for each capture.
fn triggers(table: &str) -> Vec<u64> {
    let rows = table
        .lines()
        .skip(1)
        .map(|line| line.split(',').collect::<Vec<_>>());
    rows.filter(|row| row[2] == "0")
        .map(|row| row[1].parse().expect("a scan"))
        .collect()
}

fn circle(bench: &Bench) -> PathBuf {
    bench.file("circle.ngc", &circle_program(25.0, 3000.0, (0.0, 0.0), 0.0))
}

fn boxes(run: &Run) -> Vec<String> {
    let entries = fs::read_dir(&run.out).expect("the run directory");
    let names = entries.map(|entry| entry.expect("an entry").file_name());
    let names = names.map(|name| name.to_string_lossy().into_owned());
    let mut boxes: Vec<String> = names
        .filter(|name| name.starts_with("black-box-"))
        .collect();
    boxes.sort();
    boxes
}

#[test]
fn what_a_scope_sees_of_a_running_cell_is_what_it_sees_in_its_log() {
    if size::is_left_out() {
        return;
    }
    let bench = Bench::patient("xy", &[]);
    let program = circle(&bench);
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(1000);
    let (table, picture) = (bench.path().join("live.csv"), bench.path().join("live.svg"));
    let name = cell.cell.clone();
    let asked = [
        "--signal",
        SIGNALS,
        "--trigger",
        "reversal X",
        "--count",
        "2",
    ];
    let mut live = vec![
        "--cell",
        &name,
        "--csv",
        path(&table),
        "--svg",
        path(&picture),
    ];
    live.extend(asked);
    let printed = good(&live);
    assert!(
        printed.contains("reversal of X to") && printed.contains("250 scans"),
        "{printed}"
    );
    let run = cell.finish();
    let report = run.good_report();
    let live = fs::read_to_string(&table).expect("the table");
    let found = triggers(&live);
    assert_eq!(found.len(), 2);
    let from = found[0].to_string();
    let mut of_log = vec!["--log", path(&run.out), "--csv", "-", "--from", &from];
    of_log.extend(asked);
    assert!(good(&of_log) == live, "the table of the log is another one");
    // They are the reversals of the report, in the same scans.
    let reversals = report["reversals"].as_array().expect("reversals");
    for scan in found {
        let known = |r: &Value| r["axis"] == "X" && r["scan"] == scan;
        assert!(reversals.iter().any(known), "scan {scan}: {reversals:?}");
    }
    let head = live.lines().next().expect("a head");
    assert!(
        head.starts_with("capture,scan,time_ms,X.following_error_um,X.command_mm,Y.torque_nm"),
        "{head}"
    );
    assert_eq!(live.lines().count(), 1 + 2 * 250);
    // On a PC that is not made for real time a servo misses a scan now and then: there it has no command.
    let unknown = live.lines().filter(|line| line.contains(",,")).count();
    assert!(unknown <= 50, "{unknown} of 500 scans are not known");
    for file in [picture, bench.path().join("live-2.svg")] {
        let drawn = fs::read_to_string(&file).expect("a picture");
        assert!(drawn.contains("reversal of X to") && drawn.contains("X.following_error in"));
    }
}

#[test]
fn a_scope_changes_no_bit_of_the_motion_and_sees_a_lockstep_run_as_its_log_has_it() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let short = circle(&bench);
    let alone = run(bench.path(), &short).good_report();
    let watched = LiveCell::start(bench.path(), &short, "lockstep");
    let name = watched.cell.clone();
    // Whether it comes in time is chance; that nobody notices it is not.
    for _ in 0..20 {
        let output = scope(&["--cell", &name, "--signal", "X.torque", "--timeout", "20ms"]);
        if output.status.code() == Some(0) {
            break;
        }
    }
    let watched = watched.finish().good_report();
    assert_eq!(watched["motion_digest"], alone["motion_digest"]);
    assert_eq!(watched["digest"], alone["digest"]);
    // A cell that goes on long enough for a scope that waits for something.
    let mut cell = LiveCell::start(bench.path(), &program, "lockstep");
    cell.wait_for_scan(1);
    let name = cell.cell.clone();
    let asked = [
        "--signal",
        "X.command,Y.following_error",
        "--trigger",
        "reversal Y +",
    ];
    let mut live = vec!["--cell", &name, "--csv", "-"];
    live.extend(asked);
    let live = good(&live);
    let run = cell.finish();
    let from = triggers(&live)[0].to_string();
    let mut of_log = vec!["--log", path(&run.out), "--csv", "-", "--from", &from];
    of_log.extend(asked);
    let log = good(&of_log);
    // In lockstep scans pass faster than anybody looks: what was seen is the same.
    assert!(live.lines().count() > 100, "{live}");
    for line in live.lines() {
        assert!(
            log.lines().any(|of_log| of_log == line),
            "{line} is not in the log"
        );
    }
}

#[test]
fn a_trip_is_saved_without_being_asked_and_looks_as_in_the_log() {
    let bench = Bench::of("xy", &[]);
    let program = circle(&bench);
    let faults = bench.file(
        "lost.toml",
        "[restart]\nservo = \"resume\"\n[[fault]]\nat = { reversal = 1, axis = \"X\" }\nprocess = \"servo-X\"\ndo = \"kill\"\n",
    );
    let run = run_with(bench.path(), &program, &["--faults", path(&faults)]);
    let report = run.good_report();
    let death = report["processes"].as_array().expect("processes").iter();
    let death = death.filter(|p| p["process"] == "servo-X");
    let mut death = death.map(|p| p["deaths"][0]["scan"].as_u64().expect("a scan"));
    let death = death.next().expect("it died");
    let boxes = boxes(&run);
    assert_eq!(boxes, [format!("black-box-{death}-death-servo-X.mcap")]);
    let printed = run.stderr();
    assert!(printed.contains(&boxes[0]), "{printed}");
    let file = run.out.join(&boxes[0]);
    for trigger in ["trip", "death servo-X", "reversal X"] {
        let asked = ["--signal", SIGNALS, "--trigger", trigger, "--csv", "-"];
        let of = |log: &Path| {
            let from = (death - 100).to_string();
            let mut arguments = vec!["--log", path(log), "--from", &from];
            arguments.extend(asked);
            good(&arguments)
        };
        let table = of(&file);
        assert!(
            table == of(&run.out),
            "{trigger}: the box shows something else than the log"
        );
        assert_eq!(table.lines().count(), 251, "{trigger}");
        if trigger == "death servo-X" {
            assert_eq!(triggers(&table), [death]);
        }
    }
    // The box stands alone: machine file and program are in it.
    let elsewhere = bench.path().join("mailed.mcap");
    fs::copy(&file, &elsewhere).expect("a copy");
    let list = good(&["--log", path(&elsewhere), "--list"]);
    assert!(
        list.contains("X.following_error") && list.contains("contour_error"),
        "{list}"
    );
    // The run's own log and its report are as they are without.
    let again = run_with(bench.path(), &program, &["--faults", path(&faults)]).good_report();
    assert_eq!(again["digest"], report["digest"]);
}

#[test]
fn a_process_killed_in_a_running_cell_leaves_a_box_that_the_end_of_the_run_may_cut() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(1500);
    crate::support::send(cell.pid_of(" planner "), libc::SIGKILL);
    cell.wait_for_scan(2000);
    let scope_of_hold = {
        let name = cell.cell.clone();
        std::thread::spawn(move || {
            good(&[
                "--cell",
                &name,
                "--signal",
                "hold,X.velocity",
                "--trigger",
                "order",
                "--csv",
                "-",
            ])
        })
    };
    std::thread::sleep(std::time::Duration::from_millis(300));
    let scan = cell.wait_for_scan(0).scan;
    quadrant()
        .args(["hold", "--cell", &cell.cell])
        .output()
        .expect("hold");
    let table = scope_of_hold.join().expect("the scope");
    assert!(triggers(&table)[0] >= scan, "{table}");
    cell.signal_launcher(libc::SIGINT);
    let run = cell.finish();
    let boxes = boxes(&run);
    assert_eq!(boxes.len(), 1, "{boxes:?}");
    assert!(boxes[0].ends_with("-death-planner.mcap"), "{boxes:?}");
    let file = run.out.join(&boxes[0]);
    let table = good(&[
        "--log",
        path(&file),
        "--signal",
        "X.torque",
        "--trigger",
        "death",
        "--csv",
        "-",
        "--before",
        "1s",
    ]);
    let scan = triggers(&table)[0];
    assert_eq!(boxes[0], format!("black-box-{scan}-death-planner.mcap"));
    assert!(table.lines().count() > 1200, "{}", table.lines().count());
}

#[test]
#[expect(clippy::too_many_lines, reason = "one running cell for all questions")]
fn who_waits_in_vain_hears_what_was_seen_and_who_asks_wrongly_what_there_is() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(200);
    let name = cell.cell.clone();
    let printed = refused(
        1,
        &[
            "--cell",
            &name,
            "--signal",
            "X.torque",
            "--trigger",
            "trip",
            "--timeout",
            "0.3s",
        ],
    );
    assert!(
        printed.contains("0.3 s have passed without trigger \"trip\""),
        "{printed}"
    );
    assert!(printed.contains("the last with mode enabled"), "{printed}");
    for (arguments, right) in [
        (
            &["--signal", "X.speed"][..],
            "an axis has command, feedback",
        ),
        (&["--signal", "Q.torque"], "machine xy has axes X, Y"),
        (
            &["--signal", "X.torque", "--trigger", "reversal Q"],
            "the machine has X, Y",
        ),
        (
            &["--signal", "X.torque", "--trigger", "block 9999"],
            "is never reached",
        ),
        (&["--signal", "X.torque", "--before", "5"], "has no unit"),
        (
            &["--signal", "X.torque", "--csv", "/nonexistent/a.csv"],
            "its folder does not exist",
        ),
        (
            &["--signal", "X.torque", "--svg", "/"],
            "must be the name of a file",
        ),
        (&[], "no signal is named"),
        (
            &["--signal", "X.torque", "--before", "0ms", "--after", "0ms"],
            "nothing to show",
        ),
    ] {
        let mut all = vec!["--cell", &name];
        all.extend(arguments);
        let printed = refused(2, &all);
        assert!(printed.contains(right), "{arguments:?}: {printed}");
    }
    let list = good(&["--cell", &name, "--list"]);
    assert!(list.contains("X.following_error   µm"), "{list}");
    let chart = good(&["--cell", &name, "--signal", "X.torque,X.velocity"]);
    assert!(
        chart.contains("X.torque in N·m") && chart.contains('┊'),
        "{chart}"
    );
    assert!(
        chart.lines().all(|line| line.chars().count() <= 80),
        "{chart}"
    );
    drop(cell);
    let printed = refused(1, &["--cell", "nobody-here", "--signal", "X.torque"]);
    assert!(
        printed.contains("cell \"nobody-here\" does not run"),
        "{printed}"
    );
    let printed = refused(2, &["--log", "/nonexistent", "--signal", "X.torque"]);
    assert!(printed.contains("does not exist"), "{printed}");
    let printed = refused(2, &["--log", path(&program), "--signal", "X.torque"]);
    assert!(printed.contains("is not an MCAP log"), "{printed}");
}
