//! Deaths and stalls in realtime, at no particular instant of a scan. What is asserted is counted in scans and states, for no
//! PC promises times. (The same at given scans, to the bit: `faults`. Hundreds of them: `soak`.)

use std::path::Path;
use std::time::Duration;

use bus::cell::CellPaths;
use bus::sample::Mode;
use bus::signal_page::SignalPage;

use crate::support::{
    Bench, LiveCell, Run, circle_program, number, quadrant, send, text, traces_of,
};

/// Four turns of 1.3 s each.
fn program() -> String {
    circle_program(10.0, 3000.0, (0.0, 0.0), 0.0)
}

const STANDBY: (&str, &str) = (
    "drive_mode = \"velocity\"",
    "drive_mode = \"velocity\"\nstandby = true",
);
const STALL: Duration = Duration::from_millis(200);

/// A cell in its first arc.
fn in_an_arc(edits: &[(&str, &str)]) -> (Bench, LiveCell) {
    let bench = Bench::patient("xy", edits);
    let program = bench.file("circle.ngc", &program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 10.0);
    (bench, cell)
}

/// Ended well, with no limit broken, on the path, and nothing left.
fn good(run: &Run) -> serde_json::Value {
    let report = run.good_report();
    assert_eq!(text(&report, "/outcome/kind"), "completed");
    for limit in ["velocity", "acceleration", "travel"] {
        let pointer = format!("/limits/{limit}_exceeded");
        assert_eq!(number(&report, &pointer), 0.0, "{report}");
    }
    assert!(
        traces_of(&run.cell).is_empty(),
        "{:?}",
        traces_of(&run.cell)
    );
    report
}

#[test]
fn a_planner_killed_while_nobody_replaces_it_leaves_the_tool_at_rest_on_the_path_until_somebody_does()
 {
    let (_bench, mut cell) = in_an_arc(&[]);
    // A launcher that is stopped replaces nobody: the machine comes to rest without its help.
    cell.signal_launcher(libc::SIGSTOP);
    send(cell.pid_of("quadrant planner"), libc::SIGKILL);
    let rests = cell.wait_for(|f| f.at_rest == 1);
    assert_eq!(rests.mode, Mode::Enabled as u32);
    assert!(!rests.window.is_none(), "a window is in force");
    assert!(!rests.tag.is_off_path());
    let stands = cell.wait_for_scan(rests.scan + 100);
    assert_eq!(stands.tag, rests.tag, "it stays where it came to rest");
    cell.signal_launcher(libc::SIGCONT);
    cell.wait_for(|f| f.at_rest == 0);
    let report = good(&cell.finish());
    assert_eq!(number(&report, "/processes/1/starts"), 2.0, "{report}");
}

#[test]
fn a_machine_whose_processes_are_all_stopped_for_200_ms_counts_the_scans_and_makes_up_for_none() {
    let (_bench, cell) = in_an_arc(&[]);
    let all = cell.children();
    let machine = cell.pid_of("quadrant plant-sim");
    send(machine, libc::SIGSTOP);
    all.iter().for_each(|(pid, _)| send(*pid, libc::SIGSTOP));
    std::thread::sleep(STALL);
    let others = all.iter().filter(|(pid, _)| *pid != machine);
    others.for_each(|(pid, _)| send(*pid, libc::SIGCONT));
    send(machine, libc::SIGCONT);
    let report = good(&cell.finish());
    assert!(number(&report, "/overrun_scans") >= 100.0, "{report}");
}

#[test]
fn a_master_that_is_stopped_for_200_ms_counts_the_scans_and_makes_up_for_none() {
    let (_bench, cell) = in_an_arc(&[]);
    let machine = cell.pid_of("quadrant plant-sim");
    send(machine, libc::SIGSTOP);
    std::thread::sleep(STALL);
    send(machine, libc::SIGCONT);
    let report = good(&cell.finish());
    assert!(number(&report, "/overrun_scans") >= 100.0, "{report}");
}

