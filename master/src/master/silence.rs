//! An axis whose servo says nothing, and what the master itself guards.

use bus::sample::{Cause, Driver, PATH_AXES};
use loops::braking;
use loops::guards::Broken;

use crate::drives::Drives;
use crate::window_arbiter::WindowArbiter;

use super::Master;
use super::axis_unit::AxisUnit;
use super::servos::Taken;

/// Where the window in force has the axes in the scan that ends, in the one that comes next and in the one after it.
#[derive(Debug, Clone, Copy)]
pub(super) struct NextScan<'a> {
    scan: u64,
    positions: Option<[&'a [i64; PATH_AXES]; 3]>,
    at_rest: bool,
    scan_s: f64,
}

impl<'a> NextScan<'a> {
    /// After this scan.
    pub fn after(scan: u64, scan_s: f64, windows: &'a WindowArbiter) -> NextScan<'a> {
        let [now, next, after] = [0, 1, 2].map(|ahead| windows.positions(scan + ahead));
        NextScan {
            scan,
            positions: now.zip(next).zip(after).map(|((a, b), c)| [a, b, c]),
            at_rest: windows.at_rest(scan),
            scan_s,
        }
    }

    /// Where an axis is in the scan that ends, in increments: the window in force has it there, or its course by hand, or nothing
    /// moves it.
    pub fn planned(&self, axis: &AxisUnit) -> Option<i64> {
        let by_window = self.positions.and_then(|[now, _, _]| axis.setpoint(now));
        match (axis.hand.driver(), by_window) {
            (Driver::Program, Some(position)) => Some(position),
            (Driver::Program | Driver::Manual, _) => Some(axis.command_position()),
            (Driver::Drive, _) => None,
        }
    }

    /// Where an axis is commanded to be in the scan that comes next, in increments: no servo has a say in it.
    fn position(&self, axis: &AxisUnit) -> i64 {
        let by_window = self.positions.and_then(|[_, next, _]| axis.setpoint(next));
        match (axis.hand.driver(), by_window) {
            (Driver::Program, Some(position)) => position,
            (Driver::Manual, _) => axis.hand.place_in(1),
            _ => axis.command_position(),
        }
    }

    /// Its speed there, signed.
    fn velocity_mm_s(&self, axis: &AxisUnit) -> f64 {
        let by_window = self.positions.and_then(|[_, next, after]| {
            let (next, after) = (axis.setpoint(next)?, axis.setpoint(after)?);
            Some(after.saturating_sub(next))
        });
        let step = match axis.hand.driver() {
            Driver::Manual => axis.hand.place_in(2).saturating_sub(axis.hand.place_in(1)),
            Driver::Program | Driver::Drive => by_window.unwrap_or(0),
        };
        step as f64 * axis.settings.increment_mm() / self.scan_s
    }

    /// The guard that the axis breaks, whatever its servo says of it.
    pub fn broken_guard(&self, axis: &AxisUnit) -> Cause {
        if axis.hand.driver() == Driver::Drive {
            return Cause::None;
        }
        let (command, feedback) = (self.position(axis), axis.feedback_position());
        let error_mm = command.saturating_sub(feedback) as f64 * axis.settings.increment_mm();
        let broken = axis.guards.following_error(error_mm).or(axis
            .guards
            .feedback(command, feedback)
            .filter(|_| axis.is_homed()));
        match broken {
            None => Cause::None,
            Some(Broken::Travel) => Cause::SoftLimit,
            Some(Broken::FollowingError) => Cause::FollowingError,
            Some(Broken::Speed) => Cause::SpeedLimit,
            Some(Broken::NotFinite) => Cause::BadValue,
        }
    }
}

impl AxisUnit {
    /// Commands an axis with a closed loop whose servo is silent or lost, along the window until that ends at rest: the fault
    /// waits until then. By hand it goes on along its course as long as its servo may answer again.
    pub(super) fn bridge_silence(&mut self, taken: &Taken, fault: Cause, next: &NextScan) -> Cause {
        let by_hand = self.hand.driver() != Driver::Program;
        let lost_by_hand = by_hand && matches!(taken, Taken::Lost);
        if !self.servos.must_be_replaced(taken) || lost_by_hand {
            return fault;
        }
        let position = next.position(self);
        let velocity_mm_s = next.velocity_mm_s(self);
        if let Some(now) = next.planned(self) {
            self.command_to(now);
        }
        self.replace_servo(taken, next.scan, position, velocity_mm_s);
        if by_hand || next.at_rest {
            fault
        } else {
            Cause::None
        }
    }
}

impl<D: Drives> Master<D> {
    /// A trip while a servo is silent: its last word on braking is of another speed, so its axis brakes with the others.
    pub(super) fn brake_silent_axes(&mut self) {
        let next = NextScan::after(self.scan, self.timing.scan_period_s, &self.windows);
        for index in 0..self.axes.len() {
            if !self
                .axes
                .get(index)
                .is_some_and(|axis| axis.servos.are_silent())
            {
                continue;
            }
            let speeds = self.axes.iter().map(|axis| {
                let velocity_mm_s = next.velocity_mm_s(axis);
                (velocity_mm_s, axis.settings.quick_stop_mm_s2)
            });
            let deceleration_mm_s2 = braking::deceleration_mm_s2(speeds, index);
            if let Some(axis) = self.axes.get_mut(index) {
                axis.servos.brake_with(deceleration_mm_s2);
            }
        }
    }
}
