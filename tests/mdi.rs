//! Typed-in blocks: run, keep their modes, leave the program loaded, and are refused where they must be.

use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use bus::sample::{Feedback, Mode, ProgramState};

use crate::support::{Bench, LiveCell, PATIENCE, quadrant, send};
use crate::up::{ask, down, is, obeyed, refused, up};

fn x_nm(feedback: &Feedback) -> i64 {
    feedback.axes[0].command_position
}

#[test]
fn blocks_run_one_after_another_with_the_modes_of_those_before_and_the_program_stays_loaded() {
    let (_bench, mut cell, short, _) = up("lockstep");
    refused(&cell, &["mdi", "G0 X1"], "the drives are off");
    obeyed(&cell, &["enable"]);
    let from = x_nm(&cell.wait_for(|f| f.mode == Mode::Ready as u32));
    obeyed(&cell, &["mdi", "G91 G1 X2 F3000"]);
    let first = cell.wait_for(|f| f.mode == Mode::Ready as u32);
    assert_eq!(x_nm(&first) - from, 2_000_000);
    // Incremental, a line and its feed: all as before.
    obeyed(&cell, &["mdi", "X3"]);
    let second = cell.wait_for(|f| f.mode == Mode::Ready as u32);
    assert_eq!(x_nm(&second) - from, 5_000_000);
    obeyed(&cell, &["load", &short]);
    obeyed(&cell, &["mdi", "G20", "G90 G0 X1"]);
    let inch = cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Loaded));
    assert_eq!(x_nm(&inch), 25_400_000);
    obeyed(&cell, &["mdi", "X0"]);
    obeyed(&cell, &["start", "--wait"]);
    let status = ask(&cell, &["status"]);
    assert!(status.text.contains("short.ngc"), "{}", status.text);
    obeyed(&cell, &["down"]);
}

#[test]
fn a_wrong_block_moves_nothing_and_says_where_it_is_wrong() {
    let (_bench, mut cell, ..) = up("lockstep");
    obeyed(&cell, &["enable"]);
    let before = cell.wait_for(|f| f.mode == Mode::Ready as u32);
    for (blocks, why) in [
        (vec!["G0 X10", "G1 X5 F0 Q"], "mdi:2"),
        (vec!["G0 X9999"], "X"),
        (vec![" "], "no block"),
    ] {
        let mut words = vec!["mdi"];
        words.extend(&blocks);
        let printed = ask(&cell, &words);
        assert_eq!(printed.status, 2, "{blocks:?}: {}", printed.text);
        assert!(printed.text.contains(why), "{blocks:?}: {}", printed.text);
        assert!(!printed.text.contains("/dev/shm"), "{}", printed.text);
        assert!(!printed.text.contains("5 | "), "{}", printed.text);
    }
    let after = cell.wait_for(|f| f.scan > before.scan + 100);
    assert_eq!((x_nm(&after), after.run), (x_nm(&before), 0));
    obeyed(&cell, &["down"]);
}

#[test]
fn a_block_is_refused_beside_a_program_that_runs_or_is_held_and_can_be_held_itself() {
    let (_bench, mut cell, _, long) = up("realtime");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["start"]);
    refused(&cell, &["mdi", "G0 X1"], "a program is running");
    obeyed(&cell, &["stop"]);
    let stopped = cell.wait_for(|f| f.mode == Mode::Stopped as u32);
    refused(&cell, &["mdi", "G0 X1"], "a program is running");
    assert_eq!(cell.wait_for(|_| true).load, stopped.load);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["mdi", "--no-wait", "G4 P30"]);
    obeyed(&cell, &["hold"]);
    obeyed(&cell, &["resume"]);
    obeyed(&cell, &["stop"]);
    // It is given up, and the program is there again.
    cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Loaded));
    obeyed(&cell, &["down"]);
}

/// How typed-in blocks end.
const ENDS: [&str; 9] = [
    "done",
    "nobody waits",
    "Ctrl-C of the client",
    "the client is killed",
    "stop",
    "estop",
    "the planner is killed",
    "a wrong block",
    "reset",
];

/// One that moves by a millimetre, then waits for so long, in s.
fn client(cell: &LiveCell, wait_s: &str) -> Child {
    quadrant()
        .args(["mdi", "G91 G1 X1 F3000", &format!("G4 P{wait_s}")])
        .args(["--cell", &cell.cell])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("a client")
}

/// Has typed-in blocks end so.
fn end_by(cell: &mut LiveCell, end: &str) {
    let block = ["mdi", "G91 G1 X1 F3000"];
    let run = cell.wait_for(|_| true).run + 1;
    match end {
        "done" => drop(obeyed(cell, &block)),
        "nobody waits" => {
            obeyed(cell, &[&block[..], &["--no-wait"]].concat());
            cell.wait_for(|now| now.run == run && now.program != ProgramState::Running as u32);
        }
        "a wrong block" => assert_eq!(ask(cell, &["mdi", "G1 X9999 F100"]).status, 2),
        _ => {
            let short = end == "the client is killed";
            let mut client = client(cell, if short { "1" } else { "600" });
            cell.wait_for(|now| now.run == run);
            interrupt(cell, end, &mut client);
            client.wait().expect("the client");
        }
    }
}

