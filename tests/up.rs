//! A cell that stays up: programs loaded, started, discarded; orders in every state; deaths; its end.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::time::Duration;

use bus::cell::CellPaths;
use bus::sample::{Feedback, Mode, ProgramState};
use serde_json::Value;

use crate::support::{
    Bench, LiveCell, circle_program, endless_program, look_late, number, quadrant, send, text,
    traces_of,
};

/// What an order printed, and its exit status.
pub(crate) struct Said {
    pub status: i32,
    pub text: String,
}

pub(crate) fn ask(cell: &LiveCell, words: &[&str]) -> Said {
    look_late();
    let Output {
        status,
        stdout,
        stderr,
    } = quadrant()
        .args(words)
        .args(["--cell", &cell.cell])
        .output()
        .expect("the command");
    Said {
        status: status.code().unwrap_or(-1),
        text: String::from_utf8_lossy(&[stdout, stderr].concat()).into_owned(),
    }
}

/// An order that must be obeyed. Who is told to wait a moment waits one and asks again, as an operator does.
pub(crate) fn obeyed(cell: &LiveCell, words: &[&str]) -> String {
    for _ in 0..30 {
        let printed = ask(cell, words);
        if printed.status == 1 && printed.text.contains("(wait a moment)") {
            std::thread::sleep(Duration::from_millis(100));
            continue;
        }
        assert_eq!(printed.status, 0, "{words:?}: {}", printed.text);
        return printed.text;
    }
    panic!("{words:?}: told to wait a moment 30 times");
}

/// An order that must be refused with these words, by the cell.
pub(crate) fn refused(cell: &LiveCell, words: &[&str], why: &str) {
    let printed = ask(cell, words);
    assert_eq!(printed.status, 1, "{words:?}: {}", printed.text);
    assert!(printed.text.contains(why), "{words:?}: {}", printed.text);
}

/// A cell that is up, and two programs: circles for 6 s, and for hours.
pub(crate) fn up(pace: &str) -> (Bench, LiveCell, String, String) {
    up_on(Bench::patient("xy", &[]), pace)
}

/// The same of a machine.
pub(crate) fn up_on(bench: Bench, pace: &str) -> (Bench, LiveCell, String, String) {
    let short = circle_program(10.0, 3000.0, (0.0, 0.0), 0.0);
    let short = bench.file("short.ngc", &short).display().to_string();
    let long = bench
        .file("long.ngc", &endless_program())
        .display()
        .to_string();
    let mut cell = LiveCell::up(bench.path(), pace);
    let first = cell.wait_for(|_| true);
    assert_eq!(Mode::from_wire(first.mode), Some(Mode::Disabled));
    assert_eq!(first.program, ProgramState::None as u32);
    (bench, cell, short, long)
}

pub(crate) fn is(feedback: &Feedback, mode: Mode, program: ProgramState) -> bool {
    feedback.mode == mode as u32 && feedback.program == program as u32
}

