//! What a program says to its operator and into its log, through the real processes.

use std::fs;
use std::path::Path;

use bus::sample::Waiting;
use serde_json::Value;

use crate::support::{Bench, LiveCell, Run, run, run_with};
use crate::up::obeyed;

/// Two dwells of 2 s and 1 s, a stop that is resumed at scan 6000.
const PROGRAM: &str = "G21 G90 G94\n#1=2.5\n(MSG,first)\nG4 P2\n(DEBUG,value #1)\nG1 X20 F3000\n(LOG,for the log #1)\n\
    (MSG,change the jaws)\nM0\n(PRINT,behind the stop)\nG1 X5\nG4 P1\n(MSG,at the end)\nM30\n";
const ORDERS: &str = "[[order]]\nscan = 6000\norder = \"resume\"\n";
const SAID: [(u64, &str); 6] = [
    (3, "first"),
    (5, "value 2.500000"),
    (7, "for the log 2.500000"),
    (8, "change the jaws"),
    (10, "behind the stop"),
    (13, "at the end"),
];

fn lines(file: &Path) -> Vec<Value> {
    let text = fs::read_to_string(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    let lines = text.lines().map(serde_json::from_str);
    lines.map(|line| line.expect("a line is JSON")).collect()
}

fn is_said_once_and_in_time(run: &Run, what: &str) {
    let said = lines(&run.out.join("messages.jsonl"));
    let texts: Vec<(u64, &str)> = said
        .iter()
        .map(|line| {
            let text = line["text"].as_str().expect("a text");
            (line["line"].as_u64().expect("its line"), text)
        })
        .collect();
    assert_eq!(texts, SAID, "{what}");
    let scans: Vec<u64> = said
        .iter()
        .filter_map(|line| line["scan"].as_u64())
        .collect();
    assert!(scans.is_sorted(), "{what}: {scans:?}");
    assert!(scans[0] < 1000, "{what}: {scans:?}");
    assert!(scans[1] >= 2000, "{what}: behind the dwell: {scans:?}");
    assert!(scans[3] < 6000, "{what}: before the stop: {scans:?}");
    assert!(scans[4] >= 6000, "{what}: behind the stop: {scans:?}");
    assert!(scans[5] >= 7000, "{what}: behind the last dwell: {scans:?}");
    let events = lines(&run.out.join("events.jsonl"));
    let events = events.iter().filter(|event| event["event"] == "message");
    assert_eq!(events.count(), SAID.len(), "{what}");
    for (line, text) in SAID {
        let shown = format!("the program says, line {line}: {text}");
        let times = run.stderr().matches(&shown).count();
        let to_operator = usize::from(!text.starts_with("for the log"));
        assert_eq!(times, to_operator, "{what}: {shown}");
    }
}

#[test]
fn messages_come_when_the_tool_is_there_and_stand_in_log_events_and_report() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("says.ngc", PROGRAM);
    let orders = bench.file("orders.toml", ORDERS).display().to_string();
    let run = run_with(bench.path(), &program, &["--orders", &orders]);
    let report = run.good_report();
    is_said_once_and_in_time(&run, "undisturbed");
    let listed = report["messages"].as_array().expect("messages");
    assert_eq!(listed.len(), SAID.len());
    assert_eq!(listed[1]["text"], "value 2.500000");
    let text = fs::read_to_string(run.out.join("report.txt")).expect("report.txt");
    assert!(text.contains("line 8: change the jaws"), "{text}");
    // The machine does what it does without them.
    let silent = PROGRAM.replace("(MSG,", "(").replace("(DEBUG,", "(");
    let silent = silent.replace("(PRINT,", "(").replace("(LOG,", "(");
    let silent = bench.file("silent.ngc", &silent);
    let quiet = run_with(bench.path(), &silent, &["--orders", &orders]);
    let quiet_report = quiet.good_report();
    assert_eq!(report["scans"], quiet_report["scans"]);
    assert!(quiet_report["messages"].is_null());
}

