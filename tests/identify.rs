//! `quadrant identify`: a real axis, and recordings of our own.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

use crate::support::{Bench, quadrant, root};

/// The measurements of a real axis as text, `emps.csv` and `emps-pulses.csv`; nothing where they are not there.
fn emps() -> Option<TempDir> {
    let named = std::env::var_os("QUADRANT_EMPS").map(PathBuf::from);
    let source = named.unwrap_or_else(|| root().join("../shared/emps"));
    if !source.join("DATA_EMPS.mat").exists() {
        eprintln!(
            "skipped: {} has no DATA_EMPS.mat (nonlinearbenchmark.org); QUADRANT_EMPS names its folder",
            source.display()
        );
        return None;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let made = Command::new("python3")
        .arg(root().join("tests/foreign/emps/to_csv.py"))
        .args([source.as_path(), folder.path()])
        .status();
    match made {
        Ok(status) => assert!(status.success(), "to_csv.py"),
        Err(error) => {
            eprintln!("skipped: python3: {error}");
            return None;
        }
    }
    Some(folder)
}

fn identify(files: &[&Path], more: &[&str]) -> (Option<i32>, String) {
    let output = quadrant()
        .arg("identify")
        .args(files.first())
        .args(
            files
                .iter()
                .skip(1)
                .flat_map(|file| [Path::new("--validate"), file]),
        )
        .args(more)
        .output()
        .expect("quadrant identify");
    let words = [output.stdout, output.stderr].map(|of| String::from_utf8_lossy(&of).into_owned());
    (output.status.code(), words.concat())
}

/// First number behind each place in which these words begin a line.
fn numbers(printed: &str, words: &str) -> Vec<f64> {
    let lines = printed
        .lines()
        .filter_map(|line| line.trim().strip_prefix(words));
    lines
        .filter_map(|line| line.split_whitespace().next()?.parse().ok())
        .collect()
}

/// Janot, Gautier, Brunot (2019) find 95.109 kg, 203.50 N·s/m, 20.394 N, −3.165 N by least squares, and leave 4.08 % of the force
/// unexplained, 5.98 % on the file with the pulses.
#[test]
fn a_real_axis_is_found_and_another_recording_of_it_is_explained() {
    let Some(folder) = emps() else { return };
    let (taught, seen) = (
        folder.path().join("emps.csv"),
        folder.path().join("emps-pulses.csv"),
    );
    let (status, printed) = identify(&[&taught, &seen], &[]);
    assert_eq!(status, Some(0), "{printed}");
    let of = |words: &str| numbers(&printed, words);
    let near = |words: &str, right: f64, off: f64| {
        let found = of(words)[0];
        assert!(
            (found - right).abs() <= off,
            "{words} {found}, published {right}"
        );
    };
    near("mass", 95.109, 1.0);
    near("viscous friction", 203.5, 12.0);
    near("Coulomb friction", 20.394, 1.2);
    let unexplained = of("unexplained");
    assert!(
        unexplained[0] <= 3.2 && unexplained[1] <= 5.4,
        "{unexplained:?}"
    );
    let simulated_mm_s = of("simulated speed");
    assert!(simulated_mm_s[0] <= 6.0, "{simulated_mm_s:?}");
    // The same with less smoothing: the bound of the file that it was found from holds there as well.
    let (_, printed) = identify(&[&taught], &["--smoothing-ms", "3"]);
    assert!(numbers(&printed, "unexplained")[0] <= 3.2, "{printed}");
}

#[test]
fn friction_over_distance_explains_the_reversals_of_a_real_axis_better_than_coulomb_and_viscous_friction()
 {
    let Some(folder) = emps() else { return };
    let (_, printed) = identify(&[&folder.path().join("emps.csv")], &[]);
    let line = printed
        .lines()
        .find(|line| line.contains("near reversals") && line.contains("left;"));
    let left_n: Vec<f64> = line
        .expect("a line")
        .split_whitespace()
        .filter_map(|word| word.parse().ok())
        .collect();
    assert!(left_n[0] < 0.5 * left_n[1], "{left_n:?}");
}

#[test]
fn what_tune_records_is_what_identify_reads() {
    let bench = Bench::of("xy", &[]);
    let folder = bench.path().join("recordings");
    let output = quadrant()
        .arg("tune")
        .arg(bench.path())
        .args([
            "--dry-run",
            "--travel-mm",
            "8",
            "--speed-mm-s",
            "X=60,Y=50",
            "--circles",
            "25:3000",
            "--recordings",
        ])
        .arg(&folder)
        .output()
        .expect("quadrant tune");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}");
    let strokes = folder.join("X-strokes.csv");
    let places: Vec<f64> = fs::read_to_string(&strokes)
        .expect("a recording")
        .lines()
        .skip(1)
        .map(|line| {
            line.split(',')
                .nth(1)
                .expect("a place")
                .parse()
                .expect("a number")
        })
        .collect();
    let farthest_mm = places.iter().fold(0.0, |most: f64, of| most.max(of.abs()));
    assert!((7.5..8.1).contains(&farthest_mm), "{farthest_mm} mm");
    // The drive of this machine shows the steps of its velocity command in its torque.
    let drive = ["--lead-mm", "10", "--velocity-gain-n-s-per-m", "259400"];
    let more = [drive.as_slice(), &["--smoothing-ms", "3"]].concat();
    let (status, printed) = identify(&[&strokes], &more);
    assert_eq!(status, Some(0), "{printed}");
    // Recorded at one value of Kv: the steps of the velocity command are not told from mass better than that.
    for (words, right) in [("mass", 858.0), ("Coulomb friction", 451.3)] {
        let found = numbers(&printed, words)[0];
        assert!((found / right - 1.0).abs() < 0.08, "{words} {found}");
    }
}

#[test]
fn a_file_that_is_no_recording_is_bad_input_and_what_is_missing_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("a.csv");
    fs::write(&file, "time_s,position_mm\n0,1\n0.001,2\n").expect("a file");
    let (status, printed) = identify(&[&file], &[]);
    assert_eq!(status, Some(2), "{printed}");
    assert!(printed.contains("force_n"), "{printed}");
}
