//! Threads, taps and cutting speeds on a spindle that yields to its load: how far off they are, whoever is killed meanwhile.

use std::path::Path;

use crate::common::{kill, order};
use crate::size;
use bus::sample::{Cause, Feedback, Mode, Order, Refused};
use lab::cell::{InProcessCell, Script};
use lab::invariants::{Course, Judge};
use machine::Machine;
use path::path_part::PathPart;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::faults;
use plant_sim::script::rng::Rng;

/// Seeds of a run of this test, and in full; `SEEDS=500` in the environment for a long one.
const SEEDS: [u64; 2] = [8, 30];
const Z: usize = 1;

fn lathe() -> (Machine, PlantFile) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xz-lathe");
    let mut machine = Machine::load(&folder).expect("machine.toml");
    machine.program.work_offset_mm.insert("Z".into(), -100.0);
    let plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    (machine, plant)
}

const RESTARTS: &str = "[restart]\nplanner = \"resume\"\nservo = \"wait\"\nmaster = \"wait\"\n";

/// One scan of a run: what was shown at its start, and the true places at its end.
#[derive(Debug, Clone, Copy)]
struct Row {
    feedback: Feedback,
    /// Table of each axis, in mm.
    table_mm: [f64; 2],
    /// True angle of the spindle, in turns.
    turns: f64,
    /// True speed, in rev/min.
    rpm: f64,
}

struct Run {
    rows: Vec<Row>,
    violations: Vec<String>,
}

/// A run with an operator who goes on whenever he may.
fn run(machine: &Machine, plant: &PlantFile, text: &str, script: Option<&str>) -> Run {
    run_with(machine, plant, text, script, |_, _| ())
}

fn run_with(
    machine: &Machine,
    plant: &PlantFile,
    text: &str,
    script: Option<&str>,
    mut operator: impl FnMut(&Feedback, &mut InProcessCell),
) -> Run {
    let faults = script.map(|text| faults::parse("faults.toml", text, machine).expect("a script"));
    let script = Script {
        faults,
        ..Script::default()
    };
    let program = ("any.ngc", text);
    let course = Course::of(machine, plant, program.0, text).expect("a course");
    let mut judge = Judge::new(machine, &course);
    let mut cell = InProcessCell::with_script(machine, plant, program, script).expect("a cell");
    let mut rows: Vec<Row> = Vec::new();
    let mut quiet_scans = 0;
    while let Some(published) = cell.scan() {
        judge.take(&published, |_, _| true);
        let last = published.instruments.subsamples as usize - 1;
        let table_mm = [0, 1].map(|axis| published.instruments.axes[axis].table_mm[last]);
        let feedback = *published.feedback;
        let spindle = cell.drives().auxiliaries.state().spindle;
        rows.push(Row {
            feedback,
            table_mm,
            turns: spindle.turns,
            rpm: spindle.rpm,
        });
        assert!(rows.len() < 100_000, "the run does not end");
        operator(&feedback, &mut cell);
        let waits = feedback.hold == 1 && feedback.at_rest == 1
            || feedback.mode == Mode::Tripped as u32
            || feedback.mode == Mode::Disabled as u32;
        quiet_scans = if waits { quiet_scans + 1 } else { 0 };
        if quiet_scans == 80 {
            quiet_scans = 0;
            let next = if feedback.mode == Mode::Enabled as u32 {
                Order::Resume
            } else {
                Order::Enable
            };
            cell.order(&order(next, 0.0));
        }
    }
    let (_, violations) = judge.end();
    let violations = violations.iter().map(|v| format!("{v:?}")).collect();
    Run { rows, violations }
}

fn ended(run: &Run) -> (Option<Mode>, Option<Cause>) {
    let last = run.rows.last().expect("a scan").feedback;
    (Mode::from_wire(last.mode), Cause::from_wire(last.cause))
}

