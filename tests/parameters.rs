//! Parameters that outlive a run, through the real processes.

use std::fs;
use std::path::{Path, PathBuf};

use machine::{KeptParameters, parse_parameters};

use crate::support::{Bench, LiveCell, quadrant, run, run_with, text};
use crate::up::{ask, down, obeyed, refused};

/// A counter, and a work offset that the next run begins with: it moves as far from its own zero each time.
const PROGRAM: &str =
    "G21 G90 G94\n#100=[#100+1]\nG1 X10 F6000\nG4 P0.1\nG10 L20 P1 X8\nG92.1\nG1 X9\nM2\n";

fn keeping(text: Option<&str>) -> (Bench, PathBuf, PathBuf) {
    let bench = Bench::patient(
        "xy",
        &[(
            "[scan]\n",
            "[program]\nparameter_file = \"kept/xy.var\"\n\n[scan]\n",
        )],
    );
    fs::create_dir(bench.path().join("kept")).expect("a folder");
    let file = bench.path().join("kept/xy.var");
    if let Some(text) = text {
        fs::write(&file, text).expect("written");
    }
    let program = bench.file("count.ngc", PROGRAM);
    (bench, file, program)
}

fn kept(file: &Path) -> KeptParameters {
    let text = fs::read_to_string(file).expect("the file");
    parse_parameters("kept", &text).expect("parameters")
}

/// Names in the folder of the file: nothing half written lies there.
fn beside(file: &Path) -> usize {
    let folder = file.parent().expect("a folder");
    fs::read_dir(folder).expect("the folder").count()
}

#[test]
fn a_run_begins_with_what_the_one_before_has_kept_and_its_report_can_be_made_again() {
    let (bench, file, program) = keeping(Some("100\t4\n"));
    let first = run(bench.path(), &program);
    let report = first.good_report();
    assert_eq!(text(&report, "/outcome/kind"), "completed");
    assert_eq!((kept(&file)[&100], kept(&file)[&5221]), (5.0, 2.0));
    let second = run(bench.path(), &program);
    second.good_report();
    assert_eq!((kept(&file)[&100], kept(&file)[&5221]), (6.0, 4.0));
    assert_eq!(beside(&file), 1);
    // What is in the file now is not what these runs began with.
    for run in [first, second] {
        let before = run.good_report();
        let mut again = quadrant();
        let again = again
            .arg("report")
            .arg(&run.out)
            .output()
            .expect("a report");
        assert!(again.status.success());
        let after = run.good_report();
        assert_eq!(before["motion_digest"], after["motion_digest"]);
        assert_eq!(before["path"], after["path"]);
    }
}

#[test]
fn a_file_that_is_not_there_yet_is_made_and_a_wrong_one_is_refused_with_its_lines() {
    let (bench, file, program) = keeping(None);
    run(bench.path(), &program).good_report();
    assert_eq!(kept(&file)[&5221], 2.0);
    assert!(
        !kept(&file).contains_key(&100),
        "it is not named in the file"
    );
    fs::write(&file, "100 one\n5220 12\n").expect("written");
    let refused = run(bench.path(), &program);
    assert_eq!(refused.status(), 2);
    let said = refused.stderr();
    assert!(
        said.contains("xy.var:1: ") && said.contains("xy.var:2: "),
        "{said}"
    );
    assert_eq!(
        fs::read_to_string(&file).expect("the file"),
        "100 one\n5220 12\n"
    );
}

#[test]
fn whoever_is_killed_at_the_end_of_a_program_its_parameters_are_kept_once() {
    let (bench, file, program) = keeping(None);
    let undisturbed = run(bench.path(), &program).good_report();
    let last = undisturbed["scans"].as_u64().expect("a number");
    for (index, who) in ["planner", "planner", "planner", "servo-X", "planner"]
        .iter()
        .enumerate()
    {
        fs::write(&file, "100\t4\n").expect("written");
        let scan = last - 130 + 15 * index as u64;
        let faults = bench.file(
            "faults.toml",
            &format!(
                "[restart]\nservo = \"resume\"\n[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{who}\"\ndo = \"kill\"\n"
            ),
        );
        let faults = faults.display().to_string();
        let run = run_with(bench.path(), &program, &["--faults", &faults]);
        let report = run.good_report();
        assert_eq!(
            text(&report, "/outcome/kind"),
            "completed",
            "{who} in {scan}"
        );
        assert_eq!(
            (kept(&file)[&100], kept(&file)[&5221]),
            (5.0, 2.0),
            "{who} in {scan}"
        );
        assert_eq!(beside(&file), 1, "{who} in {scan}");
    }
}

#[test]
fn a_file_that_cannot_be_written_stops_the_program_at_its_end_with_the_reason() {
    let (bench, file, program) = keeping(None);
    fs::remove_dir(file.parent().expect("a folder")).expect("removed");
    let run = run(bench.path(), &program);
    assert_ne!(run.status(), 0, "{}", run.stderr());
    let said = run.stderr();
    assert!(
        said.contains("the parameters are not kept") && said.contains("xy.var"),
        "{said}"
    );
}

/// Started again at once, and from the next program: nobody waits for a file.
#[test]
fn in_a_cell_that_stays_up_each_start_goes_on_from_the_one_before() {
    let (bench, file, program) = keeping(Some("100\t0\n"));
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    let program = program.display().to_string();
    obeyed(&cell, &["load", &program]);
    for _ in 0..3 {
        obeyed(&cell, &["start", "--wait"]);
    }
    obeyed(&cell, &["load", &program]);
    obeyed(&cell, &["start", "--wait"]);
    assert_eq!((kept(&file)[&100], kept(&file)[&5221]), (4.0, 8.0));
    // An edit that went wrong: nothing runs with it, and the file stays as it is.
    let good = fs::read_to_string(&file).expect("the file");
    let wrong = good.replace("100\t4", "100\tfour");
    fs::write(&file, &wrong).expect("written");
    let printed = ask(&cell, &["load", &program]);
    assert!(
        printed.status == 2 && printed.text.contains("xy.var:1"),
        "{}",
        printed.text
    );
    refused(&cell, &["start", "--wait"], "run 5 is not done");
    assert_eq!(fs::read_to_string(&file).expect("the file"), wrong);
    fs::write(&file, &good).expect("written");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &program]);
    obeyed(&cell, &["start", "--wait"]);
    assert_eq!((kept(&file)[&100], kept(&file)[&5221]), (5.0, 10.0));
    let run = down(cell);
    for (index, offset_mm) in [0.0, 2.0, 4.0, 6.0].into_iter().enumerate() {
        let folder = run.out.join(format!("00{}-count", index + 1));
        let machine = machine::Machine::load(&folder).expect("its machine file");
        assert_eq!(machine.parameters[&100], index as f64);
        let offset = machine.parameters.get(&5221).copied().unwrap_or_default();
        assert_eq!(offset, offset_mm);
        let report = fs::read_to_string(folder.join("report.json")).expect("a report");
        let report: serde_json::Value = serde_json::from_str(&report).expect("JSON");
        assert_eq!(text(&report, "/outcome/kind"), "completed", "{report}");
    }
}