fn report_in(folder: &Path) -> Value {
    let file = folder.join("report.json");
    let text = fs::read_to_string(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    serde_json::from_str(&text).expect("JSON")
}

/// Names of the run directories.
fn runs_in(out: &Path) -> Vec<String> {
    let entries = fs::read_dir(out).expect("the folder").flatten();
    let folders = entries.filter(|entry| entry.path().is_dir());
    let mut names: Vec<String> = folders
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn the_folder_of_a_cell_is_no_run_and_says_which_are_in_it() {
    let folder = tempfile::tempdir().expect("a folder");
    for name in ["001-a", "002-b"] {
        fs::create_dir(folder.path().join(name)).expect("a run");
    }
    let printed = quadrant().arg("report").arg(folder.path()).output();
    let printed = printed.expect("the command");
    assert_eq!(printed.status.code(), Some(2));
    let words = String::from_utf8_lossy(&printed.stderr).into_owned();
    assert!(
        words.contains("001-a to ") && words.contains("002-b"),
        "{words}"
    );
}

fn programs_of(cell: &LiveCell) -> Vec<PathBuf> {
    let place = CellPaths::new(&cell.cell).expect("a cell name");
    let entries = fs::read_dir(place.programs()).into_iter().flatten();
    entries.flatten().map(|entry| entry.path()).collect()
}

/// Ends the cell by `quadrant down`: nothing of it is left; its folder, alive until the result is dropped.
pub(crate) fn down(cell: LiveCell) -> crate::support::Run {
    assert!(obeyed(&cell, &["down"]).contains(": down"));
    let run = cell.finish();
    assert_eq!(run.status(), 0, "{}", run.stderr());
    let left = traces_of(&run.cell);
    assert!(left.is_empty(), "{left:?}");
    run
}

#[test]
fn whoever_has_waited_gives_the_next_order_at_once_and_every_answer_names_its_cell() {
    let (_bench, mut cell, _, _) = up("realtime");
    let name = format!("{}: ", cell.cell);
    for _ in 0..5 {
        for words in [&["enable"][..], &["jog", "X", "1", "--wait"], &["disable"]] {
            let said = ask(&cell, words);
            assert_eq!(said.status, 0, "{words:?}: {}", said.text);
            let named = said.text.lines().all(|line| line.starts_with(&name));
            assert!(named, "{words:?}: {}", said.text);
        }
    }
    obeyed(&cell, &["enable"]);
    // It takes half a minute.
    let from = cell.wait_for(|_| true).axes[0].command_position;
    obeyed(&cell, &["jog", "X", "20", "--speed", "40"]);
    cell.wait_for(|now| now.axes[0].command_position != from);
    let status = ask(&cell, &["status", "--json"]).text;
    assert!(status.contains("\"at_rest\": false"), "{status}");
    refused(&cell, &["disable"], &format!("{name}disable refused"));
    down(cell);
}

/// Other cells may run at the same time: several are refused as well.
#[test]
fn an_order_that_names_no_cell_moves_no_machine_of_another_folder() {
    let (_bench, cell, _, _) = up("realtime");
    let elsewhere = tempfile::tempdir().expect("a folder");
    let order = quadrant()
        .arg("enable")
        .current_dir(elsewhere.path())
        .output()
        .expect("the command");
    let words = String::from_utf8_lossy(&order.stderr).into_owned();
    assert_eq!(order.status.code(), Some(2), "{words}");
    assert!(
        words.contains("--cell") && words.contains(&cell.cell),
        "{words}"
    );
    assert!(ask(&cell, &["status"]).text.contains("DRIVES OFF"));
    down(cell);
}

#[test]
fn programs_are_loaded_and_started_one_after_the_other_and_each_leaves_its_report() {
    let (_bench, mut cell, short, long) = up("lockstep");
    refused(&cell, &["start"], "the drives are off");
    obeyed(&cell, &["enable"]);
    refused(&cell, &["start"], "no program is loaded");
    refused(&cell, &["resume"], "no program is running");
    assert!(obeyed(&cell, &["load", &short]).contains("loaded short.ngc"));
    for run in 1..=2 {
        let printed = obeyed(&cell, &["start", "--wait"]);
        assert!(printed.contains(&format!("run {run} is done")), "{printed}");
    }
    // By hand, in between.
    obeyed(&cell, &["jog", "Y", "4"]);
    cell.wait_for(|f| {
        let way_nm = f.axes[1].command_position - 4_000_000;
        is(f, Mode::Ready, ProgramState::Done) && way_nm.abs() < 20_000
    });
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 20.0);
    refused(&cell, &["load", &short], "a program is running");
    refused(&cell, &["start"], "a program is running");
    obeyed(&cell, &["stop"]);
    cell.wait_for(|f| is(f, Mode::Stopped, ProgramState::Running));
    // Given up for another one.
    obeyed(&cell, &["load", &short]);
    obeyed(&cell, &["start", "--wait"]);
    let run = down(cell);
    assert_eq!(
        runs_in(&run.out),
        ["001-short", "002-short", "003-long", "004-short"]
    );
    for (name, kind) in [
        ("001-short", "completed"),
        ("002-short", "completed"),
        ("003-long", "interrupted"),
        ("004-short", "completed"),
    ] {
        let report = report_in(&run.out.join(name));
        assert_eq!(text(&report, "/outcome/kind"), kind, "{name}");
        assert_eq!(number(&report, "/samples_lost"), 0.0, "{name}");
        assert_eq!(
            number(&report, "/limits/acceleration_exceeded"),
            0.0,
            "{name}"
        );
        let contour_um = number(&report, "/contour_error_um/peak");
        assert!(contour_um < 40.0, "{name}: {contour_um} µm");
        for file in ["machine.toml", "plant.toml", "run.mcap", "report.html"] {
            assert!(run.out.join(name).join(file).exists(), "{name}/{file}");
        }
    }
    // The second time the machine begins where the program ends.
    let arcs = |name: &str| {
        let report = report_in(&run.out.join(name));
        report
            .pointer("/arcs")
            .and_then(Value::as_array)
            .map(Vec::len)
    };
    assert_eq!(arcs("001-short"), arcs("002-short"));
    let events = fs::read_to_string(run.out.join("events.jsonl")).expect("events");
    assert_eq!(events.matches("\"run over\"").count(), 4, "{events}");
}

/// A program that ends where it began is not read again for its second start.
#[test]
fn a_program_that_is_started_again_does_its_events_again() {
    let bench = Bench::patient("xy", &[]);
    let words =
        "G21 G90 G94\nG1 X1 F3000\nM64 P1\nM8\nG1 X0\nM62 P2\nG1 X1\nX0\nM65 P1\nM9\nM63 P2\nM2\n";
    let program = bench.file("events.ngc", words).display().to_string();
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &program]);
    for _ in 0..3 {
        obeyed(&cell, &["start", "--wait"]);
    }
    let run = down(cell);
    for name in ["001-events", "002-events", "003-events"] {
        let report = report_in(&run.out.join(name));
        let events = report["auxiliary_events"].as_array();
        assert_eq!(events.map(Vec::len), Some(6), "{name}: {events:?}");
    }
}

