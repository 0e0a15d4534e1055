//! Paths rounded by G64, in cells whose processes are killed: never off the rounded path, never over a limit, always to the end.

use std::fmt::Write as _;
use std::path::Path;

use crate::common::kill;
use crate::size;
use bus::sample::{Feedback, Mode};
use lab::cell::{InProcessCell, Script};
use lab::faceted;
use lab::invariants::{Course, Judge};
use lab::least_time::least_time_s;
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::faults;
use plant_sim::script::rng::Rng;

/// Seeds of a run of this test, and in full; `SEEDS=1000` in the environment for a long one.
const SEEDS: [u64; 2] = [12, 60];

fn mill() -> (Machine, PlantFile) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
    let machine = Machine::load(&folder).expect("machine.toml");
    let plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    (machine, plant)
}

/// Chords of a curve, corners, an arc between lines, something that happens on the way, and an exact part.
fn program(rng: &mut Rng) -> String {
    let mut text = String::from("G21 G90 G64 P0.02 Q0.01\nG0 X5 Y0\nG1 F4000\n");
    let chord_rad = [0.01, 0.03, 0.1][rng.below(3) as usize];
    for index in 0..80 {
        let angle = f64::from(index) * chord_rad;
        let radius = 5.0 + angle;
        let _ = writeln!(
            text,
            "X{:.4} Y{:.4}",
            radius * angle.cos(),
            radius * angle.sin()
        );
    }
    text += "X20 Y20\nX0\nM8\nY10 X10\nG2 X20 Y0 I0 J-10\nG1 Y-10\nG61 X10\nY-5\nG64 P0.05\nX5\nY-15\nX0 Y0\nM2\n";
    text
}

struct Run {
    last: Feedback,
    scans: u64,
    violations: Vec<String>,
}

fn run(machine: &Machine, plant: &PlantFile, text: &str, script: &str) -> Run {
    let script = Script {
        faults: Some(faults::parse("faults.toml", script, machine).expect("a script")),
        ..Script::default()
    };
    let program = ("any.ngc", text);
    let course = Course::of(machine, plant, program.0, text).expect("a course");
    let mut judge = Judge::new(machine, &course);
    let mut cell = InProcessCell::with_script(machine, plant, program, script).expect("a cell");
    let mut last = None;
    let mut scans = 0;
    while let Some(published) = cell.scan() {
        judge.take(&published, |_, _| true);
        last = Some(*published.feedback);
        scans += 1;
        assert!(scans < 100_000, "the run does not end");
    }
    let (_, violations) = judge.end();
    Run {
        last: last.expect("a scan"),
        scans,
        violations: violations.iter().map(|of| format!("{of:?}")).collect(),
    }
}

#[test]
fn whoever_is_killed_on_a_rounded_path_the_tool_stays_on_it_and_goes_on() {
    let (machine, plant) = mill();
    kills_leave_the_tool_on_its_path(&machine, &plant);
}

/// Windows end within the jerk too, so does what takes the place of a killed process.
#[test]
fn whoever_is_killed_where_jerk_is_limited_the_tool_keeps_it_and_goes_on() {
    let (mut machine, plant) = mill();
    for axis in &mut machine.axes {
        axis.jerk_mm_s3 = Some(20.0 * axis.acceleration_mm_s2);
        axis.increment_nm = 0.1;
    }
    kills_leave_the_tool_on_its_path(&machine, &plant);
}

fn kills_leave_the_tool_on_its_path(machine: &Machine, plant: &PlantFile) {
    let restarts = "[restart]\nplanner = \"resume\"\nservo = \"resume\"\n";
    let mut wrong = Vec::new();
    for seed in 0..size::number("SEEDS", SEEDS[0], SEEDS[1]) {
        let mut rng = Rng::new(Rng::new(seed).bits());
        let text = program(&mut rng);
        let undisturbed = run(machine, plant, &text, restarts);
        let mut script = String::from(restarts);
        for _ in 0..rng.within(1, 3) {
            let who = ["planner", "planner", "servo-X"][rng.below(3) as usize];
            let (scan, after) = (rng.within(20, undisturbed.scans), rng.within(5, 200));
            script += &kill(who, scan, after);
        }
        let run = run(machine, plant, &text, &script);
        let ends = |run: &Run| {
            run.last
                .axes()
                .iter()
                .map(|of| of.command_position)
                .collect::<Vec<_>>()
        };
        let is_done = Mode::from_wire(run.last.mode) == Some(Mode::Finished);
        let all = undisturbed.violations.iter().chain(&run.violations);
        let said: Vec<&String> = all.take(3).collect();
        if !is_done || ends(&run) != ends(&undisturbed) || !said.is_empty() {
            wrong.push(format!("seed {seed}: {is_done} {said:?}\n{script}"));
        }
    }
    assert!(
        wrong.is_empty(),
        "{} of {}:\n{}",
        wrong.len(),
        size::number("SEEDS", SEEDS[0], SEEDS[1]),
        wrong.join("\n")
    );
}

