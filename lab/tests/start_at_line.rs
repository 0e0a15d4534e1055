//! Start at a line: levels as the blocks before it leave them, an approach over the workpiece, and the path from there, whoever is
//! killed meanwhile.

use crate::common::{going_on, kill, mill_with_spindle, order, waited};
use crate::size;
use bus::sample::{Feedback, Levels, Mode, Order, PathTag};
use lab::cell::{InProcessCell, Script};
use lab::invariants::Course;
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::faults;

/// From a stop to the order that ends it: longer than drives and brake take to come on.
const ORDER_SCANS: u64 = 100;
/// The tool is this near its path, which is looked at in steps of half of it.
const PATH_MM: f64 = 0.01;
/// What smoothing keeps the tool behind its place on the path.
const BEHIND_MM: f64 = 1.0;
const PROGRAM: &str = "G21 G90 G61\nT1 M6\nS1000 M3\nM8 M64 P2\nG0 Z-10\nG0 X10 Y10\nG1 Z-20 F1200\nG1 X20\nM0\n\
                       M9\nM7 S1500\n(MSG, second half)\nG2 X30 Y20 J10\nG1 Y30\nM64 P3\nG1 X10\nG0 Z-5\nM5\nM2\n";
const LINE: u32 = 13;
const ELEMENT: u32 = 4;

/// What a run did.
#[derive(Debug, Default)]
struct Seen {
    all: Vec<Feedback>,
}

impl Seen {
    /// The first scan on the path of an element.
    fn first_on(&self, element: u32) -> &Feedback {
        let on = |of: &&Feedback| {
            !of.window.is_none() && !of.tag.is_off_path() && of.tag.element == element
        };
        self.all.iter().find(on).expect("the element is travelled")
    }

    fn last(&self) -> &Feedback {
        self.all.last().expect("a scan")
    }
}

/// A run from a line, or from the beginning, with an operator who resumes.
fn run(machine: &Machine, plant: &PlantFile, line: u32, faults: Option<&str>) -> Seen {
    let faults = faults.map(|text| faults::parse("faults.toml", text, machine).expect("a script"));
    let script = Script {
        faults,
        ..Script::default()
    };
    let program = ("any.ngc", PROGRAM);
    let mut cell = InProcessCell::with_script(machine, plant, program, script).expect("a cell");
    cell.begin_at_line(line);
    let mut seen = Seen::default();
    let mut quiet_scans = 0;
    while let Some(published) = cell.scan() {
        let feedback = *published.feedback;
        assert!(feedback.scan < 60_000, "the run does not end");
        seen.all.push(feedback);
        quiet_scans = waited(quiet_scans, &feedback);
        if quiet_scans == ORDER_SCANS {
            quiet_scans = 0;
            cell.order(&going_on(&feedback));
        }
    }
    assert_eq!(seen.last().mode, Mode::Finished as u32);
    seen
}

fn position_mm(machine: &Machine, feedback: &Feedback, axis: usize) -> f64 {
    feedback.axes[axis].command_position as f64 * machine.axes[axis].increment_mm()
}

/// How far a point is from the path around this place on it.
fn off_path_mm(course: &Course, tag: &PathTag, at: &[f64; 3]) -> f64 {
    let steps = (2.0 * BEHIND_MM / PATH_MM) as u32;
    let (mut element, mut distance_mm) = (tag.element, tag.distance_mm);
    let mut least_mm = f64::INFINITY;
    for _ in 0..=steps {
        let on = course.path.get(element).expect("an element");
        let point = on.point(distance_mm);
        let square = |axis: usize| (point[axis] - at[axis]).powi(2);
        least_mm = least_mm.min((0..3).map(square).sum::<f64>().sqrt());
        distance_mm -= PATH_MM / 2.0;
        while distance_mm < 0.0 && element > 0 {
            element -= 1;
            let before = course.path.get(element).expect("an element");
            distance_mm += before.length_mm;
        }
        distance_mm = distance_mm.max(0.0);
    }
    least_mm
}

/// What is wrong with a run that was started at the line: the tool is on the path from there on and nowhere on it before, and has
/// travelled above its depth.
fn judge(machine: &Machine, course: &Course, seen: &Seen) {
    let mut started = false;
    let first = seen.first_on(ELEMENT);
    let places = |feedback: &Feedback| -> [f64; 3] {
        std::array::from_fn(|axis| position_mm(machine, feedback, axis))
    };
    let target = places(first);
    let mut before = places(&seen.all[0]);
    for feedback in &seen.all {
        let at = places(feedback);
        let aside_mm = (at[0] - target[0]).hypot(at[1] - target[1]);
        let travels = at[..2] != before[..2] && aside_mm > 1.0;
        before = at;
        if feedback.window.is_none() || feedback.tag.is_off_path() {
            assert!(
                started || !travels || at[2] > target[2] - PATH_MM,
                "scan {}: through the workpiece at {} mm",
                feedback.scan,
                at[2]
            );
            continue;
        }
        started = true;
        let tag = feedback.tag;
        assert!(tag.element >= ELEMENT, "scan {}: {tag:?}", feedback.scan);
        let off_mm = off_path_mm(course, &tag, &at);
        assert!(off_mm < PATH_MM, "scan {}: {off_mm} mm off", feedback.scan);
    }
}

