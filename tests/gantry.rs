//! Axes with two motors, through real processes in lockstep: the skew, the deaths of their servos, jogs, and what is refused.

use std::fs;
use std::time::Duration;

use bus::sample::{Feedback, Mode, ProgramState};
use machine::Machine;
use monitor::log::{Reader, Sample};
use plant_sim::script::rng::Rng;
use serde_json::Value;

use crate::size;
use crate::support::{Bench, LiveCell, Run, number, quadrant, run, run_with, send, text};
use crate::up::{ask, is, obeyed, up_on};

/// The largest skew that these machines have while all is well: two motors with the same loops on a bridge.
const SKEW_UM: f64 = 20.0;

/// A gantry as `quadrant new machine` writes it, with a carriage on its bridge.
fn gantry() -> Bench {
    gantry_with("")
}

/// The same with more keys of X.
fn gantry_with(more: &str) -> Bench {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let written = folder.path().join("gantry");
    let output = quadrant()
        .args(["new", "machine"])
        .arg(&written)
        .arg("--axis")
        .arg(format!(
            "X:travel=-200..200,lead=10,mass=200,motors=2{more}"
        ))
        .args(["--axis", "Y:travel=-150..150,lead=10,mass=60"])
        .output()
        .expect("quadrant");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    for file in ["machine.toml", "plant.toml"] {
        fs::rename(written.join(file), folder.path().join(file)).expect("a file");
    }
    Bench { folder }
}

/// The same after these changes of a file; each must match.
fn changed(file: &str, edits: &[(&str, &str)]) -> Bench {
    edited(gantry(), file, edits)
}

fn edited(bench: Bench, file: &str, edits: &[(&str, &str)]) -> Bench {
    let path = bench.path().join(file);
    let mut now = fs::read_to_string(&path).expect("a file");
    for (what, by) in edits {
        assert!(now.contains(what), "{file} has no {what:?}: {now}");
        now = now.replace(what, by);
    }
    fs::write(path, now).expect("writing a file");
    bench
}

fn with_standbys() -> Bench {
    let mode = "drive_mode = \"velocity\"";
    changed(
        "machine.toml",
        &[(mode, &format!("{mode}\nstandby = true"))],
    )
}

/// Straights, arcs that turn back, a dwell and a rapid; the bridge turns round many times.
const PROGRAM: &str = "G21 G17 G90 G94\nG1 X30 Y0 F4000\nG3 X30 Y0 I-15 J0 F3000\nG4 P0.15\nG1 X10 Y10\nX-10 Y10\n\
                       G2 X10 Y-10 I15 J-5 F6000\nG0 X0 Y0\nG2 X0 Y0 I20 J0 F2000\nG1 X30 Y0 F4000\nM2\n";

fn kills(bench: &Bench, restart: &str, process: &str, every: u64, times: u64) -> String {
    let text = format!(
        "[restart]\nrestarts_max = 1000\n{restart}\n[[fault]]\nat = {{ scan = 105 }}\nprocess = \"{process}\"\n\
         do = \"kill\"\nrestart_after_scans = 15\nrepeat = {{ times = {times}, every_scans = {every} }}\n"
    );
    let name = format!("{}.toml", process.replace('/', "-"));
    bench.file(&name, &text).display().to_string()
}

fn feedbacks(run: &Run) -> Vec<Feedback> {
    let samples = Reader::open(&run.out.join("run.mcap")).expect("the log");
    let feedbacks = samples.filter_map(|sample| match sample {
        Ok(Sample::Feedback(feedback)) => Some(*feedback),
        _ => None,
    });
    feedbacks.collect()
}

fn starts(report: &Value, process: &str) -> u64 {
    let processes = report["processes"].as_array().expect("processes");
    let process = processes.iter().find(|of| of["process"] == process);
    process.map_or(0, |of| of["starts"].as_u64().expect("starts"))
}

fn skew_um_peak(report: &Value) -> f64 {
    assert_eq!(text(report, "/axes/2/axis"), "X2");
    assert_eq!(text(report, "/axes/2/gantry/leader"), "X");
    number(report, "/axes/2/gantry/skew_um_peak")
}

