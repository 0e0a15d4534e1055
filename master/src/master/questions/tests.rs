#![allow(clippy::indexing_slicing)]

use super::*;

const FROM: [i64; PATH_AXES] = [1000, -1000, 0, 0, 0, 0, 0, 0, 0];
const TO: [i64; PATH_AXES] = [2000, -1010, 0, 0, 0, 0, 0, 0, 0];

fn shown(contact: bool, made_at: Option<f64>, lost_at: Option<f64>) -> InputFeedback {
    InputFeedback {
        contact,
        made_at,
        lost_at,
        ..InputFeedback::default()
    }
}

fn probing(index: u32) -> (Questions, Cause) {
    let mut questions = Questions::new(1e-3);
    questions.take(shown(index & PROBE_AWAY != 0, None, None), &FROM, &FROM);
    let event = ProgramEvent {
        number: 3,
        index,
        ..ProgramEvent::default()
    };
    let cause = questions.begin_probe(&event);
    (questions, cause)
}

#[test]
fn the_place_of_the_trip_lies_between_the_encoders_of_the_scan_as_its_instant_does() {
    let (mut questions, cause) = probing(PROBE_MUST);
    assert_eq!(cause, Cause::None);
    assert_eq!(questions.watch(7), (Cause::None, false));
    questions.take(shown(true, Some(0.25), None), &FROM, &TO);
    assert_eq!(questions.watch(8), (Cause::None, true));
    let answer = questions.latches.answer;
    assert_eq!((answer.scan, answer.value, answer.number), (8, 0.25, 3));
    assert_eq!(answer.tripped[..2], [1250, -1003]);
    assert!(questions.brakes());
    // Bounces afterwards change nothing.
    questions.take(shown(true, Some(0.9), Some(0.5)), &TO, &TO);
    assert_eq!(questions.watch(9), (Cause::None, false));
    assert_eq!(questions.latches.answer, answer);
}

#[test]
fn a_probe_that_leaves_trips_where_contact_is_lost() {
    let (mut questions, cause) = probing(PROBE_AWAY);
    assert_eq!(cause, Cause::None);
    questions.take(shown(true, Some(0.75), Some(0.5)), &FROM, &TO);
    assert_eq!(questions.watch(8), (Cause::None, true));
    assert_eq!(questions.latches.answer.tripped[0], 1500);
}

#[test]
fn contact_before_the_motion_or_behind_ones_back_stops_the_program() {
    for index in [PROBE_MUST, 0, PROBE_AWAY] {
        let mut questions = Questions::new(1e-3);
        questions.take(shown(index & PROBE_AWAY == 0, None, None), &FROM, &FROM);
        let event = ProgramEvent {
            number: 1,
            index,
            ..ProgramEvent::default()
        };
        assert_eq!(questions.begin_probe(&event), Cause::ProbeEarly);
    }
    let (mut questions, _) = probing(0);
    // Nobody watched in the scan in which it changed.
    questions.take(shown(true, None, None), &FROM, &FROM);
    questions.take(shown(true, None, None), &FROM, &FROM);
    assert_eq!(questions.watch(8), (Cause::ProbeLost, true));
    assert_eq!(questions.latches.answer.outcome, AnswerOutcome::Lost as u32);
}

