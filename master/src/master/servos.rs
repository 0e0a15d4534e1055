//! The servos of one axis: whose command its drive takes, and what the master commands where there is none.

use bus::sample::{AxisCommand, AxisFeedback, Cause, WindowId};
use bytemuck::Zeroable;
use machine::{Axis, Machine};

use crate::drives::DriveFeedback;

mod decide;
mod standby;
mod substitute;
mod switch;

pub(super) use decide::Plan;
use standby::Standby;
pub(super) use substitute::Wanted;
use substitute::{SILENT_SCANS, Substitute};
pub(super) use switch::Taken;
use switch::{SAME_SCANS, Switch};

/// The servos of one axis.
#[derive(Debug, Clone)]
pub(super) struct Servos {
    /// The command in force.
    command: AxisCommand,
    /// Incarnation of the servo that gave it.
    taken_incarnation: u32,
    missed: u32,
    missed_in_a_row: u32,
    /// The active servo answered the last scan, with nothing to complain of.
    followed: bool,
    /// The active servo is silent or lost: the master commands the axis.
    silent: bool,
    substitute: Substitute,
    switch: Switch,
    standby: Standby,
}

impl Servos {
    pub fn new(machine: &Machine, axis: &Axis) -> Servos {
        Servos {
            command: AxisCommand::zeroed(),
            taken_incarnation: 0,
            missed: 0,
            missed_in_a_row: 0,
            followed: false,
            silent: false,
            substitute: Substitute::new(machine, axis),
            switch: Switch::default(),
            standby: Standby::new(axis),
        }
    }

    /// The command in force.
    pub fn command(&self) -> &AxisCommand {
        &self.command
    }

    /// Whether a servo has commanded anything yet.
    pub fn have_commanded(&self) -> bool {
        self.command.scan != 0 || self.command.incarnation != 0
    }

    /// Whether the active servo answered the last scan well, and none before it is missed.
    pub fn follow(&self) -> bool {
        self.followed && self.missed_in_a_row == 0
    }

    /// Whether the master commands the axis.
    pub fn are_silent(&self) -> bool {
        self.silent
    }

    /// Whether a servo holds this window: a silent one's hold went with it.
    pub fn hold(&self, window: WindowId) -> bool {
        !self.silent && self.command.pending == window
    }

    /// Scans that were missed are forgiven.
    pub fn forgive(&mut self) {
        self.missed_in_a_row = 0;
    }

    /// Takes what became of the commands of this scan; the fault that it is.
    pub fn take(&mut self, taken: &Taken, watchdog_scans: u32) -> Cause {
        self.followed = false;
        match taken {
            Taken::Command(command) => {
                self.missed_in_a_row = 0;
                self.silent = false;
                self.substitute.end();
                self.command = **command;
                self.taken_incarnation = command.incarnation;
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

    /// Whether the master is to command the axis in place of a servo that has commanded it and is lost, or silent for too long.
    pub fn must_be_replaced(&self, taken: &Taken) -> bool {
        let lost = matches!(taken, Taken::Lost);
        let missed = matches!(taken, Taken::Missed) && self.missed_in_a_row >= SILENT_SCANS;
        (lost || missed) && self.command.incarnation != 0
    }

    /// The master's command for a scan: this position in increments, which the drive is to follow as wanted.
    pub fn replace(
        &mut self,
        taken: &Taken,
        scan: u64,
        position: i64,
        drive: &DriveFeedback,
        wanted: Wanted,
    ) {
        self.silent = true;
        // A scan without a command, as those of a servo that lives and says nothing: no log misses what was not sent.
        let lost = matches!(taken, Taken::Lost);
        self.missed = self.missed.saturating_add(u32::from(lost));
        self.command.scan = scan;
        self.command.position = position;
        self.substitute.step(&mut self.command, drive, wanted);
    }

    /// A silent servo's last word on braking is of another speed: its axis brakes with this deceleration.
    pub fn brake_with(&mut self, deceleration_mm_s2: f64) {
        self.command.stop_deceleration_mm_s2 = deceleration_mm_s2;
    }

    /// What the feedback shows of them.
    pub fn tell(&self, feedback: &mut AxisFeedback) {
        feedback.command_scan = self.command.scan;
        feedback.velocity_command_mm_s = self.command.velocity_mm_s;
        feedback.missed_scans = self.missed;
        feedback.missed_in_a_row = self.missed_in_a_row;
        feedback.taken_incarnation = self.taken_incarnation;
        feedback.taken_role = self.command.role;
        self.standby.tell(feedback);
    }

    /// State that a later scan depends on: the active role, the scans in which the other was the same, whether the active one
    /// followed and is silent, and the window that it holds as pending.
    pub fn inner(&self) -> ((usize, u32), bool, bool, WindowId) {
        let same_scans = self.switch.same_scans.min(SAME_SCANS);
        (
            (self.switch.role, same_scans),
            self.followed,
            self.silent,
            self.command.pending,
        )
    }
}