fn interrupt(cell: &mut LiveCell, end: &str, client: &mut Child) {
    match end {
        "the client is killed" => {
            client.kill().expect("killing the client");
            cell.wait_for(|now| now.program != ProgramState::Running as u32);
        }
        "Ctrl-C of the client" => {
            send(client.id() as i32, libc::SIGINT);
            assert_eq!(client.wait().expect("its status").code(), Some(130));
            refused(cell, &["start"], "a program is running");
            obeyed(cell, &["stop"]);
        }
        "stop" => drop(obeyed(cell, &["stop"])),
        "estop" => {
            obeyed(cell, &["estop"]);
            cell.wait_for(|now| now.mode == Mode::Tripped as u32);
            obeyed(cell, &["enable"]);
        }
        "the planner is killed" => {
            let pid = cell.pid_of("planner");
            send(pid, libc::SIGKILL);
            let is_heir = |(other, line): &(i32, String)| line.contains("planner") && *other != pid;
            let since = Instant::now();
            while !cell.children().iter().any(is_heir) {
                assert!(since.elapsed() < PATIENCE, "the planner is not replaced");
                std::thread::sleep(Duration::from_millis(5));
            }
            obeyed(cell, &["stop"]);
        }
        _ => {
            obeyed(cell, &["hold"]);
            let held = cell.wait_for(|now| now.hold == 1 && now.at_rest == 1);
            cell.wait_for(|now| now.scan > held.scan + 200);
            obeyed(cell, &["reset"]);
        }
    }
}

fn is_over(now: &Feedback) -> bool {
    let states = [ProgramState::Running, ProgramState::Loading];
    now.mode == Mode::Ready as u32 && !states.map(|state| state as u32).contains(&now.program)
}

/// No program is loaded: `start` moves nothing behind typed-in blocks.
fn nothing_starts(cell: &mut LiveCell) {
    for end in ENDS {
        end_by(cell, end);
        let over = cell.wait_for(is_over);
        assert_eq!(over.program, ProgramState::None as u32, "{end}");
        let status = ask(cell, &["status"]).text;
        assert!(!status.contains("mdi"), "{end}: {status}");
        refused(cell, &["start"], "load one first");
        let after = cell.wait_for(|now| now.scan > over.scan + 100);
        assert_eq!((after.run, x_nm(&after)), (over.run, x_nm(&over)), "{end}");
    }
}

#[test]
fn however_typed_in_blocks_end_start_never_runs_them_where_no_program_was_loaded() {
    let (_bench, mut cell, ..) = up("realtime");
    obeyed(&cell, &["enable"]);
    nothing_starts(&mut cell);
    down(cell);
}

#[test]
fn however_typed_in_blocks_end_start_never_runs_them_where_a_load_was_refused() {
    let (bench, mut cell, ..) = up("realtime");
    let wrong = bench.file("wrong.ngc", "G1 X9999 F100\nM2\n");
    obeyed(&cell, &["enable"]);
    let said = ask(&cell, &["load", &wrong.display().to_string()]);
    assert_eq!(said.status, 2, "{}", said.text);
    nothing_starts(&mut cell);
    down(cell);
}

#[test]
fn however_typed_in_blocks_end_start_runs_the_program_that_was_loaded_before() {
    let (bench, mut cell, ..) = up("realtime");
    let part = bench.file("part.ngc", "G21 G90 G94\nG1 X5 F3000\nM2\n");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &part.display().to_string()]);
    for end in ENDS {
        end_by(&mut cell, end);
        cell.wait_for(is_over);
        let status = ask(&cell, &["status"]).text;
        assert!(status.contains("part.ngc"), "{end}: {status}");
        obeyed(&cell, &["start", "--wait"]);
        let done = cell.wait_for(|now| is(now, Mode::Ready, ProgramState::Done));
        assert_eq!(x_nm(&done), 5_000_000, "{end}");
    }
    down(cell);
}

#[test]
fn a_block_is_done_also_where_the_program_from_before_does_not_fit_behind_it() {
    let bench = Bench::patient("xyz-mill", &[]);
    let part = bench.file("part.ngc", "G21 G90 G54\nG0 Z-100\nM2\n");
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &part.display().to_string()]);
    let said = obeyed(&cell, &["mdi", "G43.1 Z-300"]);
    assert!(
        said.contains("the planner refuses the program from before: "),
        "{said}"
    );
    assert!(!said.contains("the terminal of"), "{said}");
    cell.wait_for(|now| is(now, Mode::Ready, ProgramState::None));
    refused(&cell, &["start"], "load one first");
    down(cell);
}

#[test]
fn what_a_block_switches_on_goes_on_until_a_block_stop_m2_or_a_trip_switches_it_off() {
    let bench = Bench::patient("xz-lathe", &[]);
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    cell.wait_for(|now| now.mode == Mode::Ready as u32);
    let shows = |cell: &mut LiveCell, rpm: f64, coolant: u32, what: &str| {
        let before = cell.wait_for(is_over).scan;
        let now = cell.wait_for(|now| now.scan > before + 10);
        let levels = &now.auxiliary.levels;
        assert_eq!(
            (levels.spindle_rpm, levels.coolant),
            (rpm, coolant),
            "{what}"
        );
    };
    let flood = bus::sample::FLOOD;
    for end in [
        &["mdi", "M5", "M9"][..],
        &["stop"],
        &["mdi", "M2"],
        &["estop"],
        &["disable"],
    ] {
        obeyed(&cell, &["mdi", "M3 S500 M8"]);
        shows(&mut cell, 500.0, flood, "behind the block");
        obeyed(&cell, &["jog", "Z", "0.5", "--wait"]);
        shows(&mut cell, 500.0, flood, "behind a jog");
        obeyed(&cell, &["mdi", "G91 G95 G1 Z-0.5 F0.2"]);
        shows(&mut cell, 500.0, flood, "behind another block");
        let readout = ask(&cell, &["status"]).text;
        assert!(readout.contains(" M3 M8"), "{readout}");
        obeyed(&cell, end);
        if matches!(end[0], "estop" | "disable") {
            cell.wait_for(|now| now.mode != Mode::Ready as u32);
            obeyed(&cell, &["enable"]);
        }
        shows(&mut cell, 0.0, 0, end[0]);
    }
    down(cell);
}
