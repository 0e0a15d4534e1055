//! Programs in Fanuc's language: run, planned and loaded by the option, and the language travels with them.

use std::path::PathBuf;

use bus::sample::{Mode, ProgramState};

use crate::support::{Bench, number, plan, quadrant, run_with, send, text};
use crate::up::{ask, is, obeyed, up};

/// A square with a rounded corner by a macro, twice by a packed count.
const FANUC: &str = "%\nO0001 (SQUARES)\nG90 G21 G17\nG0 X0 Y0\n#500=10.\nM98 P0021000\nG4 P100\nM30\nO1000\n\
                     WHILE [#500 LT 21] DO1\nG65 P9010 A#500\n#500=#500+10\nEND1\n#500=10.\nM99\nO9010\n\
                     G1 X#1 F3000. ,R2.\nY#1\nX0 ,C1.\nY0\nM99\n%\n";

/// The same in LinuxCNC's words.
const LINUXCNC: &str = "G90 G21 G17\nG0 X0 Y0\nF3000\no1000 sub\no1 repeat [2]\no9010 call [10]\no9010 call [20]\no1 endrepeat\no1000 endsub\n\
                        o9010 sub\nG1 X[#1-2]\nG3 X#1 Y2 R2\nG1 Y#1\nX1\nX0 Y[#1-1]\nY0\no9010 endsub\n\
                        o1000 call\nG4 P0.1\nM2\n";

fn programs(bench: &Bench) -> (PathBuf, PathBuf) {
    (
        bench.file("squares.nc", FANUC),
        bench.file("squares.ngc", LINUXCNC),
    )
}

#[test]
fn a_program_of_fanuc_moves_the_machine_as_that_of_linuxcnc_does() {
    let bench = Bench::of("xy", &[]);
    let (fanuc, linuxcnc) = programs(&bench);
    let first = run_with(bench.path(), &fanuc, &["--dialect", "fanuc"]).good_report();
    let second = run_with(bench.path(), &linuxcnc, &[]).good_report();
    for key in ["/scans", "/axes", "/contour_error_um", "/limits"] {
        assert_eq!(first.pointer(key), second.pointer(key), "{key}");
    }
    assert_eq!(text(&first, "/outcome/kind"), "completed");
    assert!(number(&first, "/scans") > 1000.0);
}

#[test]
fn without_the_option_the_machine_file_says_the_language() {
    let bench = Bench::of(
        "xy",
        &[("[scan]\n", "[program]\ndialect = \"fanuc\"\n\n[scan]\n")],
    );
    let (fanuc, linuxcnc) = programs(&bench);
    let planned = |program: &PathBuf, options: &[&str]| plan(bench.path(), program, options);
    let time = |text: String| {
        let from_time = text.split(" mm, ").nth(1);
        let time = from_time.and_then(|text| text.split("what costs most").next());
        time.map(str::to_owned)
    };
    assert_eq!(
        time(planned(&fanuc, &[])),
        time(planned(&linuxcnc, &["--dialect", "linuxcnc"]))
    );
    let check = |options: &[&str]| {
        let mut command = quadrant();
        command
            .arg("check")
            .arg(bench.path())
            .arg(&fanuc)
            .args(options);
        command.output().expect("the command").status.code()
    };
    assert_eq!(check(&[]), Some(0));
    assert_eq!(check(&["--dialect", "fanuc"]), Some(0));
    assert_eq!(check(&["--dialect", "linuxcnc"]), Some(2));
}

#[test]
fn a_loaded_program_keeps_its_language_for_every_planner() {
    let (bench, mut cell, ..) = up("realtime");
    let (fanuc, _) = programs(&bench);
    let fanuc = fanuc.display().to_string();
    assert_eq!(ask(&cell, &["load", &fanuc]).status, 2);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &fanuc, "--dialect", "fanuc"]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|now| {
        now.program == ProgramState::Running as u32 && now.axes[0].command_position > 3_000_000
    });
    let planner = cell.pid_of("planner");
    send(planner, libc::SIGKILL);
    cell.wait_for_another("planner", planner);
    cell.wait_for(|now| is(now, Mode::Ready, ProgramState::Done));
    // A block that is typed in has the language of the machine file.
    assert_eq!(ask(&cell, &["mdi", "G187 P1"]).status, 2);
    obeyed(&cell, &["start", "--line", "17", "--wait"]);
    obeyed(&cell, &["down"]);
}
