//! Cells over a bus with foreign drives: the same motion on every run, whoever of the bus is killed; drives that vanish, fault or lose
//! their power.

use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::runs::{Run, circle, kills_of_owners, run};
use crate::segment::{Network, is_enabled, machine};
use crate::support::root;

#[test]
fn three_foreign_drives_run_a_circle_and_every_run_is_the_same_to_the_bit() {
    let Some(network) = Network::new() else {
        return;
    };
    let first = run(&network, &[], None);
    assert_eq!(
        first.text("/outcome/kind"),
        "completed",
        "{}",
        first.printed()
    );
    let again = run(&network, &[], None);
    for digest in ["/digest", "/motion_digest"] {
        assert_eq!(first.text(digest), again.text(digest), "{digest}");
    }
}

#[test]
fn drives_that_close_their_position_loop_follow_the_circle_no_worse() {
    let Some(network) = Network::new() else {
        return;
    };
    let velocity = run(&network, &[], None);
    let position = [(); 2].map(|()| {
        Run {
            machine: &[
                ("drive_mode = \"velocity\"", "drive_mode = \"position\""),
                ("advance_ms = 3.5", "advance_ms = 1.0"),
            ],
            drive: &[("operate = \"csv\"", "operate = \"csp\"")],
            ..Run::default()
        }
        .run(&network)
    });
    let [first, again] = &position;
    assert_eq!(first.text("/outcome/kind"), "completed");
    assert_eq!(first.text("/digest"), again.text("/digest"));
    // The form of the circle, as a ball bar has it, and its size.
    let form = "/ball_bar/0/counter_clockwise/circular_deviation_um";
    let (first_um, velocity_um) = (first.number(form), velocity.number(form));
    assert!(
        first_um <= 1.05 * velocity_um,
        "{first_um} µm, {velocity_um} µm"
    );
    let radius_um = first.number("/arcs/0/radius_error_um");
    assert!(radius_um.abs() < 5.0, "{radius_um} µm");
}

#[test]
fn the_owner_of_the_bus_is_killed_forty_times_and_no_command_is_another_one() {
    let Some(network) = Network::new() else {
        return;
    };
    let undisturbed = run(&network, &[], None);
    let kills = kills_of_owners(700, 20);
    let killed = run(&network, &[], Some(&kills));
    assert_eq!(
        killed.text("/outcome/kind"),
        "completed",
        "{}",
        killed.printed()
    );
    assert_eq!(
        killed.text("/motion_digest"),
        undisturbed.text("/motion_digest")
    );
    let again = run(&network, &[], Some(&kills));
    assert_eq!(killed.text("/digest"), again.text("/digest"));
}

#[test]
fn a_drive_that_vanishes_faults_or_loses_its_power_stops_the_others_in_that_scan_by_name() {
    let Some(network) = Network::new() else {
        return;
    };
    for (order, words) in [
        (
            "enabled+900 drop 1",
            "look at its power, and at the cable in front of it), axis Y",
        ),
        ("enabled+900 fault 0", "drive fault 1001h"),
        (
            "enabled+900 sto 2 on",
            "drive is off, or did not come on in time, axis Z",
        ),
    ] {
        let done = run(&network, &["--at", order], None);
        assert_eq!(done.output.status.code(), Some(1), "{order}");
        let printed = done.printed();
        assert!(printed.contains(words), "{order}: {printed}");
        // Frame and scan count from the same enabling: the drives are on some scans after the start.
        let scan = printed.split("tripped in scan ").nth(1).expect("a trip");
        let scan: u64 = scan
            .split(':')
            .next()
            .and_then(|n| n.parse().ok())
            .expect("a scan");
        assert!((900..=910).contains(&scan), "{order}: scan {scan}");
    }
}

/// A cell of a machine in lockstep that stays up, in a folder of its own.
pub fn up(network: &Network, [machine, out, cell]: [&str; 3]) -> Child {
    network
        .command(env!("CARGO_BIN_EXE_quadrant"))
        .args([
            "up", machine, "--pace", "lockstep", "--out", out, "--cell", cell,
        ])
        .current_dir(root())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("a cell")
}

/// Waits until `quadrant status --json` of a cell shows this.
pub fn await_status(
    network: &Network,
    cell: &str,
    what: &str,
    mut shows: impl FnMut(&serde_json::Value) -> bool,
) {
    let started = Instant::now();
    loop {
        let status = network.quadrant(&["status", "--json", "--cell", cell]);
        let status = serde_json::from_slice(&status.stdout).unwrap_or_default();
        if shows(&status) {
            return;
        }
        assert!(
            started.elapsed() < Duration::from_secs(30),
            "{what} in vain: {status}"
        );
        std::thread::sleep(Duration::from_millis(50));
    }
}