#[test]
fn both_motors_get_the_same_setpoints_and_the_skew_stays_small_through_arcs_and_reversals() {
    let bench = gantry();
    let program = bench.file("mixed.ngc", PROGRAM);
    let ended = run(bench.path(), &program);
    let report = ended.good_report();
    // What a program does not name has no place on the part.
    let place = report["contour_peaks"][0]["position_mm"].as_object();
    let letters: Vec<&String> = place.expect("a peak").keys().collect();
    assert_eq!(letters, ["X", "Y"]);
    let skew_um = skew_um_peak(&report);
    println!(
        "skew {skew_um} µm, contour error {} µm",
        number(&report, "/contour_error_um/peak")
    );
    assert!(skew_um > 0.0 && skew_um < SKEW_UM, "{skew_um}");
    assert_eq!(number(&report, "/axes/2/gantry/skew_um_max"), 200.0);
    // The tool is between two motors that both follow: no farther off the path than they are.
    let error_um = number(&report, "/contour_error_um/peak");
    assert!(error_um > 0.0 && error_um < 100.0, "{error_um}");
    let reversals = report["reversals"].as_array().expect("reversals");
    assert!(reversals.iter().any(|of| of["axis"] == "X"));
    assert!(reversals.iter().all(|of| of["axis"] != "X2"));
    let mut moved = 0;
    for feedback in feedbacks(&ended) {
        let [x, _, x2, ..] = feedback.axes;
        assert_eq!(x.command_position, x2.command_position, "{}", feedback.scan);
        moved = moved.max(x.command_position.abs());
    }
    assert!(moved > 29_000_000, "{moved}");
    let words = fs::read_to_string(ended.out.join("report.txt")).expect("the report");
    assert!(words.contains("X and X2: skew of the gantry"), "{words}");
}

#[test]
fn kills_of_the_servos_of_a_gantry_with_standbys_change_not_one_bit_of_the_motion() {
    let bench = with_standbys();
    let program = bench.file("mixed.ngc", PROGRAM);
    let expected = run(bench.path(), &program).good_report();
    let processes = ["servo-X", "servo-X/b", "servo-X2/b", "servo-X2"];
    for process in size::one_in(2, processes) {
        let faults = kills(&bench, "", process, 160, 25);
        let report = run_with(bench.path(), &program, &["--faults", &faults]).good_report();
        assert_eq!(
            text(&report, "/motion_digest"),
            text(&expected, "/motion_digest"),
            "{process}"
        );
        let name = process.replace('/', "-");
        assert!(starts(&report, &name) > 10, "{process}: {report}");
    }
}

#[test]
fn a_gantry_that_loses_a_servo_without_a_standby_stops_with_both_motors_and_hardly_any_skew() {
    let bench = gantry();
    let program = bench.file("mixed.ngc", PROGRAM);
    for process in ["servo-X", "servo-X2"] {
        let faults = kills(&bench, "servo = \"resume\"", process, 331, 8);
        let report = run_with(bench.path(), &program, &["--faults", &faults]).good_report();
        let lost = starts(&report, process);
        assert!(lost > 4, "{process}: {lost}");
        let skew_um = skew_um_peak(&report);
        println!("{process}: skew {skew_um} µm");
        // The master commands the lost motor without what its servo compensates.
        assert!(skew_um < 2.0 * SKEW_UM, "{process}: {skew_um}");
        for fault in report["faults"].as_array().expect("faults") {
            let deviation_um = fault["deviation_um"].as_f64().expect("a deviation");
            assert!(deviation_um < 60.0, "{process}: {fault}");
        }
    }
}

