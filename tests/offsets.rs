//! Work offsets and the tool table: set by an operator, kept by programs, whoever is killed meanwhile.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use bus::sample::ProgramState;
use machine::tools_file::parse_tools_file;
use machine::{KeptParameters, Machine};
use rustix::process::{Pid, Signal};
use serde_json::Value;

use crate::size;
use crate::support::{Bench, LiveCell, quadrant, run, run_with, text};
use crate::tools::tool;
use crate::up::{ask, down, obeyed, refused};

fn asked(words: &[&str]) -> Output {
    quadrant().args(words).output().expect("a command")
}

fn said(words: &[&str], status: i32) -> String {
    let output = asked(words);
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said).into_owned();
    assert_eq!(output.status.code(), Some(status), "{words:?}: {said}");
    said
}

/// A machine with this file of work offsets.
fn with_offsets(machine: &str, text: Option<&str>) -> (Bench, PathBuf, String) {
    let bench = Bench::patient(machine, &[]);
    let file = bench.path().join("offsets.toml");
    if let Some(text) = text {
        fs::write(&file, text).expect("written");
    }
    let machine = bench.path().display().to_string();
    (bench, file, machine)
}

fn kept(machine: &str) -> KeptParameters {
    Machine::load(Path::new(machine))
        .expect("a machine")
        .parameters
}

#[test]
fn offsets_are_set_shown_and_cleared_and_what_is_wrong_leaves_the_file_as_it_was() {
    let (_bench, file, machine) = with_offsets("xy", None);
    let shown = said(&["offsets", &machine], 0);
    assert!(
        shown.contains("is not there yet") && !file.exists(),
        "{shown}"
    );
    said(
        &["offsets", &machine, "set", "G55", "X=12.5", "y=-3", "R=30"],
        0,
    );
    said(&["offsets", &machine, "set", "g59.3", "X=1e-3"], 0);
    let good = fs::read_to_string(&file).expect("the file");
    let values = [(5241, 12.5), (5242, -3.0), (5250, 30.0), (5381, 0.001)];
    assert_eq!(kept(&machine), KeptParameters::from(values));
    for (words, right) in [
        (["G55", "X=nan"], "a number such as 12.5"),
        (["G55", "Q=1"], "it has X Y"),
        (["G60", "X=1"], "G54 G55"),
        (["G55", "X=1e5"], "must be from"),
        (["G55", "X"], "X=12.5"),
    ] {
        let refused = said(&["offsets", &machine, "set", words[0], words[1]], 2);
        assert!(refused.contains(right), "{refused}");
        assert_eq!(fs::read_to_string(&file).expect("the file"), good);
    }
    let json = said(&["offsets", &machine, "--json"], 0);
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["offsets"][1]["position_mm"]["X"], 12.5);
    assert_eq!(json["offsets"][1]["rotation_deg"], 30.0);
    said(&["offsets", &machine, "clear", "G55"], 0);
    assert_eq!(kept(&machine), KeptParameters::from([(5381, 0.001)]));
}

#[test]
fn a_spoilt_file_is_refused_with_its_lines_and_nothing_starts_with_half_of_it() {
    let wrong = "[G54]\nX = 1.0\nY = 2.0.0\n";
    let (bench, file, machine) = with_offsets("xy", Some(wrong));
    let program = bench.file("move.ngc", "G21 G90\nG1 X5 F6000\nM2\n");
    let refused = run(bench.path(), &program);
    assert_eq!(refused.status(), 2);
    assert!(
        refused.stderr().contains("offsets.toml:3: "),
        "{}",
        refused.stderr()
    );
    let refused = said(&["offsets", &machine, "set", "G55", "X=1"], 2);
    assert!(refused.contains("offsets.toml:3: "), "{refused}");
    assert_eq!(fs::read_to_string(&file).expect("the file"), wrong);
    fs::remove_file(&file).expect("removed");
    fs::write(bench.path().join("tools.toml"), "[T1]\nlenght_mm = 3\n").expect("written");
    let refused = said(&["check", &machine], 2);
    assert!(
        refused.contains("tools.toml:2: ") && refused.contains("length_mm"),
        "{refused}"
    );
}

