//! `(ABORT, …)` through the real processes: the tool rests at the end of the block before it, the program is given up, and its text is
//! the reason wherever somebody asks for one.

use std::fs;
use std::path::Path;

use bus::sample::{Cause, Feedback, Mode, ProgramState};
use machine::parse_parameters;
use monitor::log::{Reader, Sample};
use serde_json::Value;

use crate::support::{Bench, Run, quadrant, run, run_with, text};
use crate::up::{ask, is, obeyed, up};

/// In line 6, at scan 2,001 or a little later; X is at 10 then.
const PROGRAM: &str = "G21 G90 G94\nG1 X10 F30000\n(MSG,before)\nG4 P2\n#1=2.5\n(ABORT, tool #1 too short)\nG1 X30\n(MSG,behind)\nM2\n";
const SAYS: &str = "line 6: tool 2.500000 too short";

fn last_feedback(run: &Run) -> Feedback {
    let samples = Reader::open(&run.out.join("run.mcap")).expect("the log");
    let feedbacks = samples.filter_map(|sample| match sample.expect("a sample") {
        Sample::Feedback(feedback) => Some(*feedback),
        _ => None,
    });
    feedbacks.last().expect("a feedback")
}

fn said(folder: &Path) -> Vec<(String, u64)> {
    let file = fs::read_to_string(folder.join("messages.jsonl")).expect("what was said");
    let lines = file
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).expect("JSON"));
    let of = |line: Value| {
        let text = line["text"].as_str().expect("a text").to_owned();
        (text, line["scan"].as_u64().expect("its scan"))
    };
    lines.map(of).collect()
}

fn x_nm(feedback: &Feedback) -> i64 {
    feedback.axes[0].command_position
}

/// Status, reason, place and texts of a run that has given itself up; the scan of the last text.
fn is_given_up(run: &Run, what: &str) -> u64 {
    let stderr = run.stderr();
    assert_eq!(run.status(), 1, "{what}: {stderr}");
    let shown = stderr.lines().last().unwrap_or_default();
    assert!(
        shown.contains("(ABORT)") && shown.ends_with(SAYS),
        "{what}: {stderr}"
    );
    let report = run.report();
    assert_eq!(text(&report, "/outcome/kind"), "stopped", "{what}");
    let reason = text(&report, "/outcome/reason");
    assert!(reason.ends_with(SAYS), "{what}: {reason}");
    let page = fs::read_to_string(run.out.join("report.html")).expect("the page");
    assert!(page.contains("tool 2.500000 too short"), "{what}");
    let last = last_feedback(run);
    assert_eq!(last.mode, Mode::Stopped as u32, "{what}");
    assert_eq!((x_nm(&last), last.at_rest), (10_000_000, 1), "{what}");
    let said = said(&run.out);
    let texts: Vec<&str> = said.iter().map(|(text, _)| text.as_str()).collect();
    assert_eq!(texts, ["before", "tool 2.500000 too short"], "{what}");
    said[1].1
}

#[test]
fn a_run_that_gives_itself_up_rests_at_the_block_before_and_ends_with_its_text_as_the_reason() {
    let bench = Bench::of("xy", &[]);
    let run = run(bench.path(), bench.file("part.ngc", PROGRAM));
    let at = is_given_up(&run, "undisturbed");
    assert!(at >= 2000, "behind the dwell: {at}");
}

#[test]
fn a_planner_killed_before_at_and_behind_the_abort_changes_nothing() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("part.ngc", PROGRAM);
    let at = is_given_up(&run(bench.path(), &program), "undisturbed");
    for scan in [
        1,
        500,
        at - 20,
        at - 3,
        at - 2,
        at - 1,
        at,
        at + 1,
        at + 2,
        at + 3,
        at + 20,
    ] {
        let faults =
            format!("[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"planner\"\ndo = \"kill\"\n");
        let faults = bench.file("faults.toml", &faults).display().to_string();
        let run = run_with(bench.path(), &program, &["--faults", &faults]);
        is_given_up(
            &run,
            &format!("killed at scan {scan}, the text is due at {at}"),
        );
    }
}

#[test]
fn a_machine_lost_around_the_abort_gives_the_program_up_once_somebody_has_resumed() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("part.ngc", PROGRAM);
    let at = is_given_up(&run(bench.path(), &program), "undisturbed");
    let orders =
        "[[order]]\nscan = 2600\norder = \"enable\"\n[[order]]\nscan = 3000\norder = \"resume\"\n";
    let orders = bench.file("orders.toml", orders).display().to_string();
    for scan in [at - 10, at - 2, at - 1] {
        let faults = format!(
            "[restart]\nmaster = \"wait\"\n[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"plant-sim\"\ndo = \"kill\"\n"
        );
        let faults = bench.file("faults.toml", &faults).display().to_string();
        let more = ["--orders", &orders, "--faults", &faults];
        is_given_up(&run_with(bench.path(), &program, &more), &format!("{scan}"));
    }
}

