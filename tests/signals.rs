//! Named inputs and outputs, and what the controller does with them, through real processes.

use std::path::Path;

use bus::sample::{Cause, Mode};
use monitor::log::{Reader, Sample};
use serde_json::Value;

use crate::support::{Bench, LiveCell, Run, endless_program, quadrant, run_with};
use crate::up::{obeyed, refused};

/// `xy` with these signals and functions, and contacts in its plant.
fn machine(signals: &str, contacts: &str) -> Bench {
    let name = "name = \"xy\"\n";
    let bench = Bench::of("xy", &[(name, &format!("{name}{signals}"))]);
    let plant = bench.path().join("plant.toml");
    let text = std::fs::read_to_string(&plant).expect("plant.toml");
    bench.file(
        "plant.toml",
        &text.replacen("[[axis]]", &format!("{contacts}\n[[axis]]"), 1),
    );
    bench
}

const CHAIN: &str = r#"
[[signal]]
name = "chain"
lost = 0
default = 1
from = { terminal = 3, channel = 1 }
[functions]
emergency_stop = "chain"
"#;

const LONG: &str = "G21 G90 G17 G94\nG1 X60 F3000\nG1 X-60\nM2\n";

fn ended(bench: &Bench, program: &str, more: &[&str]) -> Run {
    let program = bench.file("program.ngc", program);
    run_with(bench.path(), &program, more)
}

/// A cell that is up, its drives on, with a program.
fn loaded(bench: &Bench, program: &str) -> LiveCell {
    let mut cell = LiveCell::up(bench.path(), "lockstep");
    cell.wait_for(|_| true);
    obeyed(&cell, &["enable"]);
    let program = bench.file("program.ngc", program);
    obeyed(&cell, &["load", program.to_str().expect("a path")]);
    cell
}

#[test]
fn an_open_emergency_stop_chain_and_a_cut_wire_stop_the_machine_within_two_scans() {
    for fault in ["value = 0", "broken = true"] {
        let contact = format!("[[contact]]\nsignal = \"chain\"\n{fault}\nat_s = 0.5\n");
        let bench = machine(CHAIN, &contact);
        let run = ended(&bench, LONG, &[]);
        assert_eq!(run.status(), 1, "{}", run.stderr());
        let report = run.report();
        let reason = report["outcome"]["reason"].as_str().unwrap_or_default();
        assert!(
            reason.contains("the emergency-stop chain is open"),
            "{reason}"
        );
        // It opens in the exchange of the cell's 500th scan, which is scan 499 or 500 by its number.
        let samples = Reader::open(&run.out.join("run.mcap")).expect("the log");
        let tripped = samples.filter_map(|sample| match sample {
            Ok(Sample::Feedback(now)) if now.mode == Mode::Tripped as u32 => Some(now.scan),
            _ => None,
        });
        let first = tripped.min().expect("a trip");
        assert!((500..=502).contains(&first), "{first}");
    }
    let bench = machine(CHAIN, "");
    assert_eq!(ended(&bench, LONG, &[]).status(), 0);
}

const LIMITS: &str = r#"
[[signal]]
name = "x_plus"
default = 1
from = { drive = "X", bit = 1 }
"#;

#[test]
fn an_axis_that_hits_its_limit_switch_stops_and_goes_only_off_it_again() {
    let bench = machine(
        LIMITS,
        "[[contact]]\nsignal = \"x_plus\"\naxis = \"X\"\nfrom_mm = 40\nbounce_ms = 6\n",
    );
    let file = bench.path().join("machine.toml");
    let text = std::fs::read_to_string(&file).expect("machine.toml");
    let drive_mode = "drive_mode = \"velocity\"\n";
    let switches = format!("{drive_mode}\n[axis.limit_switches]\npositive = \"x_plus\"\n");
    bench.file("machine.toml", &text.replacen(drive_mode, &switches, 1));
    let mut cell = loaded(&bench, LONG);
    obeyed(&cell, &["start"]);
    let now = cell.wait_for(|now| now.mode == Mode::Tripped as u32 && now.rested == 1);
    assert_eq!((now.cause, now.cause_axis), (Cause::LimitSwitch as u32, 0));
    let at_mm = now.axes[0].motor_position as f64 * 1e-6;
    // At 50 mm/s and 12 m/s² it brakes within 0.11 mm, and is seen two scans late.
    assert!((40.0..40.4).contains(&at_mm), "{at_mm}");
    obeyed(&cell, &["enable"]);
    for order in [&["jog", "X", "1"][..], &["resume"], &["jog", "X+"]] {
        refused(&cell, order, "limit switch");
    }
    obeyed(&cell, &["jog", "X", "-5", "--wait"]);
    obeyed(&cell, &["jog", "X", "1", "--wait"]);
    obeyed(&cell, &["resume"]);
    // The rest of the program still goes over the switch.
    cell.wait_for(|now| now.mode == Mode::Tripped as u32);
    obeyed(&cell, &["down"]);
    cell.finish();
}

