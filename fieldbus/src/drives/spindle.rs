//! The drive of the spindle: it is told a speed in each scan, and is off while the spindle stands.

use bus::sample::{Levels, SpindleCommand};
use machine::Machine;
use master::{AuxiliaryFeedback, DriveCommand, DriveState};

use super::axis::{DriveAxis, Moved};
use super::cia402_drives::DriveSetup;
use super::encoder_place::AbsoluteEncoder;

/// Below this the spindle stands, in turns/s: 1 rev/min.
const STANDS_TURNS_S: f64 = 1.0 / 60.0;
/// It stands at the angle that was asked for within this, in turns: half a degree.
const ORIENTED_TURNS: f64 = 0.5 / 360.0;
/// Of its ramp, what the way to an angle plans with: the rest makes up for the dead time of the drive.
const ORIENTATION_RAMP_SHARE: f64 = 0.5;
/// Its drive stays on for so long while it stands: a tap may follow.
const STANDS_ON_S: f64 = 2.0;
/// A fault is reset for so many scans after drives were to be switched on: more than two tries of the state walk.
const RESET_SCANS: u32 = 120;
/// Error code that is shown where the drive has none of its own, goes off by itself, or does not answer.
const NO_CODE: u32 = 0xFFFF;

/// The spindle behind its drive. Places are in turns, clockwise positive.
#[derive(Debug, Clone)]
pub(super) struct DrivenSpindle {
    /// Its drive, whose mm are turns.
    pub drive: DriveAxis,
    /// Its place on the cable.
    pub slave: usize,
    levels: Levels,
    /// Speed that it is told, in turns/s.
    turns_s: f64,
    /// Speed that its drive has shown last; one that answers no more may turn on.
    shown_turns_s: f64,
    /// Its drive was on, and is not any more though nobody has switched it off: it starts again by an order alone.
    dropped: bool,
    /// What its drive was told in the scan before.
    told: DriveCommand,
    /// Scans that it has stood, and those after which its drive goes off.
    stood_scans: u32,
    stands_on_scans: u32,
    /// Most that this changes in a scan, in turns/s.
    step_turns_s: f64,
    ramp_turns_s2: f64,
    /// Speed with which it makes up for a turn that it is off its angle, per second.
    gain_per_s: f64,
    orientation_turns_s: f64,
    /// An encoder shows its angle.
    has_encoder: bool,
    /// The place of the angle that it is on its way to.
    angle_turns: Option<f64>,
    /// Scans in which a fault of the drive is still reset.
    reset_scans: u32,
}

impl DrivenSpindle {
    /// Before it has been seen; none if its drive file lacks what every mode needs, or the machine has no spindle.
    pub fn new(machine: &Machine, setup: &DriveSetup) -> Option<DrivenSpindle> {
        let of_bus = machine.bus.as_ref()?.spindle.as_ref()?;
        let spindle = machine.spindle.as_ref()?;
        let scan_s = machine.scan_period_s();
        let ramp_turns_s2 = spindle.ramp_rpm_s / 60.0;
        let moved = Moved {
            lead_mm: 1.0 / of_bus.motor_turns,
            quick_stop_mm_s2: ramp_turns_s2,
            is_homed: false,
            has_brake: false,
            encoder: AbsoluteEncoder::default(),
            looks_for_index: false,
            probe_edge: None,
        };
        Some(DrivenSpindle {
            drive: DriveAxis::new(&setup.drive, moved, scan_s, machine.missed_cycles_max())?,
            slave: setup.slave,
            levels: Levels::default(),
            turns_s: 0.0,
            shown_turns_s: 0.0,
            dropped: false,
            told: DriveCommand::Disabled,
            stood_scans: 0,
            stands_on_scans: (STANDS_ON_S / scan_s) as u32,
            step_turns_s: ramp_turns_s2 * scan_s,
            ramp_turns_s2,
            gain_per_s: spindle.follow_gain_per_s,
            orientation_turns_s: of_bus.orientation_rpm / 60.0,
            has_encoder: spindle.encoder_counts_per_turn > 0,
            angle_turns: None,
            reset_scans: 0,
        })
    }

    /// What it is to do from this scan on.
    pub fn set(&mut self, levels: &Levels) {
        self.levels = *levels;
    }

