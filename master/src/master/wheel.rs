//! A wheel: a running count that an axis follows. What counts is the difference to the count before, so one that comes twice moves
//! nothing and one that is lost costs nothing; the first one only says where the wheel is.

use bus::sample::{OperatorRequest, Refused};

use super::Master;
use super::axis_unit::AxisUnit;
use super::hand::acceleration_by_hand;
use super::jog::{BACKLOG_S, TURNING_S};
use super::orders::Refusal;
use crate::drives::Drives;

/// Where a wheel was that moves an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Wheel {
    /// Session that counts; 0 for none.
    session: u32,
    /// The newest count.
    count: i32,
    /// Increments of a count, signed.
    per_count: i64,
}

impl Wheel {
    /// Whether this session counts.
    pub fn is_of(&self, session: u32) -> bool {
        self.session == session
    }

    /// What it has turned since another look at the same wheel, in counts; none where that was another one, or another step.
    fn turned_since(&self, before: &Wheel) -> Option<i32> {
        let same = self.session == before.session && self.per_count == before.per_count;
        same.then(|| self.count.wrapping_sub(before.count))
    }
}

impl AxisUnit {
    /// Furthest that a wheel may leave it to go beside one count, in s at its speed. Where every count is to be travelled it is as of
    /// increments; where the axis is to rest with the wheel, its braking and the time over which counts are spread.
    fn wheel_s(&self, velocity_mode: bool, speed_mm_s: f64, turning_s: Option<f64>) -> f64 {
        if !velocity_mode {
            return BACKLOG_S;
        }
        let brakes_s = speed_mm_s / (2.0 * acceleration_by_hand(&self.settings));
        (brakes_s + 2.0 * turning_s.unwrap_or(TURNING_S)).min(BACKLOG_S)
    }
}

impl<D: Drives> Master<D> {
    /// Takes the count of a wheel: the axis goes by as many of its steps as the wheel has turned, in whole counts. What would be too far
    /// to go, or beyond the travel, is not taken and never made up for; nor is what comes while the axis may not be jogged.
    pub(super) fn order_wheel(&mut self, request: &OperatorRequest) -> Result<(), Refusal> {
        let index = request.axis as usize;
        let unit = self
            .axes
            .get(index)
            .filter(|_| !self.gantries.is_follower(index));
        let unit = unit.ok_or(Refused::UnknownAxis)?;
        let per_count = unit.increments(request.value);
        let is_mode = request.velocity_mode <= 1;
        if per_count == 0 || !request.value.is_finite() || request.session == 0 || !is_mode {
            return Err(Refused::BadValue.into());
        }
        let speed = self.jog_speed(request)?;
        let speed_mm_s = speed.at(self.auxiliary.jog_share());
        let wheel = Wheel {
            session: request.session,
            count: request.count,
            per_count,
        };
        let before = self.follow_wheel(index, wheel);
        let unit = self.unit_to_jog(request.axis, true)?;
        let Some(turned) = wheel.turned_since(&before).filter(|turned| *turned != 0) else {
            return Ok(());
        };
        let from = unit.target();
        let step = per_count.saturating_mul(turned.signum().into());
        self.limits_allow(index, step)?;
        let (low, high) = unit.reach();
        let end = if step > 0 { high } else { low };
        let to_end = counts(end.saturating_sub(from), step);
        if to_end == 0 {
            return Err(Refused::TravelEnd.into());
        }
        let turning_s = self.turning_s(unit);
        let most_s = unit.wheel_s(request.velocity_mode == 1, speed_mm_s, turning_s);
        let most = unit.increments(most_s * speed_mm_s);
        let left = from.saturating_sub(unit.command_position());
        let room = most.saturating_mul(step.signum()).saturating_sub(left);
        // One count beside it.
        let room = counts(room.saturating_add(step), step);
        let taken = i64::from(turned.unsigned_abs()).min(to_end).min(room);
        if taken == 0 {
            // It turns on.
            self.note_increment(index);
            return Err(Refused::Backlog.into());
        }
        let way = step.saturating_mul(taken);
        let counted = (taken * i64::from(turned.signum())) as i32;
        self.manual.note_counts(counted);
        self.move_by_increments(index, way, speed, turning_s);
        Ok(())
    }

    /// This axis follows this wheel from now on, and no other axis does; what it has followed before.
    fn follow_wheel(&mut self, index: usize, wheel: Wheel) -> Wheel {
        let mut before = Wheel::default();
        for (of, axis) in self.axes.iter_mut().enumerate() {
            if of == index {
                before = axis.hand.follow_wheel(wheel);
            } else {
                axis.hand.forget_wheel(Some(wheel.session));
            }
        }
        before
    }

    /// With the drives off or braking no axis follows a wheel: what it counts meanwhile moves nothing later.
    pub(super) fn forget_wheels(&mut self) {
        if !self.mode().is_driven() {
            let axes = self.axes.iter_mut();
            axes.for_each(|axis| axis.hand.forget_wheel(None));
        }
    }
}

/// Whole counts in a way, each a step of the same sign; none where it leads the other way.
fn counts(way: i64, step: i64) -> i64 {
    way.checked_div(step).unwrap_or(0).max(0)
}
