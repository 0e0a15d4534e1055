//! Overrides of feeds and of rapids, each of its own kind.

use std::path::Path;

use crate::common::order;
use bus::sample::{Feedback, Mode, Order, Refused};
use lab::cell::InProcessCell;
use machine::Machine;
use plant_sim::plant_file::PlantFile;

const RAPID: &str = "G91 G0 X60\nM2\n";
const FEED: &str = "G91 G1 X60 F3000\nM2\n";

fn mill(feed_override_max_percent: u32) -> (Machine, PlantFile) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xyz-mill");
    let mut machine = Machine::load(&folder).expect("machine.toml");
    machine.path.feed_override_max_percent = feed_override_max_percent;
    let plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    (machine, plant)
}

/// Scans of a program with these orders before its first; the last feedback.
fn run(
    (machine, plant): &(Machine, PlantFile),
    text: &str,
    orders: &[(Order, f64)],
) -> (u64, Feedback) {
    let mut cell = InProcessCell::new(machine, plant, "any.ngc", text).expect("a cell");
    for (what, value) in orders {
        assert_eq!(cell.order(&order(*what, *value)).accepted, 1, "{what:?}");
    }
    let mut last = None;
    while let Some(published) = cell.scan() {
        last = Some(*published.feedback);
        assert!(published.feedback.scan < 60_000, "the run does not end");
    }
    let last = last.expect("a scan");
    assert_eq!(last.mode, Mode::Finished as u32);
    (last.scan, last)
}

#[test]
fn the_override_of_rapids_slows_rapids_and_nothing_else() {
    let mill = mill(100);
    let half = [(Order::RapidOverride, 50.0)];
    let (all, _) = run(&mill, RAPID, &[]);
    let (slower, last) = run(&mill, RAPID, &half);
    assert!(slower > all + 100, "{slower} scans at 50 %, {all} at 100 %");
    assert_eq!(last.inputs.rapid_override_percent(), 50);
    assert_eq!(run(&mill, FEED, &half).0, run(&mill, FEED, &[]).0);
}

#[test]
fn rapids_at_0_stand_until_they_may_go_and_feeds_go_before_them() {
    let (machine, plant) = mill(100);
    let text = "G91 G1 X10 F3000\nG0 X20\nM2\n";
    let mut cell = InProcessCell::new(&machine, &plant, "any.ngc", text).expect("a cell");
    cell.order(&order(Order::RapidOverride, 0.0));
    let mut start = None;
    let mut stands = 0;
    let mut last = None;
    while let Some(published) = cell.scan() {
        let feedback = *published.feedback;
        let place = feedback.axes[0].command_position;
        let moved = place - *start.get_or_insert(place);
        let moved_mm = moved as f64 * machine.axes[0].increment_mm();
        let rests = feedback.at_rest == 1 && (moved_mm - 10.0).abs() < 1e-3;
        stands += u64::from(rests);
        if stands == 300 {
            cell.order(&order(Order::RapidOverride, 100.0));
        }
        assert!(feedback.scan < 20_000, "it does not go on");
        last = Some((feedback.mode, moved_mm));
    }
    let (mode, moved_mm) = last.expect("a scan");
    assert_eq!(mode, Mode::Finished as u32);
    assert!((moved_mm - 30.0).abs() < 1e-3, "{moved_mm} mm");
    assert!(stands >= 300, "it stood for {stands} scans");
}

#[test]
fn a_machine_that_allows_it_takes_feeds_to_twice_what_the_program_asks_for() {
    let (machine, plant) = mill(100);
    let mut cell = InProcessCell::new(&machine, &plant, "any.ngc", FEED).expect("a cell");
    let refused = cell.order(&order(Order::Override, 120.0));
    assert_eq!(refused.reason, Refused::BadValue as u32);
    let fast = mill(200);
    let (programmed, _) = run(&fast, FEED, &[]);
    let (twice, end) = run(&fast, FEED, &[(Order::Override, 200.0)]);
    let (as_fast, of) = run(&fast, &FEED.replace("F3000", "F6000"), &[]);
    assert!(programmed > twice + 400, "{programmed} and {twice} scans");
    assert_eq!(twice, as_fast);
    let place = |feedback: &Feedback| feedback.axes.map(|axis| axis.command_position);
    assert_eq!(place(&end), place(&of));
    // Rapids are as fast as the axes are.
    assert_eq!(
        run(&fast, RAPID, &[(Order::Override, 200.0)]).0,
        run(&fast, RAPID, &[]).0
    );
}
