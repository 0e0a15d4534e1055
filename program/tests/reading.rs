//! A program read block by block makes what it makes as a whole.

use std::sync::Arc;

use crate::common::{at, mill};
use path::geometry::AxisVector;
use program::{Piece, Program, ProgramError, Progress, Reading, Setup, interpret};

/// Reads to the end, so many lines at a time, the pieces put together.
fn read(reading: &mut Reading, lines: usize) -> (Piece, Result<Progress, ProgramError>) {
    let mut whole = Piece::default();
    loop {
        let mut piece = Piece::default();
        let progress = reading.read(lines, &mut piece);
        whole.elements.append(&mut piece.elements);
        for message in &mut piece.messages {
            message.before_event += whole.events.len() as u64;
        }
        whole.events.append(&mut piece.events);
        whole.messages.append(&mut piece.messages);
        if progress != Ok(Progress::More) {
            return (whole, progress);
        }
    }
}

fn reading_of(text: &str, setup: &Setup) -> Reading {
    Reading::of_text("part.ngc", text, &Arc::new(setup.clone()), at(&[0.5])).unwrap()
}

/// Compares pieces with the whole; where the whole is refused, the pieces end with the first of its mistakes.
fn compare(text: &str, setup: &Setup, lines: usize) {
    let whole = interpret("part.ngc", text, setup, at(&[0.5]));
    let mut reading = reading_of(text, setup);
    let (piece, progress) = read(&mut reading, lines);
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), text).unwrap();
    let mut of_file = Reading::open(file.path(), &Arc::new(setup.clone()), at(&[0.5])).unwrap();
    assert_eq!(of_file.source_hash(), reading.source_hash());
    let (same, end) = read(&mut of_file, lines);
    assert_eq!(same, piece);
    assert_eq!(end.is_ok(), progress.is_ok());
    let mut seen = 0;
    let summary = program::check_file(
        file.path(),
        &Arc::new(setup.clone()),
        at(&[0.5]),
        &mut |piece: &mut Piece| seen += std::mem::take(&mut piece.elements).len(),
    );
    match (&summary, &whole) {
        (Ok(summary), Ok(whole)) => {
            assert_eq!(seen, whole.path.elements.len());
            assert_eq!(summary.elements, seen as u64);
            assert_eq!(summary.bounds, whole.path.bounds());
            assert_eq!((&summary.notes, summary.end), (&whole.notes, whole.end));
            assert_eq!(
                (summary.straight_feeds, summary.arc_feeds),
                (whole.straight_feeds, whole.arc_feeds)
            );
        }
        (summary, whole) => assert_eq!(
            summary.as_ref().err().map(|error| &error.problems),
            whole.as_ref().err().map(|error| &error.problems)
        ),
    }
    match whole {
        Ok(Program {
            path,
            events,
            messages,
            end,
            source_hash,
            notes,
            ..
        }) => {
            assert_eq!(progress, Ok(Progress::Ended(end)), "{text}");
            assert_eq!(piece.elements, path.elements, "{text}");
            assert_eq!(piece.events, events, "{text}");
            assert_eq!(piece.messages, messages, "{text}");
            assert_eq!(reading.notes(), notes);
            assert_eq!(reading.source_hash(), source_hash);
            assert_eq!(reading.elements_made(), path.elements.len() as u64);
        }
        Err(whole) => {
            let error = progress.unwrap_err();
            assert_eq!(error.problems.first(), whole.problems.first(), "{text}");
        }
    }
}

const FLOW: &str = "%\nG21 G90 F600 (a program)\no<hole> sub\nG0 X#1 (MSG, hole)\nG81 R1 Z-1\nM8\no<hole> endsub\n#1=0\no1 while [#1 LT 5]\n#1=[#1+1]\no2 if [#1 EQ 3]\no1 continue\no2 else\no<hole> call [#1]\no2 endif\no1 endwhile\nG91 M98 P7 L3\nG41.1 D2 G90 G1 X20\nY20\nX0 S200\nY0\nG40\nG0 Z5\n%\no7\nG1 X1\nM99\n";

#[test]
fn pieces_of_any_length_make_the_whole() {
    for lines in [1, 2, 3, 7, 1000] {
        compare(FLOW, &mill(200.0), lines);
        for text in ["", "\n\n", "G0 X1", "G0 X1\nM2\nX999999", "%\nG0 X1\n%\n"] {
            compare(text, &mill(200.0), lines);
        }
        compare(
            "F100 G1 X1\nX900\nX2 Q\nY700 Y3\nG1 X1",
            &mill(200.0),
            lines,
        );
    }
}

#[test]
fn the_first_mistake_ends_it_and_what_stands_before_is_kept() {
    let text = "F600 G1 X10\nM8 X20\nM3 S100 X300\nX30\nX400";
    let mut reading = reading_of(text, &mill(200.0));
    let (piece, progress) = read(&mut reading, 10);
    let error = progress.unwrap_err();
    assert!(
        error
            .to_string()
            .contains("part.ngc:3:9: axis X would reach 300"),
        "{error}"
    );
    assert_eq!(
        (
            error.problems.len(),
            piece.elements.len(),
            piece.events.len()
        ),
        (1, 2, 1)
    );
    let mut more = Piece::default();
    assert_eq!(reading.read(10, &mut more), Err(error));
    assert_eq!(more, Piece::default());
}

