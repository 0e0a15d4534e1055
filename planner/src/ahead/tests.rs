#![allow(clippy::expect_used, clippy::indexing_slicing, clippy::panic)]

use super::*;
use crate::test_spindle::spindle;
use bus::sample::{EventCode, ProgramEvent};
use path::path_part::PathPart;
use path::speed_map::first_mapped;

fn machine() -> Machine {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
    let mut machine = Machine::load(&folder).expect("the machine");
    machine.program.work_offset_mm.clear();
    machine.spindle = Some(spindle());
    machine
}

/// A long program with a loop, a subroutine, parameters, events and an arc here and there.
fn text(passes: u32) -> ProgramText {
    text_in("G61", passes)
}

fn text_in(mode: &str, passes: u32) -> ProgramText {
    let text = format!(
        "{mode}\no100 sub\nG1 X[#1] Y[#<y>] F[1000 + #1]\n#<_all> = [#<_all> + 1]\no100 endsub\n\
         #<_all> = 0\nS1000 M3\n#5 = 0\no1 while [#5 LT {passes}]\n\
         o100 call [10 * SIN[#5]]\n#<y> = [5 * COS[#5 * 3]]\nG1 X[9 * COS[#5]] Y[#<_all> MOD 7]\n\
         o2 if [#5 MOD 500 EQ 250]\nM8\nG4 P0.01\nG2 I2\nM62 P1\no2 endif\n\
         #5 = [#5 + 1]\no1 endwhile\nM5\nM2\n"
    );
    let text = text.replace("Y[#<y>]", "Y[#5 MOD 3]");
    ProgramText::Here("long.ngc".into(), text.into())
}

fn begun(
    machine: &Machine,
    text: &ProgramText,
    start: [i64; PATH_AXES],
    place: Option<&Place>,
) -> Result<Course, AheadError> {
    Course::new(machine, text, start, place, Setup::of(machine))
}

fn read_all(course: &mut Course, tool: u32) {
    while !course.is_over() {
        let end = course.windows.path().end();
        course.read_on(tool.max(end), false);
    }
    assert!(course.refused().is_none(), "{:?}", course.refused());
}

fn events_from(course: &Course, number: u32) -> Vec<ProgramEvent> {
    let at_rest = (number..).map_while(|done| {
        let ahead = course.events.ahead(done);
        let first = (ahead[0].number > 0).then_some(ahead[0]);
        course.events.at_rest(done).copied().or(first)
    });
    at_rest.collect()
}

#[test]
fn a_program_that_is_gone_on_with_from_a_place_is_that_of_its_start() {
    gone_on_with_from_every_place(&text(9000));
}

#[test]
fn a_rounded_program_that_is_gone_on_with_from_a_place_is_that_of_its_start() {
    gone_on_with_from_every_place(&text_in("G64 P0.02", 9000));
}

fn gone_on_with_from_every_place(text: &ProgramText) {
    let (machine, start) = (machine(), [0; PATH_AXES]);
    let mut whole = begun(&machine, text, start, None).expect("a course");
    let mut places: Vec<Place> = Vec::new();
    while !whole.is_over() {
        // Nothing is let go: the tool is at the start.
        let wanted = whole.windows.path().end();
        while !whole.is_over() && whole.windows.path().end() <= wanted {
            let read = whole.read_piece();
            assert!(read.is_ok(), "{read:?}");
            whole.windows.map_on();
        }
        places.append(&mut whole.places);
    }
    assert!(places.len() >= 3, "{} places", places.len());
    for kept in &places {
        let place = Place::from_bytes(&kept.to_bytes()).expect("what was kept");
        let mut course = begun(&machine, text, start, Some(&place)).expect("a course");
        assert_eq!(course.windows.path().first(), place.element);
        assert_eq!(course.program_hash, whole.program_hash);
        while !course.is_over() {
            let read = course.read_piece();
            assert!(read.is_ok(), "{read:?}");
            course.windows.map_on();
        }
        let (ours, theirs) = (course.windows.path(), whole.windows.path());
        assert_eq!(ours.end(), theirs.end());
        let programmed = |path: &PathPart, element| path.get(element).map(|of| of.shape.clone());
        for element in place.element..first_mapped(place.element).min(ours.end()) {
            assert_eq!(programmed(ours, element), programmed(theirs, element));
        }
        for element in first_mapped(place.element)..ours.end() {
            assert_eq!(ours.get(element), theirs.get(element), "element {element}");
        }
        let done = place.events.last;
        assert_eq!(events_from(&course, done), events_from(&whole, done));
        let element = first_mapped(place.element);
        if course.windows.is_mapped(element) && element < ours.end() {
            let state = PathState {
                element,
                ..PathState::default()
            };
            let mut request = WindowRequest {
                intended_setpoints: 8,
                repeats_start: true,
                ..WindowRequest::default()
            };
            request.until_element = u32::MAX;
            let (mut found, mut expected) = (Vec::new(), Vec::new());
            let outcome = course.windows.plan(&state, &request, &mut found);
            assert_eq!(outcome, whole.windows.plan(&state, &request, &mut expected));
            assert_eq!(found, expected);
        }
    }
}

