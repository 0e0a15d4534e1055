//! One axis as the master sees it.
use bus::sample::{AxisCommand, Cause, Driver, Mode, Reference};
use bytemuck::Zeroable;
use loops::guards::AxisGuards;
use machine::{Axis, DriveMode, Machine, PositionFeedback};
use path::travel::Travel;

use super::STANDSTILL_MM_S;
use super::hand::Hand;
use super::redundancy::Standby;
use super::substitute::Substitute;
use super::switch::Switch;
use crate::drives::{DriveCommand, DriveFeedback, DriveState};

/// One axis as the master sees it.
#[derive(Debug, Clone)]
pub(super) struct AxisUnit {
    pub settings: Axis,
    /// What its drive shows.
    pub drive: DriveFeedback,
    /// Position of the motor in the scan before, which the command of this one answers, in mm.
    answered_motor_mm: f64,
    /// The command in force.
    pub command: AxisCommand,
    /// Where the axis is commanded to be, in increments.
    pub command_position: i64,
    pub missed: u32,
    pub missed_in_a_row: u32,
    pub cause: Cause,
    /// Code of its drive's fault, one that has stopped the axis until the trip is acknowledged; 0 without one. Of a skew what it
    /// was, in µm, signed.
    pub fault_code: u32,
    pub taken_incarnation: u32,
    /// Which of its servos is active.
    pub switch: Switch,
    /// Its servo answered the last scan, with nothing to complain of.
    pub followed: bool,
    /// How the one that is not is.
    pub standby: Standby,
    /// Its servo is silent or lost: the master commands it.
    pub silent: bool,
    /// How the master does.
    pub substitute: Substitute,
    /// What the master guards itself, whatever the servo says.
    pub guards: AxisGuards,
    /// Which of its controllers drives it.
    pub driver: Driver,
    /// The hand on it.
    pub hand: Hand,
    /// Position of the machine less raw position of the drive, in increments: 0 until the controller has homed the axis.
    pub offset: i64,
    /// Whether its positions are those of the machine.
    pub reference: Reference,
    /// Command position less feedback position when the drives were switched off: the steady deviation of the open loop.
    pub deviation: i64,
}

/// A motor that turns more slowly counts as standing too, in turns/s: with much way in a turn, one count of its encoder to and fro in a
/// period of its drive looks faster than [`STANDSTILL_MM_S`].
const STANDSTILL_TURNS_S: f64 = 0.01;
/// A command beyond the axis's speed limit by this factor is no command: friction pulses and the position loop stay well below.
const SPEED_SANITY: f64 = 2.0;
/// Of a slow axis the loop adds more: what it makes of this share of the following-error limit.
const SPEED_ERROR_SHARE: f64 = 0.1;
/// A position command further outside the travel than this is no command.
const POSITION_SANITY_MM: f64 = 10.0;

/// The servo's own guards go first: the master's let this much more pass.
const SECOND_GUARD: f64 = 1.25;
/// Of the following error's limit, so much may the feedback be beyond the travel.
const TRAVEL_MARGIN: f64 = 0.25;

fn guards(axis: &Axis) -> AxisGuards {
    let increments = |mm: f64| libm::round(mm / axis.increment_mm()) as i64;
    let [min, max] = axis.travel_increments();
    let following_error_mm = SECOND_GUARD * axis.following_error_limit_mm;
    AxisGuards {
        travel: Travel { min, max },
        travel_margin: increments(TRAVEL_MARGIN * following_error_mm),
        following_error_mm,
        speed_mm_s: SPEED_SANITY * axis.rapid_mm_s,
    }
}

impl AxisUnit {
    /// An axis that is commanded to be where its drive shows it.
    pub fn new(machine: &Machine, settings: &Axis, drive: DriveFeedback) -> AxisUnit {
        let mut unit = AxisUnit {
            settings: settings.clone(),
            drive: DriveFeedback::default(),
            answered_motor_mm: 0.0,
            command: AxisCommand::zeroed(),
            command_position: 0,
            missed: 0,
            missed_in_a_row: 0,
            cause: Cause::None,
            fault_code: 0,
            taken_incarnation: 0,
            switch: Switch::default(),
            followed: false,
            standby: Standby::default(),
            silent: false,
            substitute: Substitute::new(machine, settings),
            guards: guards(settings),
            driver: Driver::Program,
            hand: Hand::new(machine, settings),
            offset: 0,
            reference: Reference::Missing,
            deviation: 0,
        };
        unit.take_drive(drive);
        unit.command_position = unit.feedback_position();
        unit
    }

    /// Whether its motor stands, as far as its drive shows it.
    pub fn stands(&self) -> bool {
        let standstill_mm_s = STANDSTILL_MM_S.max(STANDSTILL_TURNS_S * self.settings.lead_mm);
        self.drive.velocity_mm_s.abs() < standstill_mm_s
    }

    pub fn increments(&self, mm: f64) -> i64 {
        libm::round(mm / self.settings.increment_mm()) as i64
    }

    pub fn motor_position(&self) -> i64 {
        self.increments(self.drive.motor_position_mm)
            .saturating_add(self.offset)
    }

