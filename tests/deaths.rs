//! A process that dies or hangs, killed from outside at no particular instant: a defined stop with a named cause, or
//! another one takes its place. (Deaths at given scans, standbys and restarts of all kinds: `faults`.)

use crate::support::{
    Bench, LiveCell, Run, circle_program, endless_program, long_program, number, run_with, send,
    text, traces_of,
};

/// Kills one process of a lockstep cell in the middle of an arc; the run and its report.
fn killed(role: &str, edits: &[(&str, &str)]) -> (Run, serde_json::Value) {
    let bench = Bench::of("xy", edits);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "lockstep");
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 20.0);
    send(cell.pid_of(role), libc::SIGKILL);
    let run = cell.finish();
    let report = run.report();
    assert!(
        traces_of(&run.cell).is_empty(),
        "{:?}",
        traces_of(&run.cell)
    );
    (run, report)
}

/// The text of a machine file before which a `[restart]` table may stand.
const SCAN_TABLE: &str = "[scan]\n";

#[test]
fn a_killed_planner_is_restarted_and_the_program_goes_on_by_itself() {
    let (run, report) = killed("quadrant planner", &[]);
    assert_eq!(run.status(), 0, "{}", run.stderr());
    assert!(
        run.stderr().contains("planner killed by signal 9"),
        "{}",
        run.stderr()
    );
    assert!(
        run.stderr().contains("planner restarted"),
        "{}",
        run.stderr()
    );
    assert_eq!(text(&report, "/outcome/kind"), "completed");
    assert_eq!(number(&report, "/processes/1/starts"), 2.0, "{report}");
    assert_eq!(number(&report, "/limits/acceleration_exceeded"), 0.0);
}

#[test]
fn a_killed_planner_that_is_not_to_come_back_leaves_the_tool_at_rest_on_the_path() {
    let ends = "[restart]\nplanner = \"end\"\n\n[scan]\n";
    let (run, report) = killed("quadrant planner", &[(SCAN_TABLE, ends)]);
    assert_eq!(run.status(), 1, "{}", run.stderr());
    assert_eq!(text(&report, "/outcome/kind"), "stopped");
    assert!(text(&report, "/outcome/reason").contains("planner killed"));
    assert!(number(&report, "/contour_error_um/peak") < 25.0, "{report}");
    assert_eq!(number(&report, "/limits/acceleration_exceeded"), 0.0);
}

#[test]
fn a_killed_servo_stops_all_axes_with_its_name() {
    let (run, report) = killed("quadrant servo --axis Y", &[]);
    assert_eq!(run.status(), 1, "{}", run.stderr());
    assert!(
        run.stderr().contains("servo-Y killed by signal 9"),
        "{}",
        run.stderr()
    );
    assert_eq!(text(&report, "/outcome/kind"), "stopped");
    assert!(text(&report, "/outcome/reason").contains('Y'), "{report}");
}

#[test]
fn a_killed_master_ends_the_cell() {
    let (run, report) = killed("quadrant plant-sim", &[]);
    assert_eq!(run.status(), 1, "{}", run.stderr());
    assert!(
        run.stderr().contains("plant-sim killed by signal 9"),
        "{}",
        run.stderr()
    );
    assert_eq!(text(&report, "/outcome/kind"), "stopped");
}

#[test]
fn a_killed_monitor_does_not_stop_the_machine_and_another_one_records_on() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(10.0, 6000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(1500);
    send(cell.pid_of("quadrant recorder"), libc::SIGKILL);
    let run = cell.finish();
    assert_eq!(run.status(), 0, "{}", run.stderr());
    assert!(
        run.stderr().contains("monitor killed by signal 9"),
        "{}",
        run.stderr()
    );
    let report = run.report();
    let parts = report.pointer("/parts").and_then(|p| p.as_array());
    assert_eq!(parts.map(Vec::len), Some(2), "{report}");
    let first = number(&report, "/parts/0/last_scan");
    assert!(
        first > 400.0,
        "the first part is readable up to scan {first}"
    );
    assert!(number(&report, "/samples_lost") > 0.0);
}

#[test]
fn a_killed_monitor_that_is_not_to_come_back_cuts_the_log_short_and_the_run_says_so() {
    let leave = "[restart]\nmonitor = \"leave\"\n\n[scan]\n";
    let (run, _) = killed("quadrant recorder", &[(SCAN_TABLE, leave)]);
    assert_eq!(
        run.status(),
        1,
        "a run whose log is cut short is not a good one"
    );
    assert!(run.stderr().contains("monitor killed by signal 9"));
}

#[test]
fn a_recorder_that_hangs_is_dropped_and_the_run_goes_on() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell =
        LiveCell::start_with(bench.path(), &program, "lockstep", &["--answer-limit", "1"]);
    cell.wait_for_scan(100);
    let recorder = cell.pid_of("quadrant recorder");
    send(recorder, libc::SIGSTOP);
    let stalled = cell.wait_for_scan(600).scan;
    cell.wait_for_scan(stalled + 4000);
    send(recorder, libc::SIGCONT);
    let run = cell.finish();
    assert_eq!(run.status(), 0, "{}", run.stderr());
    assert!(
        run.stderr().contains("recorder has stalled"),
        "{}",
        run.stderr()
    );
    let lost = number(&run.report(), "/samples_lost");
    assert!(lost > 0.0, "what it lost is counted");
}

/// In lockstep a living process is waited for, but not for ever: that is the environment's fault, not a missed scan.
#[test]
fn a_process_that_hangs_in_lockstep_ends_the_run_as_an_environment_failure_that_names_it() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("long.ngc", &endless_program());
    let mut cell =
        LiveCell::start_with(bench.path(), &program, "lockstep", &["--answer-limit", "1"]);
    cell.wait_for_scan(100);
    send(cell.pid_of("quadrant servo --axis X"), libc::SIGSTOP);
    let run = cell.finish();
    assert_eq!(run.status(), 3, "{}", run.stderr());
    assert!(
        run.stderr()
            .contains("servo X (last answered 1 scans ago) has not answered"),
        "{}",
        run.stderr()
    );
    assert!(
        traces_of(&run.cell).is_empty(),
        "{:?}",
        traces_of(&run.cell)
    );
}

/// An axis that has been without its standby for a second is an alarm: in the events, on the screen.
#[test]
fn a_standby_that_does_not_come_back_is_an_alarm() {
    let bench = Bench::of(
        "xy",
        &[(
            "drive_mode = \"velocity\"",
            "drive_mode = \"velocity\"\nstandby = true",
        )],
    );
    let program = bench.file("circle.ngc", &circle_program(10.0, 3000.0, (0.0, 0.0), 0.0));
    let faults = bench.file(
        "faults.toml",
        "[[fault]]\nat = { scan = 500 }\nprocess = \"servo-X/b\"\ndo = \"kill\"\nrestart_after_scans = 3000\n",
    );
    let faults = faults.display().to_string();
    let run = run_with(bench.path(), &program, &["--faults", &faults]);
    run.good_report();
    let events = std::fs::read_to_string(run.out.join("events.jsonl")).expect("events");
    assert_eq!(events.matches("\"standby-alarm\"").count(), 1, "{events}");
    assert_eq!(events.matches("\"standby-back\"").count(), 1, "{events}");
    assert!(!events.contains("standby-differs"), "{events}");
}
