#![allow(clippy::expect_used, clippy::indexing_slicing, clippy::panic)]

use super::*;
use crate::test_spindle::spindle;

fn machine() -> Machine {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xyz-mill");
    let mut machine = Machine::load(&folder).expect("the machine");
    machine.spindle = Some(spindle());
    machine
}

fn found(text: &str, line: u32) -> Result<StartPlace, String> {
    let text = ProgramText::Here("part.ngc".into(), text.into());
    start_place(&machine(), &text, [0; PATH_AXES], line).map_err(|error| error.to_string())
}

fn codes(place: &StartPlace) -> Vec<(EventCode, u32, f64)> {
    let code = |event: &ProgramEvent| EventCode::from_wire(event.code).expect("a code");
    let events = place.levels.iter();
    events.map(|of| (code(of), of.index, of.value)).collect()
}

const PART: &str = "T1 M6\nS1000 M3\nM8\nG0 X1 Y1\nG1 X2 F600\nM9\nM0\nT2 M6\nS2000 M3\n(here)\nG1 X3\n\
                    M7\nG1 X4\no1 if [1 GT 0]\nG1 X5\no1 endif\nG1 X6\nM2\n";

#[test]
fn a_line_is_its_first_motion_with_the_levels_of_what_stands_before_it() {
    let place = found(PART, 11).expect("a place");
    assert_eq!(place.element, 2);
    assert_eq!(
        codes(&place),
        [
            (EventCode::ToolChange, 2, 0.0),
            (EventCode::ToolPrepare, 2, 0.0),
            (EventCode::SpindleSpeed, 0, 2000.0),
            (EventCode::SpindleClockwise, 0, 0.0),
            (EventCode::Mist, 0, 0.0),
            (EventCode::Flood, 0, 0.0),
            (EventCode::AwaitSpindle, 0, 0.0),
        ]
    );
    assert_eq!(found(PART, 4).expect("a place").element, 0);
    assert_eq!(found(PART, 17).expect("a place").element, 5);
}

#[test]
fn what_its_own_line_switches_is_left_to_the_line() {
    let text = "S1000 M3\nG0 X1\nM8 G1 X2 F600\nM2\n";
    let place = found(text, 3).expect("a place");
    let flood = codes(&place).iter().any(|of| of.0 == EventCode::Flood);
    assert!(!flood);
    // S, M3, and nothing of line 3.
    assert_eq!(place.events, 2);
}

#[test]
fn a_line_without_motion_is_refused_with_those_around_it() {
    assert_eq!(
        found(PART, 9).expect_err("no motion"),
        "line 9: no motion begins here: a program starts at a line that moves the tool, as lines 5 and 11 do"
    );
    assert_eq!(
        found(PART, 99).expect_err("no line"),
        "line 99: no motion begins here: a program starts at a line that moves the tool, as line 17 does"
    );
}

#[test]
fn behind_a_question_nothing_is_known() {
    let text = "G0 X1\nM66 P0 L3 Q5\nG1 X2 F600\nM2\n";
    assert!(found(text, 1).is_ok());
    let refused = found(text, 3).expect_err("a question");
    assert!(refused.starts_with("line 2: asks the machine"), "{refused}");
}

#[test]
fn a_mistake_before_the_line_is_refused_and_one_far_behind_it_is_not_met() {
    assert!(found("G0 X1\nG1 X1 F0\nG1 X2\nM2\n", 3).is_err());
}

#[test]
fn a_long_program_is_read_over_several_periods() {
    let mut text = String::from("G1 F6000\n");
    for block in 0..40_000 {
        text.push_str(&format!("X{} Y{}\n", block % 7, block % 5));
    }
    text.push_str("M2\n");
    let place = found(&text, 39_000).expect("a place");
    assert_eq!(place.element, 39_000 - 2);
}
