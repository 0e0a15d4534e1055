//! One axis as the master sees it: where it is commanded to be and is, what its drive shows and is commanded, and its fault.

use bus::sample::{
    AxisCommand, AxisFeedback, Cause, Driver, Mode, PATH_AXES, Reference, Roster, WindowId,
};
use bus::service::ROLES;
use bytemuck::Zeroable;
use loops::guards::AxisGuards;
use machine::{Axis, DriveMode, HomingMethod, Machine, PositionFeedback};

use super::STANDSTILL_MM_S;
use super::drive_place::DrivePlace;
use super::geometry::Correction;
use super::hand::Hand;
use super::sane::{Sane, guards};
use super::servos::{Plan, Servos, Taken, Wanted};
use crate::drives::{DriveCommand, DriveFeedback, DriveState};
use crate::holding_brake::{HoldingBrake, HoldingBrakeState};

/// One axis as the master sees it.
#[derive(Debug, Clone)]
pub(super) struct AxisUnit {
    pub settings: Axis,
    /// Its place in setpoints; none of an axis that no program moves.
    path_axis: Option<usize>,
    /// What the master guards itself, whatever the servo says.
    pub guards: AxisGuards,
    /// Servos that command it.
    pub servos: Servos,
    /// The hand on it, and which controller drives it.
    pub hand: Hand,
    drive: DriveFeedback,
    /// Where the drive shows an axis that is not homed.
    pub place: DrivePlace,
    /// A brake that the controller opens and closes, and what the drive itself says of its state.
    brake: Option<HoldingBrake>,
    brake_state: HoldingBrakeState,
    own_state: DriveState,
    /// Position of the motor in the scan before, which the command of this one answers, in mm.
    answered_motor_mm: f64,
    /// Where the axis is commanded to be, in increments.
    command_position: i64,
    /// Position of the machine less raw position of the drive, in increments: 0 until the controller has homed the axis.
    offset: i64,
    /// What its drive shows too little of its true place: errors of screw, scale and guideways.
    correction: Correction,
    /// How fast the motor's correction changes, in mm/s, smoothed over 1/Kp: the drive, which knows nothing of it, is to be so much slower.
    correction_mm_s: f64,
    /// Whether its positions are those of the machine.
    reference: Reference,
    /// Command position less feedback position when the drives were switched off: the steady deviation of the open loop.
    deviation: i64,
    cause: Cause,
    /// Code of its drive's fault, one that has stopped the axis until the trip is acknowledged; 0 without one. Of a skew what it
    /// was, in µm, signed.
    fault_code: u32,
}

/// A motor that turns more slowly counts as standing too, in turns/s: with much way in a turn, one count of its encoder to and fro in a
/// period of its drive looks faster than [`STANDSTILL_MM_S`].
const STANDSTILL_TURNS_S: f64 = 0.01;
impl AxisUnit {
    /// The axis of this index, commanded to be where its drive shows it; none where the machine has no such axis.
    pub fn new(machine: &Machine, index: usize, drive: DriveFeedback) -> Option<AxisUnit> {
        let settings = machine.axes.get(index)?;
        let mut unit = AxisUnit {
            settings: settings.clone(),
            path_axis: machine.path_axis(index),
            drive: DriveFeedback::default(),
            place: DrivePlace::new(
                settings,
                f64::from(machine.missed_cycles_max()) * machine.scan_period_s(),
            ),
            brake: HoldingBrake::new(settings, machine.scan_period_s()),
            brake_state: HoldingBrakeState::default(),
            own_state: DriveState::default(),
            answered_motor_mm: 0.0,
            command_position: 0,
            cause: Cause::None,
            fault_code: 0,
            servos: Servos::new(machine, settings),
            guards: guards(settings),
            hand: Hand::new(machine, settings),
            offset: 0,
            correction: Correction::default(),
            correction_mm_s: 0.0,
            reference: Reference::Missing,
            deviation: 0,
        };
        unit.take_drive(drive);
        unit.command_position = unit.feedback_position();
        Some(unit)
    }

    /// Where this setpoint has it, in increments; none where no program moves it.
    pub fn setpoint(&self, position: &[i64; PATH_AXES]) -> Option<i64> {
        position.get(self.path_axis?).copied()
    }

    /// Whether its motor stands, as far as its drive shows it.
    pub fn stands(&self) -> bool {
        let standstill_mm_s = STANDSTILL_MM_S.max(STANDSTILL_TURNS_S * self.settings.lead_mm);
        self.drive.velocity_mm_s.abs() < standstill_mm_s
    }

    pub fn increments(&self, mm: f64) -> i64 {
        libm::round(mm / self.settings.increment_mm()) as i64
    }