#[test]
fn a_hold_before_the_abort_keeps_it_until_somebody_resumes() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("part.ngc", PROGRAM);
    let at = is_given_up(&run(bench.path(), &program), "undisturbed");
    for hold in [at - 500, at - 10, at - 4] {
        let orders = format!(
            "[[order]]\nscan = {hold}\norder = \"hold\"\n[[order]]\nscan = 5000\norder = \"resume\"\n"
        );
        let orders = bench.file("orders.toml", &orders).display().to_string();
        let run = run_with(bench.path(), &program, &["--orders", &orders]);
        let then = is_given_up(&run, &format!("hold at {hold}"));
        assert!(then >= 5000, "hold at {hold}: {then}");
    }
}

#[test]
fn a_cell_is_ready_after_it_and_start_begins_the_program_again() {
    let (bench, mut cell, short, _) = up("lockstep");
    let part = bench.file("part.ngc", PROGRAM).display().to_string();
    obeyed(&cell, &["enable"]);
    let loaded = obeyed(&cell, &["load", &part]);
    assert!(loaded.contains("line 6: (ABORT"), "{loaded}");
    for number in 1..=2 {
        let given_up = ask(&cell, &["start", "--wait"]);
        assert_eq!(given_up.status, 1, "{}", given_up.text);
        assert!(
            given_up
                .text
                .contains(&format!("run {number} was given up")),
            "{}",
            given_up.text
        );
        assert!(given_up.text.contains(SAYS), "{}", given_up.text);
        let now = cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Loaded));
        assert_eq!(
            (now.run, now.cause, now.hold),
            (number, Cause::Abort as u32, 0)
        );
        assert_eq!(x_nm(&now), 10_000_000);
        let status = obeyed(&cell, &["status"]);
        assert!(
            status.contains("READY") && status.contains(SAYS),
            "{status}"
        );
        let json = obeyed(&cell, &["status", "--json"]);
        let json: Value = serde_json::from_str(&json).expect("JSON");
        let words = json["cause"]["words"].as_str().expect("a cause");
        assert!(words.ends_with(SAYS), "{words}");
    }
    obeyed(&cell, &["start", "--single-block"]);
    obeyed(&cell, &["single-block", "off"]);
    obeyed(&cell, &["resume"]);
    let again = cell.wait_for(|f| f.run == 3 && is(f, Mode::Ready, ProgramState::Loaded));
    assert_eq!(again.cause, Cause::Abort as u32);
    // Another program knows nothing of it.
    obeyed(&cell, &["load", &short]);
    let status = obeyed(&cell, &["status"]);
    let state = status.lines().next().unwrap_or_default();
    assert!(
        state.contains("READY") && !state.contains("ABORT"),
        "{status}"
    );
    assert!(status.contains("run 3 stopped: "), "{status}");
    obeyed(&cell, &["start", "--wait"]);
    obeyed(&cell, &["down"]);
    let ended = cell.finish();
    let folders = fs::read_dir(&ended.out).expect("the folder").flatten();
    let reports = folders.filter_map(|run| fs::read_to_string(run.path().join("report.json")).ok());
    let (with_text, without): (Vec<_>, Vec<_>) = reports.partition(|report| report.contains(SAYS));
    assert_eq!(with_text.len(), 3, "{without:?}");
}

#[test]
fn typed_in_blocks_that_give_themselves_up_fail_with_their_text_and_leave_the_program_loaded() {
    let (_bench, mut cell, short, _) = up("lockstep");
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &short]);
    let given_up = ask(
        &cell,
        &["mdi", "G91 G1 X2 F3000", "(abort,by hand)", "G1 X5"],
    );
    assert_eq!(given_up.status, 1, "{}", given_up.text);
    assert!(given_up.text.contains("by hand"), "{}", given_up.text);
    let now = cell.wait_for(|f| is(f, Mode::Ready, ProgramState::Loaded));
    assert_eq!(x_nm(&now), 2_000_000);
    obeyed(&cell, &["mdi", "G90 G1 X0 F3000"]);
    obeyed(&cell, &["start", "--wait"]);
    obeyed(&cell, &["down"]);
}

#[test]
fn what_was_set_before_the_abort_is_kept_and_check_tells_of_it() {
    let edit = (
        "[scan]\n",
        "[program]\nparameter_file = \"xy.var\"\n\n[scan]\n",
    );
    let bench = Bench::of("xy", &[edit]);
    let file = bench.file("xy.var", "100\t1\n");
    let program = "G21 G90 G94\n#100=[#100+1]\nG1 X10 F6000\nG10 L20 P1 X8\nG92 X3\n(ABORT,measured)\n#100=9\nM2\n";
    let program = bench.file("part.ngc", program);
    let checked = quadrant()
        .arg("check")
        .arg(bench.path())
        .arg(&program)
        .output();
    let checked = checked.expect("a check");
    let printed = String::from_utf8_lossy(&[checked.stdout, checked.stderr].concat()).into_owned();
    assert!(checked.status.success(), "{printed}");
    assert!(printed.contains("line 6: (ABORT"), "{printed}");
    let run = run(bench.path(), &program);
    assert_eq!(run.status(), 1, "{}", run.stderr());
    let kept = fs::read_to_string(file).expect("the file");
    let kept = parse_parameters("kept", &kept).expect("parameters");
    let numbers = [100, 5221, 5210, 5211].map(|number| kept[&number]);
    assert_eq!(numbers, [2.0, 2.0, 1.0, 5.0]);
}
