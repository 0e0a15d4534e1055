//! The sender of a continuous jog is killed, stopped or interrupted: the axis comes to rest, and nothing that it asked for acts later.

use std::io::Write as _;
use std::process::{Child, Output, Stdio};
use std::time::Duration;

use bus::sample::{Cause, Feedback, Mode, ProgramState};

use crate::support::{Bench, LiveCell, quadrant, send};
use crate::up::{ask, is, obeyed, refused, up};

const SPEED_MM_S: f64 = 20.0;
/// 200 ms of scans, four until an order is looked at, and what is looked ahead before an axis brakes.
const SILENT_SCANS: f64 = 200.0 + 4.0 + 130.0;
/// A fifth of 5000 mm/s².
const BRAKING_MM_S2: f64 = 1000.0;

fn x_mm(feedback: &Feedback) -> f64 {
    feedback.axes[0].command_position as f64 * 1e-6
}

fn sender(cell: &LiveCell) -> Child {
    let speed = (SPEED_MM_S * 60.0).to_string();
    quadrant()
        .args(["jog", "X+", "--speed", &speed, "--cell", &cell.cell])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("a sender")
}

/// A sender whose axis moves. On a PC that gives it no time for 0.2 s its jog ends, as it is to: then there is another one.
fn moving(cell: &mut LiveCell) -> Child {
    loop {
        let mut sender = sender(cell);
        let from_mm = x_mm(&cell.wait_for(|_| true));
        let jogs = |f: &Feedback| f.mode == Mode::Jogging as u32;
        loop {
            let now = cell.wait_for(|_| true);
            if jogs(&now) && x_mm(&now) > from_mm + 0.2 {
                return sender;
            }
            if sender.try_wait().expect("the sender").is_some() {
                break;
            }
        }
    }
}

fn rest(cell: &mut LiveCell) -> Feedback {
    cell.wait_for(|f| is(f, Mode::Ready, ProgramState::None))
}

fn printed(sender: Child) -> (i32, String) {
    let Output {
        status,
        stdout,
        stderr,
    } = sender.wait_with_output().expect("its end");
    let text = String::from_utf8_lossy(&[stdout, stderr].concat()).into_owned();
    (status.code().unwrap_or(-1), text)
}

/// Nothing moves any more.
fn stays(cell: &mut LiveCell, rest: &Feedback) {
    let later = cell.wait_for_scan(rest.scan + 600);
    assert_eq!(x_mm(&later), x_mm(rest));
    assert!(is(&later, Mode::Ready, ProgramState::None));
}

#[test]
fn a_jog_whose_sender_is_killed_or_stopped_comes_to_rest_and_stays_there() {
    let (_bench, mut cell, ..) = up("realtime");
    obeyed(&cell, &["enable"]);
    for signal in [libc::SIGKILL, libc::SIGSTOP] {
        let jogging = moving(&mut cell);
        send(jogging.id() as i32, signal);
        let at = cell.wait_for(|_| true);
        let rest = rest(&mut cell);
        let braking_mm = SPEED_MM_S * SPEED_MM_S / (2.0 * BRAKING_MM_S2);
        let most_mm = SPEED_MM_S * 1e-3 * SILENT_SCANS + braking_mm + 0.01;
        let way_mm = x_mm(&rest) - x_mm(&at);
        assert!(
            way_mm <= most_mm,
            "{way_mm} mm after its death, of {most_mm}"
        );
        send(jogging.id() as i32, libc::SIGCONT);
        let (status, text) = printed(jogging);
        if signal == libc::SIGSTOP {
            assert_eq!(status, 1, "{text}");
            assert!(text.contains("not renewed in time"), "{text}");
        }
        stays(&mut cell, &rest);
        next_is_exact(&mut cell);
    }
    obeyed(&cell, &["down"]);
}

/// The next increment ends exactly at its distance from where the command was.
fn next_is_exact(cell: &mut LiveCell) {
    let from = rest(cell).axes[0].command_position;
    obeyed(cell, &["jog", "X", "-0.251", "--wait"]);
    assert_eq!(rest(cell).axes[0].command_position, from - 251_000);
}

/// How far an increment is when somebody is killed.
#[derive(Debug, Clone, Copy)]
enum Step {
    /// So many scans after its client was started.
    Scans(u64),
    Moves,
    Done,
}

impl Step {
    fn wait(self, cell: &mut LiveCell, began: &Feedback, end: i64) {
        let from = began.axes[0].command_position;
        match self {
            Step::Scans(scans) => cell.wait_for_scan(began.scan + scans),
            Step::Moves => cell.wait_for(|f| f.axes[0].command_position != from),
            Step::Done => cell.wait_for(|f| f.axes[0].command_position == end),
        };
    }
}

