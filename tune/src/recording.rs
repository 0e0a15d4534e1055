//! What an axis did during the test motions, as its encoders and its drive tell it: read from the log of a run.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context, bail};
use machine::Machine;
use monitor::log::{Reader, Sample};

/// Scans kept before the first and after the last commanded movement of an axis.
const MARGIN_SCANS: usize = 50;

/// One axis during one run, from its first to its last commanded movement.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    /// Scan period, in s.
    pub scan_s: f64,
    /// Motor encoder, in mm.
    pub motor_mm: Vec<f64>,
    /// Linear scale, in mm; the motor encoder once more where the axis has none.
    pub scale_mm: Vec<f64>,
    /// Torque at the same instants, in N·m.
    pub torque_nm: Vec<f64>,
    /// Velocity command that acts from each of these instants on, in mm/s.
    pub velocity_command_mm_s: Vec<f64>,
    /// Kv while it was recorded, in N·s/m.
    pub gain_n_s_per_m: f64,
}

impl Recording {
    /// Whether a scale of its own measures the table.
    pub fn has_scale(&self) -> bool {
        self.motor_mm != self.scale_mm
    }

    /// The same with a torque that was shown so many scans late brought into step.
    pub fn with_torque_late(&self, scans: usize) -> Recording {
        let mut aligned = self.clone();
        let count = self.motor_mm.len().saturating_sub(scans);
        aligned.torque_nm.drain(..scans.min(self.torque_nm.len()));
        for values in [
            &mut aligned.motor_mm,
            &mut aligned.scale_mm,
            &mut aligned.torque_nm,
            &mut aligned.velocity_command_mm_s,
        ] {
            values.truncate(count);
        }
        aligned
    }
}

/// Writes recordings as text that `quadrant identify` reads: `AXIS-MOTION.csv`, an axis each.
///
/// # Errors
/// The files cannot be written.
pub fn write(
    folder: &Path,
    motion: &str,
    machine: &Machine,
    all: &[Recording],
) -> anyhow::Result<()> {
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    for (axis, recording) in machine.axes.iter().zip(all) {
        let mut text =
            String::from("time_s,position_mm,scale_mm,torque_nm,velocity_command_mm_s\n");
        let scales = recording.scale_mm.iter().zip(&recording.torque_nm);
        let rows = recording
            .motor_mm
            .iter()
            .zip(scales)
            .zip(&recording.velocity_command_mm_s);
        for (scan, ((motor_mm, (scale_mm, torque_nm)), command_mm_s)) in rows.enumerate() {
            let time_s = scan as f64 * recording.scan_s;
            let _ = writeln!(
                text,
                "{time_s:.6},{motor_mm:.6},{scale_mm:.6},{torque_nm:.6},{command_mm_s:.6}"
            );
        }
        let path = folder.join(format!("{}-{motion}.csv", axis.name));
        fs::write(&path, text).with_context(|| path.display().to_string())?;
    }
    Ok(())
}

/// Reads one recording per axis of this machine.
///
/// # Errors
/// The log cannot be read or was cut off.
pub fn read(log: &Path, machine: &Machine) -> anyhow::Result<Vec<Recording>> {
    let mut reader = Reader::open(log)?;
    let scan_s = f64::from(reader.scan_period_us()) * 1e-6;
    let mut all: Vec<Recording> = machine
        .axes
        .iter()
        .map(|axis| Recording {
            scan_s,
            gain_n_s_per_m: axis.velocity_loop.gain_n_s_per_m,
            ..Recording::default()
        })
        .collect();
    let mut command_positions: Vec<Vec<i64>> = vec![Vec::new(); all.len()];
    while let Some(sample) = reader.next_sample()? {
        let Sample::Feedback(feedback) = sample else {
            continue;
        };
        let places = all
            .iter_mut()
            .zip(&mut command_positions)
            .zip(&machine.axes);
        for (((recording, command_position), known), axis) in places.zip(feedback.axes()) {
            let increment_mm = known.increment_mm();
            recording
                .motor_mm
                .push(axis.motor_position as f64 * increment_mm);
            recording
                .scale_mm
                .push(axis.scale_position as f64 * increment_mm);
            recording.torque_nm.push(axis.torque_nm);
            recording
                .velocity_command_mm_s
                .push(axis.velocity_command_mm_s);
            command_position.push(axis.command_position);
        }
    }
    if let Some(why) = reader.cut() {
        bail!("{}: {why}", log.display());
    }
    for (recording, command_position) in all.iter_mut().zip(&command_positions) {
        let moves = |i: &usize| command_position[*i] != command_position[i - 1];
        let first = (1..command_position.len()).find(moves);
        let last = (1..command_position.len()).rev().find(moves);
        let (first, last) = first.zip(last).context("an axis was never commanded")?;
        let from = first.saturating_sub(MARGIN_SCANS);
        let to = (last + MARGIN_SCANS).min(command_position.len());
        // A command acts by so much later than the scan in which it was handed to the drive.
        let late = (machine.scan.dead_time_scans - 1) as usize;
        let commands = &mut recording.velocity_command_mm_s;
        commands.splice(..0, std::iter::repeat_n(0.0, late));
        commands.truncate(command_position.len());
        for values in [
            &mut recording.motor_mm,
            &mut recording.scale_mm,
            &mut recording.torque_nm,
            &mut recording.velocity_command_mm_s,
        ] {
            values.truncate(to);
            values.drain(..from);
        }
    }
    Ok(all)
}