#[test]
fn a_program_that_is_wrong_is_refused_before_the_cell_hears_of_it() {
    let (bench, cell, _, _) = up("realtime");
    let wrong = bench.file("wrong.ngc", "G21 G90\nG1 X5000 F100\nM2\n");
    let printed = ask(&cell, &["load", &wrong.display().to_string()]);
    assert_eq!(printed.status, 2, "{}", printed.text);
    assert!(printed.text.contains("wrong.ngc"), "{}", printed.text);
    let printed = ask(&cell, &["load", "no-such-file.ngc"]);
    assert_eq!(printed.status, 2, "{}", printed.text);
    assert!(programs_of(&cell).is_empty(), "{:?}", programs_of(&cell));
    down(cell);
}

#[test]
fn the_one_program_of_a_run_is_not_replaced_and_down_ends_it_on_the_path() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("long.ngc", &endless_program());
    let mut cell = LiveCell::start(bench.path(), &program, "lockstep");
    cell.wait_for(|f| f.tag.element >= 2);
    let program = program.display().to_string();
    refused(&cell, &["load", &program], "runs one program");
    refused(&cell, &["start"], "runs one program");
    obeyed(&cell, &["down"]);
    let run = cell.finish();
    assert_eq!(run.status(), 1, "{}", run.stderr());
    let report = run.report();
    assert_eq!(text(&report, "/outcome/kind"), "interrupted");
    assert!(number(&report, "/contour_error_um/peak") < 25.0);
}

#[test]
fn a_cell_that_several_people_end_at_once_ends_in_order() {
    // Each comes at another moment of the end.
    for after_ms in [0, 5, 10, 20, 30, 45, 60] {
        let bench = Bench::patient("xy", &[]);
        let mut cell = LiveCell::up(bench.path(), "lockstep");
        cell.wait_for(|_| true);
        let down = || {
            let mut command = quadrant();
            command.args(["down", "--cell", &cell.cell]);
            command.stdout(Stdio::null()).stderr(Stdio::null());
            command.spawn().expect("down")
        };
        let mut first = down();
        std::thread::sleep(Duration::from_millis(after_ms));
        let mut second = down();
        assert!(first.wait().expect("down").success());
        // Whoever comes when it is gone is told so.
        second.wait().expect("down");
        assert_eq!(cell.finish().status(), 0, "after {after_ms} ms");
    }
}

#[test]
fn down_in_mid_arc_brings_the_tool_to_rest_on_the_path_and_the_report_is_made() {
    let (_bench, mut cell, _, long) = up("lockstep");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 20.0);
    let run = down(cell);
    let report = report_in(&run.out.join("001-long"));
    assert_eq!(text(&report, "/outcome/kind"), "interrupted");
    assert!(number(&report, "/contour_error_um/peak") < 25.0);
    assert_eq!(number(&report, "/limits/acceleration_exceeded"), 0.0);
}

#[test]
fn a_terminated_cell_stops_in_order_too() {
    let (_bench, mut cell, _, long) = up("lockstep");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 20.0);
    cell.signal_launcher(libc::SIGTERM);
    let run = cell.finish();
    assert_eq!(run.status(), 130, "{}", run.stderr());
    let report = report_in(&run.out.join("001-long"));
    assert_eq!(text(&report, "/outcome/kind"), "interrupted");
    assert!(traces_of(&run.cell).is_empty());
}

