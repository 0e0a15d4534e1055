//! The drive files of a machine, read and judged together with it.

use std::path::Path;

use anyhow::{Context, bail};
use machine::{DriveMode, Machine};

use crate::cia402::OperatingMode;
use crate::drive_file;
use crate::drives::DriveSetup;

/// Drive files of a machine with a fieldbus, and what to know of them.
#[derive(Debug, Clone)]
pub struct Setups {
    /// By axis.
    pub drives: Vec<DriveSetup>,
    /// Warnings, a line each.
    pub warnings: Vec<String>,
}

/// Reads the drive files of a machine whose file is this; none without `[bus]`.
///
/// # Errors
/// A file that cannot be used, or does not go with the machine file: one line for each thing.
pub fn load(machine: &Machine, machine_file: &Path) -> anyhow::Result<Option<Setups>> {
    if machine.bus.is_none() {
        return Ok(None);
    }
    let folder = machine_file.parent().unwrap_or(Path::new(""));
    let mut setups = Setups {
        drives: Vec::new(),
        warnings: Vec::new(),
    };
    let shown = machine_file.display();
    for (index, axis) in machine.axes.iter().enumerate() {
        let named = axis.drive.as_ref();
        let file = &named
            .with_context(|| format!("{shown}: axis {} has no drive", axis.name))?
            .file;
        let path = folder.join(file);
        let judged = drive_file::load(&path, None)?;
        let path = path.display();
        for warning in judged.warnings {
            let warning = format!("{path}: {warning}");
            // Several axes may have the same drive file.
            if !setups.warnings.contains(&warning) {
                setups.warnings.push(warning);
            }
        }
        let drive = judged.drive;
        let wanted = match drive.mode.operate {
            OperatingMode::Csv => DriveMode::Velocity,
            OperatingMode::Cst => DriveMode::Torque,
            OperatingMode::Csp => bail!(
                "{path}: mode.operate = \"csp\": axis {} cannot be driven so yet: use csv or cst (`quadrant bus drive-file --mode`)",
                axis.name
            ),
        };
        if axis.drive_mode != wanted {
            let (word, key) = match wanted {
                DriveMode::Velocity => ("csv", "velocity"),
                DriveMode::Torque => ("cst", "torque"),
            };
            bail!(
                "{shown}: axis {}: drive_mode must be \"{key}\": its drive file has mode.operate = \"{word}\"",
                axis.name
            );
        }
        let (of_drive, of_machine) = (drive.scaling.dead_time_scans, machine.scan.dead_time_scans);
        if of_drive != of_machine {
            bail!(
                "{shown}: scan.dead_time_scans = {of_machine}: the drive of axis {} has scaling.dead_time_scans = {of_drive}: make them the same",
                axis.name
            );
        }
        setups.drives.push(DriveSetup {
            drive,
            slave: machine.slave_of(index),
        });
    }
    Ok(Some(setups))
}