/// What the table is off the spindle while they are joined, in µm, scan by scan: one entry for each tap.
fn tap_errors(run: &Run, mm_per_turn: f64) -> Vec<Vec<(usize, f64)>> {
    let mut taps: Vec<Vec<(usize, f64)>> = Vec::new();
    let mut joined_at: Option<Row> = None;
    for (index, pair) in run.rows.windows(2).enumerate() {
        let [row, next] = pair else { continue };
        // What is shown at the start of a scan was so at the end of the one before.
        if next.feedback.auxiliary.coupled == 0 {
            joined_at = None;
            continue;
        }
        let from = *joined_at.get_or_insert_with(|| {
            taps.push(Vec::new());
            *row
        });
        let off_mm = row.table_mm[Z] - from.table_mm[Z] - mm_per_turn * (row.turns - from.turns);
        if let Some(tap) = taps.last_mut() {
            tap.push((index, off_mm * 1e3));
        }
    }
    taps
}

fn largest(errors: impl Iterator<Item = f64>) -> f64 {
    errors.fold(0.0, |most, error| most.max(error.abs()))
}

fn tap(rpm: u32) -> String {
    format!("G21 G18 G90\nG0 X0 Z3\nS{rpm} M3\nG33.1 Z-15 K1\nM5\nG0 Z10\nM2\n")
}

#[test]
fn an_m6_tap_is_in_step_over_ramps_load_and_reversal() {
    let (machine, plant) = lathe();
    for rpm in [600u32, 1500] {
        let run = run(&machine, &plant, &tap(rpm), None);
        assert_eq!(ended(&run).0, Some(Mode::Finished), "{:?}", ended(&run));
        assert_eq!(run.violations, [] as [String; 0]);
        let taps = tap_errors(&run, -1.0);
        let [errors] = taps.as_slice() else {
            panic!("{} taps", taps.len())
        };
        let full = |index: &usize| run.rows[*index].rpm.abs() > 0.97 * f64::from(rpm);
        let at_speed = largest(errors.iter().filter(|(i, _)| full(i)).map(|(_, e)| *e));
        let ramps = largest(errors.iter().filter(|(i, _)| !full(i)).map(|(_, e)| *e));
        let rpms = errors
            .iter()
            .filter(|(i, _)| full(i))
            .map(|(i, _)| run.rows[*i].rpm.abs());
        let (low, high) = rpms.fold((f64::INFINITY, 0.0f64), |(l, h), r| (l.min(r), h.max(r)));
        let deepest = run.rows.iter().map(|row| row.table_mm[Z]);
        let deepest = deepest.fold(f64::INFINITY, f64::min) + 115.0;
        println!(
            "M6x1 at {rpm} rev/min: {at_speed:.1} µm at speed ({low:.0} to {high:.0} rev/min), {ramps:.1} µm in ramps and \
             reversal, depth {:+.1} µm, {} scans",
            deepest * 1e3,
            errors.len()
        );
        assert!(at_speed < 20.0 && ramps < 20.0 && deepest.abs() < 0.02);
    }
}

#[test]
fn g84_taps_rigidly_with_an_encoder_and_as_before_without() {
    let (mut machine, mut plant) = lathe();
    let text = "G21 G18 G90 G94\nG0 X0 Z10\nS600 M3\nG17 F750\nG98 G84 Z-12 R3\nG80\nM5\nM2\n";
    let rigid = run(&machine, &plant, text, None);
    assert_eq!(ended(&rigid).0, Some(Mode::Finished));
    assert_eq!(rigid.violations, [] as [String; 0]);
    let taps = tap_errors(&rigid, -1.25);
    assert_eq!(taps.len(), 1);
    let worst = largest(taps[0].iter().map(|(_, error)| *error));
    println!("G84, 1.25 mm at 600 rev/min: {worst:.1} µm");
    assert!(worst < 25.0, "{worst}");
    let left = text.replace("M3", "M4").replace("G84", "G74");
    let left = run(&machine, &plant, &left, None);
    let taps = tap_errors(&left, 1.25);
    let worst = largest(taps[0].iter().map(|(_, error)| *error));
    assert!(worst < 25.0, "G74: {worst}");
    if let Some(spindle) = &mut machine.spindle {
        spindle.encoder_counts_per_turn = 0;
    }
    if let Some(spindle) = &mut plant.spindle {
        spindle.encoder_counts_per_turn = 0;
    }
    let floating = run(&machine, &plant, text, None);
    assert_eq!(ended(&floating).0, Some(Mode::Finished));
    assert!(
        floating
            .rows
            .iter()
            .all(|row| row.feedback.auxiliary.coupled == 0)
    );
}

