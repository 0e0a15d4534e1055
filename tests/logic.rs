//! The machine's own logic as a process of the cell: asked, killed, hung, wrong, and always safe.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use bus::sample::{Cause, Mode};
use machine::Machine;
use monitor::log::{Reader, Sample};
use serde_json::Value;

use crate::support::{Bench, LiveCell, has_python, run_with};
use crate::up::{obeyed, refused};
use crate::whole_machine::{moves, signals};

/// A chuck that a button opens as long as nothing turns, a lamp, and a pump that is to be off when nobody says otherwise.
const SIGNALS: &str = r#"
[[signal]]
name = "button"
from = { by = "operator" }
[[signal]]
name = "request"
from = { output = 5 }
[[signal]]
name = "pump"
lost = 0
from = { by = "logic" }
to = { terminal = 4, channel = 1 }
[[signal]]
name = "level"
kind = "float"
from = { by = "logic" }
to = { analog_input = 1 }
"#;

/// The pump follows the program's output 5, the level is the number of questions.
const LOGIC: &str = r#"
import quadrant_logic

asked = 0

def update(io):
    global asked
    asked += 1
    io["pump"] = io["request"]
    io["level"] = asked
    if io["button"]:
        io.inhibit()

quadrant_logic.run(update)
"#;

fn machine(logic: &str, more: &str) -> Bench {
    let name = "name = \"xy\"\n";
    let table = format!("[logic]\ncommand = [\"python3\", \"./logic.py\"]\n{more}\n");
    let bench = Bench::of("xy", &[(name, &format!("{name}{SIGNALS}{table}"))]);
    bench.file("logic.py", logic);
    bench
}

const PROGRAM: &str = "G21 G90 G17 G94\nM64 P5\nG1 X30 F3000\nM65 P5\nG1 X0\nM2\n";

fn digests(out: &Path) -> (String, String) {
    let text = fs::read_to_string(out.join("report.json")).expect("a report");
    let report: Value = serde_json::from_str(&text).expect("its JSON");
    let digest = |key: &str| report[key].as_str().expect("a digest").to_string();
    (digest("digest"), digest("motion_digest"))
}

/// Values of a signal in a log, scan by scan.
fn course(out: &Path, index: usize) -> Vec<(u64, f64, bool)> {
    let samples = Reader::open(&out.join("run.mcap")).expect("the log");
    let of_signal = |sample| match sample {
        Ok(Sample::Signals(signals)) => {
            Some((signals.scan, signals.values[index], signals.lost.has(index)))
        }
        _ => None,
    };
    samples.filter_map(of_signal).collect()
}

#[test]
fn logic_is_asked_in_lockstep_the_same_on_every_run_and_moves_nothing() {
    if !has_python() {
        return;
    }
    let bench = machine(LOGIC, "");
    let program = bench.file("program.ngc", PROGRAM);
    let runs = [(), ()].map(|()| {
        let run = run_with(bench.path(), &program, &[]);
        assert_eq!(run.status(), 0, "{}", run.stderr());
        digests(&run.out)
    });
    assert_eq!(runs[0], runs[1]);
    let plain = Bench::of("xy", &[]);
    let run = run_with(plain.path(), &program, &[]);
    assert_eq!(
        digests(&run.out).1,
        runs[0].1,
        "logic that touches no motion changes none"
    );
}

/// Between the death of the logic and its return the pump is off, within two scans of the death.
#[test]
fn killed_logic_leaves_no_output_on_and_holds_the_machine() {
    if !has_python() {
        return;
    }
    let bench = machine(LOGIC, "");
    let program = bench.file("program.ngc", PROGRAM);
    let faults = "[[fault]]\nat = { scan = 300 }\nprocess = \"logic\"\ndo = \"kill\"\nrestart_after_scans = 400\n";
    let faults = bench.file("faults.toml", faults).display().to_string();
    let orders = "[[order]]\nscan = 900\norder = \"resume\"\n";
    let orders = bench.file("orders.toml", orders).display().to_string();
    let run = run_with(
        bench.path(),
        &program,
        &["--faults", &faults, "--orders", &orders],
    );
    assert_eq!(run.status(), 0, "{}", run.stderr());
    let pump = course(&run.out, 2);
    let at = |scan: u64| *pump.iter().find(|(at, ..)| *at == scan).expect("a scan");
    assert_eq!((at(299).1, at(299).2), (1.0, false));
    assert_eq!((at(302).1, at(302).2), (0.0, true));
    assert_eq!((at(690).1, at(690).2), (0.0, true));
    assert_eq!((at(720).1, at(720).2), (1.0, false));
    let samples = Reader::open(&run.out.join("run.mcap")).expect("the log");
    let held = samples.filter_map(|sample| match sample {
        Ok(Sample::Feedback(now)) if now.scan == 600 => Some((now.hold, now.mode)),
        _ => None,
    });
    assert_eq!(held.last(), Some((1, Mode::Enabled as u32)));
}