/// `cargo test --release -p lab --test all faceted -- --ignored --nocapture` prints the table of docs/developers/measurements.md.
#[test]
#[ignore = "prints a table"]
fn times_of_faceted_curves() {
    let (machine, _) = mill();
    println!(
        "| chords | noise | scan | A 5 m/s²: G61 | G64 P0.01 | A 1 m/s²: G61 | G64 P0.01 |\n|---|---|---|---|---|---|---|"
    );
    for chord_mm in [0.05, 0.1, 0.2, 0.5] {
        for noise_mm in [0.0, 0.001] {
            for period_us in [1000, 250] {
                let mut cells = String::new();
                for acceleration_mm_s2 in [5000.0, 1000.0] {
                    for mode in ["G61", "G64 P0.01"] {
                        let mut machine = machine.clone();
                        machine.scan.period_us = period_us;
                        machine.scan.interpolation_period_scans = 8000 / period_us;
                        for axis in &mut machine.axes {
                            axis.acceleration_mm_s2 = acceleration_mm_s2;
                        }
                        let text = faceted::program(chord_mm, noise_mm, mode, 1);
                        let program = program::resume_from(&machine, &[0, 0], "any.ngc", &text);
                        let (mut windows, _) =
                            planner::course(&machine, program.expect("a program"))
                                .expect("a course");
                        let start = windows.start_state();
                        let time_s = windows.time_to_end_s(&start, 1.0).expect("a time");
                        let least_s = least_time_s(windows.path(), 0.01);
                        let _ = write!(cells, " {time_s:.2} s, {:.3} |", time_s / least_s);
                    }
                }
                println!(
                    "| {chord_mm} mm | {} µm | {period_us} µs |{cells}",
                    noise_mm * 1e3
                );
            }
        }
    }
}

/// The time of a program over the least that the axes' limits allow; none if it is not one that moves, or too long for the bound's grid.
fn over_bound(machine: &Machine, text: &str) -> Option<(f64, f64)> {
    let start = vec![0; machine.axes.len()];
    let program = program::resume_from(machine, &start, "any.ngc", text).ok()?;
    if program.path.elements.len() > 20_000 {
        return None;
    }
    let (mut windows, _) = planner::course(machine, program).ok()?;
    let start = windows.start_state();
    let time_s = windows.time_to_end_s(&start, 1.0).ok()?;
    let least_s = least_time_s(windows.path(), 0.01);
    (least_s > 0.0).then(|| (time_s, time_s / least_s))
}

/// `PROGRAMS=folder MACHINE=xyz-mill cargo test --release -p lab --test all their_bound -- --ignored --nocapture`.
#[test]
#[ignore = "prints a table"]
fn times_over_their_bound() {
    let folder = std::env::var("PROGRAMS").expect("PROGRAMS=folder");
    let machine = std::env::var("MACHINE").unwrap_or("xyz-mill".into());
    let machines = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines");
    let machine = Machine::load(&machines.join(machine)).expect("machine.toml");
    let files = std::fs::read_dir(folder).expect("a folder").flatten();
    let mut files: Vec<_> = files.map(|of| of.path()).collect();
    files.sort();
    let mut ratios = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap_or_default();
        let Some((time_s, ratio)) = over_bound(&machine, &text) else {
            continue;
        };
        println!("{ratio:8.3} {time_s:9.3} s  {}", file.display());
        ratios.push(ratio);
    }
    ratios.sort_by(f64::total_cmp);
    let at = |share: f64| ratios[((ratios.len() - 1) as f64 * share) as usize];
    println!(
        "{} programs: median {:.3}, 90 % {:.3}, worst {:.3}",
        ratios.len(),
        at(0.5),
        at(0.9),
        at(1.0)
    );
}

/// A planner that leaves much of the limits unused is found by a bound that knows nothing of it.
#[test]
fn rounded_chords_take_little_more_than_the_least_time() {
    let (mut machine, _) = mill();
    for axis in &mut machine.axes {
        axis.acceleration_mm_s2 = 1000.0;
    }
    for (period_us, most) in [(1000, 1.06), (250, 1.08)] {
        machine.scan.period_us = period_us;
        machine.scan.interpolation_period_scans = 8000 / period_us;
        let text = faceted::program(0.2, 0.0, "G64 P0.01", 1);
        let (_, ratio) = over_bound(&machine, &text).expect("a program");
        assert!((0.999..most).contains(&ratio), "{period_us} µs: {ratio}");
    }
}