#[test]
fn a_loop_that_never_ends_is_read_in_pieces() {
    let text = "F600\no1 while [1]\nG1 X1\nG1 X0\no1 endwhile\n";
    let mut reading = reading_of(text, &mill(200.0));
    for _ in 0..100 {
        let mut piece = Piece::default();
        assert_eq!(reading.read(1000, &mut piece), Ok(Progress::More));
        assert!(piece.elements.len() <= 1000);
    }
    assert!(reading.elements_made() > 40_000);
}

#[test]
fn a_piece_of_blocks_that_make_many_elements_is_not_long() {
    let text = "F600 G91\nG0 Z20\no1 while [1]\nG81 X0 Z-1 R-1 L1000\no1 endwhile\n";
    let mut reading = reading_of(text, &mill(200.0));
    let mut piece = Piece::default();
    assert_eq!(reading.read(1_000_000, &mut piece), Ok(Progress::More));
    assert!((10_000..20_000).contains(&piece.elements.len()));
}

#[test]
fn names_and_labels_have_their_bounds() {
    let mut names: String = (0..30_000).map(|name| format!("#<a{name}>=1\n")).collect();
    names += "M2";
    let (_, refused) = read(&mut reading_of(&names, &mill(200.0)), 1000);
    let error = refused.unwrap_err().to_string();
    assert!(
        error.contains("part.ngc:20001:1: more than 20000 names"),
        "{error}"
    );
    let mut labels: String = (0..60_000)
        .map(|label| format!("o{label} if [0]\no{label} endif\no{label} sub\no{label} endsub\n"))
        .collect();
    labels += "M2";
    let (_, refused) = read(&mut reading_of(&labels, &mill(200.0)), 1000);
    let error = refused.unwrap_err().to_string();
    assert!(
        error.contains("more than 100000 lines with O-words"),
        "{error}"
    );
    assert!(interpret("part.ngc", &labels, &mill(200.0), at(&[])).is_ok());
}

#[test]
fn a_hole_too_many_in_one_block_is_refused() {
    let text = "F600 G91\nG0 Z20\nG83 X0 Z-1 R-1 Q0.001 L300\nM2";
    let (piece, refused) = read(&mut reading_of(text, &mill(200.0)), 1000);
    let error = refused.unwrap_err().to_string();
    assert!(error.contains("part.ngc:3:"), "{error}");
    assert_eq!(piece.elements.len(), 1);
}

#[test]
fn the_hash_that_stands_beside_a_file_is_taken_while_it_fits() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("part.ngc");
    let setup = Arc::new(mill(200.0));
    let hash = |expected: bool| {
        let of_file = Reading::open(&file, &setup, at(&[])).unwrap().source_hash();
        let text = std::fs::read_to_string(&file).unwrap();
        let of_text = Reading::of_text("part.ngc", &text, &setup, at(&[]));
        assert_eq!(of_file == of_text.unwrap().source_hash(), expected);
    };
    std::fs::write(&file, "G0 X1\nM2\n").unwrap();
    program::write_text_hash(&file).unwrap();
    hash(true);
    let beside = folder.path().join("part.ngc.hash");
    std::fs::write(&beside, "9 bytes, xxh3 0000000000000001\n").unwrap();
    hash(false);
    for spoilt in ["", "9 bytes, xxh3 zzz", "10 bytes, xxh3 0000000000000001\n"] {
        std::fs::write(&beside, spoilt).unwrap();
        hash(true);
    }
    std::fs::write(&beside, "9 bytes, xxh3 0000000000000001\n").unwrap();
    std::thread::sleep(std::time::Duration::from_millis(20));
    std::fs::write(&file, "G0 X2\nM2\n").unwrap();
    hash(true);
}

#[test]
fn a_machine_without_axes_is_refused() {
    let setup = Arc::new(Setup::default());
    let refused = Reading::of_text("part.ngc", "M2", &setup, AxisVector::zeros());
    assert!(refused.is_err());
}

#[test]
fn the_text_is_looked_through_for_labels_in_the_place_of_blocks() {
    let filler = "G1 X1 F100\nX2\n".repeat(80_000);
    let text = format!("o1 if [0]\n{filler}o1 endif\nG0 X7\nM2\n");
    let mut reading = reading_of(&text, &mill(200.0));
    let mut piece = Piece::default();
    let mut calls = 0;
    while reading.read(10, &mut piece).unwrap() == Progress::More {
        assert!(
            piece.elements.len() < 2,
            "only what stands behind the labels"
        );
        calls += 1;
    }
    // Behind the first 256 kB no call looks through more than 512 bytes and a line for each of its ten blocks.
    let rest = text.len() - (256 << 10);
    assert!(calls > rest / (10 * 600), "{calls} calls");
    assert!(calls < rest / (10 * 400), "{calls} calls");
    let whole = interpret("part.ngc", &text, &mill(200.0), at(&[0.5])).unwrap();
    assert_eq!(piece.elements, whole.path.elements);
}
