//! One drive: what it is sent and what it shows, in its own numbers and in those of the machine.

use bus::drive_codes::Silence;
use bus::drive_page::{Inputs, SlaveWiring};
use master::{DriveCommand, DriveFeedback, DriveState};

use super::encoder_place::{AbsoluteEncoder, EncoderPlace};
use super::homing::DriveHoming;
use super::position_target::PositionTarget;
use super::state_walk::{DeviceState, QUICK_STOP, StateWalk, Want};
use super::touch_probe::{Edge, TouchProbe};
use super::units::Units;
use crate::cia402::{self, OperatingMode};
use crate::drive_file::DriveFile;
use crate::field::Field;
use crate::process_data::{self, Pdo};

/// Bit 11 of the statusword: a limit of the drive is active.
const LIMIT_ACTIVE: u16 = 1 << 11;
/// Bits 4 to 6 of the controlword in mode 2: the converter's ramp runs, is not frozen, and follows the target.
const CONVERTER_RUNS: u16 = 0x70;

/// What a drive moves.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moved {
    /// Travel of one turn of its motor, in mm; of a spindle in turns.
    pub lead_mm: f64,
    /// Deceleration of its stops, in mm/s².
    pub quick_stop_mm_s2: f64,
    /// It has to be homed.
    pub is_homed: bool,
    /// The controller opens its brake.
    pub has_brake: bool,
    /// Its encoder, where that is absolute.
    pub encoder: AbsoluteEncoder,
    /// The index of the motor encoder is looked for.
    pub looks_for_index: bool,
    /// Which edge of the probe input of its drive is contact, where the drive latches it.
    pub probe_edge: Option<Edge>,
}

/// Fields of the process data of a drive, from the start of its own.
#[derive(Debug, Clone)]
pub(super) struct Fields {
    controlword: Field,
    mode: Option<Field>,
    target_velocity: Option<Field>,
    target_torque: Option<Field>,
    target_position: Option<Field>,
    velocity_offset: Option<Field>,
    torque_offset: Option<Field>,
    /// The physical outputs, where the controller opens and closes the brake by their bit 0.
    brake: Option<Field>,
    /// What has no command of its own.
    constants: Vec<(Field, i64)>,
    statusword: Field,
    mode_display: Option<Field>,
    position: Option<Field>,
    velocity: Option<Field>,
    torque: Option<Field>,
    error_code: Option<Field>,
    digital_inputs: Option<Field>,
}

/// Writes where the drive takes it.
fn write(field: Option<Field>, own: &mut [u8], value: i64) {
    if let Some(field) = field {
        field.write_signed(own, value);
    }
}

impl Fields {
    /// Of a drive file; none if it has no controlword or statusword, or an axis no position, which its rules refuse.
    fn of(drive: &DriveFile, has_brake: bool) -> Option<Fields> {
        let (receive, transmit) = (&drive.process_data.receive, &drive.process_data.transmit);
        let field = |pdos: &[Pdo], index: u16| process_data::field(pdos, index, 0);
        let (target_velocity, velocity) = drive.mode.operate.velocity_objects();
        let position = field(transmit, cia402::POSITION);
        if position.is_none() && drive.mode.operate.drives_axes() {
            return None;
        }
        Some(Fields {
            controlword: field(receive, cia402::CONTROLWORD)?,
            mode: field(receive, cia402::MODE),
            target_velocity: field(receive, target_velocity),
            target_torque: field(receive, cia402::TARGET_TORQUE),
            target_position: field(receive, cia402::TARGET_POSITION),
            velocity_offset: field(receive, cia402::VELOCITY_OFFSET),
            torque_offset: field(receive, cia402::TORQUE_OFFSET),
            brake: process_data::field(receive, cia402::DIGITAL_OUTPUTS, 1).filter(|_| has_brake),
            constants: process_data::constants(receive),
            statusword: field(transmit, cia402::STATUSWORD)?,
            mode_display: field(transmit, cia402::MODE_DISPLAY),
            position,
            velocity: field(transmit, velocity),
            torque: field(transmit, cia402::TORQUE),
            error_code: field(transmit, cia402::ERROR_CODE),
            digital_inputs: field(transmit, cia402::DIGITAL_INPUTS),
        })
    }
}