const DOOR: &str = r#"
[[signal]]
name = "door"
default = 1
from = { terminal = 3, channel = 2 }
[[signal]]
name = "part"
from = { by = "operator" }
[[signal]]
name = "start_button"
from = { terminal = 3, channel = 3 }
[[signal]]
name = "feed_knob"
kind = "float"
unit = "%"
default = 100
from = { terminal = 3, channel = 4 }
[functions]
door = "door"
ready = ["part"]
cycle_start = "start_button"
feed_override = "feed_knob"
"#;

fn signals(cell: &LiveCell) -> Value {
    let output = quadrant()
        .args(["signal", "--json", "--cell", &cell.cell])
        .output();
    let output = output.expect("quadrant signal");
    assert!(output.status.success(), "{output:?}");
    serde_json::from_slice(&output.stdout).expect("its JSON")
}

#[test]
fn a_door_holds_a_missing_part_refuses_and_a_button_starts() {
    let bench = machine(DOOR, "");
    let mut cell = loaded(&bench, LONG);
    refused(&cell, &["start"], "part");
    obeyed(&cell, &["signal", "set", "part", "on"]);
    refused(&cell, &["signal", "set", "door", "off"], "another source");
    obeyed(&cell, &["signal", "force", "feed_knob", "50"]);
    obeyed(&cell, &["signal", "force", "start_button", "on"]);
    let now = cell.wait_for(|now| now.window.sequence > 4);
    assert_eq!(now.override_percent, 50);
    obeyed(&cell, &["signal", "force", "door", "off"]);
    let now = cell.wait_for(|now| now.hold == 1 && now.rested == 1);
    assert_eq!(now.mode, Mode::Enabled as u32);
    for order in [&["resume"][..], &["jog", "X", "1"]] {
        refused(&cell, order, "door");
    }
    let shown = quadrant().args(["status", "--cell", &cell.cell]).output();
    let shown = String::from_utf8_lossy(&shown.expect("status").stdout).into_owned();
    assert!(shown.contains("a door was opened"), "{shown}");
    assert!(!shown.contains("may be moved now"), "{shown}");
    let shown = signals(&cell);
    assert_eq!(shown[0]["name"], "door");
    assert_eq!(
        (&shown[0]["value"], &shown[0]["forced"]),
        (&0.0.into(), &true.into())
    );
    obeyed(&cell, &["signal", "release", "door"]);
    obeyed(&cell, &["signal", "release", "start_button"]);
    obeyed(&cell, &["resume"]);
    cell.wait_for(|now| now.mode == Mode::Ready as u32);
    // Typed-in blocks are a program too.
    obeyed(&cell, &["signal", "force", "door", "off"]);
    refused(&cell, &["mdi", "G1 X1 F600"], "door");
    obeyed(&cell, &["signal", "release", "door"]);
    obeyed(&cell, &["signal", "set", "part", "off"]);
    refused(&cell, &["mdi", "G1 X1 F600"], "part");
    obeyed(&cell, &["down"]);
    let run = cell.finish();
    let events = events_below(&run.out);
    assert!(events.contains("a door was opened"), "{events}");
}

