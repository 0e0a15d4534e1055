//! A cell in realtime over drives that run by their own clock, whose program goes on for long.

use std::fs;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

use crate::cells::{await_status, mode, order};
use crate::runs::Edits;
use crate::segment::{DRIVES, Network, Segment, machine};
use crate::support::{root, unique_cell};

/// A cell that is up, its program running.
pub struct Up<'a> {
    pub network: &'a Network,
    pub segment: Segment,
    cell: String,
    child: Child,
    _folder: TempDir,
}

/// What the drives got and did.
#[derive(Debug)]
pub struct Judged {
    /// Largest step of a target from one frame to the next, in its increments: 60FF, 607A and 6071.
    pub steps: [i64; 3],
    /// Longest time between two frames with outputs, in ms.
    pub gap_ms: f64,
}

/// Whether the machine of a status has stopped by itself.
pub fn has_stopped(status: &Value) -> bool {
    ["tripped", "disabled"].contains(&mode(status))
}

/// What a status says.
pub fn status(up: &Up<'_>) -> Value {
    let shown = up
        .network
        .quadrant(&["status", "--json", "--cell", &up.cell]);
    serde_json::from_slice(&shown.stdout).unwrap_or_default()
}

impl<'a> Up<'a> {
    pub fn new(network: &'a Network, machine_edits: Edits<'_>, drive_edits: Edits<'_>) -> Up<'a> {
        let segment = network.live_segment(&["--drives", "3"]);
        let restarts = [("[scan]\n", "[restart]\nrestarts_max = 10000\n\n[scan]\n")];
        let folder = machine(&[machine_edits, &restarts].concat(), drive_edits);
        let program = folder.path().join("circles.ngc");
        let circles = "G21 G90 G17\nG1 X10 Y0 F1200\nO1 repeat [10000]\nG3 X10 Y0 I-10 J0\nO1 endrepeat\nM2\n";
        fs::write(&program, circles).expect("a program");
        let cell = unique_cell();
        let shown = |path: &Path| path.to_string_lossy().into_owned();
        let (machine, out) = (shown(folder.path()), shown(&folder.path().join("up")));
        let child = network
            .command(env!("CARGO_BIN_EXE_quadrant"))
            .args(["up", &machine, "--out", &out, "--cell", &cell])
            .current_dir(root())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("a cell");
        let up = Up {
            network,
            segment,
            cell,
            child,
            _folder: folder,
        };
        up.await_mode("starting", "disabled");
        up.order(&["enable"]);
        up.order(&["load", &shown(&program)]);
        up.await_mode("enabling", "ready");
        up.order(&["start"]);
        up.await_mode("starting the program", "enabled");
        up
    }

    pub fn order(&self, words: &[&str]) {
        order(self.network, &self.cell, words);
    }

    /// An order that may be refused; what is said then.
    pub fn ask(&self, words: &[&str]) -> Result<(), String> {
        let arguments = [words, &["--cell", &self.cell]].concat();
        let done = self.network.quadrant(&arguments);
        match done.status.success() {
            true => Ok(()),
            false => Err(String::from_utf8_lossy(&done.stderr).into_owned()),
        }
    }

    pub fn await_status(&self, what: &str, shows: impl FnMut(&Value) -> bool) {
        await_status(self.network, &self.cell, what, shows);
    }

    pub fn await_mode(&self, what: &str, wanted: &str) {
        self.await_status(what, |status| mode(status) == wanted);
    }

    /// Gives the segment an order; `link` is that of the other end of its cable.
    pub fn tell(&self, orders: &str) {
        match orders.strip_prefix("link ") {
            Some(way) => self.network.set_link(&[DRIVES, way]),
            None if orders.is_empty() => {}
            None => drop(self.segment.order(orders)),
        }
    }

    /// What the operator sees: the status in words.
    pub fn status(&self) -> String {
        let shown = self.network.quadrant(&["status", "--cell", &self.cell]);
        String::from_utf8_lossy(&shown.stdout).into_owned()
    }

    /// Waits until the status has these words, however its lines are broken.
    pub fn await_words(&self, what: &str, words: &str) {
        let started = Instant::now();
        loop {
            let status = self.status();
            let text = status.split_whitespace().collect::<Vec<_>>().join(" ");
            if text.contains(words) {
                return;
            }
            let patient = started.elapsed() < Duration::from_secs(30);
            assert!(patient, "{what}: {words:?} in vain: {status}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Enables as often as it takes; what comes back in several steps is not there at once.
    pub fn enable(&self, what: &str) {
        let started = Instant::now();
        while let Err(refused) = self.ask(&["enable"]) {
            let patient = started.elapsed() < Duration::from_secs(30);
            assert!(patient, "{what}: {refused}{}", self.status());
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Lets it go on for a while: anywhere in a circle and in a scan.
    pub fn pause(&self, number: u64) {
        std::thread::sleep(Duration::from_micros(7_919 * number % 300_000));
    }

    /// What the drives got in the last seconds.
    pub fn undisturbed(&self) -> Judged {
        std::thread::sleep(Duration::from_secs(5));
        Judged::of(&self.segment.recorded())
    }

    /// Ends it; what the drives got and did.
    pub fn end(mut self) -> Judged {
        self.order(&["down"]);
        assert!(self.child.wait().expect("its end").success());
        Judged::of(&self.segment.end())
    }
}

impl Judged {
    /// Of a record of drives that run by their own clock.
    fn of(record: &str) -> Judged {
        // Where the targets lie in what a drive gets: 60FF, 607A, 6071; its controlword is in front.
        const PLACES: [(usize, usize); 3] = [(8, 4), (4, 4), (12, 2)];
        let mut judged = Judged {
            steps: [0; 3],
            gap_ms: 0.0,
        };
        let mut before: [Option<([i64; 3], i64)>; 3] = [None; 3];
        for row in record.lines().skip(1) {
            // kind, number, frame, time, drive, AL state, outputs.
            let cells: Vec<&str> = row.split(',').collect();
            let ["frame", _, _, time, drive, _, outputs, ..] = cells[..] else {
                continue;
            };
            let (Ok(of), Ok(now_ns)) = (drive.parse::<usize>(), time.parse::<i64>()) else {
                continue;
            };
            if number(outputs, 0, 2) & 0x0F != 0x0F {
                before[of] = None;
                continue;
            }
            let targets = PLACES.map(|(from, bytes)| number(outputs, from, bytes));
            if let Some((last, then_ns)) = before[of] {
                for (most, (now, then)) in judged.steps.iter_mut().zip(targets.iter().zip(last)) {
                    *most = (*most).max((now - then).abs());
                }
                judged.gap_ms = judged.gap_ms.max((now_ns - then_ns) as f64 * 1e-6);
            }
            before[of] = Some((targets, now_ns));
        }
        judged
    }
}

/// A signed number in hex bytes, the lowest first.
fn number(hex: &str, from: usize, bytes: usize) -> i64 {
    let digits = |at: usize| hex.get(2 * at..2 * at + 2);
    let byte = |at: usize| u8::from_str_radix(digits(at)?, 16).ok();
    let read: Option<Vec<u8>> = (from..from + bytes).map(byte).collect();
    match read.as_deref() {
        Some(&[a, b]) => i16::from_le_bytes([a, b]).into(),
        Some(&[a, b, c, d]) => i32::from_le_bytes([a, b, c, d]).into(),
        _ => 0,
    }
}