fn increment(cell: &LiveCell, distance_mm: &str) -> Child {
    quadrant()
        .args(["jog", "X", distance_mm, "--wait", "--cell", &cell.cell])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("a client")
}

#[test]
fn an_increment_whose_client_is_killed_is_carried_out_whole_or_not_at_all_and_the_next_one_is_exact()
 {
    let (_bench, mut cell, ..) = up("lockstep");
    obeyed(&cell, &["enable"]);
    let mut steps: Vec<Step> = [0, 1, 20, 60, 150].map(Step::Scans).into();
    steps.extend([Step::Moves, Step::Done]);
    for step in steps {
        let began = rest(&mut cell);
        let from = began.axes[0].command_position;
        let end = from + 3_001_007;
        let mut client = increment(&cell, "3.001007");
        step.wait(&mut cell, &began, end);
        client.kill().expect("killing the client");
        client.wait().expect("reaping it");
        // What it has asked for is judged by then.
        let killed = cell.wait_for(|_| true).scan;
        cell.wait_for_scan(killed + 100);
        let at = rest(&mut cell).axes[0].command_position;
        let may_be = match step {
            Step::Scans(_) => &[from, end][..],
            Step::Moves | Step::Done => &[end],
        };
        assert!(may_be.contains(&at), "{step:?}: {at} from {from}");
        next_is_exact(&mut cell);
        obeyed(&cell, &["jog", "X", "-2", "--wait"]);
    }
    obeyed(&cell, &["down"]);
}

