//! Nothing hangs: whatever is killed, stopped or stuck, and however late, the machine comes to rest, the run ends within
//! moments, and what it says of its end is true. At no particular instant of a scan; in realtime, but where
//! something else is said.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::os::fd::{AsFd, AsRawFd};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

use bus::sample::{Mode, Waiting};

use crate::support::{
    Bench, LiveCell, Run, circle_program, endless_program, long_program, number, quadrant, send,
    text, traces_of,
};
use crate::tools::tool;
use crate::up::obeyed;

/// Moments, on a PC that does other things as well.
const MOMENTS: Duration = Duration::from_secs(13);

/// A master that is killed is replaced.
const REPLACED: (&str, &str) = ("[scan]\n", "[restart]\nmaster = \"wait\"\n\n[scan]\n");

fn cell_with(program: &str) -> (Bench, LiveCell) {
    let bench = Bench::patient("xy", &[REPLACED]);
    let program = bench.file("circle.ngc", program);
    let cell = LiveCell::start(bench.path(), &program, "realtime");
    (bench, cell)
}

/// A cell that waits at M0 half a second before the end of its program, until it is told to [`go_on`].
fn held_cell(bench: &Bench, pace: &str) -> LiveCell {
    let circles = circle_program(5.0, 3000.0, (0.0, 0.0), 0.0);
    let (before, last) = circles.rsplit_once("G2 ").expect("the last circle");
    let program = bench.file("circle.ngc", &format!("{before}M0\nG2 {last}"));
    let mut cell = LiveCell::start(bench.path(), &program, pace);
    cell.wait_for(|f| f.auxiliary.waiting == Waiting::ProgramStop as u32 && f.hold == 1);
    cell
}

fn go_on(cell: &LiveCell) {
    obeyed(cell, &["resume"]);
}

/// Fills a pipe, made as small as pipes can be, of which this is the reading end.
fn stuff(pipe: &impl AsFd) {
    rustix::pipe::fcntl_setpipe_size(pipe, 4096).expect("a small pipe");
    let path = format!("/proc/self/fd/{}", pipe.as_fd().as_raw_fd());
    let mut writing: File = OpenOptions::new()
        .write(true)
        .custom_flags(libc::O_NONBLOCK)
        .open(path)
        .expect("its writing end");
    while writing.write(b"x").is_ok() {}
}

