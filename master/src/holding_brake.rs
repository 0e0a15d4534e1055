//! A holding brake that the controller opens and closes: between what the master wants of a drive and what the drive gets.

use machine::{Axis, DriveMode};

use crate::drives::{DriveCommand, DriveFeedback, DriveState};

/// The torque holds the weight where it is shown within this share of it: friction of the closed brake takes the rest.
const HOLDS_SHARE: f64 = 0.2;
/// A drive that has not brought its axis to rest after this time is not waited for any longer, in s.
const STOPPING_S: f64 = 2.0;

/// Never opens a brake before the torque holds the weight, and never takes the torque away before the brake does.
///
/// ```text
/// switched on    closed → loading: v = 0, T = weight → opening, as soon as |T_shown − weight| ≤ 0.2·|weight| → open after opening_ms
/// switched off   open → stopping: the drive brakes → closing, as soon as it stands → closed after closing_ms: no torque any more
/// ```
///
/// The axis counts as ready in `open` alone. A drive that does not follow (fault, no power, no answer) has its brake closed at once, and
/// so has one that is to be driven without having been switched on. A drive whose master says nothing closes it too, by the
/// outputs that fall with the bus: so the first call finds it closed, whoever was master before, and nothing of it is saved. Order of
/// the steps: the drives with a brake output of their own (CiA 402 leaves it to them), docs/howto/vertical-axis.md. Times in s and
/// scans, torque in N·m; a shown torque that is not a number opens nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoldingBrake {
    weight_nm: f64,
    drive_mode: DriveMode,
    opening_scans: u32,
    closing_scans: u32,
    stopping_scans: u32,
}

/// How far it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Phase {
    #[default]
    Closed,
    Loading,
    Opening,
    Open,
    Stopping,
    Closing,
}

/// What [`HoldingBrake`] remembers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HoldingBrakeState {
    phase: Phase,
    /// Scans in this phase.
    scans: u32,
    /// Where the motor was when torque was put on, in mm.
    place_mm: f64,
}

impl HoldingBrake {
    /// Of an axis whose brake the controller opens; none of any other.
    pub fn new(axis: &Axis, scan_s: f64) -> Option<HoldingBrake> {
        let brake = axis.commanded_brake()?;
        let scans = |time_s: f64| libm::ceil(time_s / scan_s) as u32;
        Some(HoldingBrake {
            weight_nm: axis.weight_nm(),
            drive_mode: axis.drive_mode,
            opening_scans: scans(brake.opening_ms * 1e-3),
            closing_scans: scans(brake.closing_ms * 1e-3),
            stopping_scans: scans(STOPPING_S),
        })
    }

    /// One scan: what the drive gets for what is wanted of it, where it shows this and its motor stands or does not.
    pub fn update(
        &self,
        state: &mut HoldingBrakeState,
        wanted: DriveCommand,
        shown: &DriveFeedback,
        stands: bool,
    ) -> DriveCommand {
        if shown.state != DriveState::Ready {
            state.enter(Phase::Closed);
            return wanted;
        }
        state.scans = state.scans.saturating_add(1);
        match wanted {
            DriveCommand::SwitchOn => self.open(state, shown),
            DriveCommand::Disabled => self.close(state, stands),
            // To be driven, it must have been switched on.
            _ => match state.phase {
                Phase::Open => wanted,
                Phase::Stopping => {
                    state.enter(Phase::Open);
                    wanted
                }
                _ => self.close(state, stands),
            },
        }
    }

    fn open(&self, state: &mut HoldingBrakeState, shown: &DriveFeedback) -> DriveCommand {
        let off_nm = (shown.torque_nm - self.weight_nm).abs();
        match state.phase {
            Phase::Closed => {
                state.place_mm = shown.motor_position_mm;
                state.enter(Phase::Loading);
            }
            Phase::Loading if off_nm <= HOLDS_SHARE * self.weight_nm.abs() => {
                state.enter(Phase::Opening);
            }
            Phase::Opening if state.scans > self.opening_scans => state.enter(Phase::Open),
            // The torque has not been taken away yet.
            Phase::Closing => {
                state.place_mm = shown.motor_position_mm;
                state.enter(Phase::Opening);
            }
            Phase::Stopping => state.enter(Phase::Open),
            Phase::Loading | Phase::Opening | Phase::Open => {}
        }
        self.hold(state)
    }

    /// Stands still with the torque of the weight.
    fn hold(&self, state: &HoldingBrakeState) -> DriveCommand {
        let weight_nm = self.weight_nm;
        match self.drive_mode {
            DriveMode::Velocity => DriveCommand::Velocity {
                velocity_mm_s: 0.0,
                torque_offset_nm: weight_nm,
            },
            DriveMode::Position => DriveCommand::Position {
                position_mm: state.place_mm,
                velocity_offset_mm_s: 0.0,
                torque_offset_nm: weight_nm,
            },
            DriveMode::Torque => DriveCommand::Torque {
                torque_nm: weight_nm,
            },
        }
    }

