//! Kills at given scans, in lockstep, through the real processes: what the machine does, and that it does the same on
//! every run. One run takes many kills, so that each test strikes on straights, arcs, reversals, junctions, dwells, at the
//! start and at the end.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use bus::sample::{Feedback, Mode};
use monitor::log::{Reader, Sample};
use serde_json::Value;

use crate::size;
use crate::support::{Bench, Run, number, root, run, run_with, text};

/// Straights, a corner, arcs that turn back, a dwell, a rapid, and more of the same; ends in (30, 0).
fn mixed_program(turns: usize) -> String {
    let once = "G1 X30 Y0 F4000\nG3 X30 Y0 I-15 J0 F3000\nG4 P0.15\nG1 X10 Y10\nX-10 Y10\nG2 X10 Y-10 I15 J-5 F6000\n\
                G0 X0 Y0\nG1 X5 Y-7 F1500\n";
    format!(
        "G21 G17 G90 G94\n{}G1 X30 Y0 F4000\nM2\n",
        once.repeat(turns)
    )
}

/// Kills of one process, one after the other.
struct Kills {
    process: &'static str,
    from: u64,
    every: u64,
    times: u64,
    back_after: u64,
}

fn script(bench: &Bench, restart: &str, kills: &[Kills]) -> PathBuf {
    let mut text = format!("[restart]\nrestarts_max = 1000\n{restart}\n");
    for kill in kills {
        text += &format!(
            "[[fault]]\nat = {{ scan = {} }}\nprocess = \"{}\"\ndo = \"kill\"\nrestart_after_scans = {}\n\
             repeat = {{ times = {}, every_scans = {} }}\n",
            kill.from, kill.process, kill.back_after, kill.times, kill.every
        );
    }
    bench.file("faults.toml", &text)
}

fn run_with_faults(bench: &Bench, program: &Path, faults: &Path) -> Run {
    run_with(
        bench.path(),
        program,
        &["--faults", &faults.display().to_string()],
    )
}

fn run_with_orders(bench: &Bench, program: &Path, faults: &Path, orders: &Path) -> Run {
    let (faults, orders) = (faults.display().to_string(), orders.display().to_string());
    let more = ["--faults", &faults, "--orders", &orders];
    run_with(bench.path(), program, &more)
}

/// A script with a single kill.
fn one_kill(bench: &Bench, restart: &str, process: &'static str, scan: u64) -> PathBuf {
    let kill = Kills {
        process,
        from: scan,
        every: 1,
        times: 1,
        back_after: 20,
    };
    script(bench, restart, &[kill])
}

fn starts(report: &Value, process: &str) -> u64 {
    let processes = report.pointer("/processes").and_then(Value::as_array);
    processes
        .into_iter()
        .flatten()
        .find(|p| p.get("process").and_then(Value::as_str) == Some(process))
        .and_then(|p| p.get("starts")?.as_u64())
        .unwrap_or_else(|| panic!("no process {process} in the report"))
}

fn no_limit_is_broken(report: &Value) {
    for limit in ["velocity", "acceleration", "travel"] {
        let exceeded = number(report, &format!("/limits/{limit}_exceeded"));
        assert_eq!(exceeded, 0.0, "{limit} limit");
    }
}

fn last_feedback(run: &Run) -> Feedback {
    let mut last = None;
    for sample in Reader::open(&run.out.join("run.mcap")).expect("the log") {
        if let Ok(Sample::Feedback(feedback)) = sample {
            last = Some(*feedback);
        }
    }
    last.expect("a feedback")
}

fn command_positions(feedback: &Feedback) -> Vec<i64> {
    let axes = feedback.axes().iter();
    axes.map(|axis| axis.command_position).collect()
}

/// A shipped machine with a standby on every axis, or without any.
fn bench_with(machine: &str, standby: bool) -> Bench {
    let bench = Bench::of(machine, &[]);
    let file = bench.path().join("machine.toml");
    let text = std::fs::read_to_string(&file).expect("machine.toml");
    let mut kept = String::new();
    for line in text.lines().filter(|line| !line.starts_with("standby")) {
        kept += &format!("{line}\n");
        if standby && line.starts_with("drive_mode") {
            kept += "standby = true\n";
        }
    }
    std::fs::write(&file, kept).expect("writing machine.toml");
    bench
}