#[test]
fn a_coupling_that_slips_trips_the_machine_with_both_motors_the_skew_and_its_limit_named() {
    let slip = "[axis.bridge]          # joins it to the axis of its letter";
    let with = format!("[axis.measurement]\nslip_um = 350.0\nslip_at_s = 0.4\n\n{slip}");
    let bench = changed("plant.toml", &[(slip, &with)]);
    let program = bench.file("mixed.ngc", PROGRAM);
    let ended = run(bench.path(), &program);
    assert_eq!(ended.status(), 1, "{}", ended.stderr());
    let report = ended.report();
    let reason = text(&report, "/outcome/reason");
    for part in [
        "axis X2",
        "skew",
        "between X and X2",
        "at most 0.2 mm is allowed",
    ] {
        assert!(reason.contains(part), "{reason}");
    }
    assert!(
        ended.stderr().contains("between X and X2"),
        "{}",
        ended.stderr()
    );
    let first = feedbacks(&ended)
        .into_iter()
        .find(|feedback| feedback.mode == Mode::Tripped as u32);
    let tripped = first.expect("a trip");
    // 0.4 s are 400 scans; the encoder shows it at the end of one, and the trip is in the next.
    assert!((399..=403).contains(&tripped.scan), "{}", tripped.scan);
    assert!((300..400).contains(&tripped.axes[2].drive_code));
}

#[test]
fn a_jog_and_switched_off_drives_move_both_motors_and_the_program_goes_on_from_there() {
    let bench = gantry();
    let program = bench.file("mixed.ngc", PROGRAM);
    let orders = "[[order]]\nscan = 300\norder = \"hold\"\n[[order]]\nscan = 800\norder = \"jog\"\naxis = \"X\"\nvalue = 7.5\n\
                  [[order]]\nscan = 3000\norder = \"disable\"\n[[order]]\nscan = 3300\norder = \"enable\"\n\
                  [[order]]\nscan = 3500\norder = \"resume\"\n";
    let orders = bench.file("orders.toml", orders).display().to_string();
    let ended = run_with(bench.path(), &program, &["--orders", &orders]);
    let report = ended.good_report();
    let skew_um = skew_um_peak(&report);
    println!("skew {skew_um} µm");
    assert!(skew_um < SKEW_UM, "{skew_um}");
    let all = feedbacks(&ended);
    let at = |scan: u64| all.iter().find(|feedback| feedback.scan == scan);
    let place = |scan| at(scan).map(|feedback| feedback.axes[2].motor_position);
    let (before, after) = (place(790).expect("a scan"), place(2900).expect("a scan"));
    assert!(
        (after - before - 7_500_000).abs() < 20_000,
        "{before} {after}"
    );
    assert!(all.iter().any(|of| of.mode == Mode::Jogging as u32));
    assert!(all.iter().any(|of| of.mode == Mode::Disabled as u32));
    // Nobody names the second motor.
    let wrong = bench.file(
        "wrong.toml",
        "[[order]]\nscan = 300\norder = \"jog\"\naxis = \"X2\"\nvalue = 1.0\n",
    );
    let wrong = wrong.display().to_string();
    let refused = run_with(bench.path(), &program, &["--orders", &wrong]);
    assert_eq!(refused.status(), 2);
    let said = refused.stderr();
    assert!(said.contains("is the second motor of X"), "{said}");
}

#[test]
fn a_servo_that_hangs_in_a_jog_stops_both_motors_together() {
    let bench = gantry();
    let program = bench.file("mixed.ngc", PROGRAM);
    let orders = "[[order]]\nscan = 300\norder = \"hold\"\n[[order]]\nscan = 800\norder = \"jog\"\naxis = \"X\"\n\
                  value = 100.0\nspeed_mm_s = 100.0\n";
    let orders = bench.file("orders.toml", orders).display().to_string();
    for process in ["servo-X", "servo-X2"] {
        let faults = format!(
            "[restart]\nservo = \"end\"\n[[fault]]\nat = {{ scan = 1400 }}\nprocess = \"{process}\"\ndo = \"stop\"\nscans = 400\n"
        );
        let faults = bench.file("faults.toml", &faults).display().to_string();
        let more = ["--orders", &orders, "--faults", &faults];
        let ended = run_with(bench.path(), &program, &more);
        assert_eq!(ended.status(), 1, "{}", ended.stderr());
        let all = feedbacks(&ended);
        let at = |scan: u64| all.iter().find(|feedback| feedback.scan == scan);
        let speed_mm_s = at(1399).expect("a scan").axes[0].velocity_mm_s;
        assert!(speed_mm_s > 95.0, "{speed_mm_s}");
        let mut trip = all.iter().filter(|of| of.mode == Mode::Tripped as u32);
        let scan = trip.next().expect("a trip").scan;
        assert!((1450..1460).contains(&scan), "{scan}");
        let report = ended.report();
        let axis = process.trim_start_matches("servo-");
        let reason = text(&report, "/outcome/reason");
        assert!(
            reason.contains(&format!("axis {axis}: commands missing")),
            "{reason}"
        );
        let skew_um = skew_um_peak(&report);
        println!("{process}: skew {skew_um} µm");
        assert!(skew_um < 150.0, "{process}: {skew_um}");
    }
}

