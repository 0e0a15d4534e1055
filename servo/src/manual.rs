//! The second control device of an axis: it jogs, and it keeps the program controller's command position true meanwhile.
//!
//! Everything it remembers is in the servo's state, so that another servo of the axis goes on to the bit.
#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bytemuck::{Pod, Zeroable};
use control::changeover::{Changeover, ChangeoverState, Phase, Variant};
use control::follow_up::FollowUpState;
use control::jog::{JogMotion, JogProfile};
use control::jog_course::{AHEAD_SCANS_MAX, JogCourse, JogTimes};
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

/// The second controller: command generation, proportional position loop, changeover. What its jog needs of the model and the
/// compensation of lost motion it shares with the program's controller (`ManualLoop`).
///
/// `v = Kp·E2 + fade + return`, and what is fed forward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ManualController {
    changeover: Changeover,
    profile: JogProfile,
    /// Of homing: the search, which is also the fastest that an axis goes that is not homed, and the way to the edge.
    search: JogProfile,
    latch: JogProfile,
    speed_per_increment_per_s: f64,
    /// Increments in a scan of 1 µm/s, and the most of a scan.
    increments_per_um_s: f64,
    step_most: i64,
    /// Scans that what is fed forward looks ahead.
    ahead_scans: u32,
}

/// How fast it may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pace {
    /// A jog.
    Jog,
    /// A jog of an axis that is not homed.
    SlowJog,
    /// A jog at this speed, in µm/s.
    JogAt(u32),
    /// The same of an axis that is not homed.
    SlowJogAt(u32),
    /// Homing looks for the switch.
    Search,
    /// Homing latches.
    Latch,
    /// It stops, and is not homed.
    AsItIs,
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
    /// Scans since it may move, and since it was ordered to stop. Its command does so only once what is fed forward has seen it.
    pub moved_scans: u32,
    /// See there.
    pub stopped_scans: u32,
    /// What the command moved in the last scan, in increments.
    pub step: i32,
}

impl ManualState {
    /// While the program's controller drives.
    pub fn of_program() -> ManualState {
        ManualState {
            drove: PROGRAM,
            ..ManualState::default()
        }
    }

    /// At rest there, from where it is to go to `goal`.
    pub(crate) fn at_rest(position: i64, goal: i64) -> ManualState {
        ManualState {
            motion: JogMotion::at(position),
            goal,
            drove: MANUAL,
            ..ManualState::default()
        }
    }

    /// Whether it drove in the scan before.
    pub(crate) fn drove(&self) -> bool {
        self.drove == MANUAL
    }

    /// Whether the motor has settled after the switch: it may move, and the program's command position follows.
    pub(crate) fn may_move(&self) -> bool {
        self.changeover.phase() == Phase::Following
    }

    /// Whether the program's controller drove in the scan before.
    pub fn program_drove(&self) -> bool {
        self.drove == PROGRAM
    }
}

