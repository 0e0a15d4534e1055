//! Jogs: by an increment, and held by somebody who renews the order. Who gave a held jog and is dead, stopped or cut off moves nothing
//! any more: the axis comes to rest. Deadlines are scans, so that no clock has to agree with another one.

use bus::sample::{MAX_AXES, Mode, OperatorRequest, Refused};
use loops::hand_course::fine;
use loops::jog::JogProfile;
use machine::AxisKind;

use super::Master;
use super::axis_unit::AxisUnit;
use super::hand::{HandSpeed, Motion};
use super::orders::Refusal;
use crate::drives::Drives;

/// No jog is slower than this, in mm/s: below it, speeds are not told apart.
const JOG_MM_S_MIN: f64 = 0.001;
/// The longest deadline, in s.
const DEADLINE_MAX_S: f64 = 2.0;
/// After an increment so much motion may be left beside it, in s at the speed of the jog.
pub(super) const BACKLOG_S: f64 = 0.2;

/// Increments that come no further apart than this, in s, are one motion without a stop: each is spread over twice the time since the one
/// before.
pub(super) const TURNING_S: f64 = 0.1;

/// Increments that were taken lately, by who gave them.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Numbered {
    /// Session and newest number, the newest session first.
    taken: [(u32, u32); 4],
}

impl Numbered {
    /// Whether this increment was taken before.
    fn was_taken(&self, session: u32, number: u32) -> bool {
        let same = |of: &&(u32, u32)| session != 0 && of.0 == session;
        self.taken
            .iter()
            .find(same)
            .is_some_and(|of| number <= of.1)
    }

    fn knows(&self, session: u32) -> bool {
        self.taken.iter().any(|of| of.0 == session)
    }

    fn take(&mut self, session: u32, number: u32) {
        if session == 0 {
            return;
        }
        let place = self.taken.iter().position(|of| of.0 == session);
        let place = place.unwrap_or(self.taken.len() - 1);
        if let Some(of) = self.taken.get_mut(..=place) {
            of.rotate_right(1);
        }
        let [newest, ..] = &mut self.taken;
        *newest = (session, number);
    }
}

/// A straight line by hand, from 0 to 1: how fast it may go so that no axis of it goes faster than it may.
#[derive(Debug, Clone, Copy)]
struct Line {
    /// Square of the way of the slides, in mm², and of the others, in degrees².
    length2: [f64; 2],
    /// Per second at most, and where the order gives no speed; per scan²; and how closely the command follows its lead, which limits the
    /// jerk.
    most: f64,
    usual: f64,
    acceleration: f64,
    follows_by: f64,
}

impl Default for Line {
    fn default() -> Line {
        Line {
            length2: [0.0; 2],
            most: f64::INFINITY,
            usual: f64::INFINITY,
            acceleration: f64::INFINITY,
            follows_by: 1.0,
        }
    }
}

impl Line {
    /// With this axis, which goes so many increments; jogs of it are so fast, in mm/s, where the order gives no speed.
    fn take(&mut self, unit: &AxisUnit, way: i64, usual_mm_s: f64) {
        let way_mm = way as f64 * unit.settings.increment_mm();
        let [slides, others] = &mut self.length2;
        match unit.settings.kind {
            AxisKind::Linear => *slides += way_mm * way_mm,
            _ => *others += way_mm * way_mm,
        }
        if way == 0 {
            return;
        }
        let limits = unit.hand.limits();
        let most_mm_s = unit.speed_by_hand(unit.settings.rapid_mm_s);
        self.most = self.most.min(most_mm_s / way_mm.abs());
        self.usual = self.usual.min(usual_mm_s / way_mm.abs());
        let way = fine(way).unsigned_abs() as f64;
        self.acceleration = self.acceleration.min(limits.step_change_max as f64 / way);
        // Jerk by acceleration: the slower an axis may speed up, the more closely it may follow.
        self.follows_by = self.follows_by.min(limits.follows_by);
    }

    /// Speed of an axis and its limits; the tool goes so fast along the slides, or else along the others, where nothing scales it.
    fn of_axis(&self, unit: &AxisUnit, way: i64, along_mm_s: f64) -> (HandSpeed, JogProfile) {
        let [slides, others] = self.length2.map(libm::sqrt);
        let length = if slides > 0.0 { slides } else { others };
        let way_mm = libm::fabs(way as f64 * unit.settings.increment_mm());
        let speed = HandSpeed {
            full_mm_s: self.usual.min(along_mm_s / length) * way_mm,
            most_mm_s: self.most * way_mm,
        };
        let change = self.acceleration * fine(way).unsigned_abs() as f64;
        let limits = JogProfile::following(1, libm::floor(change) as i64, self.follows_by);
        (speed, limits)
    }
}

