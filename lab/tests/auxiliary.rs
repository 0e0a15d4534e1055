//! Spindle, coolant, outputs, tool changes and stops happen where the program says, once, whoever is killed meanwhile.

use std::fmt::Write as _;

use crate::common::{AT_SPEED_SHARE, kill, load, mill_with_spindle, order};
use crate::size;
use bus::sample::{Cause, FLOOD, Feedback, Levels, MIST, Mode, Order, SpindleCommand, Waiting};
use lab::cell::{InProcessCell, Script};
use lab::invariants::{Course, Judge};
use machine::{KeptParameters, Machine, ToolChanger};
use path::geometry::Feed;
use plant_sim::plant_file::{PlantFile, PlantSpindle};
use plant_sim::script::faults;
use plant_sim::script::rng::Rng;

/// Seeds of a run of this test, and in full; `SEEDS=500` in the environment for a long one.
const SEEDS: [u64; 2] = [10, 40];
const SPEED_RPM: f64 = 3000.0;
/// From an order of the operator to the next.
const ORDER_SCANS: u64 = 40;
/// What the tool may be further off the path than undisturbed, in mm.
const PATH_MM: f64 = 0.05;

/// The mill, whose programs keep #101.
fn mill() -> (Machine, PlantFile) {
    let (mut machine, plant) = mill_with_spindle();
    machine.program.parameters = "101 4".into();
    machine.parameters = [(101, 4.0)].into();
    (machine, plant)
}

fn cell(machine: &Machine, plant: &PlantFile, text: &str, script: Script) -> InProcessCell {
    InProcessCell::with_script(machine, plant, ("any.ngc", text), script).expect("a cell")
}

/// Every feedback of an undisturbed run.
fn feedbacks(machine: &Machine, plant: &PlantFile, text: &str) -> Vec<Feedback> {
    let mut cell = cell(machine, plant, text, Script::default());
    let mut all = Vec::new();
    while let Some(published) = cell.scan() {
        all.push(*published.feedback);
        assert!(all.len() < 100_000, "the run does not end: {text}");
    }
    all
}

fn moves(feedback: &Feedback) -> bool {
    let mut axes = feedback.axes().iter();
    feedback.at_rest == 0 && axes.any(|axis| axis.velocity_command_mm_s.abs() > 0.5)
}

#[test]
fn a_dwell_before_the_first_motion_is_made() {
    let (machine, plant) = load("xy");
    let scans = |text: &str| feedbacks(&machine, &plant, text).len() as u64;
    let motion = "G91 G1 X10 F3000\nM2\n";
    let without = scans(motion);
    for first in ["G4 P2\n", "S1000 M3\nG4 P2\n"] {
        let waited = scans(&format!("{first}{motion}")) - without;
        assert!((2000..=2008).contains(&waited), "{first:?}: {waited} scans");
    }
    let alone = scans("G4 P2\nM2\n");
    assert!(alone >= 2000, "a dwell alone: {alone} scans");
}

#[test]
fn the_first_feed_waits_for_the_spindle_and_rapids_do_not() {
    let (machine, plant) = mill();
    let text = "G91 S3000 M3\nG0 X20\nG1 X10 F3000\nS1500\nG1 X10\nM5\nM2\n";
    let all = feedbacks(&machine, &plant, text);
    let rapids = all
        .iter()
        .filter(|f| f.tag.element == 0 && moves(f) && f.auxiliary.spindle_rpm < 2000.0);
    assert!(
        rapids.count() > 50,
        "the rapid does not wait for the spindle"
    );
    let mut feeds = 0;
    for feedback in all.iter().filter(|f| moves(f)) {
        let wanted_rpm = match feedback.tag.element {
            0 => continue,
            1 => SPEED_RPM,
            _ => 1500.0,
        };
        feeds += 1;
        let rpm = feedback.auxiliary.spindle_rpm;
        let off = (rpm - wanted_rpm).abs() / wanted_rpm;
        assert!(
            off <= AT_SPEED_SHARE,
            "scan {}: {rpm} rev/min",
            feedback.scan
        );
    }
    assert!(feeds > 100);
    let waits = |f: &&Feedback| f.auxiliary.waiting == Waiting::SpindleSpeed as u32;
    assert!(all.iter().filter(waits).count() > 100);
    let lines: Vec<u32> = all.iter().filter(waits).map(|f| f.auxiliary.line).collect();
    assert_eq!((lines.first(), lines.last()), (Some(&1), Some(&4)));
    let last = all.last().expect("a scan");
    assert_eq!(last.mode, Mode::Finished as u32);
    assert_eq!(last.auxiliary.levels.spindle, SpindleCommand::Stop as u32);
}

