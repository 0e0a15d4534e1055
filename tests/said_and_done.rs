//! What commands say is what was done: remarks reach the report, output that found no room is no success, a run that nobody recorded is not
//! called done.

use std::fs;
use std::process::{Output, Stdio};

use crate::support::{Bench, LiveCell, circle_program, plan, quadrant, run, run_with, unique_cell};
use crate::up::{ask, obeyed};

const REMARKABLE: &str = "G21 G90\nG64\n/G0 X5\nG1 X10 F600\n";

fn words(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn what_was_accepted_with_a_remark_is_in_the_report_too() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("part.ngc", REMARKABLE);
    let done = run(bench.path(), &program);
    let report = done.good_report();
    let notes = report["notes"].as_array().cloned().unwrap_or_default();
    let lines: Vec<_> = notes
        .iter()
        .filter_map(|note| note["line"].as_u64())
        .collect();
    assert_eq!(lines, [2, 3, 4], "{notes:?}");
    let text = fs::read_to_string(done.out.join("report.txt")).expect("a report");
    for (line, what) in [(2, "G64 without P"), (3, "block delete"), (4, "without M2")] {
        let remark = format!("line {line}: ");
        let has = |of: &str| of.contains(&remark) && of.contains(what);
        assert!(text.lines().any(has), "{text}");
        assert!(done.stderr().lines().any(has), "{}", done.stderr());
    }
}

#[test]
fn a_program_without_remarks_has_none_in_its_report() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("part.ngc", "G21 G90\nG1 X10 F600\nM2\n");
    let report = run(bench.path(), &program).good_report();
    assert_eq!(report.get("notes"), None, "{report}");
}

#[test]
fn output_that_finds_no_room_ends_with_3_and_the_reason() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("part.ngc", "G21 G90\nG1 X10 F600\nM2\n");
    let full = || Stdio::from(fs::File::create("/dev/full").expect("/dev/full"));
    let out = bench.path().join("run");
    let done = quadrant()
        .arg("run")
        .args([bench.path(), &program])
        .args(["--pace", "lockstep", "--cell", &unique_cell(), "--out"])
        .arg(&out)
        .stdout(full())
        .output()
        .expect("a run");
    assert_eq!(done.status.code(), Some(3), "{}", words(&done));
    assert!(words(&done).contains("standard output: No space left"));
    let report = fs::read_to_string(out.join("report.json")).expect("a report");
    assert!(report.contains("\"completed\""), "{report}");
    for arguments in [
        vec![
            "plan",
            &bench.path().display().to_string(),
            &program.display().to_string(),
        ],
        vec!["report", &out.display().to_string()],
        vec!["report", &out.display().to_string(), "--json"],
        vec!["completions", "bash"],
    ] {
        let printed = quadrant().args(&arguments).stdout(full()).output();
        let printed = printed.expect("the command");
        assert_eq!(
            printed.status.code(),
            Some(3),
            "{arguments:?}: {}",
            words(&printed)
        );
        assert!(
            words(&printed).contains("No space left"),
            "{}",
            words(&printed)
        );
    }
}

#[test]
fn a_look_at_a_cell_that_finds_no_room_ends_with_3() {
    let bench = Bench::patient("xy", &[]);
    let mut cell = LiveCell::up(bench.path(), "realtime");
    cell.wait_for(|_| true);
    let full = fs::File::create("/dev/full").expect("/dev/full");
    let printed = quadrant()
        .args(["status", "--json", "--cell", &cell.cell])
        .stdout(full)
        .output()
        .expect("the command");
    assert_eq!(printed.status.code(), Some(3), "{}", words(&printed));
    obeyed(&cell, &["down"]);
}

#[test]
fn a_run_that_nobody_could_record_is_not_called_done() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("part.ngc", &circle_program(5.0, 6000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    // What is in the place of its folder keeps the recorder from making it.
    fs::write(cell.out.join("001-part"), "in the way").expect("a file");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &program.display().to_string()]);
    let said = ask(&cell, &["start", "--wait"]);
    assert_eq!(said.status, 3, "{}", said.text);
    assert!(said.text.contains("was not recorded"), "{}", said.text);
    assert!(said.text.contains("001-part/run.mcap"), "{}", said.text);
}

#[test]
fn a_dwell_of_a_day_takes_no_longer_to_plan_than_a_short_one() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("part.ngc", "G21 G90\nG0 X10\nG4 P99999.5\nG0 X20\nM2\n");
    let printed = plan(bench.path(), &program, &[]);
    let short = bench.file("short.ngc", "G21 G90\nG0 X10\nG4 P2\nG0 X20\nM2\n");
    let of_short = plan(bench.path(), &short, &[]);
    let seconds = |text: &str| -> f64 {
        let line = text
            .lines()
            .find(|line| line.starts_with("program "))
            .expect("totals");
        let time = line.split(", ").find_map(|part| part.strip_suffix(" s"));
        time.and_then(|time| time.parse().ok()).expect("seconds")
    };
    let longer_s = seconds(&printed) - seconds(&of_short);
    assert!(
        (longer_s - 99_997.5).abs() < 0.0015,
        "{printed}\n{of_short}"
    );
    let dwell = printed.lines().find(|line| line.contains("line 3: rest"));
    assert!(dwell.is_some_and(|line| line.contains("999")), "{printed}");
}

#[test]
fn a_plant_with_another_lead_is_named_before_a_run_and_by_check() {
    let bench = Bench::of("xy", &[]);
    let plant = bench.path().join("plant.toml");
    let text = fs::read_to_string(&plant).expect("plant.toml");
    fs::write(&plant, text.replacen("lead_mm = 10.0", "lead_mm = 5.0", 1)).expect("writing");
    let program = bench.file("part.ngc", "G21 G90\nG1 X1 F600\nM2\n");
    let done = run_with(bench.path(), &program, &[]);
    let checked = quadrant().arg("check").arg(bench.path()).output();
    let checked = checked.expect("check");
    assert_eq!(checked.status.code(), Some(0), "{}", words(&checked));
    let checked = String::from_utf8_lossy(&checked.stdout).into_owned();
    for text in [&done.stderr(), &checked] {
        assert!(
            text.contains("axis X: the controller reckons with 10 mm a turn"),
            "{text}"
        );
    }
}

#[test]
fn a_log_filter_that_is_none_is_refused() {
    for (filter, status) in [
        ("loud", 2),
        ("servo=loud", 2),
        ("%%%", 2),
        ("warn,servo=debug", 0),
    ] {
        let printed = quadrant()
            .args(["check", "machines/xy"])
            .env("QUADRANT_LOG", filter)
            .output()
            .expect("check");
        assert_eq!(
            printed.status.code(),
            Some(status),
            "{filter}: {}",
            words(&printed)
        );
    }
}