    /// What its drive is told in this scan; `enables` where the drives of the axes are being switched on, which resets its fault too.
    pub fn command(&mut self, enables: bool) -> DriveCommand {
        let state = self.drive.shown.state;
        self.reset_scans = match state {
            DriveState::Fault { .. } if enables => RESET_SCANS,
            DriveState::Fault { .. } => self.reset_scans.saturating_sub(1),
            _ => 0,
        };
        if !state.is_lost() {
            self.shown_turns_s = self.drive.shown.velocity_mm_s;
        }
        let wanted = SpindleCommand::from_wire(self.levels.spindle);
        self.dropped |= self.is_told_speed() && state == DriveState::Off;
        self.dropped &= wanted != SpindleCommand::Stop;
        if wanted != SpindleCommand::Orient {
            self.angle_turns = None;
        }
        self.told = match state {
            DriveState::Ready => self.turn(wanted),
            DriveState::Off if wanted != SpindleCommand::Stop && !self.dropped => {
                DriveCommand::SwitchOn
            }
            DriveState::Fault { .. } if self.reset_scans > 0 => DriveCommand::SwitchOn,
            DriveState::Off | DriveState::Fault { .. } | DriveState::Lost { .. } => {
                DriveCommand::Disabled
            }
        };
        if !self.is_told_speed() {
            // One that turns is taken from the speed that it has.
            self.turns_s = self.drive.shown.velocity_mm_s;
            self.angle_turns = None;
        }
        self.told
    }

    /// Whether its drive was told a speed last.
    fn is_told_speed(&self) -> bool {
        matches!(self.told, DriveCommand::Velocity { .. })
    }

    /// The speed of this scan; none once it is to stand and has.
    fn turn(&mut self, wanted: SpindleCommand) -> DriveCommand {
        let rests = wanted == SpindleCommand::Stop && self.turns_s == 0.0 && self.stands();
        self.stood_scans = match rests {
            true => self.stood_scans.saturating_add(1),
            false => 0,
        };
        let rpm = self.levels.spindle_rpm;
        match wanted {
            // The ramp is in what the follower asks for.
            SpindleCommand::Follow => self.turns_s = rpm / 60.0,
            SpindleCommand::Turn => self.ramp_to(rpm / 60.0),
            SpindleCommand::Orient => {
                let turns_s = self.towards_angle();
                self.ramp_to(turns_s);
            }
            SpindleCommand::Stop
                if rests && (!self.is_told_speed() || self.stood_scans > self.stands_on_scans) =>
            {
                return DriveCommand::Disabled;
            }
            SpindleCommand::Stop => self.ramp_to(0.0),
        }
        DriveCommand::Velocity {
            velocity_mm_s: self.turns_s,
            torque_offset_nm: 0.0,
        }
    }

    fn ramp_to(&mut self, turns_s: f64) {
        let most = self.step_turns_s;
        self.turns_s += (turns_s - self.turns_s).clamp(-most, most);
    }

    /// The speed that brings it to its angle: slowed down first, then by the shorter way.
    fn towards_angle(&mut self) -> f64 {
        let most = self.orientation_turns_s;
        let is_slow = self.turns_s.abs() <= most
            && self.drive.shown.velocity_mm_s.abs() <= most + STANDS_TURNS_S;
        if !self.has_encoder || self.angle_turns.is_none() && !is_slow {
            return 0.0;
        }
        let at = self.drive.shown.motor_position_mm;
        let wanted = self.levels.orientation_deg / 360.0;
        // Another angle may be asked for while it stands at one: whole turns from it count for nothing.
        let angle = match self.angle_turns {
            Some(angle) if libm::fabs(libm::remainder(angle - wanted, 1.0)) < 1e-9 => angle,
            _ => at + libm::remainder(wanted - at, 1.0),
        };
        self.angle_turns = Some(angle);
        let left = angle - at;
        let braking = libm::sqrt(2.0 * ORIENTATION_RAMP_SHARE * self.ramp_turns_s2 * left.abs());
        let speed = (self.gain_per_s * left.abs()).min(braking).min(most);
        speed.copysign(left)
    }

    fn is_oriented(&self) -> bool {
        let left = |angle: f64| angle - self.drive.shown.motor_position_mm;
        let there = |angle: f64| left(angle).abs() <= ORIENTED_TURNS;
        self.angle_turns.is_some_and(there) && self.stands()
    }

    /// Whether it turns no more, as far as its drive shows it.
    pub fn stands(&self) -> bool {
        self.drive.shown.velocity_mm_s.abs() < STANDS_TURNS_S
    }

    /// Whether its drive is commanded to do anything.
    pub fn is_driven(&self) -> bool {
        self.told != DriveCommand::Disabled
    }

    /// What the machine sees of it.
    pub fn feedback(&self) -> AuxiliaryFeedback {
        let shown = &self.drive.shown;
        AuxiliaryFeedback {
            spindle_rpm: match shown.state.is_lost() {
                true => self.shown_turns_s * 60.0,
                false => shown.velocity_mm_s * 60.0,
            },
            spindle_turns: match self.has_encoder {
                true => shown.motor_position_mm,
                false => 0.0,
            },
            oriented: self.is_oriented(),
            spindle_code: match shown.state {
                DriveState::Off if self.dropped => NO_CODE,
                DriveState::Ready | DriveState::Off => 0,
                DriveState::Fault { code: 0 } | DriveState::Lost { .. } => NO_CODE,
                DriveState::Fault { code } => code,
            },
            tool: 0,
        }
    }
}