/// Logic that says what it may not, ends or says nothing that can be read is lost, with the reason in the messages, and comes back.
#[test]
fn logic_that_is_wrong_is_lost_and_started_again() {
    if !has_python() {
        return;
    }
    for (wrong, words) in [
        (
            "io._said['set']['button'] = 1",
            "sets \"button\", which is no signal of the logic",
        ),
        ("io._said['set']['pump'] = 0.5", "sets pump to 0.5"),
        ("raise SystemExit(7)", "ended with exit status: 7"),
        ("print('hello', flush=True)", "it says \"hello\""),
    ] {
        let last = "    if io[\"button\"]:";
        let counts =
            format!("    if asked == 40 and io.hello['starts'] == 1:\n        {wrong}\n{last}");
        let bench = machine(&LOGIC.replace(last, &counts), "on_loss = \"go-on\"");
        let program = bench.file("program.ngc", PROGRAM);
        let run = run_with(bench.path(), &program, &[]);
        assert_eq!(run.status(), 0, "{wrong}: {}", run.stderr());
        assert!(run.stderr().contains(words), "{wrong}: {}", run.stderr());
        let pump = course(&run.out, 2);
        let lost = pump
            .iter()
            .filter(|(_, value, lost)| *lost && *value == 0.0)
            .count();
        // Lost where it was wrong, until the next question found it again.
        assert!((8..=17).contains(&lost), "{wrong}: {lost}");
    }
}

#[test]
fn logic_that_cannot_begin_starts_no_cell() {
    if !has_python() {
        return;
    }
    for (command, words) in [
        ("\"./is-not-there\"", "is-not-there"),
        (
            "\"python3\", \"-c\", \"print('no')\"",
            "its first line is \"no\"",
        ),
        ("\"false\"", "ended with exit status: 1"),
    ] {
        let bench = machine(LOGIC, "");
        let file = bench.path().join("machine.toml");
        let text = fs::read_to_string(&file).expect("machine.toml");
        bench.file(
            "machine.toml",
            &text.replace("\"python3\", \"./logic.py\"", command),
        );
        let program = bench.file("program.ngc", PROGRAM);
        let run = run_with(bench.path(), &program, &[]);
        assert_eq!(run.status(), 3, "{command}: {}", run.stderr());
        assert!(run.stderr().contains(words), "{command}: {}", run.stderr());
    }
}

/// In realtime: hung logic is late, lost and started again; nothing is resumed meanwhile.
#[test]
fn logic_that_hangs_is_lost_after_its_deadline_and_started_again() {
    if !has_python() {
        return;
    }
    let hangs = "    asked += 1\n    if io['button'] and io.hello['starts'] == 1:\n        import time\n        time.sleep(1000)";
    let bench = machine(&LOGIC.replace("    asked += 1", hangs), "deadline_ms = 500");
    let mut cell = LiveCell::up(bench.path(), "realtime");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    let program = bench.file("program.ngc", &crate::support::endless_program());
    obeyed(&cell, &["load", &program.display().to_string()]);
    obeyed(&cell, &["start"]);
    cell.wait_for(|now| now.window.sequence > 4);
    obeyed(&cell, &["signal", "set", "button", "on"]);
    let now = cell.wait_for(|now| now.hold == 1);
    assert_eq!(
        (now.mode, now.cause),
        (Mode::Enabled as u32, Cause::None as u32)
    );
    // The one that was started again inhibits as long as the button is on.
    refused(&cell, &["resume"], "logic");
    obeyed(&cell, &["signal", "set", "button", "off"]);
    let again = || {
        let resumed = crate::up::ask(&cell, &["resume"]);
        resumed.status == 0
    };
    assert!((0..100).any(|_| again() || {
        std::thread::sleep(std::time::Duration::from_millis(50));
        false
    }));
    obeyed(&cell, &["down"]);
    cell.finish();
}

/// M-codes that a logic does: what it did stands in a file beside it, a line each.
const CODES: &str = r#"
[[signal]]
name = "code"
kind = "int"
from = { state = "m-code" }
[[signal]]
name = "code_p"
kind = "float"
from = { state = "m-code-p" }
[[signal]]
name = "code_call"
kind = "float"
from = { state = "m-code-call" }
[[signal]]
name = "did"
kind = "float"
keeps = true
from = { by = "logic" }
[[signal]]
name = "done"
from = { by = "logic" }
[functions.m_codes]
numbers = [110, 111]
done = "done"
patience_s = 5
"#;

