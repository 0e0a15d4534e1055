//! Recordings as text: a line of column names, then a line for each instant; units told by the names.

use std::fs;
use std::path::Path;

use anyhow::{Context, bail};

use crate::options::IdentifyOptions;
use crate::recording::Recording;

/// Most by which one step of time may differ from the mean, as a part of it.
const UNEVEN_MAX: f64 = 0.01;
/// Fewest instants of a recording.
const ROWS_MIN: usize = 200;

/// What a column is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Signal {
    Time,
    Motor,
    Scale,
    Force,
    Torque,
    VelocityCommand,
}

/// Names of columns without their units.
const NAMES: [(&str, Signal); 9] = [
    ("time", Signal::Time),
    ("t", Signal::Time),
    ("position", Signal::Motor),
    ("motor", Signal::Motor),
    ("motor_position", Signal::Motor),
    ("scale", Signal::Scale),
    ("force", Signal::Force),
    ("torque", Signal::Torque),
    ("velocity_command", Signal::VelocityCommand),
];

/// Units, and what they are in s, mm, N, N·m and mm/s.
const UNITS: [(Signal, &[(&str, f64)]); 6] = [
    (Signal::Time, &[("s", 1.0), ("ms", 1e-3), ("us", 1e-6)]),
    (
        Signal::Motor,
        &[("mm", 1.0), ("m", 1e3), ("um", 1e-3), ("nm", 1e-6)],
    ),
    (
        Signal::Scale,
        &[("mm", 1.0), ("m", 1e3), ("um", 1e-3), ("nm", 1e-6)],
    ),
    (Signal::Force, &[("n", 1.0), ("kn", 1e3)]),
    (Signal::Torque, &[("nm", 1.0), ("mnm", 1e-3)]),
    (Signal::VelocityCommand, &[("mm_s", 1.0), ("m_s", 1e3)]),
];

/// A file that was read.
pub struct File {
    /// Its name, for messages.
    pub name: String,
    /// What the axis did.
    pub recording: Recording,
    /// Whether `torque_nm` holds the force itself, in N.
    pub is_force: bool,
}

/// Reads a file.
///
/// # Errors
/// It cannot be read, or is not a recording.
pub fn read(path: &Path, options: &IdentifyOptions) -> anyhow::Result<File> {
    let name = path.display().to_string();
    let text = fs::read_to_string(path).with_context(|| name.clone())?;
    parse(&name, &text, options).with_context(|| name.clone())
}

fn parse(name: &str, text: &str, options: &IdentifyOptions) -> anyhow::Result<File> {
    let mut lines = text
        .lines()
        .enumerate()
        .map(|(index, line)| (index + 1, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let (_, head) = lines.next().context("is empty")?;
    let columns: Vec<Option<(Signal, f64)>> = fields(head)
        .map(|column| column_of(&column.to_lowercase()))
        .collect();
    let place = |signal: Signal| {
        let of = |column: &Option<(Signal, f64)>| column.is_some_and(|(of, _)| of == signal);
        columns.iter().position(of)
    };
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); columns.len()];
    for (number, line) in lines {
        let mut count = 0;
        for ((value, column), list) in fields(line).zip(&columns).zip(&mut values) {
            count += 1;
            let Some((_, unit)) = column else { continue };
            let value: f64 = value
                .parse()
                .ok()
                .filter(|value: &f64| value.is_finite())
                .with_context(|| format!("line {number}: {value:?} must be a number"))?;
            list.push(value * unit);
        }
        if count != columns.len() {
            bail!("line {number}: must have {} values", columns.len());
        }
    }
    let mut take =
        |signal: Signal| place(signal).and_then(|at| values.get_mut(at).map(std::mem::take));
    let motor_mm = take(Signal::Motor).context(
        "must have the motor's position: a column position_mm, position_m or position_um",
    )?;
    let (force, torque) = (take(Signal::Force), take(Signal::Torque));
    let is_force = force.is_some();
    let torque_nm = force
        .or(torque)
        .context("must have what drives the axis: a column force_n or torque_nm")?;
    if motor_mm.len() < ROWS_MIN {
        bail!(
            "has {} instants: must have at least {ROWS_MIN}",
            motor_mm.len()
        );
    }
    let scan_s = match take(Signal::Time) {
        Some(times_s) => step_s(&times_s)?,
        None => {
            let scan_us = options
                .scan_us
                .context("must have a column time_s, or its period be given: --scan-us")?;
            scan_us * 1e-6
        }
    };
    Ok(File {
        name: name.to_owned(),
        recording: Recording {
            scan_s,
            scale_mm: take(Signal::Scale).unwrap_or_else(|| motor_mm.clone()),
            velocity_command_mm_s: take(Signal::VelocityCommand)
                .unwrap_or_else(|| vec![0.0; motor_mm.len()]),
            torque_command_nm: vec![0.0; motor_mm.len()],
            torque_nm,
            motor_mm,
            dead_time_scans: 1,
            gain_n_s_per_m: options.velocity_gain_n_s_per_m,
        },
        is_force,
    })
}

