//! What seeds of `quadrant-lab bench faults` have found, each in its smallest form.

use std::path::Path;

use crate::common::kill;
use bus::sample::{Cause, Mode, Redundancy};
use lab::cell::{InProcessCell, Script};
use lab::invariants::{Course, Judge, Shown, Violation};
use lab::liveness::Liveness;
use machine::Machine;
use plant_sim::plant_file::PlantFile;
use plant_sim::script::{faults, orders};

const PROGRAM: &str = "G21 G17 G90 G94\nG1 X3 Y0 F3000\nG3 X3 Y4 I0 J2\nG4 P0.05\nG0 X1 Y7\nM2\n";

fn xy() -> (Machine, PlantFile) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/xy");
    let machine = Machine::load(&folder).expect("machine.toml");
    let plant = PlantFile::load(&folder.join("plant.toml")).expect("plant.toml");
    (machine, plant)
}

/// A run of the program with this fault script, judged.
fn judged(faults: &str) -> (Shown, Vec<Violation>) {
    judged_with(faults, "", false)
}

/// The same with orders; `supervised` where the launcher's rules say who is replaced.
fn judged_with(faults: &str, orders: &str, supervised: bool) -> (Shown, Vec<Violation>) {
    let (machine, plant) = xy();
    let course = Course::of(&machine, &plant, "short.ngc", PROGRAM).expect("a course");
    let script = Script {
        faults: Some(faults::parse("faults.toml", faults, &machine).expect("a script")),
        orders: orders::parse("orders.toml", orders, &machine).expect("orders"),
        supervised,
        ..Script::default()
    };
    let mut cell = InProcessCell::with_script(&machine, &plant, ("short.ngc", PROGRAM), script)
        .expect("a cell");
    let mut judge = Judge::new(&machine, &course);
    let mut liveness = Liveness::new(&machine);
    while let Some(published) = cell.scan() {
        let scan = published.feedback.scan;
        judge.take(&published, |_, _| false);
        liveness.take(&published, scan, |_| false);
        if scan > 5000 {
            break;
        }
    }
    let (shown, mut violations) = judge.end();
    violations.extend(liveness.end());
    (shown, violations)
}