impl AxisUnit {
    /// A speed by hand, in mm/s, as fast as the axis may be: one that is not homed is no faster than its search.
    fn speed_by_hand(&self, speed_mm_s: f64) -> f64 {
        match self.settings.homing {
            Some(homing) if !self.is_homed() => speed_mm_s.min(homing.search_mm_s),
            _ => speed_mm_s,
        }
    }

    /// A way of a jog, in increments, as a whole number of them; within the travel from `from` on, or what of it is allowed there.
    fn way_of_jog(&self, axis: u32, way_mm: f64, from: i64) -> Result<i64, Refusal> {
        let increment_mm = self.settings.increment_mm();
        // Beyond all machines a distance has no increments.
        let distance = libm::round(way_mm / increment_mm);
        if !distance.is_finite() {
            return Err(Refused::BadValue.into());
        }
        let (low, high) = self.reach();
        let [least, most] = [low, high].map(|end| end.saturating_sub(from) as f64);
        if !(least..=most).contains(&distance) {
            return Err(Refusal {
                reason: Refused::BeyondTravel,
                allowed_mm: (least * increment_mm, most * increment_mm),
                axis,
            });
        }
        Ok(distance as i64)
    }

    /// Places where a jog may end, in increments; from outside the travel, to the far end and no farther out. Nobody knows where the
    /// travel of an axis that is not homed is: it may go as far as that is long.
    pub(super) fn reach(&self) -> (i64, i64) {
        let here = self.command_position();
        if !self.is_homed() {
            let travel_mm = self.settings.travel_max_mm - self.settings.travel_min_mm;
            let travel = self.increments(travel_mm);
            return (here.saturating_sub(travel), here.saturating_add(travel));
        }
        let reach = self.guards.travel.from_place(here);
        (reach.min, reach.max)
    }
}

impl<D: Drives> Master<D> {
    /// Takes an increment: from rest, or further where the axis goes by increments already.
    ///
    /// One that is numbered (its session is not 0) counts once, however often it comes, and is cut at the end of the travel.
    pub(super) fn order_jog(&mut self, request: &OperatorRequest) -> Result<(), Refusal> {
        let numbered = request.session != 0;
        let (session, number) = (request.session, request.deadline_scans);
        if self.manual.numbered.was_taken(session, number) {
            return Ok(());
        }
        let unit = self.unit_to_jog(request.axis, true)?;
        let increment_mm = unit.settings.increment_mm();
        let distance = libm::round(request.value / increment_mm);
        if !distance.is_finite() || distance == 0.0 {
            return Err(Refused::BadValue.into());
        }
        let speed = self.jog_speed(request)?;
        let from = unit.target();
        let way = match unit.way_of_jog(request.axis, request.value, from) {
            Err(beyond) if numbered => {
                let (least_mm, most_mm) = beyond.allowed_mm;
                unit.increments(request.value.clamp(least_mm, most_mm))
            }
            judged => judged?,
        };
        if way == 0 {
            return Err(Refused::TravelEnd.into());
        }
        self.limits_allow(request.axis as usize, way)?;
        let target = from.saturating_add(way);
        let left_mm = target.saturating_sub(unit.command_position()) as f64 * increment_mm;
        let most_mm = request.value.abs() + BACKLOG_S * speed.at(self.auxiliary.jog_share());
        if unit.is_moved_by_hand() && left_mm.abs() > most_mm {
            return Err(Refused::Backlog.into());
        }
        let turning_s = self.turning_s(unit).filter(|_| numbered);
        self.manual.numbered.take(session, number);
        self.move_by_increments(request.axis as usize, way, speed, turning_s);
        Ok(())
    }

    /// Time since the increment before, where this one goes on with it, in s.
    pub(super) fn turning_s(&self, unit: &AxisUnit) -> Option<f64> {
        let since_s =
            self.scan.saturating_sub(unit.hand.clicked()) as f64 * self.timing.scan_period_s;
        let turns = unit.is_moved_by_hand() && since_s > 0.0 && since_s <= TURNING_S;
        turns.then_some(since_s)
    }