/// Level of friction of axis X that the machine went by, scan by scan.
fn friction_levels(run: &Run) -> BTreeMap<u64, f64> {
    let samples = Reader::open(&run.out.join("run.mcap")).expect("the log");
    let levels = samples.filter_map(|sample| match sample {
        Ok(Sample::Command(command)) if command.axis == 0 => {
            Some((command.scan, command.friction_level))
        }
        _ => None,
    });
    levels.collect()
}

#[test]
fn a_servo_killed_while_it_learns_what_friction_has_become_is_followed_by_one_that_knows_it() {
    let [plain, bench] = [false, true].map(|standby| {
        let bench = bench_with("xy", standby);
        let file = bench.path().join("plant.toml");
        let mut plant = std::fs::read_to_string(&file).expect("plant.toml");
        for (tuned, now) in [
            ("coulomb_torque_nm = 0.40", "coulomb_torque_nm = 0.28"),
            ("coulomb_torque_nm = 0.48", "coulomb_torque_nm = 0.34"),
            ("coulomb_n = 200.0", "coulomb_n = 140.0"),
            ("coulomb_n = 260.0", "coulomb_n = 180.0"),
        ] {
            assert!(plant.contains(tuned), "{tuned}");
            plant = plant.replace(tuned, now);
        }
        std::fs::write(&file, plant).expect("writing plant.toml");
        bench
    });
    let program = bench.file("mixed.ngc", &mixed_program(3));
    let undisturbed = run(plain.path(), &program);
    let kill = |process, from| Kills {
        process,
        from,
        every: 700,
        times: 12,
        back_after: 12,
    };
    let first_kill = 1900;
    let kills = [kill("servo-X", first_kill), kill("servo-Y", 2250)];
    let faults = script(&bench, "", &kills);
    let killed = run_with_faults(&bench, &program, &faults);
    let levels = friction_levels(&undisturbed);
    let (at_first, at_last) = (
        levels[&first_kill],
        *levels.values().last().expect("levels"),
    );
    println!("level of friction {at_first} at the first kill, {at_last} at the end");
    // It has begun to move, and has not come to where it goes.
    assert!(
        at_first < 0.99 && at_last < at_first - 0.02,
        "{at_first} {at_last}"
    );
    let (report, expected) = (killed.good_report(), undisturbed.good_report());
    assert!(starts(&report, "servo-X") > 8, "{report}");
    assert_eq!(
        text(&report, "/motion_digest"),
        text(&expected, "/motion_digest")
    );
    for (scan, level) in friction_levels(&killed) {
        assert_eq!(levels.get(&scan), Some(&level), "scan {scan}");
    }
}

#[test]
fn kills_of_servos_that_have_a_standby_change_not_one_bit_of_the_motion() {
    let times = size::number("KILLS", 40, 200) / 4;
    for machine in ["xy", "xyz-mill"] {
        let plain = bench_with(machine, false);
        let bench = bench_with(machine, true);
        let program = bench.file("mixed.ngc", &mixed_program(3));
        let undisturbed = run(plain.path(), &program).good_report();
        let kill = |process, from| Kills {
            process,
            from,
            every: 8_000 / times,
            times,
            back_after: 12,
        };
        let faults = script(
            &bench,
            "",
            &[
                kill("servo-X", 3),
                kill("servo-Y", 41),
                kill("servo-X/b", 83),
                kill("servo-Y/b", 121),
            ],
        );
        let report = run_with_faults(&bench, &program, &faults).good_report();
        assert_eq!(
            text(&report, "/motion_digest"),
            text(&undisturbed, "/motion_digest"),
            "{machine}"
        );
        assert!(starts(&report, "servo-X") > times * 4 / 5, "{machine}");
        assert!(starts(&report, "servo-Y-b") > times * 4 / 5, "{machine}");
        for axis in 0..2 {
            assert_eq!(number(&report, &format!("/axes/{axis}/missed_scans")), 0.0);
        }
        assert_eq!(number(&report, "/samples_lost"), 0.0);
    }
}