#[test]
fn a_cell_whose_launcher_is_killed_in_a_jog_comes_to_rest_says_so_and_jogs_again_when_it_is_up_again()
 {
    let (bench, mut cell, ..) = up("lockstep");
    for (step, distance_mm) in [
        (Step::Scans(0), "40"),
        (Step::Moves, "40"),
        (Step::Done, "1"),
    ] {
        obeyed(&cell, &["enable"]);
        let began = rest(&mut cell);
        let from = began.axes[0].command_position;
        let end = from + distance_mm.parse::<i64>().expect("mm") * 1_000_000;
        // Who reads before has the last feedback also when the cell is gone.
        let (bus, mut feedback) = cell.feedback();
        let client = increment(&cell, distance_mm);
        step.wait(&mut cell, &began, end);
        cell.signal_launcher(libc::SIGKILL);
        let (status, text) = printed(client);
        let name = cell.cell.clone();
        let children = cell.children();
        drop(cell.finish());
        let lives = |pid: &i32| std::path::Path::new(&format!("/proc/{pid}")).exists();
        while children.iter().any(|(pid, _)| lives(pid)) {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let mut last = began;
        while let Some(newer) = feedback.newest(u64::MAX) {
            last = newer;
        }
        drop((feedback, bus));
        let at = last.axes[0].command_position;
        assert!((from..=end).contains(&at), "{step:?}: {at} from {from}");
        // A jog that the end of the cell cuts short is not said to be done.
        let is_done = status == 0 && text.contains("jogged\n");
        match step {
            Step::Done => assert!(is_done || text.contains("has ended"), "{text}"),
            Step::Scans(_) | Step::Moves => assert!(status != 0, "{step:?}: {text}"),
        }
        let next = quadrant().args(["jog", "X", "1", "--cell", &name]).output();
        let said = String::from_utf8_lossy(&next.expect("the command").stderr).into_owned();
        assert!(said.contains("does not run"), "{said}");
        cell = LiveCell::up_as(&name, bench.path(), "lockstep");
        cell.wait_for(|_| true);
        obeyed(&cell, &["enable"]);
        next_is_exact(&mut cell);
        obeyed(&cell, &["disable"]);
    }
    obeyed(&cell, &["down"]);
}

#[test]
fn control_c_ends_a_jog_well_and_hold_ends_it_from_elsewhere() {
    let (_bench, mut cell, ..) = up("realtime");
    obeyed(&cell, &["enable"]);
    let jogging = moving(&mut cell);
    send(jogging.id() as i32, libc::SIGINT);
    let (_, text) = printed(jogging);
    assert!(text.contains("X is at rest at"), "{text}");
    let at = rest(&mut cell);
    stays(&mut cell, &at);

    let jogging = moving(&mut cell);
    let held = obeyed(&cell, &["hold"]);
    let (status, text) = printed(jogging);
    assert_eq!(status, 1, "{text}");
    assert!(text.contains("X is at rest at"), "{text}");
    let at = rest(&mut cell);
    let stands = format!(
        "hold: the jog comes to rest: X will stand at {:.3} mm",
        x_mm(&at)
    );
    // On a PC that gave the sender no time, the jog was over before.
    let was_over = held.contains("nothing moves");
    assert!(was_over || held.contains(&stands), "{held}: {stands}");
    obeyed(&cell, &["resume"]);
    obeyed(&cell, &["down"]);
}

/// `quadrant wheel` with these lines, 10 ms apart; what it says.
fn wheel(cell: &LiveCell, options: &[&str], lines: impl Iterator<Item = String>) -> (i32, String) {
    let mut wheel = quadrant()
        .args(["wheel", "X", "0.01", "--cell", &cell.cell])
        .args(options)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("a wheel");
    let mut stdin = wheel.stdin.take().expect("its input");
    for line in lines {
        // One that has ended reads no more.
        let _ = writeln!(stdin, "{line}");
        std::thread::sleep(Duration::from_millis(10));
    }
    drop(stdin);
    printed(wheel)
}

/// Counts that were taken, and those that were not.
fn said_counts(text: &str) -> (i64, i64) {
    let numbers = text.split_whitespace().filter_map(|word| word.parse().ok());
    match numbers.collect::<Vec<i64>>()[..] {
        [taken, not, ..] => (taken, not),
        _ => panic!("no counts: {text}"),
    }
}

#[test]
fn a_wheel_on_standard_input_moves_its_axis_to_where_its_counts_say_and_what_was_taken_is_said() {
    let (_bench, mut cell, ..) = up("realtime");
    let turning = || (0..60).map(|count| count.to_string());
    // Counts that come while the drives are off move nothing, and it says why.
    let from_mm = x_mm(&cell.wait_for(|_| true));
    let (status, text) = wheel(&cell, &[], turning());
    assert_eq!(status, 0, "{text}");
    assert!(
        text.contains("counts are not taken: the drives are off"),
        "{text}"
    );
    assert!(text.contains("0 counts taken, 59 not"), "{text}");
    obeyed(&cell, &["enable"]);
    assert_eq!(
        x_mm(&cell.wait_for(|f| is(f, Mode::Ready, ProgramState::None))),
        from_mm
    );
    for (options, sign) in [(&[][..], 1), (&["--velocity"], -1)] {
        let from_mm = x_mm(&rest(&mut cell));
        let lines = (0..60).map(|count| (sign * count).to_string());
        let (status, text) = wheel(&cell, options, lines);
        assert_eq!(status, 0, "{text}");
        let (taken, not) = said_counts(&text[text.find("Ctrl-C").expect("a beginning")..]);
        assert_eq!(taken + not, 59, "{text}");
        let at = rest(&mut cell);
        let way_mm = x_mm(&at) - from_mm;
        let counted_mm = (sign * taken) as f64 * 0.01;
        assert!(
            (way_mm - counted_mm).abs() < 1e-9,
            "{way_mm} of {counted_mm} mm: {text}"
        );
        let place = format!("X is at rest at {:.3} mm", x_mm(&at));
        assert!(text.contains(&place), "{text}: {place}");
    }
    // What is no count ends it, with the axis where the last count says.
    let lines = ["7", "8", "eight", "9"].map(str::to_owned);
    let (status, text) = wheel(&cell, &[], lines.into_iter());
    assert_eq!(status, 2, "{text}");
    assert!(
        text.contains("line 3 of standard input: \"eight\" is no running count"),
        "{text}"
    );
    assert!(text.contains("1 counts taken, 0 not"), "{text}");
    obeyed(&cell, &["down"]);
}

#[test]
fn a_jog_by_a_distance_has_a_speed_and_bad_ones_are_refused() {
    let (_bench, cell, ..) = up("lockstep");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["jog", "X", "3", "--speed", "3000", "--wait"]);
    refused(
        &cell,
        &["jog", "X", "3", "--speed", "20000"],
        "to 15000 mm/min",
    );
    for (words, why) in [
        (vec!["jog", "X"], "how far?"),
        (vec!["jog", "X+", "5"], "has no distance"),
        (vec!["jog", "Q+"], "it has X Y"),
        (vec!["jog", "X+", "--speed", "0"], "above 0 mm/min"),
        (vec!["jog", "X", "1", "--speed", "-5"], "above 0 mm/min"),
    ] {
        let printed = ask(&cell, &words);
        assert_eq!(printed.status, 2, "{words:?}: {}", printed.text);
        assert!(printed.text.contains(why), "{words:?}: {}", printed.text);
    }
    obeyed(&cell, &["down"]);
}

