//! A log that finds no room: the machine does its program, nothing hangs, what was written can be read, and what is missing is
//! said.

use std::path::Path;
use std::process::{Command, Output};
use std::time::Instant;

use serde_json::Value;

use crate::size;
use crate::support::{Bench, endless_program, number, root, text, traces_of, unique_cell};

const PROGRAM: &str = "machines/xy/programs/circle-r25-f3000.ngc";

/// Runs a shell script in a mount namespace of its own, `$DISK` being a folder for a small disk; none where that is not permitted.
pub(crate) fn with_disk(folder: &Path, size: &str, script: &str) -> Option<Output> {
    let disk = folder.join("disk");
    std::fs::create_dir(&disk).expect("a folder");
    let mount = format!("mount -t tmpfs -o size={size} tmpfs {}", disk.display());
    let shell = |script: &str| {
        let mut command = Command::new("unshare");
        command.current_dir(root()).args(["-m", "sh", "-c", script]);
        command.output()
    };
    if !shell(&mount).is_ok_and(|tried| tried.status.success()) {
        eprintln!("not tested: a disk of one's own needs the right to mount");
        return None;
    }
    let quadrant = env!("CARGO_BIN_EXE_quadrant");
    let head = format!("{mount} && Q={quadrant} DISK={}", disk.display());
    Some(shell(&format!("{head}\n{script}")).expect("a shell"))
}

fn words(output: &Output) -> String {
    let out = String::from_utf8_lossy(&output.stdout);
    format!("{out}{}", String::from_utf8_lossy(&output.stderr))
}

fn report_in(folder: &Path) -> Value {
    let text = std::fs::read_to_string(folder.join("report.json")).expect("a report");
    serde_json::from_str(&text).expect("JSON")
}

/// The program was done, as far as the log is there it is right, and it says what is not there.
fn is_whole_but_for_its_log(report: &Value, said: &str) {
    assert_eq!(text(report, "/outcome/kind"), "completed", "{report}");
    assert!(number(report, "/samples_lost") > 0.0, "{report}");
    let missing = report["missing_scans"].as_array().map_or(0, Vec::len);
    assert!(missing > 0, "{report}");
    for limit in ["velocity", "acceleration", "travel"] {
        assert_eq!(number(report, &format!("/limits/{limit}_exceeded")), 0.0);
    }
    assert!(said.contains("missing"), "{said}");
}

#[test]
fn a_full_disk_stops_no_machine_and_what_was_recorded_is_reported_once_there_is_room() {
    for pace in size::one_in(2, ["lockstep", "realtime"]) {
        let folder = tempfile::tempdir().expect("a folder");
        let (cell, began) = (unique_cell(), Instant::now());
        let bench = Bench::patient("xy", &[]);
        let script = format!(
            "$Q run {} {PROGRAM} --pace {pace} --cell {cell} --out $DISK/run
             echo ended with $?
             mount -o remount,size=64m $DISK
             $Q report $DISK/run && cp $DISK/run/report.json $DISK/run/events.jsonl {}",
            bench.path().display(),
            folder.path().display()
        );
        let Some(output) = with_disk(folder.path(), "2m", &script) else {
            return;
        };
        let said = words(&output);
        assert!(output.status.success(), "{said}");
        assert!(said.contains("ended with 3"), "{said}");
        assert!(said.contains("No space left on device"), "{said}");
        is_whole_but_for_its_log(&report_in(folder.path()), &said);
        assert!(said.contains("THE LOG IS NOT WHOLE"), "{said}");
        let events = std::fs::read_to_string(folder.path().join("events.jsonl"));
        let events = events.expect("the events");
        assert!(events.contains("the machine is finished"), "{events}");
        assert!(traces_of(&cell).is_empty(), "{:?}", traces_of(&cell));
        println!("{pace}: {:.1} s", began.elapsed().as_secs_f64());
    }
}

/// Fills the disk a second into a run in real time of some five, whose recorder may begin again as often as it likes; then what
/// `afterwards` says. None where that is not permitted.
fn with_disk_filled(folder: &Path, afterwards: &str) -> Option<Output> {
    let (cell, here) = (unique_cell(), folder.display());
    let restarts = "[restart]\nrestarts_max = 1000\n\n[scan]\n";
    let bench = Bench::patient("xy", &[("[scan]\n", restarts)]);
    let machine = bench.path().display();
    let script = format!(
        "$Q run {machine} {PROGRAM} --pace realtime --cell {cell} --out $DISK/run &
         while ! [ -s $DISK/run/run.mcap ]; do sleep 0.01; done
         sleep 1
         cat /dev/zero > $DISK/filler 2>/dev/null
         {afterwards}
         cp $DISK/run/report.json {here}"
    );
    with_disk(folder, "64m", &script)
}

