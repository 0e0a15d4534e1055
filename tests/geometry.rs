//! Errors of screws and guideways: what a circle on the table shows of them, before and after their correction.

use std::f64::consts::TAU;
use std::fs;

use bus::sample::Reference;
use monitor::log::{Reader, Sample};
use serde_json::Value;

use crate::support::{Bench, Run, circle_program, number, quadrant, run, run_with, text};

/// The line of Y leans towards +X.
const SQUARENESS_UM_PER_M: f64 = 60.0;

/// Error of the screw of X in the plant, in µm.
fn screw_of_x_um(at_mm: f64) -> f64 {
    0.12 * at_mm + 5.0 * (TAU * at_mm / 150.0).sin()
}

/// Error of the guideway of Y towards X in the plant, in µm.
fn guideway_um(at_mm: f64) -> f64 {
    4.0 * (TAU * at_mm / 300.0).sin()
}

const PLANT_X: &str = "[axis.pitch_error]\nprogressive_um_per_m = 120\nperiodic_um = 5\nperiodic_length_mm = 150\n\
                       [[axis.cross_talk]]\nfrom = \"Y\"\nsquareness_um_per_m = 60\nstraightness_um = 4\n\
                       straightness_length_mm = 300\n";
const PLANT_Y: &str =
    "[axis.pitch_error]\npositions_mm = [-150, -40, 60, 150]\nerror_um = [18, -0.8, 0.2, -12]\n";
const OF_Y: &str =
    "[axis.compensation]\npositions_mm = [-150, -40, 60, 150]\nforward_um = [18, -0.8, 0.2, -12]\n";

/// Puts a table behind the first axis of a file, and one at its end.
fn add(bench: &Bench, file: &str, [of_x, of_y]: [&str; 2]) {
    let path = bench.path().join(file);
    let now = fs::read_to_string(&path).expect("a file");
    let y = "[[axis]]\nname = \"Y\"";
    assert!(now.contains(y), "{file} has no Y");
    let now = now.replace(y, &format!("{of_x}\n{y}"));
    fs::write(&path, format!("{now}\n{of_y}")).expect("writing a file");
}

/// The same machine as somebody built it, with errors of its screws and guideways.
fn built(bench: Bench) -> Bench {
    add(&bench, "plant.toml", [PLANT_X, PLANT_Y]);
    bench
}

fn list(values: impl Iterator<Item = f64>) -> String {
    let values: Vec<String> = values.map(|value| format!("{value:.3}")).collect();
    format!("[{}]", values.join(", "))
}

/// What a laser and a square find of it, in the machine file and a file beside it; both directions of X as far apart as the plant has
/// no lost motion of its own.
fn measured(bench: Bench) -> Bench {
    let rows = (-22..=22).map(|row| f64::from(row) * 10.0);
    let row = |at_mm: f64| {
        let um = screw_of_x_um(at_mm);
        format!("{at_mm},{:.3},{:.3}\n", um - 0.5, um + 0.5)
    };
    let table: String = rows.map(row).collect();
    bench.file(
        "x-laser.csv",
        &format!("position_mm,forward_um,backward_um\n{table}"),
    );
    let places = || (-10..=10).map(|row| f64::from(row) * 15.0);
    let guideways = format!(
        "{OF_Y}[[squareness]]\nof = \"Y\"\nto = \"X\"\num_per_m = {SQUARENESS_UM_PER_M}\n\
         [[straightness]]\nof = \"Y\"\nto = \"X\"\npositions_mm = {}\nerror_um = {}\n",
        list(places()),
        list(places().map(guideway_um)),
    );
    let of_x = "[axis.compensation]\nfile = \"x-laser.csv\"\n";
    add(&bench, "machine.toml", [of_x, &guideways]);
    bench
}

fn circle(bench: &Bench) -> Run {
    let program = circle_program(100.0, 6_000.0, (0.0, 0.0), 45.0);
    run(bench.path(), bench.file("circle.ngc", &program))
}

/// Circular deviations of both directions on the table, in µm.
fn circular_deviations_um(report: &Value) -> [f64; 2] {
    [0, 1].map(|arc| number(report, &format!("/arcs/{arc}/circular_deviation_um")))
}