fn levels_at(feedback: &Feedback) -> (Levels, u32, u32) {
    let levels = Levels {
        blocks_done: 0,
        ..feedback.auxiliary.levels
    };
    (
        levels,
        feedback.auxiliary.events_done,
        feedback.auxiliary.tool,
    )
}

#[test]
fn at_its_line_the_program_is_as_if_it_had_come_there() {
    let (machine, plant) = mill_with_spindle();
    let course = Course::of(&machine, &plant, "any.ngc", PROGRAM).expect("a course");
    let whole = run(&machine, &plant, 0, None);
    let started = run(&machine, &plant, LINE, None);
    judge(&machine, &course, &started);
    let [of_whole, of_started] = [&whole, &started].map(|seen| levels_at(seen.first_on(ELEMENT)));
    assert_eq!(of_started, of_whole);
    assert_eq!(of_started.0.spindle_rpm, 1500.0);
    assert!(started.first_on(ELEMENT).auxiliary.at_speed == 1);
    // M0 stands before it.
    assert!(started.all.iter().all(|feedback| feedback.hold == 0));
    for axis in 0..3 {
        let [a, b] = [&whole, &started].map(|seen| seen.last().axes[axis].command_position);
        assert_eq!(a, b, "axis {axis}");
    }
    assert_eq!(
        started.last().auxiliary.levels.digital,
        whole.last().auxiliary.levels.digital
    );
    assert_eq!(started.last().auxiliary.start_line, 0);
}

#[test]
fn a_run_from_a_line_is_the_same_to_the_bit_every_time() {
    let (machine, plant) = mill_with_spindle();
    let [a, b] = [(); 2].map(|()| run(&machine, &plant, LINE, None));
    assert!(a.all == b.all);
}

#[test]
fn whoever_is_killed_on_the_way_the_program_begins_at_its_line_with_its_levels() {
    let (machine, plant) = mill_with_spindle();
    let course = Course::of(&machine, &plant, "any.ngc", PROGRAM).expect("a course");
    let undisturbed = run(&machine, &plant, LINE, None);
    let first = undisturbed.first_on(ELEMENT);
    let levels = levels_at(first);
    let mut scans: Vec<u64> = (1..60).step_by(3).collect();
    scans.extend((60..first.scan + 20).step_by(size::number("SCANS_APART", 499, 499) as usize));
    scans.extend((first.scan - 12..first.scan + 12).step_by(2));
    let mut kills = 0;
    for (index, scan) in size::one_in(9, scans).into_iter().enumerate() {
        for who in ["planner", "plant-sim", "servo-Y"] {
            if (index + kills) % 2 == 1 && who != "planner" {
                continue;
            }
            let script = format!(
                "[restart]\nplanner = \"resume\"\nservo = \"wait\"\nmaster = \"wait\"\n{}",
                kill(who, scan, 20)
            );
            let seen = run(&machine, &plant, LINE, Some(&script));
            judge(&machine, &course, &seen);
            assert_eq!(levels_at(seen.first_on(ELEMENT)), levels, "{script}");
            let ends = |seen: &Seen| seen.last().axes.map(|axis| axis.command_position);
            assert_eq!(ends(&seen), ends(&undisturbed), "{script}");
            kills += 1;
        }
    }
    println!("{kills} kills");
    assert!(kills > 6, "{kills}");
}

#[test]
fn a_jog_on_the_way_is_followed_by_another_approach() {
    let (machine, plant) = mill_with_spindle();
    let course = Course::of(&machine, &plant, "any.ngc", PROGRAM).expect("a course");
    let undisturbed = run(&machine, &plant, LINE, None);
    let program = ("any.ngc", PROGRAM);
    let mut cell =
        InProcessCell::with_script(&machine, &plant, program, Script::default()).expect("a cell");
    cell.begin_at_line(LINE);
    let mut seen = Seen::default();
    let middle = undisturbed.first_on(ELEMENT).scan * 2 / 3;
    while let Some(published) = cell.scan() {
        let feedback = *published.feedback;
        assert!(feedback.scan < 60_000, "the run does not end");
        seen.all.push(feedback);
        if feedback.scan == middle {
            assert_eq!(cell.order(&order(Order::Hold, 0.0)).accepted, 1);
        }
        if feedback.scan == middle + 1_500 {
            let mut jog = order(Order::Jog, 7.0);
            jog.axis = 2;
            assert_eq!(cell.order(&jog).accepted, 1);
        }
        if feedback.scan == middle + 4_000 {
            assert_eq!(cell.order(&order(Order::Resume, 0.0)).accepted, 1);
        }
    }
    judge(&machine, &course, &seen);
    let ends = |seen: &Seen| seen.last().axes.map(|axis| axis.command_position);
    assert_eq!(ends(&seen), ends(&undisturbed));
}