#[test]
fn an_emergency_stop_trips_a_running_program_and_enable_takes_it_back() {
    let (_bench, mut cell, _, long) = up("realtime");
    obeyed(&cell, &["estop"]);
    let off = cell.wait_for(|f| f.cause == Cause::EmergencyStop as u32);
    assert!(is(&off, Mode::Disabled, ProgramState::None));
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["estop"]);
    cell.wait_for(|f| is(f, Mode::Tripped, ProgramState::Loaded));
    refused(&cell, &["start"], "has tripped");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|f| f.axes[1].velocity_mm_s.abs() > 10.0);
    let printed = obeyed(&cell, &["estop"]);
    assert!(printed.contains("enable ends it"), "{printed}");
    let tripped = cell.wait_for(|f| f.mode == Mode::Tripped as u32);
    assert_eq!(tripped.cause, Cause::EmergencyStop as u32);
    refused(&cell, &["resume"], "has tripped");
    obeyed(&cell, &["estop"]);
    obeyed(&cell, &["enable"]);
    cell.wait_for(|f| is(f, Mode::Enabled, ProgramState::Running) && f.hold == 1);
    let status = ask(&cell, &["status"]);
    assert_eq!(status.status, 0, "{}", status.text);
    obeyed(&cell, &["down"]);
}

/// Held, an increment that is waited for ends before it is done: its client says so.
#[test]
fn an_increment_that_is_cut_short_is_not_said_to_be_done() {
    let (_bench, mut cell, ..) = up("realtime");
    obeyed(&cell, &["enable"]);
    for cut in ["hold", "stop"] {
        let began = rest(&mut cell);
        let from = began.axes[0].command_position;
        let client = increment(&cell, "60");
        Step::Moves.wait(&mut cell, &began, 0);
        obeyed(&cell, &[cut]);
        let (status, text) = printed(client);
        let at = rest(&mut cell).axes[0].command_position;
        let gone = format!("X has gone {} of 60 mm", (at - from) as f64 / 1e6);
        assert!(
            status == 1 && text.contains(&gone),
            "{cut}: {status} {text}, not {gone}"
        );
        if cut == "hold" {
            obeyed(&cell, &["resume"]);
        }
        obeyed(&cell, &["jog", "X", "-1", "--wait"]);
    }
    obeyed(&cell, &["down"]);
}

/// Zero is set where the axis is commanded to be, whatever the motor is off.
#[test]
fn behind_fifty_clicks_and_zero_g0_to_zero_moves_nothing() {
    let (_bench, mut cell, ..) = up("lockstep");
    obeyed(&cell, &["enable"]);
    let first = rest(&mut cell).axes[0].command_position;
    for click in 0..50 {
        let way = if click % 3 == 2 { "-0.02" } else { "0.013" };
        obeyed(&cell, &["jog", "X", way, "--wait"]);
    }
    let clicked = rest(&mut cell);
    assert_eq!(
        clicked.axes[0].command_position - first,
        34 * 13_000 - 16 * 20_000
    );
    // By then the program's controllers drive again.
    let settled = cell.wait_for_scan(clicked.scan + 3_000).axes[0];
    obeyed(&cell, &["zero", "X"]);
    let run = cell.wait_for(|_| true).run;
    obeyed(&cell, &["mdi", "G90 G0 X0"]);
    let done = cell.wait_for(|now| now.run > run && now.mode == Mode::Ready as u32);
    let after = cell.wait_for_scan(done.scan + 500).axes[0];
    assert_eq!(after.command_position, settled.command_position);
    let moved_nm = after.motor_position - settled.motor_position;
    println!("the motor moved by {moved_nm} nm");
    assert!(moved_nm.abs() <= 1_000, "{moved_nm} nm");
    obeyed(&cell, &["down"]);
}

/// Numbers of the readout: work coordinates in mm.
fn work_mm(cell: &LiveCell) -> Vec<f64> {
    let status = crate::readout::status(cell);
    let axes = status["axes"].as_array().expect("axes").iter();
    axes.map(|axis| axis["work_mm"].as_f64().expect("known"))
        .collect()
}

fn reads(cell: &LiveCell, places_mm: [f64; 3]) {
    for (found, expected) in work_mm(cell).into_iter().zip(places_mm) {
        // What rounding to increments leaves of a turned place.
        assert!(
            (found - expected).abs() <= 1.5e-6,
            "{found} mm for {expected}"
        );
    }
}

