//! The log: nothing is lost with as many axes as a program can move, what was recorded survives whoever is killed, and the tools of
//! others read the same from it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use bus::sample::PATH_AXES;
use serde_json::Value;

use crate::support::{
    Bench, LiveCell, Run, circle_program, long_program, number, quadrant, root, run, send, text,
};

/// All the axes that a program can move.
const LETTERS: [&str; PATH_AXES] = ["X", "Y", "Z", "A", "B", "C", "U", "V", "W"];

/// A machine of nine slides, made of those of `xy` in turn; its watchdog waits as long as a busy PC needs.
fn nine_axes() -> Bench {
    let bench = Bench::patient("xy", &[]);
    for name in ["machine.toml", "plant.toml"] {
        let file = bench.path().join(name);
        let text = fs::read_to_string(&file).expect("a file of the machine");
        let mut parts = text.split("[[axis]]\n");
        let mut widened = parts.next().expect("a head").to_string();
        let axes: Vec<&str> = parts.collect();
        for (index, letter) in LETTERS.iter().enumerate() {
            let axis = axes[index % axes.len()];
            let known = format!("name = \"{}\"", LETTERS[index % axes.len()]);
            assert!(axis.contains(&known), "{name} has no {known}");
            widened += "[[axis]]\n";
            widened += &axis.replacen(&known, &format!("name = \"{letter}\""), 1);
        }
        fs::write(&file, widened).expect("writing a file of the machine");
    }
    bench
}

/// Every axis moves, there and back, as often as that; 1.3 s each time.
fn all_axes_move(times: usize) -> String {
    let once = "G1 X20 Y15 Z12 A20 B-15 C10 U12 V-14 W13\nG1 X0 Y0 Z0 A0 B0 C0 U0 V0 W0\n";
    format!("G21 G17 G90 G94 F4000\n{}M2\n", once.repeat(times))
}

/// Nothing is missing in the log, of nobody.
fn lost_nothing(report: &Value) {
    assert_eq!(text(report, "/outcome/kind"), "completed");
    assert_eq!(
        report.pointer("/axes").map(|a| a.as_array().map(Vec::len)),
        Some(Some(PATH_AXES))
    );
    assert_eq!(number(report, "/samples_lost"), 0.0, "{report}");
    assert_eq!(number(report, "/log/queue_losses"), 0.0, "{report}");
}

#[test]
fn nine_axes_are_recorded_without_loss_in_lockstep() {
    let bench = nine_axes();
    let program = bench.file("all.ngc", &all_axes_move(3));
    let run = run(bench.path(), &program);
    lost_nothing(&run.good_report());
}

/// Servos may miss scans on a PC that is not made for this; the recorder reports it and misses nothing itself.
#[test]
fn nine_axes_at_1_ms_are_recorded_without_loss_in_realtime() {
    let bench = nine_axes();
    let program = bench.file("all.ngc", &all_axes_move(4));
    let cell = LiveCell::start(bench.path(), &program, "realtime");
    let report = cell.finish().good_report();
    lost_nothing(&report);
    let scans = number(&report, "/scans");
    assert_eq!(number(&report, "/parts/0/first_scan"), 0.0);
    assert_eq!(number(&report, "/parts/0/last_scan"), scans - 1.0);
}

/// Scans of 1 ms that a killed recorder may leave unsaid: a second.
const SECOND_SCANS: f64 = 1000.0;

#[test]
fn a_recorder_killed_in_realtime_has_written_all_but_the_last_second() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(10.0, 3000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(1);
    let (_bus, mut reader) = cell.feedback();
    let recorder = cell.pid_of("quadrant recorder");
    // Neither a multiple of what is flushed together nor close behind one.
    let mut seen = 0;
    while seen < 2930 {
        std::thread::sleep(Duration::from_millis(1));
        seen = reader.newest(u64::MAX).map_or(seen, |f| f.scan);
    }
    send(recorder, libc::SIGKILL);
    let killed_by = reader.newest(u64::MAX).map_or(seen, |f| f.scan) as f64;
    let report = cell.finish().good_report();
    let last = number(&report, "/parts/0/last_scan");
    assert!(
        last < killed_by && killed_by - last <= SECOND_SCANS,
        "killed by scan {killed_by}, readable up to scan {last}"
    );
    assert_eq!(number(&report, "/parts/0/first_scan"), 0.0);
}