#[test]
fn tools_are_set_and_removed_and_those_of_the_machine_file_are_taken_over() {
    let (bench, _, machine) = with_offsets("xyz-mill", None);
    let file = bench.path().join("tools.toml");
    let before = Machine::load(bench.path()).expect("a machine").tools;
    said(
        &[
            "tool",
            &machine,
            "set",
            "T77",
            "length_mm=40.5",
            "diameter_mm=6",
            "name=end mill",
        ],
        0,
    );
    let tools = parse_tools_file("tools", &fs::read_to_string(&file).expect("the file"));
    let tools = tools.expect("tools");
    assert_eq!(tools.len(), before.len() + 1);
    let new = tools.last().expect("a tool");
    assert_eq!((new.number, new.offset[2], new.diameter), (77, 40.5, 6.0));
    assert_eq!(new.comment, "end mill");
    for (word, right) in [
        ("length_mm=long", "a number"),
        ("lenght_mm=1", "length_mm"),
        ("diameter_mm=-1", "at least 0"),
    ] {
        let refused = said(&["tool", &machine, "set", "T77", word], 2);
        assert!(refused.contains(right), "{refused}");
    }
    said(&["tool", &machine, "remove", "T77"], 0);
    said(&["tool", &machine, "remove", "T77"], 2);
    assert_eq!(
        Machine::load(bench.path()).expect("a machine").tools,
        before
    );
}

/// A program's own changes land in the file at its end, beside what stands there.
const SETS: &str = "G21 G90 G94\nG1 X10 F6000\nG4 P0.1\nG10 L20 P1 X8\nG10 L2 P3 Y4.5\nM2\n";

#[test]
fn what_a_program_sets_is_kept_once_whoever_is_killed_at_its_end() {
    let began = "[G54]\nX = 1.0\n\n[G59]\nX = 7.0\n";
    let (bench, file, machine) = with_offsets("xy", Some(began));
    let program = bench.file("sets.ngc", SETS);
    let undisturbed = run(bench.path(), &program).good_report();
    let last = undisturbed["scans"].as_u64().expect("a number");
    let expected = [(5221, 3.0), (5262, 4.5), (5321, 7.0)];
    assert_eq!(kept(&machine), KeptParameters::from(expected));
    let good = fs::read_to_string(&file).expect("the file");
    for (index, who) in ["planner", "planner", "planner", "servo-X"]
        .iter()
        .enumerate()
    {
        fs::write(&file, began).expect("written");
        let scan = last - 130 + 15 * index as u64;
        let faults = bench.file(
            "faults.toml",
            &format!("[restart]\nservo = \"resume\"\n[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{who}\"\ndo = \"kill\"\n"),
        );
        let faults = faults.display().to_string();
        let report = run_with(bench.path(), &program, &["--faults", &faults]).good_report();
        assert_eq!(
            text(&report, "/outcome/kind"),
            "completed",
            "{who} in {scan}"
        );
        assert_eq!(
            fs::read_to_string(&file).expect("the file"),
            good,
            "{who} in {scan}"
        );
    }
}

#[test]
fn touching_off_sets_the_offset_and_the_next_program_works_with_it() {
    let (bench, file, _) = with_offsets("xy", None);
    let program = bench.file(
        "move.ngc",
        "G21 G90 G94\nG1 X2 F6000\nG4 P1\nG10 L2 P3 Y4.5\nM2\n",
    );
    let program = program.display().to_string();
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    obeyed(&cell, &["jog", "X", "5", "--wait"]);
    obeyed(&cell, &["zero", "X", "--at", "-1"]);
    let now = cell.wait_for(|_| true);
    let machine = Machine::load(bench.path()).expect("a machine");
    let place_mm = now.axes[0].command_position as f64 * machine.axes[0].increment_mm();
    assert!((machine.parameters[&5221] - (place_mm + 1.0)).abs() < 1e-9);
    let wrong = ask(&cell, &["zero", "X", "--offset", "G60"]);
    assert!(
        wrong.status == 2 && wrong.text.contains("G54 G55"),
        "{}",
        wrong.text
    );
    obeyed(&cell, &["load", &program]);
    obeyed(&cell, &["hold"]);
    obeyed(&cell, &["start"]);
    let good = fs::read_to_string(&file).expect("the file");
    refused(&cell, &["offsets", "set", "G55", "X=1"], "is started");
    refused(&cell, &["zero", "X"], "is started");
    assert_eq!(fs::read_to_string(&file).expect("the file"), good);
    obeyed(&cell, &["resume"]);
    let end = cell.wait_for(|now| now.program == ProgramState::Done as u32);
    let end_mm = end.axes[0].command_position as f64 * machine.axes[0].increment_mm();
    assert!((end_mm - (place_mm + 1.0 + 2.0)).abs() < 1e-3, "{end_mm}");
    obeyed(&cell, &["offsets", "set", "G55", "X=1"]);
    let kept = Machine::load(bench.path()).expect("a machine").parameters;
    assert_eq!((kept[&5241], kept[&5262]), (1.0, 4.5));
    down(cell);
}