#[test]
fn a_jog_to_a_work_place_ends_where_the_readout_shows_it_turned_shifted_and_with_a_tool() {
    let bench = Bench::patient("xyz-mill", &[]);
    let offsets = "[G54]\nX = 100.0\nY = 110.0\nZ = -100.0\nR = 30.0\n\n[G55]\nX = 240.0\nY = 90.0\nZ = -90.0\n";
    std::fs::write(bench.path().join("offsets.toml"), offsets).expect("written");
    let text = "G21 G90 G94 G55\nG92 X3 Y4\nG1 X20 Y10 F3000\nM0\nG1 X30\nM2\n";
    let program = bench.file("places.ngc", text).display().to_string();
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["mdi", "G20 G43 H1"]);
    let words = "jog X 10 Y 5 Z -20 --to --wait --speed 6000";
    obeyed(&cell, &words.split(' ').collect::<Vec<_>>());
    reads(&cell, [10.0, 5.0, -20.0]);
    let before = cell
        .wait_for(|_| true)
        .axes
        .map(|axis| axis.command_position);
    // One number moves two axes of the machine.
    obeyed(&cell, &["jog", "X", "22.5", "--to", "--wait"]);
    reads(&cell, [22.5, 5.0, -20.0]);
    let after = cell
        .wait_for(|_| true)
        .axes
        .map(|axis| axis.command_position);
    assert!(before[0] != after[0] && before[1] != after[1] && before[2] == after[2]);
    let there = obeyed(&cell, &["jog", "X", "22.5", "--to"]);
    assert!(there.contains("is there already"), "{there}");
    refused(
        &cell,
        &["jog", "X", "9000", "--to"],
        "work coordinates are turned",
    );
    refused(
        &cell,
        &["jog", "Z", "9000", "--to"],
        "mm in work coordinates",
    );
    refused(
        &cell,
        &["jog", "X", "9000", "--to-machine"],
        "mm of the machine",
    );
    let both = ask(&cell, &["jog", "X", "1", "--to", "--to-machine"]);
    assert_eq!(both.status, 2, "{}", both.text);
    reads(&cell, [22.5, 5.0, -20.0]);
    // Off the path of a program its own offsets are in force.
    obeyed(&cell, &["load", &program]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|now| now.auxiliary.waiting != 0 && now.auxiliary.line == 4);
    obeyed(&cell, &["hold"]);
    let z_mm = work_mm(&cell)[2];
    obeyed(
        &cell,
        &["jog", "X", "7", "--to", "--wait", "--speed", "6000"],
    );
    let [x_mm, _, z_now_mm] = work_mm(&cell)[..] else {
        panic!("three axes");
    };
    assert!(
        (x_mm - 7.0).abs() <= 1.5e-6 && z_now_mm == z_mm,
        "{x_mm} mm"
    );
    crate::up::down(cell);
}

#[test]
fn waiting_for_a_jog_is_for_its_own_axes() {
    let (_bench, mut cell, ..) = up("realtime");
    obeyed(&cell, &["enable"]);
    // It takes a minute and a half.
    obeyed(&cell, &["jog", "X", "90", "--speed", "60"]);
    obeyed(&cell, &["jog", "Y", "0.1", "--wait"]);
    let now = cell.wait_for(|_| true);
    assert_eq!(now.axes[1].command_position % 100_000, 0);
    assert_eq!(now.mode, Mode::Jogging as u32, "X is done as well");
    obeyed(&cell, &["hold"]);
    obeyed(&cell, &["down"]);
}

#[test]
fn the_override_of_jogs_is_shown_and_counts_for_what_is_jogged_already() {
    let (_bench, mut cell, ..) = up("lockstep");
    obeyed(&cell, &["enable"]);
    refused(
        &cell,
        &["jog-override", "201"],
        "an override of jogs is 0 to 200 %",
    );
    let said = obeyed(&cell, &["jog-override", "0"]);
    assert!(said.contains("jog override 0 %"), "{said}");
    obeyed(&cell, &["jog", "X", "5"]);
    let stands = cell.wait_for(|f| f.mode == Mode::Jogging as u32);
    let later = cell.wait_for_scan(stands.scan + 500);
    assert_eq!(later.mode, Mode::Jogging as u32);
    assert_eq!(x_mm(&later), x_mm(&stands));
    let status = ask(&cell, &["status"]).text;
    assert!(status.contains("jogs 0 %"), "{status}");
    assert!(status.contains("jog-override 100"), "{status}");
    obeyed(&cell, &["jog-override", "150"]);
    let there = cell.wait_for(|f| is(f, Mode::Ready, ProgramState::None));
    assert_eq!(there.inputs.jog_override_percent(), 150);
    assert!((x_mm(&there) - x_mm(&stands) - 5.0).abs() < 1e-9);
    obeyed(&cell, &["down"]);
}
