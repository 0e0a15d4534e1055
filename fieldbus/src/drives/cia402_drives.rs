//! All drives of a machine, behind the master's seam.

use bus::drive_codes::out_of_operation;
use bus::drive_page::{Inputs, Outputs, SlaveState, SlaveWiring, Wiring};
use bus::sample::{BusCycle, Levels, MAX_AXES, MAX_SUBSAMPLES};
use bytemuck::Zeroable;
use machine::{AxisDrive, Machine};
use master::{
    AuxiliaryFeedback, DriveCommand, DriveFeedback, DriveState, Drives, InputFeedback,
    InstrumentSample, StateRefused,
};

use super::axis::{DriveAxis, Moved};
use super::encoder_place::AbsoluteEncoder;
use super::signal_places::SignalPlaces;
use super::signals::{DeviceSignals, TerminalSetup};
use super::silence::SilenceSeen;
use super::spindle::DrivenSpindle;
use super::touch_probe::Edge;
use crate::drive_file::{DriveFile, ProcessData};
use crate::link::OPERATIONAL;

/// What came of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WireAnswer {
    /// It was answered.
    Answered,
    /// No frame came back, this time.
    Missed,
    /// Nor did the process answer that carries it.
    OwnerSilent,
    /// The bus is not in operation.
    Down,
}

/// What carries process data to the drives and back.
pub trait Wire {
    /// How the segment is wired now; it may change while the bus is down.
    fn wiring(&self) -> &Wiring;

    /// Exchanges a cycle; `inputs` are those of the cycle if it was answered.
    fn exchange(&mut self, outputs: &Outputs, inputs: &mut Inputs) -> WireAnswer;

    /// Asks for the bus to be started up again, because drives have been lost and an operator wants them back.
    fn start_again(&mut self);

    /// Waits for the time of another scan, where cycles follow the clock.
    fn pause(&self);
}

/// The drive of an axis, as its files describe it.
#[derive(Debug, Clone)]
pub struct DriveSetup {
    /// Its drive file, as this axis of the drive sees it (`DriveFile::of_axis`).
    pub drive: DriveFile,
    /// What the whole drive exchanges.
    pub device: ProcessData,
    /// Which axis of the drive it is, from 0.
    pub axis: u16,
    /// Its place on the cable, from 0.
    pub slave: usize,
    /// Following error that trips its axis, in increments of the drive.
    pub following_error_increments: u32,
    /// Highest torque that it may give, in thousandths of the rated one; none where that is left to the drive.
    pub torque_limit: Option<u16>,
}

/// Drive and terminal files of a machine with a fieldbus, and what to know of them.
#[derive(Debug, Clone)]
pub struct Setups {
    /// By axis.
    pub drives: Vec<DriveSetup>,
    /// Of the spindle, where it has a drive.
    pub spindle: Option<DriveSetup>,
    /// In the order of the machine file.
    pub terminals: Vec<TerminalSetup>,
    /// Where signals are on the bus.
    pub signals: SignalPlaces,
    /// Warnings, a line each.
    pub warnings: Vec<String>,
}

#[derive(Debug, Clone)]
struct Axis {
    drive: DriveAxis,
    slave: usize,
    /// Its digital inputs that are inputs of the machine: bit of the drive, number at the machine.
    inputs: Vec<(u32, u32)>,
    samples: [InstrumentSample; MAX_SUBSAMPLES],
}

/// Drives over a wire.
#[derive(Debug)]
pub struct Cia402Drives<W> {
    wire: W,
    axes: Vec<Axis>,
    spindle: Option<DrivenSpindle>,
    signals: DeviceSignals,
    /// Something was driven in the last exchange, not off and not braked.
    driven: bool,
    outputs: Outputs,
    inputs: Inputs,
    subsamples: usize,
    run_down_scans: u32,
    start_again_scans: u32,
    look_scans: u32,
    /// What came of the last exchange.
    answer: WireAnswer,
    silence: SilenceSeen,
    /// Scans in a row in which lost drives were to be switched on.
    wanted_scans: u32,
}