#[test]
fn kills_of_the_planner_leave_the_tool_on_the_path_and_the_program_ends_where_it_should() {
    let times = size::number("KILLS", 20, 200);
    for machine in size::one_in(2, ["xy", "xyz-mill"]) {
        let bench = bench_with(machine, false);
        let program = bench.file("mixed.ngc", &mixed_program(3));
        let undisturbed = run(bench.path(), &program);
        let end = last_feedback(&undisturbed);
        let undisturbed = undisturbed.good_report();
        let faults = script(
            &bench,
            "",
            &[Kills {
                process: "planner",
                from: 5,
                // In each phase of a period.
                every: size::number("EVERY", 601, 83),
                times,
                back_after: 9,
            }],
        );
        let ended = run_with_faults(&bench, &program, &faults);
        let report = ended.good_report();
        assert_eq!(starts(&report, "planner"), times + 1, "{machine}");
        no_limit_is_broken(&report);
        let held = run_with(bench.path(), &program, &["--orders", &holds(&bench)]).good_report();
        let peak = |report: &Value| number(report, "/contour_error_um/peak");
        let most_um = peak(&undisturbed).max(peak(&held)) + 1.0;
        assert!(
            peak(&report) <= most_um,
            "{machine}: {} µm, undisturbed {}, with feed holds {}",
            peak(&report),
            peak(&undisturbed),
            peak(&held)
        );
        let last = last_feedback(&ended);
        assert_eq!(last.mode, Mode::Finished as u32);
        assert_eq!(
            command_positions(&last),
            command_positions(&end),
            "{machine}"
        );
    }
}

/// Holes with dwells and pecks (G81, G82, G83), rapids between them.
#[test]
fn kills_in_drilling_cycles_and_their_dwells_drill_every_hole_to_its_depth() {
    let bench = bench_with("xyz-mill", true);
    let program = bench.file(
        "holes.ngc",
        "G21 G17 G90 G94\nG0 X0 Y0 Z20\nG99 G82 X10 Y10 Z-6 R2 P0.08 F2400\nX20\nX20 Y20\n\
         G98 G83 X30 Y20 Z-9 R2 Q4 F2400\nX35 Y5\nG81 X5 Y5 Z-4 R1\nG80\nG0 X0 Y0 Z20\nM2\n",
    );
    let undisturbed = run(bench.path(), &program);
    let deepest = |run: &Run| {
        let mut deepest = i64::MAX;
        let mut dwelt = 0;
        for sample in Reader::open(&run.out.join("run.mcap")).expect("the log") {
            if let Ok(Sample::Feedback(feedback)) = sample {
                deepest = deepest.min(feedback.axes[2].command_position);
                dwelt += u32::from(feedback.tag.dwell_remaining_scans > 0);
            }
        }
        (deepest, dwelt)
    };
    let depth = deepest(&undisturbed);
    assert!(depth.1 > 200, "the program dwells");
    let digest = text(&undisturbed.good_report(), "/motion_digest");

    let kill = |process, from, every, times| Kills {
        process,
        from,
        every,
        times,
        back_after: 9,
    };
    let servos = script(
        &bench,
        "",
        &[
            kill("servo-Z", 30, 90, 60),
            kill("servo-Z/b", 75, 90, 60),
            kill("servo-X", 50, 180, 30),
        ],
    );
    let report = run_with_faults(&bench, &program, &servos).good_report();
    assert_eq!(text(&report, "/motion_digest"), digest);
    assert!(starts(&report, "servo-Z") > 20);

    let planner = script(&bench, "", &[kill("planner", 40, 71, 200)]);
    let ended = run_with_faults(&bench, &program, &planner);
    let report = ended.good_report();
    assert!(starts(&report, "planner") > 60);
    no_limit_is_broken(&report);
    let (deepest_hole, dwelt) = deepest(&ended);
    // Without a dwell the lowest point may lie between two scans.
    assert!(
        (deepest_hole - depth.0).abs() < 1000,
        "{deepest_hole} {depth:?}"
    );
    // Resting in a dwell only makes it longer.
    assert!(
        dwelt >= depth.1,
        "{dwelt} scans of dwell, undisturbed {}",
        depth.1
    );
    let last = last_feedback(&ended);
    assert_eq!(
        command_positions(&last),
        command_positions(&last_feedback(&undisturbed))
    );
}

/// Feed holds and resumes all along the program.
fn holds(bench: &Bench) -> String {
    let mut text = String::new();
    for scan in (5..16_000).step_by(83) {
        text += &format!("[[order]]\nscan = {scan}\norder = \"hold\"\n");
        text += &format!("[[order]]\nscan = {}\norder = \"resume\"\n", scan + 48);
    }
    bench.file("holds.toml", &text).display().to_string()
}

