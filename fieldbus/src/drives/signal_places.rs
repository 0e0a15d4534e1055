//! Which bits of which device the signals of a machine are.

use machine::{Machine, Signal, SignalKind};

use super::cia402_drives::DriveSetup;
use super::signals::TerminalSetup;
use crate::cia402;
use crate::process_data;
use crate::terminal_file::{ChannelCode, ChannelDirection, ChannelKind};

/// A device that has inputs or outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SignalDevice {
    /// The drive of this axis.
    Drive(usize),
    /// The terminal of this index in the machine file.
    Terminal(usize),
}

/// A signal that a device shows, or that goes to one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignalPlace {
    /// Index of the signal in the machine file.
    pub signal: usize,
    /// The device.
    pub device: SignalDevice,
    /// Its place on the cable, from 0.
    pub slave: usize,
    /// Where it is in the process data of the device.
    pub code: ChannelCode,
    /// What the device is sent while nobody commands it.
    pub lost: f64,
}

/// The signals of a machine that devices on its bus have.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SignalPlaces {
    /// Those that devices show.
    pub inputs: Vec<SignalPlace>,
    /// Those that go to devices.
    pub outputs: Vec<SignalPlace>,
}

impl SignalPlaces {
    /// Finds the bits of each signal.
    ///
    /// # Errors
    /// A signal names what no drive or terminal has: a line for each.
    pub fn of(
        machine: &Machine,
        drives: &[DriveSetup],
        terminals: &[TerminalSetup],
    ) -> anyhow::Result<SignalPlaces> {
        let mut places = SignalPlaces::default();
        let mut wrong = Vec::new();
        for (index, signal) in machine.signals.iter().enumerate() {
            let from = &signal.from;
            let to = signal.to.clone().unwrap_or_default();
            let input = Named {
                drive: from.drive.as_deref().zip(from.bit),
                terminal: from.terminal.zip(from.channel),
                direction: ChannelDirection::Input,
            };
            let output = Named {
                drive: to.drive.as_deref().zip(to.bit),
                terminal: to.terminal.zip(to.channel),
                direction: ChannelDirection::Output,
            };
            for (named, key, found) in [
                (input, "from", &mut places.inputs),
                (output, "to", &mut places.outputs),
            ] {
                match named.find(machine, signal, drives, terminals) {
                    Ok(all) => {
                        found.extend(all.into_iter().map(|(device, slave, code)| SignalPlace {
                            signal: index,
                            device,
                            slave,
                            code,
                            lost: signal.lost_value(),
                        }))
                    }
                    Err(what) => wrong.push(format!("signal {:?}: {key}: {what}", signal.name)),
                }
            }
        }
        anyhow::ensure!(wrong.is_empty(), "{}", wrong.join("\n"));
        Ok(places)
    }
}

/// What a signal names.
struct Named<'a> {
    drive: Option<(&'a str, u32)>,
    terminal: Option<(u32, u32)>,
    direction: ChannelDirection,
}

impl Named<'_> {
    fn find(
        &self,
        machine: &Machine,
        signal: &Signal,
        drives: &[DriveSetup],
        terminals: &[TerminalSetup],
    ) -> Result<Vec<(SignalDevice, usize, ChannelCode)>, String> {
        let mut found = Vec::new();
        if let Some((axis, bit)) = self.drive {
            let axis = machine.axis_index(axis)? as usize;
            let drive = drives.get(axis).ok_or("has no drive")?;
            let code = self.of_drive(drive, signal, bit)?;
            found.push((SignalDevice::Drive(axis), drive.slave, code));
        }
        if let Some((place, number)) = self.terminal {
            let mut all = terminals.iter().enumerate();
            let at = all.find(|(_, of)| of.slave == place as usize);
            let (index, terminal) =
                at.ok_or_else(|| format!("there is no [[bus.terminal]] with slave = {place}"))?;
            let code = self.of_terminal(terminal, signal, number)?;
            found.push((SignalDevice::Terminal(index), terminal.slave, code));
        }
        Ok(found)
    }

    /// A bit of a drive's digital inputs or outputs.
    fn of_drive(
        &self,
        drive: &DriveSetup,
        signal: &Signal,
        bit: u32,
    ) -> Result<ChannelCode, String> {
        if signal.kind != SignalKind::Bool {
            return Err("a bit of a drive is a switch: kind = \"bool\"".into());
        }
        let data = &drive.drive.process_data;
        let (pdos, (index, sub), words) = match self.direction {
            ChannelDirection::Input => (
                &data.transmit,
                (cia402::DIGITAL_INPUTS, 0),
                "60FD (digital inputs, 32 bits) in process_data.transmit",
            ),
            ChannelDirection::Output => (
                &data.receive,
                (cia402::DIGITAL_OUTPUTS, 1),
                "60FE:1 (digital outputs, 32 bits) in process_data.receive",
            ),
        };
        let (at_bits, _) = process_data::find(pdos, index, sub)
            .filter(|(_, entry)| bit < entry.bits)
            .ok_or_else(|| format!("bit {bit} needs {words} of the drive file"))?;
        Ok(ChannelCode::bit(at_bits.saturating_add(bit) as usize))
    }

    /// A channel of a terminal.
    fn of_terminal(
        &self,
        terminal: &TerminalSetup,
        signal: &Signal,
        number: u32,
    ) -> Result<ChannelCode, String> {
        let file = &terminal.terminal;
        let name = &file.identity.name;
        let place = terminal.slave;
        let Some(channel) = file.channel(number) else {
            let numbers = file.channels.iter().map(|of| of.number.to_string());
            let numbers = numbers.collect::<Vec<_>>().join(", ");
            return Err(format!(
                "terminal {place} ({name}) has no channel {number}: it has {numbers}"
            ));
        };
        let (is, wanted) = (channel.direction.word(), self.direction.word());
        if is != wanted {
            return Err(format!(
                "channel {number} of terminal {place} ({name}) is an {is}, and named as {wanted}"
            ));
        }
        let is_switch = channel.kind == ChannelKind::Bool;
        // An input that is a switch can be shown as a number.
        let goes = match self.direction {
            ChannelDirection::Input => is_switch || signal.kind != SignalKind::Bool,
            ChannelDirection::Output => is_switch == (signal.kind == SignalKind::Bool),
        };
        if !goes {
            let (kind, wanted) = (channel.kind.word(), signal.kind.word());
            return Err(format!(
                "channel {number} of terminal {place} ({name}) has the kind {kind}, the signal {wanted}"
            ));
        }
        let code = file.code(channel);
        code.ok_or_else(|| format!("channel {number} of terminal {place} ({name}) has no bits"))
    }
}
