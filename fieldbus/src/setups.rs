//! The drive and terminal files of a machine, read and judged together with it.

use std::path::Path;

use anyhow::{Context, bail};
use machine::{Axis, DriveMode, HomingMethod, Machine};

use crate::cia402::{self, OperatingMode};
use crate::drive_file::{self, DriveFile};
pub use crate::drives::Setups;
use crate::drives::{DriveSetup, SignalDevice, SignalPlaces, TerminalSetup, Units};
use crate::process_data;
use crate::terminal_file::{self, Channel, ChannelDirection};

/// Reads the drive and terminal files of a machine whose file is this; none without `[bus]`.
///
/// # Errors
/// A file that cannot be used, or does not go with the machine file: one line for each thing.
pub fn load(machine: &Machine, machine_file: &Path) -> anyhow::Result<Option<Setups>> {
    let Some(bus) = &machine.bus else {
        return Ok(None);
    };
    let folder = machine_file.parent().unwrap_or(Path::new(""));
    let mut setups = Setups {
        drives: Vec::new(),
        terminals: Vec::new(),
        signals: SignalPlaces::default(),
        warnings: Vec::new(),
    };
    let shown = machine_file.display();
    for (index, axis) in machine.axes.iter().enumerate() {
        let named = axis.drive.as_ref();
        let named = named.with_context(|| format!("{shown}: axis {} has no drive", axis.name))?;
        let path = folder.join(&named.file);
        let judged = drive_file::load(&path, |_, _| ())?;
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
            OperatingMode::Csp => DriveMode::Position,
            OperatingMode::Cst => DriveMode::Torque,
        };
        if axis.drive_mode != wanted {
            let key = match wanted {
                DriveMode::Velocity => "velocity",
                DriveMode::Torque => "torque",
                DriveMode::Position => "position",
            };
            let (axis, operate) = (&axis.name, drive.mode.operate.word());
            bail!(
                "{shown}: axis {axis}: drive_mode must be \"{key}\": its drive file has mode.operate = \"{operate}\""
            );
        }
        judge_inputs(axis, &drive).with_context(|| shown.to_string())?;
        judge_brake(axis, &drive).with_context(|| shown.to_string())?;
        judge_homing(axis, &drive).with_context(|| shown.to_string())?;
        let (of_drive, of_machine) = (drive.scaling.dead_time_scans, machine.scan.dead_time_scans);
        if of_drive != of_machine {
            bail!(
                "{shown}: scan.dead_time_scans = {of_machine}: the drive of axis {} has scaling.dead_time_scans = {of_drive}: make them the same",
                axis.name
            );
        }
        let mm_per_increment = Units::of(&drive, axis.lead_mm).mm_per_increment.abs();
        let window = (axis.following_error_limit_mm / mm_per_increment).round();
        setups.drives.push(DriveSetup {
            slave: machine.slave_of(index),
            following_error_increments: window as u32,
            drive,
        });
    }
    for terminal in &bus.terminals {
        setups.terminals.push(TerminalSetup {
            terminal: terminal_file::load(&folder.join(&terminal.file), |_, _| ())?,
            slave: terminal.slave as usize,
        });
    }
    let signals = SignalPlaces::of(machine, &setups.drives, &setups.terminals);
    setups.signals = signals.with_context(|| shown.to_string())?;
    Ok(Some(setups))
}

impl Setups {
    /// What a machine has at each place on the cable, and which signals that carries: a line each, in the order of the cable.
    pub fn places_in_words(&self, machine: &Machine) -> Vec<(usize, String)> {
        let axes = self.drives.iter().zip(&machine.axes).enumerate();
        let mut places: Vec<(usize, String)> = axes
            .map(|(index, (drive, axis))| {
                let name = &drive.drive.identity.name;
                let signals = self.signals_in_words(machine, SignalDevice::Drive(index));
                (drive.slave, format!("axis {}, {name}{signals}", axis.name))
            })
            .collect();
        for (index, terminal) in self.terminals.iter().enumerate() {
            let file = &terminal.terminal;
            let is_input = |of: &&Channel| of.direction == ChannelDirection::Input;
            let inputs = file.channels.iter().filter(is_input).count();
            let outputs = file.channels.len() - inputs;
            let signals = self.signals_in_words(machine, SignalDevice::Terminal(index));
            let name = &file.identity.name;
            let words = format!("terminal {name}, {inputs} inputs and {outputs} outputs{signals}");
            places.push((terminal.slave, words));
        }
        let others = machine.bus.iter().flat_map(|bus| &bus.other_slaves);
        places.extend(others.map(|place| (*place as usize, "left alone".into())));
        places.sort();
        places
    }

