//! The readout: where the axes are in the program and on the machine, and what is left of the block.

use bus::sample::{Mode, ProgramState};
use serde_json::Value;

use crate::support::{Bench, LiveCell, quadrant};
use crate::up::{ask, down, obeyed};

/// Places that the program commands in coordinates of its own: shifted, with G92, with the length of a tool, turned, incremental.
const PROGRAM: &str = "G21 G90 G94 G54\nG0 X3 Y4 Z-5\nM0\nG55\nG1 X1 Y2 F3000\nM0\nG92 X10 Y20\nG1 X12 Y21\nM0\nG43 H1\nG1 Z-45\nM0\nG91\nG1 X-1.5\nM0\nG49 G90 G92.1 G54\nG1 X0 Y0 F1200 Z-5\nM2\n";

pub(crate) fn status(cell: &LiveCell) -> Value {
    let output = quadrant()
        .args(["status", "--json", "--cell", &cell.cell])
        .output()
        .expect("a status");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Work coordinates of the axes, each held against the command position of the report of the cell itself.
fn work(status: &Value) -> Vec<Option<f64>> {
    let axes = status["axes"].as_array().expect("axes").iter();
    axes.map(|axis| {
        assert_eq!(axis["machine_mm"], axis["command_mm"]);
        axis["work_mm"].as_f64()
    })
    .collect()
}

fn reads(status: &Value, expected: [f64; 3]) {
    for (found, expected) in work(status).iter().zip(expected) {
        // An increment.
        let off = found.map(|found| (found - expected).abs());
        assert!(off.is_some_and(|off| off <= 1.1e-6), "{expected}: {status}");
    }
}

fn codes(status: &Value) -> String {
    let codes = status["readout"]["active_codes"].as_array().expect("codes");
    let codes: Vec<&str> = codes.iter().filter_map(Value::as_str).collect();
    codes.join(" ")
}

/// At the stop in this line.
fn at_stop(cell: &mut LiveCell, line: u32) -> Value {
    cell.wait_for(|now| now.auxiliary.waiting != 0 && now.auxiliary.line == line);
    status(cell)
}

#[test]
fn the_readout_is_where_the_program_has_commanded_the_axes_to_be() {
    let bench = Bench::patient("xyz-mill", &[]);
    std::fs::write(
        bench.path().join("offsets.toml"),
        "[G54]\nX = 240.0\n\n[G55]\nX = 100.0\nY = 110.0\nZ = -100.0\nR = 90.0\n",
    )
    .expect("written");
    let program = bench.file("places.ngc", PROGRAM).display().to_string();
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["zero", "Y", "--at", "7"]);
    let idle = status(&cell);
    assert_eq!(work(&idle)[1], Some(7.0), "{idle}");
    assert_eq!(idle["readout"]["work_offset"], "G54");
    obeyed(&cell, &["zero", "Y"]);
    obeyed(&cell, &["load", &program]);
    obeyed(&cell, &["start"]);
    let stop = at_stop(&mut cell, 3);
    reads(&stop, [3.0, 4.0, -5.0]);
    assert_eq!(stop["readout"]["work_offset"], "G54", "{stop}");
    assert!(
        stop["readout"]["time_left_s"]
            .as_f64()
            .is_some_and(|left_s| left_s > 0.01),
        "{stop}"
    );
    obeyed(&cell, &["resume"]);
    let stop = at_stop(&mut cell, 6);
    reads(&stop, [1.0, 2.0, -5.0]);
    assert!(codes(&stop).contains("G1 G17 G21 G40 G49 G55"), "{stop}");
    obeyed(&cell, &["resume"]);
    let stop = at_stop(&mut cell, 9);
    reads(&stop, [12.0, 21.0, -5.0]);
    assert!(codes(&stop).contains("G92"), "{stop}");
    obeyed(&cell, &["resume"]);
    let stop = at_stop(&mut cell, 12);
    reads(&stop, [12.0, 21.0, -45.0]);
    let length_mm = stop["axes"][2]["tool_length_mm"].as_f64();
    assert!(length_mm.is_some_and(|length_mm| length_mm > 1.0), "{stop}");
    obeyed(&cell, &["resume"]);
    let stop = at_stop(&mut cell, 15);
    reads(&stop, [10.5, 21.0, -45.0]);
    assert!(codes(&stop).contains("G91"), "{stop}");
    obeyed(&cell, &["override", "0"]);
    obeyed(&cell, &["resume"]);
    obeyed(&cell, &["override", "100"]);
    cell.wait_for(|now| now.program == ProgramState::Done as u32);
    let done = status(&cell);
    reads(&done, [0.0, 0.0, -5.0]);
    assert!(done["readout"]["time_left_s"].is_null(), "{done}");
    down(cell);
}