/// A count, whether the drive knows its place, and the start-up in which it was seen last.
const SAVED_BYTES: usize = 24;
/// So long drives are given to come to rest before a master takes them over from one that was lost, in s.
const RUN_DOWN_S: f64 = 3.0;
/// So long drives are given to show where they are, in s.
const LOOK_S: f64 = 0.5;
/// Time between two start-ups of a bus with lost drives, in s.
const START_AGAIN_S: f64 = 1.0;
/// Below this speed they are at rest, in mm/s.
const REST_MM_S: f64 = 0.5;

impl<W: Wire> Cia402Drives<W> {
    /// The drives of this machine, each set up so; none if a drive file lacks what every mode needs.
    pub fn new(machine: &Machine, setups: &Setups, wire: W) -> Option<Cia402Drives<W>> {
        let scan_s = machine.scan_period_s();
        let missed_max = machine.missed_cycles_max();
        let axes: Option<Vec<Axis>> = machine
            .axes
            .iter()
            .zip(&setups.drives)
            .map(|(axis, setup)| {
                Some(Axis {
                    drive: DriveAxis::new(&setup.drive, moved_by(axis), scan_s, missed_max)?,
                    slave: setup.slave,
                    inputs: axis.drive.iter().flat_map(AxisDrive::inputs).collect(),
                    samples: [InstrumentSample::default(); MAX_SUBSAMPLES],
                })
            })
            .collect();
        let spindle = match &setups.spindle {
            Some(setup) => Some(DrivenSpindle::new(machine, setup)?),
            None => None,
        };
        let mut drives = Cia402Drives {
            wire,
            axes: axes?,
            spindle,
            signals: DeviceSignals::new(&setups.signals, &setups.terminals, missed_max),
            driven: false,
            outputs: Outputs::zeroed(),
            inputs: Inputs::zeroed(),
            subsamples: machine.subsamples() as usize,
            run_down_scans: (RUN_DOWN_S / scan_s) as u32,
            start_again_scans: ((START_AGAIN_S / scan_s) as u32).max(1),
            look_scans: ((LOOK_S / scan_s) as u32).max(1),
            answer: WireAnswer::Down,
            silence: SilenceSeen::default(),
            wanted_scans: 0,
        };
        drives.look();
        Some(drives)
    }

    /// Where the drives are is known before the first scan, unless they do not answer at all.
    fn look(&mut self) {
        for _ in 0..self.look_scans {
            self.exchange(&[DriveCommand::Disabled; MAX_AXES]);
            if self.moved().all(|drive| !drive.shown.state.is_lost()) {
                return;
            }
            self.wire.pause();
        }
    }

    /// The drives of all axes and of the spindle.
    fn moved(&self) -> impl Iterator<Item = &DriveAxis> {
        let spindle = self.spindle.iter().map(|spindle| &spindle.drive);
        self.axes.iter().map(|axis| &axis.drive).chain(spindle)
    }

    /// Whether nothing moves, as far as it is shown.
    fn rests(&self) -> bool {
        let rests = |axis: &Axis| axis.drive.shown.velocity_mm_s.abs() < REST_MM_S;
        self.axes.iter().all(rests) && self.spindle.as_ref().is_none_or(DrivenSpindle::stands)
    }

    /// Everybody stops by itself until all are at rest, as far as they show it.
    fn run_down(&mut self) {
        for _ in 0..self.run_down_scans {
            self.command(&[DriveCommand::Disabled; MAX_AXES]);
            self.outputs.image = self.outputs.silent;
            self.carry();
            if self.rests() {
                return;
            }
            self.wire.pause();
        }
    }

    /// Drives that are to be switched on need everybody: if one does not answer, another start-up of the bus, tried now and then.
    fn want_lost_drives_back(&mut self, commands: &[DriveCommand]) {
        let drive_lost = self.moved().any(|drive| drive.shown.state.is_lost());
        let any_lost = drive_lost || self.signals.any_lost();
        if !commands.contains(&DriveCommand::SwitchOn) || !any_lost {
            self.wanted_scans = 0;
            return;
        }
        if self.wanted_scans.is_multiple_of(self.start_again_scans) {
            self.wire.start_again();
        }
        self.wanted_scans = self.wanted_scans.saturating_add(1);
    }

