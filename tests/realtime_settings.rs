//! `[processes]` of the machine file in cells that run in realtime: who runs how, what touches memory, who never pauses.

use std::fs;
use std::process::Output;

use crate::support::{Bench, LiveCell, circle_program, quadrant, send, text};

/// Eight turns of 1.3 s each.
fn cell_with(settings: &str) -> (Bench, LiveCell) {
    let with = format!("[processes]\n{settings}\n[scan]\n");
    let standby = "drive_mode = \"velocity\"\nstandby = true";
    let edits = [
        ("[scan]\n", with.as_str()),
        ("drive_mode = \"velocity\"", standby),
    ];
    let bench = Bench::patient("xy", &edits);
    let circle = circle_program(10.0, 3000.0, (0.0, 0.0), 0.0);
    let program = bench.file("circle.ngc", &circle);
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(10);
    (bench, cell)
}

fn of_process(pid: i32, file: &str) -> String {
    fs::read_to_string(format!("/proc/{pid}/{file}")).unwrap_or_default()
}

/// A field of `/proc/PID/stat`, counted as proc(5) does.
fn stat(pid: i32, number: usize) -> u64 {
    let stat = of_process(pid, "stat");
    let after_name = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    let field = after_name.split_whitespace().nth(number - 3);
    field
        .and_then(|field| field.parse().ok())
        .expect("a number")
}

const MINOR_FAULTS: usize = 10;
const MAJOR_FAULTS: usize = 12;
const PRIORITY: usize = 40;

fn line_of(text: &str, name: &str) -> String {
    let line = text.lines().find(|line| line.starts_with(name));
    let line = line.unwrap_or_else(|| panic!("no {name:?} in {text}"));
    line[name.len()..].trim().to_owned()
}

/// What of SCHED_FIFO and locked memory this user is refused, in the doctor's words.
fn refused(thing: &str) -> bool {
    let output = quadrant()
        .args(["doctor", "--seconds", "1", "--json"])
        .output();
    let stdout = output.expect("a doctor").stdout;
    let json: serde_json::Value = serde_json::from_slice(&stdout).expect("JSON");
    let findings = json["findings"].as_array().expect("findings");
    let found = findings.iter().find(|finding| finding["what"] == thing);
    found.expect("it looks for that")["grade"] != "ok"
}

#[test]
fn every_process_runs_as_the_machine_file_says() {
    let (_bench, cell) = cell_with(
        "timer_slack_ns = 7\nbusy_max_ms = 700\n\
         master.priority = 33\nplanner.priority = 11\n\
         servo = { priority = 22, processors = [0] }\n",
    );
    let may_fifo = !refused("SCHED_FIFO");
    for (role, priority) in [
        ("plant-sim", 33),
        ("servo --axis Y", 22),
        ("planner", 11),
        ("recorder", 0),
    ] {
        let pid = cell.pid_of(&format!("quadrant {role}"));
        if may_fifo {
            assert_eq!(stat(pid, PRIORITY), priority, "{role}");
        } else {
            println!("skipped: SCHED_FIFO is refused here, so nobody has a priority");
        }
        let limit = line_of(&of_process(pid, "limits"), "Max realtime timeout");
        let wanted = if priority > 0 { "700000" } else { "unlimited" };
        assert_eq!(limit.split_whitespace().next(), Some(wanted), "{role}");
        let allowed = line_of(&of_process(pid, "status"), "Cpus_allowed_list:");
        let free = !role.starts_with("servo");
        assert!(free || allowed == "0", "{role}: {allowed}");
        if !may_fifo || priority == 0 {
            // The kernel has none under SCHED_FIFO.
            assert_eq!(of_process(pid, "timerslack_ns").trim(), "7", "{role}");
        }
    }
}

/// Master and servos have their program and their memory before the scans begin; a page of a queue is touched when its place is used for
/// the first time, which takes a microsecond and no disk.
#[test]
fn nothing_is_read_from_a_disk_in_a_scan_and_hardly_a_page_is_new() {
    if refused("locked memory") {
        println!("skipped: memory cannot be locked here");
        return;
    }
    let (_bench, mut cell) = cell_with("");
    // An observer that comes is one more queue for the master: this one is there all the time.
    let (_bus, mut reader) = cell.feedback();
    let mut wait_for_scan = |scan| {
        while reader.newest(u64::MAX).is_none_or(|seen| seen.scan < scan) {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    };
    wait_for_scan(1000);
    let who = cell.children().into_iter().filter(|(_, line)| {
        ["quadrant plant-sim", "quadrant servo"]
            .iter()
            .any(|role| line.starts_with(role))
    });
    let faults = |pid| [MINOR_FAULTS, MAJOR_FAULTS].map(|number| stat(pid, number));
    let before: Vec<(i32, String, [u64; 2])> =
        who.map(|(pid, line)| (pid, line, faults(pid))).collect();
    assert_eq!(before.len(), 5, "a master, and two servos for each axis");
    wait_for_scan(4000);
    for (pid, line, [minor, major]) in before {
        let [minor_now, major_now] = faults(pid);
        assert_eq!(major_now - major, 0, "{line}");
        let new = minor_now - minor;
        assert!(new <= 100, "{new} new pages in 3000 scans: {line}");
    }
}

#[test]
fn a_process_that_the_kernel_ends_because_it_never_paused_is_named_and_replaced() {
    let (_bench, cell) = cell_with("");
    // What the kernel does is tested in `bus`; here it is what follows.
    send(
        cell.pid_of("quadrant servo --axis X --role a"),
        libc::SIGXCPU,
    );
    let run = cell.finish();
    let stderr = run.stderr();
    let cause = "servo-X killed by signal 24: it used a processor without a pause";
    assert!(stderr.contains(cause), "{stderr}");
    assert!(stderr.contains("servo-X restarted"), "{stderr}");
    assert_eq!(text(&run.good_report(), "/outcome/kind"), "completed");
}

#[test]
fn a_processor_that_this_pc_does_not_have_is_refused_in_realtime_and_of_no_matter_in_lockstep() {
    let with = "[processes.planner]\nprocessors = [1023]\n[scan]\n";
    let bench = Bench::of("xy", &[("[scan]\n", with)]);
    let program = bench.file("short.ngc", "G21 G90\nG1 F3000 X1\nM2\n");
    let run = |pace: &str| -> Output {
        let mut run = quadrant();
        let out = bench.folder.path().join(pace);
        run.arg("run")
            .arg(bench.path())
            .arg(&program)
            .args(["--pace", pace]);
        run.args(["--cell", &crate::support::unique_cell()])
            .arg("--out")
            .arg(out);
        run.output().expect("a run")
    };
    let refused = run("realtime");
    let printed = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(3), "{printed}");
    assert!(
        printed.contains("processes.planner.processors = [1023]: this PC has no processor 1023"),
        "{printed}"
    );
    assert_eq!(run("lockstep").status.code(), Some(0));
}