/// Whoever dies comes back, and the program goes on: also where the machine file would end a run.
#[test]
fn planner_servo_recorder_and_master_come_back_in_a_cell_that_stays() {
    let (_bench, mut cell, short, long) = up("lockstep");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["start"]);
    // Or the program would be over before all are back.
    obeyed(&cell, &["override", "10"]);
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 20.0);

    send(cell.pid_of("quadrant planner"), libc::SIGKILL);
    let gone_on = |cell: &mut LiveCell| {
        let from = cell.wait_for(|f| !f.tag.is_off_path());
        cell.wait_for(|f| {
            f.mode == Mode::Enabled as u32
                && (f.tag.element, f.tag.distance_mm as i64)
                    > (from.tag.element, from.tag.distance_mm as i64 + 30)
                && !f.tag.is_off_path()
        });
    };
    gone_on(&mut cell);

    send(cell.pid_of("quadrant recorder"), libc::SIGKILL);
    gone_on(&mut cell);

    send(cell.pid_of("quadrant servo --axis Y"), libc::SIGKILL);
    cell.wait_for(|f| f.mode == Mode::Tripped as u32);
    let acknowledged = (0..200).any(|_| {
        std::thread::sleep(Duration::from_millis(20));
        ask(&cell, &["enable"]).status == 0
    });
    assert!(acknowledged, "the servo does not come back");
    obeyed(&cell, &["resume"]);
    gone_on(&mut cell);

    let before = cell.wait_for(|_| true).incarnation;
    send(cell.pid_of("quadrant plant-sim"), libc::SIGKILL);
    let back = cell.wait_for(|f| f.incarnation > before);
    assert!(is(&back, Mode::Disabled, ProgramState::Running), "{back:?}");
    assert_eq!((back.run, back.load), (1, 1));
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["resume"]);
    gone_on(&mut cell);
    // Nothing of all that is the next program's.
    obeyed(&cell, &["stop"]);
    cell.wait_for(|f| f.mode == Mode::Stopped as u32);
    obeyed(&cell, &["override", "100%"]);
    assert!(obeyed(&cell, &["load", &short]).contains("run 1 is given up"));
    assert!(obeyed(&cell, &["start", "--wait"]).contains("002-short"));
    let run = down(cell);
    let next = report_in(&run.out.join("002-short"));
    assert_eq!(next["faults"].as_array().map(Vec::len), Some(0), "{next}");
    for process in next["processes"].as_array().expect("processes") {
        assert_eq!(process["starts"], 1, "{process}");
    }
    let report = report_in(&run.out.join("001-long"));
    assert_eq!(
        report["faults"].as_array().map(Vec::len),
        Some(4),
        "{report}"
    );
    assert_eq!(text(&report, "/outcome/kind"), "interrupted");
    assert!(run.out.join("001-long/run-2.mcap").exists());
    assert_eq!(number(&report, "/limits/acceleration_exceeded"), 0.0);
}

#[test]
fn a_planner_that_dies_between_programs_comes_back_with_the_one_that_is_loaded() {
    let (_bench, mut cell, short, _) = up("realtime");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &short]);
    let before = cell.pid_of("quadrant planner");
    send(before, libc::SIGKILL);
    cell.wait_for_another("quadrant planner", before);
    obeyed(&cell, &["start", "--wait"]);
    let feedback = cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Done));
    assert_eq!(feedback.load, 1);
    let run = down(cell);
    let report = report_in(&run.out.join("001-short"));
    assert_eq!(text(&report, "/outcome/kind"), "completed");
}

#[test]
fn many_clients_at_once_are_all_answered() {
    let (_bench, mut cell, _, long) = up("lockstep");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["start"]);
    std::thread::scope(|scope| {
        for client in 0..6 {
            let cell = &cell;
            scope.spawn(move || {
                for turn in 0..6 {
                    let percent = format!("{}", 40 + 10 * ((client + turn) % 7));
                    match (client + turn) % 3 {
                        0 => drop(obeyed(cell, &["override", &percent])),
                        1 => drop(obeyed(cell, &["status", "--json"])),
                        _ => drop(obeyed(cell, &["hold"])),
                    }
                }
            });
        }
    });
    obeyed(&cell, &["override", "100"]);
    obeyed(&cell, &["resume"]);
    cell.wait_for(|f| f.hold == 0 && f.at_rest == 0 && f.override_percent == 100);
    down(cell);
}

