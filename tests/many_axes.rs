//! A machine of 32 axes, through real processes: nine with letters, the second motor of a gantry, and 22 that are moved by hand alone.

use std::fs;

use bus::sample::{Feedback, MAX_AXES, Mode, PATH_AXES, ProgramState};
use monitor::log::{Reader, Sample};

use crate::support::{Bench, LiveCell, number, plan, quadrant, root, run_with, text};
use crate::up::{is, obeyed};

/// The gantry's second motor stands behind the letters, the axes that no program moves behind it.
const SECOND: usize = PATH_AXES;
/// P7 among the axes.
const P7: usize = SECOND + 7;

/// Names of the axes of a machine with so many: letters first.
fn names(letters: &[&str], axes: usize) -> Vec<String> {
    let letters = letters.iter().map(ToString::to_string);
    let others = (1..).map(|number| format!("P{number}"));
    let second = std::iter::once("X2".to_string());
    letters.chain(second).chain(others).take(axes).collect()
}

/// A settings file of `xy` with these axes, each a copy of its first one; `of_second` is added to the second motor.
fn of_axes(file: &str, names: &[String], of_second: &str) -> String {
    let file = root().join("machines/xy").join(file);
    let source = fs::read_to_string(file).expect("a file of xy");
    let mut parts = source.split("[[axis]]\n");
    let (mut all, axis) = (
        parts.next().expect("a head").to_string(),
        parts.next().expect("X"),
    );
    for name in names {
        let of_name = axis.replacen("name = \"X\"", &format!("name = \"{name}\""), 1);
        all += &format!("[[axis]]\n{of_name}\n");
        if name == "X2" {
            all += of_second;
        }
    }
    all
}

fn machine_of(letters: &[&str], axes: usize) -> Bench {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let bench = Bench { folder };
    let names = names(letters, axes);
    let gantry = "[axis.gantry]\nleader = \"X\"\nskew_max_mm = 0.2\n";
    bench.file("machine.toml", &of_axes("machine.toml", &names, gantry));
    bench.file(
        "plant.toml",
        &of_axes("plant.toml", &names, "[axis.bridge]\n"),
    );
    bench
}

const LETTERS: [&str; PATH_AXES] = ["X", "Y", "Z", "U", "V", "W", "A", "B", "C"];

/// All axes with a letter move at once: on a line, on an arc with seven beside it, and round a corner.
const PROGRAM: &str = "G21 G17 G90 G94 G61\nG1 X10 Y0 Z1 U2 V3 W4 A5 B6 C7 F3000\nG3 X10 Y0 I-10 J0 Z2 U3 V4 W5 A6 B7 C9 F2000\n\
                       G64 P0.05\nG1 X5 Y3 Z0 U1 V1 W1 A1 B1 C-1 F4000\nG1 X0 Y0 Z1 U0 V0 W0 A0 B0 C8\nG61\nG1 Z0 C0\nM2\n";

fn mm(feedback: &Feedback, axis: usize) -> f64 {
    feedback.axes[axis].command_position as f64 * 1e-6
}

