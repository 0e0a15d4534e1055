//! A process that dies brings a defined stop with a named cause. (Restarts and standbys come with their own tests.)

use crate::support::{Bench, LiveCell, circle_program, number, send, text, traces_of};

fn killed(role: &str) -> (crate::support::Run, serde_json::Value) {
    let bench = Bench::of("xy", &[("[scan]", "[scan]\nwatchdog_scans = 100")]);
    let program = bench.file("circle.ngc", &circle_program(25.0, 3000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
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

#[test]
fn a_killed_planner_brings_the_tool_to_rest_on_the_path() {
    let (run, report) = killed("quadrant planner");
    assert_eq!(run.status(), 1, "{}", run.stderr());
    assert!(
        run.stderr().contains("planner killed by signal 9"),
        "{}",
        run.stderr()
    );
    assert_eq!(text(&report, "/outcome/kind"), "stopped");
    assert!(number(&report, "/contour_error_um/peak") < 40.0, "{report}");
    assert_eq!(number(&report, "/limits/acceleration_exceeded"), 0.0);
}

#[test]
fn a_killed_servo_stops_all_axes_with_its_name() {
    let (run, report) = killed("quadrant servo --axis Y");
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
fn a_killed_monitor_does_not_stop_the_machine() {
    let bench = Bench::of("xy", &[("[scan]", "[scan]\nwatchdog_scans = 100")]);
    let program = bench.file("circle.ngc", &circle_program(10.0, 6000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(400);
    send(cell.pid_of("quadrant recorder"), libc::SIGKILL);
    let run = cell.finish();
    assert!(
        run.stderr().contains("monitor killed by signal 9"),
        "{}",
        run.stderr()
    );
    assert!(!run.stderr().contains("tripped"), "{}", run.stderr());
}

#[test]
fn a_killed_machine_side_ends_the_cell() {
    let (run, _) = killed("quadrant plant-sim");
    assert_eq!(run.status(), 1, "{}", run.stderr());
    assert!(
        run.stderr().contains("plant-sim killed by signal 9"),
        "{}",
        run.stderr()
    );
}

/// In lockstep a living process is waited for, but not for ever: that is the environment's fault, not a missed scan.
#[test]
fn a_process_that_hangs_in_lockstep_ends_the_run_as_an_environment_failure_that_names_it() {
    let bench = Bench::of("xy", &[]);
    // Long enough that it cannot be over before it is stopped.
    let turns = circle_program(25.0, 3000.0, (0.0, 0.0), 0.0);
    let arcs: String = turns
        .lines()
        .filter(|l| l.starts_with("G3"))
        .map(|l| format!("{l}\n"))
        .collect();
    let program = bench.file(
        "long.ngc",
        &turns.replace("M2\n", &format!("{}M2\n", arcs.repeat(60))),
    );
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