#[test]
fn killed_processes_neither_lose_nor_repeat_a_message() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("says.ngc", PROGRAM);
    let orders = bench.file("orders.toml", ORDERS).display().to_string();
    for kills in [
        [(100, "planner"), (2001, "planner"), (5000, "planner")],
        [(1990, "planner"), (3000, "monitor"), (5200, "plant-sim")],
        [(500, "monitor"), (2300, "planner"), (6100, "planner")],
    ] {
        let mut faults = String::from("[restart]\nmaster = \"wait\"\n");
        for (scan, process) in kills {
            faults += &format!(
                "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{process}\"\ndo = \"kill\"\n"
            );
        }
        // A machine that was replaced waits for its operator.
        let mut orders_twice = String::new();
        for (scan, order) in [(5600, "enable"), (6000, "resume"), (9000, "resume")] {
            orders_twice += &format!("[[order]]\nscan = {scan}\norder = \"{order}\"\n");
        }
        let orders = match kills.iter().any(|(_, process)| *process == "plant-sim") {
            true => bench
                .file("twice.toml", &orders_twice)
                .display()
                .to_string(),
            false => orders.clone(),
        };
        let faults = bench.file("faults.toml", &faults).display().to_string();
        let more = ["--orders", &orders, "--faults", &faults];
        let run = run_with(bench.path(), &program, &more);
        assert_eq!(run.status(), 0, "{kills:?}: {}", run.stderr());
        is_said_once_and_in_time(&run, &format!("{kills:?}"));
    }
}

#[test]
fn a_flood_of_messages_is_counted_where_it_is_not_shown_and_the_program_goes_on() {
    let bench = Bench::of("xy", &[]);
    let text = "G21 G90 G94\nG1 X1 F3000\no1 repeat [100000]\n#1=[#1+1]\n(LOG,number #1)\no1 endrepeat\nG1 X2\n(MSG,done)\nM30\n";
    let program = bench.file("flood.ngc", text);
    let run = run(bench.path(), &program);
    let report = run.good_report();
    let said = lines(&run.out.join("messages.jsonl"));
    let dropped: u64 = said
        .iter()
        .filter_map(|line| line["dropped"].as_u64())
        .sum();
    let shown = said.iter().filter(|line| line["text"].is_string()).count() as u64;
    assert_eq!(shown + dropped, 100_001, "{dropped} dropped");
    assert!(dropped > 0);
    assert_eq!(report["messages_dropped"], dropped);
    let last = said.last().expect("a message");
    assert_eq!(last["text"], "done");
}

#[test]
fn status_shows_what_the_program_has_said_last() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("says.ngc", "G21 G90 G94 F3000\n(MSG,part #1)\nG1 X2\n(MSG,turn it over)\nM0\n(MSG,thanks)\nG1 X0\nM30\n");
    let mut cell = LiveCell::up(bench.path(), "realtime");
    cell.wait_for_scan(50);
    let program = program.display().to_string();
    for words in [&["enable"][..], &["load", &program], &["start"]] {
        obeyed(&cell, words);
    }
    cell.wait_for(|feedback| {
        feedback.auxiliary.waiting == Waiting::ProgramStop as u32 && feedback.messages == 2
    });
    let status = obeyed(&cell, &["status"]);
    assert!(status.contains("says, line 2: part #1"), "{status}");
    assert!(status.contains("says, line 4: turn it over"), "{status}");
    assert!(!status.contains("thanks"), "{status}");
    obeyed(&cell, &["resume"]);
    cell.wait_for(|feedback| feedback.messages == 3);
    let json = obeyed(&cell, &["status", "--json"]);
    assert!(json.contains("thanks"), "{json}");
    // The same program once more says the same once more.
    let again = |cell: &mut LiveCell| {
        cell.wait_for(|feedback| feedback.program == bus::sample::ProgramState::Done as u32);
        obeyed(cell, &["start"]);
        cell.wait_for(|feedback| feedback.run == 2 && feedback.messages == 2);
    };
    again(&mut cell);
    obeyed(&cell, &["resume"]);
    cell.wait_for(|feedback| feedback.run == 2 && feedback.messages == 3);
    obeyed(&cell, &["down"]);
}

#[test]
fn a_program_that_names_a_log_file_writes_into_its_run_directory_alone() {
    let bench = Bench::of("xy", &[]);
    let elsewhere = bench.path().join("elsewhere.txt");
    let text = format!(
        "G21 G90 G94 F3000\n(LOGOPEN,{})\n(LOG,inside)\n(LOGCLOSE)\nG1 X1\nM30\n",
        elsewhere.display()
    );
    let program = bench.file("logs.ngc", &text);
    let run = run(bench.path(), &program);
    assert_eq!(run.status(), 0, "{}", run.stderr());
    assert!(!elsewhere.exists());
    assert!(
        run.stderr()
            .contains("LOGOPEN, LOGAPPEND and LOGCLOSE name no file"),
        "{}",
        run.stderr()
    );
    let said = lines(&run.out.join("messages.jsonl"));
    assert_eq!(said.len(), 1);
    assert_eq!(said[0]["text"], "inside");
    assert_eq!(said[0]["log_only"], true);
}
