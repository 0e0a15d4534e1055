//! A jog that goes on as long as its order is renewed: whoever gave it and is dead, stopped or cut off moves nothing any more.
//!
//! It is a jog to the end of the travel; without a renewal within its deadline the axis comes to rest as when it is ordered to stop.
//! Deadlines are counted in scans, so that no clock has to agree with another one.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::{Driver, Mode, OperatorRequest, Refused};

use super::Master;
use super::orders::Refusal;
use crate::drives::Drives;

/// Reserve before the end of the travel, in mm: neither settling nor lost motion takes the axis beyond it.
const END_RESERVE_MM: f64 = 0.1;
/// The longest deadline, in s.
const DEADLINE_MAX_S: f64 = 2.0;

/// A continuous jog that was not ordered to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ContinuousJog {
    /// Names it.
    pub session: u32,
    /// Scans that it goes on without being renewed.
    pub left_scans: u32,
}

impl<D: Drives> Master<D> {
    /// Begins one: the sign of the value is the direction.
    pub(super) fn order_jog_on(&mut self, request: &OperatorRequest) -> Result<(), Refusal> {
        let unit = self.unit_to_jog(request.axis)?;
        let direction = request.value;
        let is_direction = direction == 1.0 || direction == -1.0;
        if !is_direction || request.session == 0 || request.deadline_scans == 0 {
            return Err(Refused::BadValue.into());
        }
        let reserve = if unit.is_homed() {
            unit.increments(END_RESERVE_MM)
        } else {
            0
        };
        let (low, high) = unit.room();
        let distance = if direction > 0.0 {
            high.saturating_sub(reserve).max(0)
        } else {
            low.saturating_add(reserve).min(0)
        };
        if distance == 0 {
            return Err(Refused::TravelEnd.into());
        }
        let left_scans = self.deadline(request)?;
        let speed_mm_s = self.jog_speed(request)?;
        self.begin_jog(request.axis as usize, distance, speed_mm_s);
        self.continuous_jog = Some(ContinuousJog {
            session: request.session,
            left_scans,
        });
        Ok(())
    }

    /// Renews the one of this session, at another speed if the order has one; without a deadline it comes to rest.
    pub(super) fn order_jog_renew(&mut self, request: &OperatorRequest) -> Result<(), Refusal> {
        let of_session = |jog: &ContinuousJog| jog.session == request.session;
        let jog = self.continuous_jog.filter(of_session);
        if jog.is_none() || self.mode != Mode::Jogging {
            return Err(Refused::JogOver.into());
        }
        if request.deadline_scans == 0 {
            self.stop_jog();
            return Ok(());
        }
        let left_scans = self.deadline(request)?;
        let jogged = self.axes.iter().enumerate();
        let mut jogged = jogged.filter(|(_, unit)| unit.driver == Driver::Manual);
        let Some((axis, unit)) = jogged.next() else {
            return Err(Refused::JogOver.into());
        };
        let left = unit.jog_target.saturating_sub(unit.command_position);
        let request = OperatorRequest {
            axis: axis as u32,
            ..*request
        };
        if let Some(speed_mm_s) = self.jog_speed(&request)? {
            self.set_jog_speed(axis, left, Some(speed_mm_s));
        }
        self.continuous_jog = Some(ContinuousJog {
            session: request.session,
            left_scans,
        });
        Ok(())
    }

    fn deadline(&self, request: &OperatorRequest) -> Result<u32, Refusal> {
        let most = libm::ceil(DEADLINE_MAX_S / self.scan_period_s) as u32;
        if request.deadline_scans > most {
            return Err(Refused::BadValue.into());
        }
        Ok(request.deadline_scans)
    }

    /// One scan: the axis comes to rest where nobody has renewed the order in time.
    pub(super) fn await_renewal(&mut self) {
        let Some(jog) = &mut self.continuous_jog else {
            return;
        };
        jog.left_scans = jog.left_scans.saturating_sub(1);
        if jog.left_scans == 0 {
            self.stop_jog();
        }
    }
}
