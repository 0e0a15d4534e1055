//! What the levels of a log keep, leave out and cost.

use std::path::Path;

use serde_json::Value;

use crate::support::{Bench, circle_program, number, root, run_with, text};

/// The report of a run at a level, without what the clock says, and the bytes of its log in a scan.
fn at_level(machine: &str, program: &Path, level: &str, more: &[&str]) -> (Value, f64) {
    let folder = root().join("machines").join(machine);
    let args = [&["--log", level, "--no-learned"], more].concat();
    let run = run_with(&folder, program, &args);
    let log = std::fs::metadata(run.out.join("run.mcap")).expect("a log");
    let mut report = run.good_report();
    let bytes = log.len() as f64 / number(&report, "/scans");
    let keys = report.as_object_mut().expect("an object");
    assert_eq!(keys["log"]["level"], level);
    for of_the_clock in ["wall_s", "real_time_factor", "log"] {
        keys.remove(of_the_clock);
    }
    (report, bytes)
}

/// Where two reports differ.
fn differences(one: &Value, other: &Value, at: &str, found: &mut Vec<String>) {
    match (one, other) {
        (Value::Object(one), Value::Object(other)) => {
            for key in one.keys().chain(other.keys()) {
                let of = |map: &serde_json::Map<String, Value>| map.get(key).cloned();
                let (one, other) = (of(one).unwrap_or_default(), of(other).unwrap_or_default());
                differences(&one, &other, &format!("{at}/{key}"), found);
            }
        }
        (Value::Array(one), Value::Array(other)) if one.len() == other.len() => {
            for (one, other) in one.iter().zip(other) {
                differences(one, other, at, found);
            }
        }
        _ if one == other => {}
        _ => found.push(at.into()),
    }
}

#[test]
fn a_report_is_the_same_to_the_last_digit_from_control_and_full_and_never_a_wrong_number_from_axes()
{
    // A servo of a machine with standbys, and the planner of one without.
    let folder = tempfile::tempdir().expect("a folder");
    let faults = folder.path().join("faults.toml");
    let more = ["--faults", faults.to_str().expect("a path")];
    let program = folder.path().join("helix.ngc");
    for (machine, down, process, bytes_max) in [
        ("xy", "", "planner", 400.0),
        ("xyz-mill", "Z-5", "servo-X", 500.0),
    ] {
        let turn = format!("G3 X25 Y0 I-25 J0 {down} F3000\n");
        let text = format!("G21 G17 G90 G91.1 G94\nG0 X25 Y0\n{turn}{turn}M2\n");
        std::fs::write(&program, text).expect("a program");
        let script =
            format!("[[fault]]\nat = {{ scan = 3000 }}\nprocess = \"{process}\"\ndo = \"kill\"\n");
        std::fs::write(&faults, script).expect("a fault script");
        let (full, _) = at_level(machine, &program, "full", &more);
        let (control, bytes) = at_level(machine, &program, "control", &more);
        assert_eq!(full, control, "{machine}");
        assert!(bytes <= bytes_max, "{machine}: {bytes} bytes a scan");

        let (axes, fewer) = at_level(machine, &program, "axes", &more);
        assert!(fewer < bytes, "{machine}: {fewer} bytes a scan");
        let mut found = Vec::new();
        differences(&full, &axes, "", &mut found);
        found.sort();
        found.dedup();
        for key in found {
            let value = axes.pointer(&key);
            let is_none =
                |value: &Value| value.is_null() || value.as_array().is_some_and(Vec::is_empty);
            let of_rows = ["/blocks/", "/faults/", "/reversals/"];
            assert!(
                value.is_none_or(is_none) || of_rows.iter().any(|rows| key.starts_with(rows)),
                "{machine}: {key} is {value:?} at level axes"
            );
        }
        for row in axes["blocks"].as_array().expect("blocks") {
            assert!(row["contour_error_um_peak"].is_null(), "{row}");
        }
        for row in axes["reversals"].as_array().expect("reversals") {
            assert!(row["protrusion_um"].is_null(), "{row}");
        }
    }
}

#[test]
fn the_machine_file_says_what_is_recorded_and_the_command_line_has_the_last_word() {
    let bench = Bench::of("xy", &[("[scan]\n", "[log]\nlevel = \"axes\"\n\n[scan]\n")]);
    let program = bench.file("circle.ngc", &circle_program(5.0, 6000.0, (0.0, 0.0), 0.0));
    let level = |more: &[&str]| {
        let run = run_with(bench.path(), &program, more);
        text(&run.good_report(), "/log/level")
    };
    assert_eq!(level(&[]), "axes");
    assert_eq!(level(&["--log", "full"]), "full");
}