#[test]
fn what_lies_behind_the_tool_takes_no_memory() {
    let machine = machine();
    let mut course = begun(&machine, &text(40_000), [0; PATH_AXES], None).expect("a course");
    let mut most = 0;
    while !course.is_over() {
        let end = course.windows.path().end();
        course.read_on(end, false);
        course.events.forget(u32::MAX);
        course.places.clear();
        let path = course.windows.path();
        most = most.max(path.end() - path.first());
    }
    assert!(course.refused().is_none(), "{:?}", course.refused());
    let elements = course.windows.path().end();
    assert!(elements > 70_000, "{elements} elements");
    assert!(most < 40_000, "{most} elements at hand");
}

#[test]
fn a_mistake_far_ahead_lets_everything_before_it_be_travelled() {
    let blocks: String = (0..3000).map(|n| format!("G1 X{} F600\n", n % 9)).collect();
    let text = ProgramText::Here("wrong.ngc".into(), (blocks + "G1 X[1/0]\nM2\n").into());
    let mut course = begun(&machine(), &text, [0; PATH_AXES], None).expect("a course");
    read_until_refused(&mut course);
    let refused = course.refused().expect("a refusal").to_string();
    assert!(refused.contains("wrong.ngc:3001"), "{refused}");
    assert_eq!(course.windows.path().end(), 2999);
    assert!(course.windows.is_mapped(2998) && !course.is_whole());
}

fn read_until_refused(course: &mut Course) {
    while !course.is_over() {
        course.read_on(0, true);
    }
}

#[test]
fn events_of_a_program_in_pieces_are_those_of_the_whole() {
    let machine = machine();
    let mut course = begun(&machine, &text(600), [0; PATH_AXES], None).expect("a course");
    read_all(&mut course, 0);
    let events = events_from(&course, 0);
    let codes: Vec<u32> = events.iter().map(|event| event.code).collect();
    let of = |code: EventCode| codes.iter().filter(|found| **found == code as u32).count();
    assert_eq!(of(EventCode::AwaitSpindle), 1);
    assert_eq!(of(EventCode::Flood), 1);
    assert_eq!(of(EventCode::DigitalOutput), 1);
    assert_eq!(codes.last(), Some(&(EventCode::SpindleStop as u32)));
    assert!(
        events
            .windows(2)
            .all(|pair| pair[1].number == pair[0].number + 1)
    );
}

#[test]
fn a_program_begins_with_its_first_reading_however_short_its_elements_are() {
    let machine = machine();
    for length_mm in [1e-6, 1e-3, 0.01] {
        let chord = |n: u32| format!("G1 X{:.6}\n", f64::from(n) * length_mm);
        let text = "G21 G61 F10000\n".to_string() + &(1..20_000).map(chord).collect::<String>();
        let text = ProgramText::Here("chords.ngc".into(), (text + "M2\n").into());
        let mut course = begun(&machine, &text, [0; PATH_AXES], None).expect("a course");
        course.read_on(0, false);
        assert!(
            !course.is_over() && course.windows.is_mapped(0),
            "{length_mm} mm"
        );
        let at_hand = course.windows.path().end();
        assert!(at_hand < AHEAD_ELEMENTS + 256, "{at_hand} elements");
        let request = WindowRequest {
            intended_setpoints: machine.intended_setpoints(),
            repeats_start: true,
            ..WindowRequest::default()
        };
        let start = course.windows.start_state();
        let outcome = course.windows.plan(&start, &request, &mut Vec::new());
        assert!(outcome.is_ok(), "{length_mm} mm: {outcome:?}");
    }
}
