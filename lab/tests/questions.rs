//! What a program asks the machine: where a probe trips, what an input shows; whoever is killed meanwhile.

use std::fmt::Write as _;
use std::path::Path;

use crate::common::kill;
use crate::size;
use bus::sample::{
    AnswerOutcome, Cause, Feedback, Instruments, Mode, OperatorRequest, Order, PATH_AXES, Waiting,
};
use lab::cell::{InProcessCell, Script};
use lab::stock::probe_above;
use machine::{Machine, PositionFeedback};
use plant_sim::plant_file::{PlantFile, PlantInput};
use plant_sim::script::faults;
use plant_sim::script::rng::Rng;

/// Seeds of a run of this test, and in full; `SEEDS=500` in the environment for a long one.
const SEEDS: [u64; 2] = [8, 30];
/// The surface below the ball's centre when it touches.
const SURFACE_MM: f64 = -60.0;
const TIP_MM: f64 = 2.0;

fn mill() -> (Machine, PlantFile) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xyz-mill");
    let mut machine = Machine::load(&folder).expect("machine.toml");
    machine.program.work_offset_mm.clear();
    machine.program.probe = true;
    let mut plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    plant.probe = Some(probe_above(SURFACE_MM));
    (machine, plant)
}

fn cell(machine: &Machine, plant: &PlantFile, text: &str, script: Script) -> InProcessCell {
    InProcessCell::with_script(machine, plant, ("any.ngc", text), script).expect("a cell")
}

/// What was published in a scan: by the master, by the instruments, and what the servo of Z compensates, in mm.
type Scan = (Feedback, Instruments, f64);

/// Every scan of an undisturbed run.
fn run(machine: &Machine, plant: &PlantFile, text: &str) -> Vec<Scan> {
    let mut cell = cell(machine, plant, text, Script::default());
    let mut all = Vec::new();
    while let Some(published) = cell.scan() {
        let of_z = published.commands.iter().find(|c| c.axis == 2);
        let compensation_mm = of_z.map_or(0.0, |command| command.compensation_mm);
        all.push((*published.feedback, *published.instruments, compensation_mm));
        assert!(all.len() < 200_000, "the run does not end: {text}");
    }
    all
}

fn order(order: Order) -> OperatorRequest {
    OperatorRequest {
        order: order as u32,
        axis: 0,
        value: 0.0,
        ..OperatorRequest::default()
    }
}

/// When, in scans, the table of Z comes to a height, going down; and where its motor is then, in mm.
fn crossing(all: &[Scan], height_mm: f64) -> (f64, f64) {
    const Z: usize = 2;
    let mut before: Option<(f64, f64, f64)> = None;
    for (feedback, instruments, _) in all {
        let count = instruments.subsamples as usize;
        for sample in 0..count {
            let time = feedback.scan as f64 + (sample + 1) as f64 / count as f64;
            let table = instruments.axes[Z].table_mm[sample];
            let motor = instruments.axes[Z].motor_mm[sample];
            if let Some((was_time, was_table, was_motor)) = before
                && was_table > height_mm
                && table <= height_mm
            {
                let share = (was_table - height_mm) / (was_table - table);
                return (
                    was_time + (time - was_time) * share,
                    was_motor + (motor - was_motor) * share,
                );
            }
            before = Some((time, table, motor));
        }
    }
    panic!("it does not come to {height_mm} mm")
}