/// One drive.
#[derive(Debug, Clone)]
pub(super) struct DriveAxis {
    fields: Fields,
    units: Units,
    operate: OperatingMode,
    /// The controller wants its brake open.
    pub opens_brake: bool,
    scan_s: f64,
    quick_stop_mm_s2: f64,
    walk: StateWalk,
    /// What it knows of its place.
    pub homing: DriveHoming,
    encoder: EncoderPlace,
    /// Increments counted over the ends of 32 bits.
    pub counted: i64,
    /// It has been seen once: `counted` is its own.
    seen: bool,
    /// The position that the drive showed last to this process.
    raw: Option<i32>,
    touch_probe: Option<TouchProbe>,
    /// The edge of the probe input that is contact, where the drive latches it.
    contact: Option<Edge>,
    /// Which change of the contact is waited for: made, or lost.
    pub watches: Option<bool>,
    /// The start-up in which it was seen last; 0 for none.
    pub start_up: u64,
    device: DeviceState,
    missed: u32,
    /// Missed cycles in a row after which the drive counts as lost. What the drive makes of them it says in the next cycle that comes
    /// back.
    missed_max: u32,
    /// Velocity that is commanded, in mm/s: a stop brakes from there.
    commanded_mm_s: f64,
    /// What rounding of velocity targets has left over, in the drive's unit.
    left_over: f64,
    /// Where the drive is to be, if it closes the position loop.
    target: PositionTarget,
    /// What it shows.
    pub shown: DriveFeedback,
    /// Object 60FDh as it was shown last; 0 while the drive is lost.
    pub digital_inputs: u32,
}

impl DriveAxis {
    /// The drive of an axis, before it has been seen; none if its file lacks what every mode needs.
    pub fn new(drive: &DriveFile, moved: Moved, scan_s: f64, missed_max: u32) -> Option<DriveAxis> {
        let data = &drive.process_data;
        let units = Units::of(drive, moved.lead_mm);
        Some(DriveAxis {
            fields: Fields::of(drive, moved.has_brake)?,
            opens_brake: false,
            units,
            encoder: EncoderPlace::of(drive, &moved.encoder, units.mm_per_increment),
            raw: None,
            touch_probe: TouchProbe::of(&data.receive, &data.transmit, moved.looks_for_index)
                .filter(|_| moved.looks_for_index || moved.probe_edge.is_some()),
            contact: moved.probe_edge,
            watches: None,
            operate: drive.mode.operate,
            scan_s,
            quick_stop_mm_s2: moved.quick_stop_mm_s2,
            walk: StateWalk::default(),
            homing: DriveHoming::new(moved.is_homed),
            counted: 0,
            seen: false,
            start_up: 0,
            device: DeviceState::NotReady,
            missed: 0,
            missed_max,
            commanded_mm_s: 0.0,
            left_over: 0.0,
            target: PositionTarget::default(),
            shown: DriveFeedback {
                referenced: !moved.is_homed,
                state: DriveState::Lost { code: 0 },
                ..DriveFeedback::default()
            },
            digital_inputs: 0,
        })
    }

    /// Goes on from a count that was saved, what the drive shows is the nearest to it; and from its reference.
    pub fn count_from(&mut self, counted: i64, referenced: bool) {
        let shown = |raw| self.encoder.place(raw, Some(counted));
        self.counted = self.raw.map_or(counted, shown);
        self.seen = true;
        self.homing.restore(referenced);
    }

