//! Programs of elements of any length, many more than are read ahead, in a whole cell: they begin at once, go on without a stop that the program does not
//! ask for, and take the time that was known before.

use std::fmt::Write as _;

use crate::common::load;
use crate::size;
use bus::sample::{Mode, PathTag};
use lab::cell::InProcessCell;
use lab::invariants::{Course, Judge};
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::rng::Rng;

/// Seeds of a run of this test, and in full; `SEEDS=200` in the environment for a long one.
const SEEDS: [u64; 2] = [2, 3];
const MACHINES: [&str; 3] = ["xyz-mill", "xy", "xy-fast"];
/// The tool is nowhere at rest for longer than this but where a dwell asks for it, in s.
const PATIENCE_S: f64 = 0.5;
/// Blocks of a program: more than are read ahead.
const BLOCKS: usize = 20_000;

/// Lines in runs of one length or of all lengths from 1 nm to 40 mm, within a square.
fn program(rng: &mut Rng) -> String {
    let mut text = String::from(["G61\n", "G64 P0.01\n"][rng.within(0, 1) as usize]);
    let (mut at_mm, mut angle_rad, mut blocks) = ([20.0f64; 2], 0.0f64, 0);
    let _ = writeln!(text, "G21 G90 G94 G0 X20 Y20");
    while blocks < BLOCKS {
        let scale_mm = libm::pow(10.0, rng.between(-6.0, 1.6));
        let spread = [0.0, 1.0, 8.0][rng.within(0, 2) as usize];
        let turn_rad = [0.0, 0.01, 3.0][rng.within(0, 2) as usize];
        let _ = match rng.within(0, 9) {
            0 => writeln!(text, "G4 P0.05"),
            1 => writeln!(text, "M8"),
            _ => Ok(()),
        };
        let feed_mm_min = rng.between(100.0, 15_000.0);
        let _ = writeln!(text, "F{feed_mm_min:.0}");
        let run_mm = rng.between(10.0, 60.0);
        let (most, mut way_mm) = (rng.within(1, 9000), 0.0);
        for _ in 0..most {
            let power = spread * rng.between(-0.5, 0.5);
            let length_mm = (scale_mm * libm::pow(10.0, power)).clamp(1e-6, 40.0);
            way_mm += length_mm;
            angle_rad += turn_rad * rng.between(-0.5, 0.5);
            let to_mm = [
                at_mm[0] + length_mm * libm::cos(angle_rad),
                at_mm[1] + length_mm * libm::sin(angle_rad),
            ];
            if to_mm.iter().any(|mm| !(2.0..42.0).contains(mm)) {
                angle_rad += 2.0;
                blocks += 1;
                continue;
            }
            at_mm = to_mm;
            let word = if rng.one_in(500) { "G0" } else { "G1" };
            let _ = writeln!(text, "{word} X{:.6} Y{:.6}", at_mm[0], at_mm[1]);
            blocks += 1;
            if way_mm > run_mm {
                break;
            }
        }
    }
    text + "M2\n"
}

/// Lines of one length, one behind the other.
fn chords(count: u32, length_mm: f64, feed_mm_min: f64) -> String {
    let mut text = format!("G21 G90 G94 G61 F{feed_mm_min}\n");
    for n in 1..=count {
        let _ = writeln!(text, "G1 X{:.6}", f64::from(n) * length_mm);
    }
    text + "M2\n"
}

/// Runs a program to its end; how long it took and was known to take, in s.
fn run(machine: &Machine, plant: &PlantFile, text: &str, what: &str) -> (f64, f64) {
    let scan_s = machine.scan_period_s();
    let patience_scans = (PATIENCE_S / scan_s) as u64;
    let course = Course::of(machine, plant, "any.ngc", text).expect("a course");
    let start = plant.start(machine).expect("a start");
    let program = program::resume_from(machine, &start, "any.ngc", text).expect("a program");
    let (mut windows, _) = planner::course(machine, program).expect("windows");
    let state = windows.start_state();
    let known_s = windows.time_to_end_s(&state, 1.0).expect("a time");
    let mut judge = Judge::new(machine, &course);
    let mut cell = InProcessCell::new(machine, plant, "any.ngc", text).expect("a cell");
    let (mut begun, mut since, mut before) = (None, 0, PathTag::OFF_PATH);
    let mut scans = 0;
    while let Some(published) = cell.scan() {
        judge.take(&published, |_, _| true);
        let feedback = published.feedback;
        let is_over = feedback.mode == Mode::Finished as u32;
        if !is_over {
            scans = feedback.scan;
        }
        if !feedback.window.is_none() && begun.is_none() {
            begun = Some(scans);
        }
        if feedback.tag != before || is_over {
            (since, before) = (scans, feedback.tag);
        }
        assert!(
            scans - since < patience_scans,
            "{what}: nothing goes on from {before:?} since scan {since}\n{}",
            text.get(..2000).unwrap_or(text)
        );
    }
    let (shown, violations) = judge.end();
    assert!(violations.is_empty(), "{what}: {violations:?}");
    // The tool rests before an event.
    let events = text.lines().filter(|line| *line == "M8").count();
    assert!(shown.stops.len() <= events, "{what}: {:?}", shown.stops);
    let begun = begun.expect("a first window");
    ((scans - begun) as f64 * scan_s, known_s)
}

#[test]
fn chords_however_short_and_many_begin_at_once_and_take_the_time_that_was_known() {
    let each = |name| [(17_000, 0.01), (40_000, 1e-3), (30_000, 1e-6)].map(|of| (name, of));
    for (name, (count, length_mm)) in size::one_in(2, MACHINES.into_iter().flat_map(each)) {
        let (machine, plant) = load(name);
        let what = format!("{name}: {count} chords of {length_mm} mm");
        let text = chords(count, length_mm, 10_000.0);
        let (took_s, known_s) = run(&machine, &plant, &text, &what);
        assert!(
            (took_s - known_s).abs() < 0.1,
            "{what}: {took_s} s, and {known_s} s were known"
        );
    }
}

#[test]
fn chords_of_a_loop_are_read_as_fast_as_they_are_travelled() {
    let (machine, plant) = load("xyz-mill");
    let text = "G21 G90 G94 G61 F10000\n#1 = 0\no1 while [#1 LT 30000]\n#1 = [#1 + 1]\n\
                #2 = [#1 / 100]\nG1 X#2\no1 endwhile\nM2\n";
    let (took_s, known_s) = run(&machine, &plant, text, "a loop");
    assert!(
        (took_s - known_s).abs() < 0.1,
        "{took_s} s, and {known_s} s were known"
    );
}

#[test]
fn programs_of_elements_of_any_length_begin_at_once_and_never_wait_for_what_is_not_read() {
    for seed in 0..size::number("SEEDS", SEEDS[0], SEEDS[1]) {
        let mut rng = Rng::new(Rng::new(seed).bits());
        let name = MACHINES[rng.within(0, MACHINES.len() as u64 - 1) as usize];
        let (machine, plant) = load(name);
        let text = program(&mut rng);
        run(&machine, &plant, &text, &format!("seed {seed}: {name}"));
    }
}
