//! The second control device of an axis: it follows the course of a motion by hand, which the master steps.
//!
//! Everything it remembers is in the servo's state, so that another servo of the axis goes on to the bit.
use bus::sample::{AxisFeedback, Hand};
use bytemuck::{Pod, Zeroable};
use loops::changeover::{Changeover, ChangeoverState, Phase, Variant};
use loops::follow_up::FollowUpState;
use loops::hand_course::{AHEAD_SCANS_MAX, HandCommands, HandCourse};
use machine::{Axis, Changeover as Setting, Machine};

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

/// The second controller: proportional position loop, changeover. What its motion needs of the model and the compensation of lost
/// motion it shares with the program's controller (`ManualLoop`).
///
/// `v = Kp·E2 + fade + return`, and what is fed forward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ManualController {
    changeover: Changeover,
    speed_per_increment_per_s: f64,
    /// Scans that what is fed forward looks ahead.
    pub(crate) ahead_scans: u32,
}

/// What [`ManualController`] remembers (docs/methods/two-controllers.md).
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct ManualState {
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

    /// While the manual one does, from now on.
    pub(crate) fn of_hand() -> ManualState {
        ManualState {
            drove: MANUAL,
            ..ManualState::default()
        }
    }

    /// Whether it drove in the scan before.
    pub(crate) fn drove(&self) -> bool {
        self.drove == MANUAL
    }

    /// Whether the program's controller drove in the scan before.
    pub fn program_drove(&self) -> bool {
        self.drove == PROGRAM
    }
}

/// The course by hand that a feedback shows.
pub(crate) fn course(axis: &AxisFeedback) -> HandCourse {
    bytemuck::cast(axis.hand)
}

impl ManualController {
    /// For an axis of a machine; what is fed forward looks so many scans ahead.
    pub fn new(machine: &Machine, axis: &Axis, ahead_scans: u32) -> ManualController {
        let scan_s = machine.scan_period_s();
        let increment_mm = axis.increment_mm();
        let gain_per_s = axis.position_loop.gain_per_s;
        let scans = |seconds: f64| libm::ceil(seconds / scan_s) as u32;
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
            ahead_scans: ahead_scans.min(AHEAD_SCANS_MAX),
            speed_per_increment_per_s: gain_per_s * increment_mm,
        }
    }

    /// Where the course of this feedback is now, was, and will be.
    pub(crate) fn commands(&self, axis: &AxisFeedback) -> HandCommands {
        HandCommands::new(&course(axis), self.ahead_scans)
    }

    /// `Kp·E2`, in mm/s.
    pub(crate) fn position_loop(&self, error: i64) -> f64 {
        self.speed_per_increment_per_s * error as f64
    }

    /// It takes over from a speed command of `before_mm_s` with an error of `error` increments; its own is now `own_mm_s`.
    pub(crate) fn takes_over(
        &self,
        state: &mut ManualState,
        error: i64,
        before_mm_s: f64,
        own_mm_s: f64,
    ) {
        self.changeover
            .to_second(&mut state.changeover, error, before_mm_s, own_mm_s);
    }

    /// One scan of the changeover with an encoder that moved by `moved`: what is added to the speed command, in mm/s, and the
    /// state of the controller.
    pub(crate) fn changes_over(
        &self,
        state: &mut ManualState,
        course: &HandCourse,
        moved: i64,
        error: i64,
    ) -> (f64, Hand) {
        let changeover = &mut state.changeover;
        let follows = changeover.phase() == Phase::Following;
        let added_mm_s = self.changeover.update(changeover, moved, error);
        let rests = course.rests();
        if follows && !rests {
            self.changeover.moves(changeover);
        }
        let hand = match follows {
            false => Hand::Off,
            true if rests && self.changeover.is_settled(changeover) => Hand::Settled,
            true => Hand::Follows,
        };
        (added_mm_s, hand)
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