    fn motor_position(&self) -> i64 {
        self.increments(self.drive.motor_position_mm + self.correction.motor_mm)
            .saturating_add(self.offset)
    }

    fn scale_position(&self) -> i64 {
        self.drive.scale_position_mm.map_or_else(
            || self.motor_position(),
            |mm| {
                self.increments(mm + self.correction.scale_mm)
                    .saturating_add(self.offset)
            },
        )
    }

    /// Where its drive shows it, errors of screw and guideways left in, in mm.
    pub fn nominal_mm(&self) -> f64 {
        let motor_mm = self.drive.motor_position_mm;
        let shown_mm = match self.settings.feedback {
            PositionFeedback::Motor => motor_mm,
            PositionFeedback::Scale => self.drive.scale_position_mm.unwrap_or(motor_mm),
        };
        shown_mm + self.offset as f64 * self.settings.increment_mm()
    }

    /// Its drive shows so much too little, of which this much may come in a scan, in mm; all of it at once where none is named.
    pub fn correct_by(&mut self, errors: Correction, most_mm: Option<f64>, scan_s: f64) {
        let before = self.correction;
        self.correction = most_mm.map_or(errors, |most_mm| before.towards(errors, most_mm));
        let now_mm_s = (self.correction.motor_mm - before.motor_mm) / scan_s;
        // A step at a kink would be an acceleration that nobody has planned.
        let share = (self.settings.position_loop.gain_per_s * scan_s).min(1.0);
        self.correction_mm_s = most_mm.map_or(0.0, |_| {
            self.correction_mm_s + (now_mm_s - self.correction_mm_s) * share
        });
    }

    /// Whether no servo closes its loop.
    pub fn loop_is_open(&self, mode: Mode) -> bool {
        matches!(mode, Mode::Disabled | Mode::Tripped) || self.hand.driver() == Driver::Drive
    }

    pub fn feedback_position(&self) -> i64 {
        match self.settings.feedback {
            PositionFeedback::Motor => self.motor_position(),
            PositionFeedback::Scale => self.scale_position(),
        }
    }

    /// Where it is without the lost motion that its servo makes up for, in mm.
    pub fn place_mm(&self) -> f64 {
        let compensation_mm = match self.settings.feedback {
            PositionFeedback::Motor => self.servos.command().compensation_mm,
            PositionFeedback::Scale => 0.0,
        };
        self.feedback_position() as f64 * self.settings.increment_mm() - compensation_mm
    }

    /// What the drive says of its fault; 0 for nothing.
    pub fn fault_code(&self) -> u32 {
        self.fault_code
    }

    /// What is wrong with the drive of an axis that is to be driven.
    pub fn drive_cause(&self) -> Cause {
        match self.drive.state {
            DriveState::Fault { .. } => Cause::DriveFault,
            DriveState::Lost { .. } => Cause::DriveLost,
            _ if self.is_displaced() => Cause::Displaced,
            DriveState::Off => Cause::DriveOff,
            DriveState::Ready if !self.may_be_driven() => Cause::NotReferenced,
            DriveState::Ready => Cause::None,
        }
    }

    /// Whether its drive came back elsewhere than it was lost, and nobody has looked since.
    pub fn is_displaced(&self) -> bool {
        self.place.displaced_mm().is_some()
    }

    /// Whether its drive knows its place, or the axis can be homed.
    pub fn may_be_driven(&self) -> bool {
        self.settings.homing.is_some() || self.drive.referenced
    }

    /// Takes what the drive shows; the fault that has stopped the axis is remembered.
    pub fn take_drive(&mut self, drive: DriveFeedback) {
        self.answered_motor_mm = self.drive.motor_position_mm;
        self.drive = drive;
        self.own_state = drive.state;
        let closed = self.brake.is_some() && !self.brake_state.is_open();
        if closed && drive.state == DriveState::Ready {
            self.drive.state = DriveState::Off;
        }
        if self.settings.homing.is_none() {
            self.place.take(&drive);
        }
        self.judge_reference();
        match drive.state {
            DriveState::Fault { code } => self.fault_code = code,
            DriveState::Lost { code } if self.cause != Cause::DriveLost => self.fault_code = code,
            _ if !drive.state.is_lost() && self.is_displaced() => {
                let off_mm = self.place.displaced_mm().unwrap_or(0.0);
                self.fault_code = libm::round(off_mm * 1e3) as i32 as u32;
            }
            _ if matches!(
                self.cause,
                Cause::DriveFault | Cause::DriveLost | Cause::Skew | Cause::GantryTorque
            ) => {}
            DriveState::Ready | DriveState::Off | DriveState::Lost { .. } => self.fault_code = 0,
        }
    }

