//! What an axis did during the test motions, as its encoders and its drive tell it: read from the log of a run.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context, bail};
use bus::sample::{AxisCommand, Feedback};
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
    /// Torque that is commanded beside it from each of these instants on (torque mode: the whole torque), in N·m.
    pub torque_command_nm: Vec<f64>,
    /// Dead time with which these commands were brought into step, in scans.
    pub dead_time_scans: u32,
    /// Kv while it was recorded, in N·s/m.
    pub gain_n_s_per_m: f64,
}

impl Recording {
    /// Whether a scale of its own measures the table.
    pub fn has_scale(&self) -> bool {
        self.motor_mm != self.scale_mm
    }

    /// All that is recorded scan by scan.
    fn all_mut(&mut self) -> [&mut Vec<f64>; 5] {
        [
            &mut self.motor_mm,
            &mut self.scale_mm,
            &mut self.torque_nm,
            &mut self.velocity_command_mm_s,
            &mut self.torque_command_nm,
        ]
    }

    /// Leaves what is from the first to the last change of these command positions; a command acts by so many scans later than the scan
    /// in which it was handed to the drive.
    fn trim(&mut self, command_position: &[i64], late: usize) -> anyhow::Result<()> {
        let moves = |i: &usize| command_position[*i] != command_position[i - 1];
        let first = (1..command_position.len()).find(moves);
        let last = (1..command_position.len()).rev().find(moves);
        let (first, last) = first.zip(last).context("an axis was never commanded")?;
        let from = first.saturating_sub(MARGIN_SCANS);
        let to = (last + MARGIN_SCANS).min(command_position.len());
        for commands in [&mut self.velocity_command_mm_s, &mut self.torque_command_nm] {
            commands.splice(..0, std::iter::repeat_n(0.0, late));
            commands.truncate(command_position.len());
        }
        for values in self.all_mut() {
            values.truncate(to);
            values.drain(..from);
        }
        Ok(())
    }

    /// The same with a torque that was shown so many scans late brought into step.
    pub fn with_torque_late(&self, scans: usize) -> Recording {
        let mut aligned = self.clone();
        let count = self.motor_mm.len().saturating_sub(scans);
        aligned.torque_nm.drain(..scans.min(self.torque_nm.len()));
        for values in aligned.all_mut() {
            values.truncate(count);
        }
        aligned
    }
}

/// Brings the feedback of a scan and the commands of all axes in it together, sample by sample.
pub struct InStep {
    feedback: Option<Box<Feedback>>,
    commands: Vec<Option<Box<AxisCommand>>>,
}

impl InStep {
    /// Of so many axes.
    pub fn new(axes: usize) -> InStep {
        InStep {
            feedback: None,
            commands: vec![None; axes],
        }
    }

    /// Takes the next sample; the feedback of a scan, once the commands of all axes are there too.
    pub fn take(&mut self, sample: Sample) -> Option<Box<Feedback>> {
        match sample {
            Sample::Feedback(feedback) => self.feedback = Some(feedback),
            Sample::Command(command) => {
                let place = self.commands.get_mut(command.axis as usize)?;
                *place = Some(command);
            }
            _ => {}
        }
        let (all, commands) = (self.commands.len(), self.commands.iter().flatten());
        let whole = |scan| commands.filter(|of| of.scan == scan).count() == all;
        self.feedback.take_if(|feedback| whole(feedback.scan))
    }

    /// The command of each axis, of the scan whose feedback was given out.
    pub fn commands(&self) -> impl Iterator<Item = &AxisCommand> {
        self.commands.iter().flatten().map(Box::as_ref)
    }
}

/// The last commands of the two servos of an axis.
#[derive(Debug, Clone, Default)]
struct Newest([Vec<(u64, f64)>; 2]);

impl Newest {
    /// A servo's command may be logged before the master has used the one before it.
    const KEPT: usize = 4;

    fn take(&mut self, command: &AxisCommand) {
        if let Some(kept) = self.0.get_mut(command.role as usize) {
            kept.push((command.scan, command.torque_nm));
            if kept.len() > Newest::KEPT {
                kept.remove(0);
            }
        }
    }

    /// Torque of the command that answered the feedback of this scan.
    fn torque_nm(&self, role: u32, scan: u64) -> Option<f64> {
        let kept = self.0.get(role as usize)?;
        let found = kept.iter().rev().find(|(of, _)| *of == scan);
        found.map(|(_, torque_nm)| *torque_nm)
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
            dead_time_scans: machine.scan.dead_time_scans,
            gain_n_s_per_m: axis.velocity_loop.gain_n_s_per_m,
            ..Recording::default()
        })
        .collect();
    let mut command_positions: Vec<Vec<i64>> = vec![Vec::new(); all.len()];
    let mut commands: Vec<Newest> = vec![Newest::default(); all.len()];
    while let Some(sample) = reader.next_sample()? {
        let feedback = match sample {
            Sample::Feedback(feedback) => feedback,
            Sample::Command(command) => {
                if let Some(newest) = commands.get_mut(command.axis as usize) {
                    newest.take(&command);
                }
                continue;
            }
            _ => continue,
        };
        let places = all
            .iter_mut()
            .zip(&mut command_positions)
            .zip(&commands)
            .zip(&machine.axes);
        for ((((recording, command_position), newest), known), axis) in places.zip(feedback.axes())
        {
            let mm = |increments: i64| increments as f64 * known.increment_mm();
            let before_nm = recording.torque_command_nm.last().copied();
            let torque_nm = newest.torque_nm(axis.taken_role, axis.command_scan);
            let now = [
                mm(axis.motor_position),
                mm(axis.scale_position),
                axis.torque_nm,
                axis.velocity_command_mm_s,
                torque_nm.or(before_nm).unwrap_or_default(),
            ];
            for (values, value) in recording.all_mut().into_iter().zip(now) {
                values.push(value);
            }
            command_position.push(axis.command_position);
        }
    }
    if let Some(why) = reader.cut() {
        bail!("{}: {why}", log.display());
    }
    let late = (machine.scan.dead_time_scans - 1) as usize;
    for (recording, command_position) in all.iter_mut().zip(&command_positions) {
        recording.trim(command_position, late)?;
    }
    Ok(all)
}