#[test]
fn without_a_spindle_m3_changes_nothing() {
    let (machine, plant) = load("xyz-mill");
    let digest = |text: &str| {
        let mut cell = cell(&machine, &plant, text, Script::default());
        let mut digest = None;
        while let Some(published) = cell.scan() {
            digest = Some((
                published.instruments.motion_digest_high,
                published.instruments.motion_digest_low,
                published.feedback.auxiliary.events_done,
            ));
        }
        digest
    };
    let motion = "G91\nG1 X10 F3000\nG1 Y10\nM2\n";
    let first = digest(motion).expect("a run");
    let second = digest("G91\nS1000 M3\nG1 X10 F3000\nG1 Y10\nM2\n").expect("a run");
    assert_eq!(first.2, 0);
    assert_eq!(second.2, 0);
    // The program's hash is in its windows, so the digests differ; nothing else does.
    let scans = |text: &str| feedbacks(&machine, &plant, text).len();
    assert_eq!(
        scans(motion),
        scans("G91\nS1000 M3\nG1 X10 F3000\nG1 Y10\nM2\n")
    );
}

#[test]
fn outputs_of_a_motion_switch_where_it_begins_without_a_stop() {
    let (machine, plant) = mill();
    let text = "G91 G1 X10 F3000\nM62 P3\nG1 X10\nM63 P3\nM64 P1\nG1 X10\nM2\n";
    let all = feedbacks(&machine, &plant, text);
    let on = |f: &Feedback, output: u32| f.auxiliary.levels.digital >> output & 1 == 1;
    let switched: Vec<&Feedback> = all
        .windows(2)
        .filter(|pair| on(&pair[0], 3) != on(&pair[1], 3))
        .map(|pair| &pair[0])
        .collect();
    let [first, second] = switched.as_slice() else {
        panic!("{} switches", switched.len())
    };
    assert_eq!((first.tag.element, second.tag.element), (1, 2));
    // In the first scan of its element: at most one scan's way into it, in full motion.
    let way_mm = 50.0 * machine.scan_period_s();
    assert!(first.tag.distance_mm <= way_mm, "{:?}", first.tag);
    let speed = first.axes()[0].velocity_command_mm_s;
    assert!(speed > 45.0, "{speed} mm/s: it has braked");
    // The second stands behind M64, for which the path rests.
    let at_rest = all.iter().find(|f| on(f, 1)).expect("it is switched");
    assert_eq!(at_rest.tag.element, 1);
    assert_eq!(at_rest.at_rest, 1);
}

