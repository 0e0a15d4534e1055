//! Motions by hand: increments, held jogs, and the motions that home an axis. The master steps the course of each, every servo
//! follows it (docs/methods/two-controllers.md).
//!
//! Between motions the hand stays on for a while: the next one begins without a changeover, and everything else is as at rest.

use bus::sample::{Cause, Driver, Hand as Controller, Mode};
use loops::hand_course::{AHEAD_SCANS_MAX, Aim, FINE, HandCourse, fine};
use loops::jog::JogProfile;
use machine::{Axis, JOG_ACCELERATION_SHARE, Machine};

use super::Master;
use super::axis_unit::AxisUnit;
use super::switch::Taken;
use super::wheel::Wheel;
use crate::drives::Drives;
use crate::window_arbiter::Dropped;

/// After so long at rest the program's controllers drive again, in s.
const HAND_ON_S: f64 = 2.0;
/// A servo may take so long until its motor has settled, in s: longer than it waits itself.
const SETTLE_PATIENCE_S: f64 = 5.0;

/// What moves an axis by hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Motion {
    /// Nothing: it stands, and the next motion may begin.
    #[default]
    None,
    /// Increments, which add up.
    Increments,
    /// A jog that goes on until this scan at the latest, unless its session renews it.
    Held { session: u32, until: u64 },
    /// A straight line of several axes.
    Line,
    /// Homing looks for something.
    Homing,
    /// It comes to rest where it can.
    Stop,
}

/// What an order did by hand, for its answer.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ByOrder {
    /// What was taken of an increment or of a wheel's counts, in mm.
    pub jogged_mm: f64,
    /// Counts of a wheel that were taken, signed.
    pub counts: i32,
    /// The first axis whose motion was cut short, and where it will stand, in increments.
    pub cut: Option<(u32, i64)>,
}

/// What a course is to do once the change under way has come.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum Wanted {
    #[default]
    Nothing,
    Aim(Aim),
    Stop,
}

/// How fast a motion by hand is to be, in mm/s.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct HandSpeed {
    /// Where no override scales it.
    pub full_mm_s: f64,
    /// At most, whatever the override.
    pub most_mm_s: f64,
}

impl HandSpeed {
    /// At this share of it, 1 for all.
    pub fn at(&self, share: f64) -> f64 {
        (self.full_mm_s * share).min(self.most_mm_s)
    }
}

/// The hand on an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hand {
    /// What moves it.
    pub motion: Motion,
    course: HandCourse,
    wanted: Wanted,
    /// State of its servo's manual controller.
    controller: Controller,
    /// How fast it is to go.
    speed: HandSpeed,
    /// Scan of its last increment.
    pub clicked: u64,
    /// The wheel that it follows.
    pub wheel: Wheel,
    /// Scans that its servo has been waited for.
    waited_scans: u64,
    /// Limits of acceleration and jerk, in parts of an increment and scans.
    pub limits: JogProfile,
    /// Parts of an increment in a scan of 1 mm/s.
    step_per_mm_s: f64,
}

/// Acceleration of motions by hand, in mm/s².
pub(super) fn acceleration_by_hand(axis: &Axis) -> f64 {
    JOG_ACCELERATION_SHARE * axis.acceleration_mm_s2
}

impl Hand {
    pub fn new(machine: &Machine, axis: &Axis) -> Hand {
        let (scan_s, part_mm) = (machine.scan_period_s(), axis.increment_mm() / FINE as f64);
        let acceleration_mm_s2 = acceleration_by_hand(axis);
        let change = libm::floor(acceleration_mm_s2 * scan_s * scan_s / part_mm) as i64;
        let jerk = axis.jerk_mm_s3;
        Hand {
            motion: Motion::None,
            course: HandCourse::at(0),
            wanted: Wanted::Nothing,
            controller: Controller::Off,
            speed: HandSpeed::default(),
            clicked: 0,
            wheel: Wheel::default(),
            waited_scans: 0,
            limits: JogProfile::new(1, change, jerk.map(|jerk| jerk * scan_s.powi(3) / part_mm)),
            step_per_mm_s: scan_s / part_mm,
        }
    }