/// What a thread is off the index, in µm, where it is in step: for each pass in turn, with the run-in and the run-out left out.
fn thread_errors(
    path: &PathPart,
    run: &Run,
    mm_per_turn: f64,
    (run_in_mm, run_out_mm): (f64, f64),
) -> Vec<(u32, f64, f64)> {
    let mut passes: Vec<(u32, f64, f64)> = Vec::new();
    for pair in run.rows.windows(2) {
        let [row, next] = pair else { continue };
        let tag = next.feedback.tag;
        let Some(element) = path.get(tag.element) else {
            continue;
        };
        let mm_s = mm_per_turn * row.rpm / 60.0;
        let fed = element.feed != path::geometry::Feed::Rapid && mm_s > 0.0;
        let inside = (run_in_mm..element.length_mm - run_out_mm).contains(&tag.distance_mm);
        if !fed || !inside {
            continue;
        }
        let (start, tangent) = (element.start(), element.tangent(0.0));
        let along = [0, 1].map(|axis| (row.table_mm[axis] - start[axis]) * tangent[axis]);
        let phase = row.turns - (along[0] + along[1]) / mm_per_turn;
        let off_um = (phase - phase.round()) * mm_per_turn * 1e3;
        match passes.last_mut() {
            Some((of, low, high)) if *of == tag.element => {
                (*low, *high) = (low.min(off_um), high.max(off_um));
            }
            _ => passes.push((tag.element, off_um, off_um)),
        }
    }
    passes
}

#[test]
fn every_pass_of_g76_begins_at_the_same_angle() {
    let (machine, plant) = lathe();
    for rpm in [800u32, 1500] {
        let text = format!(
            "G21 G18 G90\nG0 X12 Z5\nS{rpm} M3\nG76 P1.5 Z-20 I-2 J0.2 K0.92 R1.5 Q29.5 H1\nM5\nG0 X30\nM2\n"
        );
        let run = run(&machine, &plant, &text, None);
        assert_eq!(ended(&run).0, Some(Mode::Finished), "{:?}", ended(&run));
        assert_eq!(run.violations, [] as [String; 0]);
        let course = Course::of(&machine, &plant, "any.ngc", &text).expect("a course");
        let passes = thread_errors(&course.path, &run, 1.5, (2.0, 1.0));
        let low = passes
            .iter()
            .map(|pass| pass.1)
            .fold(f64::INFINITY, f64::min);
        let high = passes
            .iter()
            .map(|pass| pass.2)
            .fold(f64::NEG_INFINITY, f64::max);
        let rpms = run
            .rows
            .iter()
            .filter(|row| row.feedback.auxiliary.at_speed == 1);
        let (slow, fast) = rpms.fold((f64::INFINITY, 0.0f64), |(l, h), row| {
            (l.min(row.rpm), h.max(row.rpm))
        });
        println!(
            "G76, 1.5 mm at {rpm} rev/min ({slow:.0} to {fast:.0}): {} passes, {low:.1} to {high:.1} µm off the index",
            passes.len()
        );
        assert!(passes.len() >= 6, "{passes:?}");
        assert!(low > -40.0 && high < 40.0, "{low} {high}");
    }
}

#[test]
fn a_thread_goes_on_through_a_hold_to_its_end_and_knows_no_override() {
    let (machine, plant) = lathe();
    let text = "G21 G18 G90\nG0 X12 Z5\nS600 M3\nG33 Z-15 K1\nG0 X30\nM2\n";
    let mut held_at = None;
    let run = run_with(&machine, &plant, text, None, |feedback, cell| {
        if feedback.tag.element == 1 && feedback.tag.distance_mm > 5.0 && held_at.is_none() {
            held_at = Some(feedback.scan);
            cell.order(&order(Order::Override, 20.0));
            cell.order(&order(Order::Hold, 0.0));
        }
    });
    assert_eq!(ended(&run).0, Some(Mode::Finished), "{:?}", ended(&run));
    let course = Course::of(&machine, &plant, "any.ngc", text).expect("a course");
    let passes = thread_errors(&course.path, &run, 1.0, (1.0, 1.0));
    assert_eq!(passes.len(), 1);
    assert!(passes[0].1 > -30.0 && passes[0].2 < 30.0, "{passes:?}");
    // It stands at the end of the pass while it is held.
    let held = run.rows.iter().filter(|row| row.feedback.hold == 1);
    let stands = held.filter(|row| row.feedback.at_rest == 1);
    let mut places = stands.map(|row| row.feedback.tag);
    assert!(places.all(|tag| tag.element == 1 && tag.distance_mm == 20.0));
}

