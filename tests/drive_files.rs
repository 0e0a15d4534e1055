//! Drive files through the command: what is written, printed and refused, with which status.

use std::fs;
use std::path::Path;
use std::process::Output;

use crate::support::{quadrant, root};

/// The ESI file of a vendor that does not exist: a drive in two revisions, and a module of inputs and outputs.
const TESTOR: &str = "esi/tests/drives/testor.xml";

struct Printed {
    status: i32,
    stdout: String,
    stderr: String,
}

/// `quadrant bus …` in a folder.
fn bus(folder: &Path, arguments: &[&str]) -> Printed {
    let mut command = quadrant();
    let output: Output = command
        .current_dir(folder)
        .arg("bus")
        .args(arguments)
        .output()
        .expect("running quadrant");
    Printed {
        status: output.status.code().unwrap_or(-1),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

#[test]
fn an_esi_file_becomes_a_drive_file_that_is_good_once_it_is_filled_in() {
    let folder = tempfile::tempdir().expect("a folder");
    let esi = root().join(TESTOR);
    let esi = esi.to_str().expect("a path");
    let made = bus(folder.path(), &["drive-file", esi, "--revision", "131072"]);
    assert_eq!(made.status, 0, "{}", made.stderr);
    let drive = "drives/ts-1.toml";
    assert!(
        made.stdout
            .starts_with("drives/ts-1.toml: TS-1 servo drive 2.0"),
        "{}",
        made.stdout
    );
    assert!(
        made.stdout
            .contains(&format!("quadrant bus check {drive} --esi")),
        "{}",
        made.stdout
    );

    let refused = bus(folder.path(), &["check", drive, "--esi", esi]);
    assert_eq!(refused.status, 2);
    assert_eq!(
        refused.stderr.matches("is not filled in").count(),
        5,
        "{}",
        refused.stderr
    );

    let path = folder.path().join(drive);
    let mut text = fs::read_to_string(&path).expect("the drive file");
    for (key, value) in [
        ("position_increments = 0", "8388608"),
        ("velocity_units = 0", "1000"),
        ("rated_torque_nm = 0.0", "1.27"),
        ("direction = 0", "1"),
        ("dead_time_scans = 0", "2"),
    ] {
        let name = key.split(' ').next().expect("a key");
        text = text.replace(key, &format!("{name} = {value}"));
    }
    fs::write(&path, &text).expect("writing");
    let good = bus(folder.path(), &["check", drive, "--esi", esi]);
    assert_eq!((good.status, good.stderr.as_str()), (0, ""));
    assert!(
        good.stdout
            .contains("mode csv, 9 bytes to it and 15 from it")
            && good.stdout.contains(": good"),
        "{}",
        good.stdout
    );

    // What was filled in is not lost.
    let again = bus(
        folder.path(),
        &["drive-file", esi, "--revision", "0x00020000"],
    );
    assert_eq!(again.status, 2);
    assert!(
        again.stderr.contains("is there already"),
        "{}",
        again.stderr
    );
    assert_eq!(fs::read_to_string(&path).expect("the drive file"), text);
}

#[test]
fn an_esi_file_becomes_a_terminal_file_that_is_good_as_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    let esi = root().join(TESTOR);
    let esi = esi.to_str().expect("a path");
    let made = bus(folder.path(), &["io-file", esi]);
    assert_eq!(made.status, 0, "{}", made.stderr);
    let file = "terminals/ti-8.toml";
    for words in [
        file,
        "2 channels",
        "channel   2  output  bool",
        "[[bus.terminal]]",
    ] {
        assert!(made.stdout.contains(words), "{words}: {}", made.stdout);
    }
    let good = bus(folder.path(), &["check", file, "--esi", esi]);
    assert_eq!((good.status, good.stderr.as_str()), (0, ""));
    assert!(good.stdout.contains(": good"), "{}", good.stdout);
    let again = bus(folder.path(), &["io-file", esi, "--device", "3"]);
    assert_eq!(again.status, 2);
    assert!(
        again.stderr.contains("is there already"),
        "{}",
        again.stderr
    );
    let drive = bus(folder.path(), &["io-file", esi, "--device", "1"]);
    assert_eq!(drive.status, 2);
    assert!(drive.stderr.contains("is a drive"), "{}", drive.stderr);
    assert!(
        drive.stderr.contains("--device 3   TI-8"),
        "{}",
        drive.stderr
    );
    let path = folder.path().join(file);
    let text = fs::read_to_string(&path).expect("the terminal file");
    fs::write(&path, text.replace("number = 2", "number = 1")).expect("writing");
    let wrong = bus(folder.path(), &["check", file]);
    assert_eq!(wrong.status, 2);
    assert!(wrong.stderr.contains("is there twice"), "{}", wrong.stderr);
}

#[test]
fn watchdogs_that_leave_a_standby_no_time_are_warned_of() {
    let folder = tempfile::tempdir().expect("a folder");
    let from = root().join("machines/xy-ethercat");
    fs::create_dir(folder.path().join("drives")).expect("a folder");
    fs::copy(
        from.join("drives/am-m.toml"),
        folder.path().join("drives/am-m.toml"),
    )
    .expect("a file");
    let text = fs::read_to_string(from.join("machine.toml")).expect("the machine file");
    for (what, by, words) in [
        ("", "", None),
        (
            "watchdog_ms = 10",
            "watchdog_ms = 6",
            Some(
                "bus.watchdog_ms = 6: the drives stop by themselves before the standby can have replaced an owner",
            ),
        ),
        (
            "watchdog_scans = 50 ",
            "watchdog_scans = 4 ",
            Some(
                "scan.watchdog_scans = 4: drives are given up before the standby can have replaced an owner",
            ),
        ),
    ] {
        fs::write(folder.path().join("machine.toml"), text.replace(what, by)).expect("writing");
        let checked = quadrant()
            .arg("check")
            .arg(folder.path())
            .output()
            .expect("quadrant");
        let printed = String::from_utf8_lossy(&checked.stdout).into_owned();
        assert!(checked.status.success(), "{printed}");
        assert_eq!(printed.contains("watchdog"), words.is_some(), "{printed}");
        assert!(
            words.is_none_or(|words| printed.contains(words)),
            "{printed}"
        );
    }
}

#[test]
fn drives_that_fit_are_listed_and_nothing_is_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let esi = root().join(TESTOR);
    let esi = esi.to_str().expect("a path");
    let asked = bus(folder.path(), &["drive-file", esi]);
    assert_eq!(asked.status, 2);
    assert!(
        asked
            .stderr
            .contains("--product 0x00001234 --revision 0x00010000   TS-1 servo drive 1.0"),
        "{}",
        asked.stderr
    );
    let refused = bus(folder.path(), &["drive-file", esi, "--product", "TI-8"]);
    assert_eq!(refused.status, 2);
    assert!(
        refused.stderr.contains("is no CiA 402 drive"),
        "{}",
        refused.stderr
    );
    let bad = bus(folder.path(), &["drive-file", esi, "--revision", "two"]);
    assert_eq!(bad.status, 2);
    assert!(
        bad.stderr.contains("is no number such as 0x00010420"),
        "{}",
        bad.stderr
    );
    let left: Vec<_> = fs::read_dir(folder.path()).expect("a folder").collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn a_file_that_is_no_esi_or_not_there_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join("x.xml"), "<Catalogue/>").expect("writing");
    for (file, expected) in [
        ("x.xml", "x.xml:1: is no ESI file: begins with <Catalogue>"),
        ("y.xml", "y.xml: cannot be read"),
        (".", ".: is not a file"),
    ] {
        let refused = bus(folder.path(), &["drive-file", file]);
        assert_eq!(refused.status, 2);
        assert!(refused.stderr.contains(expected), "{}", refused.stderr);
    }
    let refused = bus(folder.path(), &["check", "z.toml"]);
    assert_eq!(refused.status, 2);
    assert!(
        refused.stderr.contains("z.toml: cannot be read"),
        "{}",
        refused.stderr
    );
}
