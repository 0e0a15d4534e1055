//! What the identified model, learning and a linear scale make of circles, through the real processes.

use std::fs;

use serde_json::Value;

use crate::robust::scaled;
use crate::size;
use crate::support::{Bench, Run, circle_program, run, run_with};

/// Largest protrusion or undercut of a run in steady motion, in µm, on the table.
fn worst_um(report: &Value) -> f64 {
    let reversals = report["reversals"].as_array().expect("reversals");
    let on_arcs = reversals
        .iter()
        .filter(|r| r["radius_mm"].is_number() && r["steady"] == true);
    let heights: Vec<f64> = on_arcs
        .map(|r| {
            let outward = r["protrusion_um"].as_f64().expect("a height");
            outward.max(-r["undercut_um"].as_f64().expect("a depth"))
        })
        .collect();
    assert!(heights.len() >= 12, "{} reversals on arcs", heights.len());
    heights.into_iter().fold(0.0, f64::max)
}

fn circle(bench: &Bench, radius: f64, feed: f64) -> std::path::PathBuf {
    bench.file(
        &format!("r{radius}-f{feed}.ngc"),
        &circle_program(radius, feed, (3.0, -2.0), 40.0),
    )
}

/// Multiplies numbers of these keys in the plant file.
fn change_plant(bench: &Bench, keys: &[&str], factor: f64) {
    let path = bench.path().join("plant.toml");
    let text = fs::read_to_string(&path).expect("plant.toml");
    fs::write(path, scaled(&text, keys, factor)).expect("writing plant.toml");
}

const FRICTION: [&str; 4] = [
    "coulomb_torque_nm",
    "static_torque_nm",
    "coulomb_n",
    "static_n",
];

#[test]
fn the_shipped_machines_keep_circles_off_the_tuning_within_their_figures() {
    if size::is_left_out() {
        return;
    }
    let machines = [("xy", 5.5), ("xy-fast", 4.0), ("xy-torque", 4.0)];
    let each = |machine| [(60.0, 8000.0), (12.0, 9000.0), (17.0, 2200.0)].map(|of| (machine, of));
    let circles = machines.into_iter().flat_map(each);
    for ((machine, most_um), (radius, feed)) in circles {
        let bench = Bench::of(machine, &[]);
        let worst = worst_um(&run(bench.path(), circle(&bench, radius, feed)).good_report());
        assert!(
            worst <= most_um,
            "{machine} R{radius} F{feed}: {worst:.1} µm"
        );
    }
}

/// A start after a rest, along with the slow axis that turns round: springs that the stop had wound up are let go meanwhile.
#[test]
fn a_start_from_rest_keeps_the_tool_on_its_path() {
    for machine in size::one_in(2, ["xy", "xy-fast"]) {
        let bench = Bench::of(machine, &[]);
        let program = bench.file(
            "starts.ngc",
            "G21 G90 G61\nG0 X30\nG3 X30 Y0 I-30 F4000\nG3 X30 Y0 I-30\nG4 P0.2\nG1 X0 Y8 F6000\nG4 P0.2\n\
             G1 X-20 Y-10\nG4 P0.2\nG1 X5 Y-5\nG4 P0.2\nM2\n",
        );
        let report = run(bench.path(), program).good_report();
        let blocks = report["blocks"].as_array().expect("blocks");
        let starts: Vec<f64> = blocks
            .iter()
            .filter(|block| {
                [6, 8, 10]
                    .map(|line| block["block"] == line)
                    .contains(&true)
            })
            .map(|block| block["contour_error_um_peak"].as_f64().expect("µm"))
            .collect();
        assert_eq!(starts.len(), 3, "{blocks:?}");
        assert!(starts.iter().all(|um| *um <= 6.0), "{machine}: {starts:?}");
    }
}

/// Position and velocity come to the drive together: nothing is fed forward further ahead than a scan.
#[test]
fn a_drive_that_closes_the_position_loop_is_as_good_as_one_that_closes_the_velocity_loop() {
    if size::is_left_out() {
        return;
    }
    let velocity = Bench::of("xy", &[]);
    let position = Bench::of(
        "xy",
        &[
            ("drive_mode = \"velocity\"", "drive_mode = \"position\""),
            ("advance_ms = 2.25", "advance_ms = 1.0"),
        ],
    );
    let with =
        |bench: &Bench| worst_um(&run(bench.path(), circle(bench, 25.0, 3000.0)).good_report());
    let (velocity_um, position_um) = (with(&velocity), with(&position));
    assert!(
        position_um <= velocity_um + 1.0,
        "{position_um} µm, in velocity mode {velocity_um} µm"
    );
}