    /// Writes what it is sent for a command, and what it is to be sent if no other comes, where zeros are.
    pub fn command(
        &mut self,
        command: &DriveCommand,
        wiring: &SlaveWiring,
        image: &mut [u8],
        silent: &mut [u8],
    ) {
        let outputs = |image: &mut [u8], write: &mut dyn FnMut(&mut [u8])| {
            let from = usize::from(wiring.outputs_at);
            let to = from + usize::from(wiring.output_bytes);
            if let Some(own) = image.get_mut(from..to) {
                write(own);
            }
        };
        let want = self.want(command);
        self.homing.command(*command == DriveCommand::Home);
        let controlword = self.walk.controlword(self.device, want) | self.homing.control_bits();
        let operates = self.device == DeviceState::OperationEnabled;
        let follows = operates && want != Want::Off;
        let homes = self.homing.mode().is_some();
        if !follows || homes || self.shown.state != DriveState::Ready {
            self.target.leave();
        }
        let converter_runs = follows && self.operate == OperatingMode::Velocity;
        let controlword = controlword | if converter_runs { CONVERTER_RUNS } else { 0 };
        let torque_nm = self.target(command, follows);
        let position_mm = match *command {
            DriveCommand::Position { position_mm, .. } => Some(position_mm),
            _ => None,
        };
        outputs(image, &mut |own| {
            self.write_common(own, controlword);
            self.write_brake(own);
            self.write_touch_probe(own);
            self.write_targets(own, position_mm, torque_nm, follows);
        });
        outputs(silent, &mut |own| {
            let stops = if operates || self.device == DeviceState::QuickStopActive {
                QUICK_STOP
            } else {
                controlword & 0x07
            };
            self.write_common(own, stops);
            self.write_rest(own);
        });
    }

    fn want(&self, command: &DriveCommand) -> Want {
        match command {
            DriveCommand::Disabled => Want::Off,
            DriveCommand::SwitchOn => Want::SwitchOn,
            DriveCommand::Velocity { .. }
            | DriveCommand::Position { .. }
            | DriveCommand::Torque { .. }
            | DriveCommand::Home => Want::Operate,
            // Without a velocity or position loop of its own to brake in, the drive brakes as it can.
            DriveCommand::Brake { .. } if self.operate == OperatingMode::Cst => Want::QuickStop,
            DriveCommand::Brake { .. } => Want::Operate,
        }
    }

    /// Takes the command; the torque that goes with it, in N·m.
    fn target(&mut self, command: &DriveCommand, follows: bool) -> f64 {
        if !follows {
            self.commanded_mm_s = 0.0;
            self.left_over = 0.0;
            return 0.0;
        }
        match *command {
            DriveCommand::Velocity {
                velocity_mm_s: mm_s,
                torque_offset_nm,
            }
            | DriveCommand::Position {
                velocity_offset_mm_s: mm_s,
                torque_offset_nm,
                ..
            } => {
                self.commanded_mm_s = mm_s;
                torque_offset_nm
            }
            DriveCommand::Torque { torque_nm } => torque_nm,
            DriveCommand::Brake { deceleration_mm_s2 } => {
                let own = self.quick_stop_mm_s2;
                let named = deceleration_mm_s2 > 0.0 && deceleration_mm_s2 <= own;
                let step = if named { deceleration_mm_s2 } else { own } * self.scan_s;
                let slower = (self.commanded_mm_s.abs() - step).max(0.0);
                self.commanded_mm_s = slower.copysign(self.commanded_mm_s);
                0.0
            }
            DriveCommand::Disabled | DriveCommand::SwitchOn | DriveCommand::Home => {
                self.commanded_mm_s = 0.0;
                0.0
            }
        }
    }

    fn write_common(&self, own: &mut [u8], controlword: u16) {
        for (field, value) in &self.fields.constants {
            field.write(own, *value as u32);
        }
        self.fields.controlword.write(own, controlword.into());
        if let Some(mode) = self.fields.mode {
            let asked = self.homing.mode().unwrap_or(self.operate.value());
            mode.write_signed(own, asked);
        }
    }

