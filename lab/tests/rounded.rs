//! Paths rounded by G64, in cells whose processes are killed: never off the rounded path, never over a limit, always to the end.

use std::fmt::Write as _;
use std::path::Path;

use bus::sample::{Feedback, Mode};
use lab::cell::{InProcessCell, Script};
use lab::invariants::{Course, Judge};
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::faults;
use plant_sim::script::rng::Rng;

/// Seeds of a run of this test; `SEEDS=1000` in the environment for a long one.
const SEEDS: u64 = 60;

fn seeds() -> u64 {
    let asked = std::env::var("SEEDS").ok();
    asked.and_then(|text| text.parse().ok()).unwrap_or(SEEDS)
}

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
    let restarts = "[restart]\nplanner = \"resume\"\nservo = \"resume\"\n";
    let mut wrong = Vec::new();
    for seed in 0..seeds() {
        let mut rng = Rng::new(Rng::new(seed).bits());
        let text = program(&mut rng);
        let undisturbed = run(&machine, &plant, &text, restarts);
        let mut script = String::from(restarts);
        for _ in 0..rng.within(1, 3) {
            let who = ["planner", "planner", "servo-X"][rng.below(3) as usize];
            let (scan, after) = (rng.within(20, undisturbed.scans), rng.within(5, 200));
            let _ = write!(
                script,
                "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{who}\"\ndo = \"kill\"\nrestart_after_scans = {after}\n"
            );
        }
        let run = run(&machine, &plant, &text, &script);
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
        seeds(),
        wrong.join("\n")
    );
}
