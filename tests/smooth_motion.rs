//! Limits of jerk through the real processes, and in what `quadrant plan --csv` writes.

use std::path::{Path, PathBuf};

use crate::support::{Bench, number, planned, quadrant, run, run_with, text};

/// 20 times the acceleration in a second, and increments that do not hide it.
const JERK: (&str, &str) = (
    "acceleration_mm_s2 = 5000.0",
    "jerk_mm_s3 = 100000.0\nincrement_nm = 0.1\nacceleration_mm_s2 = 5000.0",
);
const JERK_MM_S3: f64 = 100_000.0;

/// A curve in chords, corners, an arc between lines, a dwell, an exact corner, and rapids.
fn program(bench: &Bench) -> PathBuf {
    let mut text = String::from("G21 G17 G90 G94 G64 P0.02\nG0 X5\nG1 F5000\n");
    for index in 0..120 {
        let angle = f64::from(index) * 0.05;
        let radius = 5.0 + 0.3 * angle;
        text += &format!(
            "X{:.4} Y{:.4}\n",
            radius * angle.cos(),
            radius * angle.sin()
        );
    }
    text += "X20 Y5\nY15\nG4 P0.05\nX0\nG2 X10 Y5 I0 J-10\nG61 G1 X15\nY0\nG0 X0 Y0\nM2\n";
    bench.file("smooth.ngc", &text)
}

/// The highest third difference of any axis over the cube of the scan period.
fn jerk_mm_s3(machine: &Path, program: &Path) -> f64 {
    let rows: Vec<[f64; 2]> = planned(machine, program)
        .iter()
        .map(|row| [row[5], row[6]])
        .collect();
    let third = |four: &[[f64; 2]], axis: usize| {
        let [a, b, c, d] = [0, 1, 2, 3].map(|index| four[index][axis]);
        ((d - a) - 3.0 * (c - b)).abs() / 1e-9
    };
    let both = rows
        .windows(4)
        .flat_map(|four| [third(four, 0), third(four, 1)]);
    both.fold(0.0, f64::max)
}

#[test]
fn a_program_keeps_the_jerk_of_the_axes_and_takes_a_little_longer() {
    let (free, limited) = (Bench::of("xy", &[]), Bench::of("xy", &[JERK]));
    // The file has positions of 1 nm: four of them are 4,000 mm/s³.
    let highest = jerk_mm_s3(limited.path(), &program(&limited));
    assert!(highest <= JERK_MM_S3 + 4_000.0, "{highest}");
    assert!(highest > 0.6 * JERK_MM_S3, "{highest}: it is used");
    assert!(jerk_mm_s3(free.path(), &program(&free)) > 10.0 * JERK_MM_S3);
}

#[test]
fn jerk_is_kept_whoever_is_killed_and_the_run_is_the_same_every_time() {
    let bench = Bench::of("xy", &[JERK]);
    let program = program(&bench);
    let undisturbed = run(bench.path(), &program).good_report();
    assert_eq!(number(&undisturbed, "/limits/jerk_exceeded"), 0.0);
    let kills = "[restart]\nrestarts_max = 100\nplanner = \"resume\"\nservo = \"resume\"\n\
        [[fault]]\nat = { scan = 700 }\nprocess = \"planner\"\ndo = \"kill\"\nrestart_after_scans = 150\n\
        [[fault]]\nat = { scan = 1500 }\nprocess = \"servo-X\"\ndo = \"kill\"\nrestart_after_scans = 100\n\
        [[fault]]\nat = { scan = 3000 }\nprocess = \"planner\"\ndo = \"kill\"\nrestart_after_scans = 90\n";
    let faults = bench.file("faults.toml", kills).display().to_string();
    let reports = [(); 2].map(|()| {
        let report = run_with(bench.path(), &program, &["--faults", &faults]).good_report();
        assert_eq!(text(&report, "/outcome/kind"), "completed");
        for limit in ["velocity", "acceleration", "jerk", "travel"] {
            let pointer = format!("/limits/{limit}_exceeded");
            assert_eq!(number(&report, &pointer), 0.0, "{report}");
        }
        report
    });
    let digest = |report: &serde_json::Value| report.pointer("/digest").cloned();
    assert_eq!(digest(&reports[0]), digest(&reports[1]));
}

#[test]
fn increments_that_hide_the_jerk_are_refused_with_what_they_look_like() {
    let (_, limited) = JERK;
    let coarse = limited.replace("increment_nm = 0.1\n", "increment_nm = 20.0\n");
    let bench = Bench::of("xy", &[(JERK.0, coarse.as_str())]);
    let output = quadrant()
        .arg("check")
        .args([bench.path(), program(&bench).as_path()])
        .output();
    let output = output.expect("check");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(
        stderr.contains("mm/s³, more than half of the limit"),
        "{stderr}"
    );
}
