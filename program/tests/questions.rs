//! What a program asks the machine while it runs: it is read up to there, and on with the answer.

use std::sync::Arc;

use crate::common::{at, mill};
use bus::sample::{AskedInput, InputWait};
use path::geometry::{AxisVector, Element};
use program::{Answer, EventKind, Piece, Progress, Question, Reading, Setup, interpret};

fn setup(answers: &[Answer]) -> Arc<Setup> {
    Arc::new(Setup {
        probe: true,
        answers: answers.to_vec(),
        ..mill(200.0)
    })
}

fn reading(text: &str, answers: &[Answer]) -> Reading {
    Reading::of_text("part", text, &setup(answers), at(&[])).expect("a machine")
}

fn ends(elements: &[Element]) -> Vec<AxisVector> {
    elements.iter().map(Element::end).collect()
}

const PROBING: &str = "G0 X10\nF100 G38.2 Z-20\nG0 X#5061 Z[#5063+5] Y#5070\nM2\n";

fn tripped() -> Answer {
    Answer::Tripped {
        at: at(&[10.0, 0.0, -7.25]),
        rests: at(&[10.0, 0.0, -7.5]),
    }
}

#[test]
fn a_program_is_read_up_to_a_probe_and_goes_on_from_where_the_axes_rest() {
    let mut reading = reading(PROBING, &[]);
    let mut piece = Piece::default();
    assert_eq!(reading.read(100, &mut piece).unwrap(), Progress::Asks);
    assert_eq!(ends(&piece.elements), [at(&[10.0])]);
    let places: Vec<_> = piece
        .events
        .iter()
        .map(|e| (e.before_element, e.kind))
        .collect();
    let probe = EventKind::Probe {
        away: false,
        must: true,
    };
    assert_eq!(places, [(1, probe), (2, EventKind::ProbeEnd)]);
    let Some(Question::Probe { line, element, .. }) = reading.question() else {
        panic!("{:?}", reading.question())
    };
    assert_eq!((*line, element.end()), (2, at(&[10.0, 0.0, -20.0])));
    // It asks as often as it is read, and a copy asks the same.
    let mut copy = reading.clone();
    let mut nothing = Piece::default();
    assert_eq!(copy.read(100, &mut nothing).unwrap(), Progress::Asks);
    assert_eq!(nothing, Piece::default());
    for reading in [&mut reading, &mut copy] {
        let mut piece = Piece::default();
        reading.answer(tripped()).unwrap();
        assert!(matches!(
            reading.read(100, &mut piece),
            Ok(Progress::Ended(_))
        ));
        assert_eq!(
            ends(&piece.elements),
            [at(&[10.0, 0.0, -7.5]), at(&[10.0, 1.0, -2.25])]
        );
        assert_eq!(piece.elements[0].point(0.0), at(&[10.0]));
        assert_eq!(piece.events, []);
    }
}

#[test]
fn whoever_knows_the_answers_reads_the_same_without_asking() {
    let mut whole = Piece::default();
    let known = reading(PROBING, &[tripped()]).read(100, &mut whole);
    assert!(matches!(known, Ok(Progress::Ended(_))));
    let mut asking = reading(PROBING, &[]);
    let mut parts = Piece::default();
    asking.read(100, &mut parts).unwrap();
    asking.answer(tripped()).unwrap();
    asking.read(100, &mut parts).unwrap();
    assert_eq!(whole, parts);
    assert_eq!(
        asking.source_hash(),
        reading(PROBING, &[tripped()]).source_hash()
    );
    let program = interpret("part", PROBING, &setup(&[tripped()]), at(&[])).unwrap();
    assert_eq!(program.path.elements, whole.elements);
    assert_eq!(program.events, whole.events);
}

#[test]
fn without_contact_g38_3_goes_on_and_g38_2_does_not() {
    let missed = Answer::Missed {
        rests: at(&[0.0, 0.0, -20.0]),
    };
    let mut soft = reading("F100 G38.3 Z-20\nG0 Y#5070 X#5063\nM2\n", &[]);
    let mut piece = Piece::default();
    assert_eq!(soft.read(100, &mut piece).unwrap(), Progress::Asks);
    soft.answer(missed).unwrap();
    soft.read(100, &mut piece).unwrap();
    let [_, behind] = ends(&piece.elements)[..] else {
        panic!("{piece:?}")
    };
    assert_eq!(behind, at(&[-20.0, 0.0, -20.0]));
    for (code, words) in [("G38.2", "made no contact"), ("G38.4", "kept its contact")] {
        let mut hard = reading(&format!("F100\n{code} Z-20\nM2\n"), &[]);
        hard.read(100, &mut Piece::default()).unwrap();
        let error = hard.answer(missed).unwrap_err().to_string();
        assert!(error.contains("part:2") && error.contains(words), "{error}");
        assert!(hard.read(100, &mut Piece::default()).is_err());
    }
}