#[test]
fn a_servo_that_is_stopped_for_good_is_stood_in_for_and_then_killed_and_replaced() {
    let (_bench, mut cell) = in_an_arc(&[STANDBY]);
    send(
        cell.pid_of("quadrant servo --axis X --role a"),
        libc::SIGSTOP,
    );
    let taken = cell.wait_for(|f| f.axes[0].taken_role == 1);
    assert_eq!(taken.mode, Mode::Enabled as u32);
    let run = cell.finish();
    let report = good(&run);
    let stderr = run.stderr();
    assert!(
        stderr.contains("servo-X lives but does not answer: killed"),
        "{stderr}"
    );
    assert!(stderr.contains("servo-X restarted"), "{stderr}");
    let reaction = text(&report, "/faults/0/reaction");
    assert!(
        reaction.contains("none") || reaction.contains("standby took over"),
        "{reaction}"
    );
}

/// Whoever asks for the newest feedback gets at least the scan that any servo has answered: it is with every reader before
/// anybody is woken to answer it. So status is as old as the scan in progress, and that is at most a scan period.
#[test]
fn the_status_that_a_client_sees_is_never_behind_what_a_servo_has_answered() {
    let (_bench, mut cell) = in_an_arc(&[]);
    let (_bus, mut reader) = cell.feedback();
    let page = SignalPage::open(&CellPaths::new(&cell.cell).expect("a name")).expect("its page");
    // A reader is connected from its first look on.
    let first = loop {
        if let Some(feedback) = reader.newest(u64::MAX) {
            break feedback.scan;
        }
        std::thread::sleep(Duration::from_micros(300));
    };
    let mut newest = first;
    while newest < first + 500 {
        // Places 1 and 2 are the servos'; looked at before the feedback is asked for.
        let answered = [1, 2]
            .into_iter()
            .filter_map(|place| page.answered_scan(place))
            .max();
        newest = reader.newest(u64::MAX).map_or(newest, |f| f.scan);
        assert!(
            answered.is_some_and(|scan| scan <= newest),
            "{answered:?}, {newest}"
        );
        std::thread::sleep(Duration::from_micros(300));
    }
}

/// Processes whose command line names the cell.
fn processes_of(cell: &str) -> Vec<String> {
    let entries = std::fs::read_dir("/proc").expect("/proc").flatten();
    entries
        .filter_map(|entry| std::fs::read(entry.path().join("cmdline")).ok())
        .map(|line| String::from_utf8_lossy(&line).replace('\0', " "))
        .filter(|line| line.contains(&format!("--cell {cell} ")))
        .collect()
}

/// Another run of a cell whose launcher was killed: it works, and then there is neither process nor file.
fn runs_again_and_leaves_nothing(cell: &str, bench: &Bench, what: &str) {
    let program = bench.file("short.ngc", "G21 G90 G94\nG1 X1 F3000\nM2\n");
    let out = bench.path().join(format!("again-{what}"));
    let again = quadrant()
        .arg("run")
        .arg(bench.path())
        .arg(&program)
        .args(["--cell", cell, "--out"])
        .arg(&out)
        .output()
        .expect("running again");
    let stderr = String::from_utf8_lossy(&again.stderr);
    assert_eq!(again.status.code(), Some(0), "{what}: {stderr}");
    wait_until_nobody_is_left(cell);
    assert!(traces_of(cell).is_empty(), "{what}: {:?}", traces_of(cell));
}

