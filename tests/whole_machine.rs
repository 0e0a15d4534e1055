//! `machines/xyz-cell`: a part with tool changes, its logic killed in the middle of them.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use bus::sample::Mode;
use machine::Machine;
use monitor::log::{Reader, Sample};
use serde_json::Value;

use crate::size;
use crate::support::{Bench, QUADRANT, Run, has_python, root, run_with};

/// The machine, with its logic where it lies.
fn machine() -> Bench {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let from = root().join("machines/xyz-cell");
    let bench = Bench { folder };
    for name in ["machine.toml", "plant.toml"] {
        let text = fs::read_to_string(from.join(name)).expect("a file of xyz-cell");
        let logic = from.join("logic.py").display().to_string();
        bench.file(name, &text.replace("./logic.py", &logic));
    }
    bench
}

fn part() -> PathBuf {
    root().join("machines/xyz-cell/programs/first-part.ngc")
}

/// The signals of each scan, by name.
pub fn signals(out: &Path, machine: &Machine) -> Vec<(u64, BTreeMap<String, f64>)> {
    let samples = Reader::open(&out.join("run.mcap")).expect("the log");
    let of_scan = |sample| match sample {
        Ok(Sample::Signals(signals)) => {
            let names = machine.signals.iter().map(|signal| signal.name.clone());
            Some((
                signals.scan,
                names.zip(signals.values().iter().copied()).collect(),
            ))
        }
        _ => None,
    };
    samples.filter_map(of_scan).collect()
}

/// Scans in which an axis is commanded to another place than in the scan before, or the spindle turns.
pub fn moves(out: &Path) -> BTreeSet<u64> {
    let samples = Reader::open(&out.join("run.mcap")).expect("the log");
    let (mut before, mut moves) = (None, BTreeSet::new());
    for sample in samples {
        let Ok(Sample::Feedback(now)) = sample else {
            continue;
        };
        let places: Vec<i64> = now
            .axes()
            .iter()
            .map(|axis| axis.command_position)
            .collect();
        let moved = before.as_ref().is_some_and(|of| *of != places);
        let turns = now.auxiliary.spindle_rpm.abs() > 1.0;
        if turns || now.mode == Mode::Enabled as u32 && moved {
            moves.insert(now.scan);
        }
        before = Some(places);
    }
    moves
}

/// No axis moves and no spindle turns while the drawbar is open or the changer is at work, and no tool is changed but for one that is wanted.
fn assert_interlocked(out: &Path, machine: &Machine, what: &str) {
    let moves = moves(out);
    assert!(moves.len() > 1000, "{what}");
    let mut tools = Vec::new();
    for (scan, now) in signals(out, machine) {
        let is_at_work =
            now["tool_clamped"] == 0.0 || now["drawbar_valve"] != 0.0 || now["arm_valve"] != 0.0;
        assert!(
            !(is_at_work && moves.contains(&scan)),
            "{what}: it moves in scan {scan}: {now:?}"
        );
        tools.push(now["spindle_tool"]);
    }
    tools.dedup();
    assert_eq!(tools, [0.0, 3.0, 0.0, 4.0, 0.0], "{what}");
}

fn motion_digest(run: &Run) -> String {
    let text = fs::read_to_string(run.out.join("report.json")).expect("a report");
    let report: Value = serde_json::from_str(&text).expect("its JSON");
    report["motion_digest"].as_str().expect("a digest").into()
}

#[test]
fn a_part_is_made_with_three_tool_changes_and_a_vice() {
    if !has_python() {
        return;
    }
    let bench = machine();
    let run = run_with(bench.path(), part(), &[]);
    assert_eq!(run.status(), 0, "{}", run.stderr());
    let loaded = Machine::load(bench.path()).expect("the machine");
    let course = signals(&run.out, &loaded);
    let mut tools: Vec<f64> = course.iter().map(|(_, now)| now["spindle_tool"]).collect();
    tools.dedup();
    assert_eq!(tools, [0.0, 3.0, 0.0, 4.0, 0.0]);
    let (_, last) = course.last().expect("a scan");
    let outputs = [
        "carousel_motor",
        "arm_valve",
        "drawbar_valve",
        "vice_valve",
        "coolant_valve",
    ];
    assert!(outputs.iter().all(|name| last[*name] == 0.0), "{last:?}");
    // The same logic in Rust does the same, where it has been built (cargo test --workspace).
    let of_quadrant = Path::new(QUADRANT.expect("a command to test"));
    let example = of_quadrant.with_file_name("examples").join("xyz_cell");
    if !example.exists() {
        println!("{} is not built: not compared", example.display());
        return;
    }
    let text = fs::read_to_string(bench.path().join("machine.toml")).expect("machine.toml");
    let line = text
        .lines()
        .find(|line| line.starts_with("command = "))
        .expect("a command");
    let rust = format!("command = [{:?}]", example.display().to_string());
    bench.file("machine.toml", &text.replace(line, &rust));
    let again = run_with(bench.path(), part(), &[]);
    assert_eq!(again.status(), 0, "{}", again.stderr());
    assert_eq!(motion_digest(&again), motion_digest(&run));
    assert_eq!(signals(&again.out, &loaded), course);
}

/// At whatever instant the logic dies: its outputs are off two scans later, the machine comes to rest, and the part is made all the same.
#[test]
fn logic_that_is_killed_at_any_instant_leaves_no_output_on_and_the_part_is_made() {
    if !has_python() {
        return;
    }
    let kills = size::number("KILLS", 6, 1000);
    let bench = machine();
    let loaded = Machine::load(bench.path()).expect("the machine");
    for kill in 0..kills {
        // Spread over the part, at every place of the logic's period.
        let scan = 60 + kill * (11_500 / kills) + kill % 8;
        let faults = format!(
            "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"logic\"\ndo = \"kill\"\nrestart_after_scans = 150\n"
        );
        let faults = bench.file("faults.toml", &faults).display().to_string();
        let orders = format!("[[order]]\nscan = {}\norder = \"resume\"\n", scan + 400);
        let orders = bench.file("orders.toml", &orders).display().to_string();
        let run = run_with(
            bench.path(),
            part(),
            &["--faults", &faults, "--orders", &orders],
        );
        assert_eq!(run.status(), 0, "kill in scan {scan}: {}", run.stderr());
        assert_interlocked(&run.out, &loaded, &format!("kill in scan {scan}"));
        for (at, now) in signals(&run.out, &loaded) {
            if !(scan + 2..scan + 140).contains(&at) {
                continue;
            }
            let outputs = [
                "carousel_motor",
                "arm_valve",
                "drawbar_valve",
                "vice_valve",
                "lube_pump",
            ];
            let on: Vec<_> = outputs.iter().filter(|name| now[**name] != 0.0).collect();
            assert!(on.is_empty(), "killed in scan {scan}, in scan {at}: {on:?}");
        }
    }
}