    /// What the drive is commanded for this scan.
    pub fn drive_command(&self, mode: Mode, switching_on: bool) -> DriveCommand {
        match mode {
            Mode::Disabled if switching_on => DriveCommand::SwitchOn,
            Mode::Disabled => DriveCommand::Disabled,
            Mode::Tripped => self.brake(),
            _ if self.hand.driver() == Driver::Drive => self.brake(),
            Mode::Enabled
            | Mode::Stopping
            | Mode::Stopped
            | Mode::Finished
            | Mode::Jogging
            | Mode::Ready => {
                if self.cause != Cause::None {
                    return self.brake();
                }
                match self.settings.drive_mode {
                    DriveMode::Velocity => DriveCommand::Velocity {
                        velocity_mm_s: self.servos.command().velocity_mm_s - self.correction_mm_s,
                        torque_offset_nm: self.servos.command().torque_nm,
                    },
                    DriveMode::Position if self.servos.have_commanded() => self.position_command(),
                    DriveMode::Position => self.brake(),
                    DriveMode::Torque if !self.servos.have_commanded() => self.brake(),
                    DriveMode::Torque => DriveCommand::Torque {
                        torque_nm: self.servos.command().torque_nm,
                    },
                }
            }
        }
    }

    /// What the position loop is to answer, from what the servo asked of a velocity loop: `Kp·e` of its velocity is what its own position
    /// loop asked for, and `e` from where the motor was then, in the scan before, is where it is to be. The drive's loop, of the same gain, does the
    /// same without the way of the feedback to the servo and back.
    fn position_command(&self) -> DriveCommand {
        let command = self.servos.command();
        let offset_mm_s = command.feed_forward_mm_s + command.friction_pulse_mm_s;
        let error_mm =
            (command.velocity_mm_s - offset_mm_s) / self.settings.position_loop.gain_per_s;
        // The master answers at once.
        let from_mm = if self.servos.are_silent() {
            self.drive.motor_position_mm
        } else {
            self.answered_motor_mm
        };
        DriveCommand::Position {
            position_mm: from_mm + error_mm,
            velocity_offset_mm_s: offset_mm_s - self.correction_mm_s,
            torque_offset_nm: command.torque_nm,
        }
    }

    /// One scan of its brake, where the controller opens and closes it: what the drive gets for this command; whether the brake is to be
    /// open.
    pub fn step_brake(&mut self, command: &mut DriveCommand) -> bool {
        let stands = self.stands();
        let Some(brake) = &self.brake else {
            return false;
        };
        let shown = DriveFeedback {
            state: self.own_state,
            ..self.drive
        };
        *command = brake.update(&mut self.brake_state, *command, &shown, stands);
        self.brake_state.opens()
    }

    fn brake(&self) -> DriveCommand {
        let asked = self.servos.command().stop_deceleration_mm_s2;
        let most = self.settings.quick_stop_mm_s2;
        DriveCommand::Brake {
            deceleration_mm_s2: if asked > 0.0 && asked <= most {
                asked
            } else {
                most
            },
        }
    }

    /// What the drive shows.
    pub fn drive(&self) -> &DriveFeedback {
        &self.drive
    }

    /// Velocity that its drive shows, in mm/s.
    pub fn velocity_mm_s(&self) -> f64 {
        self.drive.velocity_mm_s
    }

    /// Where it is commanded to be, in increments.
    pub fn command_position(&self) -> i64 {
        self.command_position
    }

    /// The same in mm.
    pub fn commanded_mm(&self) -> f64 {
        self.command_position as f64 * self.settings.increment_mm()
    }

    /// It is commanded to be there, in increments.
    pub fn command_to(&mut self, position: i64) {
        self.command_position = position;
    }

