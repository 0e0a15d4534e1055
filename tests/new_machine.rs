//! A machine that somebody describes in a few numbers: it checks, runs and can be tuned as it is written.

use std::fs;
use std::path::Path;
use std::process::Output;

use bus::sample::{Feedback, MAX_AXES, Reference};
use monitor::log::{Reader, Sample};
use tempfile::TempDir;

use crate::support::{Run, number, quadrant, run, run_with, text};

/// A gantry mill with a rotary axis.
const GANTRY: [&str; 4] = [
    "X:travel=0..1200,rack=2x20,ratio=10,mass=150",
    "Y:travel=0..800,belt=5x24,ratio=5,mass=60",
    "Z:travel=-200..0,lead=10,mass=25",
    "A:travel=-3600..3600,gear=60,inertia=0.2",
];

fn new_machine(folder: &Path, axes: &[&str]) -> Output {
    let mut command = quadrant();
    command.args(["new", "machine"]).arg(folder);
    for axis in axes {
        command.args(["--axis", axis]);
    }
    command.output().expect("quadrant")
}

fn refused(axes: &[&str]) -> String {
    let home = TempDir::new().expect("a folder");
    let folder = home.path().join("mine");
    let output = new_machine(&folder, axes);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    let left: Vec<_> = fs::read_dir(home.path()).expect("a folder").collect();
    assert!(left.is_empty(), "{left:?}");
    said
}

#[test]
fn a_gantry_of_rack_belt_screw_and_gear_checks_and_runs_as_written() {
    let home = TempDir::new().expect("a folder");
    let folder = home.path().join("my-gantry");
    let output = new_machine(&folder, &GANTRY);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
    assert!(said.contains("quadrant run"), "{said}");
    let of_machine = fs::read_to_string(folder.join("machine.toml")).expect("a file");
    for line in [
        "rack_module_mm = 2.0",
        "pulley_teeth = 24",
        "kind = \"rotary\"",
        "rapid_deg_s = ",
    ] {
        assert!(of_machine.contains(line), "{line}: {of_machine}");
    }
    assert!(of_machine.contains("# estimated"), "{of_machine}");
    let run = run(&folder, folder.join("programs/first.ngc"));
    let report = run.good_report();
    assert_eq!(text(&report, "/machine"), "my-gantry");
    // Untuned, on screw and rack: the axes follow.
    let peak_um = number(&report, "/contour_error_um/peak");
    assert!(peak_um > 0.0 && peak_um < 500.0, "{peak_um}");
    for axis in report["axes"].as_array().expect("axes") {
        let share = axis["torque_peak_nm"].as_f64().expect("a torque");
        assert!(share > 0.0, "{axis}");
    }
}

#[test]
fn a_machine_with_incremental_encoders_says_that_it_must_be_homed_and_runs_once_it_is() {
    let home = TempDir::new().expect("a folder");
    let folder = home.path().join("mine");
    let axes = [
        "X:travel=-200..200,lead=10,encoder=incremental",
        "Z:travel=-100..0,rack=2x20,ratio=10,encoder=incremental,start=-60",
        "A:travel=-90..90,gear=90,encoder=incremental",
        "Y:travel=-150..150",
    ];
    let output = new_machine(&folder, &axes);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
    for part in ["encoders of X Z A are incremental", "quadrant home --wait"] {
        assert!(said.contains(part), "{said}");
    }
    let program = folder.join("programs/first.ngc");
    let orders =
        "[[order]]\nscan = 300\norder = \"home\"\n[[order]]\nscan = 60000\norder = \"resume\"\n";
    let file = folder.join("orders.toml");
    fs::write(&file, orders).expect("written");
    let file = file.display().to_string();
    let ended = run_with(&folder, &program, &["--orders", &file]);
    let report = ended.good_report();
    assert_goes_up_first(&ended);
    // The zero of each axis is the true one: the table is where the program says.
    let peak_um = number(&report, "/contour_error_um/peak");
    assert!(peak_um > 0.0 && peak_um < 500.0, "{peak_um}");
}

/// Z, the second axis, is homed before the others move, and its first millimetre is upwards.
fn assert_goes_up_first(run: &Run) {
    let samples = Reader::open(&run.out.join("run.mcap")).expect("the log");
    let feedbacks = samples.filter_map(|sample| match sample {
        Ok(Sample::Feedback(feedback)) => Some(*feedback),
        _ => None,
    });
    let places = |of: &Feedback| of.axes.map(|axis| axis.motor_position);
    let (mut from, mut first) = ([0; MAX_AXES], None);
    for feedback in feedbacks {
        let [x, z, a, ..] = feedback.axes;
        if z.reference == Reference::Known as u32 {
            assert!(first.is_some_and(|way| way > 0), "{first:?}");
            assert_ne!((x.reference, a.reference), (0, 0));
            return;
        }
        if feedback.scan == 300 {
            from = places(&feedback);
        } else if feedback.scan > 300 {
            let now = places(&feedback);
            let ways: [i64; MAX_AXES] = std::array::from_fn(|axis| now[axis] - from[axis]);
            first = first.or(Some(ways[1]).filter(|way| way.abs() > 1_000_000));
            let others = [ways[0], ways[2], ways[3]];
            assert!(others.iter().all(|way| way.abs() < 20_000), "{ways:?}");
        }
    }
    panic!("Z was never homed");
}

#[test]
fn a_folder_that_is_there_and_numbers_that_fit_no_machine_are_refused_and_nothing_is_written() {
    for (axes, why) in [
        (&[][..], "which axes has it?"),
        (&["X"], "travel=LOW..HIGH is missing"),
        (&["Q:travel=0..1"], "\"Q\" is no axis"),
        (&["X:travel=5..1"], "must be LOW..HIGH"),
        (&["X:travel=0..100,led=10"], "\"led\" is no key"),
        (&["X:travel=0..100,lead=-1"], "lead=-1: must be above 0"),
        (
            &["X:travel=0..100,lead=10,rack=2x20"],
            "one of lead, rack and belt",
        ),
        (&["X:travel=0..100,rack=2"], "SIZExTEETH"),
        (&["A:travel=0..100,lead=10"], "a rotary axis has gear=TURNS"),
        (&["A:travel=0..100,mass=10"], "axis A has `inertia`"),
        (
            &["X:travel=0..100", "X:travel=0..100"],
            "axis X is there twice",
        ),
        (
            &["X:travel=0..100,lead=2,acceleration=50000"],
            "acceleration=50000: is more than the motor can do that turns itself too: at most 4700 with 2 mm in one turn",
        ),
        (&["X:travel=0..100,start=200"], "must be within the travel"),
        (&["Z:travel=0..100,lifts=up"], "lifts=up: must be yes or no"),
        (
            &["X:travel=0..100,encoder=sincos"],
            "must be absolute or incremental",
        ),
    ] {
        let said = refused(axes);
        assert!(said.contains(why), "{axes:?}: {said}");
    }
    let home = TempDir::new().expect("a folder");
    let output = new_machine(home.path(), &GANTRY);
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("is there already"));
}