#[test]
fn kills_of_the_monitor_change_not_one_bit_of_the_motion() {
    let times = size::number("KILLS", 40, 200);
    let bench = Bench::of("xy", &[]);
    let program = bench.file("mixed.ngc", &mixed_program(3));
    let undisturbed = run(bench.path(), &program).good_report();
    let faults = script(
        &bench,
        "",
        &[Kills {
            process: "monitor",
            from: 20,
            every: 8_000 / times,
            times,
            back_after: 9,
        }],
    );
    let report = run_with_faults(&bench, &program, &faults).good_report();
    assert_eq!(
        text(&report, "/motion_digest"),
        text(&undisturbed, "/motion_digest")
    );
    assert!(number(&report, "/samples_lost") > 0.0);
}

#[test]
fn a_servo_without_a_standby_is_lost_thirty_times_and_the_program_is_done_all_the_same() {
    for machine in size::one_in(2, ["xy", "xyz-mill"]) {
        let bench = bench_with(machine, false);
        let program = bench.file("mixed.ngc", &mixed_program(1));
        let faults = script(
            &bench,
            "servo = \"resume\"",
            &[Kills {
                process: "servo-Y",
                from: 105,
                every: 431,
                times: 30,
                back_after: 20,
            }],
        );
        let ended = run_with_faults(&bench, &program, &faults);
        let report = ended.good_report();
        let lost = starts(&report, "servo-Y") - 1;
        assert!(lost >= 15, "{machine}: {lost}");
        no_limit_is_broken(&report);
        let faults = report.pointer("/faults").and_then(Value::as_array);
        for fault in faults.into_iter().flatten() {
            let deviation_um = fault.get("deviation_um").and_then(Value::as_f64);
            let brakes_mm = fault.get("brake_distance_mm").and_then(Value::as_f64);
            // 100 mm/s at 12 m/s² is 0.42 mm, rapids 250 mm/s 2.6 mm; the axes brake in proportion.
            assert!(
                deviation_um.is_some_and(|um| um < 60.0),
                "{machine}: {fault}"
            );
            assert!(brakes_mm.is_some_and(|mm| mm < 4.0), "{machine}: {fault}");
        }
        let end = last_feedback(&run(bench.path(), &program));
        let last = last_feedback(&ended);
        assert_eq!(
            command_positions(&last),
            command_positions(&end),
            "{machine}"
        );
    }
}

#[test]
fn a_run_with_kills_of_everybody_is_the_same_to_the_bit_every_time() {
    let bench = bench_with("xy", true);
    let program = bench.file("mixed.ngc", &mixed_program(1));
    let orders = bench.file(
        "orders.toml",
        "[[order]]\nscan = 2700\norder = \"enable\"\n[[order]]\nscan = 2900\norder = \"resume\"\n",
    );
    let faults = bench.file(
        "faults.toml",
        r#"
[restart]
master = "wait"
servo = "resume"
restarts_max = 100
[[fault]]
at = { scan = 400 }
process = "planner"
do = "kill"
[[fault]]
at = { reversal = 2, axis = "X" }
process = "servo-X"
do = "kill"
[[fault]]
at = { block = 6 }
process = "servo-Y/b"
do = "stop"
scans = 30
[[fault]]
at = { scan = 1800 }
process = "monitor"
do = "stop"
scans = 100
[[fault]]
at = { scan = 2400 }
process = "plant-sim"
do = "kill"
[[fault]]
at = { scan = 3400 }
process = "servo-X"
do = "kill"
[[fault]]
at = { scan = 3400 }
process = "servo-X/b"
do = "kill"
restart_after_scans = 31
[[fault]]
at = { random = [3800, 4200] }
process = "planner"
do = "stop"
scans = 60
"#,
    );
    let digests: Vec<_> = (0..3)
        .map(|_| {
            let report = run_with_orders(&bench, &program, &faults, &orders).good_report();
            (text(&report, "/motion_digest"), text(&report, "/digest"))
        })
        .collect();
    assert_eq!(digests[0], digests[1]);
    assert_eq!(digests[0], digests[2]);
}