    /// The signals of a device: `: door from channel 2, pump to channel 9`.
    fn signals_in_words(&self, machine: &Machine, device: SignalDevice) -> String {
        let mut words = Vec::new();
        let both = [
            (&self.signals.inputs, "from"),
            (&self.signals.outputs, "to"),
        ];
        for (places, way) in both {
            for place in places.iter().filter(|place| place.device == device) {
                let Some(signal) = machine.signals.get(place.signal) else {
                    continue;
                };
                let to = signal.to.clone().unwrap_or_default();
                let (bit, channel) = match way {
                    "from" => (signal.from.bit, signal.from.channel),
                    _ => (to.bit, to.channel),
                };
                let (what, number) = match device {
                    SignalDevice::Drive(_) => ("bit", bit),
                    SignalDevice::Terminal(_) => ("channel", channel),
                };
                let at = format!("{what} {}", number.unwrap_or_default());
                words.push(format!("{} {way} {at}", signal.name));
            }
        }
        match words.is_empty() {
            true => String::new(),
            false => format!(": {}", words.join(", ")),
        }
    }
}

/// Inputs of the drive that are inputs of the machine come in each cycle.
fn judge_inputs(axis: &Axis, drive: &DriveFile) -> anyhow::Result<()> {
    let named = axis.drive.as_ref();
    let wanted = named.is_some_and(|drive| !drive.input_bits.is_empty());
    let mapped = process_data::find(&drive.process_data.transmit, cia402::DIGITAL_INPUTS, 0);
    if wanted && mapped.is_none() {
        bail!(
            "axis {}: drive.input_bits needs 60FD (digital inputs, 32 bits) in process_data.transmit of its drive file",
            axis.name
        );
    }
    Ok(())
}

/// A brake that the controller opens is opened in each cycle, and closes where nothing is sent.
fn judge_brake(axis: &Axis, drive: &DriveFile) -> anyhow::Result<()> {
    if axis.commanded_brake().is_none() {
        return Ok(());
    }
    let (name, receive) = (&axis.name, &drive.process_data.receive);
    match process_data::find(receive, cia402::DIGITAL_OUTPUTS, 1) {
        None => bail!(
            "axis {name}: brake.by = \"controller\" needs 60FE:1 (physical outputs) in process_data.receive of its drive file, and the \
             mask of its bit 0 in 60FE:2; most drives open the brake themselves: \"drive\""
        ),
        Some((_, entry)) if entry.value & 1 == 1 => bail!(
            "axis {name}: brake.by = \"controller\": the value of 60FE:1 in its drive file opens the brake for good: clear its bit 0"
        ),
        Some(_) => Ok(()),
    }
}

/// What finds the axis's place is there: the drive itself, where it can be asked to in each cycle.
fn judge_homing(axis: &Axis, drive: &DriveFile) -> anyhow::Result<()> {
    let Some(homing) = &axis.homing else {
        return Ok(());
    };
    if homing.method != HomingMethod::Drive {
        bail!(
            "axis {}: homing.method must be \"drive\" on a bus: switches and index pulses of drives are not read yet",
            axis.name
        );
    }
    let data = &drive.process_data;
    let mapped = process_data::find(&data.receive, cia402::MODE, 0).is_some()
        && process_data::find(&data.transmit, cia402::MODE_DISPLAY, 0).is_some();
    if !mapped {
        bail!(
            "axis {}: homing.method = \"drive\" needs 6060 and 6061 in the process data of its drive file",
            axis.name
        );
    }
    Ok(())
}