/// A script of orders has signals by their names, and the door holds the run in that scan on every run.
#[test]
fn a_door_is_opened_by_a_script_of_orders() {
    let bench = machine(DOOR, "");
    let order = |scan: u32, order: &str, more: &str| {
        format!("[[order]]\nscan = {scan}\norder = \"{order}\"\n{more}")
    };
    let script = [
        order(1, "signal", "signal = \"part\"\nvalue = 1\n"),
        // It was not ready when the run began.
        order(60, "resume", ""),
        order(900, "signal-force", "signal = \"door\"\nvalue = 0\n"),
        order(1400, "signal-release", "signal = \"door\"\n"),
        order(1500, "resume", ""),
    ];
    let script = bench
        .file("orders.toml", &script.concat())
        .display()
        .to_string();
    let run = ended(&bench, LONG, &["--orders", &script]);
    assert_eq!(run.status(), 0, "{}", run.stderr());
    let samples = Reader::open(&run.out.join("run.mcap")).expect("the log");
    let held = samples.filter_map(|sample| match sample {
        Ok(Sample::Feedback(now)) if now.hold == 1 && now.scan > 500 => Some(now.scan),
        _ => None,
    });
    let held: Vec<u64> = held.collect();
    let (first, last) = (held.first().expect("a hold"), held.last().expect("a hold"));
    assert!(
        (900..=903).contains(first) && (1500..=1502).contains(last),
        "{first} {last}"
    );
    let wrong = bench.file(
        "wrong.toml",
        &order(5, "signal", "signal = \"gate\"\nvalue = 1\n"),
    );
    let wrong = wrong.display().to_string();
    let refused = ended(&bench, LONG, &["--orders", &wrong]);
    assert_eq!(refused.status(), 2);
    assert!(
        refused.stderr().contains("none of this name"),
        "{}",
        refused.stderr()
    );
}

/// A running cell shows its signals to the scope, and triggers by them.
#[test]
fn a_scope_of_a_running_cell_sees_named_signals() {
    let bench = machine(DOOR, "");
    let mut cell = LiveCell::up(bench.path(), "realtime");
    cell.wait_for(|_| true);
    let scope = [
        "scope",
        "--signal",
        "signal.part,signal.feed_knob",
        "--trigger",
        "signal.part rising 0.5",
    ];
    let mut scope = quadrant()
        .args(scope)
        .args([
            "--before", "5 scans", "--after", "5 scans", "--csv", "-", "--cell", &cell.cell,
        ])
        .stdout(std::process::Stdio::piped())
        .spawn()
        .expect("a scope");
    // Until it has seen one.
    while scope.try_wait().expect("the scope").is_none() {
        obeyed(&cell, &["signal", "set", "part", "on"]);
        obeyed(&cell, &["signal", "set", "part", "off"]);
    }
    let output = scope.wait_with_output().expect("its output");
    let table = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{table}");
    let rows: Vec<&str> = table.lines().skip(1).collect();
    assert!(
        rows.iter()
            .all(|row| row.ends_with(",100") || row.contains(",100,")),
        "{table}"
    );
    assert!(rows.iter().any(|row| row.contains(",1,")), "{table}");
    obeyed(&cell, &["down"]);
    cell.finish();
}

/// A pump that a program switches, and a pressure switch that follows it.
const PUMP: &str = r#"
[[signal]]
name = "pump"
from = { output = 3 }
to = { terminal = 4, channel = 1 }
[[signal]]
name = "pressure_ok"
from = { terminal = 3, channel = 1 }
to = { input = 7 }
[[signal]]
name = "flow"
kind = "float"
unit = "l/min"
from = { terminal = 5, channel = 1 }
to = { analog_input = 2 }
"#;

#[test]
fn a_program_switches_outputs_and_reads_inputs_by_what_they_are_bound_to() {
    let contacts = "[[contact]]\nsignal = \"pressure_ok\"\nfollows = \"pump\"\non_delay_ms = 300\n\
                    [[contact]]\nsignal = \"flow\"\nfollows = \"pump\"\nvalue = 12.5\n";
    let bench = machine(PUMP, contacts);
    let program = "G21 G90\nM64 P3\nM66 P7 L3 Q2\n#1=#5399\nM66 E2 L0\n#2=#5399\nM65 P3\nM66 P7 L4 Q2\n\
                   (DEBUG,pressure #1 flow #2)\nG1 X5 F3000\nM2\n";
    let run = ended(&bench, program, &[]);
    assert_eq!(run.status(), 0, "{}", run.stderr());
    let events = std::fs::read_to_string(run.out.join("events.jsonl")).expect("events");
    assert!(
        events.contains("pressure 1.000000 flow 12.500000"),
        "{events}"
    );
}