#[test]
fn a_cell_whose_launcher_is_killed_leaves_no_process_behind() {
    let (_bench, mut cell, _, long) = up("realtime");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|f| f.tag.element >= 2 && f.tag.distance_mm > 20.0);
    let children = cell.children();
    cell.signal_launcher(libc::SIGKILL);
    let started = std::time::Instant::now();
    let lives = |pid: i32| Path::new(&format!("/proc/{pid}")).exists();
    while children.iter().any(|(pid, _)| lives(*pid)) {
        assert!(started.elapsed().as_secs() < 30, "{children:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
    let name = cell.cell.clone();
    let run = cell.finish();
    assert!(
        run.out.join("001-long/run.mcap").exists(),
        "what was recorded stays"
    );
    let cleaned = quadrant().args(["clean", &name]).output().expect("clean");
    assert!(cleaned.status.success());
    assert!(traces_of(&name).is_empty());
}

#[test]
fn a_reset_gives_up_the_rest_of_a_program_and_start_begins_it_again() {
    let (_bench, mut cell, _, long) = up("lockstep");
    refused(&cell, &["reset"], "no program is loaded");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["override", "10"]);
    obeyed(&cell, &["start", "--single-block"]);
    cell.wait_for(|f| f.hold == 1 && f.at_rest == 1);
    obeyed(&cell, &["single-block", "off"]);
    obeyed(&cell, &["resume"]);
    cell.wait_for(|f| f.hold == 0 && f.at_rest == 0);
    refused(&cell, &["reset"], "not in hold");
    obeyed(&cell, &["hold"]);
    let place = |f: &Feedback| [0, 1].map(|axis: usize| f.axes[axis].command_position);
    let held = cell.wait_for(|f| f.at_rest == 1);
    let reset = (0..100).any(|_| {
        std::thread::sleep(Duration::from_millis(20));
        ask(&cell, &["reset"]).status == 0
    });
    assert!(reset, "it is not taken at rest in hold");
    let now = cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Loaded));
    assert_eq!((now.hold, place(&now)), (0, place(&held)));
    // From its beginning, from where the axes are.
    obeyed(&cell, &["start", "--single-block"]);
    let again = cell.wait_for(|f| f.run == 2 && f.hold == 1 && f.at_rest == 1);
    assert!(!again.tag.is_off_path());
    assert_eq!(again.tag.element, 0);
    obeyed(&cell, &["down"]);
    cell.finish();
}

#[test]
fn a_program_starts_at_a_line_and_goes_on_from_there() {
    let (bench, mut cell, ..) = up("lockstep");
    let part = "G21 G90\nG0 X10\nG1 X20 F3000\n(a word)\nG1 Y20\nG1 X0\nM2\n";
    let part = bench.file("part.ngc", part).display().to_string();
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &part]);
    let no_motion = ask(&cell, &["start", "--line", "4"]);
    assert_eq!(no_motion.status, 2, "{}", no_motion.text);
    let what = "part.ngc:4: no motion begins here";
    assert!(no_motion.text.contains(what), "{}", no_motion.text);
    assert!(
        no_motion.text.contains("as lines 3 and 5 do"),
        "{}",
        no_motion.text
    );
    let now = cell.wait_for(|_| true);
    assert_eq!(now.run, 0, "a refused line has started something");
    let said = obeyed(&cell, &["start", "--line", "5", "--wait"]);
    assert!(
        said.contains("run 1 started") && said.contains(", at line 5"),
        "{said}"
    );
    assert!(said.contains("run 1 is done"), "{said}");
    // The second motion of the program was never made: its line was 3.
    let end = cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Done));
    assert!(end.auxiliary.start_line == 0);
    obeyed(&cell, &["hold"]);
    let said = obeyed(&cell, &["start", "--line", "3"]);
    assert!(said.contains("in hold: resume moves"), "{said}");
    refused(&cell, &["load", &part], "a program is running");
    // It rests behind the line's block.
    obeyed(&cell, &["single-block", "on"]);
    obeyed(&cell, &["resume"]);
    let begun =
        cell.wait_for(|f| f.auxiliary.levels.blocks_done > 0 && f.hold == 1 && f.at_rest == 1);
    assert_eq!((begun.run, begun.tag.element), (2, 1));
    obeyed(&cell, &["single-block", "off"]);
    obeyed(&cell, &["resume"]);
    cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Done));
    obeyed(&cell, &["down"]);
    assert_eq!(cell.finish().output.status.code(), Some(0));
}