#[test]
fn a_tap_that_is_held_stops_in_step_and_is_not_jogged() {
    let (machine, plant) = lathe();
    let mut asked = 0;
    let run = run_with(&machine, &plant, &tap(900), None, |feedback, cell| {
        let place = feedback.tag;
        if asked == 0 && place.element == 1 && place.distance_mm > 6.0 {
            asked = 1;
            cell.order(&order(Order::Hold, 0.0));
        }
        if asked == 1 && feedback.hold == 1 && feedback.at_rest == 1 {
            let answer = cell.order(&order(Order::Jog, 1.0));
            // It must have rested for a moment before that.
            if answer.reason == Refused::InThread as u32 {
                asked = 2;
            }
        }
    });
    assert_eq!(asked, 2);
    assert_eq!(ended(&run).0, Some(Mode::Finished), "{:?}", ended(&run));
    let taps = tap_errors(&run, -1.0);
    let worst = largest(taps[0].iter().map(|(_, error)| *error));
    println!("a tap held and resumed: {worst:.1} µm");
    assert!(worst < 25.0, "{worst}");
}

/// Who is killed in a tap, and the processes that are.
const KILLED: [(&str, &[&str]); 6] = [
    ("planner", &["planner"]),
    ("servo of Z, with its standby", &["servo-Z"]),
    ("both servos of Z", &["servo-Z", "servo-Z/b"]),
    ("both servos of X", &["servo-X", "servo-X/b"]),
    ("master", &["plant-sim"]),
    ("master and planner", &["plant-sim", "planner"]),
];

#[test]
fn whoever_is_killed_in_a_tap_spindle_and_axis_stop_together_and_go_on_in_step() {
    let (machine, plant) = lathe();
    let text = tap(1000);
    let undisturbed = run(&machine, &plant, &text, None);
    let coupled = |row: &&Row| row.feedback.auxiliary.coupled != 0;
    let first = undisturbed
        .rows
        .iter()
        .find(coupled)
        .expect("a tap")
        .feedback
        .scan;
    let last = undisturbed
        .rows
        .iter()
        .rfind(coupled)
        .expect("a tap")
        .feedback
        .scan;
    let mut worst = [0.0f64; 6];
    let mut wrong = Vec::new();
    for seed in 0..size::number("SEEDS", SEEDS[0], SEEDS[1]) {
        let mut rng = Rng::new(Rng::new(seed).bits());
        let kind = (seed % 6) as usize;
        let scan = rng.within(first, last);
        let mut script = String::from(RESTARTS);
        for who in KILLED[kind].1 {
            script += &kill(who, scan, rng.within(5, 200));
        }
        let run = run(&machine, &plant, &text, Some(&script));
        if ended(&run).0 != Some(Mode::Finished) {
            wrong.push(format!("seed {seed}: {:?}: {script}", ended(&run)));
            continue;
        }
        let taps = tap_errors(&run, -1.0);
        if taps.len() != 1 {
            wrong.push(format!("seed {seed}: {} taps: {script}", taps.len()));
        }
        let deepest = run.rows.iter().map(|row| row.table_mm[Z]);
        let deepest = deepest.fold(f64::INFINITY, f64::min) + 115.0;
        if deepest.abs() > 0.05 {
            wrong.push(format!("seed {seed}: depth {deepest:+.3} mm: {script}"));
        }
        let of_run = largest(taps.iter().flatten().map(|(_, error)| *error));
        if of_run > 250.0 {
            wrong.push(format!("seed {seed}: {of_run:.1} µm: {script}"));
        }
        if !run.violations.is_empty() {
            wrong.push(format!("seed {seed}: {:?}: {script}", run.violations));
        }
        worst[kind] = worst[kind].max(of_run);
    }
    for ((name, _), worst) in KILLED.iter().zip(worst) {
        println!("killed in a tap at 1000 rev/min: {name}: at most {worst:.1} µm off the spindle");
    }
    assert_eq!(wrong, [] as [String; 0]);
}