#[test]
fn in_hold_the_way_to_go_leads_to_the_end_of_the_block_and_after_a_jog_nothing_is_said_of_it() {
    let bench = Bench::patient("xy", &[]);
    let text = "G21 G90 G94\nG1 X40 Y20 F3000\nX0 Y0\nM2\n";
    let program = bench.file("line.ngc", text).display().to_string();
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["hold"]);
    obeyed(&cell, &["load", &program]);
    obeyed(&cell, &["start"]);
    // Where it may be jogged: it stands in hold, and has for as long as that takes.
    let held =
        cell.wait_for(|now| now.hold == 1 && now.rested == 1 && now.mode == Mode::Enabled as u32);
    cell.wait_for_scan(held.scan + 200);
    let held = status(&cell);
    let [x, y] = [&held["axes"][0], &held["axes"][1]];
    for (axis, end_mm) in [(x, 40.0), (y, 20.0)] {
        let at_mm = axis["work_mm"].as_f64();
        let to_go_mm = axis["distance_to_go_mm"].as_f64();
        if let (Some(at_mm), Some(to_go_mm)) = (at_mm, to_go_mm) {
            assert!((at_mm + to_go_mm - end_mm).abs() <= 1.1e-6, "{held}");
        }
    }
    assert!(held["readout"]["block_text"].is_string() || held["readout"]["block_text"].is_null());
    obeyed(&cell, &["jog", "X", "5", "--wait"]);
    let jogged = status(&cell);
    assert!(jogged["axes"][0]["distance_to_go_mm"].is_null(), "{jogged}");
    let off_mm = |status: &Value| {
        status["axes"][0]["work_mm"]
            .as_f64()
            .zip(status["axes"][0]["machine_mm"].as_f64())
    };
    let (work_mm, machine_mm) = off_mm(&jogged).expect("known");
    assert!((work_mm - machine_mm).abs() <= 1.1e-6, "{jogged}");
    let text = ask(&cell, &["status"]).text;
    assert!(
        text.contains("distance to go") && text.contains("work offset G54"),
        "{text}"
    );
    down(cell);
}

#[test]
fn behind_a_block_of_single_block_the_work_coordinates_are_those_of_the_program() {
    let bench = Bench::patient("xy", &[]);
    let text = "G21 G90 G94\nG92 X100\nG1 X140 F3000\nG1 Y20\nM2\n";
    let program = bench.file("line.ngc", text).display().to_string();
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &program]);
    obeyed(&cell, &["start", "--single-block"]);
    cell.wait_for(|now| now.auxiliary.waiting != 0 && now.hold == 1);
    let stopped = status(&cell);
    let work_mm = stopped["axes"][0]["work_mm"].as_f64().expect("known");
    assert!((work_mm - 140.0).abs() < 1e-3, "{stopped}");
    down(cell);
}

/// What turns is read in degrees, under names that say so; where nothing but that moves, the feed is in degrees too.
#[test]
fn a_rotary_axis_and_its_feed_are_read_in_degrees() {
    let home = tempfile::tempdir().expect("a folder");
    let folder = home.path().join("table");
    let made = quadrant()
        .args(["new", "machine"])
        .arg(&folder)
        .args([
            "--axis",
            "X:travel=0..300",
            "--axis",
            "A:travel=-3600..3600",
        ])
        .output()
        .expect("running quadrant");
    assert!(made.status.success(), "{made:?}");
    let program = folder.join("turn.ngc");
    let turn = "G21 G90 G94\nG0 X10 A5\nM0\nG1 A3000 F1200\nM2\n";
    std::fs::write(&program, turn).expect("written");
    let mut cell = LiveCell::up(&folder, "realtime");
    cell.wait_for(|_| true);
    let program = program.display().to_string();
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &program]);
    obeyed(&cell, &["start"]);
    let stop = at_stop(&mut cell, 3);
    let [x, a] = [&stop["axes"][0], &stop["axes"][1]];
    assert_eq!((&x["unit"], &a["unit"]), (&"mm".into(), &"deg".into()));
    assert!((a["command_deg"].as_f64().expect("degrees") - 5.0).abs() < 1e-5);
    assert!(a["following_error_mdeg"].is_f64() && a["velocity_deg_s"].is_f64());
    for key in [
        "command_mm",
        "feedback_mm",
        "velocity_mm_s",
        "following_error_um",
        "work_mm",
    ] {
        assert!(
            a.get(key).is_none() && x.get(key).is_some(),
            "{key}: {stop}"
        );
    }
    obeyed(&cell, &["resume"]);
    cell.wait_for(|now| now.axes[1].velocity_mm_s > 15.0);
    let turns = status(&cell);
    assert_eq!(
        turns["readout"]["programmed_feed_deg_min"], 1200.0,
        "{turns}"
    );
    assert!(
        turns["readout"]["programmed_feed_mm_min"].is_null(),
        "{turns}"
    );
    let shown = quadrant()
        .args(["status", "--cell", &cell.cell])
        .output()
        .expect("a status");
    let shown = String::from_utf8_lossy(&shown.stdout);
    assert!(
        shown.contains("deg/min, programmed 1200") && shown.contains("mdeg"),
        "{shown}"
    );
    obeyed(&cell, &["stop"]);
    down(cell);
}
