//! `quadrant bench circles`: quadrant protrusions on a grid of radii and feeds, for each way of compensating them.

use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use bus::machine::machine_file;
use serde_json::Value;
use toml_edit::{DocumentMut, value};

use super::run_report;
use crate::cli::BenchOptions;
use crate::output::say;

/// Radii of the grid, in mm.
const RADII_MM: [f64; 4] = [10.0, 25.0, 50.0, 100.0];
/// Feeds of the grid, in mm/min.
const FEEDS_MM_MIN: [f64; 3] = [1000.0, 3000.0, 10_000.0];
/// Values of `reversal.method` that are compared; the first is what the others are judged against.
const METHODS: [&str; 3] = ["none", "backlash", "kick"];
/// Where circles start, off the axes, so that every reversal lies in steady motion.
const START_DEG: f64 = 45.0;

/// Prints the table: worst protrusion or undercut on the table over axes, reversals and both directions, in µm.
///
/// # Errors
/// The machine cannot be read, or a run fails.
pub fn circles(options: &BenchOptions) -> anyhow::Result<()> {
    let folder = std::env::temp_dir().join(format!("quadrant-circles-{}", std::process::id()));
    let result = table(&options.machine, &folder);
    let _ = fs::remove_dir_all(&folder);
    result
}

fn table(machine: &Path, folder: &Path) -> anyhow::Result<()> {
    let machines = METHODS
        .map(|method| variant(machine, &folder.join(method), method))
        .into_iter()
        .collect::<anyhow::Result<Vec<PathBuf>>>()?;
    say(&format!(
        "worst protrusion or undercut on the table, µm; {}, cw and ccw, two turns each",
        machine.display()
    ));
    say(&format!(
        "  radius     feed   {}",
        METHODS.map(|m| format!("{m:>18}")).concat()
    ));
    let mut all: Vec<Vec<f64>> = vec![Vec::new(); METHODS.len()];
    for radius_mm in RADII_MM {
        for feed_mm_min in FEEDS_MM_MIN {
            let program = folder.join("circle.ngc");
            fs::write(&program, circle(radius_mm, feed_mm_min))
                .with_context(|| program.display().to_string())?;
            let mut row = format!("  R{radius_mm:<6} F{feed_mm_min:<6} ");
            let mut reference_um = None;
            for (machine, values) in machines.iter().zip(&mut all) {
                let worst_um = worst_um(&run_report(machine, &program)?)?;
                let reference_um = *reference_um.get_or_insert(worst_um);
                row += &format!(
                    "{worst_um:9.1} {:+5.0} %  ",
                    (worst_um / reference_um - 1.0) * 100.0
                );
                values.push(worst_um);
            }
            say(&row);
        }
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let worst = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    for (name, of) in [("mean", &mean as &dyn Fn(&[f64]) -> f64), ("worst", &worst)] {
        let cells: String = all
            .iter()
            .map(|v| format!("{:9.1}          ", of(v)))
            .collect();
        say(&format!("  {name:15} {cells}"));
    }
    Ok(())
}

/// A copy of the machine whose axes compensate by `method`.
fn variant(machine: &Path, folder: &Path, method: &str) -> anyhow::Result<PathBuf> {
    let file = machine_file(machine);
    let named = || file.display().to_string();
    let mut document: DocumentMut = fs::read_to_string(&file)
        .with_context(named)?
        .parse()
        .with_context(named)?;
    let axes = document
        .get_mut("axis")
        .and_then(|axes| axes.as_array_of_tables_mut())
        .with_context(|| format!("{}: has no [[axis]]", file.display()))?;
    for axis in axes.iter_mut() {
        if let Some(reversal) = axis.get_mut("reversal").and_then(|r| r.as_table_mut()) {
            reversal.insert("method", value(method));
        }
    }
    fs::create_dir_all(folder)?;
    fs::write(folder.join("machine.toml"), document.to_string())?;
    let plant = file.with_file_name("plant.toml");
    fs::copy(&plant, folder.join("plant.toml")).with_context(|| plant.display().to_string())?;
    Ok(folder.to_path_buf())
}

/// Two turns counter-clockwise, two clockwise, around zero.
fn circle(radius_mm: f64, feed_mm_min: f64) -> String {
    let angle = START_DEG * PI / 180.0;
    let (x, y) = (radius_mm * libm::cos(angle), radius_mm * libm::sin(angle));
    let turns =
        |g: &str| format!("{g} X{x:.6} Y{y:.6} I{:.6} J{:.6} F{feed_mm_min}\n", -x, -y).repeat(2);
    format!(
        "G21 G17 G90 G94\nG0 X{x:.6} Y{y:.6}\nG4 P0.2\n{}G4 P0.2\n{}G4 P0.2\nM2\n",
        turns("G3"),
        turns("G2")
    )
}

/// Largest protrusion or undercut in steady motion on an arc.
fn worst_um(report: &Value) -> anyhow::Result<f64> {
    let reversals = report
        .get("reversals")
        .and_then(Value::as_array)
        .context("report.json has no reversals")?;
    let number = |reversal: &Value, key: &str| reversal.get(key).and_then(Value::as_f64);
    let is_steady = |reversal: &Value| reversal.get("steady") == Some(&Value::Bool(true));
    Ok(reversals
        .iter()
        .filter(|r| number(r, "radius_mm").is_some() && is_steady(r))
        .filter_map(|r| Some(number(r, "protrusion_um")?.max(-number(r, "undercut_um")?)))
        .fold(0.0, f64::max))
}
