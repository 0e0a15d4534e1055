//! Start-ups of a running cell that fail: frames that no longer come back, at every step of one, and processes that are killed in it.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Child;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::cells::{await_status, mode, order};
use crate::segment::{Network, Segment, machine};
use crate::support::{root, unique_cell};

/// A cell in lockstep, its drives enabled.
struct Up<'a> {
    network: &'a Network,
    segment: Segment,
    folder: tempfile::TempDir,
    cell: String,
    child: Child,
}

impl Up<'_> {
    fn new(network: &Network) -> Up<'_> {
        let segment = network.segment(&["--drives", "3"]);
        let restarts = "[restart]\nrestarts_max = 1000\n\n[scan]\n";
        let folder = machine(&[("[scan]\n", restarts)], &[]);
        let cell = unique_cell();
        let shown = |path: &Path| path.to_string_lossy().into_owned();
        let (machine, out) = (shown(folder.path()), shown(&folder.path().join("up")));
        let log = fs::File::create(folder.path().join("log")).expect("a log");
        let child = network
            .command(env!("CARGO_BIN_EXE_quadrant"))
            .args(["up", &machine, "--pace", "lockstep", "--answer-limit", "1"])
            .args(["--out", &out, "--cell", &cell])
            .current_dir(root())
            .stdout(std::process::Stdio::null())
            .stderr(log)
            .spawn()
            .expect("a cell");
        let up = Up {
            network,
            segment,
            folder,
            cell,
            child,
        };
        up.await_status("starting", |status| mode(status) == "disabled");
        up.enable();
        up
    }

    fn await_status(&self, what: &str, shows: impl Fn(&Value) -> bool) {
        await_status(self.network, &self.cell, what, shows);
    }

    /// Enables the drives; the bus is in operation then, and says so.
    fn enable(&self) {
        order(self.network, &self.cell, &["enable"]);
        self.await_status("enabling", |status| {
            let slaves = status["bus"]["slaves"].as_array();
            let operational = |slave: &Value| slave["al_state"] == "OP";
            mode(status) == "ready"
                && status["bus"]["state"] == "in operation"
                && slaves.is_some_and(|slaves| slaves.len() == 3 && slaves.iter().all(operational))
        });
    }

    /// Kills owner and standby of the bus.
    fn kill_bus_processes(&self) {
        let status = self
            .network
            .quadrant(&["status", "--json", "--cell", &self.cell]);
        let status: Value = serde_json::from_slice(&status.stdout).expect("JSON");
        for pid in bus_processes(&status) {
            crate::support::send(pid as i32, libc::SIGKILL);
        }
    }

    /// Frames that were answered and had no process data: those of start-ups.
    fn start_up_frames(&self) -> u64 {
        let status: Value = serde_json::from_str(&self.segment.order("status")).expect("JSON");
        let count = |key: &str| status[key].as_u64().expect(key);
        count("frames") - count("process_data_frames")
    }

    fn await_cut(&self) {
        let started = Instant::now();
        loop {
            let status: Value = serde_json::from_str(&self.segment.order("status")).expect("JSON");
            if status["cut"] == serde_json::json!([0]) {
                return;
            }
            let limit = Duration::from_secs(30);
            assert!(started.elapsed() < limit, "nobody starts up: {status}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// The bus is down, and what is told of it is true.
    fn await_down(&self) {
        self.await_status("failing", |status| {
            let bus = &status["bus"];
            let owner = bus["owner_pid"].as_i64();
            let cycles = [
                "in operation",
                "in operation in part",
                "out of operation",
                "without a link",
            ];
            if !cycles.contains(&bus["state"].as_str().unwrap_or_default()) {
                assert_eq!(bus["slaves"], serde_json::json!([]), "{status}");
                assert_eq!(bus["round_trip_us"], Value::Null, "{status}");
            }
            bus["state"] == "down" && owner.is_some_and(|pid| bus_processes(status).contains(&pid))
        });
        let text = self
            .network
            .quadrant(&["status", "--cell", &self.cell])
            .stdout;
        let text = String::from_utf8_lossy(&text);
        assert!(text.contains("bus down: "), "{text}");
        assert!(!text.contains("slaves in OP"), "{text}");
    }

    /// Ends the cell; what it printed.
    fn end(mut self) -> String {
        order(self.network, &self.cell, &["down"]);
        assert!(self.child.wait().expect("its end").success());
        fs::read_to_string(self.folder.path().join("log")).expect("the log")
    }
}

/// Process ids of owner and standby, that live.
pub fn bus_processes(status: &Value) -> Vec<i64> {
    let processes = status["processes"].as_array().expect("processes");
    let of_bus = |process: &&Value| {
        let name = process["process"].as_str();
        name.is_some_and(|name| name.starts_with("fieldbus"))
    };
    let of_bus = processes.iter().filter(of_bus);
    of_bus
        .filter_map(|process| process["pid"].as_i64())
        .collect()
}

/// Why start-ups failed, each once.
fn failures(log: &str) -> BTreeSet<&str> {
    let lines = log
        .lines()
        .filter_map(|line| line.split_once("WARN fieldbus"));
    let told = lines.filter_map(|(_, line)| line.split_once(": "));
    told.map(|(_, why)| why).collect()
}

#[test]
fn a_start_up_that_fails_at_any_step_and_kills_in_it_leave_a_bus_that_is_enabled_once_frames_come_back()
 {
    const CUTS: u64 = 12;
    let Some(network) = Network::new() else {
        return;
    };
    let up = Up::new(&network);
    let before = up.start_up_frames();
    up.kill_bus_processes();
    up.await_status("tripping", |status| mode(status) == "tripped");
    up.enable();
    let frames = up.start_up_frames() - before;
    for cut in 0..=CUTS {
        // The last frames ask for OP.
        up.segment
            .order(&format!("drop-after {}", (frames - 1) * cut / CUTS));
        up.kill_bus_processes();
        up.await_cut();
        for _ in 0..cut % 3 {
            up.kill_bus_processes();
        }
        up.await_down();
        up.segment.order("restore 0");
        up.enable();
    }
    let log = up.end();
    let failures = failures(&log);
    for step in ["no slave answers", "going from SAFE-OP to OP"] {
        let told = failures.iter().any(|why| why.contains(step));
        assert!(told, "{step} is not among {failures:#?}");
    }
    assert!(failures.len() >= 5, "{failures:#?}");
}