    /// State that a later scan depends on, beside the course: the kind of motion and the scans it is left, the next aim, the servo.
    pub fn inner(&self, scan: u64) -> [u64; 6] {
        let (kind, left) = match self.motion {
            Motion::None => (0, 0),
            Motion::Increments => (1, 0),
            Motion::Held { session, until } => (2 + u64::from(session), until.saturating_sub(scan)),
            Motion::Line => (u64::MAX - 2, 0),
            Motion::Homing => (u64::MAX, 0),
            Motion::Stop => (u64::MAX - 1, 0),
        };
        let wanted = match self.wanted {
            Wanted::Nothing => 0,
            Wanted::Aim(aim) => aim.goal as u64 ^ 1,
            Wanted::Stop => u64::MAX,
        };
        [
            kind,
            left,
            wanted,
            self.waited_scans << 2 | self.controller as u64,
            self.speed.full_mm_s.to_bits(),
            self.speed.most_mm_s.to_bits(),
        ]
    }

    /// Largest step of a scan at this share of its speed; only at none of it 0, where it rests.
    fn step_max(&self, share: f64) -> i64 {
        let step = libm::floor(self.speed.at(share) * self.step_per_mm_s) as i64;
        step.max(i64::from(share > 0.0))
    }

    /// Nothing moves or is about to.
    fn rests(&self) -> bool {
        self.course.rests() && self.wanted == Wanted::Nothing
    }

    /// Its motion has ended, and the motor has settled.
    fn is_done(&self) -> bool {
        self.rests() && self.controller == Controller::Settled
    }

    /// Where it is to end as far as is known, in increments.
    pub fn target(&self) -> i64 {
        match self.wanted {
            Wanted::Aim(aim) => aim.goal.div_euclid(FINE),
            Wanted::Nothing | Wanted::Stop => self.course.target(),
        }
    }
}

impl AxisUnit {
    /// Whether it is moved by hand, or by its drive: not at rest in the hand.
    pub(super) fn is_moved_by_hand(&self) -> bool {
        match self.driver {
            Driver::Program => false,
            Driver::Manual => self.hand.motion != Motion::None,
            Driver::Drive => true,
        }
    }

    /// Whether a motion by hand other than homing is on its way.
    fn is_under_way(&self) -> bool {
        let homes = matches!(self.hand.motion, Motion::Homing | Motion::None);
        self.driver == Driver::Manual && !homes && !self.hand.rests()
    }

    /// Whether it stands in the hand.
    pub(super) fn is_in_hand(&self) -> bool {
        self.driver == Driver::Manual && self.hand.motion == Motion::None
    }

    /// Where it is to end by hand, or is commanded to be, in increments.
    pub(super) fn target(&self) -> i64 {
        match self.driver {
            Driver::Manual => self.hand.target(),
            Driver::Program | Driver::Drive => self.command_position,
        }
    }

    /// The hand takes it to a place in increments, at this share of a speed; from rest within these limits of acceleration and jerk, or
    /// its own.
    pub(super) fn move_by_hand(
        &mut self,
        motion: Motion,
        goal: i64,
        (speed, share): (HandSpeed, f64),
        limits: Option<&JogProfile>,
    ) {
        if self.driver != Driver::Manual {
            self.driver = Driver::Manual;
            self.hand.course = HandCourse::at(self.command_position);
            self.hand.controller = Controller::Off;
        }
        if self.hand.course.rests() {
            self.hand.course.limit(limits.unwrap_or(&self.hand.limits));
        }
        self.hand.motion = motion;
        self.hand.waited_scans = 0;
        self.hand.speed = speed;
        self.hand.wanted = Wanted::Aim(Aim {
            goal: fine(goal),
            step_max: self.hand.step_max(share),
        });
    }

    /// What is jogged goes on at this share of its speed.
    pub(super) fn scale_by_hand(&mut self, share: f64) {
        let hand = &mut self.hand;
        let is_jog = matches!(
            hand.motion,
            Motion::Increments | Motion::Held { .. } | Motion::Line
        );
        if self.driver == Driver::Manual && is_jog && !hand.rests() {
            hand.wanted = Wanted::Aim(Aim {
                goal: fine(hand.target()),
                step_max: hand.step_max(share),
            });
        }
    }