    /// Writes what the drives are sent for these commands.
    fn command(&mut self, commands: &[DriveCommand]) {
        self.outputs = Outputs::zeroed();
        for (axis, command) in self.axes.iter_mut().zip(commands) {
            let (wiring, _) = slave(&self.wire, &self.inputs, axis.slave);
            let (image, silent) = (&mut self.outputs.image, &mut self.outputs.silent);
            axis.drive.command(command, &wiring, image, silent);
        }
        if let Some(spindle) = &mut self.spindle {
            let (wiring, _) = slave(&self.wire, &self.inputs, spindle.slave);
            let command = spindle.command(commands.contains(&DriveCommand::SwitchOn));
            let (image, silent) = (&mut self.outputs.image, &mut self.outputs.silent);
            spindle.drive.command(&command, &wiring, image, silent);
        }
        self.signals.write(self.wire.wiring(), &mut self.outputs);
    }

    /// Carries the outputs there and the inputs back.
    fn carry(&mut self) {
        let answer = self.wire.exchange(&self.outputs, &mut self.inputs);
        self.answer = answer;
        let sound = answer == WireAnswer::Answered && self.took_part();
        let silence = self.silence.take(answer, &self.inputs);
        let start_up = self.wire.wiring().nonce;
        for (drive, place) in moved_mut(&mut self.axes, &mut self.spindle) {
            let (wiring, state) = slave(&self.wire, &self.inputs, place);
            match answer {
                WireAnswer::Answered if !operates(&state) => drive.lose(match state.answered {
                    1 => out_of_operation(state.al_status, state.al_status_code),
                    _ => silence as u32,
                }),
                WireAnswer::Answered if sound => {
                    drive.take(&self.inputs, &wiring, start_up);
                }
                WireAnswer::Down => drive.lose(silence as u32),
                WireAnswer::Answered | WireAnswer::Missed | WireAnswer::OwnerSilent => {
                    drive.miss(silence);
                }
            }
        }
        let (axes, wiring) = (&self.axes, self.wire.wiring());
        let is_lost = |axis: usize| {
            let axis = axes.get(axis);
            axis.is_none_or(|axis| axis.drive.shown.state.is_lost())
        };
        let came = (answer, sound);
        self.signals.take(wiring, &self.inputs, came, is_lost);
    }

    /// Whether every slave that says it operates took part in the exchange of process data, by its working counter. Where one did not,
    /// nobody knows whose inputs are those of the cycle before. One that is on its way out of operation may count or not.
    fn took_part(&self) -> bool {
        let (mut least, mut most) = (0, 0);
        let slaves = self.wire.wiring().slaves().iter();
        for (wiring, state) in slaves.zip(&self.inputs.slaves) {
            most += u32::from(wiring.working_counter);
            if operates(state) {
                least += u32::from(wiring.working_counter);
            }
        }
        (least..=most).contains(&self.inputs.working_counter)
    }
}

/// Whether a slave answered, and takes outputs.
pub(super) fn operates(state: &SlaveState) -> bool {
    state.answered == 1 && state.al_status & 0x1F == OPERATIONAL
}

/// The drives of all axes and of the spindle, with their places on the cable.
fn moved_mut<'a>(
    axes: &'a mut [Axis],
    spindle: &'a mut Option<DrivenSpindle>,
) -> impl Iterator<Item = (&'a mut DriveAxis, usize)> {
    let axes = axes.iter_mut().map(|axis| (&mut axis.drive, axis.slave));
    let spindle = spindle.iter_mut().map(|of| (&mut of.drive, of.slave));
    axes.chain(spindle)
}

