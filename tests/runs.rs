//! Run directories: listed, marked, removed and exported.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::{Duration, Instant};

use bus::sample::ProgramState;
use machine::Machine;
use monitor::log::{RunLog, Sample};
use serde_json::Value;

use crate::recorder::read_by_others;
use crate::support::{
    Bench, LiveCell, PATIENCE, Run, circle_program, number, quadrant, run, run_with, text,
};
use crate::up::{down, obeyed, up};

/// What `quadrant runs` printed: its exit status, standard output, standard error.
fn runs(folder: &Path, words: &[&str]) -> (Option<i32>, String, String) {
    let done = quadrant()
        .current_dir(folder)
        .arg("runs")
        .args(words)
        .output();
    let done = done.expect("quadrant runs");
    let words = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (done.status.code(), words(&done.stdout), words(&done.stderr))
}

fn obeys(folder: &Path, words: &[&str]) -> String {
    let (status, printed, said) = runs(folder, words);
    assert_eq!(status, Some(0), "{words:?}: {said}");
    printed
}

fn refuses(folder: &Path, words: &[&str], why: &str) {
    let (status, _, said) = runs(folder, words);
    assert_eq!(status, Some(2), "{words:?}: {said}");
    assert!(said.contains(why), "{words:?}: {said}");
}

/// The runs that are listed, the words of the command before `--json`.
fn listed(folder: &Path, words: &[&str]) -> Vec<Value> {
    let printed = obeys(folder, &[words, &["--json"]].concat());
    let all: Value = serde_json::from_str(&printed).expect("JSON");
    all["runs"].as_array().expect("runs").clone()
}

fn short_run() -> (Bench, Run) {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("a\u{1b}[31m.ngc", "G21 G90\nG1 X3 Y1 F6000\nM2\n");
    let run = run(bench.path(), &program);
    run.good_report();
    (bench, run)
}

fn parent(run: &Path) -> &Path {
    run.parent().expect("a folder")
}

#[test]
fn a_run_is_listed_with_the_numbers_of_its_report_and_nothing_that_a_terminal_obeys() {
    let (_bench, run) = short_run();
    let report = run.report();
    let listed = listed(&run.out, &["."]);
    let [one] = listed.as_slice() else {
        panic!("{listed:?}");
    };
    assert_eq!(text(one, "/outcome"), "completed");
    assert_eq!(one["under_way"], false);
    assert_eq!(one["program"], "a\u{1b}[31m.ngc");
    assert_eq!(one["marked"], Value::Null);
    assert_eq!(
        number(one, "/took_s"),
        number(&report, "/scans") * number(&report, "/scan_period_us") / 1e6
    );
    assert_eq!(
        number(one, "/contour_error_um"),
        number(&report, "/contour_error_um/peak")
    );
    let axes = (0..2).map(|axis| number(&report, &format!("/axes/{axis}/following_error_um/peak")));
    let worst = axes.fold(0.0, f64::max);
    assert_eq!(number(one, "/following_error_um"), worst);
    let files = fs::read_dir(&run.out).expect("the run").flatten();
    let of_disk = files.map(|file| {
        let file = file.metadata().expect("a file");
        file.len().max(file.blocks() * 512)
    });
    assert_eq!(one["bytes"], of_disk.sum::<u64>());
    let table = obeys(parent(&run.out), &["."]);
    assert!(
        table.contains("completed") && table.contains("a [31m.ngc"),
        "{table}"
    );
    assert!(!table.contains('\u{1b}'), "{table}");
}

