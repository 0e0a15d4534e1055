//! What a crash leaves behind goes at the next start, and children of a dead launcher do not stay.

use std::path::Path;

use crate::support::{Bench, LiveCell, circle_program, quadrant, traces_of, wait_until_gone};

#[test]
fn children_of_a_killed_launcher_leave_and_the_next_run_of_the_cell_cleans_up() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(25.0, 3000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(500);
    let children = cell.children();
    assert_eq!(children.len(), 5);
    cell.child.kill().expect("killing the launcher");
    cell.child.wait().expect("reaping it");
    wait_until_gone(&children);
    assert!(
        !traces_of(&cell.cell).is_empty(),
        "a killed launcher cannot have cleaned up"
    );

    let out = bench.path().join("again");
    let again = quadrant()
        .arg("run")
        .arg(bench.path())
        .arg(&program)
        .args(["--pace", "lockstep", "--cell", &cell.cell, "--out"])
        .arg(&out)
        .output()
        .expect("running again");
    assert_eq!(
        again.status.code(),
        Some(0),
        "{}",
        String::from_utf8_lossy(&again.stderr)
    );
    assert!(
        traces_of(&cell.cell).is_empty(),
        "{:?}",
        traces_of(&cell.cell)
    );
}

#[test]
fn clean_removes_what_a_crash_left_and_refuses_a_living_cell() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(25.0, 3000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(100);
    let refused = quadrant()
        .args(["clean", &cell.cell])
        .output()
        .expect("clean");
    assert_eq!(refused.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("already running"));
    let children = cell.children();
    cell.child.kill().expect("killing the launcher");
    cell.child.wait().expect("reaping it");
    wait_until_gone(&children);
    let cleaned = quadrant()
        .args(["clean", &cell.cell])
        .output()
        .expect("clean");
    assert_eq!(cleaned.status.code(), Some(0));
    assert!(
        traces_of(&cell.cell).is_empty(),
        "{:?}",
        traces_of(&cell.cell)
    );
}

#[test]
fn the_files_of_a_living_cell_are_its_owners_alone() {
    use std::os::unix::fs::PermissionsExt;
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(25.0, 3000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(10);
    let traces = traces_of(&cell.cell);
    assert!(traces.len() > 1);
    for name in traces {
        // Segments come and go with their readers.
        let Ok(metadata) = std::fs::metadata(Path::new("/dev/shm").join(&name)) else {
            continue;
        };
        let mode = metadata.permissions().mode();
        assert_eq!(mode & 0o077, 0, "{name} has mode {mode:o}");
    }
}