/// Waits until the launcher has ended, without reading what it prints; how long it took.
fn ends(cell: &mut LiveCell) -> (i32, Duration) {
    let since = Instant::now();
    loop {
        if let Some(status) = cell.child.try_wait().expect("the launcher") {
            return (status.code().unwrap_or(-1), since.elapsed());
        }
        assert!(since.elapsed() < MOMENTS, "the run does not end");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn wait_until(what: &str, mut reached: impl FnMut() -> bool) {
    let since = Instant::now();
    while !reached() {
        assert!(since.elapsed() < MOMENTS, "{what}: it never came to that");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Ctrl-S, a hung ssh link: whoever reads what the launcher prints takes no more.
#[test]
fn output_that_nobody_takes_keeps_nobody_from_being_replaced_and_no_stop_from_being_obeyed() {
    let (_bench, mut cell) = cell_with(&long_program());
    stuff(cell.child.stdout.as_ref().expect("its output"));
    stuff(cell.child.stderr.as_ref().expect("its log"));
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 10.0);
    send(cell.pid_of("quadrant planner"), libc::SIGKILL);
    wait_until("another planner", || {
        let children = cell.children();
        let mut planners = children
            .iter()
            .filter(|(_, l)| l.contains("quadrant planner"));
        planners.any(|(_, line)| line.contains("--incarnation 2"))
    });
    // It works: the window that the first one left would have ended by then.
    let stands = cell.wait_for_scan(1).scan;
    let moves = cell.wait_for(|f| f.scan > stands + 1000 && f.at_rest == 0);
    assert_eq!(moves.hold, 0);
    cell.signal_launcher(libc::SIGTERM);
    let (status, took) = ends(&mut cell);
    assert_eq!(status, 130, "after {took:?}");
    let report = std::fs::read_to_string(cell.out.join("report.json")).expect("a report");
    assert!(report.contains("\"interrupted\""), "{report}");
}

/// The master stays after its last feedback until the recorder has it: a recorder that is stopped for a moment keeps it there.
#[test]
fn a_master_killed_after_its_last_feedback_is_not_missed() {
    let bench = Bench::patient("xy", &[REPLACED]);
    let mut cell = held_cell(&bench, "realtime");
    let recorder = cell.pid_of("quadrant recorder");
    send(recorder, libc::SIGSTOP);
    go_on(&cell);
    cell.wait_for(|f| f.last == 1);
    send(cell.pid_of("quadrant plant-sim"), libc::SIGKILL);
    let since = Instant::now();
    send(recorder, libc::SIGCONT);
    let run = cell.finish();
    assert!(since.elapsed() < MOMENTS, "{}", run.stderr());
    let report = run.good_report();
    assert_eq!(text(&report, "/outcome/kind"), "completed");
    assert!(!run.stderr().contains("restarted"), "{}", run.stderr());
    assert!(
        traces_of(&run.cell).is_empty(),
        "{:?}",
        traces_of(&run.cell)
    );
}

/// A recorder that nobody continues is not waited for as one that has much to write.
#[test]
fn a_recorder_that_is_stopped_for_good_at_the_end_is_ended_and_the_run_is_done_without_its_last_scans()
 {
    let bench = Bench::patient("xy", &[REPLACED]);
    let mut cell = held_cell(&bench, "realtime");
    send(cell.pid_of("quadrant recorder"), libc::SIGSTOP);
    go_on(&cell);
    cell.wait_for(|f| f.last == 1);
    let (status, _) = ends(&mut cell);
    let run = cell.finish();
    assert_eq!(status, 1, "{}", run.stderr());
    let report = run.report();
    assert_eq!(text(&report, "/outcome/kind"), "completed");
    let ended = std::fs::read_to_string(run.out.join("ended.json")).expect("its end");
    let ended: serde_json::Value = serde_json::from_str(&ended).expect("JSON");
    let missing = report["missing_scans"].as_array().expect("missing scans");
    let to = missing.last().map(|gap| &gap["last"]);
    assert_eq!(to, Some(&ended["scan"]), "{}", run.stderr());
}

/// The master waits for a recorder whose queue is full, and does not see that it dies and another one comes: that one never gets
/// what was published before.
#[test]
fn in_lockstep_a_master_waits_for_no_recorder_that_has_been_replaced_meanwhile() {
    let bench = Bench::of("xy", &[]);
    let cell = held_cell(&bench, "lockstep");
    let (recorder, master) = (
        cell.pid_of("quadrant recorder"),
        cell.pid_of("quadrant plant-sim"),
    );
    send(recorder, libc::SIGSTOP);
    std::thread::sleep(Duration::from_millis(500));
    send(master, libc::SIGSTOP);
    send(recorder, libc::SIGKILL);
    wait_until("another recorder", || {
        let mut lines = cell.children().into_iter().map(|(_, line)| line);
        lines.any(|line| line.contains("quadrant recorder") && line.contains("--incarnation 2"))
    });
    // It has its ports, and is in the roster.
    std::thread::sleep(Duration::from_millis(500));
    send(master, libc::SIGCONT);
    go_on(&cell);
    let since = Instant::now();
    let run = cell.finish();
    assert!(since.elapsed() < MOMENTS, "{}", run.stderr());
    assert_eq!(run.status(), 0, "{}", run.stderr());
}

/// A servo that is stopped before it has connected to the master never gets its last feedback.
#[test]
fn a_process_that_misses_the_last_feedback_holds_up_no_run() {
    let (_bench, mut cell) = cell_with(&long_program());
    let servo = loop {
        let mut children = cell.children().into_iter();
        if let Some((pid, _)) = children.find(|(_, line)| line.contains("quadrant servo --axis X"))
        {
            break pid;
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    // A reader that is there before has the last feedback also when the cell is gone.
    let (_bus, mut feedback) = cell.feedback();
    wait_until("a feedback", || feedback.newest(u64::MAX).is_some());
    send(servo, libc::SIGSTOP);
    cell.signal_launcher(libc::SIGTERM);
    let (status, took) = ends(&mut cell);
    send(servo, libc::SIGCONT);
    let last = feedback.newest(u64::MAX).expect("a feedback");
    assert_eq!(last.last, 1, "{last:?}");
    assert!(took < Duration::from_millis(5500), "{took:?}");
    assert!(matches!(status, 1 | 130), "{status}");
}

/// Whoever drops a roster because it was not what was sent, gets it again.
#[test]
fn the_roster_is_said_again_and_again() {
    let (_bench, mut cell) = cell_with(&long_program());
    let (bus, _feedback) = cell.feedback();
    let mut rosters = bus.roster_reader(16).expect("a reader");
    let mut versions = Vec::new();
    wait_until("a roster that says the same", || {
        versions.extend(rosters.any().map(|roster| roster.version));
        let said = |version: &u64| versions.iter().filter(|v| *v == version).count();
        versions.iter().any(|version| said(version) > 2)
    });
}

/// Who has ordered a run to end is told that it comes to rest. One that was brought on again would be ended in motion, 15 s later.
#[test]
fn a_run_that_is_ended_by_ctrl_c_is_not_brought_on_by_another_terminal() {
    // It rests for 3 s before it ends.
    let rests = ("[scan]\n", "[scan]\nsettle_scans = 3000\n");
    let bench = Bench::patient("xy", &[rests]);
    let program = bench.file("circle.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 10.0);
    cell.signal_launcher(libc::SIGINT);
    cell.wait_for(|f| f.mode == Mode::Stopped as u32);
    for order in ["resume", "enable"] {
        let refused = quadrant()
            .args([order, "--cell", &cell.cell])
            .output()
            .expect("quadrant");
        let why = String::from_utf8_lossy(&refused.stderr);
        assert_eq!(refused.status.code(), Some(1), "{order}: {why}");
        assert!(why.contains("about to end"), "{order}: {why}");
    }
    let run = cell.finish();
    assert_eq!(run.status(), 130, "{}", run.stderr());
}

/// A launcher that is stopped for a moment finds both when it goes on: the master dead, and the order to stop.
#[test]
fn a_stop_that_comes_while_the_master_is_being_replaced_is_obeyed() {
    let (_bench, mut cell) = cell_with(&long_program());
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 10.0);
    cell.signal_launcher(libc::SIGSTOP);
    send(cell.pid_of("quadrant plant-sim"), libc::SIGKILL);
    cell.signal_launcher(libc::SIGTERM);
    cell.signal_launcher(libc::SIGCONT);
    let since = Instant::now();
    let run = cell.finish();
    let stderr = run.stderr();
    assert!(since.elapsed() < MOMENTS, "{stderr}");
    assert!(!stderr.contains("not at rest"), "{stderr}");
    assert!(stderr.contains("plant-sim restarted"), "{stderr}");
    // The machine was without a master for a moment: that is how it ended, and not as the stop alone would have.
    assert_eq!(run.status(), 1, "{stderr}");
    assert!(
        traces_of(&run.cell).is_empty(),
        "{:?}",
        traces_of(&run.cell)
    );
}

/// What the report says is missing at the end of the log, which has this last scan.
fn missing_at_the_end(run: &Run) -> (f64, f64, f64) {
    let report = run.report();
    let parts = report.pointer("/parts").and_then(|p| p.as_array());
    let parts = parts.expect("parts").iter();
    let reached = parts.filter_map(|part| part["last_scan"].as_f64());
    let gaps = report.pointer("/missing_scans").and_then(|p| p.as_array());
    let last = gaps.and_then(|gaps| gaps.last()).expect("a gap");
    assert!(number(&report, "/samples_lost") > 0.0);
    let scan = |key: &str| last[key].as_f64().expect("a scan");
    (reached.fold(-1.0, f64::max), scan("first"), scan("last"))
}

/// A launcher that is stopped for a moment replaces nobody before the run is over.
#[test]
fn a_recorder_killed_in_the_last_moments_holds_up_nothing_and_the_report_says_what_is_missing() {
    let bench = Bench::patient("xy", &[REPLACED]);
    let mut cell = held_cell(&bench, "realtime");
    cell.signal_launcher(libc::SIGSTOP);
    send(cell.pid_of("quadrant recorder"), libc::SIGKILL);
    go_on(&cell);
    let last = cell.wait_for(|f| f.last == 1).scan as f64;
    cell.signal_launcher(libc::SIGCONT);
    let since = Instant::now();
    let run = cell.finish();
    assert!(since.elapsed() < MOMENTS, "{}", run.stderr());
    let (reached, first, to) = missing_at_the_end(&run);
    assert_eq!((first, to), (reached + 1.0, last), "{}", run.stderr());
}

/// Stops each process that this one starts before it has done anything; a test that looks for it could come too late. None where nobody may
/// trace.
fn stop_each_that_is_born(launcher: u32) -> Option<std::process::Child> {
    let mut trace = std::process::Command::new(tool("strace")?);
    trace.args(["-qq", "-f", "-o", "/dev/null", "-e", "trace=execve"]);
    trace.args(["-e", "inject=execve:signal=STOP"]);
    let mut tracer = trace.args(["-p", &launcher.to_string()]).spawn().ok()?;
    let is_traced = || {
        let status = std::fs::read_to_string(format!("/proc/{launcher}/status"));
        status.is_ok_and(|status| !status.contains("TracerPid:\t0\n"))
    };
    while !is_traced() {
        if tracer.try_wait().expect("strace").is_some() {
            eprintln!("strace may not trace a process here: the check is left out");
            return None;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    Some(tracer)
}

/// Whether a process is stopped.
fn is_stopped(pid: i32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let state = stat.rsplit_once(") ").map(|(_, rest)| rest.to_owned());
    state.is_some_and(|state| state.starts_with(['T', 't']))
}

/// It comes when there is nothing left to record: the last feedback, for which it would wait, has been.
#[test]
fn a_recorder_that_comes_too_late_for_the_last_feedback_is_not_waited_for() {
    let bench = Bench::patient("xy", &[REPLACED]);
    let mut cell = held_cell(&bench, "realtime");
    let Some(mut tracer) = stop_each_that_is_born(cell.child.id()) else {
        return;
    };
    send(cell.pid_of("quadrant recorder"), libc::SIGKILL);
    let mut second = None;
    wait_until("another recorder, which has done nothing", || {
        let children = cell.children();
        let born = children
            .iter()
            .find(|(_, l)| l.contains("quadrant recorder") && l.contains("--incarnation 2"));
        second = born.map(|(pid, _)| *pid).filter(|pid| is_stopped(*pid));
        second.is_some()
    });
    let second = second.expect("it was seen");
    // It stays stopped when it is let go.
    send(second, libc::SIGSTOP);
    send(tracer.id() as i32, libc::SIGTERM);
    tracer.wait().expect("strace");
    go_on(&cell);
    let last = cell.wait_for(|f| f.last == 1).scan as f64;
    wait_until("the master leaves", || {
        let children = cell.children();
        !children
            .iter()
            .any(|(_, l)| l.contains("quadrant plant-sim"))
    });
    send(second, libc::SIGCONT);
    let since = Instant::now();
    let run = cell.finish();
    assert!(since.elapsed() < MOMENTS, "{}", run.stderr());
    assert_eq!(run.status(), 0, "{}", run.stderr());
    let (reached, first, to) = missing_at_the_end(&run);
    assert_eq!((first, to), (reached + 1.0, last), "{}", run.stderr());
}

/// Nobody reports the death of a recorder whose launcher has gone: the master waits for it a moment, once, and not in every scan.
#[test]
fn in_lockstep_a_recorder_that_is_gone_with_its_launcher_keeps_nobody_waiting() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("endless.ngc", &endless_program());
    let mut cell = LiveCell::start(bench.path(), &program, "lockstep");
    cell.wait_for(|f| f.at_rest == 0 && f.tag.element >= 2);
    let recorder = cell.pid_of("quadrant recorder");
    let mut others = cell.children();
    others.retain(|(pid, _)| *pid != recorder);
    send(recorder, libc::SIGSTOP);
    // The rest of its queue fills: the master waits for it now.
    std::thread::sleep(Duration::from_millis(500));
    cell.signal_launcher(libc::SIGKILL);
    send(recorder, libc::SIGKILL);
    let began = Instant::now();
    let lives = |pid: i32| Path::new(&format!("/proc/{pid}")).exists();
    while others.iter().any(|(pid, _)| lives(*pid)) {
        assert!(began.elapsed() < Duration::from_secs(3), "{others:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
    let name = cell.cell.clone();
    cell.finish();
    let cleaned = quadrant().args(["clean", &name]).output().expect("clean");
    assert!(cleaned.status.success());
    assert!(traces_of(&name).is_empty());
}