#[test]
fn a_program_stop_waits_for_the_operator_and_an_optional_one_where_it_is_switched_on() {
    for optional in [0.0, 1.0] {
        let (machine, plant) = mill();
        let text = "G91 S3000 M3 M8\nG1 X5 F3000\nM0\nG1 X5\nM1\nG1 X5\nM60\nG1 X5\nM2\n";
        let mut cell = cell(&machine, &plant, text, Script::default());
        let answer = cell.order(&order(Order::OptionalStop, optional));
        assert_eq!(answer.accepted, 1);
        let mut stops: Vec<(u32, u32)> = Vec::new();
        let mut stopped_scans = 0;
        let mut last = None;
        while let Some(published) = cell.scan() {
            let feedback = *published.feedback;
            last = Some(feedback);
            let waiting = Waiting::from_wire(feedback.auxiliary.waiting).expect("known");
            if !waiting.is_for_operator() {
                stopped_scans = 0;
                continue;
            }
            assert_eq!((feedback.hold, moves(&feedback)), (1, false));
            assert_eq!(feedback.auxiliary.levels.coolant, FLOOD, "coolant stays on");
            assert_eq!(feedback.auxiliary.at_speed, 1, "the spindle goes on");
            stopped_scans += 1;
            if stopped_scans == 1 {
                stops.push((feedback.auxiliary.waiting, feedback.auxiliary.line));
            }
            if stopped_scans == 300 {
                assert_eq!(cell.order(&order(Order::Resume, 0.0)).accepted, 1);
            }
        }
        let mut expected = vec![(Waiting::ProgramStop as u32, 3)];
        if optional == 1.0 {
            expected.push((Waiting::OptionalStop as u32, 5));
        }
        expected.push((Waiting::PalletStop as u32, 7));
        assert_eq!(stops, expected);
        let last = last.expect("a scan");
        assert_eq!(last.mode, Mode::Finished as u32);
        assert_eq!(last.auxiliary.levels.coolant, 0);
    }
}

#[test]
fn a_tool_comes_into_a_spindle_that_stands_and_an_operator_says_that_it_is_in() {
    let text = "G91 S3000 M3\nG1 X5 F3000\nT4 M6\nM3\nG1 X5\nT4 M6\nG1 X5\nM2\n";
    let (machine, plant) = mill();
    let all = feedbacks(&machine, &plant, text);
    let changed = all.iter().position(|f| f.auxiliary.tool == 4);
    let changed = &all[changed.expect("the tool comes in")];
    assert_eq!(changed.auxiliary.spindle_rpm, 0.0);
    let waits = |what: Waiting| {
        let waits = all.iter().filter(|f| f.auxiliary.waiting == what as u32);
        waits.count()
    };
    assert!(waits(Waiting::SpindleStandstill) > 400);
    assert!((240..=260).contains(&waits(Waiting::ToolChange)));

    let (mut machine, plant) = mill();
    machine.tool_change.by = ToolChanger::Operator;
    let mut cell = cell(&machine, &plant, text, Script::default());
    let mut asked = 0;
    let mut last = None;
    while let Some(published) = cell.scan() {
        let feedback = *published.feedback;
        last = Some(feedback);
        if feedback.auxiliary.waiting == Waiting::ToolByOperator as u32 {
            assert_eq!((feedback.auxiliary.tool, feedback.auxiliary.line), (0, 3));
            assert_eq!(feedback.auxiliary.levels.tool, 4);
            asked += 1;
            assert_eq!(cell.order(&order(Order::Resume, 0.0)).accepted, 1);
        }
    }
    let last = last.expect("a scan");
    assert_eq!((asked, last.auxiliary.tool), (1, 4));
    assert_eq!(last.mode, Mode::Finished as u32);
}

