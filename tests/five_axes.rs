//! Five axes: the tip of the tool keeps to the programmed path within its tolerance at every scan, on a table and with a head, by
//! formulas of their own; whoever dies meanwhile.

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::{Bench, quadrant, root, run, run_with};

/// Program zero, length of tool 1.
const ZERO_MM: [(&str, f64); 2] = [("xyzac-trunnion", -300.0), ("xyzbc-head", -250.0)];
const TOOL_MM: f64 = 60.0;
/// Height of the lines of A and C above program zero, and of those of B and C above the face of the spindle.
const TABLE_MM: f64 = -50.0;
const PIVOT_MM: f64 = 120.0;

type Place = [f64; 5];

/// The tip on the work, and the rotary axes, for a place of the axes: by the equations of each machine, not by turns about lines.
fn tip(machine: &str, axes: &Place) -> Place {
    let [x, y, z, first, second] = *axes;
    let (sin, cos) = first.to_radians().sin_cos();
    let (sin_c, cos_c) = second.to_radians().sin_cos();
    if machine == "xyzac-trunnion" {
        // Seen from the table, the spindle turns about A and then about C.
        let (y, z) = (y, z + 300.0 - TOOL_MM - TABLE_MM);
        let (y, z) = (cos * y - sin * z, sin * y + cos * z);
        return [
            cos_c * x - sin_c * y,
            sin_c * x + cos_c * y,
            z + TABLE_MM,
            first,
            second,
        ];
    }
    let long = PIVOT_MM + TOOL_MM;
    [
        x - long * sin * cos_c,
        y - long * sin * sin_c,
        z + 250.0 + PIVOT_MM - long * cos,
        first,
        second,
    ]
}

/// Setpoints of a program, as `plan` writes them.
fn setpoints(machine: &Path, program: &Path, folder: &Path) -> Vec<Place> {
    let csv = folder.join("setpoints.csv");
    let output = quadrant()
        .arg("plan")
        .args([machine, program])
        .arg("--csv")
        .arg(&csv)
        .output();
    let output = output.expect("plan");
    let said = String::from_utf8_lossy(&output.stderr);
    // An exceeded limit is exit status 1.
    assert_eq!(
        output.status.code(),
        Some(0),
        "{}: {said}",
        program.display()
    );
    let text = fs::read_to_string(&csv).expect("the setpoints");
    let rows = text.lines().skip(1).map(|line| {
        let numbers: Vec<f64> = line
            .split(',')
            .skip(5)
            .take(5)
            .map(|value| value.parse().expect("a position"))
            .collect();
        numbers.try_into().expect("five axes")
    });
    rows.collect()
}