fn wait_until_nobody_is_left(cell: &str) {
    for _ in 0..6000 {
        if processes_of(cell).is_empty() {
            return;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("still there: {:#?}", processes_of(cell));
}

#[test]
fn a_launcher_killed_while_it_replaces_a_process_leaves_nobody_and_the_cell_runs_again() {
    let (bench, mut cell) = in_an_arc(&[]);
    send(cell.pid_of("quadrant planner"), libc::SIGKILL);
    while !cell
        .children()
        .iter()
        .any(|(_, line)| line.contains("--incarnation 2"))
    {
        assert!(cell.child.try_wait().expect("the launcher").is_none());
    }
    cell.child.kill().expect("killing the launcher");
    cell.child.wait().expect("reaping it");
    runs_again_and_leaves_nothing(&cell.cell, &bench, "restart");
}

#[test]
fn a_launcher_killed_at_any_moment_of_its_start_leaves_a_cell_that_runs_again() {
    let strike = |moment: u64| {
        let bench = Bench::patient("xy", &[]);
        let program = bench.file("circle.ngc", &program());
        let mut cell = LiveCell::start(bench.path(), &program, "realtime");
        std::thread::sleep(Duration::from_micros(moment * 5_000));
        cell.child.kill().expect("killing the launcher");
        cell.child.wait().expect("reaping it");
        runs_again_and_leaves_nothing(&cell.cell, &bench, &format!("{}-ms", moment * 5));
    };
    // A few at a time: each waits for the members of the one that was killed.
    std::thread::scope(|scope| {
        for lane in 0..4 {
            scope.spawn(move || (0..3).for_each(|turn| strike(1 + lane + turn * 4)));
        }
    });
}

/// Kills the process of a role as soon as it is seen; what the launcher reported.
fn killed_at_birth(role: &str, machine: &Path, program: &Path) -> String {
    let cell = LiveCell::start(machine, program, "realtime");
    loop {
        let child = cell
            .children()
            .into_iter()
            .find(|(_, line)| line.contains(role));
        if let Some((pid, _)) = child {
            send(pid, libc::SIGKILL);
            break;
        }
    }
    let run = cell.finish();
    assert!(
        run.status() == 1 || run.status() == 3,
        "{role}: {}",
        run.stderr()
    );
    wait_until_nobody_is_left(&run.cell);
    assert!(
        traces_of(&run.cell).is_empty(),
        "{:?}",
        traces_of(&run.cell)
    );
    run.stderr()
}

#[test]
fn a_process_killed_while_the_cell_starts_is_a_start_that_failed_and_leaves_nothing() {
    // Should one of them be ready before it is struck, the run ends by its loss all the same.
    let restart = "[restart]\nplanner = \"end\"\nmonitor = \"leave\"\n\n[scan]\n";
    let bench = Bench::patient("xy", &[("[scan]\n", restart)]);
    let program = bench.file("circle.ngc", &program());
    let mut in_start = 0;
    for role in [
        "quadrant recorder",
        "quadrant servo --axis X",
        "quadrant planner",
        "quadrant plant-sim",
    ] {
        let printed = killed_at_birth(role, bench.path(), &program);
        in_start += u32::from(printed.contains("before it was ready"));
    }
    assert!(in_start > 0, "not one was struck while it started");
}

/// The machine does not wait long for a recorder that writes nothing any more, and nobody is taken for hung who has nothing left
/// to do.
#[test]
fn a_recorder_that_is_stopped_when_a_run_ends_is_waited_for_for_2_seconds() {
    let (_bench, cell) = in_an_arc(&[]);
    let recorder = cell.pid_of("quadrant recorder");
    send(recorder, libc::SIGSTOP);
    cell.signal_launcher(libc::SIGTERM);
    let asked = std::time::Instant::now();
    let machine_lives = || {
        let all = cell.children();
        all.iter().any(|(_, line)| line.contains("plant-sim"))
    };
    while machine_lives() {
        assert!(
            asked.elapsed() < Duration::from_secs(4),
            "the machine waits for a recorder that does nothing"
        );
        std::thread::sleep(Duration::from_millis(20));
    }
    send(recorder, libc::SIGCONT);
    let run = cell.finish();
    assert!(
        run.stderr().contains("recorder has stalled"),
        "{}",
        run.stderr()
    );
    assert!(
        !run.stderr().contains("does not answer"),
        "{}",
        run.stderr()
    );
    let lost = number(&run.report(), "/samples_lost");
    assert_eq!(lost, 0.0, "what was in its queue is in its log");
}
