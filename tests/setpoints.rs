//! The setpoints of every shipped program: within every limit at every scan, exact on the path.

use std::fs;

use crate::support::{quadrant, root};

#[test]
fn no_shipped_program_breaks_a_limit_or_leaves_its_path_at_any_scan() {
    let mut planned = 0;
    for (machine, programs) in [
        ("xy", "xy"),
        ("xy-fast", "xy"),
        ("xy-torque", "xy"),
        ("xyz-mill", "xyz-mill"),
        ("xzb-pivot", "xzb-pivot"),
        ("xyzac-trunnion", "xyzac-trunnion"),
        ("xyzbc-head", "xyzbc-head"),
    ] {
        let folder = root().join("machines").join(programs).join("programs");
        for entry in fs::read_dir(folder).expect("programs").flatten() {
            let output = quadrant()
                .arg("plan")
                .arg(root().join("machines").join(machine))
                .arg(entry.path())
                .output()
                .expect("plan");
            assert_eq!(
                output.status.code(),
                Some(0),
                "{machine} {}: {}",
                entry.path().display(),
                String::from_utf8_lossy(&output.stderr)
            );
            planned += 1;
        }
    }
    assert!(planned > 60, "only {planned} programs");
}

/// An audit of its own, on what `plan --csv` writes: finite differences against the machine file's limits.
#[test]
fn the_setpoints_a_user_gets_as_csv_keep_the_limits() {
    let folder = tempfile::tempdir().expect("a folder");
    for (machine, program) in [
        ("machines/xy", "machines/xy/programs/pocket.ngc"),
        (
            "machines/xy-fast",
            "machines/xy/programs/circle-r10-f10000-cw.ngc",
        ),
        (
            "machines/xyz-mill",
            "machines/xyz-mill/programs/pocket-3d.ngc",
        ),
        ("machines/xzb-pivot", "machines/xzb-pivot/programs/line.ngc"),
    ] {
        let csv = folder.path().join("setpoints.csv");
        let output = quadrant()
            .args(["plan", machine, program, "--csv"])
            .arg(&csv)
            .output()
            .expect("plan");
        assert_eq!(
            output.status.code(),
            Some(0),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        let limits = machine::Machine::load(&root().join(machine)).expect("the machine");
        let period_s = limits.scan_period_s();
        let axes = limits.axes.len();
        let mut before: Vec<Vec<i64>> = Vec::new();
        let text = fs::read_to_string(&csv).expect("the setpoints");
        let mut setpoints = 0;
        for (number, line) in text.lines().skip(1).enumerate() {
            let columns: Vec<&str> = line.split(',').collect();
            let position: Vec<i64> = (0..axes)
                .map(|axis| {
                    let mm: f64 = columns[5 + axis].parse().expect("a position");
                    (mm / limits.axes[axis].increment_mm()).round() as i64
                })
                .collect();
            before.push(position);
            if before.len() > 3 {
                before.remove(0);
            }
            if let [a, b, c] = before.as_slice() {
                for axis in 0..axes {
                    let unit = limits.axes[axis].increment_mm();
                    let velocity = (c[axis] - b[axis]) as f64 * unit / period_s;
                    let acceleration =
                        (c[axis] - 2 * b[axis] + a[axis]) as f64 * unit / (period_s * period_s);
                    let settings = &limits.axes[axis];
                    assert!(
                        velocity.abs() <= settings.rapid_mm_s * (1.0 + 1e-9),
                        "{machine} setpoint {number}: {velocity} mm/s"
                    );
                    assert!(
                        acceleration.abs() <= settings.acceleration_mm_s2 * (1.0 + 1e-9),
                        "{machine} setpoint {number}: {acceleration} mm/s²"
                    );
                }
            }
            setpoints += 1;
        }
        assert!(setpoints > 100, "{machine}: {setpoints} setpoints");
    }
}