/// The events of a cell and of all its runs.
fn events_below(folder: &Path) -> String {
    let mut events = std::fs::read_to_string(folder.join("events.jsonl")).unwrap_or_default();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.path().is_dir() {
            events += &events_below(&entry.path());
        }
    }
    events
}

const ALARMS: &str = r#"
[[signal]]
name = "air_ok"
default = 1
from = { terminal = 3, channel = 5 }
[[signal]]
name = "oil"
kind = "float"
unit = "bar"
default = 6
from = { terminal = 3, channel = 6 }
[[alarm]]
number = 700
text = "no air"
remedy = "open the main valve"
signal = "air_ok"
reaction = "hold"
[[alarm]]
number = 710
text = "oil pressure low"
signal = "oil"
below = 4.0
after_s = 0.05
reaction = "trip"
"#;

#[test]
fn an_alarm_stops_the_machine_stays_until_it_is_acknowledged_and_is_in_the_events() {
    let bench = machine(ALARMS, "");
    let mut cell = loaded(&bench, &endless_program());
    obeyed(&cell, &["start"]);
    cell.wait_for(|now| now.window.sequence > 4);
    obeyed(&cell, &["signal", "force", "air_ok", "off"]);
    cell.wait_for(|now| now.hold == 1 && now.rested == 1);
    refused(&cell, &["resume"], "alarm");
    let status = obeyed(&cell, &["status"]);
    assert!(
        status.contains("! alarm 700") && status.contains("open the main valve"),
        "{status}"
    );
    assert!(status.contains("signal air_ok is off, forced"), "{status}");
    obeyed(&cell, &["signal", "release", "air_ok"]);
    let alarms = obeyed(&cell, &["alarms"]);
    assert!(
        alarms.contains("700") && alarms.contains("over, not acknowledged"),
        "{alarms}"
    );
    refused(
        &cell,
        &["alarms", "acknowledge", "701"],
        "no alarm of this number",
    );
    obeyed(&cell, &["alarms", "acknowledge", "700"]);
    assert!(obeyed(&cell, &["alarms"]).contains("no alarm"));
    obeyed(&cell, &["resume"]);
    // Too short for its alarm, then long enough.
    obeyed(&cell, &["signal", "force", "oil", "3.5"]);
    let now = cell.wait_for(|now| now.mode == Mode::Tripped as u32 && now.rested == 1);
    assert_eq!(now.cause, Cause::MachineAlarm as u32);
    refused(&cell, &["enable"], "alarm");
    obeyed(&cell, &["signal", "release", "oil"]);
    obeyed(&cell, &["enable"]);
    // The launcher notes what it sees, some times a second.
    let mut history = String::new();
    while !history.contains("alarm 710") {
        history = obeyed(&cell, &["alarms", "history"]);
    }
    obeyed(&cell, &["down"]);
    let run = cell.finish();
    let lines: Vec<&str> = history.lines().collect();
    assert!(
        lines.len() >= 4 && lines[0].contains("alarm 700, no air"),
        "{history}"
    );
    let told = quadrant()
        .args(["alarms", "history"])
        .arg(&run.out)
        .output();
    let told = String::from_utf8(told.expect("alarms history").stdout).expect("UTF-8");
    assert!(told.starts_with(&history), "{told} {history}");
    let events = events_below(&run.out);
    for words in [
        "alarm 700, no air",
        "alarm 700, no air: acknowledged",
        "alarm 710, oil pressure low",
    ] {
        assert!(events.contains(words), "{words}: {events}");
    }
}

const WHEEL: &str = r#"
[[signal]]
name = "counts"
kind = "int"
from = { by = "operator" }
[[signal]]
name = "wheel_x"
from = { by = "operator" }
[[signal]]
name = "wheel_y"
from = { by = "operator" }
[[signal]]
name = "wheel_10"
from = { by = "operator" }
[[signal]]
name = "grip"
from = { by = "operator" }
[functions.handwheel]
counts = "counts"
counts_per_click = 4
step_mm = 0.01
times_10 = "wheel_10"
enable = "grip"
axes = { X = "wheel_x", Y = "wheel_y" }
"#;