/// M61: where an operator puts tools in, the machine believes the program; a changer knows itself what is in.
#[test]
fn the_number_of_the_tool_in_the_spindle_is_set_without_a_change() {
    let text = "G91 M61 Q4\nG1 X5 F3000\nT4 M6\nG1 X5\nT2 M6\nG1 X5\nM61 Q1\nG1 X1\nM2\n";
    let tools = |machine: &Machine, plant: &PlantFile| {
        let mut cell = cell(machine, plant, text, Script::default());
        let (mut tools, mut asked, mut changed) = (vec![], vec![], 0);
        while let Some(published) = cell.scan() {
            let feedback = *published.feedback;
            let now = feedback.auxiliary;
            if tools.last() != Some(&now.tool) {
                tools.push(now.tool);
            }
            changed += usize::from(now.waiting == Waiting::ToolChange as u32);
            if now.waiting == Waiting::ToolByOperator as u32 {
                asked.push((now.levels.tool, now.line));
                assert_eq!(cell.order(&order(Order::Resume, 0.0)).accepted, 1);
            }
            assert!(feedback.scan < 100_000, "the run does not end");
        }
        (tools, asked, changed)
    };
    let (mut machine, plant) = mill();
    let (shown, asked, changed) = tools(&machine, &plant);
    assert_eq!((shown, asked), (vec![0, 4, 2], vec![]));
    assert!(
        (480..=520).contains(&changed),
        "{changed} scans for two changes"
    );
    machine.tool_change.by = ToolChanger::Operator;
    let (shown, asked, changed) = tools(&machine, &plant);
    assert_eq!((shown, asked), (vec![0, 4, 2, 1], vec![(2, 5)]));
    assert_eq!(changed, 0);
}

#[test]
fn a_spindle_that_does_not_come_to_its_speed_trips_with_its_cause() {
    let (machine, mut plant) = mill();
    plant.spindle = Some(PlantSpindle {
        acceleration_rpm_s: 100.0,
        orientation_rpm: 60.0,
        ..PlantSpindle::default()
    });
    let all = feedbacks(&machine, &plant, "G91 S3000 M3\nG1 X5 F3000\nM2\n");
    let last = all.last().expect("a scan");
    assert_eq!(last.mode, Mode::Tripped as u32);
    assert_eq!(Cause::from_wire(last.cause), Some(Cause::Spindle));
    assert!(!all.iter().any(moves));
}

/// A program with everything in it.
fn everything() -> String {
    let mut text = String::from("G21 G91 T2 M6\nS3000 M3 M8\nG4 P0.05\n");
    let mut add = |words: &str| {
        let _ = writeln!(text, "{words}");
    };
    for words in [
        "G0 X8 Y4",
        "M62 P1",
        "G1 X6 F2400",
        "M63 P1",
        "M7",
        "G1 Y6",
        "M0",
        "G2 X6 Y6 I6",
        "M64 P5",
        "M9",
        "T3 M6",
        "M4",
        "G1 X-6 F2400",
        "M62 P2",
        "G1 Y-6",
        "G4 P0.02",
        "M5",
        "M60",
        "M65 P5",
        "M19 R90",
        "G0 X-6",
        "S2000 M3 M8",
        "G1 Y-4 F2400",
        "M30",
    ] {
        add(words);
    }
    text
}

/// A program whose path, offsets and outputs come out of loops, subroutines and parameters.
fn computed() -> String {
    String::from(
        "G21 G90 T1 M6\nS1500 M3\n\
         o<side> sub\n\
         M62 P#3\n\
         G91 G1 X#1 Y#2 F2400\n\
         #<_sides> = [#<_sides> + 1]\n\
         o<side> endsub [#<_sides> * 0.5]\n\
         #<_sides> = 0\n#100 = 0\n\
         o10 while [#100 lt 4]\n\
         G10 L2 P1 X[#100 * 0.5] Y0\n\
         G90 G54 G0 X1 Y1\n\
         o<side> call [3] [0] [#100 + 1]\n\
         o<side> call [0] [2 + #<_value>] [0]\n\
         o20 repeat [2]\n\
         M63 P[#100 + 1]\n\
         G1 X-1 Y[-#<_sides> / 10]\n\
         o20 endrepeat\n\
         o30 if [#100 eq 1]\n\
         T2 M6\nM61 Q3\nM3\nM8\n\
         o30 elseif [#100 eq 2]\n\
         G4 P0.03\nM9\nM64 P7\n\
         o30 endif\n\
         #100 = [#100 + 1]\n\
         #101 = [#101 + 1]\n\
         G10 L20 P2 X#101\n\
         o10 endwhile\n\
         G92 X0 Y0\nG90 G1 X#<_sides> Y2\nG92.1\nM5\nM30\n",
    )
}