#[test]
fn a_lost_master_leaves_both_motors_of_a_gantry_at_one_place() {
    let bench = gantry();
    let program = bench.file("mixed.ngc", PROGRAM);
    let faults = kills(&bench, "master = \"wait\"", "plant-sim", 100_000, 1);
    let orders =
        "[[order]]\nscan = 700\norder = \"enable\"\n[[order]]\nscan = 900\norder = \"resume\"\n";
    let orders = bench.file("orders.toml", orders).display().to_string();
    let more = ["--faults", &faults, "--orders", &orders];
    let report = run_with(bench.path(), &program, &more).good_report();
    assert_eq!(starts(&report, "plant-sim"), 2);
    let skew_um = skew_um_peak(&report);
    println!("skew {skew_um} µm");
    assert!(skew_um < 2.0 * SKEW_UM, "{skew_um}");
}

/// How far the table of the second motor is ahead of that of the first, in µm, by scan.
fn tables_um(run: &Run) -> Vec<(u64, f64)> {
    let samples = Reader::open(&run.out.join("run.mcap")).expect("the log");
    let tables = samples.filter_map(|sample| match sample {
        Ok(Sample::Instruments(sample)) => {
            let tables_mm = sample.places_mm(sample.last()?, |axis| &axis.table_mm);
            let [x, _, x2, ..] = tables_mm;
            Some((sample.scan, (x2 - x) * 1e3))
        }
        _ => None,
    });
    tables.collect()
}

#[test]
fn both_motors_home_by_their_own_switches_and_indices_and_the_bridge_is_square_then() {
    // The machine was left skewed: nobody knows it before it is homed.
    let skewed = "name = \"X2\"\nstart_position_mm = 0.0";
    let start = skewed.replace("0.0", "0.12");
    let bench = edited(
        gantry_with(",encoder=incremental"),
        "plant.toml",
        &[
            (skewed, &start),
            ("digital = 2\nat_mm = -190.0", "digital = 2\nat_mm = -189.6"),
            // A bridge that its guideways can hold askew.
            ("stiffness_n_per_um = 20.0", "stiffness_n_per_um = 0.3"),
        ],
    );
    let program = bench.file("mixed.ngc", PROGRAM);
    let orders = "[[order]]\nscan = 300\norder = \"jog\"\naxis = \"X\"\nvalue = -150.0\nspeed_mm_s = 20.0\n\
                  [[order]]\nscan = 9500\norder = \"home\"\n[[order]]\nscan = 35000\norder = \"resume\"\n";
    let orders = bench.file("orders.toml", orders).display().to_string();
    let ended = run_with(bench.path(), &program, &["--orders", &orders]);
    let report = ended.good_report();
    let error_um = number(&report, "/contour_error_um/peak");
    assert!(error_um < 100.0, "{error_um}");
    let all = tables_um(&ended);
    let skew_um = |scans: std::ops::Range<u64>| {
        let seen = all.iter().filter(|(scan, _)| scans.contains(scan));
        seen.fold(0.0, |most: f64, (_, um)| most.max(um.abs()))
    };
    let (before_um, after_um) = (skew_um(200..300), skew_um(35_000..u64::MAX));
    println!("skewed by {before_um} µm before, {after_um} µm after");
    assert!(before_um > 60.0, "{before_um}");
    assert!(after_um < SKEW_UM + 10.0, "{after_um}");
    // The switches are 0.4 mm apart, and nothing was skewed by that.
    assert!(skew_um(300..35_000) < 160.0, "{}", skew_um(300..35_000));
    let last = feedbacks(&ended).pop().expect("a feedback");
    assert_eq!((last.axes[0].reference, last.axes[2].reference), (0, 0));
}