#[test]
fn a_handwheel_moves_the_chosen_axis_click_by_click_and_nothing_else_ever() {
    let bench = machine(WHEEL, "");
    let mut cell = loaded(&bench, LONG);
    let standing = |cell: &mut LiveCell| {
        let asked = cell.wait_for(|_| true).scan;
        let now = cell.wait_for(|now| now.scan > asked + 300 && now.mode == Mode::Ready as u32);
        [0, 1].map(|axis| now.axes[axis].command_position)
    };
    let first = standing(&mut cell);
    // X and Y from where they stood, in clicks of 0.01 mm, once they stand.
    let clicks = |cell: &mut LiveCell, first: &[i64; 2]| {
        let now = standing(cell);
        [0, 1].map(|axis| {
            let way = now[axis] - first[axis];
            assert_eq!(way % 10_000, 0, "axis {axis}: {way}");
            way / 10_000
        })
    };
    let set = |cell: &LiveCell, changes: &[(&str, &str)]| {
        for (name, value) in changes {
            obeyed(cell, &["signal", "set", name, value]);
        }
    };
    for (changes, expected) in [
        // Nothing is chosen, or nobody holds it.
        (&[("counts", "40")][..], [0, 0]),
        (&[("wheel_x", "1"), ("counts", "80")], [0, 0]),
        // What it was turned before moves nothing; less than a click neither.
        (&[("grip", "1")], [0, 0]),
        (&[("counts", "100")], [5, 0]),
        (&[("counts", "103")], [5, 0]),
        (&[("counts", "104"), ("counts", "92")], [3, 0]),
        (&[("wheel_10", "1"), ("counts", "96")], [13, 0]),
        // Two axes are none.
        (&[("wheel_y", "1"), ("counts", "140")], [13, 0]),
        (&[("wheel_x", "0"), ("wheel_10", "0")], [13, 0]),
        (&[("counts", "132")], [13, -2]),
        // Over the end of its counter.
        (&[("grip", "0"), ("counts", "-8")], [13, -2]),
        (&[("grip", "1"), ("counts", "4")], [13, 1]),
    ] {
        set(&cell, changes);
        assert_eq!(clicks(&mut cell, &first), expected, "{changes:?}");
    }
    // With the drives off, and while a program runs, it moves nothing then or later.
    obeyed(&cell, &["disable"]);
    set(&cell, &[("counts", "400")]);
    obeyed(&cell, &["enable"]);
    let first = standing(&mut cell);
    set(&cell, &[("counts", "404")]);
    assert_eq!(clicks(&mut cell, &first), [0, 1]);
    obeyed(&cell, &["start"]);
    set(&cell, &[("counts", "800")]);
    let done = cell.wait_for(|now| now.mode == Mode::Ready as u32 && now.program == 4);
    let end = done.axes[1].command_position;
    set(&cell, &[("counts", "804")]);
    cell.wait_for(|now| now.axes[1].command_position == end + 10_000);
    obeyed(&cell, &["down"]);
    cell.finish();
}

const LUBE: &str = r#"
[[signal]]
name = "lube"
from = { travel = "X", every_m = 0.1, for_ms = 50 }
to = { terminal = 4, channel = 3 }
"#;

#[test]
fn a_pump_is_on_when_an_axis_moves_first_and_each_time_it_has_gone_so_far() {
    let bench = machine(LUBE, "");
    // 60 + 120 mm: with the first motion, and 100 mm later.
    let run = ended(&bench, LONG, &[]);
    assert_eq!(run.status(), 0, "{}", run.stderr());
    let samples = Reader::open(&run.out.join("run.mcap")).expect("the log");
    let (mut begins, mut before, mut on) = (0, 0.0, 0);
    for sample in samples {
        if let Ok(Sample::Signals(signals)) = sample {
            let now = signals.values[0];
            begins += u32::from(now > before);
            on += u32::from(now == 1.0);
            before = now;
        }
    }
    assert_eq!((begins, on), (2, 100));
}
