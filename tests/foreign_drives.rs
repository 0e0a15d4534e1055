//! A segment of foreign EtherCAT drives, as foreign masters see it: what a bus process will be tested against.

use std::process::Command;

use crate::size;
use crate::support::root;

/// What the script ends with where a part that it needs is missing.
const MISSING: i32 = 77;

#[test]
fn foreign_masters_bring_a_segment_of_foreign_drives_into_operation() {
    if size::is_left_out() {
        return;
    }
    let mut script = Command::new(root().join("tests/foreign/ethercat/run"));
    let foreign = root().join("target/foreign/bin/python");
    if std::env::var_os("QUADRANT_PYTHON").is_none() && foreign.exists() {
        script.env("QUADRANT_PYTHON", foreign);
    }
    let done = script.output().expect("the script");
    let printed = String::from_utf8_lossy(&done.stdout);
    let complained = String::from_utf8_lossy(&done.stderr);
    if done.status.code() == Some(MISSING) {
        eprintln!("{printed}");
        return;
    }
    assert!(done.status.success(), "{printed}{complained}");
    for fact in [
        "SOEM: OP",
        "SOEM: SDO abort 0x06010002",
        "SOEM: working counter short in 0 of",
        "KickCAT: OP",
        "KickCAT: statusword 0x4237",
        "am-sdk: enabled",
        "in lockstep the same master saw the same twice",
        "in lockstep, with the same orders, the record is the same twice",
        "silence: AL status code 0x1B of all",
        "three hundred cycles without a frame: AL status code 0x1A of all",
    ] {
        assert!(printed.contains(fact), "no {fact:?} in:\n{printed}");
    }
}
