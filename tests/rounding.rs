//! G64 through the real processes, and in what `quadrant plan --csv` writes: within the tolerance, both ways, and faster.

use std::path::{Path, PathBuf};

use crate::support::{Bench, number, planned, run, run_with};

type Point = [f64; 2];

/// Axes that kinks slow down.
const SOFT: (&str, &str) = ("acceleration_mm_s2 = 5000.0", "acceleration_mm_s2 = 1000.0");

/// A curve in chords, corners, and back to the start.
fn points() -> Vec<Point> {
    let chords = (0..240).map(|index| {
        let angle = f64::from(index) * 0.03;
        let radius = 8.0 + angle;
        [radius * angle.cos() - 8.0, radius * angle.sin()]
    });
    let corners = [
        [20.0, 20.0],
        [-20.0, 20.0],
        [-20.0, -5.0],
        [-19.8, -5.0],
        [0.0, 0.0],
    ];
    chords.chain(corners).collect()
}

fn program(bench: &Bench, mode: &str) -> PathBuf {
    let mut text = format!("G21 G17 G90 G94 {mode}\nG1 F6000\n");
    for [x, y] in points() {
        text += &format!("X{x:.4} Y{y:.4}\n");
    }
    bench.file(&format!("{}.ngc", mode.replace(' ', "-")), &(text + "M2\n"))
}

fn setpoints(machine: &Path, program: &Path) -> Vec<Point> {
    let rows = planned(machine, program);
    rows.iter().map(|row| [row[5], row[6]]).collect()
}

/// Distance of a point from a polyline.
fn distance_mm(point: Point, line: &[Point]) -> f64 {
    let of_chord = |ends: &[Point]| {
        let (along, to) = (
            [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]],
            [point[0] - ends[0][0], point[1] - ends[0][1]],
        );
        let squared = along[0] * along[0] + along[1] * along[1];
        let share = (to[0] * along[0] + to[1] * along[1]) / squared;
        let share = if squared > 0.0 {
            share.clamp(0.0, 1.0)
        } else {
            0.0
        };
        (to[0] - share * along[0]).hypot(to[1] - share * along[1])
    };
    line.windows(2).map(of_chord).fold(f64::INFINITY, f64::min)
}

fn furthest_mm(points: &[Point], line: &[Point]) -> f64 {
    points
        .iter()
        .map(|point| distance_mm(*point, line))
        .fold(0.0, f64::max)
}

#[test]
fn a_rounded_path_is_within_its_tolerance_both_ways_and_faster() {
    let bench = Bench::of("xy", &[SOFT]);
    let programmed = points();
    let exact = setpoints(bench.path(), &program(&bench, "G61"));
    for tolerance_mm in [0.01, 0.05] {
        let mode = format!("G64 P{tolerance_mm}");
        let rounded = setpoints(bench.path(), &program(&bench, &mode));
        // The chord between two setpoints at 100 mm/s cuts a corner of this radius by less than 1 µm.
        let allowed_mm = tolerance_mm + 1e-3;
        assert!(furthest_mm(&rounded, &programmed) <= tolerance_mm + 1e-6);
        assert!(furthest_mm(&programmed, &rounded) <= allowed_mm);
        assert!(furthest_mm(&rounded, &programmed) > 0.9 * tolerance_mm);
        assert_eq!(rounded.last(), programmed.last());
        assert!(
            rounded.len() * 10 < exact.len() * 7,
            "{} and {}",
            rounded.len(),
            exact.len()
        );
    }
    // G64 without P: what the machine file says.
    let table = "[path]\ntolerance_mm = 0.01\n\n[scan]";
    let by_machine = Bench::of("xy", &[SOFT, ("[scan]", table)]);
    let said = setpoints(bench.path(), &program(&bench, "G64 P0.01"));
    assert_eq!(
        setpoints(by_machine.path(), &program(&by_machine, "G64")),
        said
    );
    assert_eq!(setpoints(bench.path(), &program(&bench, "G64")), exact);
}

#[test]
fn a_rounded_program_runs_to_its_end_whoever_is_killed_and_the_same_every_time() {
    let bench = Bench::of("xy", &[]);
    let program = program(&bench, "G64 P0.02");
    let undisturbed = run(bench.path(), &program).good_report();
    let kills = "[restart]\nrestarts_max = 100\nplanner = \"resume\"\n\
                 [[fault]]\nat = { scan = 150 }\nprocess = \"planner\"\ndo = \"kill\"\nrestart_after_scans = 40\n\
                 repeat = { times = 4, every_scans = 431 }\n";
    let faults = bench.file("faults.toml", kills).display().to_string();
    let reports = [0; 2].map(|_| run_with(bench.path(), &program, &["--faults", &faults]).report());
    assert_eq!(reports[0]["motion_digest"], reports[1]["motion_digest"]);
    for report in reports.iter().chain([&undisturbed]) {
        assert_eq!(report["outcome"]["kind"], "completed", "{report:#}");
        let contour_um = number(report, "/contour_error_um/peak");
        assert!(contour_um < 20.0 + 30.0, "{contour_um}");
    }
}