pub fn mode(status: &serde_json::Value) -> &str {
    status["mode"].as_str().unwrap_or_default()
}

/// Gives an order that is taken.
pub fn order(network: &Network, cell: &str, words: &[&str]) {
    let mut arguments = words.to_vec();
    arguments.extend(["--cell", cell]);
    let done = network.quadrant(&arguments);
    let printed = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{words:?}: {printed}");
}

/// Differences between the first target of a drive that operates (607A, in csp) and where it was, in increments, each time that it was
/// enabled.
fn first_target_errors(record: &str) -> Vec<i32> {
    let mut errors = Vec::new();
    let mut before = [None; 3];
    for row in record.lines().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        let (Ok(drive), Ok(position)) = (cells[4].parse::<usize>(), cells[8].parse::<i32>()) else {
            continue;
        };
        let enabled = is_enabled(row);
        if let (true, Some((false, stood))) = (enabled, before[drive]) {
            let target: Vec<u8> = (4..8)
                .filter_map(|at| u8::from_str_radix(cells[6].get(2 * at..2 * at + 2)?, 16).ok())
                .collect();
            let target = i32::from_le_bytes(target.try_into().expect("a target"));
            errors.push(target.wrapping_sub(stood));
        }
        before[drive] = Some((enabled, position));
    }
    errors
}

/// Process id of the bus process that a status shows.
fn bus_process(status: &serde_json::Value) -> Option<i64> {
    let mut processes = status["processes"].as_array()?.iter();
    let owner = processes.find(|process| process["process"] == "fieldbus")?;
    owner["pid"].as_i64()
}

/// Without a standby the drives stop by themselves; the process is started again, and an operator has the program go on. The drives close
/// their position loops here: a target that is not where the drive is would be a step.
#[test]
fn a_bus_without_a_standby_is_started_again_and_the_program_goes_on_from_its_place() {
    let kills = std::env::var("QUADRANT_KILLS").map_or(2, |kills| kills.parse().expect("a number"));
    let Some(network) = Network::new() else {
        return;
    };
    let segment = network.segment(&["--drives", "3"]);
    let machine = machine(
        &[
            ("standby = true", "standby = false"),
            ("[scan]\n", "[restart]\nrestarts_max = 1000\n\n[scan]\n"),
            ("drive_mode = \"velocity\"", "drive_mode = \"position\""),
            ("advance_ms = 3.5", "advance_ms = 1.0"),
        ],
        &[("operate = \"csv\"", "operate = \"csp\"")],
    );
    let program = circle(machine.path());
    let cell = crate::support::unique_cell();
    let shown = |path: &Path| path.to_string_lossy().into_owned();
    let (folder, program, out) = (
        shown(machine.path()),
        shown(&program),
        shown(&machine.path().join("up")),
    );
    let mut up = up(&network, [&folder, &out, &cell]);
    let await_mode = |what: &str, wanted: &str| {
        await_status(&network, &cell, what, |status| mode(status) == wanted);
    };
    await_mode("starting", "disabled");
    order(&network, &cell, &["enable"]);
    order(&network, &cell, &["load", &program]);
    order(&network, &cell, &["override", "10"]);
    await_mode("enabling", "ready");
    order(&network, &cell, &["start"]);
    await_mode("starting the program", "enabled");
    for _ in 0..kills {
        let status = network.quadrant(&["status", "--json", "--cell", &cell]);
        let status: serde_json::Value = serde_json::from_slice(&status.stdout).expect("JSON");
        assert_eq!(mode(&status), "enabled", "{status}");
        let owner = bus_process(&status).unwrap_or_else(|| panic!("no fieldbus in {status}"));
        crate::support::send(owner as i32, libc::SIGKILL);
        await_mode("tripping", "tripped");
        await_status(&network, &cell, "starting the bus", |status| {
            bus_process(status).is_some_and(|new| new != owner)
        });
        order(&network, &cell, &["enable"]);
        await_mode("enabling again", "enabled");
        order(&network, &cell, &["resume"]);
    }
    order(&network, &cell, &["override", "100"]);
    await_mode("finishing", "ready");
    order(&network, &cell, &["down"]);
    assert!(up.wait().expect("its end").success());
    let report = fs::read_to_string(machine.path().join("up/001-circle/report.json"));
    let report: serde_json::Value = serde_json::from_str(&report.expect("a report")).expect("JSON");
    assert_eq!(report["outcome"]["kind"], "completed");
    let errors = first_target_errors(&segment.end());
    assert_eq!(errors.len(), 3 * (kills + 1), "{errors:?}");
    assert!(errors.iter().all(|error| error.abs() <= 1), "{errors:?}");
}