    /// Bit 0 of the physical outputs opens the brake. Where nobody speaks any more it is not written, and the brake closes.
    fn write_brake(&self, own: &mut [u8]) {
        if let Some(field) = self.fields.brake {
            let bit = Field { bits: 1, ..field };
            bit.write(own, self.opens_brake.into());
        }
    }

    /// What the drive is to latch. Where nobody speaks any more it is nothing.
    fn write_touch_probe(&mut self, own: &mut [u8]) {
        let probe = self.watches.and_then(|made| self.edge(made));
        if let Some(unit) = &mut self.touch_probe {
            unit.command(probe, own);
        }
    }

    /// The edge at the drive that is contact made, or lost.
    fn edge(&self, made: bool) -> Option<Edge> {
        self.contact.map(|edge| match (edge, made) {
            (Edge::Rising, false) => Edge::Falling,
            (Edge::Falling, false) => Edge::Rising,
            (edge, _) => edge,
        })
    }

    fn write_targets(
        &mut self,
        own: &mut [u8],
        position_mm: Option<f64>,
        torque_nm: f64,
        follows: bool,
    ) {
        self.write_rest(own);
        if !follows {
            return;
        }
        let torque = libm::round(torque_nm * self.units.torque_per_nm) as i64;
        match self.operate {
            OperatingMode::Csv | OperatingMode::ProfileVelocity | OperatingMode::Velocity => {
                let wanted = self.commanded_mm_s * self.units.velocity_per_mm_s + self.left_over;
                let sent = libm::round(wanted);
                self.left_over = wanted - sent;
                write(self.fields.target_velocity, own, sent as i64);
                write(self.fields.torque_offset, own, torque);
            }
            OperatingMode::Cst => write(self.fields.target_torque, own, torque),
            OperatingMode::Csp => self.write_position_target(own, position_mm, torque),
        }
    }

    /// Where the drive is to be; velocity and torque beside it are what its loop need not find out.
    fn write_position_target(&mut self, own: &mut [u8], target: Option<f64>, torque: i64) {
        let velocity_mm_s = self.commanded_mm_s;
        let increments_per_mm = 1.0 / self.units.mm_per_increment;
        let step = velocity_mm_s * self.scan_s * increments_per_mm;
        let target = match target.map(|position_mm| position_mm * increments_per_mm) {
            Some(position) => self.target.set(self.counted, position),
            None => self.target.go_on(self.counted, step),
        };
        self.write_target_position(own, target);
        let velocity = libm::round(velocity_mm_s * self.units.velocity_per_mm_s) as i64;
        write(self.fields.velocity_offset, own, velocity);
        write(self.fields.torque_offset, own, torque);
    }

    /// Targets that move nothing: no velocity, no torque, the position where it is.
    fn write_rest(&self, own: &mut [u8]) {
        let none = [
            self.fields.target_velocity,
            self.fields.target_torque,
            self.fields.velocity_offset,
            self.fields.torque_offset,
        ];
        for field in none.into_iter().flatten() {
            field.write(own, 0);
        }
        self.write_target_position(own, self.counted);
    }

    /// A place as the drive counts: as far from what it shows as from what is counted here.
    fn write_target_position(&self, own: &mut [u8], counted: i64) {
        let target = match self.raw {
            Some(raw) => counted.wrapping_sub(self.counted).wrapping_add(raw.into()),
            None => counted,
        };
        if let Some(field) = self.fields.target_position {
            field.write(own, target as u32);
        }
    }