/// What the drive of an axis moves.
fn moved_by(axis: &machine::Axis) -> Moved {
    Moved {
        lead_mm: axis.lead_mm,
        quick_stop_mm_s2: axis.quick_stop_mm_s2,
        is_homed: axis.homing.is_some(),
        has_brake: axis.commanded_brake().is_some(),
        encoder: absolute_encoder(axis),
        looks_for_index: axis.homing.is_some_and(|of| of.method.has_index()),
        probe_edge: axis
            .drive
            .as_ref()
            .and_then(|drive| drive.probe_edge)
            .map(Edge::from),
    }
}

/// What is known of the encoder of an axis before it is seen: nothing where the axis is homed.
fn absolute_encoder(axis: &machine::Axis) -> AbsoluteEncoder {
    let Some(drive) = axis.drive.as_ref().filter(|_| axis.homing.is_none()) else {
        return AbsoluteEncoder::default();
    };
    let middle_mm = f64::midpoint(axis.travel_min_mm, axis.travel_max_mm);
    AbsoluteEncoder {
        zero_mm: drive.zero_mm,
        turns: drive.encoder_turns,
        middle_mm: if axis.modulo { 0.0 } else { middle_mm },
    }
}

fn slave(wire: &impl Wire, inputs: &Inputs, index: usize) -> (SlaveWiring, SlaveState) {
    let wiring = wire.wiring().slaves().get(index).copied();
    let state = inputs.slaves.get(index).copied();
    (wiring.unwrap_or_default(), state.unwrap_or_default())
}

impl<W: Wire> Drives for Cia402Drives<W> {
    fn count(&self) -> usize {
        self.axes.len()
    }

    fn feedback(&self, axis: usize) -> DriveFeedback {
        let lost = DriveFeedback {
            state: DriveState::Lost { code: 0 },
            ..DriveFeedback::default()
        };
        self.axes.get(axis).map_or(lost, |axis| axis.drive.shown)
    }

    fn exchange(&mut self, commands: &[DriveCommand]) {
        self.want_lost_drives_back(commands);
        let drives =
            |of: &DriveCommand| !matches!(of, DriveCommand::Disabled | DriveCommand::Brake { .. });
        self.driven = commands.iter().any(drives)
            || self.spindle.as_ref().is_some_and(DrivenSpindle::is_driven);
        self.command(commands);
        let before = self
            .axes
            .iter()
            .map(|axis| axis.drive.shown.motor_position_mm);
        let mut before_mm = [0.0; MAX_AXES];
        for (kept, at) in before_mm.iter_mut().zip(before) {
            *kept = at;
        }
        self.carry();
        // There is no instrument: what the encoders showed is taken, evenly between two scans.
        for (axis, before_mm) in self.axes.iter_mut().zip(before_mm) {
            let now_mm = axis.drive.shown.motor_position_mm;
            let samples = axis.samples.iter_mut().take(self.subsamples).enumerate();
            for (sub, sample) in samples {
                let share = (sub + 1) as f64 / self.subsamples as f64;
                let at_mm = before_mm + (now_mm - before_mm) * share;
                *sample = InstrumentSample {
                    motor_mm: at_mm,
                    table_mm: at_mm,
                };
            }
        }
    }

    fn open_brakes(&mut self, axes: u64) {
        for (index, axis) in self.axes.iter_mut().enumerate() {
            axis.drive.opens_brake = axes >> index & 1 == 1;
        }
    }

    fn watch_probe(&mut self, made: Option<bool>) {
        for axis in &mut self.axes {
            axis.drive.watches = made;
        }
    }

    fn command_levels(&mut self, levels: &Levels) {
        if let Some(spindle) = &mut self.spindle {
            spindle.set(levels);
        }
    }

    fn auxiliary(&self) -> AuxiliaryFeedback {
        let spindle = self.spindle.as_ref();
        spindle.map_or_else(AuxiliaryFeedback::default, DrivenSpindle::feedback)
    }

