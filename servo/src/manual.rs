//! The second control device of an axis: it jogs, and it keeps the program controller's register true meanwhile.
//!
//! Everything it remembers is in the [`ControllerState`], so that another servo of the axis goes on to the bit.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::{AxisFeedback, ControllerState, ManualState};
use bytemuck::Zeroable;
use control::changeover::{Changeover, ChangeoverState, Phase, Variant};
use control::follow_up::FollowUpState;
use control::jog::JogProfile;
use machine::{Axis, Changeover as Setting, Machine};

/// A jog may use this share of the axis's acceleration: it is watched by eye and stops by hand.
const ACCELERATION_SHARE: f64 = 0.2;
/// Below this speed the motor stands, in mm/s: five encoder counts of 10 nm in a scan of 1 ms.
const STANDING_MM_S: f64 = 0.05;
/// It must stand so long, in s, to count as settled: at that speed a position loop of 50/s is off by 1 µm, two and a
/// half of its time constants later by less than a tenth of that.
const SETTLE_S: f64 = 0.05;
/// It is not waited for longer than this in any phase, in s.
const PATIENCE_S: f64 = 0.5;
/// What was commanded before a switch fades with this time constant, in s.
const FADE_S: f64 = 0.05;
/// The return to where the motor stood sums its error with this time constant, in s.
const RETURN_S: f64 = 0.1;
/// Back where it stood: within this, in mm.
const RETURN_TOLERANCE_MM: f64 = 1e-4;

/// Nobody drove in the scan before.
const NOBODY: u32 = 0;
/// The program's controller did.
pub(crate) const PROGRAM: u32 = 1;
/// The manual one did.
const MANUAL: u32 = 2;

/// The second controller: command generation, error counter, proportional position loop, changeover.
///
/// `v = Kp·E2 + fade + return`, without feed-forward: a jog lags by v/Kp and comes to its target without overshoot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ManualController {
    changeover: Changeover,
    profile: JogProfile,
    speed_per_increment_per_s: f64,
}

/// What it puts out in one scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ManualOutput {
    /// Velocity command, in mm/s.
    pub velocity_mm_s: f64,
    /// Its error, in increments.
    pub error: i64,
    /// It has come to rest at its goal, or where it was told to stop.
    pub done: bool,
}

impl ManualController {
    /// For an axis of a machine.
    pub fn new(machine: &Machine, axis: &Axis) -> ManualController {
        let scan_s = machine.scan_period_s();
        let increment_mm = axis.increment_mm();
        let gain_per_s = axis.position_loop.gain_per_s;
        let scans = |seconds: f64| libm::ceil(seconds / scan_s) as u32;
        let speed_mm_s = machine.manual.jog_mm_s.min(axis.rapid_mm_s);
        let acceleration_mm_s2 = ACCELERATION_SHARE * axis.acceleration_mm_s2;
        let increments = |mm: f64| libm::floor(mm / increment_mm) as i64;
        ManualController {
            changeover: Changeover {
                variant: match axis.changeover {
                    Setting::SettledDeviation => Variant::SettledDeviation,
                    Setting::ReturnToStand => Variant::ReturnToStand,
                },
                standing_increments: increments(STANDING_MM_S * scan_s).max(1),
                settle_scans: scans(SETTLE_S),
                patience_scans: scans(PATIENCE_S),
                return_gain_mm_s: gain_per_s * increment_mm * scan_s / RETURN_S,
                return_tolerance: increments(RETURN_TOLERANCE_MM).max(1),
                fade_factor: libm::exp(-scan_s / FADE_S),
            },
            profile: JogProfile {
                step_max: increments(speed_mm_s * scan_s),
                step_change_max: increments(acceleration_mm_s2 * scan_s * scan_s),
            },
            speed_per_increment_per_s: gain_per_s * increment_mm,
        }
    }

