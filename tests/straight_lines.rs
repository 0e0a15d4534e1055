//! Straight lines by a master axis, through the real processes and in what `quadrant plan --csv` writes.

use std::fs;
use std::path::Path;

use crate::size;
use crate::support::{Bench, number, quadrant, run};

/// Points in program coordinates, in mm: every axis master once, either sign, awkward slopes, a line of one axis.
const POINTS: [[f64; 3]; 9] = [
    [30.0, -7.1, 11.3],
    [-41.237, 12.345, 3.001],
    [-40.0, -33.333, 18.0],
    [-40.013, -33.0, -29.999],
    [17.0, 61.803, -29.0],
    [17.0, 61.803, 40.0],
    [16.999, 61.801, 39.993],
    [-3.0, 20.0, 1.0],
    [0.0, 0.0, 0.0],
];
/// Work offset of `machines/xyz-mill`.
const OFFSET_MM: [f64; 3] = [250.0, 200.0, -100.0];

fn bench(straight_lines: &str) -> Bench {
    let table = format!("[interpolation]\nstraight_lines = \"{straight_lines}\"\n\n[scan]");
    Bench::of("xyz-mill", &[("[scan]", &table)])
}

/// Each point on a line of its own, from line 2 on, with a wait after it.
fn program() -> String {
    let mut text = String::from("G21 G17 G90 G94 F4000\n");
    for (index, [x, y, z]) in POINTS.iter().enumerate() {
        let motion = if index % 3 == 0 { "G0" } else { "G1" };
        text += &format!("{motion} X{x} Y{y} Z{z}\nG4 P0.02\n");
    }
    text + "M2\n"
}

struct CsvRow {
    line: usize,
    nm: [i128; 3],
}

fn setpoints(machine: &Path, program: &Path) -> Vec<CsvRow> {
    let csv = machine.join("setpoints.csv");
    let output = quadrant()
        .arg("plan")
        .args([machine, program])
        .arg("--csv")
        .arg(&csv)
        .output()
        .expect("plan");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    let text = fs::read_to_string(&csv).expect("the setpoints");
    let setpoint = |line: &str| {
        let columns: Vec<&str> = line.split(',').collect();
        let nm = |column: usize| {
            let mm: f64 = columns[column].parse().expect("a position");
            (mm * 1e6).round() as i128
        };
        CsvRow {
            line: columns[1].parse().expect("a line"),
            nm: [nm(5), nm(6), nm(7)],
        }
    };
    text.lines().skip(1).map(setpoint).collect()
}

fn end_nm(point: usize) -> [i128; 3] {
    let mm = |axis: usize| POINTS[point][axis] + OFFSET_MM[axis];
    std::array::from_fn(|axis| (mm(axis) * 1e6).round() as i128)
}

#[test]
fn every_row_of_a_line_is_within_an_increment_of_it_and_it_ends_exactly() {
    let bench = bench("master-axis");
    let file = bench.file("lines.ngc", &program());
    let setpoints = setpoints(bench.path(), &file);
    let mut judged = 0;
    for setpoint in &setpoints {
        let (point, waits) = ((setpoint.line - 2) / 2, setpoint.line % 2 == 1);
        let to = end_nm(point);
        if waits {
            assert_eq!(setpoint.nm, to, "line {}", setpoint.line);
            continue;
        }
        let from = if point == 0 {
            setpoints[0].nm
        } else {
            end_nm(point - 1)
        };
        let master = (0..3)
            .max_by_key(|axis| ((to[*axis] - from[*axis]).abs(), 3 - axis))
            .expect("an axis");
        let whole = to[master] - from[master];
        for axis in 0..3 {
            let travel = to[axis] - from[axis];
            let off = (setpoint.nm[axis] - from[axis]) * whole
                - (setpoint.nm[master] - from[master]) * travel;
            assert!(
                off.abs() < whole.abs(),
                "line {}, axis {axis}: {} nm off",
                setpoint.line,
                off as f64 / whole as f64
            );
        }
        judged += 1;
    }
    assert!(judged > 3000, "{judged} setpoints on lines");
    assert_eq!(
        setpoints.last().expect("setpoints").nm,
        end_nm(POINTS.len() - 1)
    );
}

#[test]
fn both_ways_of_making_lines_are_told_apart_only_by_increments() {
    let (master, rounded) = (bench("master-axis"), bench("rounded"));
    let of = |bench: &Bench| setpoints(bench.path(), &bench.file("lines.ngc", &program()));
    let (master, rounded) = (of(&master), of(&rounded));
    let mut differ = 0;
    // Limits less a different rounding make the speeds differ by a hair, so setpoints drift apart in time; ends do not.
    for point in 0..POINTS.len() {
        let first_wait = |setpoints: &[CsvRow]| {
            let wait = setpoints
                .iter()
                .find(|setpoint| setpoint.line == 2 * point + 3);
            wait.map(|setpoint| setpoint.nm)
        };
        assert_eq!(first_wait(&master), first_wait(&rounded));
    }
    for (a, b) in master.iter().zip(&rounded) {
        differ += usize::from(a.nm != b.nm);
    }
    assert!(
        differ > 1000,
        "only {differ} setpoints differ: is the setting used?"
    );
}

#[test]
fn a_machine_with_a_master_axis_runs_its_lines_to_the_end() {
    let bench = bench("master-axis");
    let file = bench.file("lines.ngc", &program());
    let report = run(bench.path(), &file).good_report();
    assert_eq!(number(&report, "/limits/velocity_exceeded"), 0.0);
    assert_eq!(number(&report, "/limits/acceleration_exceeded"), 0.0);
    assert_eq!(number(&report, "/limits/travel_exceeded"), 0.0);
    if size::is_left_out() {
        return;
    }
    let helix = "machines/xyz-mill/programs/pocket-3d.ngc";
    let report = run(bench.path(), crate::support::root().join(helix)).good_report();
    assert_eq!(number(&report, "/limits/acceleration_exceeded"), 0.0);
}
