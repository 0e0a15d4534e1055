//! Whether the other servo of an axis could take it over: a state that everybody sees, and where the machine file says so a
//! reason to hold.

use bus::sample::{AxisFeedback, Job, Redundancy, Roster};
use machine::Axis;

use super::Servos;
use super::switch::SAME_SCANS;

/// An axis with two servos, as to the one that does not drive.
#[derive(Debug, Clone, Copy)]
pub struct Standby {
    /// The machine file asks for one.
    wanted: bool,
    state: Redundancy,
    /// Scans in a row in which it could not have taken over.
    unsynchronised_scans: u32,
    /// Number of times it has said something else after it had said the same.
    differences: u32,
    /// The machine has been held for this loss.
    held: bool,
}

impl Standby {
    pub fn new(axis: &Axis) -> Standby {
        Standby {
            wanted: axis.standby,
            state: Redundancy::default(),
            unsynchronised_scans: 0,
            differences: 0,
            held: false,
        }
    }

    /// It has said something else than the active one, after it had said the same.
    pub fn differs(&mut self) {
        self.differences = self.differences.saturating_add(1);
    }

    pub fn tell(&self, feedback: &mut AxisFeedback) {
        feedback.redundancy = self.state as u32;
        feedback.unsynchronised_scans = self.unsynchronised_scans;
        feedback.differences = self.differences;
    }
}

impl Servos {
    /// Ends the scan for the standby: what it is now.
    pub fn judge_standby(&mut self, index: usize, roster: &Roster) {
        let standby = &mut self.standby;
        if !standby.wanted {
            return;
        }
        let other = 1 - self.switch.role.min(1) as u32;
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

    /// Whether the machine is to be held because the standby is lost, or was not synchronised for more than these scans: once for each
    /// loss.
    pub fn hold_for_standby(&mut self, alarm_scans: u32) -> bool {
        let standby = &mut self.standby;
        let lost = standby.state == Redundancy::Lost || standby.unsynchronised_scans > alarm_scans;
        lost && standby.wanted && !std::mem::replace(&mut standby.held, true)
    }
}