#[test]
fn the_tripped_place_is_told_in_the_coordinates_and_the_unit_of_the_program() {
    let text = "G10 L2 P2 X4 Z-5\nG55 G20\nF4 G38.2 Z-0.5\nG0 G53 X#5063 Y[#5061*25.4]\nM2\n";
    let mut reading = reading(text, &[]);
    let mut piece = Piece::default();
    assert_eq!(reading.read(100, &mut piece).unwrap(), Progress::Asks);
    reading
        .answer(Answer::Tripped {
            at: at(&[0.0, 0.0, -10.08]),
            rests: at(&[0.0, 0.0, -10.1]),
        })
        .unwrap();
    reading.read(100, &mut piece).unwrap();
    let last = ends(&piece.elements)[1];
    // Z: -5.08 mm from the zero of G55 are -0.2 inch, which X takes as inches of the machine.
    assert!((last - at(&[-5.08, -101.6, -10.1])).norm() < 1e-9, "{last}");
}

#[test]
fn an_input_is_asked_for_and_told() {
    let mut piece = Piece::default();
    let mut reading = reading(
        "M66 P3 L3 Q2.5\nG0 X#5399\nM66 E1\nG0 X[#5399*2]\nM2\n",
        &[],
    );
    assert_eq!(reading.read(100, &mut piece).unwrap(), Progress::Asks);
    let asked = AskedInput {
        number: 3,
        analog: false,
        wait: InputWait::High,
    };
    assert_eq!(
        reading.question(),
        Some(&Question::Input { line: 1, asked })
    );
    let kind = EventKind::AwaitInput {
        asked,
        timeout_s: 2.5,
    };
    assert_eq!(piece.events[0].kind, kind);
    reading.answer(Answer::Input(-1.0)).unwrap();
    assert_eq!(reading.read(100, &mut piece).unwrap(), Progress::Asks);
    reading.answer(Answer::Input(3.5)).unwrap();
    reading.read(100, &mut piece).unwrap();
    assert_eq!(ends(&piece.elements), [at(&[-1.0]), at(&[7.0])]);
}

#[test]
fn what_no_machine_can_answer_is_refused_with_what_would_be_right() {
    for (text, words) in [
        ("M66", "one input"),
        ("M66 P1 E1", "one input"),
        ("M66 P64", "from 0 to 63"),
        ("M66 E8", "from 0 to 7"),
        ("M66 P1 L5 Q1", "from 0 to 4"),
        ("M66 P1 L3", "longest wait"),
        ("M66 E1 L3 Q1", "read at once"),
        ("G38.2 Z-5", "feed"),
        ("F100 G38.2", "G38.2 without an axis word"),
        ("G93 G38.2 Z-5 F10", "G94"),
        ("G41.1 D2\nF100 G38.2 Z-5", "G38.2"),
    ] {
        let text = format!("{text}\nM2\n");
        let mut reading = reading(&text, &[]);
        let error = reading.read(100, &mut Piece::default()).unwrap_err();
        assert!(error.to_string().contains(words), "{text}: {error}");
    }
    let mut wrong = reading(PROBING, &[]);
    wrong.read(100, &mut Piece::default()).unwrap();
    let error = wrong.answer(Answer::Input(1.0)).unwrap_err().to_string();
    assert!(error.contains("another question"), "{error}");
}

#[test]
fn a_check_assumes_the_answers_and_says_so() {
    let setup = Setup {
        rehearsed: true,
        ..(*setup(&[])).clone()
    };
    let program = interpret("part", PROBING, &setup, at(&[])).unwrap();
    assert_eq!(program.path.elements[2].end(), at(&[10.0, 1.0, -15.0]));
    let notes: Vec<String> = program.notes.iter().map(|note| note.shown()).collect();
    assert!(
        notes
            .iter()
            .any(|note| note.contains("as if a probe tripped")),
        "{notes:?}"
    );
    let error = interpret("part", PROBING, &self::setup(&[]), at(&[])).unwrap_err();
    assert!(
        error.to_string().contains("only a run has an answer"),
        "{error}"
    );
}

#[test]
fn a_check_of_a_program_that_waits_for_its_machine_ends() {
    let setup = Setup {
        rehearsed: true,
        ..(*setup(&[])).clone()
    };
    let text = "o1 while [1]\nM66 P0 L0\no1 endwhile\nG0 X1\nM2\n";
    let program = interpret("part", text, &setup, at(&[])).unwrap();
    let notes: Vec<String> = program.notes.iter().map(|note| note.shown()).collect();
    assert!(
        notes
            .iter()
            .any(|note| note.contains("asks again and again")),
        "{notes:?}"
    );
}
