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
use control::jog::{JogMotion, JogProfile, JogTimes};
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

/// The second controller: command generation, error counter, proportional position loop, feed-forward, changeover.
///
/// `v = Kp·E2 + α·v_command + fade + return`, and the torque that accelerates the axis, with the lead times of the program's controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ManualController {
    changeover: Changeover,
    profile: JogProfile,
    speed_per_increment_per_s: f64,
    forward: Forward,
}

/// What a jog feeds forward.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Forward {
    /// Speed for each increment in a scan, in mm/s; 0 where nothing is fed forward.
    mm_s: f64,
    /// How far ahead of the command's last scan, in scans.
    speed_ahead_scans: f64,
    /// Torque for a change of speed of an increment in a scan per scan, in N·m; 0 where acceleration is not fed forward.
    torque_nm: f64,
    /// How far ahead.
    torque_ahead_scans: f64,
    /// From what is fed forward to the command, in scans.
    delay_scans: u32,
}

impl Forward {
    fn of(machine: &Machine, axis: &Axis) -> Forward {
        let scan_s = machine.scan_period_s();
        let forward = &axis.feed_forward;
        let model = axis.model.filter(|_| axis.torque_feed_forward.acceleration);
        let radius_m = axis.lead_mm * 1e-3 / (2.0 * core::f64::consts::PI);
        let mass_kg = model.map_or(0.0, |model| model.mass_kg);
        let current_loop_scans = axis.torque_feed_forward.current_loop_ms * 1e-3 / scan_s;
        // The program's controller feeds the speed around `advance − 1` scans from its setpoint forward.
        let speed_ahead_scans = (forward.advance_ms * 1e-3 / scan_s - 1.5).max(0.0);
        // A command acts a dead time later and is held for a scan; the force follows it by the current loop.
        let torque_ahead_scans = f64::from(machine.scan.dead_time_scans) + current_loop_scans;
        Forward {
            mm_s: if forward.enabled {
                forward.coefficient * axis.increment_mm() / scan_s
            } else {
                0.0
            },
            speed_ahead_scans,
            torque_nm: mass_kg * radius_m * axis.increment_mm() * 1e-3 / (scan_s * scan_s),
            torque_ahead_scans,
            delay_scans: speed_ahead_scans.max(torque_ahead_scans + 1.0) as u32 + 2,
        }
    }
}

/// What [`ManualController`] remembers (docs/methods/two-controllers.md).
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ManualState {
    /// Position command of the manual controller, in increments of its own, and what leads it.
    pub motion: JogMotion,
    /// Where that command is to end.
    pub goal: i64,
    /// The changeover between the two controllers.
    pub changeover: ChangeoverState,
    /// Who drove in the scan before: 0 nobody (loop open), 1 the program's controller, 2 the manual one.
    pub drove: u32,
    /// Scans since it may move, and since it was ordered to stop. Its command does so `delay_scans` later: what is fed forward is ahead of it.
    pub moved_scans: u32,
    /// See there.
    pub stopped_scans: u32,
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
    /// What of it is fed forward, in mm/s.
    pub feed_forward_mm_s: f64,
    /// Torque that accelerates the axis, in N·m.
    pub torque_nm: f64,
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
            profile: JogProfile::new(
                increments(speed_mm_s * scan_s),
                increments(acceleration_mm_s2 * scan_s * scan_s),
                axis.jerk_mm_s3
                    .map(|jerk_mm_s3| jerk_mm_s3 * scan_s.powi(3) / increment_mm),
            ),
            forward: Forward::of(machine, axis),
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
                motion: JogMotion::at(position),
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
        let delay_scans = self.forward.delay_scans;
        if moves {
            state.moved_scans = state.moved_scans.saturating_add(1);
            state.stopped_scans = if stop {
                state.stopped_scans.saturating_add(1)
            } else {
                0
            };
        }
        let stops = state.stopped_scans > delay_scans;
        if state.moved_scans > delay_scans {
            state.motion = self.profile.advance(&state.motion, state.goal, stops);
        }
        let error = state.motion.command.saturating_sub(position);
        let changeover = &mut state.changeover;
        let added_mm_s = self.changeover.update(changeover, program, position, error);
        let arrived = state.motion.rests() && (stops || state.motion.command == state.goal);
        if moves && !arrived {
            self.changeover.moves(changeover);
        }
        let done = moves && arrived && self.changeover.is_settled(changeover);
        let (feed_forward_mm_s, torque_nm) = if moves && !arrived {
            self.forward(state)
        } else {
            (0.0, 0.0)
        };
        ManualOutput {
            velocity_mm_s: self.speed_per_increment_per_s * error as f64
                + feed_forward_mm_s
                + added_mm_s,
            feed_forward_mm_s,
            torque_nm,
            error,
            done,
        }
    }

    /// Speed in mm/s and torque in N·m of what is commanded when this scan's command acts.
    fn forward(&self, state: &ManualState) -> (f64, f64) {
        let forward = &self.forward;
        let when = JogTimes {
            starts_in: forward.delay_scans.saturating_sub(state.moved_scans),
            stops_in: match state.stopped_scans {
                0 => u32::MAX,
                scans => forward.delay_scans.saturating_sub(scans),
            },
        };
        let step = |ahead: f64| {
            let profile = &self.profile;
            profile.step_ahead(&state.motion, state.goal, when, ahead)
        };
        let change = step(forward.torque_ahead_scans + 1.0) - step(forward.torque_ahead_scans);
        (
            forward.mm_s * step(forward.speed_ahead_scans),
            forward.torque_nm * change,
        )
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
