//! Spindle, coolant, outputs and stops through the real processes.

use bus::sample::{Feedback, Mode, Waiting};
use lab::cell::{InProcessCell, Script};
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::orders;

use crate::support::{Bench, LiveCell, quadrant, root};

const PROGRAM: &str = "G21 G90 G94\nS3000 M3 M8\nG0 X5 Y5\nG1 X20 F3000\nM62 P2\nG1 Y20\nM63 P2\nG1 X5\nM0\nG4 P0.1\nM9\nG1 Y5\nM5\nM30\n";
/// Long after the program stop is reached.
const ORDERS: &str = "[[order]]\nscan = 6000\norder = \"resume\"\n";

/// `xy` with a spindle.
fn bench() -> Bench {
    let scan = "[scan]\n";
    let with = format!("[spindle]\nspeed_max_rpm = 6000.0\n\n{scan}");
    let bench = Bench::of("xy", &[(scan, &with)]);
    let plant = std::fs::read_to_string(root().join("machines/xy/plant.toml")).expect("a plant");
    let spindle = "[spindle]\nacceleration_rpm_s = 5000.0\n\n[[axis]]";
    bench.file("plant.toml", &plant.replacen("[[axis]]", spindle, 1));
    bench
}

#[test]
fn the_real_processes_do_events_as_one_process_does_and_the_report_lists_them() {
    let bench = bench();
    let program = bench.file("events.ngc", PROGRAM);
    let file = bench.file("orders.toml", ORDERS).display().to_string();
    let real = LiveCell::start_with(bench.path(), &program, "lockstep", &["--orders", &file]);
    let report = real.finish().good_report();
    let machine = Machine::load(bench.path()).expect("machine.toml");
    let plant = PlantFile::load(bench.path()).expect("plant.toml");
    let script = Script {
        orders: orders::parse("orders.toml", ORDERS, &machine).expect("orders"),
        ..Script::default()
    };
    let shown = program.display().to_string();
    let mut cell =
        InProcessCell::with_script(&machine, &plant, (&shown, PROGRAM), script).expect("a cell");
    let mut digest = String::new();
    let mut last: Option<Feedback> = None;
    while let Some(published) = cell.scan() {
        digest = format!("{:032x}", published.instruments.motion_digest());
        last = Some(*published.feedback);
    }
    assert_eq!(last.map(|f| f.mode), Some(Mode::Finished as u32));
    assert_eq!(report["motion_digest"], digest.as_str());
    let events = report["auxiliary_events"].as_array().expect("events");
    let words: Vec<&str> = events.iter().filter_map(|e| e["event"].as_str()).collect();
    for expected in [
        "spindle 3000 rev/min clockwise",
        "coolant flood",
        "output 2 on",
        "output 2 off",
        "waits for the operator (program stop, M0), line 9",
        "waits no longer",
        "coolant off",
        "spindle stopped",
    ] {
        assert!(words.contains(&expected), "{expected}: {words:?}");
    }
}

#[test]
fn a_killed_planner_and_master_neither_lose_nor_repeat_what_the_program_stops_for() {
    let bench = bench();
    let program = bench.file("events.ngc", PROGRAM);
    // Both die while the program is stopped (M0), and the planner once more while the spindle speeds up.
    let mut faults = String::from("[restart]\nmaster = \"wait\"\n");
    for (scan, process) in [(300, "planner"), (5000, "planner"), (5200, "plant-sim")] {
        faults += &format!(
            "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{process}\"\ndo = \"kill\"\n"
        );
    }
    let mut orders = String::new();
    for (scan, order) in [(5600, "enable"), (6000, "resume"), (9000, "resume")] {
        orders += &format!("[[order]]\nscan = {scan}\norder = \"{order}\"\n");
    }
    let faults = bench.file("faults.toml", &faults).display().to_string();
    let orders = bench.file("orders.toml", &orders).display().to_string();
    let more = ["--faults", &faults, "--orders", &orders];
    let run = LiveCell::start_with(bench.path(), &program, "lockstep", &more).finish();
    let report = run.good_report();
    let events = report["auxiliary_events"].as_array().expect("events");
    let count = |words: &str| {
        let of_words = events.iter().filter(|event| event["event"] == words);
        of_words.count()
    };
    assert_eq!(count("output 2 on"), 1, "{events:?}");
    assert_eq!(count("output 2 off"), 1, "{events:?}");
    let stop = Waiting::ProgramStop.words();
    assert_eq!(count(&format!("waits for {stop}, line 9")), 1, "{events:?}");
    // The second time after the master was lost: the program goes on with it.
    assert_eq!(count("spindle 3000 rev/min clockwise"), 2, "{events:?}");
}

#[test]
fn check_says_which_speed_the_spindle_does_not_have() {
    let bench = bench();
    let program = bench.file("fast.ngc", "S9000 M3\nG1 X5 F600\nM2\n");
    let output = quadrant()
        .arg("check")
        .arg(bench.path())
        .arg(&program)
        .output();
    let output = output.expect("quadrant check");
    let shown = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{shown}");
    assert!(
        shown.contains("fast.ngc:1: S9000: the spindle of this machine turns at"),
        "{shown}"
    );
}