/// How far a place is from a line, in mm.
fn off_line(place: &Place, from: &Place, to: &Place) -> f64 {
    let along: Vec<f64> = (0..3).map(|axis| to[axis] - from[axis]).collect();
    let length: f64 = along.iter().map(|way| way * way).sum();
    let here: f64 = (0..3)
        .map(|axis| (place[axis] - from[axis]) * along[axis])
        .sum();
    let share = if length > 0.0 {
        (here / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let apart = (0..3).map(|axis| (place[axis] - from[axis] - share * along[axis]).powi(2));
    apart.sum::<f64>().sqrt()
}

/// A random path of lines, each with a turn of both rotary axes.
fn random_path(random: &mut impl FnMut() -> f64) -> Vec<Place> {
    let count = 3 + (random() * 8.0) as usize;
    // From lone long moves to chords of a curve.
    let size = 60.0 * 10f64.powf(-2.0 * random());
    let mut place = [0.0, 0.0, 20.0, 0.0, 0.0];
    let mut places = vec![place];
    for _ in 0..count {
        for (axis, component) in place.iter_mut().enumerate() {
            let step = size * (2.0 * random() - 1.0);
            let (low, high) = [
                (-60.0, 60.0),
                (-60.0, 60.0),
                (0.0, 60.0),
                (-80.0, 20.0),
                (-300.0, 300.0),
            ][axis];
            *component = (*component + step).clamp(low, high);
        }
        places.push(place);
    }
    places
}

/// The program of a path, its lines after the first number 3.
fn program_of(letters: &str, path: &[Place], tolerance_mm: f64, feed: f64) -> String {
    let mode = if tolerance_mm > 0.0 {
        format!("G64 P{tolerance_mm} Q{tolerance_mm}")
    } else {
        "G61".into()
    };
    let mut text = format!("G21 G90 {mode} T1 M6\nG43.4 H1 G0 X0 Y0 Z20\n");
    for [x, y, z, first, second] in path.iter().skip(1) {
        text +=
            &format!("G1 X{x:.6} Y{y:.6} Z{z:.6} {letters}{first:.6} C{second:.6} F{feed:.0}\n");
    }
    text + "M2\n"
}

/// `PATHS=1000` judges as many.
#[test]
fn the_tip_keeps_its_tolerance_at_every_scan_of_random_paths_and_no_axis_exceeds_a_limit() {
    let paths: u32 = std::env::var("PATHS").map_or(24, |paths| paths.parse().expect("a number"));
    let folder = tempfile::tempdir().expect("a folder");
    let program = folder.path().join("random.ngc");
    let mut state = 0x2545_F491_4F6C_DD1Du64;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut worst_share = 0.0f64;
    for index in 0..paths {
        let (machine, _) = ZERO_MM[index as usize % 2];
        let letters = if machine == "xyzac-trunnion" {
            "A"
        } else {
            "B"
        };
        let path = random_path(&mut random);
        let tolerance_mm = if index % 5 == 0 {
            0.0
        } else {
            0.005 * 10f64.powf(random())
        };
        let feed = 500.0 + 5500.0 * random();
        fs::write(&program, program_of(letters, &path, tolerance_mm, feed)).expect("a program");
        let rows = setpoints(
            &root().join("machines").join(machine),
            &program,
            folder.path(),
        );
        let tips: Vec<Place> = rows.iter().map(|row| tip(machine, row)).collect();
        // On the way there in rapid nothing is asked of it.
        let from_start = |here: &Place| off_line(here, &path[0], &path[0]);
        let begin = (0..tips.len())
            .min_by(|a, b| from_start(&tips[*a]).total_cmp(&from_start(&tips[*b])))
            .expect("setpoints");
        let mut judged = 0;
        for here in tips.iter().skip(begin + 1) {
            let lines = path
                .windows(2)
                .map(|ends| off_line(here, &ends[0], &ends[1]));
            let off_mm = lines.fold(f64::INFINITY, f64::min);
            assert!(
                off_mm <= tolerance_mm + 0.001,
                "path {index} on {machine}: {off_mm} mm of {tolerance_mm}"
            );
            if tolerance_mm > 0.0 {
                worst_share = worst_share.max(off_mm / tolerance_mm);
            }
            judged += 1;
        }
        assert!(judged > 50, "path {index}: {judged} setpoints");
    }
    println!(
        "{paths} paths: the tip took at most {:.0} % of its tolerance",
        100.0 * worst_share
    );
    assert!(worst_share > 0.2, "nothing was rounded");
}

#[test]
fn shipped_five_axis_programs_run_and_the_tip_goes_round_a_cone_as_programmed() {
    let folder = tempfile::tempdir().expect("a folder");
    for (machine, program) in [
        ("xyzac-trunnion", "dome.ngc"),
        ("xyzac-trunnion", "blade.ngc"),
        ("xyzac-trunnion", "tilted-square.ngc"),
        ("xyzbc-head", "cone.ngc"),
        ("xyzbc-head", "wave.ngc"),
    ] {
        let programs = root().join("machines").join(machine).join("programs");
        let program = programs.join(program);
        // A copy: the tool in the spindle is kept beside the machine file.
        let bench = Bench::of(machine, &[]);
        let report = run(bench.path(), &program).good_report();
        let peak_um = report["contour_error_um"]["peak"].as_f64().expect("a peak");
        assert!(peak_um < 60.0, "{}: {peak_um} µm", program.display());
    }
    // Tool 2 is 25 mm longer: the tip is 25 mm below that of tool 1.
    let machine = root().join("machines/xyzbc-head");
    let rows = setpoints(&machine, &machine.join("programs/cone.ngc"), folder.path());
    let on_wall = rows.iter().filter(|row| (row[3] - 15.0).abs() < 1e-9);
    let mut turned_deg = 0.0f64;
    for row in on_wall {
        let (sin, cos) = row[3].to_radians().sin_cos();
        let angle = row[4].to_radians();
        let long = PIVOT_MM + 85.0;
        let (x, y) = (
            row[0] - long * sin * angle.cos(),
            row[1] - long * sin * angle.sin(),
        );
        let z = row[2] + 250.0 + PIVOT_MM - long * cos;
        if z.abs() > 1e-6 {
            continue;
        }
        let radius_mm = x.hypot(y);
        assert!(
            (radius_mm - 30.0).abs() < 0.021,
            "{radius_mm} mm at C{}",
            row[4]
        );
        let ahead = (y.atan2(x) - angle).rem_euclid(TAU);
        assert!(
            ahead.min(TAU - ahead) * 30.0 < 0.05,
            "the head is not where the tip is: {ahead}"
        );
        turned_deg = turned_deg.max(row[4]);
    }
    assert!(turned_deg > 359.0, "{turned_deg}");
}

/// Servos die in the middle of it; what their standbys send is the same.
#[test]
fn whichever_servo_dies_while_all_five_axes_turn_the_axes_go_where_they_would_have_gone() {
    let bench = Bench::of(
        "xyzac-trunnion",
        &[(
            "drive_mode = \"velocity\"",
            "drive_mode = \"velocity\"\nstandby = true",
        )],
    );
    let program = root().join("machines/xyzac-trunnion/programs/blade.ngc");
    let digest = |report: &Value| report["motion_digest"].clone();
    let undisturbed = digest(&run(bench.path(), &program).good_report());
    let at = |(number, axis): (usize, char)| {
        let scan = 900 + 400 * number;
        format!(
            "[[fault]]\nat = {{ scan = {scan} }}\nprocess = \"servo-{axis}\"\ndo = \"kill\"\n\n"
        )
    };
    let deaths: String = "XACYZACX".chars().enumerate().map(at).collect();
    let faults = bench.file("faults.toml", &deaths);
    let faults = faults.to_string_lossy().into_owned();
    let report = run_with(bench.path(), &program, &["--faults", &faults]).good_report();
    assert_eq!(digest(&report), undisturbed);
    // A planner that dies is a hold on the path: the tip is taken up where it stood.
    let faults = bench.file(
        "planner.toml",
        "[[fault]]\nat = { scan = 2500 }\nprocess = \"planner\"\ndo = \"kill\"\n",
    );
    let faults = faults.to_string_lossy().into_owned();
    run_with(bench.path(), &program, &["--faults", &faults]).good_report();
}

#[test]
fn lines_of_rotary_axes_that_make_no_sense_are_refused_with_line_and_rule() {
    for (what, by, expected) in [
        (
            "axis = \"A\"\ncarries",
            "axis = \"B\"\ncarries",
            "kind = \"rotary\"",
        ),
        (
            "axis = \"A\"\ncarries",
            "axis = \"X\"\ncarries",
            "kind = \"rotary\"",
        ),
        (
            "axis = \"A\"\ncarries",
            "axis = \"C\"\ncarries",
            "is there twice",
        ),
        ("carries = \"work\"", "carries = \"spindle\"", "work"),
        ("[-1.0, 0.0, 0.0]", "[0.0, 0.0, 0.0]", "has no direction"),
        ("[-1.0, 0.0, 0.0]", "[1.0, 0.0]", "3"),
        ("[-1.0, 0.0, 0.0]", "[nan, 0.0, 0.0]", "direction"),
        ("name = \"Y\"", "name = \"V\"", "no Y"),
    ] {
        let bench = Bench::of("xyzac-trunnion", &[(what, by)]);
        let output = quadrant()
            .arg("check")
            .arg(bench.path())
            .output()
            .expect("check");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{by}: {said}");
        assert!(
            said.contains("rotary_line") && said.contains(expected),
            "{by}: {said}"
        );
    }
}