#[test]
fn a_planner_killed_in_a_hold_never_moves_the_machine_when_it_comes_back() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("mixed.ngc", &mixed_program(1));
    let orders = bench.file(
        "orders.toml",
        "[[order]]\nscan = 700\norder = \"hold\"\n[[order]]\nscan = 1800\norder = \"resume\"\n",
    );
    let faults = script(
        &bench,
        "",
        &[Kills {
            process: "planner",
            from: 690,
            every: 160,
            times: 6,
            back_after: 30,
        }],
    );
    let ended = run_with_orders(&bench, &program, &faults, &orders);
    ended.good_report();
    let mut stands = None;
    for sample in Reader::open(&ended.out.join("run.mcap")).expect("the log") {
        if let Ok(Sample::Feedback(feedback)) = sample
            && (850..1800).contains(&feedback.scan)
        {
            let command_positions = feedback.axes.map(|axis| axis.command_position);
            assert_eq!(
                *stands.get_or_insert(command_positions),
                command_positions,
                "scan {}",
                feedback.scan
            );
        }
    }
    assert!(stands.is_some());
    assert_eq!(last_feedback(&ended).axes[0].command_position, 30_000_000);
}

#[test]
fn a_planner_that_is_to_wait_leaves_the_machine_in_hold_until_somebody_resumes() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("mixed.ngc", &mixed_program(1));
    let orders = bench.file(
        "orders.toml",
        "[[order]]\nscan = 2000\norder = \"resume\"\n",
    );
    let faults = one_kill(&bench, "planner = \"wait\"", "planner", 700);
    let ended = run_with_orders(&bench, &program, &faults, &orders);
    let report = ended.good_report();
    let resumed = number(&report, "/faults/0/resumed_at_scan");
    assert!((2000.0..2040.0).contains(&resumed), "{resumed}");
}

/// What a master leaves in the cell is where its axes are and where on the path they were: drives stay off until
/// somebody enables them.
#[test]
fn a_master_that_comes_back_waits_with_its_drives_off_where_the_axes_stand() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("mixed.ngc", &mixed_program(1));
    let orders = bench.file(
        "orders.toml",
        "[[order]]\nscan = 1500\norder = \"resume\"\n[[order]]\nscan = 1600\norder = \"enable\"\n\
         [[order]]\nscan = 1800\norder = \"resume\"\n",
    );
    let faults = one_kill(&bench, "master = \"wait\"", "plant-sim", 700);
    let ended = run_with_orders(&bench, &program, &faults, &orders);
    ended.good_report();
    assert!(
        ended
            .stderr()
            .contains("resume refused: the drives are off"),
        "{}",
        ended.stderr()
    );
    for sample in Reader::open(&ended.out.join("run.mcap")).expect("the log") {
        if let Ok(Sample::Feedback(feedback)) = sample {
            let disabled = feedback.mode == Mode::Disabled as u32;
            assert_eq!(
                disabled,
                (700..=1600).contains(&feedback.scan),
                "{}",
                feedback.scan
            );
            if disabled {
                for axis in feedback.axes() {
                    assert_eq!(axis.command_position, axis.motor_position);
                }
            }
        }
    }
    let last = last_feedback(&ended);
    assert_eq!(last.mode, Mode::Finished as u32);
    assert_eq!(last.axes[0].command_position, 30_000_000);
}

/// Wrong samples are for the lab: the product's own processes cannot be asked for them.
#[test]
fn quadrant_itself_refuses_a_script_that_would_have_it_send_wrong_samples() {
    for action in ["drop", "delay", "corrupt"] {
        let more = match action {
            "delay" => "late_scans = 2",
            "corrupt" => "what = \"jump\"",
            _ => "",
        };
        let script = format!(
            "[[fault]]\nat = {{ scan = 300 }}\nprocess = \"servo-X\"\ndo = \"{action}\"\n{more}\n"
        );
        let bench = Bench::of("xy", &[]);
        let faults = bench.file("faults.toml", &script).display().to_string();
        let program = root().join("machines/xy/programs/circle-r25-f3000.ngc");
        let run = run_with(bench.path(), &program, &["--faults", &faults]);
        assert_eq!(run.status(), 2, "{}", run.stderr());
        assert!(run.stderr().contains("quadrant-lab"), "{}", run.stderr());
        assert!(!run.out.exists(), "nothing is started, nothing is written");
    }
}