#[test]
fn of_writers_at_the_same_time_none_loses_a_change() {
    let (_bench, _file, machine) = with_offsets("xy", None);
    let names = ["G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2"];
    std::thread::scope(|scope| {
        for (index, name) in names.iter().enumerate() {
            let machine = &machine;
            scope.spawn(move || said(&["offsets", machine, "set", name, &format!("X={index}")], 0));
        }
    });
    let expected: BTreeMap<u32, f64> = (0..8)
        .map(|index| (5221 + 20 * index, f64::from(index)))
        .collect();
    assert_eq!(kept(&machine), expected);
}

const CALLS: &str =
    "openat,flock,read,write,fsync,rename,renameat,renameat2,unlink,close,statx,readlink";

/// A writer under strace; none where that is not there, or may not trace.
fn traced(words: &[&str], more: &[&str]) -> Option<Output> {
    let strace = tool("strace")?;
    let mut command = Command::new(strace);
    let output = command
        .args(["-qq", "-e", &format!("trace={CALLS}")])
        .args(more)
        .arg(env!("CARGO_BIN_EXE_quadrant"))
        .args(words)
        .output()
        .expect("strace");
    Some(output)
}

/// Words of a command that sets this value.
type Words<'a> = &'a dyn Fn(&str) -> Vec<String>;

/// Killed at its last system calls (at as many as `KILLS` says, over all of them): the file is old or new, never else.
#[test]
fn whenever_a_writer_is_killed_its_file_is_old_or_new() {
    let (bench, offsets, machine) = with_offsets("xy", Some("[G54]\nX = 1.0\n"));
    let tools = bench.path().join("tools.toml");
    fs::write(&tools, "[T1]\nlength_mm = 1.0\n").expect("written");
    let words = |what: [&str; 3], value: &str| {
        let [command, of, key] = what;
        let value = format!("{key}={value}");
        [command, &machine, "set", of, &value]
            .map(str::to_string)
            .to_vec()
    };
    let of_offsets = |value: &str| words(["offsets", "G54", "X"], value);
    let of_tools = |value: &str| words(["tool", "T1", "length_mm"], value);
    let trace = bench.path().join("trace");
    killed_everywhere(&offsets, &of_offsets, &trace);
    killed_everywhere(&tools, &of_tools, &trace);
}