#[test]
fn a_program_moves_nine_of_32_axes_and_one_without_a_letter_is_jogged_meanwhile() {
    let bench = machine_of(&LETTERS, MAX_AXES);
    let program = bench.file("nine.ngc", PROGRAM);
    let checked = quadrant()
        .arg("check")
        .arg(bench.path())
        .arg(&program)
        .output();
    let checked = checked.expect("quadrant");
    assert!(checked.status.success(), "{checked:?}");
    assert!(!plan(bench.path(), &program, &[]).is_empty());
    let orders = "[[order]]\nscan = 300\norder = \"hold\"\n[[order]]\nscan = 700\norder = \"jog\"\naxis = \"P7\"\nvalue = 7.5\n\
                  [[order]]\nscan = 2000\norder = \"resume\"\n";
    let orders = bench.file("orders.toml", orders).display().to_string();
    let ended = run_with(bench.path(), &program, &["--orders", &orders]);
    let report = ended.good_report();
    let axes = report["axes"].as_array().expect("axes");
    let named: Vec<&str> = axes
        .iter()
        .filter_map(|axis| axis["axis"].as_str())
        .collect();
    assert_eq!(named, names(&LETTERS, MAX_AXES));
    assert_eq!(text(&report, "/axes/9/gantry/leader"), "X");
    // Who was jogged had a following error, and who stood had none to speak of.
    let error_um = |axis: usize| number(&report, &format!("/axes/{axis}/following_error_um/peak"));
    println!("P7 {} µm, P8 {} µm", error_um(P7), error_um(P7 + 1));
    assert!(error_um(P7) > 1.0 && error_um(P7 + 1) < 1.0);
    let error_um = number(&report, "/contour_error_um/peak");
    assert!(error_um > 0.0 && error_um < 100.0, "{error_um}");
    let samples = Reader::open(&ended.out.join("run.mcap")).expect("the log");
    let feedbacks = samples.filter_map(|sample| match sample {
        Ok(Sample::Feedback(feedback)) => Some(*feedback),
        _ => None,
    });
    let (mut last, mut before, mut together) = (None, [0; PATH_AXES], 0);
    for feedback in feedbacks {
        assert_eq!((feedback.axis_count, feedback.path_axes), (32, 9));
        let now = feedback.path_positions();
        together += usize::from(now.iter().zip(&before).all(|(now, before)| now != before));
        before = now;
        assert_eq!(mm(&feedback, 0), mm(&feedback, SECOND), "{}", feedback.scan);
        let jogged_mm = mm(&feedback, P7);
        assert!((0.0..=7.5).contains(&jogged_mm), "{}", feedback.scan);
        let stand = feedback.axes[SECOND + 1..].iter().enumerate();
        let stand = stand.filter(|(other, _)| other + SECOND + 1 != P7);
        assert!(stand.clone().all(|(_, axis)| axis.command_position == 0));
        last = Some(feedback);
    }
    let last = last.expect("a feedback");
    assert_eq!((last.mode, mm(&last, P7)), (Mode::Finished as u32, 7.5));
    assert!(together > 1000, "scans in which all nine moved: {together}");
    assert_eq!(
        ended
            .stderr()
            .lines()
            .filter(|line| line.contains("ERROR"))
            .count(),
        0
    );
}

#[test]
fn a_cell_of_32_axes_stays_up_and_jogs_one_without_a_letter_to_a_place() {
    let bench = machine_of(&LETTERS, MAX_AXES);
    let program = bench.file("nine.ngc", PROGRAM).display().to_string();
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    for to in ["--to-machine", "--to"] {
        for (place, place_mm) in [("12.5", 12.5), ("-3", -3.0)] {
            obeyed(
                &cell,
                &[
                    "jog", "P7", place, "X", "1", to, "--wait", "--speed", "6000",
                ],
            );
            let now = cell.wait_for(|_| true);
            assert_eq!((mm(&now, P7), mm(&now, 0)), (place_mm, 1.0), "{to}");
        }
    }
    let there = obeyed(&cell, &["jog", "P7", "-3", "--to-machine"]);
    assert!(there.contains("is there already"), "{there}");
    obeyed(&cell, &["mdi", "G0 Z3 B2 C-1"]);
    obeyed(&cell, &["load", &program]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Done));
    let status = crate::readout::status(&cell);
    let axes = status["axes"].as_array().expect("axes");
    let of = |name: &str| axes.iter().find(|axis| axis["axis"] == name);
    let p7 = of("P7").expect("in the status");
    assert_eq!(
        (&p7["machine_mm"], &p7["work_mm"]),
        (&(-3.0).into(), &serde_json::Value::Null)
    );
    assert_eq!(axes.len(), MAX_AXES);
    let words = crate::up::ask(&cell, &["status"]).text;
    assert!(words.contains("\n  P7 "), "{words}");
    obeyed(&cell, &["down"]);
    assert_eq!(cell.finish().status(), 0);
}

#[test]
fn a_33rd_axis_and_a_tenth_letter_are_refused_with_what_is_right() {
    let refused = |letters: &[&str], axes: usize, words: &str| {
        let bench = machine_of(letters, axes);
        let output = quadrant().arg("check").arg(bench.path()).output();
        let output = output.expect("quadrant");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(words), "{said}");
    };
    refused(&LETTERS, 33, "axis has 33 values: must have 1 to 32");
    let tenth = ["X", "Y", "Z", "U", "V", "W", "A", "B", "C", "D"];
    refused(
        &tenth,
        12,
        "axis D name: unknown variant `D`, expected one of `X`, `Y`",
    );
    let words = "axis Y name must come before the second motors and the axes without a letter";
    refused(&["X", "P20", "Y"], 5, words);
    refused(
        &["X", "P32"],
        4,
        "axis P32 name: unknown variant `P32`, expected one of `X`, `Y`",
    );
}
