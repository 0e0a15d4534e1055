//! The parameters that outlive a run: what a program begins with, and what it leaves.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;

use machine::{KeptParameters, Machine, parse_parameters};
use path::geometry::AxisVector;
use program::{Progress, Reading, Setup};

/// A counter, work offsets with a rotation, G92, G28.1 and G30.1; one parameter that nobody keeps.
const PROGRAM: &str = "G21 G90 G94 F600\n#100=[#100+1]\n#101=[#5241*2]\n#102=9\nG10 L2 P2 X1.25 Y-3 R15\nG55\nG0 X4 Y5\n\
    G92 X10\nG28.1\nG0 X7\nG30.1\nG10 L20 P3 Y2\nM2\n";

fn setup(parameters: KeptParameters) -> Arc<Setup> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xyz-mill");
    let mut machine = Machine::load(&folder).expect("the mill");
    machine.program.work_offset_mm.clear();
    for axis in &mut machine.axes {
        (axis.travel_min_mm, axis.travel_max_mm) = (-1000.0, 1000.0);
    }
    machine.parameters = parameters;
    Arc::new(Setup::of(&machine))
}

/// What a program leaves that begins with these.
fn left_by(text: &str, parameters: KeptParameters) -> KeptParameters {
    let start = AxisVector::zeros();
    let reading = Reading::of_text("any.ngc", text, &setup(parameters), start);
    let mut reading = reading.expect("a machine");
    let mut piece = Default::default();
    while reading.read(100, &mut piece).expect("a program") == Progress::More {}
    reading.kept_parameters()
}

fn parameters(values: &[(u32, f64)]) -> KeptParameters {
    values.iter().copied().collect()
}

#[test]
fn a_program_begins_with_what_was_kept_and_leaves_what_is_named_and_what_always_is() {
    let left = left_by(PROGRAM, parameters(&[(100, 4.0), (5241, 3.0)]));
    assert_eq!(left[&100], 5.0);
    assert!(!left.contains_key(&101) && !left.contains_key(&102));
    assert_eq!((left[&5241], left[&5242], left[&5250]), (1.25, -3.0, 15.0));
    assert_eq!(left[&5220], 1.0, "M2 leaves G54 in force");
    let again = left_by(PROGRAM, left.clone());
    assert_eq!(again[&100], 6.0);
    assert_eq!(left_by("%\nG55\n%\n", KeptParameters::new())[&5220], 2.0);
}

#[test]
fn offsets_that_were_kept_move_the_program() {
    let end = |values: &[(u32, f64)], text: &str| {
        let start = AxisVector::zeros();
        let program = program::interpret("any.ngc", text, &setup(parameters(values)), start);
        program.expect("a program").path.end().expect("a way")
    };
    let text = "G21 G90\nG0 X10 Y0\nM2\n";
    assert_eq!(end(&[], text)[0], 10.0);
    assert_eq!(end(&[(5221, 2.5)], text)[0], 12.5);
    assert_eq!(end(&[(5220, 2.0), (5241, -4.0)], text)[0], 6.0);
    assert_eq!(end(&[(5210, 1.0), (5211, 1.5)], text)[0], 11.5);
    assert_eq!(end(&[(5211, 1.5)], text)[0], 10.0, "G92 does not apply");
    let turned = end(&[(5230, 90.0)], text);
    assert!(turned[0].abs() < 1e-9 && (turned[1] - 10.0).abs() < 1e-9);
}

/// Both begin with the same file, and each leaves one: the same, as far as theirs is written to six decimals. Their standalone
/// interpreter is a machine in inches.
#[test]
fn the_file_that_a_program_leaves_is_the_one_that_linuxcnc_leaves() {
    let folder = tempfile::tempdir().expect("a folder");
    let (file, program) = (folder.path().join("a.var"), folder.path().join("a.ngc"));
    fs::write(&program, PROGRAM).expect("written");
    let before = "100\t4\n101\t1\n5161\t0.5\n";
    fs::write(&file, before).expect("written");
    for _ in 0..2 {
        let mut command = Command::new("rs274");
        command.env("HOME", folder.path()).arg("-g").arg("-v");
        command.args([&file, &program]).stdin(Stdio::null());
        let Ok(run) = command.output() else {
            eprintln!("skipped: rs274 is missing: apt install linuxcnc-uspace (Debian)");
            return;
        };
        let printed = String::from_utf8_lossy(&run.stdout).into_owned();
        assert!(printed.contains("PROGRAM_END"), "{printed}");
    }
    let text = fs::read_to_string(&file).expect("their file");
    let theirs = parse_parameters("theirs", &text).expect("their file is one of ours");
    let mut ours = parse_parameters("ours", before).expect("a file");
    // Lengths are kept in the unit of the machine.
    ours.insert(5161, 0.5 * 25.4);
    for _ in 0..2 {
        // They count #101 from inches too.
        ours = left_by(PROGRAM, ours);
    }
    assert!(theirs.keys().eq(ours.keys()), "{theirs:?}\n{ours:?}");
    for (number, value) in &theirs {
        let is_length = match number {
            5161..=5169 | 5181..=5189 | 5211..=5219 => true,
            5221..=5390 => (number - 5221) % 20 < 9,
            101 => true,
            _ => false,
        };
        let value = if is_length { value * 25.4 } else { *value };
        let off = (value - ours[number]).abs();
        assert!(
            off < 3e-5,
            "#{number}: theirs {value}, ours {}",
            ours[number]
        );
    }
}