#[test]
fn a_run_under_way_says_so_and_is_not_removed_and_one_that_was_interrupted_says_that() {
    let bench = Bench::patient("xy", &[]);
    let program = bench.file("circle.ngc", &circle_program(10.0, 1000.0, (0.0, 0.0), 0.0));
    let mut cell = LiveCell::start(bench.path(), &program, "realtime");
    cell.wait_for_scan(100);
    let out = cell.out.clone();
    let above = parent(&out);
    let now = listed(above, &["."]);
    assert_eq!(now[0]["under_way"], true, "{now:?}");
    assert_eq!(now[0]["outcome"], Value::Null, "{now:?}");
    refuses(above, &["remove", "run"], "under way");
    obeyed(&cell, &["stop"]);
    let run = cell.finish();
    let then = listed(above, &["run"]);
    assert_eq!(then[0]["under_way"], false, "{then:?}");
    assert_eq!(text(&then[0], "/outcome"), "interrupted");
    assert_eq!(run.status(), 1, "{}", run.stderr());
    obeys(above, &["remove", "run/"]);
    assert!(!out.exists());
}

#[test]
fn the_runs_of_a_cell_that_is_up_are_found_from_anywhere_the_oldest_first() {
    let (_bench, mut cell, short, long) = up("realtime");
    let out = cell.out.clone();
    let elsewhere = tempfile::tempdir().expect("a folder");
    let of_cell = || -> Vec<Value> {
        let all = listed(elsewhere.path(), &[]);
        let prefix = format!("{}/", out.display());
        all.into_iter()
            .filter(|run| text(run, "/run").starts_with(&prefix))
            .collect()
    };
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["load", &short]);
    obeyed(&cell, &["start", "--wait"]);
    obeyed(&cell, &["load", &long]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|f| f.run == 2 && f.program == ProgramState::Running as u32);
    let second = out.join("002-long");
    let since = Instant::now();
    while !second.join("run.mcap").exists() || !out.join("001-short/report.json").exists() {
        assert!(since.elapsed() < PATIENCE, "no log, or no report");
        std::thread::sleep(Duration::from_millis(20));
    }
    let [first, last] = &of_cell()[..] else {
        panic!("{:?}", of_cell());
    };
    assert_eq!(text(first, "/outcome"), "completed");
    assert_eq!(text(first, "/program"), "short.ngc");
    assert_eq!(last["under_way"], true, "{last}");
    refuses(&out, &["remove", "002-long"], "under way");
    refuses(&out, &["remove", "."], "is the folder of a cell");
    obeyed(&cell, &["stop"]);
    let _run = down(cell);
    assert_eq!(text(&listed(&out, &["."])[1], "/outcome"), "interrupted");
    obeys(&out, &["remove", "001-short", "002-long"]);
    assert!(!second.exists() && out.join("events.jsonl").exists());
}

#[test]
fn a_marked_run_stays_until_its_mark_is_taken_away_or_it_is_named_with_marked() {
    let (_bench, run) = short_run();
    let above = parent(&run.out);
    obeys(above, &["mark", "run", "--reason", "first article"]);
    let reason = fs::read_to_string(run.out.join("marked"));
    assert_eq!(reason.expect("a mark"), "first article");
    assert_eq!(text(&listed(above, &["."])[0], "/marked"), "first article");
    refuses(above, &["remove", "run"], "is marked");
    obeys(above, &["unmark", "run"]);
    assert!(!run.out.join("marked").exists());
    assert!(obeys(above, &["unmark", "run"]).contains("not marked"));
    obeys(above, &["mark", "run"]);
    assert_eq!(text(&listed(above, &["."])[0], "/marked"), "");
    obeys(above, &["remove", "run", "--marked"]);
    assert!(!run.out.exists());
}