#[test]
fn a_linear_scale_is_no_worse_than_the_motor_encoder() {
    if size::is_left_out() {
        return;
    }
    let motor = Bench::of("xy", &[]);
    let scale = Bench::of(
        "xy",
        &[(
            "drive_mode = \"velocity\"",
            "feedback = \"scale\"\ndual_feedback_ms = 5.0\ndrive_mode = \"velocity\"",
        )],
    );
    for (radius, feed) in [(25.0, 3000.0), (10.0, 10_000.0)] {
        let with =
            |bench: &Bench| worst_um(&run(bench.path(), circle(bench, radius, feed)).good_report());
        let (motor_um, scale_um) = (with(&motor), with(&scale));
        assert!(
            scale_um <= motor_um + 0.2,
            "R{radius} F{feed}: scale {scale_um:.1} µm, motor {motor_um:.1} µm"
        );
    }
}

#[test]
fn learning_recovers_from_changed_friction_within_three_circles_and_only_when_asked_to() {
    // Friction that is followed anyway leaves nothing to learn.
    let bench = Bench::of("xy", &[("mode = \"on\"", "mode = \"off\"")]);
    change_plant(&bench, &FRICTION, 1.3);
    let program = circle(&bench, 25.0, 3000.0);
    let file = bench.path().join("learned.toml");
    let before = worst_um(&run(bench.path(), &program).good_report());
    assert!(
        !file.exists(),
        "a run without --learn wrote {}",
        file.display()
    );
    for _ in 0..3 {
        run_with(bench.path(), &program, &["--learn"]).good_report();
    }
    let learned = run(bench.path(), &program);
    let after = worst_um(&learned.good_report());
    assert!(
        before > 5.5,
        "{before:.1} µm: the change of friction does not show"
    );
    assert!(
        after <= 3.9,
        "{before:.1} µm before, {after:.1} µm after three passes"
    );
    let again = run(bench.path(), &program);
    assert_eq!(
        learned.report()["digest"],
        again.report()["digest"],
        "the same tables, the same run"
    );
    let without = run_with(bench.path(), &program, &["--no-learned"]);
    let without_um = worst_um(&without.good_report());
    assert!((without_um - before).abs() < 1e-9, "{without_um} {before}");
}

#[test]
fn a_run_that_tripped_teaches_nothing() {
    let bench = Bench::of(
        "xy",
        &[(
            "following_error_limit_mm = 2.0",
            "following_error_limit_mm = 0.002",
        )],
    );
    let ended: Run = run_with(bench.path(), circle(&bench, 25.0, 3000.0), &["--learn"]);
    assert_eq!(ended.status(), 1);
    assert!(!bench.path().join("learned.toml").exists());
}

#[test]
fn learned_tables_that_cannot_be_are_refused_before_anything_starts() {
    let bench = Bench::of("xy", &[]);
    let program = circle(&bench, 10.0, 3000.0);
    run_with(bench.path(), &program, &["--learn"]).good_report();
    let file = bench.path().join("learned.toml");
    let good = fs::read_to_string(&file).expect("learned.toml");
    for (what, by, says) in [
        ("version = 4", "version = 9", "version = 9"),
        ("machine = \"xy\"", "machine = \"lathe\"", "another machine"),
        ("friction_scale = ", "friction_scale = -", "friction_scale"),
        ("name = \"X\"", "name = \"U\"", "none of that name"),
    ] {
        fs::write(&file, good.replace(what, by)).expect("writing");
        let refused = run(bench.path(), &program);
        assert_eq!(refused.status(), 2, "{by}");
        assert!(
            refused.stderr().contains(says),
            "{by}: {}",
            refused.stderr()
        );
    }
    run_with(bench.path(), &program, &["--no-learned"]).good_report();
    // Training data of other settings are set aside, not refused.
    let other = good.replace("settings = \"", "settings = \"0");
    fs::write(&file, other).expect("writing");
    let set_aside = run(bench.path(), &program);
    set_aside.good_report();
    assert!(
        set_aside.stderr().contains("is not used"),
        "{}",
        set_aside.stderr()
    );
}