#[test]
fn a_circle_on_a_machine_that_was_measured_is_nearly_as_round_as_on_one_without_errors() {
    let ideal = circular_deviations_um(&circle(&Bench::of("xy", &[])).good_report());
    let before = circular_deviations_um(&circle(&built(Bench::of("xy", &[]))).good_report());
    let after = circle(&measured(built(Bench::of("xy", &[])))).good_report();
    let after_um = circular_deviations_um(&after);
    println!("G of ideal {ideal:?}, before {before:?}, after {after_um:?} µm");
    for ((ideal_um, before_um), after_um) in ideal.into_iter().zip(before).zip(after_um) {
        // The ellipse of 60 µm/m alone has 6 µm at R100.
        assert!(before_um > 15.0, "{before_um}");
        assert!(after_um <= 0.1 * before_um + ideal_um, "{after_um}");
    }
    // The radius too: screws that are 120 µm/m too long and 80 too short.
    for arc in 0..2 {
        let off_um = number(&after, &format!("/arcs/{arc}/radius_error_um"));
        assert!(off_um.abs() < 0.5, "{off_um}");
    }
    for limit in ["velocity", "acceleration", "travel"] {
        assert_eq!(number(&after, &format!("/limits/{limit}_exceeded")), 0.0);
    }
}

/// Without the model it is the position backlash that makes both directions of a table good.
#[test]
fn lost_motion_that_differs_by_place_is_made_good_by_the_table_of_both_directions() {
    let lost = "backlash_um = 8.36";
    let with = |more: &str| {
        let bench = Bench::without_model("xy", &[(lost, "backlash_um = 0.0")]);
        add(&bench, "machine.toml", [more, ""]);
        let report = circle(&bench).good_report();
        circular_deviations_um(&report)[0]
    };
    let without_um = with("");
    let table_um = with(
        "[axis.compensation]\npositions_mm = [-200, 200]\nforward_um = [-4.18, -4.18]\nbackward_um = [4.18, 4.18]\n",
    );
    let key = Bench::without_model("xy", &[]);
    let key_um = circular_deviations_um(&circle(&key).good_report())[0];
    println!("G without {without_um}, by the table {table_um}, by backlash_um {key_um} µm");
    assert!((table_um - key_um).abs() < 0.01, "{table_um} and {key_um}");
    assert!(without_um > key_um + 1.0, "{without_um} and {key_um}");
}

#[test]
fn a_corrected_circle_is_the_same_to_the_bit_whichever_servo_is_killed_in_it() {
    let plain = measured(built(Bench::of("xy", &[])));
    let standby = (
        "drive_mode = \"velocity\"",
        "drive_mode = \"velocity\"\nstandby = true",
    );
    let bench = measured(built(Bench::of("xy", &[standby])));
    let undisturbed = text(&circle(&plain).good_report(), "/motion_digest");
    let kill = |process: &str, from: u64| {
        format!(
            "[[fault]]\nat = {{ scan = {from} }}\nprocess = \"{process}\"\ndo = \"kill\"\nrestart_after_scans = 12\n\
             repeat = {{ times = 8, every_scans = 2000 }}\n"
        )
    };
    let kills: String = [
        ("servo-X", 3),
        ("servo-Y", 541),
        ("servo-X/b", 1083),
        ("servo-Y/b", 1621),
    ]
    .map(|(process, from)| kill(process, from))
    .concat();
    let faults = bench.file(
        "faults.toml",
        &format!("[restart]\nrestarts_max = 1000\n{kills}"),
    );
    let program = circle_program(100.0, 6_000.0, (0.0, 0.0), 45.0);
    let program = bench.file("circle.ngc", &program);
    let more = ["--faults", &faults.display().to_string()];
    let killed = run_with(bench.path(), &program, &more).good_report();
    assert_eq!(text(&killed, "/motion_digest"), undisturbed);
}

/// The tool stops for a planner and a master that die, and goes on where it was: on the same circle, and twice the same.
#[test]
fn a_corrected_circle_stays_round_through_the_deaths_of_planner_and_master() {
    let bench = measured(built(Bench::of("xy", &[])));
    let undisturbed = circular_deviations_um(&circle(&bench).good_report());
    let faults = bench.file(
        "faults.toml",
        "[restart]\nrestarts_max = 1000\nmaster = \"wait\"\n\
         [[fault]]\nat = { scan = 3000 }\nprocess = \"planner\"\ndo = \"kill\"\nrestart_after_scans = 9\n\
         repeat = { times = 3, every_scans = 3001 }\n\
         [[fault]]\nat = { scan = 8000 }\nprocess = \"plant-sim\"\ndo = \"kill\"\nrestart_after_scans = 20\n",
    );
    let orders = bench.file(
        "orders.toml",
        "[[order]]\nscan = 9500\norder = \"enable\"\n[[order]]\nscan = 9600\norder = \"resume\"\n",
    );
    let (faults, orders) = (faults.display().to_string(), orders.display().to_string());
    let program = bench.path().join("circle.ngc");
    let once = || {
        let more = ["--faults", &faults, "--orders", &orders];
        run_with(bench.path(), &program, &more).good_report()
    };
    let (first, second) = (once(), once());
    assert_eq!(
        text(&first, "/motion_digest"),
        text(&second, "/motion_digest")
    );
    let killed = circular_deviations_um(&first);
    println!("G {undisturbed:?}, with deaths {killed:?} µm");
    for (undisturbed_um, killed_um) in undisturbed.into_iter().zip(killed) {
        assert!(killed_um < undisturbed_um + 6.0, "{killed_um}");
    }
}

