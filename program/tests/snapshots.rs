//! A reading that is cut anywhere and goes on in a fresh one makes the same, to the bit.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::common::{at, everything, mill};
use crate::generate;
use path::geometry::AxisVector;
use program::{Piece, ProgramError, Progress, Reading};

type Outcome = Result<Progress, ProgramError>;

/// Reads to the end, at most so many lines. Between two pieces, `cut` takes the reading's place.
fn read(
    mut reading: Reading,
    lines: usize,
    cut: impl Fn(Reading) -> Reading,
) -> (Piece, Outcome, Reading) {
    let mut whole = Piece::default();
    for _ in 0..3000 {
        let progress = reading.read(lines, &mut whole);
        reading = cut(reading);
        if progress != Ok(Progress::More) {
            return (whole, progress, reading);
        }
    }
    (whole, Ok(Progress::More), reading)
}

/// Compares a reading that is cut every so many lines with one that is not.
fn check(fresh: &Reading, lines: usize, text: &str) {
    let (whole, end, uncut) = read(fresh.clone(), lines, |reading| reading);
    let longest = std::cell::Cell::new(0);
    let (pieces, same, cut) = read(fresh.clone(), lines, |reading| {
        let snapshot = reading.snapshot();
        longest.set(longest.get().max(snapshot.len()));
        let mut next = fresh.clone();
        next.resume(&snapshot).unwrap();
        assert_eq!(next.snapshot(), snapshot);
        next
    });
    // Text tells -0 from 0, and one NaN is as good as another.
    assert_eq!(format!("{pieces:?}"), format!("{whole:?}"), "{text}");
    assert_eq!((same, cut.notes()), (end, uncut.notes()), "{text}");
    assert_eq!(cut.elements_made(), uncut.elements_made());
    assert!(longest.get() < 20_000, "{} bytes", longest.get());
}

#[test]
fn programs_of_the_grammar_are_cut_at_every_line() {
    let setup = everything();
    for seed in 0..400 {
        let kinds = generate::Kinds {
            splines: true,
            spindle_motion: true,
            polar: true,
            mutations: seed % 4 == 3,
        };
        let text = generate::program(seed, kinds);
        let fresh = Reading::of_text("part.ngc", &text, &setup, AxisVector::zeros()).unwrap();
        check(&fresh, 1, &text);
    }
}

#[test]
fn the_programs_that_there_are_are_cut_in_many_places() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folders = ["xy", "xyz-mill", "xzb-pivot"]
        .map(|machine| root.join("../machines").join(machine).join("programs"));
    let others = root.join("../../shared/programs");
    let mut files: Vec<PathBuf> = folders
        .iter()
        .chain([&others])
        .flat_map(|folder| std::fs::read_dir(folder).into_iter().flatten().flatten())
        .map(|entry| entry.path())
        .filter(|path| path.is_file())
        .collect();
    files.sort();
    let setup = everything();
    assert!(files.len() > 10);
    for file in files {
        let lines = std::fs::read(&file)
            .unwrap()
            .split(|byte| *byte == b'\n')
            .count();
        let fresh = Reading::open(&file, &setup, at(&[1.0, 2.0])).unwrap();
        check(&fresh, 1 + lines / 300, &file.display().to_string());
    }
}

#[test]
fn what_a_program_has_at_the_moment_goes_along() {
    let text = "G21 G90 F600\n#<_global>=-0.0\n#5=7\nG92 X3\nT1 M6 G43\nG10 L1 P1 Z11 R4\no<a> sub\n#<local>=5\nM73\nG91 G20\no1 repeat [3]\nG1 X[#1+#<local>]\no1 endrepeat\n(debug, #<_global> #5)\no<a> endsub [4]\no<a> call [2]\nG5.2 X1 Y1 P1 L3\nX2 Y2 P1\nX3 Y1 P1\nX4 Y4 P2\nG5.3\nG64\nG41 D1 G1 X20 Y30\nX40\nM8\nG1 Z2\nY60\nG40 X0\nG0 Z5\nM98 P9 L4\nG81 X1 Y1 Z-1 R1 L2\nX2\nG38.2 Z-4\nM2\nO9\nG1 X1\nM99\n";
    let fresh = Reading::of_text("part.ngc", text, &everything(), AxisVector::zeros()).unwrap();
    let (whole, end, _) = read(fresh.clone(), 10, |reading| reading);
    assert!(matches!(end, Ok(Progress::Ended(_))), "{end:?}");
    assert!(whole.elements.len() > 20 && whole.events.len() > 2 && whole.messages.len() == 1);
    check(&fresh, 1, text);
}

#[test]
fn snapshots_of_something_else_are_refused() {
    let setup = Arc::new(mill(200.0));
    let reading =
        |text: &str, start: AxisVector| Reading::of_text("part.ngc", text, &setup, start).unwrap();
    let mut first = reading("F100\nG1 X1\nG1 X2\nM2", at(&[]));
    let mut piece = Piece::default();
    assert_eq!(first.read(2, &mut piece), Ok(Progress::More));
    let snapshot = first.snapshot();
    let refusal = |mut reading: Reading, bytes: &[u8]| {
        let before = reading.snapshot();
        let error = reading.resume(bytes).unwrap_err().to_string();
        assert_eq!(reading.snapshot(), before);
        error
    };
    let fresh = || reading("F100\nG1 X1\nG1 X2\nM2", at(&[]));
    for other in [
        reading("F100\nG1 X1\nG1 X3\nM2", at(&[])),
        reading("F100\nG1 X1\nG1 X2\nM2", at(&[1.0])),
    ] {
        assert!(refusal(other, &snapshot).contains("of another program"));
    }
    for at in 0..snapshot.len() {
        let mut damaged = snapshot.clone();
        damaged[at] ^= 4;
        assert!(refusal(fresh(), &damaged).contains("damaged"));
        assert!(refusal(fresh(), &snapshot[..at]).contains("damaged"));
    }
}
