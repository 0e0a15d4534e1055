//! `quadrant tune`: from untuned gains to circles within bounds, on machines that nobody reported it about.

use std::fs;
use std::path::Path;
use std::process::Output;

use machine::Machine;

use crate::quality::{measure, worst_um};
use crate::size;
use crate::support::{Bench, dead_time_line, dead_time_of, quadrant};

/// The reference machine as somebody might set it who knows nothing of it, with `plant` edits of what is true.
fn untuned(plant: &[(&str, &str)]) -> Bench {
    let bench = Bench::of("xy", &[]);
    let file = bench.path().join("machine.toml");
    let text = fs::read_to_string(&file).expect("machine.toml");
    let mut skipping = false;
    let mut lines = Vec::new();
    for line in text.lines() {
        if line.starts_with('[') {
            skipping = [
                "[axis.model",
                "[axis.torque_feed_forward]",
                "[axis.adaptation]",
            ]
            .iter()
            .any(|table| line.starts_with(table));
        }
        if skipping {
            continue;
        }
        let key = line.split(" = ").next().unwrap_or_default();
        lines.push(match key {
            "gain_per_s" => "gain_per_s = 20.0".into(),
            "gain_n_s_per_m" => "gain_n_s_per_m = 86000.0".into(),
            "advance_ms" => "advance_ms = 0.0".into(),
            "method" => "method = \"none\"".into(),
            _ => line.to_string(),
        });
    }
    fs::write(&file, lines.join("\n") + "\n").expect("machine.toml");
    let file = bench.path().join("plant.toml");
    let mut text = fs::read_to_string(&file).expect("plant.toml");
    for (what, by) in plant {
        assert!(text.contains(what), "plant.toml has no {what:?}");
        text = text.replace(what, by);
    }
    fs::write(&file, text).expect("plant.toml");
    bench
}

/// Without the slow circle, which takes most of the time and none of these tests asks for.
const QUICK: [&str; 2] = ["--circles", "25:3000,10:10000"];

fn tune(machine: &Path, more: &[&str]) -> Output {
    quadrant()
        .arg("tune")
        .arg(machine)
        .args(more)
        .output()
        .expect("quadrant tune")
}