    /// An axis goes further by so many increments; where increments go on with those before, no faster than in twice the time since then.
    pub(super) fn move_by_increments(
        &mut self,
        index: usize,
        way: i64,
        mut speed: HandSpeed,
        turning_s: Option<f64>,
    ) {
        let Some(unit) = self.axes.get(index) else {
            return;
        };
        let increment_mm = unit.settings.increment_mm();
        let target = unit.target().saturating_add(way);
        let left = target.saturating_sub(unit.command_position());
        let left_mm = left as f64 * increment_mm;
        if let Some(since_s) = turning_s.filter(|_| left.signum() == way.signum()) {
            speed.most_mm_s = speed.most_mm_s.min(left_mm.abs() / (2.0 * since_s));
        }
        self.jog_to(index, Motion::Increments, target, speed, None);
        self.manual.note_jogged(way as f64 * increment_mm);
        self.note_increment(index);
    }

    /// An increment came for this axis.
    pub(super) fn note_increment(&mut self, index: usize) {
        if let Some(unit) = self.axes.get_mut(index) {
            unit.hand.click(self.scan);
        }
    }

    /// Begins a jog of several axes along a straight line, from rest to rest: one motion, of which each axis makes its share.
    pub(super) fn order_jog_line(&mut self, request: &OperatorRequest) -> Result<(), Refusal> {
        let mut line = Line::default();
        for (index, way_mm) in request.line_mm.iter().enumerate() {
            if *way_mm == 0.0 {
                continue;
            }
            let axis = index as u32;
            let unit = self.unit_to_jog(axis, false)?;
            let way = unit.way_of_jog(axis, *way_mm, unit.command_position())?;
            self.limits_allow(index, way)?;
            let usual_mm_s = match request.speed_mm_s {
                0.0 => self.manual.jog_mm_s(),
                _ => f64::INFINITY,
            };
            line.take(unit, way, usual_mm_s);
        }
        let along_mm_s = match request.speed_mm_s {
            0.0 => self.manual.jog_mm_s(),
            speed if speed >= JOG_MM_S_MIN => speed,
            _ => return Err(Refused::BadValue.into()),
        };
        for (index, way_mm) in request.line_mm.iter().enumerate() {
            let Some(unit) = self.axes.get(index).filter(|_| *way_mm != 0.0) else {
                continue;
            };
            let way = unit.increments(*way_mm);
            let target = unit.command_position().saturating_add(way);
            let (speed, limits) = line.of_axis(unit, way, along_mm_s);
            self.jog_to(index, Motion::Line, target, speed, Some(&limits));
        }
        Ok(())
    }

    /// Begins a held jog: the sign of the value is the direction. It ends at the end of the travel.
    pub(super) fn order_jog_on(&mut self, request: &OperatorRequest) -> Result<(), Refusal> {
        let unit = self.unit_to_jog(request.axis, false)?;
        let direction = request.value;
        let is_direction = direction == 1.0 || direction == -1.0;
        if !is_direction || request.session == 0 || request.deadline_scans == 0 {
            return Err(Refused::BadValue.into());
        }
        self.limits_allow(request.axis as usize, direction as i64)?;
        let (low, high) = unit.reach();
        let target = if direction > 0.0 { high } else { low };
        if target == unit.command_position() {
            return Err(Refused::TravelEnd.into());
        }
        let motion = Motion::Held {
            session: request.session,
            until: self.jog_until(request)?,
        };
        let speed = self.jog_speed(request)?;
        self.jog_to(request.axis as usize, motion, target, speed, None);
        Ok(())
    }

    /// Renews the jogs of this session, at another speed if the order has one; without a deadline they come to rest, and so does what
    /// goes by increments that the session has given.
    pub(super) fn order_jog_renew(&mut self, request: &OperatorRequest) -> Result<(), Refusal> {
        if request.deadline_scans == 0 && self.manual.numbered.knows(request.session) {
            let by_increments = |axis: &AxisUnit| axis.hand.motion() == Motion::Increments;
            self.cut_by_hand(by_increments);
            return Ok(());
        }
        let of_session = |axis: &AxisUnit| matches!(axis.hand.motion(), Motion::Held { session, .. } if session == request.session);
        if self.mode() != Mode::Jogging || !self.axes.iter().any(of_session) {
            return Err(Refused::JogOver.into());
        }
        let new_until = self.jog_until(request)?;
        if request.deadline_scans == 0 {
            self.cut_by_hand(of_session);
            return Ok(());
        }
        // All are judged before the first is renewed.
        let mut speeds = [None; MAX_AXES];
        for (index, speed) in speeds.iter_mut().enumerate() {
            let axis = index as u32;
            let renews = self.axes.get(index).is_some_and(of_session);
            if renews && request.speed_mm_s != 0.0 && !self.gantries.is_follower(index) {
                *speed = Some(self.jog_speed(&OperatorRequest { axis, ..*request })?);
            }
        }
        for axis in self.axes.iter_mut().filter(|axis| of_session(axis)) {
            axis.hand.renew(new_until);
        }
        for (index, speed) in speeds.into_iter().enumerate() {
            if let Some((axis, speed)) = self.axes.get(index).zip(speed) {
                let (motion, target) = (axis.hand.motion(), axis.target());
                self.jog_to(index, motion, target, speed, None);
            }
        }
        Ok(())
    }