fn killed_everywhere(file: &Path, words: Words<'_>, trace: &Path) {
    let change = |value: &str, more: &[&str]| {
        let words = words(value);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        traced(&words, more)
    };
    let text = || fs::read_to_string(file).expect("the file");
    let mut seen = [0; 2];
    // The command looks for cells, and other tests have some: its calls are not the same each time. Wider each time.
    for attempt in 1..=8 {
        let Some(first) = change("2", &["-o", &trace.display().to_string()]) else {
            return;
        };
        if !first.status.success() {
            eprintln!("strace cannot trace here: the check is left out");
            return;
        }
        let traced = fs::read_to_string(trace).expect("a trace");
        let names = traced.lines().filter_map(|line| line.split_once('('));
        let names: Vec<&str> = names.map(|(name, _)| name).collect();
        let calls = names.len();
        let (from, count) = match size::number("KILLS", 0, 200) {
            0 => (calls.saturating_sub(24 * attempt), 24),
            kills => (0, kills as usize),
        };
        for kill in 0..count {
            let before = text();
            let value = if before.contains("= 2.0") { "3" } else { "2" };
            let at = from + kill * (calls - from) / count;
            // Each kind of call is counted by itself.
            let before_it = names[..=at].iter().filter(|name| **name == names[at]);
            let (name, nth) = (names[at], before_it.count());
            let inject = format!("inject={name}:signal=KILL:when={nth}");
            let _ = change(value, &["-o", "/dev/null", "-e", &inject]);
            let after = text();
            let is_new = after.contains(&format!("= {value}.0"));
            let new = before.replace(
                if value == "3" { "= 2.0" } else { "= 3.0" },
                &format!("= {value}.0"),
            );
            assert!(
                after == before || after == new,
                "killed at {at} of {calls}: {after}"
            );
            seen[usize::from(is_new)] += 1;
        }
        eprintln!(
            "{}: killed {count} times over {calls} calls: {seen:?} old and new",
            file.display()
        );
        if seen.iter().all(|count| *count > 0) {
            break;
        }
    }
    assert!(seen.iter().all(|count| *count > 0), "old and new: {seen:?}");
    // And the next writer is not held up by what is left behind.
    let last = change("5", &["-o", "/dev/null"]);
    assert!(last.is_some_and(|output| output.status.success()));
    assert!(text().contains("= 5.0"));
}

/// What a run of a program did to the file.
struct Kept {
    before: String,
    /// At every look since.
    seen: Vec<String>,
    /// System calls of the planner.
    calls: Vec<String>,
    killed: bool,
}

/// A cell whose planner is killed while it keeps what a program has set.
struct Keeping<'a> {
    cell: LiveCell,
    strace: &'a Path,
    bench: &'a Bench,
    file: &'a Path,
}