impl ManualController {
    /// For an axis of a machine; what is fed forward looks so many scans ahead.
    pub fn new(machine: &Machine, axis: &Axis, ahead_scans: u32) -> ManualController {
        let scan_s = machine.scan_period_s();
        let increment_mm = axis.increment_mm();
        let gain_per_s = axis.position_loop.gain_per_s;
        let scans = |seconds: f64| libm::ceil(seconds / scan_s) as u32;
        let speed_mm_s = machine.manual.jog_mm_s.min(axis.rapid_mm_s);
        let homing_mm_s = axis
            .homing
            .map(|homing| [homing.search_mm_s, homing.latch_mm_s]);
        let [search_mm_s, latch_mm_s] = homing_mm_s.unwrap_or([speed_mm_s; 2]);
        let acceleration_mm_s2 = ACCELERATION_SHARE * axis.acceleration_mm_s2;
        let increments = |mm: f64| libm::floor(mm / increment_mm) as i64;
        let profile = |speed_mm_s: f64| {
            JogProfile::new(
                increments(speed_mm_s * scan_s),
                increments(acceleration_mm_s2 * scan_s * scan_s),
                axis.jerk_mm_s3
                    .map(|jerk_mm_s3| jerk_mm_s3 * scan_s.powi(3) / increment_mm),
            )
        };
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
            profile: profile(speed_mm_s),
            search: profile(search_mm_s.min(axis.rapid_mm_s)),
            latch: profile(latch_mm_s.min(axis.rapid_mm_s)),
            ahead_scans: ahead_scans.min(AHEAD_SCANS_MAX),
            increments_per_um_s: 1e-3 * scan_s / increment_mm,
            step_most: increments(axis.rapid_mm_s * scan_s).max(1),
            speed_per_increment_per_s: gain_per_s * increment_mm,
        }
    }

    /// The same that counts a motor as settled after the time it takes, whatever the motor does.
    pub(crate) fn settling_in_time(mut self) -> ManualController {
        self.changeover.standing_increments = i64::MAX;
        self
    }

    /// One scan of the command generation.
    ///
    /// The command begins to move, and to brake when it is ordered to, only after as many scans as are looked ahead: so nothing
    /// that is fed forward comes late.
    pub(crate) fn advance(&self, state: &mut ManualState, pace: Pace, stop: bool) -> JogCourse {
        if state.may_move() {
            state.moved_scans = state.moved_scans.saturating_add(1);
            state.stopped_scans = if stop {
                state.stopped_scans.saturating_add(1)
            } else {
                0
            };
        }
        let after = self.ahead_scans.saturating_add(2);
        let when = JogTimes {
            starts_in: after.saturating_sub(state.moved_scans),
            stops_in: match state.stopped_scans {
                0 => u32::MAX,
                scans => after.saturating_sub(scans),
            },
        };
        let before = (&state.motion, i64::from(state.step));
        let profile = self.profile(pace, state);
        let course = JogCourse::new(&profile, before, state.goal, when, self.ahead_scans);
        let step = course.at(0).saturating_sub(course.at(-1));
        let largest = i64::from(i32::MAX);
        state.step = step.clamp(-largest, largest) as i32;
        state.motion = course.now();
        course
    }

    /// What limits it now. An axis that is not homed, and is ordered to stop, gets no faster than it is meanwhile.
    fn profile(&self, pace: Pace, state: &ManualState) -> JogProfile {
        match pace {
            Pace::Jog => self.profile,
            Pace::SlowJog if self.profile.step_max < self.search.step_max => self.profile,
            Pace::SlowJog | Pace::Search => self.search,
            Pace::Latch => self.latch,
            Pace::JogAt(speed_um_s) => self.at_speed(speed_um_s, self.step_most),
            Pace::SlowJogAt(speed_um_s) => self.at_speed(speed_um_s, self.search.step_max),
            Pace::AsItIs => JogProfile {
                step_max: state.motion.lead_step.saturating_abs().max(1),
                ..self.profile
            },
        }
    }

    /// A jog at another speed than that of the machine file, of at most so many increments in a scan.
    fn at_speed(&self, speed_um_s: u32, step_most: i64) -> JogProfile {
        let step = libm::floor(f64::from(speed_um_s) * self.increments_per_um_s) as i64;
        let step_max = step.min(step_most).max(1);
        JogProfile {
            step_max,
            arrives_from: self.profile.arrives_from.min(step_max),
            ..self.profile
        }
    }

    /// `Kp·E2`, in mm/s.
    pub(crate) fn position_loop(&self, error: i64) -> f64 {
        self.speed_per_increment_per_s * error as f64
    }

    /// It takes over from a speed command of `before_mm_s`; its own is now `own_mm_s`.
    pub(crate) fn takes_over(&self, state: &mut ManualState, before_mm_s: f64, own_mm_s: f64) {
        self.changeover
            .to_second(&mut state.changeover, 0, before_mm_s, own_mm_s);
    }

    /// One scan of the changeover, with the command position of the program's controller, which follows the axis: what is added
    /// to the speed command, in mm/s, and whether the jog is done: at rest at its goal, or where it was ordered to stop.
    pub(crate) fn changes_over(
        &self,
        state: &mut ManualState,
        program: &mut FollowUpState,
        position: i64,
        error: i64,
    ) -> (f64, bool) {
        let moves = state.may_move();
        let changeover = &mut state.changeover;
        let added_mm_s = self.changeover.update(changeover, program, position, error);
        let stops = state.stopped_scans >= self.ahead_scans.saturating_add(2);
        let arrived = state.motion.rests() && (stops || state.motion.command == state.goal);
        if moves && !arrived {
            self.changeover.moves(changeover);
        }
        let done = moves && arrived && self.changeover.is_settled(changeover);
        (added_mm_s, done)
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