    /// The last scan of a held jog that nobody renews. An order names it, counted from what its sender has seen: what is on the way for
    /// long moves nothing for long.
    fn jog_until(&self, request: &OperatorRequest) -> Result<u64, Refusal> {
        let most = libm::ceil(DEADLINE_MAX_S / self.timing.scan_period_s) as u32;
        if request.deadline_scans > most {
            return Err(Refused::BadValue.into());
        }
        let until = self.scan.saturating_add(request.deadline_scans.into());
        Ok(match request.latest_scan {
            0 => until,
            latest => until.min(latest),
        })
    }

    /// The axis that an order is to jog, where one may be jogged.
    pub(super) fn unit_to_jog(&self, axis: u32, by_increment: bool) -> Result<&AxisUnit, Refusal> {
        let unit = self.axes.get(axis as usize);
        let unit = unit.filter(|_| !self.gantries.is_follower(axis as usize));
        let ends = |axis: &AxisUnit| axis.hand.motion() == Motion::Stop;
        let others_end = self.manual.homes() || self.axes.iter().any(ends);
        match (self.mode(), unit) {
            (Mode::Jogging, Some(unit)) if !others_end => {
                let adds_up = by_increment && unit.hand.motion() == Motion::Increments;
                if unit.is_moved_by_hand() && !adds_up {
                    return Err(Refused::Jogging.into());
                }
            }
            (_, Some(_)) if self.axes.iter().any(|axis| axis.hand.holds()) => {
                match self.must_rest() {
                    // While the hand is on, the next motion may begin at once.
                    Err(refusal) if refusal.reason == Refused::NotAtRest && self.is_idle() => {}
                    judged => judged?,
                }
            }
            _ => self.must_rest()?,
        }
        if self.auxiliary.is_coupled() {
            return Err(Refused::InThread.into());
        }
        self.signals_allow(false)?;
        Ok(unit.ok_or(Refused::UnknownAxis)?)
    }

    /// Speed of a jog, from the order or the machine file. An axis that is not homed is no faster than its search.
    pub(super) fn jog_speed(&self, request: &OperatorRequest) -> Result<HandSpeed, Refusal> {
        let unit = self.axes.get(request.axis as usize);
        let unit = unit.ok_or(Refused::UnknownAxis)?;
        let most_mm_s = unit.settings.rapid_mm_s;
        let full_mm_s = match request.speed_mm_s {
            0.0 => self.manual.jog_mm_s().min(most_mm_s),
            speed if (JOG_MM_S_MIN..=most_mm_s).contains(&speed) => speed,
            _ => {
                return Err(Refusal {
                    reason: Refused::JogSpeed,
                    allowed_mm: (JOG_MM_S_MIN, most_mm_s),
                    axis: request.axis,
                });
            }
        };
        Ok(HandSpeed {
            full_mm_s,
            most_mm_s: unit.speed_by_hand(most_mm_s),
        })
    }

    /// Scales the speeds of all jogs, those under way too; 0 rests, and what was begun goes on from there later.
    pub(super) fn order_jog_override(&mut self, percent: f64) -> Result<(), Refusal> {
        self.auxiliary.override_jogs(percent)?;
        let share = self.auxiliary.jog_share();
        let axes = self.axes.iter_mut();
        axes.for_each(|axis| axis.hand.scale(share));
        Ok(())
    }

    /// The hand takes an axis to a place in increments, with both motors of a gantry.
    fn jog_to(
        &mut self,
        axis: usize,
        motion: Motion,
        target: i64,
        speed: HandSpeed,
        limits: Option<&JogProfile>,
    ) {
        let share = self.auxiliary.jog_share();
        for motor in self.gantries.motors_of(axis) {
            if let Some(unit) = self.axes.get_mut(motor) {
                let way = (unit.command_position(), target);
                unit.hand.move_to(motion, way, (speed, share), limits);
            }
        }
        self.take_in_hand();
    }
}