#[test]
fn the_tripped_position_is_that_of_the_instant_of_the_contact() {
    for (feed_mm_min, most_um) in [(50.0, 1.0), (100.0, 1.0), (500.0, 1.0), (2000.0, 1.0)] {
        for feedback in [PositionFeedback::Motor, PositionFeedback::Scale] {
            let (mut machine, plant) = mill();
            machine.axes[2].feedback = feedback;
            let near_mm = SURFACE_MM + TIP_MM + 2.0;
            let text = format!("G0 Z{near_mm}\nG38.2 Z-70 F{feed_mm_min}\nG0 Z-50\nM2\n");
            let all = run(&machine, &plant, &text);
            let last = all.last().expect("a scan").0;
            assert_eq!(
                last.mode,
                Mode::Finished as u32,
                "{:?}",
                Cause::from_wire(last.cause)
            );
            let given = all.iter().map(|(feedback, ..)| feedback.answer);
            let mut given = given.filter(|a| a.outcome == AnswerOutcome::Given as u32);
            let answer = given.next().expect("an answer");
            let (time, motor_mm) = crossing(&all, SURFACE_MM + TIP_MM);
            let off_scans = (answer.scan as f64 + answer.value - time).abs();
            assert!(off_scans < 1e-3, "{off_scans} scans off");
            let increment_mm = machine.axes[2].increment_mm();
            let tripped_mm = answer.tripped[2] as f64 * increment_mm;
            // By a scale that is where the table is; by the motor, where the motor is, less what its servo compensates.
            let at_trip = all.iter().find(|(f, ..)| f.scan == answer.scan);
            let (at_trip, _, compensation_mm) = at_trip.expect("that scan");
            let truth_mm = match feedback {
                PositionFeedback::Scale => SURFACE_MM + TIP_MM,
                PositionFeedback::Motor => motor_mm - compensation_mm,
            };
            let off_um = (tripped_mm - truth_mm) * 1e3;
            let scan_um = feed_mm_min / 60.0;
            let overtravel_um = (answer.tripped[2] - answer.rests[2]) as f64 * increment_mm * 1e3;
            let table_um = (tripped_mm - SURFACE_MM - TIP_MM) * 1e3;
            println!(
                "F{feed_mm_min} by {feedback:?}: {off_um:.3} µm off ({table_um:.2} µm from the table), a scan is {scan_um:.2} µm, rests {overtravel_um:.0} µm behind; at {:.3} mm/s",
                at_trip.axes()[2].velocity_mm_s
            );
            assert!(
                off_um.abs() < most_um,
                "F{feed_mm_min} {feedback:?}: {off_um} µm"
            );
            // The program goes on from where the axes rest.
            let rest_mm = answer.rests[2] as f64 * increment_mm;
            assert!(
                rest_mm < tripped_mm && rest_mm > tripped_mm - 3.0,
                "{rest_mm} mm"
            );
        }
    }
}

/// Touches five places, moves by what it has found, waits for an input; ends where all of it says.
fn everything() -> String {
    let mut text = String::from("G0 X255 Z-55\n#1=0\n#2=0\no1 while [#1 LT 5]\n");
    let mut add = |words: &str| {
        let _ = writeln!(text, "{words}");
    };
    for words in [
        "G91 G0 X3",
        "M64 P4",
        "G90 G38.2 Z-70 F600",
        "#2=[#2+#5063]",
        "M62 P1",
        "G38.4 Z-50 F300",
        "M63 P1",
        "G0 Z-55",
        "G38.3 Z-56",
        "o2 if [#5070 EQ 1]",
        "G0 X0",
        "o2 endif",
        "M65 P4",
        "#1=[#1+1]",
        "o1 endwhile",
        "M64 P9",
        "M66 P3 L3 Q5",
        "G0 Y[200+#5399*7] Z-50",
        "M66 P3 L4 Q0.1",
        "G0 X[260+#5399]",
        "G1 Z[#2/5+10] F2000",
        "M2",
    ] {
        add(words);
    }
    text
}

fn with_input(plant: &mut PlantFile) {
    plant.inputs = vec![PlantInput {
        digital: Some(3),
        analog: None,
        value: 1.0,
        at_s: 0.25,
        after_output: Some(9),
    }];
}

/// What came of a run: each answer in order, the place it ends at, and what is wrong with it.
#[derive(Debug, Default, PartialEq)]
struct Seen {
    answers: Vec<(u32, u32, f64, [i64; PATH_AXES])>,
    end: Option<[i64; PATH_AXES]>,
    outputs: Vec<u64>,
    wrong: Vec<String>,
    changes: Vec<u64>,
}

