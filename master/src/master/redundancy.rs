//! Whether the other servo of an axis could take it over: a state that everybody sees, and where the machine file says so a
//! reason to hold.

use bus::sample::{Job, Mode, Redundancy, Roster};
use machine::AfterStandby;

use crate::drives::Drives;

use super::Master;
use super::axis_unit::AxisUnit;
use super::decide::SAME_SCANS;

/// An axis with two servos, as to the one that does not drive.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Standby {
    /// How it is.
    pub state: Redundancy,
    /// Scans in a row in which it could not have taken over.
    pub unsynchronised_scans: u32,
    /// How often it has said something else after it had said the same.
    pub differences: u32,
    /// The machine has been held for this loss.
    held: bool,
}

impl AxisUnit {
    /// Ends the scan for the standby: what it is now.
    pub(super) fn judge_standby(&mut self, index: usize, roster: &Roster) {
        if !self.settings.standby {
            return;
        }
        let other = 1 - self.switch.role.min(1) as u32;
        let standby = &mut self.standby;
        standby.state = if roster.living(Job::Servo, index, other).is_none() {
            Redundancy::Lost
        } else if self.switch.same_scans >= SAME_SCANS {
            Redundancy::Synchronised
        } else {
            Redundancy::CatchingUp
        };
        if standby.state == Redundancy::Synchronised {
            standby.unsynchronised_scans = 0;
            standby.held = false;
        } else {
            standby.unsynchronised_scans = standby.unsynchronised_scans.saturating_add(1);
        }
    }
}

impl<D: Drives> Master<D> {
    /// With `[restart] standby = "hold"`, an axis that is without its standby for longer than the alarm takes holds the machine,
    /// once for each loss.
    pub(super) fn hold_without_standby(&mut self) {
        if self.restart.standby != AfterStandby::Hold || self.mode != Mode::Enabled {
            return;
        }
        for axis in &mut self.axes {
            let standby = &mut axis.standby;
            let lost = standby.state == Redundancy::Lost
                || standby.unsynchronised_scans > self.standby_alarm_scans;
            if lost && axis.settings.standby && !standby.held {
                standby.held = true;
                self.hold = true;
            }
        }
    }
}
