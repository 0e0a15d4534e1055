//! A run with faults, run in one process, gives what the real processes give, to the bit: kills and restarts included.

use lab::cell::{InProcessCell, Script};
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::{faults, orders};

use crate::size;
use crate::support::{Bench, run_with};

/// Two lines, an arc with a reversal of each axis, a dwell: about a second.
const PROGRAM: &str = "G21 G17 G90 G94\nG0 X4 Y1\nG1 X10 Y4 F3000\nG3 X10 Y-4 I0 J-4\nG1 X6 Y-2\nG4 P0.1\nG2 X6 Y4 I0 J3 F4000\nG0 X0 Y0\nM2\n";

const WITH_STANDBY: &[(&str, &str)] = &[(
    "drive_mode = \"velocity\"",
    "drive_mode = \"velocity\"\nstandby = true",
)];

/// The digest of a cell of the same run, and its scans.
fn in_process(bench: &Bench, program: &str, script: Script) -> (String, u64) {
    let machine = Machine::load(bench.path()).expect("machine.toml");
    let plant = PlantFile::load(&bench.path().join("plant.toml")).expect("plant.toml");
    let mut cell =
        InProcessCell::with_script(&machine, &plant, (program, PROGRAM), script).expect("a cell");
    let (mut scans, mut digest) = (0u64, (0, 0));
    while let Some(printed) = cell.scan() {
        scans = printed.feedback.scan;
        assert!(scans < 60_000, "the cell does not end");
        let instruments = printed.instruments;
        digest = (
            instruments.motion_digest_high,
            instruments.motion_digest_low,
        );
    }
    (format!("{:016x}{:016x}", digest.0, digest.1), scans)
}

/// Runs each script both ways and compares.
fn same(edits: &[(&str, &str)], scripts: &[(&str, &str, &str)]) {
    let bench = Bench::of("xy", edits);
    let program = bench.file("short.ngc", PROGRAM);
    let machine = Machine::load(bench.path()).expect("machine.toml");
    let mut differing = Vec::new();
    for (name, faults, orders) in scripts {
        let faults_file = bench.file("faults.toml", faults);
        let orders_file = bench.file("orders.toml", orders);
        let script = Script {
            faults: Some(faults::load(&faults_file, &machine).expect("faults.toml")),
            orders: orders::load(&orders_file, &machine).expect("orders.toml"),
            ..Script::default()
        };
        let (digest, scans) = in_process(&bench, &program.display().to_string(), script);
        let [faults_file, orders_file] =
            [faults_file, orders_file].map(|p| p.display().to_string());
        let more = ["--faults", &faults_file, "--orders", &orders_file];
        let real = run_with(bench.path(), &program, &more);
        let report = real.report();
        println!("{name}: {scans} scans, exit {}", real.status());
        if report["motion_digest"] != digest.as_str() {
            differing.push(format!(
                "{name}: in one process {scans} scans, real {}\n{}",
                report["scans"],
                real.stderr()
            ));
        }
    }
    assert!(differing.is_empty(), "{}", differing.join("\n"));
}

fn fault(scan: u64, process: &str, what: &str) -> String {
    format!("[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{process}\"\n{what}\n")
}

fn order(scan: u64, word: &str) -> String {
    format!("[[order]]\nscan = {scan}\norder = \"{word}\"\n")
}

#[test]
fn a_planner_killed_in_any_phase_of_a_period_or_stopped() {
    let kill = |scan: u64| fault(scan, "planner", "do = \"kill\"\nrestart_after_scans = 30");
    let scripts = [
        kill(200),
        kill(203),
        kill(207),
        kill(400) + &kill(420),
        kill(8),
        fault(301, "planner", "do = \"stop\"\nscans = 100"),
        fault(304, "planner", "do = \"stop\"\nscans = 20"),
    ];
    let scripts: Vec<(&str, &str, &str)> = scripts
        .iter()
        .map(|s| (s.as_str(), s.as_str(), ""))
        .collect();
    same(&[], &scripts);
    let waits = format!("[restart]\nplanner = \"wait\"\n{}", kill(256));
    let orders = order(500, "resume");
    same(&[], &[("wait", &waits, &orders)]);
}