#[test]
fn what_no_run_has_made_is_not_removed_nor_anything_that_is_named_with_it() {
    let (bench, run) = short_run();
    let above = parent(&run.out);
    let machine = bench.path().display().to_string();
    refuses(
        above,
        &["remove", "run", &machine],
        "is not a run directory",
    );
    std::os::unix::fs::symlink("run", above.join("link")).expect("a link");
    refuses(above, &["remove", "run", "link"], "is a link or a copy");
    refuses(above, &["remove", "run", "link/"], "is a link or a copy");
    // A machine with somebody's log beside it.
    let copied = fs::copy(run.out.join("run.mcap"), bench.path().join("run.mcap"));
    copied.expect("a log");
    refuses(above, &["remove", "run", &machine], "is a link or a copy");
    fs::create_dir(run.out.join("parts")).expect("a folder");
    refuses(above, &["remove", "run"], "holds the folder parts");
    assert_eq!(listed(above, &["."]).len(), 1, "a link is no run");
    assert!(run.out.join("run.mcap").exists());
}

/// All of a run, as CSV.
fn exported(run: &Path) -> String {
    obeys(run, &["export", ".", "--as", "csv"]);
    let name = run.file_name().expect("a name").to_string_lossy();
    fs::read_to_string(run.join(format!("{name}.csv"))).expect("a file")
}

/// The rows of an export to CSV, the first line first.
fn rows(text: &str) -> Vec<Vec<&str>> {
    text.lines().map(|line| line.split(',').collect()).collect()
}

#[test]
fn an_export_to_csv_has_the_samples_of_the_log_to_the_bit_and_of_a_span_those_rows() {
    let (_bench, run) = short_run();
    let machine = Machine::load(&run.out).expect("a machine");
    let printed = exported(&run.out);
    let all = rows(&printed);
    let column = |name: &str| {
        let index = all[0].iter().position(|of| *of == name);
        let index = index.unwrap_or_else(|| panic!("{name}: {:?}", all[0]));
        all[1..].iter().map(move |row| row[index].to_string())
    };
    let increment_mm = machine.axes[0].increment_mm();
    let mut expected: [Vec<String>; 8] = Default::default();
    for sample in RunLog::open(&run.out).expect("a log") {
        match sample.expect("a sample") {
            Sample::Feedback(f) => {
                expected[0].push(f.scan.to_string());
                let position = f.axes[0].motor_position as f64 * increment_mm;
                expected[1].push(position.to_string());
                expected[2].push(f.axes[0].velocity_mm_s.to_string());
                expected[3].push(f.axes[0].torque_nm.to_string());
                expected[4].push(f.axes[0].winding_k.to_string());
            }
            Sample::Command(c) if c.axis == 0 && c.role == 0 => {
                expected[5].push((c.position as f64 * increment_mm).to_string());
                expected[6].push((c.following_error_mm * 1e3).to_string());
                expected[7].push(c.friction_pulse_mm_s.to_string());
            }
            _ => {}
        }
    }
    let names = [
        "scan",
        "X.feedback_mm",
        "X.velocity_mm_s",
        "X.torque_nm",
        "X.winding_k",
        "X.command_mm",
        "X.following_error_um",
        "X.pulse_mm_s",
    ];
    for (name, expected) in names.iter().zip(&expected) {
        // The last feedback is answered by nobody.
        let found: Vec<String> = column(name).filter(|value| !value.is_empty()).collect();
        assert!(found == *expected, "{name} differs from the log");
    }
    let scans = number(&run.report(), "/scans");
    assert_eq!((all.len() - 1) as f64, scans);
    obeys(
        &run.out,
        &[
            "export", ".", "--as", "csv", "--from", "0.05", "--to", "0.069", "--axes", "Y",
            "--out", "part.csv",
        ],
    );
    let part = fs::read_to_string(run.out.join("part.csv")).expect("a file");
    let of_y = all.iter().map(|row| [&row[..2], &row[10..]].concat());
    let of_y: Vec<Vec<&str>> = of_y.collect();
    let expected = [&of_y[..1], &of_y[51..71]].concat();
    assert_eq!(rows(&part), expected);
}

