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
use super::servos::Taken;
use super::wheel::Wheel;
use crate::drives::Drives;
use crate::window_arbiter::Dropped;

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
    /// Controller that drives the axis.
    driver: Driver,
    /// What moves it.
    motion: Motion,
    course: HandCourse,
    wanted: Wanted,
    /// State of its servo's manual controller.
    controller: Controller,
    /// How fast it is to go.
    speed: HandSpeed,
    /// Scan of its last increment.
    clicked: u64,
    /// The wheel that it follows.
    wheel: Wheel,
    /// Scans that its servo has been waited for.
    waited_scans: u64,
    /// Limits of acceleration and jerk, in parts of an increment and scans.
    limits: JogProfile,
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
            driver: Driver::Program,
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
    fn target(&self) -> i64 {
        match self.wanted {
            Wanted::Aim(aim) => aim.goal.div_euclid(FINE),
            Wanted::Nothing | Wanted::Stop => self.course.target(),
        }
    }
}

impl Hand {
    /// Which controller drives the axis.
    pub fn driver(&self) -> Driver {
        self.driver
    }

    /// Whether the hand is on the axis.
    pub fn is_on(&self) -> bool {
        self.driver == Driver::Manual
    }

    pub fn motion(&self) -> Motion {
        self.motion
    }

    pub fn limits(&self) -> &JogProfile {
        &self.limits
    }

    /// Whether the axis is moved by hand, or by its drive: not at rest in the hand.
    fn moves(&self) -> bool {
        match self.driver {
            Driver::Program => false,
            Driver::Manual => self.motion != Motion::None,
            Driver::Drive => true,
        }
    }

    /// Whether a motion by hand other than homing is on its way.
    fn is_under_way(&self) -> bool {
        let homes = matches!(self.motion, Motion::Homing | Motion::None);
        self.is_on() && !homes && !self.rests()
    }

    /// Whether the axis stands in the hand.
    pub fn holds(&self) -> bool {
        self.is_on() && self.motion == Motion::None
    }

    /// Takes the axis from where it is commanded to be to a place in increments, at this share of a speed; from rest within these
    /// limits of acceleration and jerk, or its own.
    pub fn move_to(
        &mut self,
        motion: Motion,
        (from, goal): (i64, i64),
        (speed, share): (HandSpeed, f64),
        limits: Option<&JogProfile>,
    ) {
        if !self.is_on() {
            self.driver = Driver::Manual;
            self.course = HandCourse::at(from);
            self.controller = Controller::Off;
        }
        if self.course.rests() {
            self.course.limit(limits.unwrap_or(&self.limits));
        }
        self.motion = motion;
        self.waited_scans = 0;
        self.speed = speed;
        self.wanted = Wanted::Aim(Aim {
            goal: fine(goal),
            step_max: self.step_max(share),
        });
    }

    /// A jog goes on at this share of its speed.
    pub fn scale(&mut self, share: f64) {
        let is_jog = matches!(
            self.motion,
            Motion::Increments | Motion::Held { .. } | Motion::Line
        );
        if self.is_on() && is_jog && !self.rests() {
            self.wanted = Wanted::Aim(Aim {
                goal: fine(self.target()),
                step_max: self.step_max(share),
            });
        }
    }

    /// A held jog goes on until this scan at the latest.
    pub fn renew(&mut self, new_until: u64) {
        if let Motion::Held { until, .. } = &mut self.motion {
            *until = new_until.max(*until);
        }
    }

    /// The motion comes to rest where it can.
    fn stop(&mut self) {
        if self.is_on() && self.motion != Motion::None {
            self.motion = Motion::Stop;
            self.wanted = if self.course.rests() {
                Wanted::Nothing
            } else {
                Wanted::Stop
            };
        }
    }

    /// A search has found what it looked for: it comes to rest where it can, and another one follows.
    pub fn stop_search(&mut self) {
        self.stop();
        self.motion = Motion::Homing;
    }

    /// Its motion is over.
    pub fn end_motion(&mut self) {
        self.motion = Motion::None;
    }