    /// Decides whose command is taken in this scan, which is closed or not; the window in force has the axis at this position.
    pub fn decide_command<'a>(
        &mut self,
        scan: u64,
        index: usize,
        commands: &'a [Option<AxisCommand>; ROLES.len()],
        roster: &Roster,
        (in_force, position, closed): (WindowId, Option<i64>, bool),
    ) -> Taken<'a> {
        let plan = Plan {
            in_force,
            position,
            closed,
            sane: Sane {
                settings: &self.settings,
                command_position: self.command_position,
                is_homed: self.is_homed(),
            },
        };
        self.servos.decide(scan, index, commands, roster, &plan)
    }

    /// Takes what became of its commands; the fault that it is.
    pub fn take(&mut self, taken: &Taken, watchdog_scans: u32) -> Cause {
        if let Taken::Command(command) = taken {
            self.command_position = command.position;
        }
        self.servos.take(taken, watchdog_scans)
    }

    /// The master commands it in place of its servo: to this position in this scan, in increments, and to be wanted there in the next.
    pub fn replace_servo(&mut self, taken: &Taken, scan: u64, next: i64, velocity_mm_s: f64) {
        let wanted = Wanted {
            position_mm: next.saturating_sub(self.offset) as f64 * self.settings.increment_mm()
                - self.correction.motor_mm,
            velocity_mm_s,
        };
        let position = self.command_position;
        self.servos
            .replace(taken, scan, position, &self.drive, wanted);
    }

    /// One scan of its course by hand: where the servos have it in this scan.
    pub fn step_by_hand(&mut self) {
        if let Some(place) = self.hand.step() {
            self.command_position = place;
        }
    }

    /// Its fault; none for a sound axis.
    pub fn cause(&self) -> Cause {
        self.cause
    }

    /// It has this fault, where it has none yet; whether it had none.
    pub fn fail(&mut self, cause: Cause) -> bool {
        let is_first = self.cause == Cause::None;
        if is_first {
            self.cause = cause;
        }
        is_first
    }

    /// The same, with a code.
    pub fn fail_with(&mut self, cause: Cause, code: u32) -> bool {
        let is_first = self.fail(cause);
        if is_first {
            self.fault_code = code;
        }
        is_first
    }

    /// Its fault is forgotten.
    pub fn clear_fault(&mut self) {
        self.cause = Cause::None;
        self.fault_code = 0;
        self.servos.forgive();
    }

    /// Position of the machine less raw position of the drive, in increments.
    pub fn offset(&self) -> i64 {
        self.offset
    }

    /// Its positions are those of the drive and this many increments: it is commanded to be where it is.
    pub fn count_from(&mut self, offset: i64) {
        self.offset = offset;
        self.command_position = self.feedback_position();
    }

    pub fn reference(&self) -> Reference {
        self.reference
    }

    /// Whether a program may move it.
    pub fn is_homed(&self) -> bool {
        self.settings.homing.is_none() || self.reference == Reference::Known
    }

    pub fn set_reference(&mut self, reference: Reference) {
        self.reference = reference;
    }

    /// Takes what the drive shows of its reference: one that it has lost is gone.
    pub fn judge_reference(&mut self) {
        let keeps = match self.settings.homing.map(|homing| homing.method) {
            None => {
                self.reference = match self.drive.referenced {
                    _ if self.drive.state.is_lost() => Reference::Unseen,
                    _ if self.is_displaced() => Reference::Displaced,
                    true => Reference::Known,
                    false => Reference::Missing,
                };
                return;
            }
            Some(HomingMethod::Drive) => {
                if self.drive.referenced && self.reference == Reference::Missing {
                    self.reference = Reference::Known;
                }
                self.drive.referenced
            }
            Some(_) => !(self.drive.state.is_lost() || self.drive.restarted),
        };
        if !keeps && self.reference == Reference::Known {
            self.reference = Reference::Missing;
        }
    }

    /// Its loop is opened: command position and encoder stay as far apart as they are.
    pub fn open_loop(&mut self) {
        self.deviation = self
            .command_position
            .saturating_sub(self.feedback_position());
    }

    /// Its loop is open: the command position will follow the encoder.
    pub fn follow_encoder(&mut self) {
        self.deviation = 0;
    }

    /// While its loop is open its command position follows the encoder.
    pub fn follow_up(&mut self, mode: Mode) {
        let deviation = match mode {
            Mode::Disabled => self.deviation,
            Mode::Tripped => 0,
            _ if self.hand.driver() == Driver::Drive => 0,
            _ => return,
        };
        self.command_position = self.feedback_position().saturating_add(deviation);
    }

    /// Whether it is within its in-position window.
    pub fn is_in_position(&self) -> bool {
        let off = self
            .feedback_position()
            .saturating_sub(self.command_position) as f64;
        let most_mm = self.settings.in_position_window_um() * 1e-3;
        off.abs() * self.settings.increment_mm() <= most_mm
    }

    /// What the feedback shows of it.
    pub fn tell(&self) -> AxisFeedback {
        let mut feedback = AxisFeedback {
            motor_position: self.motor_position(),
            scale_position: self.scale_position(),
            command_position: self.command_position,
            hand: self.hand.told(),
            velocity_mm_s: self.drive.velocity_mm_s,
            torque_nm: self.drive.torque_nm,
            winding_k: self.drive.winding_rise_k,
            cause: self.cause as u32,
            torque_limited: u32::from(self.drive.torque_limited),
            driver: self.hand.driver() as u32,
            drive_code: self.fault_code,
            reference: self.reference as u32,
            ..AxisFeedback::zeroed()
        };
        self.servos.tell(&mut feedback);
        feedback
    }

    /// State that a later scan depends on beside what is told.
    pub fn inner(&self) -> (i64, (u32, u32)) {
        (self.deviation, self.brake_state.inner())
    }
}