fn judged(machine: &Machine, plant: &PlantFile, text: &str, faults: Option<&str>) -> Seen {
    let faults = faults.map(|text| faults::parse("faults.toml", text, machine).expect("a script"));
    let script = Script {
        faults,
        ..Script::default()
    };
    let mut cell = cell(machine, plant, text, script);
    let mut seen = Seen::default();
    let mut before: Option<Feedback> = None;
    let mut quiet_scans = 0;
    while let Some(published) = cell.scan() {
        let feedback = *published.feedback;
        let answer = feedback.answer;
        let was = before.replace(feedback);
        let known = answer.outcome >= AnswerOutcome::Given as u32;
        let new = was.is_none_or(|was| {
            (was.answer.number, was.answer.outcome) != (answer.number, answer.outcome)
        });
        if known && new {
            seen.answers
                .push((answer.number, answer.outcome, answer.value, answer.tripped));
            seen.changes.push(feedback.scan);
        }
        let digital = feedback.auxiliary.levels.digital;
        if was.map_or(0, |was| was.auxiliary.levels.digital) != digital {
            seen.outputs.push(digital);
        }
        if was.is_some_and(|was| was.auxiliary.events_done > feedback.auxiliary.events_done) {
            seen.wrong
                .push(format!("{}: an event is undone", feedback.scan));
        }
        if feedback.scan > 120_000 {
            let event = published
                .status
                .map(|status| (status.event, status.answered, status.cause));
            seen.wrong
                .push(format!("the run does not end: {feedback:?} {event:?}"));
            break;
        }
        let waits = feedback.hold == 1
            || feedback.mode == Mode::Tripped as u32
            || feedback.mode == Mode::Disabled as u32;
        quiet_scans = if waits { quiet_scans + 1 } else { 0 };
        if quiet_scans >= 40 {
            quiet_scans = 0;
            let next = if feedback.mode == Mode::Enabled as u32 {
                Order::Resume
            } else {
                Order::Enable
            };
            cell.order(&order(next));
        }
    }
    let last = before.expect("a scan");
    if last.mode == Mode::Finished as u32 {
        seen.end = Some(last.path_positions());
    } else {
        let cause = Cause::from_wire(last.cause);
        seen.wrong
            .push(format!("ends in mode {}, {cause:?}", last.mode));
    }
    seen
}

#[test]
fn a_program_goes_on_with_what_it_has_found() {
    let (machine, mut plant) = mill();
    with_input(&mut plant);
    let seen = judged(&machine, &plant, &everything(), None);
    assert_eq!(seen.wrong, [] as [String; 0]);
    let outcomes: Vec<u32> = seen.answers.iter().map(|answer| answer.1).collect();
    let (given, missed) = (AnswerOutcome::Given as u32, AnswerOutcome::Missed as u32);
    let mut expected = [given, given, missed].repeat(5);
    expected.extend([given, missed]);
    assert_eq!(outcomes, expected);
    let end = seen
        .end
        .expect("an end")
        .map(|position| position as f64 * 1e-6);
    // The input showed 1, then did not go off in time: -1.
    assert_eq!((end[0], end[1]), (259.0, 207.0));
    let mean_mm = SURFACE_MM + TIP_MM + 10.0;
    assert!((end[2] - mean_mm).abs() < 0.02, "{} mm", end[2]);
}

