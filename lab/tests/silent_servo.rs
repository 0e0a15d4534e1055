//! A servo that falls silent or dies without a standby, at any speed and place: the tool comes to rest on the path.

use std::fmt::Write as _;
use std::path::Path;

use bus::sample::{Cause, Feedback};
use lab::cell::{InProcessCell, Script};
use lab::invariants::{Course, Judge, Shown, Violation};
use machine::{Axis, DriveMode, Machine};
use plant_sim::plant_file::PlantFile;
use plant_sim::script::faults;
use plant_sim::script::rng::Rng;

use crate::size;

const MACHINES: [&str; 5] = ["xy", "xy-fast", "xy-torque", "xyz-mill", POSITION];
/// A machine whose drives close the position loop; the others are folders.
const POSITION: &str = "xy with drives in position mode";
/// Seeds of a run of this test, and in full; `SEEDS=500` in the environment for a long one.
const SEEDS: [u64; 2] = [24, 100];
/// The table's distance from the path, whatever the servo did, in mm.
const PATH_MM: f64 = 1.0;

/// A machine without standbys, and its plant.
fn load(name: &str) -> (Machine, PlantFile) {
    let position = name == POSITION;
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../machines")
        .join(if position { "xy" } else { name });
    let mut machine = Machine::load(&folder).expect("machine.toml");
    for axis in &mut machine.axes {
        axis.standby = false;
        if position {
            axis.drive_mode = DriveMode::Position;
        }
    }
    machine.program.work_offset_mm.clear();
    let plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    (machine, plant)
}

fn place(rng: &mut Rng, axis: &Axis) -> f64 {
    match rng.within(0, 4) {
        0 => axis.travel_min_mm,
        1 => axis.travel_max_mm,
        _ => axis.travel_min_mm + rng.between(0.0, axis.travel_max_mm - axis.travel_min_mm),
    }
}

/// Rapids and feeds between any places, the ends of the travel among them, and an arc as fast as the machine takes it.
fn program(rng: &mut Rng, machine: &Machine) -> String {
    let [x, y] = [&machine.axes[0], &machine.axes[1]];
    let mut text = String::from("G21 G17 G90 G94\n");
    let feed = rng.within(500, 15_000);
    match rng.within(0, 2) {
        0 => {
            let (to_x, to_y) = (place(rng, x), place(rng, y));
            let _ = writeln!(text, "G0 X{to_x:.3} Y{to_y:.3}");
        }
        1 => {
            let (to_x, to_y) = (place(rng, x) / 2.0, place(rng, y) / 2.0);
            let _ = writeln!(text, "G1 X{to_x:.3} Y{to_y:.3} F{feed}");
        }
        _ => {
            let radius = [2.0, 5.0, 10.0, 25.0, 40.0][rng.within(0, 4) as usize];
            let middle = |axis: &Axis| (axis.travel_min_mm + axis.travel_max_mm) / 2.0;
            let (at_x, at_y) = (middle(x), middle(y));
            let _ = writeln!(
                text,
                "G0 X{at_x} Y{at_y}\nG3 X{at_x} Y{at_y} I{radius} J0 F{feed}"
            );
        }
    }
    text.push_str("M2\n");
    text
}

struct Trial {
    what: String,
    shown: Shown,
    violations: Vec<Violation>,
    last: Feedback,
    /// Farthest that an encoder was beyond its travel, in mm.
    beyond_mm: f64,
}

fn trial(seed: u64) -> Trial {
    let mut rng = Rng::new(Rng::new(seed).bits());
    let name = MACHINES[rng.within(0, MACHINES.len() as u64 - 1) as usize];
    let (machine, plant) = load(name);
    let text = program(&mut rng, &machine);
    let course = Course::of(&machine, &plant, "any.ngc", &text).expect("a course");
    let length = run(&machine, &plant, &course, &text, None).1.scans;
    let axis = &machine.axes[rng.within(0, 1) as usize].name;
    let scan = rng.within(2, length - 2);
    let what = if rng.one_in(3) {
        "do = \"kill\"\nrestart_after_scans = 900"
    } else {
        "do = \"stop\"\nscans = 900"
    };
    let script = format!(
        "[restart]\nservo = \"end\"\n[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"servo-{axis}\"\n{what}\n"
    );
    let (last, shown, violations, beyond_mm) = run(&machine, &plant, &course, &text, Some(&script));
    Trial {
        what: format!("seed {seed}: {name}\n{text}{script}"),
        shown,
        violations,
        last,
        beyond_mm,
    }
}

fn run(
    machine: &Machine,
    plant: &PlantFile,
    course: &Course,
    text: &str,
    script: Option<&str>,
) -> (Feedback, Shown, Vec<Violation>, f64) {
    let script = Script {
        faults: script.map(|text| faults::parse("faults.toml", text, machine).expect("a script")),
        ..Script::default()
    };
    let mut cell =
        InProcessCell::with_script(machine, plant, ("any.ngc", text), script).expect("a cell");
    let mut judge = Judge::new(machine, course);
    let mut beyond_mm = 0.0f64;
    let mut last = None;
    while let Some(published) = cell.scan() {
        judge.take(&published, |_, _| true);
        for (axis, settings) in published.feedback.axes().iter().zip(&machine.axes) {
            let at_mm = axis.motor_position as f64 * settings.increment_mm();
            beyond_mm = beyond_mm
                .max(at_mm - settings.travel_max_mm)
                .max(settings.travel_min_mm - at_mm);
        }
        last = Some(*published.feedback);
        assert!(published.feedback.scan < 100_000, "it does not end: {text}");
    }
    let (shown, violations) = judge.end();
    (last.expect("a scan"), shown, violations, beyond_mm)
}

#[test]
fn a_silent_or_dead_servo_without_a_standby_leaves_the_tool_at_rest_on_the_path() {
    let seeds = size::number("SEEDS", SEEDS[0], SEEDS[1]);
    let (mut worst_mm, mut worst_beyond_mm, mut trips) = (0.0f64, 0.0f64, 0);
    for seed in 0..seeds {
        let trial = trial(seed);
        let what = &trial.what;
        assert_eq!(trial.violations, [], "{what}");
        let off_mm = trial.shown.contour_mm.0.max(trial.shown.deviation_mm);
        assert!(off_mm < PATH_MM, "{off_mm} mm off the path: {what}");
        let beyond_mm = trial.beyond_mm;
        assert!(beyond_mm < PATH_MM, "{beyond_mm} mm beyond: {what}");
        if trial.shown.trips > 0 {
            trips += 1;
            let cause = Cause::from_wire(trial.last.cause);
            let expected = [Some(Cause::Watchdog), Some(Cause::ServoLost)];
            assert!(expected.contains(&cause), "{cause:?}: {what}");
        }
        let axes = trial.last.axes();
        let rests = axes.iter().all(|axis| axis.velocity_mm_s.abs() < 0.5);
        assert!(rests, "{what}");
        worst_mm = worst_mm.max(off_mm);
        worst_beyond_mm = worst_beyond_mm.max(beyond_mm);
    }
    println!(
        "{seeds} seeds, {trips} trips: at most {worst_mm:.4} mm off the path, {worst_beyond_mm:.4} mm beyond the travel"
    );
    assert!(trips > seeds / 2);
}

#[test]
fn a_machine_in_torque_mode_is_among_them() {
    let torque = |name: &&str| load(name).0.axes[0].drive_mode == DriveMode::Torque;
    assert!(MACHINES.iter().any(torque));
}