/// An event that was counted: where the machine was, and the levels from then on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Counted {
    number: u32,
    element: u32,
    digital: u64,
    coolant: u32,
    spindle: u32,
    tool: u32,
    prepared: u32,
}

/// What the judge of one run has seen.
#[derive(Debug, Default)]
struct Seen {
    counted: Vec<Counted>,
    scans_of_events: Vec<u64>,
    stops: Vec<(u32, u32)>,
    violations: Vec<String>,
    before: Option<Feedback>,
    kept: Option<KeptParameters>,
    contour_mm: f64,
    digest: (u64, u64),
}

impl Seen {
    fn take(&mut self, feedback: &Feedback, feeds: &[bool]) {
        let auxiliary = &feedback.auxiliary;
        let mut say = |what: String| self.violations.push(format!("{}: {what}", feedback.scan));
        let levels: &Levels = &auxiliary.levels;
        let before = self.before.replace(*feedback);
        let done = before.map_or(0, |before| before.auxiliary.events_done);
        if auxiliary.events_done < done {
            say(format!("{done} events, then {}", auxiliary.events_done));
        }
        if auxiliary.events_done > done {
            if auxiliary.events_done != done + 1 {
                say(format!(
                    "{done} events, then {} at once",
                    auxiliary.events_done
                ));
            }
            self.scans_of_events.push(feedback.scan);
            // Counted where it was before; a killed master shows no place afterwards.
            let tag = before.map_or(feedback.interrupted_at, |before| before.tag);
            self.counted.push(Counted {
                number: auxiliary.events_done,
                element: tag.element,
                digital: levels.digital,
                coolant: levels.coolant & (MIST | FLOOD),
                spindle: levels.spindle,
                tool: auxiliary.tool,
                prepared: levels.tool_prepared,
            });
        }
        let stop = (auxiliary.waiting, auxiliary.line);
        let was = before.map(|before| (before.auxiliary.waiting, before.auxiliary.line));
        let for_operator = |(waiting, _): (u32, u32)| {
            Waiting::from_wire(waiting).is_some_and(Waiting::is_for_operator)
        };
        if for_operator(stop) && was != Some(stop) {
            self.stops.push(stop);
        }
        let enabled = feedback.mode == Mode::Enabled as u32;
        let feeds = feeds.get(feedback.tag.element as usize) == Some(&true);
        if enabled && feeds && moves(feedback) {
            let off = (auxiliary.spindle_rpm - levels.spindle_rpm).abs();
            if off > AT_SPEED_SHARE * levels.spindle_rpm.abs() + 1.0 || levels.spindle_rpm == 0.0 {
                say(format!("feeds at {} rev/min", auxiliary.spindle_rpm));
            }
        }
    }
}

