//! A rotary axis that turns without end, through real processes: shorter ways, turns, the readout, jogs, the return to the path.

use std::path::{Path, PathBuf};

use bus::sample::{Feedback, Mode, ProgramState};
use serde_json::Value;

use crate::support::{LiveCell, quadrant};
use crate::up::{ask, down, is, obeyed};

const PROGRAM: &str =
    "G21 G90 G94\nG0 A350\nM0\nG91 G0 A1090\nM0\nG90 G1 X5 A90 F2000\nG0 A10\nM2\n";

/// A as `status --json` shows it: in coordinates of the program, and of the machine.
fn shown(cell: &LiveCell) -> (f64, f64) {
    let printed = ask(cell, &["status", "--json"]);
    let state: Value = serde_json::from_str(&printed.text).expect("JSON");
    let axis = &state["axes"][1];
    let number = |key: &str| axis[key].as_f64().expect("a number");
    (number("work_deg"), number("machine_deg"))
}

/// Where A is commanded to be, in degrees as it is counted.
fn counted(feedback: &Feedback) -> f64 {
    feedback.axes[1].command_position as f64 * 1e-6
}

fn stops(cell: &mut LiveCell, line: u32) -> Feedback {
    cell.wait_for(|now| now.auxiliary.waiting != 0 && now.auxiliary.line == line)
}

fn near(found: f64, expected: f64) {
    assert!(
        (found - expected).abs() < 0.01,
        "{found} and not {expected}"
    );
}

/// A machine with a slide and such a table.
fn table(home: &Path) -> PathBuf {
    let folder = home.join("table");
    let output = quadrant()
        .args(["new", "machine"])
        .arg(&folder)
        .args(["--axis", "X:travel=-100..100"])
        .args(["--axis", "A:travel=endless,gear=60"])
        .output()
        .expect("quadrant");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("A without end"), "{said}");
    folder
}

#[test]
fn a_table_that_turns_without_end_takes_the_shorter_way_and_is_shown_within_a_turn() {
    let home = tempfile::tempdir().expect("a folder");
    let folder = table(home.path());
    let file = folder.join("part.ngc");
    std::fs::write(&file, PROGRAM).expect("written");
    let file = file.display().to_string();
    let mut cell = LiveCell::up(&folder, "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &file]);
    obeyed(&cell, &["start"]);
    near(counted(&stops(&mut cell, 3)), -10.0);
    near(shown(&cell).0, 350.0);
    near(shown(&cell).1, 350.0);
    obeyed(&cell, &["resume"]);
    near(counted(&stops(&mut cell, 5)), 1080.0);
    // Turned away by hand, it turns back by as much.
    obeyed(&cell, &["hold"]);
    obeyed(&cell, &["jog", "A", "400", "--speed", "2000", "--wait"]);
    let (_, of_machine) = shown(&cell);
    near(of_machine, 40.0);
    obeyed(&cell, &["resume"]);
    let ended = cell.wait_for(|now| is(now, Mode::Ready, ProgramState::Done));
    near(counted(&ended), 1090.0);
    near(shown(&cell).1, 10.0);
    obeyed(&cell, &["zero", "A"]);
    near(shown(&cell).0, 0.0);
    near(shown(&cell).1, 10.0);
    down(cell);
}

#[test]
fn a_slide_without_end_and_a_table_with_ends_are_refused_and_so_is_one_with_neither() {
    for (what, by, why) in [
        (
            "modulo = true",
            "modulo = true\ntravel_min_deg = 0.0 #",
            "axis A travel_min_deg goes without `modulo`",
        ),
        (
            "name = \"X\"",
            "name = \"X\"\nmodulo = true",
            "axis X modulo = true: a slide has ends: needs kind = \"rotary\"",
        ),
        (
            "modulo = true",
            "modulo = false #",
            "axis A: missing field `travel_min_deg`",
        ),
    ] {
        let home = tempfile::tempdir().expect("a folder");
        let folder = table(home.path());
        let file = folder.join("machine.toml");
        let text = std::fs::read_to_string(&file).expect("a file");
        assert!(text.contains(what), "{text}");
        std::fs::write(&file, text.replace(what, by)).expect("written");
        let output = quadrant().arg("check").arg(&folder).output();
        let output = output.expect("quadrant");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(why), "{why}: {said}");
    }
}