/// Kills a whole realtime cell, launcher first; the last scan that anybody saw, and what is left.
fn all_killed_at_once(scan: u64) -> (f64, Run) {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(scan);
    let children = cell.children();
    let (_bus, mut reader) = cell.feedback();
    send(cell.child.id() as i32, libc::SIGKILL);
    for (pid, _) in children {
        send(pid, libc::SIGKILL);
    }
    let mut last = 0;
    while let Some(feedback) = reader.newest(u64::MAX) {
        if feedback.scan <= last {
            break;
        }
        last = feedback.scan;
    }
    let run = cell.finish();
    let _ = quadrant().args(["clean", &run.cell]).output();
    (scan.max(last) as f64, run)
}

#[test]
fn a_cell_killed_whole_and_at_once_leaves_a_log_that_is_reported_up_to_its_last_second() {
    let (last_seen, run) = all_killed_at_once(2930);
    assert!(
        !run.out.join("report.json").exists(),
        "nobody was left to write it"
    );
    let done = quadrant().arg("report").arg(&run.out).output();
    let done = done.expect("quadrant report");
    let stderr = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{stderr}");
    let report = run.report();
    assert_eq!(text(&report, "/outcome/kind"), "stopped");
    let recovered = number(&report, "/scans");
    assert_eq!(number(&report, "/parts/0/first_scan"), 0.0);
    assert!(
        last_seen + 1.0 - recovered <= SECOND_SCANS,
        "scan {last_seen} was seen, {recovered} scans are in the log"
    );
    // As far as it reaches nothing is missing, and what it says is what the tools of others find in it.
    assert_eq!(number(&report, "/samples_lost"), 0.0, "{report}");
    if let Some(found) = read_by_others(&run.out.join("run.mcap")) {
        assert_eq!(found["whole"], false, "{found}");
        agree(&found, &report);
    }
}

#[test]
fn a_foreign_reader_finds_a_valid_file_and_the_numbers_of_the_report() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(10.0, 6000.0, (0.0, 0.0), 0.0));
    let run = run(bench.path(), &program);
    let report = run.good_report();
    let Some(found) = read_by_others(&run.out.join("run.mcap")) else {
        return;
    };
    assert_eq!(found["whole"], true, "{found}");
    agree(&found, &report);
}

/// The rounding of report.json.
const ROUNDING_UM: f64 = 0.000_51;

fn agree(found: &Value, report: &Value) {
    assert_eq!(found["problems"], serde_json::json!([]), "{found}");
    assert_eq!(number(found, "/scans"), number(report, "/scans"));
    for (index, axis) in ["X", "Y"].iter().enumerate() {
        for (theirs, ours) in [
            ("following_error_um_peak", "peak"),
            ("following_error_um_rms", "rms"),
        ] {
            let theirs = number(found, &format!("/axes/{axis}/{theirs}"));
            let ours = number(report, &format!("/axes/{index}/following_error_um/{ours}"));
            assert!(
                (theirs - ours).abs() <= ROUNDING_UM,
                "{axis}: {theirs} of the foreign reader, {ours} in report.json"
            );
        }
    }
}

/// What the Python packages `mcap` and `mcap-ros2-support` make of a log. Without them nothing is tested, unless
/// QUADRANT_PYTHON names a Python that must have them, as continuous integration does.
pub(crate) fn read_by_others(log: &Path) -> Option<Value> {
    let named = std::env::var_os("QUADRANT_PYTHON").map(PathBuf::from);
    let python = named.clone().unwrap_or_else(|| "python3".into());
    let has_them = Command::new(&python)
        .args(["-c", "import mcap, mcap_ros2"])
        .output()
        .is_ok_and(|done| done.status.success());
    if !has_them {
        assert!(
            named.is_none(),
            "{} cannot import mcap and mcap_ros2",
            python.display()
        );
        eprintln!(
            "SKIPPED: {} has no packages mcap and mcap-ros2-support; no foreign reader has looked at the log",
            python.display()
        );
        return None;
    }
    let done = Command::new(&python)
        .arg(root().join("tests/foreign/read_mcap.py"))
        .arg(log)
        .output()
        .expect("the foreign reader");
    let printed = String::from_utf8_lossy(&done.stdout);
    let complained = String::from_utf8_lossy(&done.stderr);
    let found = serde_json::from_str(&printed);
    Some(found.unwrap_or_else(|_| panic!("the foreign reader printed:\n{printed}{complained}")))
}