/// Killed shortly before the end, a planner leaves a window that comes to rest at the program's end by braking: the next
/// one has to say that the program is over.
#[test]
fn a_planner_killed_in_any_scan_leaves_a_program_that_ends_where_it_should() {
    let undisturbed = judged("").0.scans;
    for scan in 0..undisturbed {
        let (shown, violations) = judged(&kill("planner", scan, 12));
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

/// A planner's status that names a cause which is none of a planner's is taken for nonsense: the machine stopped, and said that a
/// following error or a bad value was why.
#[test]
fn a_status_with_a_cause_that_no_planner_has_stops_nothing() {
    for what in ["bit-0", "all-bits", "most", "one-more"] {
        let (shown, violations) = judged(&format!(
            "[[fault]]\nat = {{ scan = 64 }}\nprocess = \"planner\"\ndo = \"corrupt\"\nscans = 9\nfield = \"status.cause\"\nwhat = \"{what}\"\n"
        ));
        assert_eq!(violations, [], "{what}");
        assert_eq!(shown.mode, Some(Mode::Finished), "{what}");
    }
}

/// The launcher orders a stop for a planner that is lost for good; an operator who resumes takes it back, and the run hung.
#[test]
fn a_resume_does_not_take_back_the_stop_for_a_planner_that_is_lost_for_good() {
    let faults = "[restart]\nplanner = \"end\"\n[[fault]]\nat = { scan = 100 }\nprocess = \"planner\"\ndo = \"kill\"\n";
    for scan in [101, 130, 200] {
        let orders = format!("[[order]]\nscan = {scan}\norder = \"resume\"\n");
        let (shown, violations) = judged_with(faults, &orders, false);
        assert_eq!(violations, [], "resumed in scan {scan}");
        assert_eq!(shown.mode, Some(Mode::Stopped), "resumed in scan {scan}");
    }
}

/// A servo that dies too often is given up: the run waited for it for ever.
#[test]
fn a_servo_that_is_given_up_ends_the_run() {
    for servo in ["wait", "resume"] {
        let faults = format!(
            "[restart]\nservo = \"{servo}\"\nrestarts_max = 2\n[[fault]]\nat = {{ scan = 100 }}\nprocess = \"servo-X\"\ndo = \"kill\"\nrepeat = {{ times = 5, every_scans = 60 }}\n"
        );
        let (shown, violations) = judged_with(&faults, "", true);
        assert_eq!(violations, [], "{servo}");
        assert_eq!(shown.mode, Some(Mode::Tripped), "{servo}");
        assert!(shown.scans < 1000, "{servo}: {} scans", shown.scans);
    }
}

/// A standby that was born between two planners held the last window of the old one and refused all of the new one.
#[test]
fn a_standby_that_is_replaced_while_the_planner_is_comes_into_step() {
    let (mut machine, plant) = xy();
    for axis in &mut machine.axes {
        axis.standby = true;
    }
    for after in 1..60 {
        let text = format!(
            "[restart]\nplanner = \"resume\"\n\
             [[fault]]\nat = {{ scan = 60 }}\nprocess = \"planner\"\ndo = \"kill\"\nrestart_after_scans = 16\n\
             [[fault]]\nat = {{ scan = 60 }}\nprocess = \"servo-X/a\"\ndo = \"kill\"\nrestart_after_scans = {after}\n"
        );
        let script = Script {
            faults: Some(faults::parse("faults.toml", &text, &machine).expect("a script")),
            ..Script::default()
        };
        let mut cell = InProcessCell::with_script(&machine, &plant, ("short.ngc", PROGRAM), script)
            .expect("a cell");
        let mut state = 0;
        while let Some(published) = cell.scan() {
            let feedback = published.feedback;
            if feedback.scan == 200 {
                state = feedback.axes()[0].redundancy;
                break;
            }
        }
        assert_eq!(
            Redundancy::from_wire(state),
            Some(Redundancy::Synchronised),
            "replaced after {after} scans"
        );
    }
}

/// How a run ends whose servos have standbys or not: mode, cause and motion digest.
fn ends(standby: bool, fault: &str) -> (Option<Mode>, Option<Cause>, [u64; 2]) {
    let (mut machine, plant) = xy();
    for axis in &mut machine.axes {
        axis.standby = standby;
    }
    let script = Script {
        faults: Some(faults::parse("faults.toml", fault, &machine).expect("a script")),
        ..Script::default()
    };
    let mut cell = InProcessCell::with_script(&machine, &plant, ("short.ngc", PROGRAM), script)
        .expect("a cell");
    let mut last = None;
    while let Some(published) = cell.scan() {
        let instruments = published.instruments;
        let digest = [
            instruments.motion_digest_high,
            instruments.motion_digest_low,
        ];
        last = Some((*published.feedback, digest));
        if published.feedback.scan > 2000 {
            break;
        }
    }
    let (last, digest) = last.expect("a scan");
    let (mode, cause) = (Mode::from_wire(last.mode), Cause::from_wire(last.cause));
    (mode, cause, digest)
}

/// A number of the commands of servo X, wrong in one way from scan 150 on.
fn wrong(field: &str, what: &str, scans: u32) -> String {
    format!(
        "[[fault]]\nat = {{ scan = 150 }}\nprocess = \"servo-X/a\"\ndo = \"corrupt\"\nscans = {scans}\n\
         field = \"{field}\"\nwhat = \"{what}\"\n"
    )
}

/// Two servos cannot tell which of them computes wrong: the master holds both against the window in force.
#[test]
fn a_servo_that_commands_another_position_than_the_window_has_is_not_followed() {
    let (mode, _, undisturbed) = ends(true, "");
    assert_eq!(mode, Some(Mode::Finished));
    let fault = wrong("command.position", "one-more", 1);
    let (mode, cause, digest) = ends(true, &fault);
    assert_eq!((mode, cause), (Some(Mode::Finished), Some(Cause::None)));
    assert_eq!(digest, undisturbed, "the standby goes on to the bit");
    let (mode, cause, _) = ends(false, &fault);
    assert_eq!((mode, cause), (Some(Mode::Tripped), Some(Cause::BadValue)));
}

/// Some of its commands come too late, the others say earlier than is true when they may be read.
#[test]
fn a_standby_takes_over_from_a_servo_whose_commands_say_another_scan_to_be_read_in() {
    let fault = wrong("command.visible_from", "bit-2", 40);
    assert_eq!(ends(true, &fault), ends(true, ""));
}

#[test]
fn a_servo_cannot_say_that_it_is_lost() {
    let (mode, cause, _) = ends(false, &wrong("command.cause", "bit-3", 1));
    assert_eq!((mode, cause), (Some(Mode::Tripped), Some(Cause::BadValue)));
}
