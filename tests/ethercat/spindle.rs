//! A spindle behind a foreign CiA 402 drive, told its speed over the bus, through real processes.

use std::collections::BTreeSet;
use std::f64::consts::TAU;

use tempfile::TempDir;

use crate::runs::kills_of_owners;
use crate::segment::{Network, machine};
use crate::terminals::ran;

/// The fourth drive turns a spindle; an increment of it is a µrad.
const SPINDLE: &str = "standby = true\n[bus.spindle]\nfile = \"drives/am-m.toml\"\nslave = 3\n";
const SPEEDS: &str = "[spindle]\nspeed_max_rpm = 100.0\nramp_rpm_s = 120.0\nencoder_counts_per_turn = 6_283_185\n\
    patience_s = 5.0\n[scan]\n";

fn with_spindle() -> TempDir {
    let edits = [("standby = true\n", SPINDLE), ("[scan]\n", SPEEDS)];
    machine(&edits, &[])
}

/// It turns both ways while the axes move, stands at an angle, and stops.
const PROGRAM: &str =
    "G21 G90\nS60 M3\nG1 X5 F3000\nS80 M4\nG1 X0\nM19 R90\nG4 P0.05\nM5\nG1 X2\nM2\n";

/// What the drive of the spindle did, step by step: its place in turns, and whether it was enabled.
fn steps(record: &str) -> Vec<(f64, bool)> {
    let of_spindle = record
        .lines()
        .map(|line| line.split(',').collect::<Vec<_>>());
    let of_spindle =
        of_spindle.filter(|row| row[0] == "step" && row[4] == "3" && !row[7].is_empty());
    let step = |row: Vec<&str>| {
        let word: u32 = row[7].parse().expect("a statusword");
        let position: f64 = row[8].parse().expect("a place");
        (position / 1e6 / TAU, word & 0x6F == 0x27)
    };
    of_spindle.map(step).collect()
}

/// Highest and lowest speed over 50 steps of 1 ms, in rev/min.
fn speeds(steps: &[(f64, bool)]) -> (f64, f64) {
    let speed = |pair: &[(f64, bool)]| (pair[50].0 - pair[0].0) / 0.05 * 60.0;
    let all = steps.windows(51).map(speed);
    all.fold((0.0f64, 0.0f64), |(most, least), of| {
        (most.max(of), least.min(of))
    })
}

#[test]
fn a_program_turns_a_spindle_over_the_bus_the_same_on_every_run_and_whoever_is_killed() {
    let Some(network) = Network::new() else {
        return;
    };
    let machine = with_spindle();
    let kills = kills_of_owners(900, 20);
    let mut digests = BTreeSet::new();
    for faults in [None, None, Some(kills.as_str())] {
        let segment = network.segment(&["--drives", "4"]);
        let done = ran(&network, &machine, PROGRAM, faults);
        assert_eq!(
            done.text("/outcome/kind"),
            "completed",
            "{}",
            done.printed()
        );
        digests.insert(done.text("/motion_digest"));
        let record = segment.end();
        let steps = steps(&record);
        let (most, least) = speeds(&steps);
        assert!(
            (most - 60.0).abs() < 3.0 && (least + 80.0).abs() < 4.0,
            "{most} {least}"
        );
        // M19 R90: a quarter of a turn behind the zero of its encoder, and there it stays once it is off.
        let (turns, enabled) = steps[steps.len() - 1];
        let off_deg = libm::remainder(turns - 0.25, 1.0) * 360.0;
        assert!(off_deg.abs() < 1.0, "{off_deg}");
        assert!(!enabled, "it is off while it stands");
    }
    assert_eq!(digests.len(), 1, "{digests:?}");
}

#[test]
fn a_fault_of_its_drive_or_one_that_vanishes_while_it_turns_trips_the_machine() {
    let Some(network) = Network::new() else {
        return;
    };
    let machine = with_spindle();
    let turns = "G21 G90\nS60 M3\nG1 X60 F1200\nG1 X-60\nM2\n";
    for fault in ["enabled+2500 fault 3", "enabled+2500 drop 3"] {
        let _segment = network.segment(&["--drives", "4", "--at", fault]);
        let done = ran(&network, &machine, turns, None);
        let printed = done.printed();
        assert_eq!(done.output.status.code(), Some(1), "{fault}: {printed}");
        assert!(printed.contains("spindle"), "{fault}: {printed}");
    }
}

#[test]
fn a_program_that_turns_a_spindle_that_nobody_drives_is_refused() {
    let Some(network) = Network::new() else {
        return;
    };
    let machine = machine(&[("[scan]\n", SPEEDS)], &[]);
    let file = machine.path().join("p.ngc");
    std::fs::write(&file, PROGRAM).expect("writing");
    let (folder, file) = (machine.path().to_string_lossy(), file.to_string_lossy());
    let checked = network.quadrant(&["check", &folder, &file]);
    assert_eq!(checked.status.code(), Some(2));
    let said = String::from_utf8_lossy(&checked.stderr);
    assert!(
        said.contains("the spindle goes nowhere") && said.contains("[bus.spindle]"),
        "{said}"
    );
}
