//! Block by block: the machine rests behind each block, once, whoever is killed meanwhile.

use crate::common::{going_on, kill, load, order, waited};
use bus::sample::{Feedback, Mode, Order, Waiting};
use lab::cell::{InProcessCell, Script};
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::faults;

/// From a stop to the order that ends it.
const ORDER_SCANS: u64 = 40;
/// Motion, an arc, a wait, an event between two blocks, a stop of the program, a rapid.
const PROGRAM: &str =
    "G21 G91\nG1 X10 F3000\nG1 Y10\nG4 P0.1\nM8\nG2 X6 Y6 I6\nM0\nG0 X-5\nG1 Y-1\nM2\n";
const BLOCK: u32 = Waiting::SingleBlock as u32;
const M0: u32 = Waiting::ProgramStop as u32;

/// A stop: what is waited for, its line, where the axes are commanded to be.
type Stop = (u32, u32, [i64; 3]);

#[derive(Debug, Default)]
struct Seen {
    stops: Vec<Stop>,
    /// Scans in which a stop began.
    scans: Vec<u64>,
    last: Option<Feedback>,
}

fn places(feedback: &Feedback) -> [i64; 3] {
    std::array::from_fn(|axis| feedback.axes[axis].command_position)
}

/// A run block by block with an operator who resumes; `at_stop` orders more in a stop.
fn run(
    machine: &Machine,
    plant: &PlantFile,
    faults: Option<&str>,
    mut at_stop: impl FnMut(&mut InProcessCell, usize),
) -> Seen {
    let faults = faults.map(|text| faults::parse("faults.toml", text, machine).expect("a script"));
    let script = Script {
        faults,
        ..Script::default()
    };
    let program = ("any.ngc", PROGRAM);
    let mut cell = InProcessCell::with_script(machine, plant, program, script).expect("a cell");
    assert_eq!(cell.order(&order(Order::SingleBlock, 1.0)).accepted, 1);
    let mut seen = Seen::default();
    let mut quiet_scans = 0;
    while let Some(published) = cell.scan() {
        let feedback = *published.feedback;
        assert!(feedback.scan < 60_000, "the run does not end");
        let stop = (feedback.auxiliary.waiting, feedback.auxiliary.line);
        let was = seen.last.replace(feedback);
        let was = was.map(|was| (was.auxiliary.waiting, was.auxiliary.line));
        if [BLOCK, M0].contains(&stop.0) && was != Some(stop) {
            assert_eq!((feedback.hold, feedback.at_rest), (1, 1));
            seen.stops.push((stop.0, stop.1, places(&feedback)));
            seen.scans.push(feedback.scan);
        }
        quiet_scans = waited(quiet_scans, &feedback);
        if quiet_scans == ORDER_SCANS / 2 {
            at_stop(&mut cell, seen.stops.len());
        }
        if quiet_scans == ORDER_SCANS {
            quiet_scans = 0;
            cell.order(&going_on(&feedback));
        }
    }
    let last = seen.last.expect("a scan");
    assert_eq!(last.mode, Mode::Finished as u32);
    seen
}

#[test]
fn the_machine_rests_exactly_at_the_end_of_each_block_and_resume_runs_the_next() {
    let (machine, plant) = load("xyz-mill");
    let seen = run(&machine, &plant, None, |_, _| {});
    let stops: Vec<(u32, u32)> = seen.stops.iter().map(|stop| (stop.0, stop.1)).collect();
    let expected = [
        (BLOCK, 2),
        (BLOCK, 3),
        (BLOCK, 4),
        (BLOCK, 6),
        (M0, 7),
        (BLOCK, 8),
    ];
    assert_eq!(stops, expected);
    let start = seen.stops[0].2;
    let increment_mm = machine.axes[0].increment_mm();
    let moved =
        |index: usize, axis: usize| (seen.stops[index].2[axis] - start[axis]) as f64 * increment_mm;
    for (index, [x_mm, y_mm]) in [
        [0.0, 0.0],
        [0.0, 10.0],
        [0.0, 10.0],
        [6.0, 16.0],
        [6.0, 16.0],
        [1.0, 16.0],
    ]
    .into_iter()
    .enumerate()
    {
        let off = (moved(index, 0) - x_mm).hypot(moved(index, 1) - y_mm);
        assert!(off <= increment_mm, "stop {index}: {off} mm off");
    }
}

#[test]
fn switched_off_in_a_stop_the_rest_runs_at_once_and_switched_on_again_it_stops_again() {
    let (machine, plant) = load("xyz-mill");
    let seen = run(&machine, &plant, None, |cell, stops| {
        let on = f64::from(u8::from(stops != 2));
        assert_eq!(cell.order(&order(Order::SingleBlock, on)).accepted, 1);
    });
    let lines: Vec<u32> = seen.stops.iter().map(|stop| stop.1).collect();
    // Off behind line 3, on again in the program stop of line 7.
    assert_eq!(lines, [2, 3, 7, 8]);
}

#[test]
fn whoever_is_killed_around_a_stop_it_is_made_once_and_at_its_place() {
    let (machine, plant) = load("xyz-mill");
    let undisturbed = run(&machine, &plant, None, |_, _| {});
    let mut kills = 0;
    for (index, stop) in undisturbed.scans.iter().enumerate() {
        for (offset, who) in [
            (0, "planner"),
            (4, "planner"),
            (8, "plant-sim"),
            (13, "planner"),
            (18, "plant-sim"),
            (23, "planner"),
            (45, "planner"),
        ] {
            let scan = stop + offset + index as u64 % 4 - 12;
            let script = format!(
                "[restart]\nplanner = \"resume\"\nservo = \"wait\"\nmaster = \"wait\"\n{}",
                kill(who, scan, 20)
            );
            let seen = run(&machine, &plant, Some(&script), |_, _| {});
            assert_eq!(seen.stops, undisturbed.stops, "{script}");
            kills += 1;
        }
    }
    assert_eq!(kills, 42);
}