    fn close(&self, state: &mut HoldingBrakeState, stands: bool) -> DriveCommand {
        match state.phase {
            Phase::Closed => {}
            Phase::Loading => state.enter(Phase::Closed),
            Phase::Opening => state.enter(Phase::Closing),
            Phase::Open => state.enter(Phase::Stopping),
            Phase::Stopping if stands || state.scans > self.stopping_scans => {
                state.enter(Phase::Closing);
            }
            Phase::Closing if state.scans > self.closing_scans => state.enter(Phase::Closed),
            Phase::Stopping | Phase::Closing => {}
        }
        match state.phase {
            Phase::Closed => DriveCommand::Disabled,
            _ => DriveCommand::Brake {
                deceleration_mm_s2: 0.0,
            },
        }
    }
}

impl HoldingBrakeState {
    fn enter(&mut self, phase: Phase) {
        if self.phase != phase {
            (self.phase, self.scans) = (phase, 0);
        }
    }

    /// Whether the brake is commanded open.
    pub fn opens(&self) -> bool {
        matches!(self.phase, Phase::Opening | Phase::Open | Phase::Stopping)
    }

    /// Whether the axis may be moved.
    pub fn is_open(&self) -> bool {
        self.phase == Phase::Open
    }

    /// State that a later scan depends on.
    pub fn inner(&self) -> (u32, u32) {
        let counts = !matches!(self.phase, Phase::Closed | Phase::Loading | Phase::Open);
        (self.phase as u32, if counts { self.scans } else { 0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BRAKE: HoldingBrake = HoldingBrake {
        weight_nm: 1.25,
        drive_mode: DriveMode::Velocity,
        opening_scans: 60,
        closing_scans: 30,
        stopping_scans: 2000,
    };
    const MOVES: DriveCommand = DriveCommand::Velocity {
        velocity_mm_s: 5.0,
        torque_offset_nm: 1.3,
    };
    const HOLDS: DriveCommand = DriveCommand::Velocity {
        velocity_mm_s: 0.0,
        torque_offset_nm: 1.25,
    };
    const BRAKES: DriveCommand = DriveCommand::Brake {
        deceleration_mm_s2: 0.0,
    };

    fn shown(state: DriveState, torque_nm: f64) -> DriveFeedback {
        DriveFeedback {
            state,
            torque_nm,
            ..DriveFeedback::default()
        }
    }

    /// So many scans of the same; the last command.
    fn scans(state: &mut HoldingBrakeState, count: u32, wanted: DriveCommand) -> DriveCommand {
        let shown = shown(DriveState::Ready, 1.25);
        let commands = (0..count).map(|_| BRAKE.update(state, wanted, &shown, true));
        commands.last().unwrap_or_default()
    }

    fn opened() -> HoldingBrakeState {
        let mut state = HoldingBrakeState::default();
        scans(&mut state, 100, DriveCommand::SwitchOn);
        assert!(state.is_open());
        state
    }

    #[test]
    fn it_opens_when_torque_holds_the_weight_and_the_axis_is_ready_when_it_is_open() {
        let mut state = HoldingBrakeState::default();
        for torque_nm in [0.0, 0.9, f64::NAN, -1.25] {
            for _ in 0..100 {
                let shown = shown(DriveState::Ready, torque_nm);
                let command = BRAKE.update(&mut state, DriveCommand::SwitchOn, &shown, true);
                assert_eq!((command, state.opens()), (HOLDS, false));
            }
        }
        assert_eq!(scans(&mut state, 60, DriveCommand::SwitchOn), HOLDS);
        assert!(state.opens() && !state.is_open());
        scans(&mut state, 3, DriveCommand::SwitchOn);
        assert!(state.is_open());
        assert_eq!(scans(&mut state, 1, MOVES), MOVES);
    }

    #[test]
    fn the_drive_holds_until_the_brake_does() {
        let mut state = opened();
        let shown = shown(DriveState::Ready, 1.25);
        for _ in 0..5 {
            let command = BRAKE.update(&mut state, DriveCommand::Disabled, &shown, false);
            assert_eq!((command, state.opens()), (BRAKES, true), "it moves still");
        }
        for _ in 0..31 {
            assert_eq!(scans(&mut state, 1, DriveCommand::Disabled), BRAKES);
            assert!(!state.opens());
        }
        scans(&mut state, 1, DriveCommand::Disabled);
        assert_eq!(
            scans(&mut state, 1, DriveCommand::Disabled),
            DriveCommand::Disabled
        );
    }

    #[test]
    fn every_step_can_be_called_back_and_a_drive_that_is_lost_has_its_brake_closed() {
        let steps = [DriveCommand::SwitchOn, DriveCommand::Disabled, MOVES];
        for way in [DriveCommand::SwitchOn, DriveCommand::Disabled] {
            for count in 0..120 {
                let mut state = match way {
                    DriveCommand::SwitchOn => HoldingBrakeState::default(),
                    _ => opened(),
                };
                scans(&mut state, count, way);
                let before = state;
                for next in steps {
                    let mut state = before;
                    let command = scans(&mut state, 1, next);
                    // Without torque it is never open.
                    assert!(command != DriveCommand::Disabled || !state.opens());
                    assert!(command != MOVES || state.is_open());
                    scans(&mut state, 200, next);
                    assert_eq!(
                        state.is_open(),
                        next == DriveCommand::SwitchOn || command == MOVES
                    );
                }
                for lost in [DriveState::Off, DriveState::Fault { code: 1 }] {
                    let mut state = before;
                    BRAKE.update(&mut state, MOVES, &shown(lost, 1.25), true);
                    assert!(!state.opens());
                }
            }
        }
    }
}