#[test]
fn a_servo_with_a_standby_killed_or_stopped() {
    let kill = |scan: u64, role: &str| {
        fault(
            scan,
            &format!("servo-X/{role}"),
            "do = \"kill\"\nrestart_after_scans = 25",
        )
    };
    let stop = |scan: u64, role: &str| {
        fault(
            scan,
            &format!("servo-Y/{role}"),
            "do = \"stop\"\nscans = 30",
        )
    };
    let scripts = [
        kill(300, "a"),
        kill(300, "a") + &kill(380, "b"),
        kill(210, "b"),
        stop(333, "a"),
        stop(333, "b") + &kill(400, "a"),
        fault(280, "servo-Y/a", "do = \"stop\"\nscans = 100"),
    ];
    let scripts: Vec<(&str, &str, &str)> = scripts
        .iter()
        .map(|s| (s.as_str(), s.as_str(), ""))
        .collect();
    same(WITH_STANDBY, &scripts);
}

#[test]
fn a_servo_without_a_standby_lost_and_back() {
    let goes_on = format!(
        "[restart]\nservo = \"resume\"\n{}",
        fault(320, "servo-Y", "do = \"kill\"\nrestart_after_scans = 40")
    );
    let waits = format!(
        "[restart]\nservo = \"wait\"\n{}",
        fault(320, "servo-X", "do = \"stop\"\nscans = 80")
    );
    let orders = order(700, "enable") + &order(760, "resume");
    let ends = fault(320, "servo-X", "do = \"kill\"");
    same(
        &[],
        &[
            ("resume", &goes_on, ""),
            ("wait", &waits, &orders),
            ("end", &ends, ""),
        ],
    );
}

#[test]
fn a_master_killed_in_motion_enabled_and_resumed() {
    let orders = order(600, "enable") + &order(650, "resume");
    let kill = |scan| {
        format!(
            "[restart]\nmaster = \"wait\"\n{}",
            fault(scan, "plant-sim", "do = \"kill\"")
        )
    };
    let with_servo = kill(330) + &fault(322, "servo-X", "do = \"stop\"\nscans = 8");
    same(
        &[],
        &[
            ("in motion", &kill(330), &orders),
            ("at a boundary", &kill(344), &orders),
            ("a servo to go on in the same scan", &with_servo, &orders),
        ],
    );
}

#[test]
fn samples_dropped_delayed_and_corrupted() {
    let mut scripts: Vec<String> = vec![
        fault(300, "servo-X", "do = \"drop\"\nscans = 4"),
        fault(300, "servo-X", "do = \"delay\"\nscans = 5\nlate_scans = 3"),
        fault(304, "planner", "do = \"drop\"\nscans = 24"),
        fault(304, "planner", "do = \"delay\"\nscans = 24\nlate_scans = 5"),
    ];
    for (process, scans, kinds) in [
        (
            "servo-X",
            2,
            &[
                "not-a-number",
                "infinity",
                "jump",
                "old-scan",
                "future-scan",
                "never-visible",
                "wrong-axis",
                "wrong-incarnation",
                "replay",
            ][..],
        ),
        (
            "planner",
            10,
            &[
                "not-a-number",
                "infinity",
                "old-scan",
                "future-scan",
                "never-visible",
                "wrong-incarnation",
                "replay",
                "checksum",
                "setpoint-jump",
                "cut",
            ][..],
        ),
    ] {
        for what in kinds {
            let what = format!("do = \"corrupt\"\nscans = {scans}\nwhat = \"{what}\"");
            scripts.push(fault(303, process, &what));
        }
    }
    let scripts = size::one_in(3, scripts);
    let scripts: Vec<(&str, &str, &str)> = scripts
        .iter()
        .map(|s| (s.as_str(), s.as_str(), ""))
        .collect();
    same(&[], &scripts);
}
