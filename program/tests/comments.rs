//! Comments that ask for something: each does what it says, or is refused.

use std::sync::Arc;

use crate::common::{at, everything, mill, on_mill, refusal};
use path::geometry::AxisVector;
use program::{Message, Piece, Program, ProgramEnd, Progress, Reading, Setup, interpret};

fn program(text: &str) -> Program {
    on_mill(text).unwrap_or_else(|error| panic!("{error}"))
}

fn texts(messages: &[Message]) -> Vec<&str> {
    messages.iter().map(|said| said.text.as_str()).collect()
}

#[test]
fn abort_ends_the_program_before_its_block_and_says_its_text_with_values() {
    let text = "G0 X1\n#1=2.5 G0 X7 (ABORT, tool #1 too short)\nG0 X9\nM2";
    let program = program(text);
    assert_eq!(program.end, ProgramEnd::Abort(2));
    assert_eq!(program.path.end(), Some(at(&[1.0])));
    assert_eq!(texts(&program.messages), ["tool 2.500000 too short"]);
    assert_eq!(program.messages[0].before_element, 1);
    assert_eq!(program.blocks.last().map(|block| block.line), Some(2));
    assert!(
        program.notes.iter().any(|note| note.line == 2),
        "{:?}",
        program.notes
    );
}

#[test]
fn a_program_of_an_abort_alone_and_one_in_a_branch_that_is_not_taken() {
    assert_eq!(program("(ABORT,x)").end, ProgramEnd::Abort(1));
    let text = "#1=1\no1 if [#1 EQ 2]\n(ABORT,x)\no1 endif\nG0 X1\nM2";
    assert_eq!(program(text).end, ProgramEnd::M2(6));
    let text = "o1 sub\nG0 X1\n(ABORT,#1)\nG0 X2\no1 endsub\no1 call [3]\nM2";
    let given_up = program(text);
    assert_eq!(given_up.end, ProgramEnd::Abort(3));
    assert_eq!(texts(&given_up.messages), ["3.000000"]);
}

/// As rs274 of LinuxCNC 2.9 reads them; (PROBEOPEN …) in any case, and a comment that is nearly an ABORT gets a note.
#[test]
fn a_comment_word_is_read_in_any_case_behind_blanks_and_with_its_comma_at_once() {
    for (comment, aborts, says) in [
        ("(ABORT,a)", true, Some("a")),
        ("(abort,a)", true, Some("a")),
        ("( \tAbOrT, a b )", true, Some("a b")),
        ("(ABORT,)", true, Some("")),
        ("(ABORT ,a)", false, None),
        ("(ABORT)", false, None),
        ("(ABORTED, a)", false, None),
        ("(to abort, press stop)", false, None),
        ("(MSG,a)", false, Some("a")),
        ("( msg, a)", false, Some("a")),
        ("(MSG ,a)", false, None),
        ("(message, a)", false, None),
        ("(debug,a)", false, Some("a")),
        ("(PRINT,a)", false, Some("a")),
        ("(log,a)", false, Some("a")),
        ("; (ABORT,a)", false, None),
    ] {
        let program = program(&format!("G0 X1\n{comment}\nG0 X2\nM2"));
        let ended = matches!(program.end, ProgramEnd::Abort(_));
        assert_eq!(ended, aborts, "{comment}");
        assert_eq!(texts(&program.messages).first().copied(), says, "{comment}");
    }
    let notes = |text: &str| {
        let notes = program(text).notes;
        let notes = notes
            .into_iter()
            .filter(|note| note.text.contains("(ABORT, …)"));
        notes.count()
    };
    assert_eq!(notes("G0 X1\n(ABORT , a)\nM2"), 1);
    assert_eq!(notes("G0 X1\n(to abort, press stop)\nM2"), 0);
}

#[test]
fn a_comment_beside_an_o_word_says_nothing_and_a_note_tells_so() {
    let text = "o1 if [0] (ABORT,a)\nG0 X1 (MSG,b)\no1 endif (MSG,c)\nG0 X2 (MSG,d)\nM2 (MSG,e)";
    let program = program(text);
    assert_eq!(program.end, ProgramEnd::M2(5));
    assert_eq!(texts(&program.messages), ["d", "e"]);
    assert!(
        program
            .notes
            .iter()
            .any(|note| (note.line, note.count) == (1, 2))
    );
}

#[test]
fn values_that_a_block_sets_count_in_its_comments() {
    let text = "#1=5 (DEBUG,#1)\n#1=6 #<a>=#1\n#1=#<a> (PRINT,#1 #<a>)\n#5599=0\n(DEBUG,no)\n(PRINT,yes)\n#5599=1 (DEBUG,again)\nM2";
    assert_eq!(
        texts(&program(text).messages),
        ["5.000000", "5.000000 5.000000", "yes", "again"]
    );
}

#[test]
fn between_probeopen_and_probeclose_what_a_probe_finds_is_in_the_log() {
    let text = "G20 F9\nG38.2 X1\n(PROBEOPEN grid.txt)\nG38.3 Y2.5\n(probeclose)\nG38.2 Z1\nM2";
    let setup = Arc::unwrap_or_clone(everything());
    let program = interpret("part", text, &setup, AxisVector::zeros()).unwrap();
    let found: Vec<_> = program
        .messages
        .iter()
        .map(|said| (said.line, said.log_only, said.text.as_str()))
        .collect();
    let nine = "1.000000 2.500000 0.000000 0.000000 0.000000 0.000000 0.000000 0.000000 0.000000";
    assert_eq!(found, [(4, true, nine)]);
}

#[test]
fn python_in_a_comment_is_refused_by_name() {
    for comment in ["(py,x=1)", "(PYRUN,x)", "( pyreload)", ";py,x"] {
        let error = refusal(&format!("G0 X1\n{comment}\nM2"));
        assert!(
            error.contains("Python") && error.contains("M100"),
            "{error}"
        );
    }
    assert_eq!(program("G0 X1 (pyramid, left)\nM2").messages, []);
}

/// What is behind a snapshot is what is behind the blocks that were read.
#[test]
fn a_program_that_is_read_bit_by_bit_ends_at_the_abort_and_so_does_one_from_a_snapshot() {
    let setup: Arc<Setup> = Arc::new(mill(200.0));
    let start = AxisVector::zeros();
    let text = "G0 X1\nG0 X2\n(MSG,a)\nG0 X3\n(ABORT,b #5420)\nG0 X4\nM2\n";
    let open = || Reading::of_text("part", text, &setup, start).unwrap();
    let mut reading = open();
    let mut read = Vec::new();
    loop {
        let mut piece = Piece::default();
        let mut other = open();
        other.resume(&reading.snapshot()).unwrap();
        let progress = reading.read(1, &mut piece).unwrap();
        let mut same = Piece::default();
        assert_eq!(other.read(1, &mut same).unwrap(), progress);
        assert_eq!(same, piece);
        read.extend(piece.messages);
        if let Progress::Ended(end) = progress {
            assert_eq!(end, ProgramEnd::Abort(5));
            break;
        }
    }
    assert_eq!(texts(&read), ["a", "b 3.000000"]);
    assert_eq!(reading.elements_made(), 3);
}