    /// The hand brings it to rest where it can.
    pub(super) fn rest_by_hand(&mut self) {
        if self.driver == Driver::Manual && self.hand.motion != Motion::None {
            self.hand.motion = Motion::Stop;
            self.hand.wanted = if self.hand.course.rests() {
                Wanted::Nothing
            } else {
                Wanted::Stop
            };
        }
    }

    /// Where it will stand once it has braked as it is about to, in increments: the change under way comes first.
    fn stands_by_hand(&self, scans: u32) -> i64 {
        let mut course = self.hand.course;
        if self.hand.wanted == Wanted::Stop {
            for _ in 0..course.changes_in.max(1) {
                course = course.advanced();
            }
            course.stop(scans);
        }
        course.target()
    }

    /// The program's controller drives again.
    pub(super) fn leave_hand(&mut self) {
        self.driver = Driver::Program;
        self.hand.motion = Motion::None;
        self.hand.wanted = Wanted::Nothing;
        self.hand.controller = Controller::Off;
    }

    /// One scan of its course: where the servos have it in this scan.
    pub(super) fn step_by_hand(&mut self) {
        if self.driver == Driver::Manual {
            self.hand.course = self.hand.course.advanced();
            self.command_position = self.hand.course.place();
        }
    }

    /// Where its course is in the scan after so many, in increments.
    pub(super) fn by_hand_in(&self, scans: usize) -> i64 {
        let mut course = self.hand.course;
        for _ in 0..scans {
            course = course.advanced();
        }
        course.place()
    }

    /// What its servo says of the motion.
    pub(super) fn heed_hand(&mut self, taken: &Taken) {
        if let Taken::Command(command) = taken {
            self.hand.controller = Controller::from_wire(command.hand);
        }
    }

    /// The course that its servos see.
    pub(super) fn hand_course(&self) -> bus::sample::HandCourse {
        match self.driver {
            Driver::Manual => bytemuck::cast(self.hand.course),
            Driver::Program | Driver::Drive => bus::sample::HandCourse::default(),
        }
    }
}

impl<D: Drives> Master<D> {
    /// Axes begin to be moved by hand: the machine leaves the path.
    pub(super) fn take_in_hand(&mut self) {
        if self.mode != Mode::Jogging {
            self.forget_cause_of_jog();
            self.jog_from = self.mode;
            self.mode = Mode::Jogging;
            self.windows.drop_all(self.scan, Dropped::LeavesPath);
        }
    }

    /// All that is moved by hand comes to rest where it can; homing ends.
    pub(super) fn rest_all_by_hand(&mut self) {
        self.cut_by_hand(|_| true);
        self.end_homing();
    }

    /// What is moved by hand of these axes comes to rest where it can. The first that is cut short is told.
    pub(super) fn cut_by_hand(&mut self, which: impl Fn(&AxisUnit) -> bool) {
        let scans = self.change_scans().unwrap_or(1);
        for (index, axis) in self.axes.iter_mut().enumerate() {
            if !which(axis) {
                continue;
            }
            let moves = axis.is_under_way();
            axis.rest_by_hand();
            if moves && self.by_order.cut.is_none() {
                self.by_order.cut = Some((index as u32, axis.stands_by_hand(scans)));
            }
        }
    }

    /// Contact of the probe ends all that is moved by hand, but homing.
    pub(super) fn heed_touch(&mut self) {
        let moves = |axis: &AxisUnit| axis.is_under_way() && axis.hand.motion != Motion::Stop;
        let moved = self.axes.iter().position(moves);
        let Some(axis) = moved.filter(|_| self.auxiliary.questions.touched) else {
            return;
        };
        self.axes.iter_mut().for_each(AxisUnit::rest_by_hand);
        // What has stopped a program for good stays to be seen.
        if self.jog_from != Mode::Stopped || self.cause == Cause::None {
            self.cause = Cause::ProbeJogged;
            self.cause_axis = axis as u32;
            self.cause_scan = self.scan + 1;
        }
    }