#[test]
fn a_gantry_that_is_found_too_skew_by_homing_trips_and_is_not_homed() {
    let bench = edited(
        gantry_with(",encoder=incremental"),
        "machine.toml",
        &[(
            "position_mm = -195.0  # of the index behind the edge of the switch\norder = 2\n\n[[axis]]\nname = \"Y\"",
            "position_mm = -195.3\norder = 2\n\n[[axis]]\nname = \"Y\"",
        )],
    );
    let program = bench.file("mixed.ngc", PROGRAM);
    let orders = "[[order]]\nscan = 300\norder = \"jog\"\naxis = \"X\"\nvalue = -170.0\nspeed_mm_s = 20.0\n\
                  [[order]]\nscan = 10000\norder = \"home\"\n";
    let orders = bench.file("orders.toml", orders).display().to_string();
    let ended = run_with(bench.path(), &program, &["--orders", &orders]);
    assert_eq!(ended.status(), 1, "{}", ended.stderr());
    let reason = text(&ended.report(), "/outcome/reason");
    assert!(
        reason.contains("skew): 0.3") && reason.contains("between X and X2"),
        "{reason}"
    );
    let last = feedbacks(&ended).pop().expect("a feedback");
    assert_eq!((last.axes[0].reference, last.axes[2].reference), (1, 1));
}

/// A gantry that stands right before its switches, and is homed within some seconds.
fn quickly_homed(edits: &[(&str, &str)]) -> Bench {
    let bench = gantry_with(",encoder=incremental,start=-185");
    let quick = [("latch_mm_s = 2.0", "latch_mm_s = 10.0")];
    edited(bench, "machine.toml", &[&quick, edits].concat())
}

#[test]
fn homing_that_is_held_leaves_a_gantry_that_is_enabled_homed_and_runs_its_program() {
    // The two encoders begin at different places.
    let encoder = |shows: &str| {
        format!("shows_mm = {shows}\nindex_at_mm = -195.0\n\n[axis.home_switch]\ndigital = 2")
    };
    let of_second = (&*encoder("400.0"), &*encoder("-77.7"));
    let bench = edited(quickly_homed(&[]), "plant.toml", &[of_second]);
    let program = bench.file("mixed.ngc", PROGRAM);
    let orders = [
        (300, "home"),
        (700, "hold"),
        (1_500, "disable"),
        (1_800, "enable"),
        (3_000, "home"),
        (9_000, "resume"),
    ];
    let orders =
        orders.map(|(scan, order)| format!("[[order]]\nscan = {scan}\norder = \"{order}\"\n"));
    let orders = bench
        .file("orders.toml", &orders.concat())
        .display()
        .to_string();
    let ended = run_with(bench.path(), &program, &["--orders", &orders]);
    let report = ended.good_report();
    let all = feedbacks(&ended);
    let references = |scan: u64| {
        let at = all.iter().find(|of| of.scan == scan).expect("a scan");
        [at.axes[0].reference, at.axes[2].reference]
    };
    let seen = [290, 600, 1_700, 2_900, 8_900].map(references);
    assert_eq!(seen, [[1, 1], [2, 2], [1, 1], [1, 1], [0, 0]]);
    assert!(all.iter().all(|of| of.mode != Mode::Tripped as u32));
    let skew_um = skew_um_peak(&report);
    assert!(skew_um < 100.0, "{skew_um}");
    let error_um = number(&report, "/contour_error_um/peak");
    assert!(error_um < 100.0, "{error_um}");
}