#[test]
fn a_disk_that_is_full_for_a_while_costs_the_scans_of_that_while() {
    let folder = tempfile::tempdir().expect("a folder");
    let afterwards = "sleep 1; rm $DISK/filler; wait $!; echo ended with $?";
    let Some(output) = with_disk_filled(folder.path(), afterwards) else {
        return;
    };
    let said = words(&output);
    assert!(said.contains("ended with 0"), "{said}");
    let report = report_in(folder.path());
    is_whole_but_for_its_log(&report, &said);
    let parts = report["parts"].as_array().expect("parts");
    let last = parts.last().expect("a part");
    let scans = number(&report, "/scans");
    assert_eq!(last["last_scan"].as_f64(), Some(scans - 1.0), "{report}");
}

/// Its recorder begins again and again, and is between two beginnings when the program is done.
#[test]
fn a_disk_that_is_full_to_the_end_is_no_success() {
    let folder = tempfile::tempdir().expect("a folder");
    let afterwards = "wait $!; echo ended with $?; rm $DISK/filler; $Q report $DISK/run || exit 1";
    let Some(output) = with_disk_filled(folder.path(), afterwards) else {
        return;
    };
    let said = words(&output);
    assert!(said.contains("ended with 3"), "{said}");
    is_whole_but_for_its_log(&report_in(folder.path()), &said);
}

/// Somebody else fills the disk in the middle, and clears it again.
#[test]
fn where_the_disk_gets_scarce_less_is_recorded_until_there_is_room_again_and_it_is_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let (bench, cell) = (Bench::patient("xy", &[]), unique_cell());
    let program = bench.file("endless.ngc", &endless_program());
    let script = format!(
        "$Q run {} {} --pace realtime --cell {cell} --out $DISK/run &
         runs() {{ $Q status --cell {cell} 2>&1 | grep -q RUNS; }}
         less() {{ $Q status --cell {cell} 2>&1 | grep -q 'recorded no more than --log'; }}
         all() {{ ! less; }}
         until_it() {{ for i in $(seq 600); do $1 && return; sleep 0.1; done; echo never $1; }}
         until_it runs
         free=$(df --output=avail -B1 $DISK | tail -1)
         head -c $((free - 1000000)) /dev/zero > $DISK/filler
         until_it less
         rm $DISK/filler
         until_it all
         $Q stop --cell {cell}; wait $!; echo ended with $?
         cp $DISK/run/report.json {}",
        bench.path().display(),
        program.display(),
        folder.path().display()
    );
    let Some(output) = with_disk(folder.path(), "64m", &script) else {
        return;
    };
    let said = words(&output);
    assert!(said.contains("ended with 1"), "{said}");
    assert!(said.contains("recorded no more than --log"), "{said}");
    assert!(said.contains("recorded as asked for again"), "{said}");
    assert!(traces_of(&cell).is_empty());
    let report = report_in(folder.path());
    assert_eq!(text(&report, "/outcome/kind"), "interrupted", "{report}");
    // What was left out is no number of its own.
    assert!(number(&report, "/samples_lost") > 0.0, "{report}");
}

/// Runs a program under a limit of file sizes in kB; what it printed and how it ended.
fn with_file_size(limit_kb: u32, program: &Path, out: &Path, cell: &str) -> Output {
    let script = format!(
        "ulimit -f {limit_kb}; exec {} run machines/xy {} --pace lockstep --log full --cell {cell} --out {}",
        env!("CARGO_BIN_EXE_quadrant"),
        program.display(),
        out.display()
    );
    let mut shell = Command::new("bash");
    let output = shell.current_dir(root()).args(["-c", &script]).output();
    output.expect("bash")
}

#[test]
fn a_limit_of_file_sizes_is_said_and_kills_nobody() {
    let folder = tempfile::tempdir().expect("a folder");
    let (cell, out) = (unique_cell(), folder.path().join("run"));
    let nowhere = folder.path().join("refused");
    let refused = with_file_size(1000, Path::new(PROGRAM), &nowhere, &cell);
    let said = words(&refused);
    assert_eq!(refused.status.code(), Some(3), "{said}");
    assert!(said.contains("ulimit -f"), "{said}");

    let program = folder.path().join("long.ngc");
    // 125 s of motion, some 80 MB.
    let turns = "G3 X25 Y0 I-25 J0 F3000\n".repeat(40);
    let moves = format!("G21 G17 G90 G94\nG0 X25 Y0\n{turns}M2\n");
    std::fs::write(&program, moves).expect("a file");
    let output = with_file_size(50_000, &program, &out, &cell);
    let said = words(&output);
    assert!(!said.contains("killed by signal"), "{said}");
    assert!(said.contains("File too large"), "{said}");
    let report = report_in(&out);
    assert_eq!(text(&report, "/outcome/kind"), "completed", "{report}");
    let parts = report["parts"].as_array().map_or(0, Vec::len);
    assert!(parts > 1, "{report}");
    assert!(traces_of(&cell).is_empty(), "{:?}", traces_of(&cell));
}