    pub fn scale_position(&self) -> i64 {
        self.drive.scale_position_mm.map_or_else(
            || self.motor_position(),
            |mm| self.increments(mm).saturating_add(self.offset),
        )
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
            PositionFeedback::Motor => self.command.compensation_mm,
            PositionFeedback::Scale => 0.0,
        };
        self.feedback_position() as f64 * self.settings.increment_mm() - compensation_mm
    }

    /// What is wrong with the drive of an axis that is to be driven.
    pub fn drive_cause(&self) -> Cause {
        match self.drive.state {
            DriveState::Fault { .. } => Cause::DriveFault,
            DriveState::Lost { .. } => Cause::DriveLost,
            DriveState::Off => Cause::DriveOff,
            DriveState::Ready if !self.may_be_driven() => Cause::NotReferenced,
            DriveState::Ready => Cause::None,
        }
    }

    /// Whether its drive knows its place, or the axis can be homed.
    pub fn may_be_driven(&self) -> bool {
        self.settings.homing.is_some() || self.drive.referenced
    }

    /// Takes what the drive shows; the fault that has stopped the axis is remembered.
    pub fn take_drive(&mut self, drive: DriveFeedback) {
        self.answered_motor_mm = self.drive.motor_position_mm;
        self.drive = drive;
        self.judge_reference();
        match drive.state {
            DriveState::Fault { code } => self.fault_code = code,
            DriveState::Lost { code } if self.cause != Cause::DriveLost => self.fault_code = code,
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
            _ if self.driver == Driver::Drive => self.brake(),
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
                        velocity_mm_s: self.command.velocity_mm_s,
                        torque_offset_nm: self.command.torque_nm,
                    },
                    DriveMode::Position if self.is_commanded() => self.position_command(),
                    DriveMode::Position => self.brake(),
                    DriveMode::Torque if !self.is_commanded() => self.brake(),
                    DriveMode::Torque => DriveCommand::Torque {
                        torque_nm: self.command.torque_nm,
                    },
                }
            }
        }
    }

    /// Whether a servo has commanded anything yet.
    fn is_commanded(&self) -> bool {
        self.command.scan != 0 || self.command.incarnation != 0
    }

    /// What the position loop is to answer, from what the servo asked of a velocity loop: `Kp·e` of its velocity is what its own position
    /// loop asked for, and `e` from where the motor was then, in the scan before, is where it is to be. The drive's loop, of the same gain, does the
    /// same without the way of the feedback to the servo and back.
    fn position_command(&self) -> DriveCommand {
        let command = &self.command;
        let offset_mm_s = command.feed_forward_mm_s + command.friction_pulse_mm_s;
        let error_mm =
            (command.velocity_mm_s - offset_mm_s) / self.settings.position_loop.gain_per_s;
        // The master answers at once.
        let from_mm = if self.silent {
            self.drive.motor_position_mm
        } else {
            self.answered_motor_mm
        };
        DriveCommand::Position {
            position_mm: from_mm + error_mm,
            velocity_offset_mm_s: offset_mm_s,
            torque_offset_nm: command.torque_nm,
        }
    }

    pub fn brake(&self) -> DriveCommand {
        let asked = self.command.stop_deceleration_mm_s2;
        let most = self.settings.quick_stop_mm_s2;
        DriveCommand::Brake {
            deceleration_mm_s2: if asked > 0.0 && asked <= most {
                asked
            } else {
                most
            },
        }
    }

    /// Whether a command is one that the drive may see; the named cause otherwise.
    pub fn judge(&self, command: &AxisCommand) -> Cause {
        let settings = &self.settings;
        let error_mm = SPEED_ERROR_SHARE * settings.following_error_limit_mm;
        let loop_mm_s = settings.position_loop.gain_per_s * error_mm;
        let speed_most = SPEED_SANITY * settings.rapid_mm_s.max(loop_mm_s);
        let finite = command.velocity_mm_s.is_finite()
            && command.torque_nm.is_finite()
            && command.stop_deceleration_mm_s2.is_finite();
        let position_mm = command.position as f64 * self.settings.increment_mm();
        let before_mm = self.command_position as f64 * self.settings.increment_mm();
        let (travel_low_mm, travel_high_mm) = if self.is_homed() {
            (self.settings.travel_min_mm, self.settings.travel_max_mm)
        } else {
            (before_mm, before_mm)
        };
        let low_mm = travel_low_mm.min(before_mm);
        let high_mm = travel_high_mm.max(before_mm);
        let reachable = position_mm >= low_mm - POSITION_SANITY_MM
            && position_mm <= high_mm + POSITION_SANITY_MM;
        let torque_fits = command.torque_nm.abs() <= self.settings.motor.peak_torque_nm;
        if !finite || !reachable || !torque_fits {
            return Cause::BadValue;
        }
        if command.velocity_mm_s.abs() > speed_most {
            return Cause::SpeedLimit;
        }
        let said = Cause::from_wire(command.cause);
        said.filter(|cause| *cause == Cause::None || cause.is_of_servo())
            .unwrap_or(Cause::BadValue)
    }
}