#[test]
fn a_gantry_is_enabled_and_homed_after_an_emergency_stop_and_a_dead_master_in_its_second_homing() {
    let bench = quickly_homed(&[("watchdog_scans = 50", "watchdog_scans = 1000")]);
    let (_bench, mut cell, short, _) = up_on(bench, "realtime");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["home", "--wait"]);
    obeyed(&cell, &["home"]);
    obeyed(&cell, &["estop"]);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["home", "--wait"]);
    obeyed(&cell, &["home"]);
    send(cell.pid_of("plant-sim"), libc::SIGKILL);
    cell.wait_for(|now| now.incarnation == 2);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["home", "--wait"]);
    let now = cell.wait_for(|_| true);
    assert_eq!([now.axes[0].reference, now.axes[2].reference], [0, 0]);
    obeyed(&cell, &["load", &short]);
    cell.wait_for(|now| is(now, Mode::Ready, ProgramState::Loaded));
    obeyed(&cell, &["start"]);
    cell.wait_for(|now| is(now, Mode::Ready, ProgramState::Done));
    obeyed(&cell, &["down"]);
    assert_eq!(cell.finish().status(), 0);
}

/// An interruption leaves motors that stand pulling against each other by no more of their rated torque, in percent, beside what friction
/// holds after a homing that nobody disturbed.
const STANDING_PERCENT: f64 = 0.5;

/// Enables the machine and homes it, as an operator does who tries again after a moment.
fn comes_home(cell: &mut LiveCell, what: &str) {
    for _ in 0..20 {
        let done = |words: &[&str]| ask(cell, words);
        let (enabled, homed) = (done(&["enable"]), done(&["home", "--wait"]));
        if (enabled.status, homed.status) == (0, 0) {
            return;
        }
        println!("{what}: {} {}", enabled.text.trim(), homed.text.trim());
        std::thread::sleep(Duration::from_millis(200));
    }
    panic!("{what}: it cannot be enabled and homed");
}

/// Mean difference of the torques of the two motors over some scans in which the machine stands, in percent of the rated one.
fn standing_percent(cell: &mut LiveCell, rated_nm: f64) -> f64 {
    let from = cell.wait_for(|_| true).scan;
    let looks = (1..=20u64).map(|look| {
        let now = cell.wait_for_scan(from + 500 + 10 * look);
        assert_eq!(Mode::from_wire(now.mode), Some(Mode::Ready));
        now.axes[2].torque_nm - now.axes[0].torque_nm
    });
    100.0 * (looks.sum::<f64>() / 20.0 / rated_nm).abs()
}

/// Orders, and processes that are killed.
const INTERRUPTIONS: [&str; 7] = [
    "estop",
    "hold",
    "disable",
    "stop",
    "servo --axis X --role",
    "servo --axis X2 --role",
    "plant-sim",
];

fn interrupt(cell: &mut LiveCell, how: &str, what: &str) {
    if how.contains('-') {
        let pid = cell.pid_of(how);
        send(pid, libc::SIGKILL);
        cell.wait_for_another(how, pid);
        return;
    }
    let said = ask(cell, &[how]);
    // While it moves some are refused: "wait until it stands, or hold it".
    assert!(said.status == 0 || how != "estop", "{what}: {}", said.text);
    if said.status != 0 {
        obeyed(cell, &["hold"]);
    }
}

