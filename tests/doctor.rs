//! `quadrant doctor` on this PC.

use std::process::Command;

use serde_json::Value;

use crate::support::quadrant;

fn findings(output: &std::process::Output) -> Value {
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
fn the_doctor_says_of_each_finding_why_and_what_to_change_and_fits_the_screen() {
    let output = quadrant()
        .args(["doctor", "--json"])
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
    let output = quadrant().arg("doctor").output().expect("a doctor");
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
        "ulimit -n 100 && exec {} doctor --json",
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