    fn inputs(&self) -> InputFeedback {
        let mut digital = 0;
        for axis in &self.axes {
            let shown = axis.drive.digital_inputs;
            for (bit, number) in &axis.inputs {
                let is_on = shown.checked_shr(*bit).unwrap_or(0) & 1;
                digital |= u64::from(is_on).checked_shl(*number).unwrap_or(0);
            }
        }
        InputFeedback {
            digital,
            ..InputFeedback::default()
        }
    }

    fn signal(&self, index: usize) -> Option<f64> {
        self.signals.shown(index)
    }

    fn command_signals(&mut self, values: &[f64]) {
        self.signals.command(values);
    }

    fn want_back(&mut self) {
        if self.signals.any_lost() && !self.driven && self.rests() {
            self.wire.start_again();
        }
    }

    fn exchanged_late_ns(&self) -> i64 {
        let answered = self.answer == WireAnswer::Answered;
        i64::from(answered) * self.inputs.clock_late_ns
    }

    fn bus_cycle(&self) -> Option<BusCycle> {
        let wiring = self.wire.wiring();
        let counts = &self.inputs.counts;
        let answered = self.answer == WireAnswer::Answered;
        let states = self.inputs.slaves.iter().zip(wiring.slaves());
        let operational = states.filter(|(state, _)| operates(state)).count();
        let mut inputs = [0; MAX_AXES];
        for (shown, axis) in inputs.iter_mut().zip(&self.axes) {
            *shown = u64::from(axis.drive.digital_inputs);
        }
        Some(BusCycle {
            scan: 0,
            visible_from: 0,
            sent: counts.sent,
            missed: counts.missed,
            short: counts.short,
            late: counts.late,
            foreign: counts.foreign,
            repeated: counts.repeated,
            round_trip_ns: u64::from(answered) * self.inputs.round_trip_ns,
            clock_offset_ns: self.exchanged_late_ns(),
            answered: answered.into(),
            distributed_clocks: (wiring.reference_clock != 0).into(),
            slaves_operational: match self.answer {
                WireAnswer::Down => 0,
                _ => operational as u32,
            },
            slave_count: wiring.slave_count,
            axis_count: self.axes.len() as u32,
            reserved: 0,
            inputs,
        })
    }

    fn instruments(&self, axis: usize) -> &[InstrumentSample] {
        let samples = self.axes.get(axis).map(|axis| &axis.samples);
        samples
            .and_then(|samples| samples.get(..self.subsamples))
            .unwrap_or(&[])
    }

    fn state_bytes(&self) -> usize {
        (self.moved().count() + self.signals.counts().count()) * SAVED_BYTES
    }

    fn save(&self, bytes: &mut [u8]) {
        let slots = bytes.as_chunks_mut::<SAVED_BYTES>().0;
        let moved = self.moved().map(|drive| {
            let referenced = u64::from(drive.homing.is_referenced());
            [drive.counted as u64, referenced, drive.start_up]
        });
        let counts = self.signals.counts();
        let counts = counts.map(|[counted, counts]| [counted, counts, 0]);
        for (slot, words) in slots.iter_mut().zip(moved.chain(counts)) {
            slot.copy_from_slice(bytemuck::bytes_of(&words));
        }
    }

    fn restore(&mut self, bytes: &[u8]) -> Result<(), StateRefused> {
        let slots = bytes.as_chunks::<SAVED_BYTES>().0.iter();
        let mut slots = slots.map(|slot| bytemuck::pod_read_unaligned::<[u64; 3]>(slot));
        let mut start_ups = Vec::new();
        for (drive, _) in moved_mut(&mut self.axes, &mut self.spindle) {
            let [counted, referenced, start_up] = slots.next().ok_or(StateRefused)?;
            drive.count_from(counted as i64, referenced == 1);
            start_ups.push(start_up);
        }
        let counts = slots.map(|[counted, counts, _]| [counted, counts]);
        self.signals.count_from(counts);
        self.run_down();
        // Who was without power since is shown in the first scan.
        let moved = moved_mut(&mut self.axes, &mut self.spindle);
        for ((drive, _), start_up) in moved.zip(start_ups) {
            drive.start_up = start_up;
        }
        Ok(())
    }
}