    /// One scan in which it drives. The program's register is `state.command_position`, before and after; the encoder
    /// of the scan before `state.feedback_position`.
    pub(crate) fn update(
        &self,
        state: &mut ControllerState,
        axis: &AxisFeedback,
        position: i64,
        stop: bool,
    ) -> ManualOutput {
        let mut manual = state.manual;
        let mut switch = changeover_of(state);
        if manual.drove != MANUAL {
            // It begins without an error, where the motor stands; its own speed command is then none.
            self.changeover.to_second(
                &mut switch,
                axis.command_register,
                position,
                0,
                axis.velocity_command_mm_s,
                0.0,
            );
            let way = axis.jog_target.saturating_sub(axis.command_register);
            manual = ManualState {
                command_position: position,
                goal: position.saturating_add(way),
                drove: MANUAL,
                ..ManualState::zeroed()
            };
        }
        let moves = switch.phase == Phase::Following;
        if moves {
            let left = manual.goal.saturating_sub(manual.command_position);
            manual.step = self.profile.step(manual.step, left, stop);
            manual.command_position = manual.command_position.saturating_add(manual.step);
        }
        let error = manual.command_position.saturating_sub(position);
        let added_mm_s = self.changeover.update(&mut switch, position, error);
        let arrived = stop || manual.command_position == manual.goal;
        if moves && (manual.step != 0 || !arrived) {
            self.changeover.moves(&mut switch);
        }
        let done = moves && manual.step == 0 && arrived && self.changeover.is_settled(&switch);
        state.command_position = switch.first.register;
        state.feedback_position = position;
        manual.steady_deviation = switch.first.steady_deviation;
        manual.stored_error = switch.second_stored_error;
        manual.fade_mm_s = switch.fade_mm_s;
        manual.return_mm_s = switch.return_mm_s;
        manual.settled_scans = switch.settled_scans;
        manual.waited_scans = switch.waited_scans;
        manual.phase = match switch.phase {
            Phase::FirstDrives => 0,
            Phase::Settling => 1,
            Phase::Returning => 2,
            Phase::Following => 3,
        };
        state.manual = manual;
        ManualOutput {
            velocity_mm_s: self.speed_per_increment_per_s * error as f64 + added_mm_s,
            error,
            done,
        }
    }

    /// The program's controller drives with this speed command of its own, in mm/s; what it is together with the share
    /// that takes over from whoever drove before it, or from standing still.
    pub(crate) fn program_drives(
        &self,
        state: &mut ControllerState,
        before_mm_s: f64,
        own_mm_s: f64,
    ) -> f64 {
        if state.manual.drove != PROGRAM {
            let mut switch = changeover_of(state);
            self.changeover.to_first(&mut switch, before_mm_s, own_mm_s);
            state.manual = ManualState {
                fade_mm_s: switch.fade_mm_s,
                drove: PROGRAM,
                ..ManualState::zeroed()
            };
        }
        own_mm_s + self.changeover.fade(&mut state.manual.fade_mm_s)
    }
}

/// The loop is open: the register that follows the motor from the opening on (docs/methods/follow-up.md).
pub(crate) fn follow_up(state: &mut ControllerState, position: i64) -> i64 {
    let mut first = changeover_of(state).first;
    if state.manual.drove != NOBODY {
        first.count(position);
        first.open();
        state.manual = ManualState::zeroed();
    }
    first.follow(position);
    state.manual.steady_deviation = first.steady_deviation;
    first.register
}

fn changeover_of(state: &ControllerState) -> ChangeoverState {
    let manual = &state.manual;
    ChangeoverState {
        first: FollowUpState {
            steady_deviation: manual.steady_deviation,
            ..FollowUpState::closed(state.command_position, state.feedback_position)
        },
        phase: match manual.phase {
            1 => Phase::Settling,
            2 => Phase::Returning,
            3 => Phase::Following,
            _ => Phase::FirstDrives,
        },
        second_stored_error: manual.stored_error,
        fade_mm_s: manual.fade_mm_s,
        return_mm_s: manual.return_mm_s,
        settled_scans: manual.settled_scans,
        waited_scans: manual.waited_scans,
    }
}