#[test]
fn a_gantry_whose_homing_is_interrupted_anyhow_and_anywhere_is_enabled_and_homed_afterwards() {
    let bench = quickly_homed(&[("watchdog_scans = 50", "watchdog_scans = 1000")]);
    let restart = "[restart]\nrestarts_max = 1000\nservo = \"wait\"\nmaster = \"wait\"\n\n[scan]\n";
    let bench = edited(bench, "machine.toml", &[("[scan]\n", restart)]);
    let rated_nm = {
        let machine = Machine::load(bench.path()).expect("a machine");
        machine.axes[0].motor.rated_torque_nm
    };
    let (_bench, mut cell, short, _) = up_on(bench, "realtime");
    let mut rng = Rng::new(35);
    let (mut first, mut worst_percent) = (0, 0.0f64);
    let homings = size::number("HOMINGS", 6, 100);
    comes_home(&mut cell, "undisturbed");
    let undisturbed_percent = standing_percent(&mut cell, rated_nm);
    for homing in 0..homings {
        obeyed(&cell, &["enable"]);
        let begins = cell.wait_for(|_| true);
        first += u64::from(begins.axes[0].reference != 0);
        let after = rng.below(2_500);
        let how = rng.pick(&INTERRUPTIONS).copied().unwrap_or("estop");
        let what = format!("homing {homing}, {how} after {after} scans");
        while ask(&cell, &["home"]).text.contains("wait until it stands") {
            std::thread::sleep(Duration::from_millis(50));
        }
        cell.wait_for_scan(begins.scan + after);
        interrupt(&mut cell, how, &what);
        if rng.one_in(2) {
            // The next one begins where this one was interrupted, homed before or not.
            comes_home(&mut cell, &what);
            let percent = standing_percent(&mut cell, rated_nm);
            assert!(
                percent <= undisturbed_percent + STANDING_PERCENT,
                "{what}: {percent:.2} %"
            );
            worst_percent = worst_percent.max(percent);
        }
    }
    comes_home(&mut cell, "the end");
    println!(
        "{homings} homings interrupted, {first} of them first ones; standing {worst_percent:.2} % of the rated torque at most, \
         {undisturbed_percent:.2} % undisturbed"
    );
    obeyed(&cell, &["load", &short]);
    obeyed(&cell, &["start"]);
    // A hold that has interrupted it last still holds.
    obeyed(&cell, &["resume"]);
    cell.wait_for(|now| is(now, Mode::Ready, ProgramState::Done));
    obeyed(&cell, &["down"]);
    assert_eq!(cell.finish().status(), 0);
}

/// Largest difference of the torques of the two motors, in percent of the rated one: of a scan, and smoothed as the master does it.
fn torque_difference_percent(run: &Run, rated_nm: f64) -> (f64, f64) {
    let (mut smooth, mut peak, mut smooth_peak) = (0.0f64, 0.0f64, 0.0f64);
    for feedback in feedbacks(run) {
        let [x, _, x2, ..] = feedback.axes;
        let now = 100.0 * (x2.torque_nm - x.torque_nm) / rated_nm;
        smooth += (now - smooth) / 500.0;
        peak = peak.max(now.abs());
        smooth_peak = smooth_peak.max(smooth.abs());
    }
    (peak, smooth_peak)
}

#[test]
fn motors_that_share_the_work_stay_far_below_the_difference_of_torques_that_trips() {
    let mass = "mass_kg = 100.0";
    let gantries = [
        "",
        ",ratio=2,speed=200,acceleration=1500",
        ",acceleration=3000,speed=400",
    ];
    let each = |more| [(more, false), (more, true)];
    for (more, askew) in size::one_in(3, gantries.into_iter().flat_map(each)) {
        let mut bench = gantry_with(more);
        if askew {
            // The carriage is at one end, where the guideway rubs twice as much.
            let file = bench.path().join("plant.toml");
            let plant = fs::read_to_string(&file).expect("a plant");
            let [before, x, y, x2] = plant.split("[[axis]]").collect::<Vec<_>>()[..] else {
                panic!("three axes: {plant}");
            };
            assert!(x.contains(mass) && x2.contains(mass), "{plant}");
            let x = x.replace(mass, "mass_kg = 60.0");
            let x2 = x2.replace(mass, "mass_kg = 140.0");
            let plant = [before, &x, y, &x2].join("[[axis]]");
            fs::write(&file, plant).expect("a plant");
            bench = edited(
                bench,
                "plant.toml",
                &[("coulomb_n = 72.0", "coulomb_n = 150.0")],
            );
        }
        let machine = Machine::load(bench.path()).expect("a machine");
        let rated_nm = machine.axes[0].motor.rated_torque_nm;
        let program = bench.file("mixed.ngc", PROGRAM);
        let ended = run(bench.path(), &program);
        ended.good_report();
        let (peak, smooth) = torque_difference_percent(&ended, rated_nm);
        println!("{more:?}, askew {askew}: {peak:.1} % of {rated_nm} N·m, smoothed {smooth:.1} %");
        assert!(smooth > 0.0 && smooth < 60.0, "{more:?}, {askew}: {smooth}");
    }
}