fn words(output: &Output) -> String {
    format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

fn near(what: &str, found: f64, right: f64, percent: f64) {
    assert!(
        (found / right - 1.0).abs() * 100.0 <= percent,
        "{what} {found}, really {right}"
    );
}

#[test]
fn from_untuned_gains_it_finds_the_machine_and_its_circles_are_round_to_4_um() {
    let bench = untuned(&[]);
    let old = fs::read_to_string(bench.path().join("machine.toml")).expect("machine.toml");
    let circles: &[&str] = if size::is_full() { &[] } else { &QUICK };
    let output = tune(bench.path(), circles);
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
    let kept = fs::read_to_string(bench.path().join("machine.toml.before-tune"));
    assert_eq!(kept.expect("the old file"), old);

    let machine = Machine::load(bench.path()).expect("the new file");
    for (axis, mass_kg, friction_n, gap_um, lost_um) in
        [(0, 858.0, 451.3, 5.0, 8.3), (1, 908.0, 561.6, 8.0, 12.3)]
    {
        let axis = &machine.axes[axis];
        let model = axis.model.expect("a model");
        let table = model.table.expect("a table");
        near("mass", model.mass_kg, mass_kg, 3.0);
        near("friction", model.coulomb_n, friction_n, 3.0);
        near("gap", table.gap_um, gap_um, 10.0);
        near("lost motion", axis.reversal.backlash_um, lost_um, 5.0);
    }
    let circles = [(25.0, 3000.0), (17.0, 2200.0), (60.0, 8000.0)];
    for (radius, feed) in size::one_in(3, circles) {
        let worst = worst_um(&measure(&bench, radius, feed, (0.0, 0.0), 45.0));
        assert!(worst <= 3.9, "R{radius} F{feed}: {worst} µm");
    }
}

#[test]
fn another_friction_and_another_gap_are_found_as_well() {
    if size::is_left_out() {
        return;
    }
    let bench = untuned(&[
        ("coulomb_torque_nm = 0.40", "coulomb_torque_nm = 0.52"),
        ("static_torque_nm = 0.50", "static_torque_nm = 0.65"),
        ("coulomb_n = 200.0", "coulomb_n = 260.0"),
        ("static_n = 260.0", "static_n = 338.0"),
        ("gap_um = 5.0", "gap_um = 7.5"),
    ]);
    // The last one turns as gently as R100 F1000, in half the time.
    let output = tune(bench.path(), &["--circles", "25:3000,10:10000,25:500"]);
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
    let machine = Machine::load(bench.path()).expect("the new file");
    let model = machine.axes[0].model.expect("a model");
    near("friction", model.coulomb_n, 1.3 * 451.3, 3.0);
    near("gap", model.table.expect("a table").gap_um, 7.5, 10.0);
    let worst = worst_um(&measure(&bench, 25.0, 3000.0, (0.0, 0.0), 45.0));
    assert!(worst <= 3.9, "{worst} µm");
}

/// A machine that comes with the product, with drives that have this dead time; its own file has 1.
fn with_dead_time(machine: &str, scans: u32) -> Bench {
    let bench = Bench::of(machine, &[]);
    let file = bench.path().join("plant.toml");
    let text = fs::read_to_string(&file).expect("plant.toml");
    let drive = format!("[drive]\ndead_time_scans = {scans}\n\n[[axis]]");
    fs::write(&file, text.replacen("[[axis]]", &drive, 1)).expect("plant.toml");
    bench
}

#[test]
fn the_dead_time_of_the_drives_is_found_to_a_quarter_of_a_scan() {
    let machines = [("xy", 2), ("xy-fast", 4), ("xy-torque", 1)];
    for (machine, scans) in size::one_in(3, machines) {
        let bench = with_dead_time(machine, scans);
        let line = dead_time_line(quadrant().arg("tune").arg(bench.path()).arg("--dry-run"));
        println!("{machine} {scans}: {line}");
        for axis in ["X", "Y"] {
            let off = (dead_time_of(&line, axis) - f64::from(scans)).abs();
            assert!(off <= 0.25, "{machine} with {scans}: {line}");
        }
        let right = format!("right is [scan] dead_time_scans = {scans} in the machine file");
        assert_eq!(line.ends_with(&right), scans != 1, "{line}");
    }
}

#[test]
fn a_machine_whose_file_has_another_dead_time_is_tuned_for_the_one_that_its_drives_have() {
    if size::is_left_out() {
        return;
    }
    let bench = with_dead_time("xy", 3);
    let output = tune(bench.path(), &QUICK);
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
    let machine = Machine::load(bench.path()).expect("the new file");
    assert_eq!(machine.scan.dead_time_scans, 3);
    // 4.5 scans of 1 ms less the drive's 0.25 ms.
    assert_eq!(machine.axes[0].feed_forward.advance_ms, 4.25);
    let worst = worst_um(&measure(&bench, 25.0, 3000.0, (0.0, 0.0), 45.0));
    assert!(worst <= 3.9, "{worst} µm");
}

/// Half of the lost motion is no gap, but bearings that give way and slip; friction is LuGre; the torque is shown 2 ms late.
#[test]
fn a_machine_that_is_not_as_the_model_says_is_tuned_and_what_was_found_is_told() {
    if size::is_left_out() {
        return;
    }
    let scale = "[axis.scale]\nresolution_nm = 50.0      # [typ]\n";
    let late = format!("{scale}\n[axis.measurement]\ntorque_delay_ms = 2.0\n");
    let bench = untuned(&[
        (
            "gap_um = 5.0",
            "gap_um = 2.5\nhysteresis_n = [30.0, 30.0, 20.0]",
        ),
        (
            "gap_um = 8.0",
            "gap_um = 4.0\nhysteresis_n = [39.0, 39.0, 26.0]",
        ),
        ("coulomb_n = ", "law = \"lugre\"\ncoulomb_n = "),
        (scale, &late),
    ]);
    let output = tune(bench.path(), &QUICK);
    let printed = words(&output);
    assert_eq!(output.status.code(), Some(0), "{printed}");
    assert!(printed.contains("2.00 ms late"), "{printed}");
    assert!(printed.contains("Best: "), "{printed}");
    let machine = Machine::load(bench.path()).expect("the new file");
    for (axis, (mass_kg, friction_n)) in machine.axes.iter().zip([(858.0, 451.3), (908.0, 561.6)]) {
        let model = axis.model.expect("a model");
        near("mass", model.mass_kg, mass_kg, 3.0);
        near("friction", model.coulomb_n, friction_n, 3.0);
        assert_eq!(axis.disturbance_observer.bandwidth_rad_s, 0.0);
    }
    let worst = worst_um(&measure(&bench, 25.0, 3000.0, (0.0, 0.0), 45.0));
    assert!(worst <= 3.9, "{worst} µm");
}

#[test]
fn a_machine_that_the_model_does_not_fit_is_refused_and_its_file_stays() {
    if size::is_left_out() {
        return;
    }
    // A coupling that has come loose: the table follows the motor like a weight on a rubber band.
    let bench = untuned(&[("stiffness_n_per_m = 1.2e8", "stiffness_n_per_m = 1.0e6")]);
    let file = bench.path().join("machine.toml");
    let old = fs::read_to_string(&file).expect("machine.toml");
    let output = tune(bench.path(), &QUICK);
    assert_eq!(output.status.code(), Some(1), "{}", words(&output));
    let printed = words(&output);
    assert!(
        printed.contains("axis X") && printed.contains("nothing is written"),
        "{printed}"
    );
    assert_eq!(fs::read_to_string(&file).expect("machine.toml"), old);
    assert!(!bench.path().join("machine.toml.before-tune").exists());
}

#[test]
fn an_axis_that_trips_during_the_test_motions_is_named_and_nothing_is_written() {
    let bench = untuned(&[]);
    let file = bench.path().join("machine.toml");
    let old = fs::read_to_string(&file).expect("machine.toml").replace(
        "following_error_limit_mm = 2.0",
        "following_error_limit_mm = 0.02",
    );
    fs::write(&file, &old).expect("machine.toml");
    let output = tune(bench.path(), &QUICK);
    assert_eq!(output.status.code(), Some(1), "{}", words(&output));
    let printed = words(&output);
    assert!(
        printed.contains("following error") && printed.contains("axis X"),
        "{printed}"
    );
    assert_eq!(fs::read_to_string(&file).expect("machine.toml"), old);
}

#[test]
fn an_axis_without_a_scale_says_so_and_takes_its_lost_motion_as_reported_and_a_dry_run_only_shows_it()
 {
    if size::is_left_out() {
        return;
    }
    let scale = "[axis.scale]\nresolution_nm = 50.0      # [typ]\n";
    let bench = untuned(&[(scale, "")]);
    let file = bench.path().join("machine.toml");
    let old = fs::read_to_string(&file).expect("machine.toml");
    let output = tune(
        bench.path(),
        &[
            &["--dry-run", "--lost-motion-um", "X=8.3,Y=12.3"],
            &QUICK[..],
        ]
        .concat(),
    );
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
    assert!(words(&output).contains("axis X has no scale"));
    assert_eq!(fs::read_to_string(&file).expect("machine.toml"), old);
    let shown = String::from_utf8_lossy(&output.stdout).into_owned();
    let from = shown.find("# The reference machine").expect("the file");
    let machine = Machine::parse("shown", &shown[from..]).expect("a machine file");
    assert_eq!(machine.axes[0].reversal.backlash_um, 8.3);
    assert!(machine.axes[0].model.expect("a model").table.is_none());
}

#[test]
fn a_lost_motion_of_an_axis_that_is_not_there_and_a_circle_without_a_feed_are_bad_input() {
    let bench = untuned(&[]);
    let output = tune(bench.path(), &["--lost-motion-um", "Q=8"]);
    assert_eq!(output.status.code(), Some(2), "{}", words(&output));
    assert!(words(&output).contains("no axis Q"));
    let output = tune(bench.path(), &["--travel-mm", "X=far"]);
    assert_eq!(output.status.code(), Some(2), "{}", words(&output));
    assert!(words(&output).contains("--travel-mm X=far"));
    let output = tune(bench.path(), &["--circles", "25"]);
    assert_eq!(output.status.code(), Some(2), "{}", words(&output));
    assert!(words(&output).contains("must be RADIUS:FEED"));
}

/// A table of 100 kg on a screw of 16.68 N/µm, and one of 150 kg on 25.02 N/µm: 65 Hz, damped by 2 %.
#[test]
fn a_machine_that_rings_gets_motion_that_spares_it() {
    if size::is_left_out() {
        return;
    }
    let bench = Bench::of("xy", &[]);
    let file = bench.path().join("plant.toml");
    let plant = fs::read_to_string(&file).expect("plant.toml");
    let soft = plant
        .replacen(
            "stiffness_n_per_m = 1.2e8",
            "stiffness_n_per_m = 1.668e7",
            1,
        )
        .replacen(
            "stiffness_n_per_m = 1.2e8",
            "stiffness_n_per_m = 2.502e7",
            1,
        )
        .replace("damping_ratio = 0.08", "damping_ratio = 0.02");
    fs::write(&file, soft).expect("plant.toml");
    let output = tune(bench.path(), &QUICK);
    let said = words(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("motion is made to spare"), "{said}");
    let machine = Machine::load(bench.path()).expect("the new file");
    near(
        "Hz",
        machine.path.vibration_hz.expect("a frequency"),
        65.0,
        10.0,
    );
    for axis in &machine.axes {
        let jerk_mm_s3 = axis.jerk_mm_s3.expect("a limit of jerk");
        assert!(jerk_mm_s3 <= 20.0 * axis.acceleration_mm_s2, "{jerk_mm_s3}");
    }
}
