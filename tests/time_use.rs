//! What `quadrant plan` says about where a program's time goes.

use std::fs;
use std::path::PathBuf;

use crate::support::{Bench, plan, planned, quadrant};

/// A long line, a right angle, an arc that is too narrow for its feed, a dwell and a rapid.
fn program(bench: &Bench) -> PathBuf {
    let text = "G21 G17 G90 G94 G61\nG1 F6000\nX50\nY30\nG2 X52 Y32 I2 J0\nG1 X80\nG4 P0.5\nG0 X0 Y0\nM2\n";
    bench.file("where.ngc", text)
}

#[test]
fn the_places_that_cost_time_are_named_with_the_limit_that_holds_the_tool_back() {
    let bench = Bench::of("xy", &[]);
    let text = plan(bench.path(), &program(&bench), &[]);
    for words in [
        "%  the programmed feed\n",
        "%  corners: acceleration of Y\n",
        "line 3: corner of 90.0°: acceleration of",
        "line 7: rest",
        "%  curves: acceleration of Y\n",
        "highest speed of X",
    ] {
        assert!(text.contains(words), "no {words:?} in\n{text}");
    }
    let limited = plan(
        bench.path(),
        &program(&bench),
        &["--what-if", "jerk=40000,acceleration.Y=2500"],
    );
    for words in [
        "what if jerk=40000, acceleration.Y=2500: ",
        "line 5: jump of the curvature: jerk of X",
        " of 2500 mm/s²",
    ] {
        assert!(limited.contains(words), "no {words:?} in\n{limited}");
    }
}

#[test]
fn blocks_add_up_to_the_time_of_the_program_and_the_picture_shows_the_path() {
    let bench = Bench::of("xy", &[]);
    let [blocks, svg] = ["blocks.csv", "path.svg"].map(|name| bench.path().join(name));
    let options = [
        "--blocks",
        &blocks.display().to_string(),
        "--svg",
        &svg.display().to_string(),
    ];
    plan(bench.path(), &program(&bench), &options);
    let scans = planned(bench.path(), &program(&bench)).len();
    let text = fs::read_to_string(&blocks).expect("the blocks");
    assert!(text.starts_with("line,length_mm,time_s,asked_s,held_back_by\n"));
    let rows: Vec<Vec<&str>> = text
        .lines()
        .skip(1)
        .map(|row| row.split(',').collect())
        .collect();
    let lines: Vec<&str> = rows.iter().map(|row| row[0]).collect();
    assert_eq!(lines, ["3", "4", "5", "6", "7", "8"]);
    let sum = |column: usize| -> f64 {
        let numbers = rows.iter().map(|row| row[column].parse::<f64>());
        numbers.map(|of| of.expect("a number")).sum()
    };
    assert!((sum(2) - scans as f64 * 1e-3).abs() < 1e-3, "{}", sum(2));
    assert!((sum(1) - (50.0 + 30.0 + std::f64::consts::PI + 28.0 + 86.162)).abs() < 0.01);
    let picture = fs::read_to_string(&svg).expect("the picture");
    assert!(picture.matches("<polyline").count() > 20, "{picture}");
}

#[test]
fn a_wrong_what_if_says_what_would_be_right() {
    let bench = Bench::of("xy", &[]);
    for (words, expected) in [
        ("jerk", "jerk (.AXIS for one axis), tolerance or vibration"),
        ("acceleration.Q=3", "the machine has no axis Q"),
    ] {
        let output = quadrant()
            .arg("plan")
            .args([bench.path(), &program(&bench)])
            .args(["--what-if", words])
            .output()
            .expect("plan");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains(expected), "{stderr}");
    }
}
