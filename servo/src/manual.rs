//! The second control device of an axis: it jogs, and it keeps the program controller's command position true meanwhile.
//!
//! Everything it remembers is in the servo's state, so that another servo of the axis goes on to the bit.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::AxisFeedback;
use bytemuck::{Pod, Zeroable};
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
const PROGRAM: u32 = 1;
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

/// What [`ManualController`] remembers (docs/methods/two-controllers.md).
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ManualState {
    /// Position command of the manual controller, in increments of its own.
    pub command_position: i64,
    /// Where that command is to end.
    pub goal: i64,
    /// Change of that command in the last scan, in increments.
    pub step: i64,
    /// The changeover between the two controllers.
    pub changeover: ChangeoverState,
    /// Who drove in the scan before: 0 nobody (loop open), 1 the program's controller, 2 the manual one.
    pub drove: u32,
    /// Kept zero.
    pub reserved: u32,
}

impl ManualState {
    /// While the program's controller drives.
    pub fn of_program() -> ManualState {
        ManualState {
            drove: PROGRAM,
            ..ManualState::default()
        }
    }

    /// Whether the program's controller drove in the scan before.
    pub fn program_drove(&self) -> bool {
        self.drove == PROGRAM
    }
}

/// What it puts out in one scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ManualOutput {
    /// Velocity command, in mm/s.
    pub velocity_mm_s: f64,
    /// Its error, in increments.
    pub error: i64,
    /// It has come to rest at its goal, or where it was ordered to stop.
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

    /// One scan in which it drives. `program` is the command position of the program's controller, which follows the axis, and the
    /// encoder of the scan before.
    pub(crate) fn update(
        &self,
        state: &mut ManualState,
        program: &mut FollowUpState,
        axis: &AxisFeedback,
        position: i64,
        stop: bool,
    ) -> ManualOutput {
        if state.drove != MANUAL {
            let way = axis.jog_target.saturating_sub(axis.command_position);
            *state = ManualState {
                command_position: position,
                goal: position.saturating_add(way),
                drove: MANUAL,
                ..ManualState::default()
            };
            // It begins without an error, where the motor stands; its own speed command is then none.
            *program = FollowUpState::closed(axis.command_position, position);
            let before_mm_s = axis.velocity_command_mm_s;
            self.changeover
                .to_second(&mut state.changeover, 0, before_mm_s, 0.0);
        }
        let moves = state.changeover.phase() == Phase::Following;
        if moves {
            let left = state.goal.saturating_sub(state.command_position);
            state.step = self.profile.step(state.step, left, stop);
            state.command_position = state.command_position.saturating_add(state.step);
        }
        let error = state.command_position.saturating_sub(position);
        let changeover = &mut state.changeover;
        let added_mm_s = self.changeover.update(changeover, program, position, error);
        let arrived = stop || state.command_position == state.goal;
        if moves && (state.step != 0 || !arrived) {
            self.changeover.moves(changeover);
        }
        let done = moves && state.step == 0 && arrived && self.changeover.is_settled(changeover);
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
        state: &mut ManualState,
        before_mm_s: f64,
        own_mm_s: f64,
    ) -> f64 {
        if !state.program_drove() {
            *state = ManualState::of_program();
            self.changeover
                .to_first(&mut state.changeover, before_mm_s, own_mm_s);
        }
        own_mm_s + self.changeover.fade(&mut state.changeover.fade_mm_s)
    }
}

/// The loop is open: the program's command position follows the motor from the opening on (docs/methods/follow-up.md).
pub(crate) fn follow_up(state: &mut ManualState, program: &mut FollowUpState, position: i64) {
    if state.drove != NOBODY {
        program.count(position);
        program.open();
        *state = ManualState::default();
    }
    program.follow(position);
}