    /// Where it will stand once it has braked as it is about to, in increments: the change under way comes first.
    fn stands_at(&self, scans: u32) -> i64 {
        let mut course = self.course;
        if self.wanted == Wanted::Stop {
            for _ in 0..course.changes_in.max(1) {
                course = course.advanced();
            }
            course.stop(scans);
        }
        course.target()
    }

    /// The program's controller drives again.
    pub fn leave(&mut self) {
        self.driver = Driver::Program;
        self.motion = Motion::None;
        self.wanted = Wanted::Nothing;
        self.controller = Controller::Off;
    }

    /// The drive holds the axis by itself.
    pub fn give_to_drive(&mut self) {
        self.leave();
        self.driver = Driver::Drive;
    }

    /// The drive no longer holds the axis by itself.
    pub fn take_from_drive(&mut self) {
        if self.driver == Driver::Drive {
            self.driver = Driver::Program;
        }
    }

    /// One scan of the course; where it has the axis, in increments, while the hand is on it.
    pub fn step(&mut self) -> Option<i64> {
        self.is_on().then(|| {
            self.course = self.course.advanced();
            self.course.place()
        })
    }

    /// Where the course is in the scan after so many, in increments.
    pub fn place_in(&self, scans: usize) -> i64 {
        let mut course = self.course;
        for _ in 0..scans {
            course = course.advanced();
        }
        course.place()
    }

    /// What the servo says of the motion.
    pub fn heed(&mut self, taken: &Taken) {
        if let Taken::Command(command) = taken {
            self.controller = Controller::from_wire(command.hand);
        }
    }

    /// One scan of a motion by hand: a held jog that is not renewed ends, what is wanted is begun as early as the servos look ahead, in
    /// so many scans, and what is done is over. False once the servo has been waited for too long.
    fn step_motion(
        &mut self,
        scan: u64,
        ahead_scans: u32,
        all_follow: bool,
        patience_scans: u64,
    ) -> bool {
        if matches!(self.motion, Motion::Held { until, .. } if scan >= until) {
            self.stop();
        }
        // Those that begin together begin in the same scan: motors of a gantry, axes of a line.
        let may_change = self.course.changes_in == 0 && (all_follow || !self.course.rests());
        match self.wanted {
            Wanted::Aim(aim) if may_change => self.course.change(aim, ahead_scans),
            Wanted::Stop if may_change => self.course.stop(ahead_scans),
            _ => {
                let waits = self.motion != Motion::None && self.course.rests();
                self.waited_scans = if waits { self.waited_scans + 1 } else { 0 };
                if self.is_done() && self.motion != Motion::Homing {
                    self.motion = Motion::None;
                }
                return self.waited_scans <= patience_scans;
            }
        }
        self.wanted = Wanted::Nothing;
        true
    }

    /// Scan of its last increment.
    pub fn clicked(&self) -> u64 {
        self.clicked
    }

    /// An increment came for it in this scan.
    pub fn click(&mut self, scan: u64) {
        self.clicked = scan;
    }

    /// It follows this wheel from now on; the one that it followed before.
    pub fn follow_wheel(&mut self, wheel: Wheel) -> Wheel {
        std::mem::replace(&mut self.wheel, wheel)
    }

    /// It does not follow a wheel of this session any more; of any, where none is named.
    pub fn forget_wheel(&mut self, session: Option<u32>) {
        if session.is_none_or(|session| self.wheel.is_of(session)) {
            self.wheel = Wheel::default();
        }
    }

    /// The course that the servos see.
    pub fn told(&self) -> bus::sample::HandCourse {
        if self.is_on() {
            bytemuck::cast(self.course)
        } else {
            bus::sample::HandCourse::default()
        }
    }
}

impl AxisUnit {
    /// Whether it is moved by hand, or by its drive: not at rest in the hand.
    pub(super) fn is_moved_by_hand(&self) -> bool {
        self.hand.moves()
    }

    /// Where it is to end by hand, or is commanded to be, in increments.
    pub(super) fn target(&self) -> i64 {
        if self.hand.is_on() {
            self.hand.target()
        } else {
            self.command_position()
        }
    }
}

