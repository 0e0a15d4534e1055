//! The two paces, and what a group looks like from outside.

use std::time::Duration;

use crate::size;
use crate::support::{Bench, LiveCell, circle_program, number, send, text, traces_of};

#[test]
fn one_process_per_role_can_be_told_apart_while_it_runs() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(25.0, 3000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(10);
    let lines: Vec<String> = cell.children().into_iter().map(|(_, line)| line).collect();
    for role in [
        "quadrant plant-sim ",
        "quadrant planner ",
        "quadrant servo --axis X ",
        "quadrant servo --axis Y ",
        "quadrant recorder ",
    ] {
        let count = lines.iter().filter(|line| line.starts_with(role)).count();
        assert_eq!(count, 1, "{role:?} among {lines:#?}");
    }
    assert_eq!(lines.len(), 5, "{lines:#?}");
    for (pid, line) in cell.children() {
        let name = std::fs::read_to_string(format!("/proc/{pid}/comm")).expect("a name");
        assert!(name.starts_with("qd-"), "{line} is called {name} in top");
    }
}

#[test]
fn in_realtime_missed_scans_are_counted_and_survived_without_a_trip() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(10.0, 3000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(500);
    let servo = cell.pid_of("quadrant servo --axis X");
    send(servo, libc::SIGSTOP);
    std::thread::sleep(Duration::from_millis(8));
    send(servo, libc::SIGCONT);
    let report = cell.finish().good_report();
    assert_eq!(text(&report, "/outcome/kind"), "completed");
    assert_eq!(text(&report, "/pace"), "realtime");
    assert!(number(&report, "/axes/0/missed_scans") >= 1.0, "{report}");
    assert_eq!(number(&report, "/limits/velocity_exceeded"), 0.0);
    assert_eq!(number(&report, "/limits/acceleration_exceeded"), 0.0);
}

/// Expanding a long program takes longer than a period: the first window may come late, the program must come all the same.
#[test]
fn in_realtime_a_program_that_takes_long_to_expand_still_starts() {
    let bench = Bench::patient("xy", &[]);
    let mut text = String::from("G21 G17 G90 G94 F6000\n");
    for block in 0..60_000 {
        text += &format!("G1 X{:.4} Y0\n", f64::from(1 + block % 2) * 0.01);
    }
    let program = bench.file("many.ngc", &(text + "M2\n"));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for(|f| f.tag.element > 20);
    cell.signal_launcher(libc::SIGINT);
    assert_eq!(cell.finish().status(), 130);
}

#[test]
fn every_shipped_machine_runs_a_program_in_lockstep() {
    let runs = [
        ("machines/xy", "machines/xy/programs/rounded-square.ngc"),
        (
            "machines/xy-fast",
            "machines/xy/programs/circle-r10-f3000-ccw.ngc",
        ),
        (
            "machines/xy-torque",
            "machines/xy/programs/circle-r10-f3000-ccw.ngc",
        ),
        ("machines/xyz-mill", "machines/xyz-mill/programs/helix.ngc"),
    ];
    for (machine, program) in size::one_in(4, runs) {
        let run = crate::support::run(machine, program);
        let report = run.good_report();
        assert_eq!(text(&report, "/outcome/kind"), "completed", "{machine}");
        assert!(
            number(&report, "/contour_error_um/rms") < 30.0,
            "{machine}: {report}"
        );
        assert!(
            traces_of(&run.cell).is_empty(),
            "{:?}",
            traces_of(&run.cell)
        );
    }
}

#[test]
fn a_program_without_motion_is_done_at_once() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("nothing.ngc", "G21 G90\nM2\n");
    let report = crate::support::run(bench.path(), &program).good_report();
    assert_eq!(text(&report, "/outcome/kind"), "completed");
}

#[test]
fn two_cells_on_one_pc_never_meet() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(10.0, 6000.0, (0.0, 0.0), 0.0));
    let alone = crate::support::run(bench.path(), &program).good_report();
    let first = LiveCell::start(bench.path(), &program, "lockstep");
    let second = LiveCell::start(bench.path(), &program, "lockstep");
    let (first, second) = (first.finish().good_report(), second.finish().good_report());
    assert_eq!(text(&alone, "/digest"), text(&first, "/digest"));
    assert_eq!(text(&alone, "/digest"), text(&second, "/digest"));
}

/// Memory of a process by these lines of its status, in kB.
fn memory_kb(pid: i32, kinds: &[&str]) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let of_kind = |line: &str| {
        let (kind, size) = line.split_once(':')?;
        kinds.contains(&kind).then_some(())?;
        size.split_whitespace().next()?.parse::<u64>().ok()
    };
    status.lines().filter_map(of_kind).sum()
}

#[test]
fn a_servo_has_under_20_mb_of_its_own_and_does_not_grow() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(25.0, 3000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(2000);
    let servos =
        ["quadrant servo --axis X", "quadrant servo --axis Y"].map(|role| cell.pid_of(role));
    // Without its program, which is in memory once for all processes.
    let own = |pid| memory_kb(pid, &["RssAnon", "RssShmem", "VmSwap"]);
    let early = servos.map(own);
    cell.wait_for_scan(6000);
    let late = servos.map(own);
    for (early, late) in early.into_iter().zip(late) {
        assert!(early > 0 && late < 20_000, "{late} kB");
        assert!(late <= early + 256, "grew from {early} to {late} kB");
    }
    // The rest of the program tells nothing about memory.
    cell.signal_launcher(libc::SIGINT);
    assert_eq!(cell.finish().status(), 130);
}
