//! An axis whose servo says nothing, and what the master itself guards.

use bus::sample::{Cause, Driver, MAX_AXES};
use loops::braking;
use loops::guards::Broken;

use crate::drives::Drives;
use crate::window_arbiter::WindowArbiter;

use super::Master;
use super::axis_unit::AxisUnit;
use super::substitute::{SILENT_SCANS, Wanted};
use super::switch::Taken;

/// Where the window in force has the axes in the scan that ends, in the one that comes next and in the one after it.
#[derive(Debug, Clone, Copy)]
pub(super) struct NextScan<'a> {
    scan: u64,
    positions: Option<[&'a [i64; MAX_AXES]; 3]>,
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
    pub fn planned(&self, axis: &AxisUnit, index: usize) -> Option<i64> {
        match (axis.driver, self.positions) {
            (Driver::Program, Some([now, _, _])) => now.get(index).copied(),
            (Driver::Program | Driver::Manual, _) => Some(axis.command_position),
            (Driver::Drive, _) => None,
        }
    }

    /// Where an axis is commanded to be in the scan that comes next, in increments: no servo has a say in it.
    fn position(&self, axis: &AxisUnit, index: usize) -> i64 {
        let by_window = self.positions.and_then(|[_, next, _]| next.get(index));
        match (axis.driver, by_window) {
            (Driver::Program, Some(position)) => *position,
            (Driver::Manual, _) => axis.by_hand_in(1),
            _ => axis.command_position,
        }
    }

    /// Its speed there, signed.
    fn velocity_mm_s(&self, axis: &AxisUnit, index: usize) -> f64 {
        let by_window = self.positions.and_then(|[_, next, after]| {
            let (next, after) = (next.get(index)?, after.get(index)?);
            Some(after.saturating_sub(*next))
        });
        let step = match axis.driver {
            Driver::Manual => axis.by_hand_in(2).saturating_sub(axis.by_hand_in(1)),
            Driver::Program | Driver::Drive => by_window.unwrap_or(0),
        };
        step as f64 * axis.settings.increment_mm() / self.scan_s
    }

    /// The guard that the axis breaks, whatever its servo says of it.
    pub fn broken_guard(&self, axis: &AxisUnit, index: usize) -> Cause {
        if axis.driver == Driver::Drive {
            return Cause::None;
        }
        let (command, feedback) = (self.position(axis, index), axis.feedback_position());
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
    /// Takes what became of its commands in this scan; the fault that it is.
    pub(super) fn take(&mut self, taken: &Taken, watchdog_scans: u32) -> Cause {
        self.followed = false;
        match taken {
            Taken::Command(command) => {
                self.missed_in_a_row = 0;
                self.silent = false;
                self.substitute.end();
                self.command = **command;
                self.taken_incarnation = command.incarnation;
                self.command_position = command.position;
                self.followed = true;
                Cause::None
            }
            Taken::Bad(cause) => {
                self.missed_in_a_row = 0;
                *cause
            }
            Taken::Lost => Cause::ServoLost,
            Taken::Missed => {
                self.missed = self.missed.saturating_add(1);
                self.missed_in_a_row = self.missed_in_a_row.saturating_add(1);
                if self.missed_in_a_row >= watchdog_scans {
                    Cause::Watchdog
                } else {
                    Cause::None
                }
            }
        }
    }

    /// Commands an axis with a closed loop whose servo is silent or lost, along the window until that ends at rest: the fault
    /// waits until then. By hand it goes on along its course as long as its servo may answer again.
    pub(super) fn bridge_silence(
        &mut self,
        taken: &Taken,
        fault: Cause,
        next: &NextScan,
        index: usize,
    ) -> Cause {
        let lost = matches!(taken, Taken::Lost);
        let missed = matches!(taken, Taken::Missed) && self.missed_in_a_row >= SILENT_SCANS;
        let by_hand = self.driver != Driver::Program;
        let never_commanded = self.command.incarnation == 0;
        if !(lost || missed) || lost && by_hand || never_commanded {
            return fault;
        }
        self.silent = true;
        // A scan without a command, as those of a servo that lives and says nothing: no log misses what nobody has sent.
        self.missed = self.missed.saturating_add(u32::from(lost));
        self.command.scan = next.scan;
        let position = next.position(self, index);
        if let Some(now) = next.planned(self, index) {
            self.command_position = now;
        }
        self.command.position = self.command_position;
        let wanted = Wanted {
            position_mm: position.saturating_sub(self.offset) as f64 * self.settings.increment_mm(),
            velocity_mm_s: next.velocity_mm_s(self, index),
        };
        self.substitute.step(&mut self.command, &self.drive, wanted);
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
        let next = NextScan::after(self.scan, self.scan_period_s, &self.windows);
        for index in 0..self.axes.len() {
            if !self.axes.get(index).is_some_and(|axis| axis.silent) {
                continue;
            }
            let speeds = self.axes.iter().enumerate().map(|(index, axis)| {
                let velocity_mm_s = next.velocity_mm_s(axis, index);
                (velocity_mm_s, axis.settings.quick_stop_mm_s2)
            });
            let deceleration_mm_s2 = braking::deceleration_mm_s2(speeds, index);
            if let Some(axis) = self.axes.get_mut(index) {
                axis.command.stop_deceleration_mm_s2 = deceleration_mm_s2;
            }
        }
    }
}
