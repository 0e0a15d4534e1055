//! The two motors of a gantry: both have the same command position wherever nothing else gives them one, they are moved by hand
//! together, and the skew between them is guarded (docs/howto/gantry.md).

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

use bus::sample::{Cause, Driver, Mode, Reference};
use machine::GantryPair;

use super::Master;
use super::axis_unit::AxisUnit;
use crate::drives::Drives;

impl<D: Drives> Master<D> {
    /// The gantry whose first motor is that of this axis.
    pub(super) fn led_by(&self, leader: usize) -> Option<GantryPair> {
        self.gantries
            .iter()
            .find(|pair| pair.leader == leader)
            .copied()
    }

    /// Whether this is the second motor of an axis: no order names it.
    pub(super) fn is_follower(&self, axis: usize) -> bool {
        self.gantries.iter().any(|pair| pair.follower == axis)
    }

    /// The second motor does by hand what its leader has just been told to.
    pub(super) fn follow_by_hand(&mut self, leader: usize) {
        let Some(pair) = self.led_by(leader) else {
            return;
        };
        let of_leader = self.axes.get(leader);
        let told = of_leader.map(|axis| (axis.jog_target, axis.driver));
        if let (Some((jog_target, driver)), Some(axis)) = (told, self.axes.get_mut(pair.follower)) {
            axis.jog_target = jog_target;
            axis.driver = driver;
        }
    }

    /// Encoders that begin anywhere, or have lost their place: both motors count from where the first one does, so that skew is what
    /// it has become since.
    pub(super) fn align_gantries(&mut self) {
        for pair in &self.gantries {
            let leader = self.axes.get(pair.leader);
            let place = leader.map(AxisUnit::feedback_position);
            let is_lost = |axis: &&mut AxisUnit| axis.settings.homing.is_some() && !axis.is_homed();
            let follower = self.axes.get_mut(pair.follower).filter(is_lost);
            if let (Some(place), Some(axis)) = (place, follower) {
                axis.offset = place.saturating_sub(axis.feedback_position());
                axis.command_position = axis.feedback_position();
            }
        }
    }

    /// Without a window and out of anybody's hand, the second motor is commanded to be where the first is: a difference that a jog,
    /// switched-off drives or a trip have left is made up for as soon as the loops are closed.
    pub(super) fn couple_gantries(&mut self) {
        if self.windows.has_window() {
            return;
        }
        for pair in &self.gantries {
            let by_program = |axis: &&AxisUnit| axis.driver == Driver::Program;
            let leader = self.axes.get(pair.leader).filter(by_program);
            let Some(place) = leader.map(|axis| axis.command_position) else {
                continue;
            };
            let follower = self.axes.get_mut(pair.follower);
            if let Some(axis) = follower.filter(|axis| axis.driver == Driver::Program) {
                axis.command_position = place;
            }
        }
    }

    /// The two motors of a gantry are homed together: what one has lost, the other does not know either.
    pub(super) fn lose_references_together(&mut self) {
        let mut changed = false;
        for pair in &self.gantries {
            let known = |axis: usize| {
                let axis = self.axes.get(axis);
                axis.is_some_and(|axis| axis.reference == Reference::Known)
            };
            if known(pair.leader) == known(pair.follower) {
                continue;
            }
            for motor in [pair.leader, pair.follower] {
                let axis = self.axes.get_mut(motor);
                if let Some(axis) = axis.filter(|axis| axis.settings.homing.is_some()) {
                    axis.reference = Reference::Missing;
                    changed = true;
                }
            }
        }
        if changed {
            self.align_gantries();
        }
    }

    /// A driven gantry whose skew is beyond its limit has a fault: of its second motor, with the skew in whole µm as its code.
    pub(super) fn judge_skew(&mut self) {
        if matches!(self.mode, Mode::Disabled | Mode::Tripped) {
            return;
        }
        for pair in &self.gantries {
            let (Some(leader), Some(follower)) =
                (self.axes.get(pair.leader), self.axes.get(pair.follower))
            else {
                continue;
            };
            // Before both are homed, positions count from how they were when the master began.
            if leader.reference != follower.reference {
                continue;
            }
            let skew = follower
                .feedback_position()
                .saturating_sub(leader.feedback_position());
            let skew_mm = skew as f64 * follower.settings.increment_mm();
            let Some(axis) = self.axes.get_mut(pair.follower) else {
                continue;
            };
            if skew_mm.abs() > pair.skew_max_mm && axis.cause == Cause::None {
                axis.cause = Cause::Skew;
                axis.fault_code = (libm::round(skew_mm * 1e3) as i32) as u32;
            }
        }
    }
}