impl Keeping<'_> {
    fn text(&self) -> String {
        fs::read_to_string(self.file).expect("the file")
    }

    fn planner(&self) -> u64 {
        let status = ask(&self.cell, &["status", "--json"]).text;
        let status: Value = serde_json::from_str(&status).expect("JSON");
        let processes = status["processes"].as_array().expect("processes");
        let planner = processes.iter().find(|of| of["process"] == "planner");
        planner
            .and_then(|of| of["pid"].as_u64())
            .expect("a planner")
    }

    /// A program that sets X of G54; at its end the planner is killed at this system call, if there is one. None where nobody may
    /// trace.
    fn run(&mut self, x_mm: f64, kill: Option<(&str, usize)>) -> Option<Kept> {
        let program = format!("G21 G91 G94\nG1 X0.01 F6000\nM0\nG90 G10 L2 P1 X{x_mm}\nM2\n");
        let program = self.bench.file("sets.ngc", &program).display().to_string();
        obeyed(&self.cell, &["load", &program]);
        obeyed(&self.cell, &["start"]);
        self.cell
            .wait_for(|now| now.auxiliary.waiting != 0 && now.hold == 1);
        let (before, planner) = (self.text(), self.planner());
        let trace = self.bench.path().join("trace");
        let mut command = Command::new(self.strace);
        command.args(["-qq", "-f", "-p", &planner.to_string()]);
        command
            .args(["-e", &format!("trace={CALLS}"), "-o"])
            .arg(&trace);
        if let Some((name, nth)) = kill {
            command.args(["-e", &format!("inject={name}:signal=KILL:when={nth}")]);
        }
        let mut tracer = command.stderr(Stdio::null()).spawn().expect("strace");
        let is_traced = || {
            let status = fs::read_to_string(format!("/proc/{planner}/status")).unwrap_or_default();
            status.contains("TracerPid:") && !status.contains("TracerPid:\t0")
        };
        let since = Instant::now();
        while !is_traced() {
            if since.elapsed() > Duration::from_secs(5) {
                let _ = tracer.kill();
                let _ = tracer.wait();
                return None;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        obeyed(&self.cell, &["resume"]);
        let mut seen = vec![self.text()];
        let mut asked = Instant::now();
        loop {
            let text = self.text();
            if seen.last() != Some(&text) {
                seen.push(text);
            }
            let now = self.cell.wait_for(|_| true);
            if now.program == ProgramState::Done as u32 {
                break;
            }
            // Who waits for somebody, because the planner was lost, is told to go on.
            if asked.elapsed() > Duration::from_secs(1) {
                let _ = (ask(&self.cell, &["enable"]), ask(&self.cell, &["resume"]));
                asked = Instant::now();
            }
        }
        seen.push(self.text());
        // A planner that lives is let go.
        let _ = kill_process(&tracer);
        let _ = tracer.wait();
        let traced = fs::read_to_string(trace).expect("a trace");
        let names = traced.lines().filter_map(|line| line.split_once('('));
        let names = names.filter_map(|(before, _)| before.split_whitespace().last());
        Some(Kept {
            before,
            seen,
            calls: names.map(str::to_string).collect(),
            killed: self.planner() != planner,
        })
    }
}

/// Ends a tracer so that it lets go of what it traces.
fn kill_process(child: &Child) -> rustix::io::Result<()> {
    rustix::process::kill_process(Pid::from_child(child), Signal::TERM)
}

/// Killed at its system calls at the end of a program (at eight, or as many as `KILLS` says): the file is old or new at every
/// look, and new in the end.
#[test]
fn whenever_the_planner_is_killed_at_the_end_of_a_program_the_file_is_old_or_new() {
    let Some(strace) = tool("strace") else {
        return;
    };
    let restart =
        "[restart]\nplanner = \"resume\"\nrestarts_max = 100000\nwithin_s = 1.0\n\n[scan]\n";
    let bench = Bench::patient("xy", &[("[scan]\n", restart)]);
    let file = bench.path().join("offsets.toml");
    fs::write(&file, "[G54]\nX = 1.0\n").expect("written");
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    let mut keeping = Keeping {
        cell,
        strace: &strace,
        bench: &bench,
        file: &file,
    };
    if let Some(Kept { calls, .. }) = keeping.run(2.0, None) {
        let kills = size::number("KILLS", 8, 8) as usize;
        let mut killed = 0;
        for kill in 0..kills {
            let at = kill * calls.len() / kills;
            let same = calls[..=at].iter().filter(|name| **name == calls[at]);
            let nth = same.count();
            let x_mm = 3.0 + (kill % 2) as f64;
            let kept = keeping.run(x_mm, Some((&calls[at], nth))).expect("traced");
            let new = kept.seen.last().expect("a look");
            assert!(new.contains(&format!("X = {x_mm:.1}\n")), "{new}");
            let mut looks = kept.seen.iter();
            let sound = looks.all(|text| *text == kept.before || text == new);
            assert!(sound, "killed at {at} of {}: {:?}", calls.len(), kept.seen);
            killed += usize::from(kept.killed);
        }
        eprintln!(
            "the planner was killed {killed} times over {} calls",
            calls.len()
        );
        assert!(killed * 2 > kills, "{killed} of {kills}");
    } else {
        eprintln!("strace may not trace a process here: the check is left out");
    }
    down(keeping.cell);
}

/// A slide has its offset in mm and a rotary axis in degrees, under a table that says so.
#[test]
fn the_machine_file_gives_a_rotary_axis_its_work_offset_in_degrees() {
    let home = tempfile::tempdir().expect("a folder");
    let folder = home.path().join("gantry");
    let made = quadrant()
        .args(["new", "machine"])
        .arg(&folder)
        .args(["--axis", "X:travel=0..300", "--axis", "A:travel=-360..360"])
        .output()
        .expect("running quadrant");
    assert!(made.status.success(), "{made:?}");
    let file = folder.join("machine.toml");
    let text = fs::read_to_string(&file).expect("machine.toml");
    let offsets =
        "[program.work_offset_mm]\nX = 12.5\n\n[program.work_offset_deg]\nA = -30.0\n\n[[axis]]";
    fs::write(&file, text.replacen("[[axis]]", offsets, 1)).expect("machine.toml");
    let output = quadrant()
        .arg("offsets")
        .arg(&folder)
        .arg("--json")
        .output()
        .expect("running quadrant");
    let shown: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let g54 = &shown["offsets"][0];
    assert_eq!(
        g54["position_mm"],
        serde_json::json!({ "X": 12.5 }),
        "{shown}"
    );
    assert_eq!(
        g54["position_deg"],
        serde_json::json!({ "A": -30.0 }),
        "{shown}"
    );
}