const CLAMP: &str = r#"
import quadrant_logic

begun = None

def update(io):
    global begun
    code = io["code"]
    if code == 0:
        io["done"] = False
        begun = None
        return
    if io["did"] == io["code_call"]:
        io["done"] = True
        return
    if begun is None:
        begun = io.time_s
    if io.time_s - begun >= 0.2:
        with open("did.txt", "a") as file:
            file.write(f"{code:.0f} {io['code_p']:g}\n")
        io["did"] = io["code_call"]

quadrant_logic.run(update)
"#;

const CLAMPED: &str = "G21 G90 G17 G94\nM110 P2.5\nG1 X5 F3000\nM111\nM110\nG1 X0\nM2\n";

#[test]
fn an_m_code_is_done_by_the_logic_once_in_its_order_and_the_program_waits_for_it() {
    if !has_python() {
        return;
    }
    let name = "name = \"xy\"\n";
    let table = "[logic]\ncommand = [\"python3\", \"./logic.py\"]\non_loss = \"go-on\"\n";
    let bench = Bench::of("xy", &[(name, &format!("{name}{CODES}{table}"))]);
    let folder = bench.path().display().to_string();
    let clamp = CLAMP.replace("did.txt", &format!("{folder}/did.txt"));
    bench.file("logic.py", &clamp);
    let did = || {
        let did = fs::read_to_string(bench.path().join("did.txt")).unwrap_or_default();
        let _ = fs::remove_file(bench.path().join("did.txt"));
        did
    };
    let program = bench.file("program.ngc", CLAMPED);
    let all = "110 2.5\n111 -1\n110 -1\n";
    let run = run_with(bench.path(), &program, &[]);
    assert_eq!(run.status(), 0, "{}", run.stderr());
    assert_eq!(did(), all);
    // 0.2 s each and some questions: so long the code is shown.
    let shown = course(&run.out, 0);
    let scans = shown.iter().filter(|(_, code, _)| *code != 0.0).count();
    assert!((600..750).contains(&scans), "{scans}");
    // The logic, the planner or the master is killed while one is under way.
    for (process, scans) in [
        ("logic", [150, 260, 700]),
        ("planner", [150, 290, 700]),
        ("plant-sim", [150, 300, 720]),
    ] {
        for scan in scans {
            let faults = format!(
                "[restart]\nplanner = \"resume\"\nmaster = \"wait\"\n[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"{process}\"\ndo = \"kill\"\nrestart_after_scans = 40\n"
            );
            let faults = bench.file("faults.toml", &faults).display().to_string();
            let orders = "[[order]]\nscan = 1200\norder = \"enable\"\n[[order]]\nscan = 1500\norder = \"resume\"\n";
            let orders = bench.file("orders.toml", orders).display().to_string();
            let run = run_with(
                bench.path(),
                &program,
                &["--faults", &faults, "--orders", &orders],
            );
            assert_eq!(run.status(), 0, "{process} {scan}: {}", run.stderr());
            assert_eq!(did(), all, "{process} {scan}");
        }
    }
    // Nobody does it.
    bench.file("logic.py", &clamp.replace("io[\"done\"] = True", "pass"));
    let run = run_with(bench.path(), &program, &[]);
    assert_eq!(run.status(), 1, "{}", run.stderr());
    let report = run.report();
    let reason = report["outcome"]["reason"].as_str().expect("a reason");
    assert!(
        reason.contains("the machine did not do an M-code in time"),
        "{reason}"
    );
}

#[test]
fn m_codes_of_the_machine_are_refused_where_they_mean_nothing() {
    let name = "name = \"xy\"\n";
    let table = "[logic]\ncommand = [\"python3\", \"./logic.py\"]\n";
    for (what, by, right) in [
        (
            "done = \"done\"\npatience_s",
            "done = \"code\"\npatience_s",
            "must be a switch",
        ),
        (
            "state = \"m-code\" }",
            "state = \"mist\" }",
            "that shows what is to be done",
        ),
        ("[110, 111]", "[99]", "100"),
    ] {
        assert!(CODES.contains(what), "{what}");
        let codes = CODES.replace(what, by);
        let bench = Bench::of("xy", &[(name, &format!("{name}{codes}{table}"))]);
        bench.file("logic.py", CLAMP);
        let program = bench.file("program.ngc", CLAMPED);
        let run = run_with(bench.path(), &program, &[]);
        assert_eq!(run.status(), 2, "{by}: {}", run.stderr());
        assert!(run.stderr().contains(right), "{by}: {}", run.stderr());
    }
    let bench = Bench::of("xy", &[(name, &format!("{name}{CODES}{table}"))]);
    bench.file("logic.py", CLAMP);
    for (block, right) in [("M110 Q3", "has no Q"), ("M120", "[functions.m_codes]")] {
        let program = bench.file("program.ngc", &format!("{block}\nM2\n"));
        let run = run_with(bench.path(), &program, &[]);
        assert_eq!(run.status(), 2, "{block}: {}", run.stderr());
        assert!(run.stderr().contains(right), "{block}: {}", run.stderr());
    }
}

