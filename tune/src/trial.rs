//! Before and after: the same circles on the machine as it was and as it would be.

use anyhow::Context;
use machine::Machine;
use serde_json::Value;
use toml_edit::DocumentMut;

use super::bench::Bench;
use super::{motions, write};
use launcher::exit::{Failure, Kind};

/// Worst protrusion or undercut of each test circle, in µm, as `report.json` has it; none where the machine stopped.
pub type Column = Vec<Option<f64>>;

/// Circles that this machine has room for: radius, feed, program.
pub fn circles(machine: &Machine) -> Vec<(f64, f64, String)> {
    motions::CIRCLES
        .into_iter()
        .filter_map(|(radius_mm, feed_mm_min)| {
            let program = motions::circle(machine, radius_mm, feed_mm_min)?;
            Some((radius_mm, feed_mm_min, program))
        })
        .collect()
}

/// Runs them.
///
/// # Errors
/// The environment does not allow it, or somebody interrupted. A machine that stops is no error.
pub fn run(
    bench: &mut Bench,
    document: &DocumentMut,
    circles: &[(f64, f64, String)],
) -> Result<Column, Failure> {
    let mut plain = document.clone();
    write::plain(&mut plain);
    circles
        .iter()
        .map(|(_, _, program)| match bench.report(&plain, program) {
            Ok(report) => worst_um(&report).environment().map(Some),
            Err(Failure::Stopped(why)) => {
                tracing::warn!("{why:#}");
                Ok(None)
            }
            Err(other) => Err(other),
        })
        .collect()
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

/// Mean of a column; a circle on which the machine stopped counts as endlessly bad.
pub fn mean_um(column: &Column) -> f64 {
    let sum: f64 = column.iter().map(|um| um.unwrap_or(f64::INFINITY)).sum();
    sum / column.len().max(1) as f64
}

/// The table for people.
pub fn table(circles: &[(f64, f64, String)], columns: &[(&str, &Column)]) -> String {
    let mut text =
        String::from("worst protrusion or undercut, µm, cw and ccw\n  radius     feed  ");
    for (name, _) in columns {
        text += &format!("{name:>15}");
    }
    let cell = |um: Option<f64>| {
        um.filter(|um| um.is_finite())
            .map_or(format!("{:>15}", "stopped"), |um| format!("{um:15.1}"))
    };
    for (index, (radius_mm, feed_mm_min, _)) in circles.iter().enumerate() {
        text += &format!("\n  R{radius_mm:<6} F{feed_mm_min:<8}");
        for (_, column) in columns {
            text += &cell(column.get(index).copied().flatten());
        }
    }
    text += &format!("\n  {:17}", "mean");
    for (_, column) in columns {
        text += &cell(Some(mean_um(column)));
    }
    text
}