#[test]
fn a_log_without_instruments_is_exported_without_the_table_and_listed_without_its_error() {
    let bench = Bench::of("xy", &[]);
    let program = bench.file("part.ngc", "G21 G90\nG1 X3 Y1 F6000\nM2\n");
    let run = run_with(bench.path(), &program, &["--log", "axes"]);
    let listed = listed(&run.out, &["."]);
    assert_eq!(listed[0]["contour_error_um"], Value::Null);
    assert!(number(&listed[0], "/following_error_um") > 0.0);
    let printed = exported(&run.out);
    let all = rows(&printed);
    assert_eq!(all[0][4], "X.table_mm");
    assert_eq!((all.len() - 1) as f64, number(&run.report(), "/scans"));
    // The last feedback is answered by nobody.
    for row in &all[1..all.len() - 1] {
        let empty = row.iter().filter(|value| value.is_empty()).count();
        assert!(row[4].is_empty() && empty == 2, "{row:?}");
    }
}

#[test]
fn an_export_that_finds_nothing_is_refused_and_leaves_no_file() {
    let (_bench, run) = short_run();
    let export = |more: &[&str], why: &str| {
        let to = ["export", ".", "--as", "mcap", "--out", "x.mcap"];
        refuses(&run.out, &[&to[..], more].concat(), why);
    };
    export(&["--axes", "Q"], "--axes Q: the run has no such axis");
    export(&["--from", "2", "--to", "1"], "--from 2 s");
    export(
        &["--from", "3000"],
        "nothing between --from and --to: read from 0.000 to 0.1",
    );
    let names = fs::read_dir(&run.out).expect("the run").flatten();
    let mut names = names.map(|entry| entry.file_name().to_string_lossy().into_owned());
    assert!(names.all(|name| !name.contains("x.mcap")));
    fs::write(run.out.join("x.mcap"), "mine").expect("a file");
    export(
        &["--from", "3000"],
        "nothing between --from and --to: read from 0.000 to 0.1",
    );
    let kept = fs::read_to_string(run.out.join("x.mcap"));
    assert_eq!(kept.expect("a file"), "mine");
}

#[test]
fn an_export_to_mcap_has_the_same_rows_as_one_to_csv_and_foreign_readers_find_them() {
    let (_bench, run) = short_run();
    let printed = exported(&run.out);
    obeys(
        &run.out,
        &["export", ".", "--as", "mcap", "--out", "x.mcap"],
    );
    let file = fs::read(run.out.join("x.mcap")).expect("a file");
    let mut found = [Vec::new(), Vec::new()];
    for message in mcap::MessageStream::new(&file).expect("an MCAP file") {
        let message = message.expect("a message");
        let axis = usize::from(message.channel.topic == "/axis/Y");
        let (head, body) = message.data.split_at(4);
        assert_eq!(head, [0, 1, 0, 0], "little-endian CDR");
        let values = body
            .chunks(8)
            .map(|eight| f64::from_le_bytes(eight.try_into().expect("8")));
        let values: Vec<String> = values.map(|value| value.to_string()).collect();
        assert_eq!(message.log_time, found[axis].len() as u64 * 1_000_000);
        found[axis].push(values);
    }
    let all = rows(&printed);
    for (axis, rows) in found.iter().enumerate() {
        assert_eq!(rows.len(), all.len() - 1);
        for (row, line) in rows.iter().zip(&all[1..]) {
            let of_axis = &line[2 + 8 * axis..10 + 8 * axis];
            let row = row.join(",").replace("NaN", "");
            assert_eq!(row, format!("{},{}", line[1], of_axis.join(",")));
        }
    }
    if let Some(read) = read_by_others(&run.out.join("x.mcap")) {
        assert_eq!(read["problems"], serde_json::json!([]), "{read}");
        assert_eq!(read["messages"]["/axis/X"], found[0].len(), "{read}");
        let errors = all[1..].iter().filter_map(|row| row[5].parse::<f64>().ok());
        let peak = errors.map(f64::abs).fold(0.0, f64::max);
        assert_eq!(number(&read, "/row_following_error_um_peak/X"), peak);
    }
}