#[test]
fn a_probe_that_is_a_mere_input_trips_in_the_middle_of_its_scan_and_where_drives_latched_it() {
    let (mut questions, _) = probing(PROBE_MUST);
    questions.take(shown(true, None, None), &FROM, &TO);
    assert_eq!(questions.watch(8), (Cause::None, true));
    assert_eq!(questions.latches.answer.tripped[..2], [1500, -1005]);
    assert_eq!(questions.watched(), Some(true));
    // The drive of the first axis shows its latch a scan later.
    questions.take(shown(true, None, None), &TO, &TO);
    let mut latched = [None; PATH_AXES];
    latched[0] = Some(1234);
    questions.take_latched(latched);
    assert_eq!(questions.watch(9), (Cause::None, true));
    assert_eq!(questions.latches.answer.tripped[..2], [1234, -1005]);
    assert_eq!(questions.watch(10), (Cause::None, false));
    // A latch that is shown before the input is kept; one that comes long after the trip is a bounce.
    let (mut early, _) = probing(PROBE_MUST);
    early.take_latched(latched);
    early.take_latched([None; PATH_AXES]);
    early.take(shown(true, None, None), &FROM, &TO);
    assert_eq!(early.watch(8), (Cause::None, true));
    assert_eq!(early.latches.answer.tripped[..2], [1234, -1005]);
    early.take_latched([Some(7); PATH_AXES]);
    assert_eq!(early.watch(8 + LATCH_SCANS + 1), (Cause::None, false));
    // Where its source was lost meanwhile, nobody knows of a contact.
    let (mut lost, _) = probing(0);
    let gone = InputFeedback {
        contact_lost: true,
        ..shown(true, None, None)
    };
    lost.take(gone, &FROM, &TO);
    assert_eq!(lost.watch(8), (Cause::ProbeLost, true));
    // A master that has seen no input yet takes none for a change.
    let mut next = Questions::new(1e-3);
    next.resume(&probing(PROBE_MUST).0.latches());
    next.take(shown(true, None, None), &FROM, &TO);
    assert_eq!(next.watch(8), (Cause::ProbeLost, true));
}

#[test]
fn a_motion_that_ends_without_contact_stops_the_program_where_contact_is_necessary() {
    for (index, cause) in [(PROBE_MUST, Cause::ProbeMissed), (0, Cause::None)] {
        let (mut questions, _) = probing(index);
        assert_eq!(questions.end_probe(TO), cause);
        assert_eq!(
            questions.latches.answer.outcome,
            AnswerOutcome::Missed as u32
        );
        assert_eq!(questions.latches.answer.rests, TO);
        assert!(questions.waits_for_planner());
        questions.taken(3);
        assert!(!questions.waits_for_planner());
    }
}

#[test]
fn an_input_is_read_at_once_at_its_edge_at_its_level_or_when_the_wait_is_over() {
    let digital = |level: bool| InputFeedback {
        digital: u64::from(level) << 5,
        ..InputFeedback::default()
    };
    // What is waited for, the levels scan by scan, and what it reads after how many scans.
    for (wait, levels, value, scans) in [
        (InputWait::Immediate, [1, 1, 1, 1], 1.0, 0),
        (InputWait::Immediate, [0, 1, 1, 1], 0.0, 0),
        (InputWait::High, [0, 0, 1, 1], 1.0, 2),
        (InputWait::Low, [1, 0, 1, 1], 0.0, 1),
        (InputWait::Rise, [1, 1, 0, 1], 1.0, 3),
        (InputWait::Fall, [0, 1, 0, 1], 0.0, 2),
        (InputWait::High, [0, 0, 0, 0], -1.0, 4),
    ] {
        let mut questions = Questions::new(1e-3);
        let asked = AskedInput {
            number: 5,
            analog: false,
            wait,
        };
        let event = ProgramEvent {
            number: 1,
            value: 4e-3,
            index: asked.wire(),
            ..ProgramEvent::default()
        };
        let answered = (0..10).find(|waited| {
            let level = levels
                .get(*waited as usize)
                .is_some_and(|level| *level == 1);
            questions.take(digital(level), &FROM, &FROM);
            questions.input_is_answered(&event, 100 + waited, *waited)
        });
        let answer = questions.latches.answer;
        assert_eq!(
            (answered, answer.value),
            (Some(scans), value),
            "{wait:?} {levels:?}"
        );
        assert_eq!(
            answer.outcome == AnswerOutcome::Missed as u32,
            value == -1.0,
            "{wait:?}"
        );
    }
}

#[test]
fn an_analogue_input_is_read_as_it_is() {
    let mut questions = Questions::new(1e-3);
    let mut analog = InputFeedback::default();
    analog.analog[2] = -3.5;
    questions.take(analog, &FROM, &FROM);
    let asked = AskedInput {
        number: 2,
        analog: true,
        wait: InputWait::Immediate,
    };
    let event = ProgramEvent {
        number: 1,
        index: asked.wire(),
        ..ProgramEvent::default()
    };
    assert!(questions.input_is_answered(&event, 1, 0));
    assert_eq!(questions.latches.answer.value, -3.5);
}
