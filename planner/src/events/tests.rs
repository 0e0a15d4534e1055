#![allow(clippy::expect_used, clippy::indexing_slicing)]

use super::*;

use crate::test_spindle::spindle;

use path::geometry::AxisVector;
use program::{Setup, interpret};

fn machine(turns: bool) -> Machine {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
    let mut machine = Machine::load(&folder).expect("the machine");
    machine.program.work_offset_mm.clear();
    machine.spindle = turns.then(spindle);
    machine
}

fn events(machine: &Machine, text: &str) -> Result<Events, EventError> {
    let setup = Setup::of(machine);
    let program = interpret("part.ngc", text, &setup, AxisVector::zeros()).expect("a program");
    let mut path = program.path;
    Events::of(machine, &program.events, &mut path)
}

/// Code, element, and whether in motion, of each.
fn found(events: &Events) -> Vec<(EventCode, u32, bool)> {
    let planned = events.planned.iter();
    planned
        .map(|planned| {
            let code = EventCode::from_wire(planned.event.code).expect("a code");
            (code, planned.event.element, planned.in_motion)
        })
        .collect()
}

#[test]
fn the_first_feed_after_a_change_of_the_spindle_waits_for_it_and_rapids_do_not() {
    let text = "S1000 M3\nG0 X10\nG1 X20 F600\nG1 X30\nS2000\nG1 X40\nM5\nG1 X50\nM2\n";
    let planned = events(&machine(true), text).expect("events");
    assert_eq!(
        found(&planned),
        [
            (EventCode::SpindleSpeed, 0, false),
            (EventCode::SpindleClockwise, 0, false),
            (EventCode::AwaitSpindle, 1, false),
            (EventCode::SpindleSpeed, 3, false),
            (EventCode::AwaitSpindle, 3, false),
            (EventCode::SpindleStop, 4, false),
        ]
    );
    assert_eq!(planned.until_element(0), 0);
    assert_eq!(planned.until_element(2), 1);
    assert_eq!(planned.until_element(6), u32::MAX);
    let without = events(&machine(false), text).expect("events");
    assert!(without.is_empty());
}

/// The speed of before the rapid is not that of behind it.
#[test]
fn where_the_speed_follows_the_radius_the_feed_behind_each_rapid_waits_for_it() {
    let text =
        "G96 D2000 S100 M3\nG1 X10 F600\nX20\nG0 X40\nG1 X50\nG97 S500\nG0 X40\nG1 X50\nM2\n";
    let planned = events(&machine(true), text).expect("events");
    assert_eq!(
        found(&planned),
        [
            (EventCode::SurfaceCentre, 0, false),
            (EventCode::SurfaceLimit, 0, false),
            (EventCode::SurfaceSpeed, 0, false),
            (EventCode::SpindleClockwise, 0, false),
            (EventCode::AwaitSpindle, 0, false),
            (EventCode::AwaitSpindle, 3, false),
            (EventCode::SpindleSpeed, 4, false),
            (EventCode::AwaitSpindle, 5, false),
        ]
    );
}

#[test]
fn outputs_of_a_motion_do_not_stop_it_and_are_told_ahead() {
    let text = "G1 X10 F600\nM62 P3\nG1 X20\nM63 P3\nM64 P1\nG1 X30\nM62 P5\nM2\n";
    let planned = events(&machine(false), text).expect("events");
    assert_eq!(
        found(&planned),
        [
            (EventCode::DigitalOutput, 1, true),
            (EventCode::DigitalOutput, 2, false),
            (EventCode::DigitalOutput, 2, true),
            (EventCode::DigitalOutput, 3, false),
        ]
    );
    assert_eq!(planned.until_element(0), 2);
    assert_eq!(planned.ahead(0).map(|event| event.number)[..2], [1, 0]);
    assert_eq!(planned.ahead(2).map(|event| event.number)[..2], [3, 0]);
    assert_eq!(planned.at_rest(0), None);
    assert_eq!(planned.at_rest(1).map(|event| event.line), Some(5));
}

#[test]
fn what_the_machine_does_not_have_is_refused_with_its_line() {
    let refusal = |text: &str| {
        let refused = events(&machine(true), text).map(|_| ());
        refused.expect_err(text).to_string()
    };
    assert_eq!(
        refusal("G1 X1 F100\nS9000 M3\nM2\n"),
        "line 2: S9000: the spindle of this machine turns at 100 to 6000 rev/min"
    );
    assert_eq!(
        refusal("G96 D50 S100\nM2\n"),
        "line 1: D50: the spindle of this machine turns no slower than 100 rev/min"
    );
    assert_eq!(
        refusal("M68 E8 Q1\nM2\n"),
        "line 1: analogue output 8: there are outputs 0 to 7"
    );
    let many = "M62 P1\nM63 P1\n".repeat(5) + "G1 X1 F100\nM2\n";
    assert!(refusal(&many).contains("line 9: more than 8 outputs"));
}
