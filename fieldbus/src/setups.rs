//! The drive and terminal files of a machine, read and judged together with it.

use std::path::Path;

use anyhow::{Context, bail};
use machine::{Axis, DriveMode, Fieldbus, HomingMethod, Machine, Spindle, SpindleDrive};

use crate::cia402::{self, OperatingMode};
use crate::drive_file::{self, DriveFile};
pub use crate::drives::Setups;
use crate::drives::{
    DriveSetup, Edge, SignalDevice, SignalPlaces, TerminalSetup, TouchProbe, Units, encoder_range,
};
use crate::process_data;
use crate::terminal_file::{self, Channel, ChannelDirection};

/// Scans from the death of an owner of the bus to the first frame of its standby, at most
/// (docs/developers/measurements.md: the largest gap was 3.3 ms at 1 ms).
const TAKE_OVER_SCANS: u32 = 4;

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
        spindle: None,
        terminals: Vec::new(),
        signals: SignalPlaces::default(),
        warnings: Vec::new(),
    };
    let shown = machine_file.display();
    if let Some(warning) = watchdog_that_does_not_fit(machine, bus) {
        setups.warnings.push(format!("{shown}: {warning}"));
    }
    for (index, axis) in machine.axes.iter().enumerate() {
        let named = axis.drive.as_ref();
        let named = named.with_context(|| format!("{shown}: axis {} has no drive", axis.name))?;
        let path = folder.join(&named.file);
        let file = setups.load_drive(&path)?;
        let axis_of_drive = (named.axis - 1) as u16;
        let drive = file.of_axis(axis_of_drive);
        judge_axis(axis, &drive).with_context(|| shown.to_string())?;
        judge_mode(axis, &drive).with_context(|| shown.to_string())?;
        judge_inputs(axis, &drive).with_context(|| shown.to_string())?;
        judge_brake(axis, &drive).with_context(|| shown.to_string())?;
        judge_homing(machine, axis, &drive).with_context(|| shown.to_string())?;
        judge_probe(axis, &drive).with_context(|| shown.to_string())?;
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
            torque_limit: torque_limit(axis, &drive).with_context(|| shown.to_string())?,
            drive,
            device: file.process_data,
            axis: axis_of_drive,
        });
    }
    if let (Some(of_bus), Some(spindle)) = (&bus.spindle, &machine.spindle) {
        let drive = setups.load_drive(&folder.join(&of_bus.file))?;
        judge_spindle(of_bus, spindle, &drive).with_context(|| shown.to_string())?;
        setups.spindle = Some(DriveSetup {
            slave: of_bus.slave as usize,
            following_error_increments: u32::MAX,
            torque_limit: None,
            device: drive.process_data.clone(),
            axis: 0,
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

/// Whether the drives stop by themselves, or are given up, before anybody can do something about a silence.
fn watchdog_that_does_not_fit(machine: &Machine, bus: &Fieldbus) -> Option<String> {
    let (hang_scans, reason) = match bus.standby {
        true => (
            machine.bus_hang_scans(),
            "before the standby can have replaced an owner of the bus that hangs",
        ),
        false => (0, "as soon as a frame or two come late"),
    };
    let least_scans = hang_scans + TAKE_OVER_SCANS;
    let period_us = machine.scan.period_us;
    let least_ms = (least_scans * period_us).div_ceil(1000);
    let (of_scan, of_bus) = (machine.scan.watchdog_scans, bus.watchdog_scans(period_us));
    if of_bus < least_scans {
        return Some(format!(
            "bus.watchdog_ms = {}: the drives stop by themselves {reason}; at least {least_ms} fits a scan of {period_us} µs",
            bus.watchdog_ms
        ));
    }
    (of_scan < least_scans).then(|| {
        format!(
            "scan.watchdog_scans = {of_scan}: drives are given up {reason}; at least {least_scans}"
        )
    })
}

impl Setups {
    /// Reads a drive file, and keeps its warnings.
    fn load_drive(&mut self, path: &Path) -> anyhow::Result<DriveFile> {
        let judged = drive_file::load(path, |_, _| ())?;
        let path = path.display();
        for warning in judged.warnings {
            let warning = format!("{path}: {warning}");
            // Several axes may have the same drive file.
            if !self.warnings.contains(&warning) {
                self.warnings.push(warning);
            }
        }
        Ok(judged.drive)
    }

    /// What a machine has at each place on the cable, and which signals that carries: a line each, in the order of the cable.
    pub fn places_in_words(&self, machine: &Machine) -> Vec<(usize, String)> {
        let axes = self.drives.iter().zip(&machine.axes).enumerate();
        let mut places: Vec<(usize, String)> = axes
            .map(|(index, (drive, axis))| {
                let name = &drive.drive.identity.name;
                let of_drive = match drive.axis {
                    0 => String::new(),
                    axis => format!(" (its axis {})", axis + 1),
                };
                let signals = self.signals_in_words(machine, SignalDevice::Drive(index));
                let words = format!("axis {}, {name}{of_drive}{signals}", axis.name);
                (drive.slave, words)
            })
            .collect();
        if let Some(spindle) = &self.spindle {
            let words = format!("spindle, {}", spindle.drive.identity.name);
            places.push((spindle.slave, words));
        }
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

/// An axis of a drive of several has its own objects in what the drive exchanges.
fn judge_axis(axis: &Axis, drive: &DriveFile) -> anyhow::Result<()> {
    let (data, operate) = (&drive.process_data, drive.mode.operate);
    let number = axis.drive.as_ref().map_or(1, |drive| drive.axis);
    if number > 1 && !process_data::holds(&data.receive, &data.transmit, operate) {
        let needed = [operate.receive_needed(), operate.transmit_needed()].concat();
        let needed: Vec<String> = needed
            .iter()
            .map(|object| format!("{:04X}", cia402::on_axis(*object, (number - 1) as u16)))
            .collect();
        bail!(
            "axis {}: drive.axis = {number}: needs {} in the process data of its drive file",
            axis.name,
            needed.join(", ")
        );
    }
    Ok(())
}

/// The drive closes the loops that the servo leaves to it.
fn judge_mode(axis: &Axis, drive: &DriveFile) -> anyhow::Result<()> {
    let (name, operate) = (&axis.name, drive.mode.operate);
    let (wanted, key) = match operate {
        OperatingMode::Csv => (DriveMode::Velocity, "velocity"),
        OperatingMode::Csp => (DriveMode::Position, "position"),
        OperatingMode::Cst => (DriveMode::Torque, "torque"),
        OperatingMode::ProfileVelocity | OperatingMode::Velocity => bail!(
            "axis {name}: its drive file has mode.operate = \"{}\", which is for spindles ([bus.spindle]): an axis is driven in csv, cst \
             or csp",
            operate.word()
        ),
    };
    if axis.drive_mode != wanted {
        bail!(
            "axis {name}: drive_mode must be \"{key}\": its drive file has mode.operate = \"{}\"",
            operate.word()
        );
    }
    Ok(())
}

/// The drive of a spindle is told a speed in each cycle, also the highest one.
fn judge_spindle(
    of_bus: &SpindleDrive,
    spindle: &Spindle,
    drive: &DriveFile,
) -> anyhow::Result<()> {
    let operate = drive.mode.operate;
    if !operate.is_told_speed() {
        bail!(
            "bus.spindle: its drive file has mode.operate = \"{}\": a spindle is driven in csv, profile-velocity or velocity",
            operate.word()
        );
    }
    let data = &drive.process_data;
    let (target, _) = operate.velocity_objects();
    let bits = process_data::find(&data.receive, target, 0).map_or(32, |(_, entry)| entry.bits);
    let turn_s = Units::of(drive, 1.0 / of_bus.motor_turns)
        .velocity_per_mm_s
        .abs();
    let most = spindle.speed_max_rpm / 60.0 * turn_s;
    let largest = 2.0_f64.powi(bits as i32 - 1) - 1.0;
    if most > largest {
        bail!(
            "spindle.speed_max_rpm = {}: is {most:.0} units of its drive, whose target velocity ({target:04X}) holds {largest:.0} at most: \
             look at scaling.velocity_units and velocity_rpm of its drive file",
            spindle.speed_max_rpm
        );
    }
    let shows_position = process_data::find(&data.transmit, cia402::POSITION, 0).is_some();
    if spindle.encoder_counts_per_turn > 0 && !shows_position {
        bail!(
            "spindle.encoder_counts_per_turn = {}: needs 6064 (actual position) in process_data.transmit of the drive file of the spindle",
            spindle.encoder_counts_per_turn
        );
    }
    Ok(())
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

/// The limit of the torque of a drive, in thousandths of the rated one: the machine does not count on more, and no cycle says another.
fn torque_limit(axis: &Axis, drive: &DriveFile) -> anyhow::Result<Option<u16>> {
    let limit_percent = axis.drive.as_ref().and_then(|of| of.torque_limit_percent);
    let Some(limit_percent) = limit_percent else {
        return Ok(None);
    };
    let (name, receive) = (&axis.name, &drive.process_data.receive);
    let key = format!("axis {name}: drive.torque_limit_percent = {limit_percent}");
    let mut limits = cia402::TORQUE_LIMITS.iter();
    if let Some(object) = limits.find(|of| process_data::find(receive, **of, 0).is_some()) {
        bail!(
            "{key}: {object:04X} is in process_data.receive of its drive file, and the value of its entry counts: write that, and take this \
             key out"
        );
    }
    let limit_nm = limit_percent / 100.0 * drive.scaling.rated_torque_nm;
    let peak_nm = axis.motor.peak_torque_nm;
    if peak_nm > limit_nm * 1.001 {
        bail!(
            "{key}: is {limit_nm:.2} N·m, and motor.peak_torque_nm = {peak_nm}: the machine counts on more than the drive may give; make it \
             {limit_nm:.2} at most"
        );
    }
    Ok(Some((limit_percent * 10.0).round() as u16))
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

/// What finds the axis's place is there: in the process data of its drive, or among the digital inputs of the machine.
fn judge_homing(machine: &Machine, axis: &Axis, drive: &DriveFile) -> anyhow::Result<()> {
    let Some(homing) = &axis.homing else {
        return judge_encoder(axis, drive);
    };
    let (name, data) = (&axis.name, &drive.process_data);
    let mapped = process_data::find(&data.receive, cia402::MODE, 0).is_some()
        && process_data::find(&data.transmit, cia402::MODE_DISPLAY, 0).is_some();
    if homing.method == HomingMethod::Drive && !mapped {
        bail!(
            "axis {name}: homing.method = \"drive\" needs 6060 and 6061 in the process data of its drive file"
        );
    }
    if homing.method.has_index() && !can_latch(drive, Edge::Index) {
        bail!(
            "axis {name}: homing by index needs 60B8, 60B9 and 60BC (or 60BA) in the process data of its drive file: its touch-probe unit \
             latches the index"
        );
    }
    let switch = homing.switch_input.filter(|_| homing.method.has_switch());
    if let Some(input) = switch.filter(|input| !machine.has_digital_input(*input)) {
        bail!(
            "axis {name}: homing.switch_input = {input}: no drive ([axis.drive] input_bits) and no signal ([signal.to] input) is this input"
        );
    }
    Ok(())
}

/// The travel of an axis with an absolute encoder fits into what the encoder tells apart.
fn judge_encoder(axis: &Axis, drive: &DriveFile) -> anyhow::Result<()> {
    let Some(turns) = axis.drive.as_ref().and_then(|drive| drive.encoder_turns) else {
        return Ok(());
    };
    let mm_per_increment = Units::of(drive, axis.lead_mm).mm_per_increment.abs();
    let range_mm = encoder_range(drive, Some(turns)) as f64 * mm_per_increment;
    let travel_mm = axis.travel_max_mm - axis.travel_min_mm;
    if axis.modulo || travel_mm >= range_mm {
        let what = match axis.modulo {
            true => "turns without end".to_string(),
            false => format!("has a travel of {travel_mm:.1} mm"),
        };
        bail!(
            "axis {}: drive.encoder_turns = {turns}: its encoder shows the same again after {range_mm:.1} mm, and the axis {what}: home it \
             ([axis.homing])",
            axis.name
        );
    }
    Ok(())
}

/// The drive latches the contact of the probe, both ways.
fn judge_probe(axis: &Axis, drive: &DriveFile) -> anyhow::Result<()> {
    let edge = axis.drive.as_ref().and_then(|drive| drive.probe_edge);
    if edge.is_some_and(|edge| !can_latch(drive, edge.into())) {
        bail!(
            "axis {}: drive.probe_edge needs 60B8, 60B9, and 60BA (rising) or 60BB (falling) in the process data of its drive file: its touch-probe unit \
             latches the contact",
            axis.name
        );
    }
    Ok(())
}

fn can_latch(drive: &DriveFile, edge: Edge) -> bool {
    let data = &drive.process_data;
    let unit = TouchProbe::of(&data.receive, &data.transmit, false);
    unit.is_some_and(|unit| unit.can(edge))
}
