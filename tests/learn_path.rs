//! Learning along the path of a program that runs again and again, through the real processes.

use std::fs;
use std::path::{Path, PathBuf};

use crate::robust::scaled;
use crate::support::{Bench, Run, run, run_with};

/// One circle both ways, with what stands between.
const CIRCLE: &str = "G21 G17 G90 G94\nG91.1\nG0 X10 Y0\nG4 P0.2\nF5000\nG3 X10 Y0 I-10\nG3 X10 Y0 I-10\nG4 P0.2\nG2 X10 Y0 I-10\nG2 X10 Y0 I-10\nM2\n";

/// A machine whose screws are half as stiff as its model says.
fn soft(edits: &[(&str, &str)]) -> (Bench, PathBuf) {
    let bench = Bench::of("xy", edits);
    let file = bench.path().join("plant.toml");
    let plant = fs::read_to_string(&file).expect("plant.toml");
    let plant = scaled(&plant, &["stiffness_n_per_m"], 0.5);
    fs::write(&file, plant).expect("writing plant.toml");
    let program = bench.file("circle.ngc", CIRCLE);
    (bench, program)
}

/// Mean protrusion or undercut of a run in steady motion, in µm, on the table.
fn mean_um(run: &Run) -> f64 {
    let report = run.good_report();
    let reversals = report["reversals"].as_array().expect("reversals");
    let heights: Vec<f64> = reversals
        .iter()
        .filter(|r| r["radius_mm"].is_number() && r["steady"] == true)
        .map(|r| {
            let outward = r["protrusion_um"].as_f64().expect("a height");
            outward.max(-r["undercut_um"].as_f64().expect("a depth"))
        })
        .collect();
    assert!(heights.len() >= 6, "{} reversals on arcs", heights.len());
    heights.iter().sum::<f64>() / heights.len() as f64
}

fn learned_file(bench: &Bench) -> PathBuf {
    bench.path().join("learned-path/circle.ngc.csv")
}

fn pass(bench: &Bench, program: &Path) -> Run {
    let pass = run_with(bench.path(), program, &["--learn-path"]);
    assert_eq!(pass.status(), 0, "{}", pass.stderr());
    pass
}

#[test]
fn four_passes_of_a_program_take_away_half_of_what_a_softer_screw_leaves_and_a_standby_goes_on_with_it_to_the_bit()
 {
    let (bench, program) = soft(&[(
        "drive_mode = \"velocity\"",
        "drive_mode = \"velocity\"\nstandby = true",
    )]);
    let before = mean_um(&pass(&bench, &program));
    for _ in 1..4 {
        pass(&bench, &program);
    }
    let learned = run(bench.path(), &program);
    let after = mean_um(&learned);
    assert!(
        after <= 0.5 * before,
        "{before:.2} µm before, {after:.2} after"
    );
    let without = run_with(bench.path(), &program, &["--no-learned"]);
    assert!((mean_um(&without) - before).abs() < 1e-9);
    // The copy in the run directory is what ran, and gives the same again.
    let copied = fs::read_to_string(learned.out.join("learned-path.csv")).expect("the copy");
    assert_eq!(
        copied,
        fs::read_to_string(learned_file(&bench)).expect("the file")
    );
    let again = run(bench.path(), &program);
    assert_eq!(learned.report()["digest"], again.report()["digest"]);

    let faults = bench.file(
        "faults.toml",
        "[[fault]]\nat = { scan = 1500 }\nprocess = \"servo-X\"\ndo = \"kill\"\n",
    );
    let faults = ["--faults", faults.to_str().expect("a name")];
    let killed = run_with(bench.path(), &program, &faults).good_report();
    assert_eq!(killed["faults"][0]["process"], "servo-X");
    assert!(killed["motion_digest"].is_string());
    assert_eq!(killed["motion_digest"], learned.report()["motion_digest"]);
}

#[test]
fn what_was_learned_along_a_path_is_refused_when_damaged_and_not_used_for_another_program_or_machine()
 {
    let (bench, program) = soft(&[]);
    let first = run(bench.path(), &program);
    let digest = first.good_report()["digest"].clone();
    for _ in 0..2 {
        pass(&bench, &program);
    }
    let file = learned_file(&bench);
    let good = fs::read_to_string(&file).expect("the file");
    assert_ne!(run(bench.path(), &program).good_report()["digest"], digest);

    fs::write(&file, good.replacen("place_mm", "place_nm", 1)).expect("writing");
    let damaged = run(bench.path(), &program);
    assert_eq!(damaged.status(), 2);
    assert!(
        damaged.stderr().contains("is damaged"),
        "{}",
        damaged.stderr()
    );
    let without = run_with(bench.path(), &program, &["--no-learned"]);
    assert_eq!(without.good_report()["digest"], digest);
    fs::write(&file, &good).expect("writing");

    // The same name, but another program.
    fs::write(&program, CIRCLE.replace("F5000", "F4000")).expect("writing");
    let other = run(bench.path(), &program);
    other.good_report();
    assert!(other.stderr().contains("the program"), "{}", other.stderr());
    assert!(!other.out.join("learned-path.csv").exists());
    fs::write(&program, CIRCLE).expect("writing");

    let machine = bench.path().join("machine.toml");
    let text = fs::read_to_string(&machine).expect("machine.toml");
    fs::write(
        &machine,
        text.replace("gain_per_s = 50.0", "gain_per_s = 49.0"),
    )
    .expect("writing");
    let tuned = run(bench.path(), &program);
    tuned.good_report();
    assert!(
        tuned.stderr().contains("the settings"),
        "{}",
        tuned.stderr()
    );
    assert!(!tuned.out.join("learned-path.csv").exists());
}

#[test]
fn a_run_with_a_replaced_servo_or_without_a_table_scale_teaches_nothing_along_its_path() {
    let (bench, program) = soft(&[]);
    let faults = bench.file(
        "faults.toml",
        "[restart]\nservo = \"resume\"\n[[fault]]\nat = { scan = 1500 }\nprocess = \"servo-X\"\ndo = \"kill\"\n",
    );
    let faults = ["--learn-path", "--faults", faults.to_str().expect("a name")];
    let replaced = run_with(bench.path(), &program, &faults);
    assert_ne!(replaced.status(), 0);
    assert!(!learned_file(&bench).exists(), "{}", replaced.stderr());

    let file = bench.path().join("plant.toml");
    let plant = fs::read_to_string(&file).expect("plant.toml");
    let plant: String = plant
        .lines()
        .filter(|line| !line.starts_with("[axis.scale]") && !line.starts_with("resolution_nm"))
        .flat_map(|line| [line, "\n"])
        .collect();
    fs::write(&file, plant).expect("writing");
    let blind = run_with(bench.path(), &program, &["--learn-path"]);
    assert_ne!(blind.status(), 0);
    assert!(
        blind.stderr().contains("no table scale"),
        "{}",
        blind.stderr()
    );
    assert!(!learned_file(&bench).exists());
}