/// Values of a line: between commas, semicolons, tabs or spaces.
fn fields(line: &str) -> impl Iterator<Item = &str> {
    let separator = [',', ';', '\t'].into_iter().find(|of| line.contains(*of));
    line.split(move |of: char| separator.map_or(of.is_whitespace(), |separator| of == separator))
        .map(str::trim)
        .filter(move |field| separator.is_some() || !field.is_empty())
}

/// What a column of this name holds, and its unit; nothing if that is not known.
fn column_of(name: &str) -> Option<(Signal, f64)> {
    NAMES.iter().find_map(|(known, signal)| {
        let unit = name.strip_prefix(known)?.strip_prefix('_')?;
        let (_, units) = UNITS.iter().find(|(of, _)| of == signal)?;
        let (_, factor) = units.iter().find(|(known, _)| *known == unit)?;
        Some((*signal, *factor))
    })
}

/// The step of evenly spaced times, in s.
fn step_s(times_s: &[f64]) -> anyhow::Result<f64> {
    let (first, last) = times_s
        .first()
        .zip(times_s.last())
        .context("has no times")?;
    let step_s = (last - first) / (times_s.len().max(2) - 1) as f64;
    let uneven = times_s
        .windows(2)
        .position(|pair| ((pair[1] - pair[0]) / step_s - 1.0).abs() > UNEVEN_MAX);
    match uneven {
        _ if step_s.is_nan() || step_s <= 0.0 => bail!("time must rise from line to line"),
        Some(at) => bail!(
            "times are not evenly spaced: {} s follows {} s, the mean step is {step_s} s",
            times_s[at + 1],
            times_s[at]
        ),
        None => Ok(step_s),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options() -> IdentifyOptions {
        IdentifyOptions {
            recording: "a.csv".into(),
            validate: Vec::new(),
            lead_mm: None,
            smoothing_ms: 10.0,
            scan_us: None,
            velocity_gain_n_s_per_m: 0.0,
        }
    }

    fn text(head: &str, line: impl Fn(usize) -> String) -> String {
        let lines: Vec<String> = (0..ROWS_MIN).map(line).collect();
        format!("# somebody's\n{head}\n{}\n", lines.join("\n"))
    }

    #[test]
    fn units_are_told_by_the_names_of_columns_and_other_columns_are_left_alone() {
        let text = text("time_ms;position_m;note;force_kn", |i| {
            format!("{i};{};good;0.5", i as f64 * 1e-3)
        });
        let file = parse("a.csv", &text, &options()).expect("a recording");
        assert!(file.is_force);
        assert!((file.recording.scan_s - 1e-3).abs() < 1e-12);
        assert_eq!(file.recording.motor_mm[10], 10.0);
        assert_eq!(file.recording.torque_nm[10], 500.0);
        assert!(!file.recording.has_scale());
    }

    #[test]
    fn what_is_missing_is_named() {
        let no_force = text("time_s,position_mm", |i| format!("{i},{i}"));
        let no_time = text("position_mm,torque_nm", |i| format!("{i},{i}"));
        let uneven = text("time_s,position_mm,torque_nm", |i| format!("{},1,1", i * i));
        let word = text("position_mm,torque_nm", |_| "1,much".into());
        for (text, what) in [
            (no_force, "force_n"),
            (no_time, "--scan-us"),
            (uneven, "evenly"),
            (word, "line 3"),
        ] {
            let error = parse("a.csv", &text, &options()).err().expect("refused");
            assert!(format!("{error:#}").contains(what), "{error:#}");
        }
    }
}