    /// Takes what it showed, in operation, in a cycle that was answered, of the start-up of this number.
    pub fn take(&mut self, inputs: &Inputs, wiring: &SlaveWiring, start_up: u64) {
        let from = usize::from(wiring.inputs_at);
        let to = from + usize::from(wiring.input_bytes);
        let Some(own) = inputs.image.get(from..to) else {
            self.lose(Silence::BusDown as u32);
            return;
        };
        self.missed = 0;
        let fields = &self.fields;
        let statusword = fields.statusword.read(own) as u16;
        self.device = DeviceState::of(statusword);
        let raw = fields.position.map_or(0, |field| field.read_signed(own));
        let shown_mode = fields.mode_display.map(|field| field.read_signed(own));
        let before = std::mem::replace(&mut self.start_up, start_up);
        let restarted = wiring.restarted == 1 && ![0, start_up].contains(&before);
        if restarted {
            self.homing.lose();
        }
        self.counted = match self.raw.filter(|_| !restarted) {
            // From here on the drive counts from its reference.
            _ if self.homing.take(statusword, shown_mode) => raw.into(),
            Some(before) => self.counted.saturating_add(self.encoder.step(before, raw)),
            None => self.encoder.place(raw, self.seen.then_some(self.counted)),
        };
        self.raw = Some(raw);
        let position_mm = self.counted as f64 * self.units.mm_per_increment;
        let differs_mm = position_mm - self.shown.motor_position_mm;
        let velocity_mm_s = match fields.velocity {
            Some(field) => f64::from(field.read_signed(own)) / self.units.velocity_per_mm_s,
            None if self.seen => differs_mm / self.scan_s,
            None => 0.0,
        };
        self.seen = true;
        let torque = fields.torque.map_or(0, |field| field.read_signed(own));
        let in_mode = shown_mode.is_none_or(|mode| {
            i64::from(mode) == self.operate.value() || self.homing.may_show(mode)
        });
        let code = fields.error_code.map_or(0, |field| field.read(own));
        self.digital_inputs = fields.digital_inputs.map_or(0, |field| field.read(own));
        let (mut index_mm, mut probe_mm) = (None, None);
        let came = self.touch_probe.iter_mut().flat_map(|unit| unit.take(own));
        for (edge, at) in came {
            let counted = self.counted.saturating_add(self.encoder.step(raw, at));
            let latched = match edge {
                Edge::Index => &mut index_mm,
                Edge::Rising | Edge::Falling => &mut probe_mm,
            };
            *latched = Some(counted as f64 * self.units.mm_per_increment);
        }
        self.shown = DriveFeedback {
            motor_position_mm: position_mm,
            scale_position_mm: None,
            velocity_mm_s,
            torque_nm: f64::from(torque) / self.units.torque_per_nm,
            winding_rise_k: 0.0,
            torque_limited: statusword & LIMIT_ACTIVE != 0,
            referenced: self.homing.is_referenced(),
            index_mm,
            probe_mm,
            restarted,
            state: match self.device {
                DeviceState::OperationEnabled if in_mode => DriveState::Ready,
                DeviceState::Fault | DeviceState::FaultReaction => DriveState::Fault { code },
                _ => DriveState::Off,
            },
        };
    }

    /// A cycle was not answered, for this reason: the axis goes on as it was, for a few.
    pub fn miss(&mut self, silence: Silence) {
        self.missed = self.missed.saturating_add(1);
        if self.missed >= self.missed_max {
            self.lose(silence as u32);
        } else {
            (self.shown.index_mm, self.shown.probe_mm) = (None, None);
            self.shown.motor_position_mm += self.shown.velocity_mm_s * self.scan_s;
        }
    }

    /// It does not answer, or takes no outputs, for the reason that the bus has: where it is, nobody knows.
    pub fn lose(&mut self, code: u32) {
        self.homing.lose();
        if let Some(unit) = &mut self.touch_probe {
            unit.lose();
        }
        self.shown.referenced = self.homing.is_referenced();
        self.shown.state = DriveState::Lost { code };
        self.shown.velocity_mm_s = 0.0;
        self.shown.torque_nm = 0.0;
        self.device = DeviceState::NotReady;
        self.commanded_mm_s = 0.0;
        self.digital_inputs = 0;
    }
}