/// What it remembers outlives it: a logic that says nothing when it is started again finds what it has said before.
#[test]
fn a_signal_that_keeps_its_value_goes_on_with_it_under_the_next_logic() {
    if !has_python() {
        return;
    }
    let signals_of_it = "on_loss = \"go-on\"\n\
        [[signal]]\nname = \"kept\"\nkind = \"int\"\nkeeps = true\nfrom = { by = \"logic\" }\n\
        [[signal]]\nname = \"plain\"\nkind = \"int\"\nfrom = { by = \"logic\" }\n\
        [[signal]]\nname = \"seen\"\nkind = \"int\"\nfrom = { by = \"logic\" }";
    // It says each once in its life, and from its second start on shows what it finds.
    let once = "import quadrant_logic\n\
        def update(io):\n\
        \x20   if io.machine['scan'] < 500 and io['kept'] == 0:\n\
        \x20       io['kept'] = 7\n\
        \x20       io['plain'] = 5\n\
        \x20   if io.machine['scan'] > 1000:\n\
        \x20       io['seen'] = io['kept']\n\
        quadrant_logic.run(update)\n";
    let bench = machine(once, signals_of_it);
    let program = bench.file("p.ngc", "G21 G90\nG1 X20 F600\nM2\n");
    let faults = "[[fault]]\nat = { scan = 700 }\nprocess = \"logic\"\ndo = \"kill\"\nrestart_after_scans = 100\n";
    let faults = bench.file("faults.toml", faults).display().to_string();
    let run = run_with(bench.path(), program, &["--faults", &faults]);
    assert_eq!(run.status(), 0, "{}", run.stderr());
    let loaded = Machine::load(bench.path()).expect("the machine");
    let course = signals(&run.out, &loaded);
    let at = |name: &str, scan: u64| {
        let found = course.iter().find(|(at, _)| *at == scan);
        found.expect("a scan").1[name]
    };
    let kept: BTreeSet<u64> = course
        .iter()
        .skip(20)
        .map(|(_, now)| now["kept"] as u64)
        .collect();
    assert_eq!(kept, BTreeSet::from([7]));
    assert_eq!(
        (at("plain", 600), at("plain", 900), at("seen", 1500)),
        (5.0, 0.0, 7.0)
    );
    let events = fs::read_to_string(run.out.join("events.jsonl")).expect("events");
    assert!(
        events.contains("the machine's own logic was lost"),
        "{events}"
    );
}

/// One that never answers holds the program, trips the machine or lets it go on, as the machine file says.
#[test]
fn a_logic_that_never_answers_is_lost_from_the_start() {
    if !has_python() {
        return;
    }
    let program = "G21 G90\nG1 X20 F6000\nM2\n";
    for (on_loss, moved) in [("hold", false), ("trip", false), ("go-on", true)] {
        let broken = "import quadrant_logic\nquadrant_logic.run(lambda io: io['no such signal'])\n";
        let bench = machine(broken, &format!("on_loss = \"{on_loss}\""));
        let program = bench.file("p.ngc", program);
        let stop = bench.file("stop.toml", "[[order]]\nscan = 6000\norder = \"stop\"\n");
        let stop = stop.display().to_string();
        let run = run_with(bench.path(), program, &["--orders", &stop]);
        // What was planned before its first answer is late comes to rest within a window.
        let moves = moves(&run.out).len();
        assert_eq!(moves > 200, moved, "{on_loss}: {moves} {}", run.stderr());
        assert_eq!(run.status() == 0, moved, "{on_loss}: {}", run.stderr());
        let events = fs::read_to_string(run.out.join("events.jsonl")).expect("events");
        assert!(
            events.contains("logic-lost") || moved,
            "{on_loss}: {events}"
        );
        let holds = events.contains("the machine's own logic did not answer");
        assert_eq!(holds, on_loss == "hold", "{on_loss}: {events}");
    }
}