    /// The probe has stopped a motion by hand: another one begins, or the program goes on.
    pub(super) fn forget_cause_of_jog(&mut self) {
        if self.cause == Cause::ProbeJogged {
            self.clear_causes();
        }
    }

    /// Whether an axis is moved by hand.
    pub(super) fn is_moved_by_hand(&self) -> bool {
        self.homing.is_some() || self.axes.iter().any(AxisUnit::is_moved_by_hand)
    }

    /// Whether what the hand moves on these axes has come to rest, and the motors with it.
    pub(super) fn is_done_by_hand(&self, axis: usize) -> bool {
        self.motors_of(axis).all(|motor| {
            let axis = self.axes.get(motor);
            axis.is_none_or(|axis| axis.driver != Driver::Manual || axis.hand.is_done())
        })
    }

    /// Scans until a change of a course takes effect: as far as the servos look ahead, and one; none where the hand is on nothing.
    fn change_scans(&self) -> Option<u32> {
        let by_hand = |axis: &&AxisUnit| axis.driver == Driver::Manual;
        let hands = self.axes.iter().filter(by_hand);
        let ahead_scans = hands.map(|axis| axis.command.ahead_scans).max()?;
        Some(ahead_scans.min(AHEAD_SCANS_MAX) + 1)
    }

    /// One scan of all motions by hand, once the answers of the scan are taken: what is wanted is begun as early as the servos look
    /// ahead, held jogs that nobody renews end, and what is done is over.
    pub(super) fn step_hands(&mut self) {
        let Some(scans) = self.change_scans() else {
            return;
        };
        let mut hands = self
            .axes
            .iter()
            .filter(|axis| axis.driver == Driver::Manual);
        let all_follow = hands.all(|axis| axis.hand.controller >= Controller::Follows);
        let patience_scans = (SETTLE_PATIENCE_S / self.scan_period_s) as u64;
        let mut lost = None;
        for (index, axis) in self.axes.iter_mut().enumerate() {
            if axis.driver != Driver::Manual {
                continue;
            }
            if matches!(axis.hand.motion, Motion::Held { until, .. } if self.scan >= until) {
                axis.rest_by_hand();
            }
            let hand = &mut axis.hand;
            // Those that begin together begin in the same scan: motors of a gantry, axes of a line.
            let may_change = hand.course.changes_in == 0 && (all_follow || !hand.course.rests());
            match hand.wanted {
                Wanted::Aim(aim) if may_change => hand.course.change(aim, scans),
                Wanted::Stop if may_change => hand.course.stop(scans),
                _ => {
                    let waits = hand.motion != Motion::None && hand.course.rests();
                    hand.waited_scans = if waits { hand.waited_scans + 1 } else { 0 };
                    if hand.waited_scans > patience_scans {
                        lost = Some(index as u32);
                    }
                    if hand.is_done() && hand.motion != Motion::Homing {
                        hand.motion = Motion::None;
                    }
                    continue;
                }
            }
            hand.wanted = Wanted::Nothing;
        }
        if let Some(axis) = lost {
            self.trip(Cause::NotInPosition, axis);
        }
    }

    /// Nothing is moved by hand any more: the mode is again what it was before. The hand stays on for a while where no
    /// program moves anything.
    pub(super) fn leave_hands(&mut self) {
        if self.is_moved_by_hand() {
            self.hand_on_scans = (HAND_ON_S / self.scan_period_s) as u64;
            return;
        }
        if self.mode == Mode::Jogging {
            self.mode = self.jog_from;
            self.rest_scans = 0;
        }
        self.hand_on_scans = self.hand_on_scans.saturating_sub(1);
        // In a hold the planner still sends windows, which only the program's controllers execute.
        let keeps = matches!(self.mode, Mode::Ready | Mode::Stopped | Mode::Stopping);
        if !keeps || self.hand_on_scans == 0 {
            self.axes.iter_mut().for_each(AxisUnit::leave_hand);
        }
    }
}
