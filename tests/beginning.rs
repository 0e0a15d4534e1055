//! The tool in the spindle, the offset that is applied and the modes belong to the machine: kept over programs, typed-in blocks and the
//! deaths of processes, and read in one place by the planner, the readout, `zero` and programs.
//!
//! `QUADRANT_TESTS=full cargo test --release --test cell -- beginning:: --nocapture` kills each process between each way and each next order.

use std::fs;
use std::time::{Duration, Instant};

use bus::sample::{Feedback, Mode};
use serde_json::Value;

use crate::readout::status;
use crate::size;
use crate::support::{Bench, LiveCell, PATIENCE, send};
use crate::up::{ask, down, obeyed};

/// Typed-in blocks, one order each, and the offset along Z that they leave applied, in mm.
const WAYS: [(&[&str], f64); 7] = [
    (&["T3 M6", "G43"], 75.0),
    (&["T1 M6", "T3 M6 G43"], 75.0),
    (&["G43.1 Z75"], 75.0),
    (&["T1 M6", "G43 H3"], 75.0),
    (&["T3 M6 G43", "G49"], 0.0),
    (&["T1 M6 G43", "G43.2 H4"], 85.0),
    (&["T2 M6 G43", "T3 M6", "G43"], 75.0),
];

/// Processes that die between a way and the next order.
const DEATHS: [Option<&str>; 4] = [
    None,
    Some("planner"),
    Some("servo --axis Z --role a"),
    Some("plant-sim"),
];

fn is_ready(now: &Feedback) -> bool {
    now.mode == Mode::Ready as u32
}

/// Kills a process, waits until another one is there, and switches the drives on again where they went off.
fn kill(cell: &mut LiveCell, role: &str) {
    let pid = cell.pid_of(role);
    send(pid, libc::SIGKILL);
    cell.wait_for(|_| true);
    let is_heir = |(other, line): &(i32, String)| line.contains(role) && *other != pid;
    let since = Instant::now();
    while !cell.children().iter().any(is_heir) {
        assert!(since.elapsed() < PATIENCE, "{role} is not replaced");
        std::thread::sleep(Duration::from_millis(5));
    }
    let now = cell.wait_for(|now| {
        matches!(
            Mode::from_wire(now.mode),
            Some(Mode::Ready | Mode::Disabled | Mode::Tripped)
        )
    });
    if !is_ready(&now) {
        obeyed(cell, &["enable"]);
        cell.wait_for(is_ready);
    }
}

fn z_mm(cell: &mut LiveCell) -> f64 {
    cell.wait_for(is_ready).axes[2].command_position as f64 * 1e-6
}

/// What all show who show it: the machine, the readout and the parameters of a program.
fn shows(cell: &mut LiveCell, applied_mm: f64, tool: u32, what: &str) -> Value {
    let now = cell.wait_for(is_ready);
    assert_eq!(now.auxiliary.tool_offset[2], applied_mm, "{what}");
    assert_eq!(now.auxiliary.tool, tool, "{what}");
    let status = status(cell);
    let axis = &status["axes"][2];
    assert_eq!(axis["tool_length_mm"], applied_mm, "{what}: {status}");
    let work_mm = axis["work_mm"].as_f64().expect("a place in the program");
    let expected_mm = now.axes[2].command_position as f64 * 1e-6 + 100.0 - applied_mm;
    assert!((work_mm - expected_mm).abs() < 1e-6, "{what}: {status}");
    let codes = status["readout"]["active_codes"].to_string();
    let expected = if applied_mm == 0.0 { "G49" } else { "G43" };
    assert!(codes.contains(expected), "{what}: {codes}");
    status
}

fn mill() -> (Bench, LiveCell) {
    let bench = Bench::patient("xyz-mill", &[]);
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    (bench, cell)
}

#[test]
fn every_way_of_applying_an_offset_holds_for_every_next_order_over_every_death() {
    let (mut bench, mut cell) = mill();
    let every = size::is_full();
    for (number, (way, applied_mm)) in WAYS.into_iter().enumerate() {
        if every && number > 0 {
            // A launcher gives up on processes that die too often.
            down(cell);
            (bench, cell) = mill();
        }
        let program = bench.file("tip.ngc", "G21 G90 G0 Z-1\nG0 Z[#5083 * 0]\nM2\n");
        let program = program.display().to_string();
        for (turn, death) in DEATHS.into_iter().enumerate() {
            if !every && turn != number % DEATHS.len() {
                continue;
            }
            let what = format!("{way:?}, {death:?} killed");
            obeyed(&cell, &["mdi", "G21 G90 G49 G0 Z-10"]);
            for block in way {
                obeyed(&cell, &["mdi", block]);
            }
            let tool = cell.wait_for(is_ready).auxiliary.tool;
            if let Some(role) = death {
                kill(&mut cell, role);
            }
            shows(&mut cell, applied_mm, tool, &what);
            obeyed(&cell, &["mdi", "G0 Z0"]);
            assert!(
                (z_mm(&mut cell) - (applied_mm - 100.0)).abs() < 1e-9,
                "{what}"
            );
            obeyed(&cell, &["load", &program]);
            obeyed(&cell, &["start", "--wait"]);
            assert!(
                (z_mm(&mut cell) - (applied_mm - 100.0)).abs() < 1e-9,
                "{what}: a program"
            );
            shows(&mut cell, applied_mm, tool, &what);
        }
    }
    down(cell);
}