/// One run of a program, with an operator who goes on whenever he may.
fn run(
    machine: &Machine,
    plant: &PlantFile,
    (text, course): (&str, &Course),
    script: Option<&str>,
) -> Seen {
    let faults = script.map(|text| faults::parse("faults.toml", text, machine).expect("a script"));
    let script = Script {
        faults,
        ..Script::default()
    };
    let mut cell = cell(machine, plant, text, script);
    let elements = (0..course.path.end()).filter_map(|element| course.path.get(element));
    let feeds: Vec<bool> = elements
        .map(|element| !element.is_dwell() && element.feed != Feed::Rapid)
        .collect();
    let mut judge = Judge::new(machine, course);
    let mut seen = Seen::default();
    let mut quiet_scans = 0;
    while let Some(published) = cell.scan() {
        judge.take(&published, |_, _| true);
        let feedback = *published.feedback;
        seen.kept = cell.kept_parameters().cloned();
        if seen.kept.is_none() && feedback.mode == Mode::Finished as u32 {
            seen.violations
                .push("done before its parameters are kept".into());
        }
        seen.take(&feedback, &feeds);
        if feedback.scan > 60_000 {
            seen.violations.push("the run does not end".into());
            break;
        }
        let waits = feedback.hold == 1
            || feedback.mode == Mode::Tripped as u32
            || feedback.mode == Mode::Disabled as u32;
        quiet_scans = if waits { quiet_scans + 1 } else { 0 };
        if quiet_scans < ORDER_SCANS {
            continue;
        }
        quiet_scans = 0;
        let next = if feedback.mode == Mode::Enabled as u32 {
            Order::Resume
        } else {
            Order::Enable
        };
        cell.order(&order(next, 0.0));
    }
    let (shown, violations) = judge.end();
    for violation in violations {
        seen.violations.push(format!("{violation:?}"));
    }
    seen.contour_mm = shown.contour_mm.0;
    seen.digest = shown.digest;
    let last = seen.before.expect("a scan");
    if last.mode != Mode::Finished as u32 {
        let cause = Cause::from_wire(last.cause);
        seen.violations
            .push(format!("ends in mode {}, {cause:?}", last.mode));
    }
    seen
}

fn one_of<'a, T>(rng: &mut Rng, all: &'a [T]) -> &'a T {
    rng.pick(all).expect("a list with elements")
}

#[test]
fn whoever_is_killed_at_an_event_none_is_lost_and_none_is_done_twice() {
    kill_around_events(&everything(), 2);
}

#[test]
fn whoever_is_killed_in_a_loop_or_a_subroutine_place_offsets_tool_and_outputs_are_right_afterwards()
{
    kill_around_events(&computed(), 0);
}

/// Kills at and around the events of a program, and anywhere: it ends as if nobody had been killed.
fn kill_around_events(text: &str, stops: usize) {
    let (machine, plant) = mill();
    let course = Course::of(&machine, &plant, "any.ngc", text).expect("a course");
    let undisturbed = run(&machine, &plant, (text, &course), None);
    assert_eq!(undisturbed.violations, [] as [String; 0]);
    assert_eq!(undisturbed.stops.len(), stops, "{:?}", undisturbed.stops);
    let passes = text.matches("while").count() as f64 * 2.0;
    assert_eq!(
        undisturbed.kept.as_ref().map(|kept| kept[&101]),
        Some(4.0 + passes)
    );
    let (mut kills, mut worst_mm) = (0, 0.0f64);
    for seed in 0..size::number("SEEDS", SEEDS[0], SEEDS[1]) {
        let mut rng = Rng::new(Rng::new(seed).bits());
        let mut script =
            String::from("[restart]\nplanner = \"resume\"\nservo = \"wait\"\nmaster = \"wait\"\n");
        for _ in 0..rng.within(1, 3) {
            let event = *one_of(&mut rng, &undisturbed.scans_of_events);
            let scan = (event + rng.within(0, 60)).saturating_sub(30).max(5);
            let who = *one_of(
                &mut rng,
                &[
                    "planner",
                    "planner",
                    "plant-sim",
                    "plant-sim",
                    "servo-X",
                    "servo-Y/b",
                ],
            );
            script += &kill(who, scan, rng.within(5, 200));
            kills += 1;
        }
        let seen = run(&machine, &plant, (text, &course), Some(&script));
        let what = format!("seed {seed}:\n{script}");
        assert_eq!(seen.violations, [] as [String; 0], "{what}");
        worst_mm = worst_mm.max(seen.contour_mm);
        let most_mm = undisturbed.contour_mm + PATH_MM;
        assert!(seen.contour_mm <= most_mm, "{} mm: {what}", seen.contour_mm);
        let numbers = |seen: &Seen| -> Vec<_> {
            let counted = seen.counted.iter();
            counted.map(|c| (c.number, c.digital, c.prepared)).collect()
        };
        assert_eq!(numbers(&seen), numbers(&undisturbed), "{what}");
        assert_eq!(seen.stops, undisturbed.stops, "{what}");
        // Where each happened on the path; a killed master shows no place while it is replaced.
        for (now, then) in seen.counted.iter().zip(&undisturbed.counted) {
            let placed = now.element != u32::MAX;
            assert!(
                !placed || now.element == then.element,
                "{now:?} {then:?} {what}"
            );
        }
        let end = |seen: &Seen| seen.before.map(|f| (f.auxiliary.tool, f.auxiliary.levels));
        assert_eq!(end(&seen), end(&undisturbed), "{what}");
        assert_eq!(seen.kept, undisturbed.kept, "{what}");
    }
    println!(
        "{kills} kills: at most {worst_mm:.4} mm off the path, undisturbed {:.4} mm",
        undisturbed.contour_mm
    );
}