#[test]
fn check_says_what_of_each_axis_is_corrected_and_copies_hold_the_table() {
    let bench = measured(Bench::of("xy", &[]));
    let output = quadrant().arg("check").arg(bench.path()).output();
    let output = output.expect("quadrant check");
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    for line in [
        "axis X is corrected: its own errors from -220 to 220 mm up to 28.",
        "µm, the mean of both directions; by Y up to 9.0 µm; by Y up to 4.0 µm",
        "axis Y is corrected: its own errors from -150 to 150 mm up to 18.0 µm",
    ] {
        assert!(said.contains(line), "{said}");
    }
    let program = bench.file("short.ngc", "G21 G90\nG1 X1 F600\nM2\n");
    let ended = run(bench.path(), program);
    ended.good_report();
    let copy = fs::read_to_string(ended.out.join("machine.toml")).expect("the copy");
    assert!(
        !copy.contains("x-laser.csv") && copy.contains("backward_um = ["),
        "{copy}"
    );
}

/// Where an axis stands when it becomes known it stays, and creeps to its true place: nothing steps.
#[test]
fn an_axis_that_is_homed_is_corrected_from_then_on_without_a_step() {
    let homing = "[axis.homing]\nmethod = \"switch-index\"\nswitch_input = 3\nsearch_mm_s = 40\nlatch_mm_s = 5\n\
                  position_mm = -15.5\nsearch_distance_mm = 60\n";
    let switch = "[axis.encoder]\nshows_mm = 512.75\nindex_at_mm = -5.5\n[axis.home_switch]\ndigital = 3\nat_mm = -8\n";
    let homed = |table: &str, error: &str| {
        let bench = Bench::of("xy", &[]);
        let of_x = format!("{homing}{table}");
        add(&bench, "machine.toml", [&of_x, ""]);
        let of_x = format!("{switch}{error}");
        add(&bench, "plant.toml", [&of_x, ""]);
        let program = circle_program(80.0, 6_000.0, (0.0, 0.0), 45.0);
        let program = bench.file("circle.ngc", &program);
        let orders =
            "[[order]]\nscan = 300\norder = \"home\"\n[[order]]\nscan = 9000\norder = \"resume\"\n";
        let orders = bench.file("orders.toml", orders).display().to_string();
        run_with(bench.path(), &program, &["--orders", &orders])
    };
    let ideal = circular_deviations_um(&homed("", "").good_report());
    // 200 µm/m of X, 16 µm of G, and 40 µm at 0.
    let ended = homed(
        "[axis.compensation]\npositions_mm = [-100, 100]\nforward_um = [20, 60]\n",
        "[axis.pitch_error]\npositions_mm = [-100, 100]\nerror_um = [20, 60]\n",
    );
    let corrected = circular_deviations_um(&ended.good_report());
    println!("G {ideal:?}, corrected {corrected:?} µm");
    // In its first turn the axis finds again what its friction does: where its motor counts from has changed.
    let worse = ideal
        .iter()
        .zip(corrected)
        .map(|(ideal_um, um)| um - ideal_um);
    let worse: Vec<f64> = worse.collect();
    assert!(worse[0] < 2.5 && worse[1] < 0.5, "{worse:?}");
    let samples = Reader::open(&ended.out.join("run.mcap")).expect("the log");
    let axes = samples.filter_map(|sample| match sample {
        Ok(Sample::Feedback(feedback)) => Some(feedback.axes[0]),
        _ => None,
    });
    let known = axes.filter(|x| x.reference == Reference::Known as u32);
    let places: Vec<i64> = known.map(|x| x.motor_position).collect();
    assert!(places.len() > 5000, "{}", places.len());
    let bends = places
        .windows(3)
        .map(|at| (at[2] - 2 * at[1] + at[0]).abs());
    // 5 µm of acceleration, and what friction does to an axis that starts; the step would be 37 µm.
    let most = bends.max().expect("places");
    assert!(most < 12_000, "{most} nm");
}
