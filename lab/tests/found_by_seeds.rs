//! What seeds of `quadrant bench faults` have found, each in its smallest form.

use std::path::Path;

use bus::sample::Mode;
use lab::cell::{InProcessCell, Script};
use lab::invariants::{Course, Judge, Shown, Violation};
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::faults;

const PROGRAM: &str = "G21 G17 G90 G94\nG1 X3 Y0 F3000\nG3 X3 Y4 I0 J2\nG4 P0.05\nG0 X1 Y7\nM2\n";

/// A run of the program with this fault script, judged.
fn judged(faults: &str) -> (Shown, Vec<Violation>) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
    let machine = Machine::load(&folder).expect("machine.toml");
    let plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    let course = Course::of(&machine, &plant, "short.ngc", PROGRAM).expect("a course");
    let script = Script {
        faults: Some(faults::parse("faults.toml", faults, &machine).expect("a script")),
        orders: Vec::new(),
        ..Script::default()
    };
    let mut cell = InProcessCell::with_script(&machine, &plant, ("short.ngc", PROGRAM), script)
        .expect("a cell");
    let mut judge = Judge::new(&machine, &course);
    while let Some(published) = cell.scan() {
        let scan = published.feedback.scan;
        judge.take(&published, |_, _| false);
        if scan > 5000 {
            break;
        }
    }
    judge.end()
}

/// Killed shortly before the end, a planner leaves a window that comes to rest at the program's end by braking: the next
/// one has to say that the program is over.
#[test]
fn a_planner_killed_in_any_scan_leaves_a_program_that_ends_where_it_should() {
    let undisturbed = judged("").0.scans;
    for scan in 0..undisturbed {
        let (shown, violations) = judged(&format!(
            "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"planner\"\ndo = \"kill\"\nrestart_after_scans = 12\n"
        ));
        assert_eq!(violations, [], "killed in scan {scan}");
        assert_eq!(shown.mode, Some(Mode::Finished), "killed in scan {scan}");
    }
}

/// A setpoint whose place on the path is not a number is refused: a planner would go on from there.
#[test]
fn a_window_whose_tags_are_no_numbers_never_comes_into_force() {
    for what in ["not-a-number", "infinity"] {
        for scan in [8, 64, 128, 200] {
            let (shown, violations) = judged(&format!(
                "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"planner\"\ndo = \"corrupt\"\nscans = 10\nwhat = \"{what}\"\n"
            ));
            assert_eq!(violations, [], "{what} in scan {scan}");
            assert_eq!(shown.mode, Some(Mode::Finished), "{what} in scan {scan}");
        }
    }
}