#[test]
fn a_servo_with_a_standby_that_is_killed_at_an_event_changes_no_bit_of_the_motion() {
    let (machine, plant) = mill();
    let course = Course::of(&machine, &plant, "any.ngc", &everything()).expect("a course");
    let undisturbed = run(&machine, &plant, (&everything(), &course), None);
    for scan in &undisturbed.scans_of_events {
        let script =
            format!("[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"servo-X\"\ndo = \"kill\"\n");
        let seen = run(&machine, &plant, (&everything(), &course), Some(&script));
        assert_eq!(seen.digest, undisturbed.digest, "{script}");
        assert_eq!(seen.counted, undisturbed.counted, "{script}");
        assert_eq!(seen.violations, [] as [String; 0], "{script}");
    }
}

#[test]
fn an_override_that_the_program_has_switched_off_does_not_count() {
    let (machine, plant) = mill();
    let scans = |text: &str, percent: f64| {
        let mut cell = cell(&machine, &plant, text, Script::default());
        assert_eq!(cell.order(&order(Order::Override, percent)).accepted, 1);
        let mut scans = 0;
        while cell.scan().is_some() {
            scans += 1;
        }
        scans
    };
    let (off, on) = ("G91 M49\nG1 X40 F3000\nM2\n", "G91 M48\nG1 X40 F3000\nM2\n");
    let full = scans(off, 100.0);
    assert_eq!(scans(off, 50.0), full);
    assert_eq!(scans(on, 100.0), full);
    assert!(scans(on, 50.0) > full + 500);
}

#[test]
fn an_axis_may_be_jogged_in_a_program_stop_and_the_program_returns_to_its_place() {
    let (machine, plant) = mill();
    let text = "G91 S1000 M3\nG1 X5 F3000\nM0\nM8\nG1 Y5\nM2\n";
    let mut cell = cell(&machine, &plant, text, Script::default());
    let mut stopped_scans = 0;
    let mut place = None;
    let mut last = None;
    while let Some(published) = cell.scan() {
        let feedback = *published.feedback;
        last = Some(feedback);
        assert!(feedback.scan < 20_000, "it does not end");
        if feedback.auxiliary.waiting != Waiting::ProgramStop as u32 {
            if feedback.auxiliary.levels.coolant == FLOOD {
                place.get_or_insert(feedback.axes()[0].command_position);
            }
            continue;
        }
        stopped_scans += 1;
        if stopped_scans == 200 {
            assert_eq!(cell.order(&order(Order::Jog, -2.0)).accepted, 1);
        }
        if stopped_scans == 1500 {
            assert_eq!(cell.order(&order(Order::Resume, 0.0)).accepted, 1);
        }
    }
    let last = last.expect("a scan");
    assert_eq!(last.mode, Mode::Finished as u32);
    // M8 was done where the program stands, not where the axis was jogged to.
    assert_eq!(place, Some(last.axes()[0].command_position));
}
