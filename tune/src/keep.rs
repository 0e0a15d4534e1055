//! What was found, for people; the new file, and the old one beside it.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use machine::settings_file::N_PER_NM;
use machine::{AxisKind, Machine, replace_file};
use toml_edit::DocumentMut;

use super::dead_time;
use super::identify::Found;
use super::ringing::Ringing;
use super::smooth;
use crate::options::TuneOptions;
use console::exit::{Failure, Kind, Outcome};
use console::output::say;

/// The table of what was identified.
pub fn findings(machine: &Machine, all: &[Found]) -> String {
    let mut text = String::from(
        "axis     mass friction  static  Stribeck  viscous | table friction stiffness    gap  lost motion | unexplained\n           kg        N   ratio      mm/s    N·s/m |    kg        N      N/µm     µm           µm | torque N",
    );
    for (axis, found) in machine.axes.iter().zip(all) {
        // A rotary axis is shown in its own units, not as the slide that stands for it.
        let (force, mass) = match axis.kind {
            AxisKind::Linear => (1.0, 1.0),
            AxisKind::Rotary => (N_PER_NM, N_PER_NM * N_PER_NM),
        };
        let places = if axis.kind == AxisKind::Rotary { 3 } else { 1 };
        text += &format!(
            "\n{:4} {:8.places$} {:8.places$} {:7.3} {:9.2} {:8.*} |",
            axis.name,
            found.mass_kg() / mass,
            found.coulomb_n() / force,
            found.motor.static_ratio,
            found.motor.stribeck_mm_s,
            places - 1,
            found.viscous_n_s_per_m() / mass,
        );
        text += &found
            .table
            .map_or(format!(" {:49} |", "no scale: not known"), |table| {
                format!(
                    " {:5.1} {:8.1} {:9.1} {:6.2} {:12.2} |",
                    table.mass_kg / mass,
                    table.friction.coulomb_n() / force,
                    table.stiffness_n_per_um / mass,
                    table.gap_um,
                    found.lost_motion_um(),
                )
            });
        text += &format!(
            " {:.1}; cogging {:.3} N·m, {} a turn",
            found.residual_n / force,
            found.cogging_nm,
            found.cogging_per_turn
        );
    }
    if machine
        .axes
        .iter()
        .any(|axis| axis.kind == AxisKind::Rotary)
    {
        text += "\nrotary axes: kg·m², N·m, °/s, N·m·s/rad; stiffness in millions of N·m/rad, gap and lost motion in mdeg, cogging and torque in N·m at the motor";
    }
    text
}

/// What rings, axis by axis, and what of it motion is made to spare.
pub fn ringing(machine: &Machine, all: &[Vec<Ringing>]) -> String {
    let mut text = String::from("ringing after a change of acceleration");
    for (axis, rings) in machine.axes.iter().zip(all) {
        let of = |of: &Ringing| {
            format!(
                "{:.1} Hz, damping ratio {:.3}, {:.1} {}",
                of.frequency_hz,
                of.damping_ratio,
                of.amplitude_um,
                axis.kind.deviation_unit()
            )
        };
        let found: Vec<String> = rings.iter().map(of).collect();
        let found = match found.as_slice() {
            [] => format!("none above 0.5 {}", axis.kind.deviation_unit()),
            found => found.join("; "),
        };
        text += &format!("\n{:4} {found}", axis.name);
    }
    text += &match smooth::worst(all) {
        Some(spared) => format!(
            "\nmotion is made to spare {:.1} Hz: vibration_hz and jerk_mm_s3; corners and chords of exact paths (G61) then take \
             a stop: ask for a tolerance (G64 P, or tolerance_mm of [path])",
            spared.frequency_hz
        ),
        None => format!(
            "\nnothing above {} µm that is worth sparing: motion stays as the machine file has it",
            smooth::WORTH_UM
        ),
    };
    text
}

/// A file that the product itself would not read is not written.
///
/// # Errors
/// Why not.
pub fn check(document: &DocumentMut) -> anyhow::Result<()> {
    Machine::parse("the settings found", &document.to_string())
        .map(|_| ())
        .map_err(|error| anyhow!("the model does not fit, nothing is written: {error}"))
}

/// Writes the file that was asked for, or shows it.
pub fn write(options: &TuneOptions, path: &Path, document: &DocumentMut) -> Outcome {
    let text = document.to_string();
    if options.dry_run {
        say(&text);
        return Ok(());
    }
    if let Some(out) = &options.out {
        replace_file(out, &text)
            .with_context(|| out.display().to_string())
            .environment()?;
        say(&format!("written: {}", out.display()));
        return Ok(());
    }
    let kept = keep_old(path)?;
    replace_file(path, &text)
        .with_context(|| path.display().to_string())
        .environment()?;
    say_written(path, &kept);
    Ok(())
}

/// Gives the drive files the dead time of this machine file, if it has another one than the machine that they were written for, and
/// keeps the old ones.
pub fn write_drive_files(
    options: &TuneOptions,
    path: &Path,
    machine: &Machine,
    document: &DocumentMut,
) -> Outcome {
    let new = Machine::parse("the settings found", &document.to_string()).input()?;
    let scans = new.scan.dead_time_scans;
    let stays = options.dry_run || options.out.is_some();
    if stays || scans == machine.scan.dead_time_scans {
        return Ok(());
    }
    for file in dead_time::drive_files(machine) {
        let path = path.with_file_name(file);
        let kept = keep_old(&path)?;
        dead_time::write_drive_file(&path, scans)?;
        say_written(&path, &kept);
    }
    Ok(())
}

/// Copies a file before it is replaced; where to.
fn keep_old(path: &Path) -> Result<PathBuf, Failure> {
    let kept = free_name(path);
    fs::copy(path, &kept)
        .with_context(|| kept.display().to_string())
        .environment()?;
    Ok(kept)
}

fn say_written(path: &Path, kept: &Path) {
    say(&format!(
        "written: {}; the old one is {}",
        path.display(),
        kept.display()
    ));
}

/// `machine.toml.before-tune`, numbered from 2 where that is taken.
fn free_name(path: &Path) -> PathBuf {
    let named = |suffix: &str| {
        let mut name = path.as_os_str().to_owned();
        name.push(suffix);
        PathBuf::from(name)
    };
    let first = named(".before-tune");
    if !first.exists() {
        return first;
    }
    (2_u32..)
        .map(|number| named(&format!(".before-tune-{number}")))
        .find(|name| !name.exists())
        .unwrap_or(first)
}
