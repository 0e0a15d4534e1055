//! `quadrant doctor` on this PC.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::Value;

use crate::support::{Bench, quadrant, send};

fn findings(output: &std::process::Output) -> Value {
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
fn the_doctor_says_of_each_finding_why_and_what_to_change_and_fits_the_screen() {
    let output = quadrant()
        .args(["doctor", "--seconds", "1", "--json"])
        .output()
        .expect("a doctor");
    let json = findings(&output);
    let list = json["findings"].as_array().expect("findings");
    assert!(list.len() > 12, "{list:?}");
    for finding in list {
        let is_ok = finding["grade"] == "ok";
        assert!(is_ok || finding["why"].is_string(), "{finding}");
        assert!(is_ok || finding["change"].is_array(), "{finding}");
    }
    let must = json["grade"] == "must-be-changed";
    assert_eq!(output.status.code(), Some(if must { 3 } else { 0 }));
    let output = quadrant()
        .args(["doctor", "--seconds", "1"])
        .output()
        .expect("a doctor");
    let text = String::from_utf8_lossy(&output.stdout);
    for line in text.lines().filter(|line| line.chars().count() > 80) {
        // Commands are copied, so they are not broken.
        assert!(
            line.starts_with(&" ".repeat(22)) || line.contains("change"),
            "{line:?}"
        );
    }
}

#[test]
fn too_few_open_files_must_be_changed_and_the_exit_status_is_3() {
    let limited = format!(
        "ulimit -n 100 && exec {} doctor --seconds 1 --json",
        env!("CARGO_BIN_EXE_quadrant")
    );
    let output = Command::new("sh")
        .args(["-c", &limited])
        .output()
        .expect("a shell");
    let json = findings(&output);
    let list = json["findings"].as_array().expect("findings");
    let files = list
        .iter()
        .find(|f| f["what"] == "open files")
        .expect("open files");
    assert_eq!(files["grade"], "must-be-changed", "{files}");
    assert_eq!(output.status.code(), Some(3));
    let printed = String::from_utf8_lossy(&output.stderr);
    assert!(printed.contains("open files"), "{printed}");
}

/// The measurement of a machine, in the words of the findings and as numbers.
fn measured(machine: &Path, seconds: &str) -> (Value, String) {
    let mut doctor = quadrant();
    doctor.arg("doctor").arg(machine);
    let output = doctor.args(["--seconds", seconds, "--json"]).output();
    let json = findings(&output.expect("a doctor"));
    let list = json["findings"].as_array().expect("findings");
    let scans = list.iter().find(|f| f["what"] == "scans").expect("scans");
    let found = scans["found"].as_str().expect("words").to_owned();
    (json["measured"].clone(), found)
}

#[test]
fn the_doctor_measures_scans_as_the_master_of_the_machine_would_begin_them() {
    let with = "[processes]\nmaster = { priority = 70, processors = [0] }\n[scan]\n";
    let period = ("period_us = 1000", "period_us = 500");
    let bench = Bench::of("xy", &[period, ("[scan]\n", with)]);
    let (json, found) = measured(bench.path(), "1");
    assert_eq!(json["scan_period_us"], 500);
    assert_eq!(json["processors"], serde_json::json!([0]));
    // One that is late by whole scans makes up for none, so there may be fewer in the end.
    assert_eq!(json["scans"], 2000);
    let priority = json["priority"].as_u64().expect("a priority");
    assert!([0, 70].contains(&priority), "granted or refused: {json}");
    let us = |name: &str| json[name].as_f64().expect("a number");
    assert!(
        us("p50_us") <= us("p99_us") && us("p99_us") <= us("max_us"),
        "{json}"
    );
    assert!(us("p50_us") > 0.0, "{json}");
    assert!(
        found.starts_with("2000 of 500 µs begun as a master would"),
        "{found}"
    );
}

#[test]
fn ctrl_c_ends_the_measurement_and_what_was_measured_is_judged() {
    let mut doctor = quadrant();
    doctor.args(["doctor", "--seconds", "3600", "--json"]);
    let doctor = doctor.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let doctor = doctor.expect("a doctor");
    std::thread::sleep(Duration::from_secs(2));
    send(doctor.id() as i32, libc::SIGINT);
    let output = doctor.wait_with_output().expect("its end");
    let scans = findings(&output)["measured"]["scans"].as_u64();
    assert!(
        scans.is_some_and(|scans| scans > 0 && scans < 3_000_000),
        "{scans:?}"
    );
}
