//! What can be seen of a bus: `quadrant status`, metrics and the scope, of a running cell and of its log.

use std::path::Path;

use serde_json::Value;

use crate::cells::{await_status, mode, order};
use crate::runs::circle;
use crate::segment::{Network, enabled_steps, machine};
use crate::support::{root, unique_cell};

/// The value of a metric whose labels hold these words.
fn metric(text: &str, name: &str, words: &str) -> Option<f64> {
    let of_it = |line: &&str| line.starts_with(&format!("{name}{{")) && line.contains(words);
    let line = text.lines().find(of_it)?;
    line.rsplit_once(' ')?.1.parse().ok()
}

/// Scan, round trip in µs, frames and frames missed, in each row of a table.
fn rows(table: &[u8]) -> Vec<[f64; 4]> {
    let text = String::from_utf8_lossy(table);
    let mut lines = text.lines();
    let head = lines.next().expect("a head");
    let columns: Vec<&str> = head.split(',').collect();
    let names = ["scan", "bus.round_trip_us", "bus.sent", "bus.missed"];
    let at = names.map(|name| {
        let found = columns.iter().position(|column| *column == name);
        found.unwrap_or_else(|| panic!("no {name} in {head}"))
    });
    let row = |line: &str| {
        let values: Vec<&str> = line.split(',').collect();
        at.map(|column| values[column].parse().expect(line))
    };
    lines.map(row).collect()
}

/// Every scan has a frame of its own, with a time that a cable can have.
fn are_of_a_bus(rows: &[[f64; 4]]) {
    assert!(rows.len() >= 50, "{} rows", rows.len());
    for pair in rows.windows(2) {
        let [[scan, _, sent, _], [next, round_trip_us, more, _]] = pair else {
            unreachable!("two of them");
        };
        assert_eq!((next - scan, more - sent), (1.0, 1.0), "{pair:?}");
        // In lockstep drives answer when they are done.
        assert!((1.0..10e6).contains(round_trip_us), "{pair:?}");
    }
}

/// A number in `bus` of a status.
fn count(bus: &Value, key: &str) -> u64 {
    bus[key]
        .as_u64()
        .unwrap_or_else(|| panic!("{key} of {bus}"))
}

/// `quadrant status`, as JSON and in a line.
fn is_in_the_status(network: &Network, cell: &str) {
    let status = network.quadrant(&["status", "--json", "--cell", cell]);
    let status: Value = serde_json::from_slice(&status.stdout).expect("JSON");
    let bus = &status["bus"];
    assert_eq!(bus["state"], "in operation", "{bus}");
    assert_eq!(bus["standby"], true, "{bus}");
    let processes = status["processes"].as_array().expect("processes");
    let owner = processes
        .iter()
        .find(|process| process["pid"] == bus["owner_pid"])
        .unwrap_or_else(|| panic!("nobody owns the bus: {status}"));
    let name = owner["process"].as_str().expect("a name");
    assert!(name.starts_with("fieldbus"), "{name}");
    assert!(count(bus, "frames") > count(bus, "missed") + count(bus, "short"));
    for key in ["late", "foreign", "repeated"] {
        count(bus, key);
    }
    assert!(bus["round_trip_us"].as_f64() > Some(0.0), "{bus}");
    assert_eq!(bus["clock_offset_us"], Value::Null, "{bus}");
    let slaves = bus["slaves"].as_array().expect("slaves");
    let axes: Vec<&Value> = slaves.iter().map(|slave| &slave["axis"]).collect();
    assert_eq!(axes, ["X", "Y", "Z"]);
    let text = network.quadrant(&["status", "--cell", cell]).stdout;
    let text = String::from_utf8_lossy(&text);
    let words = "bus in operation, 3 of 3 slaves in OP, round trip ";
    assert!(text.contains(words), "{text}");
}

fn is_in_the_metrics(network: &Network) {
    let scraped = network.get("http://127.0.0.1:7823/metrics");
    let value = |name: &str, words: &str| metric(&scraped, name, words);
    let complete = value("quadrant_bus_cycles_total", "outcome=\"complete\"");
    assert!(complete > Some(0.0), "{scraped}");
    assert!(value("quadrant_bus_stray_frames_total", "kind=\"foreign\"").is_some());
    let operational = value("quadrant_bus_slaves_operational", "cell=");
    assert_eq!(operational, Some(3.0), "{scraped}");
    let round_trip_s = value("quadrant_bus_round_trip_seconds", "cell=");
    assert!(round_trip_s > Some(0.0) && round_trip_s < Some(10.0));
    assert_eq!(value("quadrant_bus_clock_offset_seconds", "cell="), None);
}

/// What `quadrant scope` shows of this cell or log.
fn is_in_the_scope(network: &Network, of: [&str; 2]) {
    let signals = "bus.round_trip,bus.sent,bus.missed";
    let mut arguments = vec!["scope", "--signal", signals];
    arguments.extend(of);
    arguments.extend(["--before", "50 scans", "--after", "50 scans", "--csv", "-"]);
    let scope = network.quadrant(&arguments);
    assert!(scope.status.success(), "{scope:?}");
    are_of_a_bus(&rows(&scope.stdout));
}

#[test]
fn what_a_bus_does_is_seen_in_status_metrics_and_scope_of_the_cell_and_of_its_log() {
    let Some(network) = Network::new() else {
        return;
    };
    network.set_link(&["lo", "up"]);
    let segment = network.segment(&["--drives", "3"]);
    let machine = machine(&[], &[]);
    let program = circle(machine.path());
    let cell = unique_cell();
    let shown = |path: &Path| path.to_string_lossy().into_owned();
    let (folder, program) = (shown(machine.path()), shown(&program));
    let out = shown(&machine.path().join("up"));
    let mut up = network
        .command(env!("CARGO_BIN_EXE_quadrant"))
        .args(["up", &folder, "--pace", "lockstep", "--metrics"])
        .args(["--out", &out, "--cell", &cell])
        .current_dir(root())
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .expect("a cell");
    await_status(&network, &cell, "starting", |status| {
        mode(status) == "disabled" && status["bus"]["slaves"][0]["al_state"] == "OP"
    });
    is_in_the_status(&network, &cell);
    is_in_the_metrics(&network);
    is_in_the_scope(&network, ["--cell", &cell]);
    order(&network, &cell, &["enable"]);
    await_status(&network, &cell, "enabling", |status| {
        mode(status) == "ready"
    });
    order(&network, &cell, &["load", &program]);
    await_status(&network, &cell, "loading", |status| {
        status["program"]["state"] == "loaded"
    });
    order(&network, &cell, &["start", "--wait"]);
    order(&network, &cell, &["down"]);
    assert!(up.wait().expect("its end").success());
    assert!(enabled_steps(&segment.end()) > 0);
    let run = shown(&machine.path().join("up/001-circle"));
    is_in_the_scope(&network, ["--log", &run]);
}
