//! All axes of the machine, and what is true of them together.

use std::ops::{Deref, DerefMut};

use bus::sample::{Cause, PATH_AXES};
use machine::Machine;

use super::axis_unit::AxisUnit;
use crate::drives::{DriveState, Drives};

/// All axes of the machine.
#[derive(Debug, Clone)]
pub(super) struct Axes(Vec<AxisUnit>);

impl Deref for Axes {
    type Target = [AxisUnit];

    fn deref(&self) -> &[AxisUnit] {
        &self.0
    }
}

impl DerefMut for Axes {
    fn deref_mut(&mut self) -> &mut [AxisUnit] {
        &mut self.0
    }
}

impl Axes {
    /// As many as there are drives, each commanded to be where its drive shows it.
    pub fn new<D: Drives>(machine: &Machine, drives: &D) -> Axes {
        let indices = 0..machine.axes.len().min(drives.count());
        let units =
            indices.filter_map(|index| AxisUnit::new(machine, index, drives.feedback(index)));
        Axes(units.collect())
    }

    /// Those that programs move, in the order in which paths have them.
    pub fn of_path(&self) -> impl Iterator<Item = &AxisUnit> {
        self.iter().take_while(|axis| axis.settings.has_letter())
    }

    /// Whether they are, as far as is seen: a drive that does not answer shows no speed.
    pub fn stand(&self) -> bool {
        let stands = |axis: &AxisUnit| axis.drive().state.is_lost() || axis.stands();
        self.iter().all(stands)
    }

    /// Whether each knows its place.
    pub fn are_homed(&self) -> bool {
        self.iter().all(AxisUnit::is_homed)
    }

    /// Whether a program may move them: farther outside the travel only a jog does, inwards.
    pub fn are_within_travel(&self) -> bool {
        self.iter().all(AxisUnit::is_within_travel)
    }

    /// Whether a program may begin with them: homed, within the travel, and driven by drives that know their places.
    pub fn may_run(&self) -> bool {
        self.iter()
            .all(|axis| axis.may_be_driven() && axis.is_homed() && axis.is_within_travel())
    }

    /// Whether all stand and have a servo that follows them, whatever their drives show.
    pub fn are_served_at_rest(&self) -> bool {
        self.stand() && self.iter().all(|axis| axis.servos.follow())
    }

    /// Whether no drive has a fault or does not answer.
    pub fn drives_can_follow(&self) -> bool {
        self.iter().all(|axis| {
            !matches!(
                axis.drive().state,
                DriveState::Fault { .. } | DriveState::Lost { .. }
            )
        })
    }

    /// Whether every drive is on.
    pub fn drives_follow(&self) -> bool {
        self.iter()
            .all(|axis| axis.drive().state == DriveState::Ready)
    }

    /// Whether a drive does not answer.
    pub fn has_lost_drive(&self) -> bool {
        self.iter().any(|axis| axis.drive().state.is_lost())
    }

    /// A bit for each axis whose drive has a fault.
    pub fn faulted_drives(&self) -> u32 {
        let axes = self.iter().enumerate();
        axes.filter(|(_, axis)| matches!(axis.drive().state, DriveState::Fault { .. }))
            .fold(0, |bits, (index, _)| bits | 1 << index)
    }

    /// The first axis with a fault, and its cause.
    pub fn fault(&self) -> Option<(Cause, u32)> {
        let mut axes = self.iter().enumerate();
        let faulty = axes.find(|(_, axis)| axis.cause() != Cause::None);
        faulty.map(|(index, axis)| (axis.cause(), index as u32))
    }

    /// Faults are forgotten.
    pub fn clear_faults(&mut self) {
        self.iter_mut().for_each(AxisUnit::clear_fault);
    }

    /// The first axis that is not within its in-position window.
    pub fn out_of_position(&self) -> Option<usize> {
        self.iter().position(|axis| !axis.is_in_position())
    }

    /// Where those of the path are commanded to be, in increments.
    pub fn command_positions(&self) -> [i64; PATH_AXES] {
        self.on_path(AxisUnit::command_position)
    }

    /// Something of those of the path, by place on it.
    pub fn on_path<T: Default + Copy>(&self, of: impl Fn(&AxisUnit) -> T) -> [T; PATH_AXES] {
        let mut values = [T::default(); PATH_AXES];
        for (value, axis) in values.iter_mut().zip(self.of_path()) {
            *value = of(axis);
        }
        values
    }
}
