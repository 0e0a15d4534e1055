//! Motions by hand over a bus: the command is exact in every scan, whatever loop the drives close.
//!
//! `CLICKS=100 cargo test --release --test ethercat -- by_hand --nocapture` for many.

use std::fmt::Write as _;
use std::fs;

use plant_sim::script::rng::Rng;

use crate::segment::{Network, machine};
use crate::support::{text, unique_cell};

/// The first click, the time that each has, and the scan that is shown first.
const FIRST: u64 = 1_500;
const EVERY: u64 = 700;
const SHOWN: u64 = 1_400;
const AXES: [&str; 3] = ["X", "Y", "Z"];

/// An increment of an axis: its scan and its way, in nm.
struct Click {
    scan: u64,
    axis: usize,
    way_nm: i64,
}

/// Clicks of any size both ways; a third of them while one of another axis is under way.
fn clicks(count: u64) -> Vec<Click> {
    let mut random = Rng::new(7);
    let mut scan = FIRST;
    let (mut last_axis, mut rested) = (0, [0; 3]);
    let mut clicks = Vec::new();
    for _ in 0..count {
        let beside = !clicks.is_empty() && random.one_in(3);
        let step = if beside {
            random.within(1, 2)
        } else {
            random.below(3)
        };
        let axis = (last_axis + step as usize) % 3;
        scan += if beside { 60 } else { EVERY };
        // Each from rest: one on top of another may be more than is taken.
        scan = scan.max(rested[axis]);
        rested[axis] = scan + EVERY;
        let size_nm = 10f64.powf(random.between(3.0, 6.6)).round() as i64;
        let way_nm = if random.one_in(2) { size_nm } else { -size_nm };
        clicks.push(Click { scan, axis, way_nm });
        last_axis = axis;
    }
    clicks
}

/// A run in which a program is held from its start, and resumed behind the last click.
fn orders(clicks: &[Click], end: u64) -> String {
    let mut orders = "[[order]]\nscan = 900\norder = \"hold\"\n".to_string();
    for click in clicks {
        let (scan, axis, value) = (click.scan, AXES[click.axis], click.way_nm as f64 / 1e6);
        writeln!(
            orders,
            "[[order]]\nscan = {scan}\norder = \"jog\"\naxis = \"{axis}\"\nvalue = {value:.6}"
        )
        .expect("a text");
    }
    orders + &format!("[[order]]\nscan = {end}\norder = \"resume\"\n")
}

/// Command positions of a run, in nm, from [`SHOWN`] to this scan.
fn commands(network: &Network, run: &str, end: u64) -> Vec<[i64; 3]> {
    let (trigger, after) = (
        format!("scan {SHOWN}"),
        format!("{} scans", end - SHOWN + 1),
    );
    let scope = network.quadrant(&[
        "scope",
        "--log",
        run,
        "--signal",
        "X.command,Y.command,Z.command",
        "--trigger",
        &trigger,
        "--before",
        "0 scans",
        "--after",
        &after,
        "--csv",
        "-",
    ]);
    let errors = String::from_utf8_lossy(&scope.stderr);
    assert!(scope.status.success(), "{errors}");
    let table = String::from_utf8_lossy(&scope.stdout).into_owned();
    let head: Vec<&str> = table.lines().next().expect("a head").split(',').collect();
    let column = |name: &str| head.iter().position(|of| *of == name).expect("a column");
    let places = AXES.map(|axis| column(&format!("{axis}.command_mm")));
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        places.map(|at| (cells[at].parse::<f64>().expect("a place") * 1e6).round() as i64)
    };
    table.lines().skip(1).map(row).collect()
}

#[test]
fn clicks_are_exact_in_every_scan_whatever_loop_the_drives_close() {
    let Some(network) = Network::new() else {
        return;
    };
    let count = std::env::var("CLICKS").map_or(12, |count| count.parse().expect("CLICKS"));
    let clicks = clicks(count);
    let end = clicks.last().expect("a click").scan + EVERY;
    for (mode, operate, more) in [
        ("velocity", "csv", &[][..]),
        (
            "position",
            "csp",
            &[("advance_ms = 3.5", "advance_ms = 1.0")],
        ),
        ("torque", "cst", &[]),
    ] {
        let segment = network.segment(&["--drives", "3"]);
        let (drive_mode, operates) = (
            format!("drive_mode = \"{mode}\""),
            format!("operate = \"{operate}\""),
        );
        let mut edits = vec![("drive_mode = \"velocity\"", drive_mode.as_str())];
        edits.extend(more);
        let machine = machine(&edits, &[("operate = \"csv\"", &operates)]);
        let path = |name: &str| machine.path().join(name).display().to_string();
        let (program, script, out) = (path("wait.ngc"), path("clicks.toml"), path("run"));
        fs::write(&program, "G4 P2\nM2\n").expect("writing");
        fs::write(&script, orders(&clicks, end)).expect("writing");
        let folder = machine.path().display().to_string();
        let cell = unique_cell();
        let run = network.quadrant(&[
            "run", &folder, &program, "--orders", &script, "--out", &out, "--cell", &cell,
        ]);
        let printed = String::from_utf8_lossy(&run.stderr);
        assert!(run.status.success(), "{operate}: {printed}");
        let report = fs::read_to_string(path("run/report.json")).expect("a report");
        let report = serde_json::from_str(&report).expect("JSON");
        assert_eq!(text(&report, "/outcome/kind"), "completed", "{operate}");
        let rows = commands(&network, &out, end);
        assert_eq!(rows.len() as u64, end - SHOWN + 1, "{operate}");
        let (mut at, mut next, mut before) = (rows[0], clicks.iter().peekable(), rows[0]);
        for (scan, row) in (SHOWN..).zip(&rows) {
            while let Some(click) = next.next_if(|click| click.scan < scan) {
                at[click.axis] += click.way_nm;
            }
            for axis in 0..3 {
                // Towards where it is to end, never past it.
                let (left, step) = (at[axis] - row[axis], row[axis] - before[axis]);
                let good = left.signum() * step.signum() >= 0
                    && (left != 0 || step * (at[axis] - before[axis]) >= 0);
                assert!(
                    good,
                    "{operate}, {} in scan {scan}: {left} nm left, {step} gone",
                    AXES[axis]
                );
            }
            before = *row;
        }
        assert_eq!(rows.last(), Some(&at), "{operate}");
        println!("{operate}: {count} clicks, {} scans: exact", rows.len());
        drop(segment);
    }
}