#[test]
fn whoever_is_killed_in_a_thread_it_goes_on_at_the_index() {
    let (machine, plant) = lathe();
    let text = "G21 G18 G90\nG0 X12 Z5\nS600 M3\nG33 Z-35 K1\nG0 X30\nM2\n";
    let course = Course::of(&machine, &plant, "any.ngc", text).expect("a course");
    let undisturbed = run(&machine, &plant, text, None);
    let on = |row: &&Row| row.feedback.tag.element == 1 && row.feedback.tag.distance_mm > 0.0;
    let first = undisturbed
        .rows
        .iter()
        .find(on)
        .expect("a pass")
        .feedback
        .scan;
    for seed in 0..size::number("SEEDS", SEEDS[0], SEEDS[1]) / 3 {
        let mut rng = Rng::new(Rng::new(seed).bits());
        let who = ["planner", "servo-Z", "plant-sim"][(seed % 3) as usize];
        let scan = rng.within(first, first + 1500);
        let script = format!("{RESTARTS}{}", kill(who, scan, rng.within(5, 200)));
        let run = run(&machine, &plant, text, Some(&script));
        assert_eq!(
            ended(&run).0,
            Some(Mode::Finished),
            "seed {seed}: {:?}",
            ended(&run)
        );
        assert_eq!(run.violations, [] as [String; 0], "seed {seed}: {script}");
        // The last part of the pass is in step again, at the index.
        let passes = thread_errors(&course.path, &run, 1.0, (30.0, 1.0));
        assert!(
            passes.iter().all(|pass| pass.1 > -30.0 && pass.2 < 30.0),
            "seed {seed}: {passes:?}: {script}"
        );
    }
}

/// Faces off with the cutting speed kept, to the limit; then X0 lies elsewhere, and in the end the speed is a number again.
const FACING: &str = "G21 G18 G90 G95\nG0 X60 Z2\nG96 D2500 S180 M3\nG1 Z0 F0.2\nX1 F0.2\nG0 Z5\nX60\nG92 X40\nG1 X30\nG97 S400\nX35\nM2\n";
const X: usize = 0;

/// Commanded speeds of a run of [`FACING`] that are not those of the radius.
fn wrong_speeds(run: &Run, course: &Course) -> Vec<String> {
    let mut wrong = vec![];
    for row in &run.rows {
        let (tag, auxiliary) = (row.feedback.tag, row.feedback.auxiliary);
        let Some(element) = course.path.get(tag.element) else {
            continue;
        };
        let moves = tag.distance_mm > 0.0 && tag.distance_mm < element.length_mm;
        let turns = auxiliary.levels.spindle_rpm != 0.0;
        let centre_mm = match element.line {
            4..=7 if moves => 0.0,
            9 if moves => 20.0,
            _ => continue,
        };
        let x_mm = row.feedback.axes[X].command_position as f64 * 1e-6;
        let by_radius = 180e3 / (std::f64::consts::TAU * (x_mm - centre_mm).abs());
        let right = by_radius.clamp(50.0, 2500.0);
        if turns && (auxiliary.levels.spindle_rpm - right).abs() > 1e-3 * right {
            let (scan, rpm) = (row.feedback.scan, auxiliary.levels.spindle_rpm);
            wrong.push(format!(
                "scan {scan}: {rpm} rev/min at X {x_mm}, not {right}"
            ));
        }
    }
    wrong
}