#[test]
fn a_program_that_says_g43_takes_the_tool_that_is_in_the_spindle_also_after_a_restart_of_the_cell()
{
    let (bench, mut cell) = mill();
    let program = bench
        .file("g43.ngc", "G21 G90 G43\nG0 Z0\nM2\n")
        .display()
        .to_string();
    obeyed(&cell, &["mdi", "T3 M6"]);
    obeyed(&cell, &["load", &program]);
    obeyed(&cell, &["start", "--wait"]);
    assert!((z_mm(&mut cell) + 25.0).abs() < 1e-9);
    shows(&mut cell, 75.0, 3, "a program");
    down(cell);
    let file = bench.path().join("spindle.toml");
    let kept = fs::read_to_string(&file).expect("the tool is kept");
    assert!(kept.ends_with("tool = 3\n"), "{kept}");
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    shows(&mut cell, 0.0, 3, "after a restart");
    obeyed(&cell, &["mdi", "G43"]);
    obeyed(&cell, &["mdi", "G0 Z0"]);
    assert!((z_mm(&mut cell) + 25.0).abs() < 1e-9);
    down(cell);
    fs::write(&file, "tool = \"three\"\n").expect("written");
    let refused = crate::support::quadrant()
        .arg("check")
        .arg(bench.path())
        .output()
        .expect("a check");
    assert_eq!(refused.status.code(), Some(2));
}

#[test]
fn what_is_touched_off_reads_as_it_was_asked_for_with_the_offset_that_is_applied() {
    let (_bench, mut cell) = mill();
    for (blocks, zero) in [
        ("G49", &["zero", "Z", "--at", "5"][..]),
        ("T2 M6 G43", &["zero", "Z"]),
        ("G55", &["zero", "Z", "--at", "-3"]),
    ] {
        obeyed(&cell, &["mdi", blocks]);
        obeyed(&cell, zero);
        cell.wait_for(is_ready);
        let expected: f64 = zero.get(3).map_or(0.0, |at| at.parse().expect("a number"));
        let shown = status(&cell);
        let work_mm = shown["axes"][2]["work_mm"].as_f64().expect("a place");
        assert!(
            (work_mm - expected).abs() < 1e-6,
            "{blocks} {zero:?}: {shown}"
        );
        let before = z_mm(&mut cell);
        obeyed(&cell, &["mdi", &format!("G21 G90 G0 Z{expected}")]);
        assert!((z_mm(&mut cell) - before).abs() < 1e-6, "{blocks} {zero:?}");
    }
    down(cell);
}

#[test]
fn modes_stay_between_blocks_and_programs_until_m2_reset_or_a_program_that_is_given_up() {
    let (bench, mut cell) = mill();
    let stops = bench
        .file("stops.ngc", "G91 G20\nM0\nM2\n")
        .display()
        .to_string();
    let codes = |cell: &LiveCell| status(cell)["readout"]["active_codes"].to_string();
    let has = |cell: &LiveCell, expected: &[&str]| {
        let codes = codes(cell);
        for code in expected {
            assert!(codes.contains(&format!("\"{code}\"")), "{code}: {codes}");
        }
    };
    let set = ["mdi", "G91 G20 G55 G18 F10 S500 G99"];
    obeyed(&cell, &set);
    cell.wait_for(is_ready);
    has(&cell, &["G91", "G20", "G55", "G18", "G99"]);
    for role in ["planner", "plant-sim"] {
        kill(&mut cell, role);
        has(&cell, &["G91", "G20", "G55", "G18", "G99"]);
    }
    obeyed(&cell, &["mdi", "M2"]);
    cell.wait_for(is_ready);
    has(&cell, &["G1", "G90", "G20", "G54", "G17", "G99"]);
    obeyed(&cell, &set);
    obeyed(&cell, &["load", &stops]);
    has(&cell, &["G91", "G20", "G55"]);
    obeyed(&cell, &["reset"]);
    has(&cell, &["G1", "G90", "G21", "G54", "G17", "G98"]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|now| now.auxiliary.waiting != 0);
    has(&cell, &["G91", "G20"]);
    obeyed(&cell, &["reset"]);
    has(&cell, &["G90", "G21", "G54"]);
    let said = ask(&cell, &["mdi", "G0 X1000"]);
    assert_eq!(said.status, 2, "in mm: {}", said.text);
    down(cell);
}