impl<D: Drives> Master<D> {
    /// Axes begin to be moved by hand: the machine leaves the path.
    pub(super) fn take_in_hand(&mut self) {
        if self.mode() != Mode::Jogging {
            self.forget_cause_of_jog();
            self.modes.begin_jog();
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
            let moves = axis.hand.is_under_way();
            axis.hand.stop();
            if moves {
                let place = axis.hand.stands_at(scans);
                self.manual.note_cut(index as u32, place);
            }
        }
    }

    /// Contact of the probe ends all that is moved by hand, but homing.
    pub(super) fn heed_touch(&mut self) {
        let moves = |axis: &AxisUnit| axis.hand.is_under_way() && axis.hand.motion != Motion::Stop;
        let moved = self.axes.iter().position(moves);
        let Some(axis) = moved.filter(|_| self.auxiliary.questions.is_touched()) else {
            return;
        };
        self.axes.iter_mut().for_each(|axis| axis.hand.stop());
        // What has stopped a program for good stays to be seen.
        if self.modes.jog_from() != Mode::Stopped || self.modes.cause() == Cause::None {
            let axis = axis as u32;
            self.modes.blame(Cause::ProbeJogged, axis, self.scan);
        }
    }

    /// The probe has stopped a motion by hand: another one begins, or the program goes on.
    pub(super) fn forget_cause_of_jog(&mut self) {
        if self.modes.cause() == Cause::ProbeJogged {
            self.clear_causes();
        }
    }

    /// Whether an axis is moved by hand.
    pub(super) fn is_moved_by_hand(&self) -> bool {
        self.manual.homes() || self.axes.iter().any(AxisUnit::is_moved_by_hand)
    }

    /// Whether what the hand moves on these axes has come to rest, and the motors with it.
    pub(super) fn is_done_by_hand(&self, axis: usize) -> bool {
        self.gantries.motors_of(axis).all(|motor| {
            let axis = self.axes.get(motor);
            axis.is_none_or(|axis| !axis.hand.is_on() || axis.hand.is_done())
        })
    }

    /// Scans until a change of a course takes effect: as far as the servos look ahead, and one; none where the hand is on nothing.
    fn change_scans(&self) -> Option<u32> {
        let hands = self.axes.iter().filter(|axis| axis.hand.is_on());
        let ahead_scans = hands.map(|axis| axis.servos.command().ahead_scans);
        let ahead_scans = ahead_scans.max()?;
        Some(ahead_scans.min(AHEAD_SCANS_MAX) + 1)
    }

    /// One scan of all motions by hand, once the answers of the scan are taken: what is wanted is begun as early as the servos look
    /// ahead, held jogs that nobody renews end, and what is done is over.
    pub(super) fn step_hands(&mut self) {
        let Some(scans) = self.change_scans() else {
            return;
        };
        let mut hands = self.axes.iter().filter(|axis| axis.hand.is_on());
        let all_follow = hands.all(|axis| axis.hand.controller >= Controller::Follows);
        let patience_scans = (SETTLE_PATIENCE_S / self.timing.scan_period_s) as u64;
        let mut lost = None;
        let axes = self.axes.iter_mut().enumerate();
        for (index, axis) in axes.filter(|(_, axis)| axis.hand.is_on()) {
            let hand = &mut axis.hand;
            if !hand.step_motion(self.scan, scans, all_follow, patience_scans) {
                lost = Some(index as u32);
            }
        }
        if let Some(axis) = lost {
            self.trip(Cause::NotInPosition, axis);
        }
    }

    /// Nothing is moved by hand any more: the mode is again what it was before. The hand stays on for a while where no
    /// program moves anything.
    pub(super) fn leave_hands(&mut self) {
        if self.is_moved_by_hand() {
            self.manual.stay_on(self.timing.scan_period_s);
            return;
        }
        self.modes.end_jog();
        // In a hold the planner still sends windows, which only the program's controllers execute.
        let keeps = matches!(self.mode(), Mode::Ready | Mode::Stopped | Mode::Stopping);
        if !self.manual.stays_on() || !keeps {
            self.axes.iter_mut().for_each(|axis| axis.hand.leave());
        }
    }
}
