//! Observers: what they show, and that nobody in the cell notices them.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::os::fd::FromRawFd;
use std::process::{Child, Stdio};

use serde_json::Value;

use crate::size;
use crate::support::{
    Bench, LiveCell, Run, circle_program, long_alone, long_program, quadrant, send, text,
};

/// Children that look on; dropping them ends them.
struct Monitors(Vec<Child>);

impl Drop for Monitors {
    fn drop(&mut self) {
        for child in &mut self.0 {
            send(child.id() as i32, libc::SIGCONT);
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Runs circles in lockstep with so many monitors, the last of which is stopped in the middle and stays so; also the lines of the
/// first.
fn watched(count: usize) -> (Run, Vec<Value>) {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("circle.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "lockstep");
    cell.wait_for_scan(1);
    let lines = |index: usize| bench.path().join(format!("lines-{index}.jsonl"));
    let mut monitors = Monitors(Vec::new());
    for index in 0..count {
        let file = File::create(lines(index)).expect("a file");
        let child = quadrant()
            .args(["monitor", "--json", "--cell", &cell.cell])
            .stdout(file)
            .stderr(Stdio::null())
            .spawn()
            .expect("a monitor");
        monitors.0.push(child);
    }
    let printed = |index: usize| -> usize {
        let file = File::open(lines(index)).expect("its file");
        BufReader::new(file).lines().count()
    };
    if let Some(last) = monitors.0.last() {
        // It has its queues by then; from now on nobody empties them.
        while printed(count - 1) < 2 {
            assert!(
                matches!(cell.child.try_wait(), Ok(None)),
                "the run was over before its monitors printed anything"
            );
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        if count > 1 {
            send(last.id() as i32, libc::SIGSTOP);
        }
    }
    let run = cell.finish();
    drop(monitors);
    let file = File::open(lines(0)).expect("its file");
    let each = BufReader::new(file).lines().map_while(Result::ok);
    // The last one may have been cut off.
    let lines = each.filter_map(|line| serde_json::from_str(&line).ok());
    (run, lines.collect())
}

#[test]
fn monitors_and_one_of_them_that_is_stopped_change_no_bit_of_the_motion() {
    let digest = text(long_alone(), "/motion_digest");
    let whole = text(long_alone(), "/digest");
    for count in size::one_in(2, [4, 1]) {
        let (run, lines) = watched(count);
        assert_eq!(
            text(&run.good_report(), "/motion_digest"),
            digest,
            "{count}"
        );
        assert_eq!(text(&run.good_report(), "/digest"), whole, "{count}");
        let last = lines.last().expect("the first monitor printed something");
        assert_eq!(last["cell"], run.cell.as_str());
        assert_eq!(last["program"]["name"], "circle.ngc", "{last}");
        assert_eq!(
            last["processes"].as_array().map(Vec::len),
            Some(5),
            "{last}"
        );
        assert!(last["circle"]["radius_mm"] == 25.0, "{last}");
        let heights = lines.iter().flat_map(|line| {
            let reversals = line["reversals"].as_array().cloned().unwrap_or_default();
            reversals
                .into_iter()
                .filter_map(|r| r["height_um"].as_f64())
        });
        assert!(heights.count() > 0, "no reversal was seen whole");
    }
}

#[test]
fn status_of_a_realtime_cell_names_state_axes_and_processes() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(1500);
    let look = |more: &[&str]| {
        let output = quadrant()
            .args(["status", "--cell", &cell.cell])
            .args(more)
            .output()
            .expect("status");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        String::from_utf8(output.stdout).expect("text")
    };
    let status: Value = serde_json::from_str(&look(&["--json"])).expect("JSON");
    let plain = look(&[]);
    let screen = {
        let output = quadrant()
            .args(["monitor", "--once", "--cell", &cell.cell])
            .output();
        String::from_utf8(output.expect("a screen").stdout).expect("text")
    };
    let planner = cell.pid_of(" planner ");
    drop(cell);
    assert_eq!(status["pace"], "realtime", "{status}");
    assert_eq!(status["mode"], "enabled");
    assert_eq!(status["override_percent"], 100);
    assert_eq!(status["hold"], false);
    assert!(status["cause"].is_null());
    assert!(status["scan"].as_u64() >= Some(1500));
    assert!(status["program"]["line"].as_u64() >= Some(2), "{status}");
    assert!(status["program"]["percent"].as_f64() > Some(0.0));
    let names = |list: &str, key: &str| -> Vec<String> {
        let list = status[list].as_array().expect("a list").iter();
        list.map(|entry| entry[key].as_str().unwrap_or_default().to_string())
            .collect()
    };
    assert_eq!(names("axes", "axis"), ["X", "Y"]);
    let processes = ["monitor", "servo-X", "servo-Y", "planner", "plant-sim"];
    assert_eq!(names("processes", "process"), processes);
    let axis = &status["axes"][0];
    for key in [
        "command_mm",
        "feedback_mm",
        "following_error_um",
        "torque_nm",
    ] {
        assert!(axis[key].is_f64(), "{key}: {axis}");
    }
    assert_eq!(axis["servo"], "a");
    assert_eq!(axis["missed_scans"].as_u64().map(|_| ()), Some(()));
    assert_eq!(status["processes"][3]["pid"], planner);
    assert_eq!(status["processes"][3]["starts"], 1);
    assert_eq!(status["processes"][3]["live"], true);
    assert!(
        plain.contains("RUNS") && plain.contains("servo-Y"),
        "{plain}"
    );
    assert!(
        screen.contains("▶ RUNS") && screen.lines().count() == 24,
        "{screen}"
    );
}

/// Standing in for a monitor that was stopped with its cell and goes on in the next one of that name.
#[test]
fn a_monitor_that_wakes_in_the_next_cell_of_its_name_takes_nothing_away_from_it() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &long_program());
    let mut first = LiveCell::start(bench.path(), &program, "realtime");
    first.wait_for_scan(200);
    let name = first.cell.clone();
    let printed = bench.path().join("lines.jsonl");
    let child = quadrant()
        .args(["monitor", "--json", "--cell", &name])
        .stdout(File::create(&printed).expect("a file"))
        .stderr(Stdio::null())
        .spawn()
        .expect("a monitor");
    let monitors = Monitors(vec![child]);
    while std::fs::metadata(&printed).map_or(0, |file| file.len()) == 0 {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let pid = monitors.0.first().expect("one").id() as i32;
    send(pid, libc::SIGSTOP);
    first.signal_launcher(libc::SIGINT);
    first.finish();
    let mut second = LiveCell::start_as(&name, bench.path(), &program, "realtime", &[]);
    second.wait_for_scan(200);
    send(pid, libc::SIGCONT);
    let mut monitors = monitors;
    let ended = monitors.0.first_mut().expect("one").wait();
    assert_eq!(ended.expect("it ends").code(), Some(0));
    // Every service can still be opened: a servo that is lost is replaced, an observer sees it all.
    let status = quadrant()
        .args(["status", "--json", "--cell", &name])
        .output()
        .expect("status");
    assert_eq!(status.status.code(), Some(0), "{status:?}");
    let status: Value = serde_json::from_slice(&status.stdout).expect("JSON");
    assert!(status["axes"][1]["following_error_um"].is_f64(), "{status}");
    drop(second);
}

#[test]
fn where_no_cell_runs_that_is_said_with_status_1() {
    for command in ["status", "monitor"] {
        let output = quadrant()
            .args([command, "--cell", "nobody-here"])
            .output()
            .expect("it ends");
        assert_eq!(output.status.code(), Some(1));
        let printed = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            printed.contains("cell \"nobody-here\" does not run"),
            "{printed}"
        );
    }
}

#[test]
fn a_monitor_that_comes_and_goes_again_and_again_leaves_no_trace() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(25.0, 3000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(1);
    for time in 0..size::number("TIMES", 10, 30) {
        let output = quadrant()
            .args(["status", "--json", "--cell", &cell.cell])
            .output()
            .expect("status");
        assert_eq!(output.status.code(), Some(0), "time {time}: {output:?}");
    }
    let run = cell.finish();
    run.good_report();
    assert_eq!(crate::support::traces_of(&run.cell), Vec::<String>::new());
}

/// A terminal of 80 × 24: our end, and that of the program in it.
pub(crate) fn terminal() -> (File, File) {
    let (mut master, mut slave) = (-1, -1);
    // SAFETY: plain system calls; both descriptors are owned by what is made of them.
    unsafe {
        let size = libc::winsize {
            ws_row: 24,
            ws_col: 80,
            ws_xpixel: 0,
            ws_ypixel: 0,
        };
        let null = std::ptr::null_mut();
        let made = libc::openpty(&mut master, &mut slave, null, std::ptr::null(), &size);
        assert_eq!(made, 0, "a terminal");
        (File::from_raw_fd(master), File::from_raw_fd(slave))
    }
}

#[test]
fn a_run_with_a_view_shows_it_meanwhile_and_then_its_report() {
    let bench = Bench::patient("xy", &[]);
    let turns = circle_program(10.0, 3000.0, (0.0, 0.0), 0.0);
    let program = bench.file("circle.ngc", &turns);
    let (mut ours, screen) = terminal();
    let cell = crate::support::unique_cell();
    let mut run = quadrant()
        .arg("run")
        .args([bench.path(), program.as_path()])
        .args(["--pace", "realtime", "--view", "--cell", &cell, "--out"])
        .arg(bench.path().join("out"))
        .stdin(screen.try_clone().expect("a descriptor"))
        .stdout(screen.try_clone().expect("a descriptor"))
        .stderr(screen)
        .spawn()
        .expect("the run");
    let reader = std::thread::spawn(move || {
        let (mut shown, mut piece) = (Vec::new(), [0; 4096]);
        while let Ok(count @ 1..) = ours.read(&mut piece) {
            shown.extend_from_slice(&piece[..count]);
        }
        String::from_utf8_lossy(&shown).into_owned()
    });
    let status = run.wait().expect("the run");
    let shown = reader.join().expect("what was shown");
    assert!(status.success(), "{shown}");
    let (view, report) = (shown.find("RUNS"), shown.find("COMPLETED"));
    assert!(view.is_some() && view < report, "{shown}");
    assert!(crate::support::traces_of(&cell).is_empty());
}

#[test]
fn a_view_without_a_terminal_is_refused_before_anything_starts() {
    let printed = quadrant()
        .args([
            "run",
            "machines/xy",
            "machines/xy/programs/circle-r25-f3000.ngc",
            "--view",
        ])
        .output()
        .expect("the command");
    assert_eq!(printed.status.code(), Some(2));
    let words = String::from_utf8_lossy(&printed.stderr).into_owned();
    assert!(words.contains("--view: needs a terminal"), "{words}");
}

/// A terminal that was closed, then a word to leave: the view must not read the terminal's end for ever.
#[test]
fn a_monitor_whose_terminal_has_gone_leaves_when_it_is_reported_to() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("long.ngc", &long_program());
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(50);
    let (terminal, screen) = terminal();
    let mut view = quadrant()
        .args(["monitor", "--cell", &cell.cell])
        .stdin(screen.try_clone().expect("a descriptor"))
        .stdout(screen.try_clone().expect("a descriptor"))
        .stderr(screen)
        .spawn()
        .expect("the monitor");
    let scan = cell.wait_for_scan(0).scan;
    cell.wait_for_scan(scan + 500);
    drop(terminal);
    cell.wait_for_scan(scan + 800);
    send(view.id() as i32, libc::SIGTERM);
    let left = (0..400).any(|_| {
        std::thread::sleep(std::time::Duration::from_millis(25));
        view.try_wait().expect("the monitor").is_some()
    });
    if !left {
        send(view.id() as i32, libc::SIGKILL);
        let _ = view.wait();
    }
    assert!(left, "it goes on without a terminal");
}