#[test]
fn in_g96_the_spindle_follows_the_radius_and_the_feed_follows_the_spindle() {
    let (machine, plant) = lathe();
    let course = Course::of(&machine, &plant, "any.ngc", FACING).expect("a course");
    let run = run(&machine, &plant, FACING, None);
    assert_eq!(ended(&run).0, Some(Mode::Finished), "{:?}", ended(&run));
    assert_eq!(run.violations, [] as [String; 0]);
    let wrong = wrong_speeds(&run, &course);
    assert!(
        wrong.is_empty(),
        "{} scans: {:?}",
        wrong.len(),
        wrong.first()
    );
    let mut cut = vec![];
    for pair in run.rows.windows(2) {
        let (tag, next) = (pair[0].feedback.tag, pair[1].feedback.tag);
        let Some(element) = course.path.get(tag.element).filter(|of| of.line == 5) else {
            continue;
        };
        let x_mm = pair[0].table_mm[X];
        if next.element != tag.element || !(2.0..58.0).contains(&x_mm) {
            continue;
        }
        assert_ne!(element.feed, path::geometry::Feed::Rapid);
        let turns = pair[1].turns - pair[0].turns;
        let m_min = pair[1].rpm * std::f64::consts::TAU * x_mm * 1e-3;
        cut.push((x_mm, m_min, (next.distance_mm - tag.distance_mm) / turns));
    }
    let above = |of: &&(f64, f64, f64)| of.0 > 12.5;
    let speeds = cut.iter().filter(above).map(|of| of.1);
    let (low, high) = speeds.fold((f64::INFINITY, 0.0f64), |(l, h), of| (l.min(of), h.max(of)));
    let feeds = cut.iter().map(|of| of.2);
    let (least, most) = feeds.fold((f64::INFINITY, 0.0f64), |(l, h), of| (l.min(of), h.max(of)));
    println!(
        "facing at 180 m/min from X58 to X2: {low:.1} to {high:.1} m/min above the limit's radius, {least:.4} to {most:.4} mm per turn, {} scans",
        cut.len()
    );
    assert!(cut.len() > 10_000, "{}", cut.len());
    assert!(low > 0.97 * 180.0 && high < 1.02 * 180.0, "{low} {high}");
    assert!(least > 0.85 * 0.2 && most < 1.03 * 0.2, "{least} {most}");
    let last = run
        .rows
        .iter()
        .rfind(|row| row.feedback.auxiliary.levels.spindle_rpm != 0.0);
    let last_rpm = last.map(|row| row.feedback.auxiliary.levels.spindle_rpm);
    assert_eq!(last_rpm, Some(400.0));
}

#[test]
fn whoever_is_killed_in_g96_the_spindle_has_the_speed_of_the_radius_afterwards() {
    let (machine, plant) = lathe();
    let course = Course::of(&machine, &plant, "any.ngc", FACING).expect("a course");
    let undisturbed = run(&machine, &plant, FACING, None);
    let last = undisturbed.rows.len() as u64 - 200;
    for seed in 0..size::number("SEEDS", SEEDS[0], SEEDS[1]) / 3 {
        let mut rng = Rng::new(Rng::new(seed).bits());
        let who = ["planner", "servo-X", "plant-sim"][(seed % 3) as usize];
        let (scan, after) = (rng.within(500, last), rng.within(5, 200));
        let script = format!("{RESTARTS}{}", kill(who, scan, after));
        let run = run(&machine, &plant, FACING, Some(&script));
        assert_eq!(
            ended(&run).0,
            Some(Mode::Finished),
            "seed {seed}: {:?}",
            ended(&run)
        );
        assert_eq!(run.violations, [] as [String; 0], "seed {seed}: {script}");
        let wrong = wrong_speeds(&run, &course);
        assert!(
            wrong.is_empty(),
            "seed {seed}: {:?}: {script}",
            wrong.first()
        );
    }
}

#[test]
fn the_shipped_programs_run_to_their_end() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xz-lathe");
    let machine = Machine::load(&folder).expect("machine.toml");
    let plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    for name in ["groove-g33.ngc", "tap-m6.ngc", "thread-m20.ngc"] {
        let text = std::fs::read_to_string(folder.join("programs").join(name)).expect("a program");
        let mut cell = InProcessCell::new(&machine, &plant, name, &text).expect("a cell");
        let (mut scans, mut mode, mut digest) = (0, 0, (0, 0));
        while let Some(published) = cell.scan() {
            scans = published.feedback.scan;
            mode = published.feedback.mode;
            let instruments = published.instruments;
            digest = (
                instruments.motion_digest_high,
                instruments.motion_digest_low,
            );
        }
        println!("{name} {scans} {:016x}{:016x}", digest.0, digest.1);
        assert_eq!(Mode::from_wire(mode), Some(Mode::Finished), "{name}");
    }
}
