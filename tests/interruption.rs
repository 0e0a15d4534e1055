//! Ctrl-C and SIGTERM: the tool comes to rest on the path, the report is written, nothing stays behind.

use crate::support::{Bench, LiveCell, endless_program, long_program, number, text, traces_of};

fn arc_in_progress(signal: i32) -> (crate::support::Run, serde_json::Value) {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("long.ngc", &endless_program());
    let mut cell = LiveCell::start(bench.path(), &program, "lockstep");
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 30.0);
    cell.signal_launcher(signal);
    let run = cell.finish();
    let report = run.report();
    (run, report)
}

#[test]
fn ctrl_c_in_mid_arc_stops_the_tool_on_the_path() {
    let (run, report) = arc_in_progress(libc::SIGINT);
    assert_eq!(run.status(), 130, "{}", run.stderr());
    assert_eq!(text(&report, "/outcome/kind"), "interrupted");
    assert!(number(&report, "/contour_error_um/peak") < 40.0, "{report}");
    assert_eq!(number(&report, "/limits/velocity_exceeded"), 0.0);
    assert_eq!(number(&report, "/limits/acceleration_exceeded"), 0.0);
    assert!(
        traces_of(&run.cell).is_empty(),
        "{:?}",
        traces_of(&run.cell)
    );
}

#[test]
fn sigterm_is_an_orderly_stop_too() {
    let (run, report) = arc_in_progress(libc::SIGTERM);
    assert_eq!(run.status(), 130, "{}", run.stderr());
    assert_eq!(text(&report, "/outcome/kind"), "interrupted");
}

#[test]
fn a_second_ctrl_c_stops_at_once_and_leaves_nothing_behind() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(300);
    // A master that is stopped cannot come to rest in order.
    let machine = cell.pid_of("quadrant plant-sim");
    crate::support::send(machine, libc::SIGSTOP);
    cell.signal_launcher(libc::SIGINT);
    std::thread::sleep(std::time::Duration::from_millis(300));
    cell.signal_launcher(libc::SIGINT);
    let children = cell.children();
    let run = cell.finish();
    assert_eq!(run.status(), 130, "{}", run.stderr());
    for (pid, line) in children {
        assert!(
            !std::path::Path::new(&format!("/proc/{pid}")).exists(),
            "{line} lives"
        );
    }
    assert!(
        traces_of(&run.cell).is_empty(),
        "{:?}",
        traces_of(&run.cell)
    );
}

/// A terminal that is gone takes nothing with it: the run stops in order and its report is written.
#[test]
fn a_closed_standard_error_and_a_hangup_still_end_in_order() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("long.ngc", &endless_program());
    let mut cell = LiveCell::start(bench.path(), &program, "lockstep");
    cell.wait_for_scan(2000);
    drop(cell.child.stderr.take());
    drop(cell.child.stdout.take());
    cell.signal_launcher(libc::SIGHUP);
    let run = cell.finish();
    assert_eq!(run.status(), 130);
    assert_eq!(text(&run.report(), "/outcome/kind"), "interrupted");
}