#[test]
fn whoever_is_killed_while_a_program_asks_each_answer_is_had_once_and_is_right() {
    let (machine, mut plant) = mill();
    with_input(&mut plant);
    let undisturbed = judged(&machine, &plant, &everything(), None);
    assert_eq!(undisturbed.wrong, [] as [String; 0]);
    let (mut kills, mut lost, mut worst_um) = (0, 0, 0.0f64);
    for seed in 0..size::number("SEEDS", SEEDS[0], SEEDS[1]) {
        let mut rng = Rng::new(Rng::new(seed).bits());
        let mut script =
            String::from("[restart]\nplanner = \"resume\"\nservo = \"wait\"\nmaster = \"wait\"\n");
        for _ in 0..rng.within(1, 3) {
            let change = *rng.pick(&undisturbed.changes).expect("answers");
            let scan = (change + rng.within(0, 120)).saturating_sub(100).max(5);
            let who = *rng
                .pick(&["planner", "planner", "planner", "plant-sim", "servo-Z"])
                .expect("one");
            script += &kill(who, scan, rng.within(5, 200));
            kills += 1;
        }
        let seen = judged(&machine, &plant, &everything(), Some(&script));
        let what = format!("seed {seed}:\n{script}\n{seen:?}");
        let unsure = seen
            .answers
            .iter()
            .any(|answer| answer.1 > AnswerOutcome::Missed as u32);
        if unsure {
            // A master that dies in the middle of a touch: the program says so and stops.
            assert!(script.contains("plant-sim"), "{what}");
            lost += 1;
            continue;
        }
        assert_eq!(seen.wrong, [] as [String; 0], "{what}");
        let kinds = |seen: &Seen| -> Vec<_> { seen.answers.iter().map(|a| (a.0, a.1)).collect() };
        assert_eq!(kinds(&seen), kinds(&undisturbed), "{what}");
        assert_eq!(seen.outputs, undisturbed.outputs, "{what}");
        for (now, then) in seen.answers.iter().zip(&undisturbed.answers) {
            let off_um = (now.3[2] - then.3[2]).abs() as f64 * 1e-3;
            worst_um = worst_um.max(off_um);
            assert!(off_um < 20.0, "{off_um} µm: {what}");
        }
        let (now, then) = (seen.end.expect("an end"), undisturbed.end.expect("an end"));
        for (now, then) in now.iter().zip(then) {
            assert!((now - then).abs() < 20_000, "{what}");
        }
    }
    println!(
        "{kills} kills: {lost} runs stopped as unsure, tripped at most {worst_um:.2} µm apart"
    );
}

#[test]
fn a_probe_that_finds_nothing_or_is_in_contact_before_stops_the_program_with_its_reason() {
    for (text, cause) in [
        ("G38.2 Z-56 F2000\nG0 X0\nM2\n", Cause::ProbeMissed),
        ("G38.4 Z-56 F2000\nG0 X0\nM2\n", Cause::ProbeEarly),
        ("G38.5 Z-56 F2000\nG0 X0\nM2\n", Cause::ProbeEarly),
        (
            "G38.2 Z-70 F2000\nG38.2 Z-70\nG0 X0\nM2\n",
            Cause::ProbeEarly,
        ),
    ] {
        let (machine, plant) = mill();
        let all = run(&machine, &plant, text);
        let last = all.last().expect("a scan").0;
        assert_eq!(Cause::from_wire(last.cause), Some(cause), "{text}");
        assert_eq!(last.mode, Mode::Stopped as u32, "{text}");
        let x = last.axes()[0].command_position as f64 * 1e-6;
        assert!((x - 250.0).abs() < 1e-3, "{text}: X went to {x}");
    }
}

#[test]
fn a_wait_for_an_input_is_shown_and_ends_with_the_input() {
    let (machine, mut plant) = mill();
    with_input(&mut plant);
    let text = "G0 X251\nM64 P9\nM66 P3 L1 Q2\nG0 X[250+#5399*4]\nM2\n";
    let all = run(&machine, &plant, text);
    let waits = all
        .iter()
        .filter(|(f, ..)| f.auxiliary.waiting == Waiting::Input as u32);
    let waits: Vec<u32> = waits.map(|(f, ..)| f.auxiliary.line).collect();
    assert!((200..=260).contains(&waits.len()), "{} scans", waits.len());
    assert!(waits.iter().all(|line| *line == 3));
    let last = all.last().expect("a scan").0;
    assert_eq!(last.axes()[0].command_position, 254_000_000);
    assert_eq!(last.inputs.digital, 1 << 3);
}