/// Each edit of the machine file, with a part of what `check` says of it.
#[rustfmt::skip] // a table
const WRONG: [(&[(&str, &str)], &str); 8] = [
    (&[("leader = \"X\"", "leader = \"Z\"")], "axis X2 gantry.leader = \"Z\": must name an axis of this machine with a motor of its own: X Y"),
    (&[("leader = \"X\"", "leader = \"Y\"")], "axis X2 name = \"X2\": must be \"Y2\""),
    (&[("skew_max_mm = 0.2", "skew_max_mm = 0.0")], "axis X2 gantry.skew_max_mm = 0 mm: must be above 0"),
    (&[("[axis.gantry] ", "#"), ("leader", "#"), ("skew_max_mm", "#")], "axis X2 name = \"X2\": is the name of a second motor"),
    (&[("name = \"X2\"\ntravel_min_mm = -200.0", "name = \"X2\"\ntravel_min_mm = -150.0")], "axis X2 travel_min_mm = -150 mm: must be -200 mm, as of axis X"),
    (&[("drive_mode", "changeover = \"return-to-stand\"\ndrive_mode")], "axis X2 gantry needs changeover = \"settled-deviation\""),
    (&[("name = \"X\"\n", "name = \"X\"\njerk_mm_s3 = 20000.0\n")], "axis X2 jerk_mm_s3 is missing: must be 20000 mm/s³, as of axis X"),
    (&[("[scan]", "[program.work_offset_mm]\nX2 = 1.0\n\n[scan]")], "names a second motor: offsets are of its axis"),
];

#[test]
fn a_second_motor_without_its_axis_or_unlike_it_is_refused_with_what_would_be_right() {
    for (edits, why) in WRONG {
        let bench = changed("machine.toml", edits);
        let output = quadrant().arg("check").arg(bench.path()).output();
        let output = output.expect("quadrant");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(why), "{why}: {said}");
    }
    let bench = changed(
        "plant.toml",
        &[("[axis.bridge] ", "#"), ("stiffness_n_per_um = 20.0", "#")],
    );
    let output = quadrant().arg("check").arg(bench.path()).output();
    let said = String::from_utf8_lossy(&output.expect("quadrant").stderr).into_owned();
    assert!(
        said.contains("the plant file has no [axis.bridge] for it"),
        "{said}"
    );
    // An axis that programs name stands before all second motors.
    let bench = gantry();
    let file = bench.path().join("machine.toml");
    let all = fs::read_to_string(&file).expect("a file");
    let parts: Vec<&str> = all.split("[[axis]]").collect();
    let [head, x, y, x2] = parts.as_slice() else {
        panic!("three axes: {all}");
    };
    let swapped = [*head, *x, *x2, *y].join("[[axis]]");
    let error = Machine::parse("machine.toml", &swapped).expect_err("out of order");
    let said = error.to_string();
    assert!(
        said.contains("axis Y name must come before the second motors"),
        "{said}"
    );
}

#[test]
fn what_moves_one_motor_alone_is_refused_on_a_gantry() {
    let bench = gantry();
    let program = bench.file("mixed.ngc", PROGRAM);
    let tune = quadrant().arg("tune").arg(bench.path()).output();
    let tune = tune.expect("quadrant");
    assert_eq!(tune.status.code(), Some(2));
    let said = String::from_utf8_lossy(&tune.stderr).into_owned();
    assert!(said.contains("the two motors of a gantry"), "{said}");
    let learn = run_with(bench.path(), &program, &["--learn-path"]);
    assert_eq!(learn.status(), 2, "{}", learn.stderr());
    assert!(learn.stderr().contains("gantry"), "{}", learn.stderr());
    for (axis, why) in [
        ("X:travel=0..100,motors=3", "must be 1 or 2"),
        ("A:travel=0..100,motors=2", "is for slides"),
    ] {
        let output = quadrant()
            .args(["new", "machine"])
            .arg(bench.path().join("other"))
            .args(["--axis", axis])
            .output()
            .expect("quadrant");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(why), "{said}");
    }
}
